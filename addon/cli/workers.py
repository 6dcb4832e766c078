# SPDX-License-Identifier: GPL-3.0-or-later
"""Work in processes that go through the same door as this one: a window's own, or takes side by side.

Neither threads (NumPy's small steps hold Python's lock) nor `multiprocessing` (it starts `sys.executable`, which in
Blender is not what runs us, and imports a main module that Blender does not have) would do.
"""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import IO, Any, cast

from ..core.data.errors import InputError, JobError
from ..io.scratch import naming_scratch, scratch_folder
from .parcels import read_parcel, write_parcel
from .serving import ANSWER, HANDED, PATIENCE, POLL, SERVE, SHARE

Answers = Generator[tuple[int, Any], None, None]  # the number of each work, and what came of it, such as trouble
ROOT = Path(__file__).resolve().parents[2]
EXTENSION = "mocap_autolabel"
NO_MORE = object()  # of the works
FILES = count()  # in scratch folders, that no two have one name
HEAR_S = 0.02  # s between two looks at what processes have said
# Opens the package from where it lies, whatever it is called and wherever it was installed.
SCRIPT = """
import importlib.util, json, sys
root, sys.path[:] = sys.argv[1], json.loads(sys.argv[2])
name, start = "mocap_autolabel", root + "/__init__.py"
spec = importlib.util.spec_from_file_location(name, start, submodule_search_locations=[root])
sys.modules[name] = package = importlib.util.module_from_spec(spec)
spec.loader.exec_module(package)
from mocap_autolabel.addon.cli import main
sys.exit(main(sys.argv[3:]))
"""


class Worker:
    """A process that does one work after the other; `share` of the last is done, as far as it tells.

    `busy` is whether it is at work, `hint` what else is said where it is killed.
    """

    result: Path | None = None  # where what comes of the last work will be

    def __init__(self, scratch: Path, hint: str = ""):
        """Starts it; JobError where there can be none."""
        self.scratch, self.share, self.hint, self.busy = scratch, 0.0, hint, False
        name = scratch / str(next(FILES))
        self.said, self.errors = name.with_suffix(".stdout"), name.with_suffix(".stderr")
        self._read, self._rest = 0, b""
        with naming_scratch(scratch):
            output, errors = self.said.open("wb"), self.errors.open("wb")
        with output, errors:
            try:
                self.process = subprocess.Popen(  # noqa: S603 - it is ourselves
                    [*door(), SERVE],
                    stdin=subprocess.PIPE,
                    stdout=output,
                    stderr=errors,
                    start_new_session=True,  # a Ctrl-C reaches us only, and we stop them once
                )
            except OSError as error:
                reason = error.strerror or error
                raise JobError(f"no process can be started for it ({reason}); expected fewer --jobs") from None
        self.pipe = cast("IO[bytes]", self.process.stdin)

    def hand(self, work: Callable):
        """Hands it a function of ours with what it is given; what that returns, which is not None, is looked at."""
        self.busy, self.share = True, 0.0
        parcel, self.result = (self.scratch / f"{next(FILES)}.{kind}" for kind in ("parcel", "result"))
        write_parcel(parcel, work)
        with suppress(OSError):  # that it is gone shows where it would have answered
            self.pipe.write(json.dumps([HANDED, str(self.result), str(parcel)]).encode() + b"\n")
            self.pipe.flush()

    def look(self) -> Any:
        """What came of the work, or how the process ended where that is all; None while it is at work."""
        ended = self.process.poll() is not None  # before what it said is read
        with self.said.open("rb") as file:
            file.seek(self._read)
            said = file.read()
        self._read += len(said)
        *lines, self._rest = (self._rest + said).split(b"\n")
        for line in (line.decode("utf-8", "replace") for line in lines):
            if line.startswith(SHARE):
                self.share = float(line[len(SHARE) :])
            elif line.startswith(ANSWER):
                return self._answer(**json.loads(line[len(ANSWER) :]))
        if ended:
            return self._answer(self.process.returncode, self.errors.read_bytes().decode("utf-8", "replace"))
        return None

    def _answer(self, status: int, errors: str) -> Any:
        """What came of the work, or why nothing did, by its exit status and what it said on standard error."""
        self.busy = False
        if status == 0 and self.result and self.result.is_file():
            found = read_parcel(self.result)
            self.result.unlink()  # results of a whole session are many
            return found
        lines = errors.strip().splitlines()
        reason = next((line for line in reversed(lines) if line.startswith("mocap-autolabel: ")), "")
        if reason:
            return (InputError if status == InputError.exit_status else JobError)(reason.partition(": ")[2])
        if status >= 0:
            return JobError(f"its process ended with status {status} and said nothing; expected it to finish")
        try:
            killed = signal.Signals(-status).name
        except ValueError:
            killed = str(status)
        words = f"its process was killed ({killed}), as systems do when memory is full"
        return JobError(f"{words}; expected it to finish{self.hint}")

    def close(self):
        """Lets go of the pipe to the process, which ends itself then; at once where it starts up or cannot hear it."""
        if not self.result or (self.busy and sys.platform == "win32"):
            self.process.kill()
        with suppress(OSError):
            self.pipe.close()


class Crew:
    """So many processes at most, those of them that are idle, and a folder for what they leave."""

    def __init__(self, jobs: int, scratch: Path):
        self.jobs, self.scratch = jobs, scratch
        self.workers: list[Worker] = []
        self.idle: list[Worker] = []

    def start(self) -> Worker:
        """Another process; JobError where there can be none."""
        worker = Worker(self.scratch, ", see --jobs")
        self.workers.append(worker)
        return worker

    def run(self, works: Iterable[Callable | None]) -> Answers:
        """Number and answer of each work, as they come; processes that ended meanwhile are replaced."""
        at_work: dict[Worker, int] = {}
        left, numbers, more, again = iter(works), count(), True, 0.0
        while more or at_work:
            while more and len(at_work) < self.jobs and time.monotonic() >= again:
                worker = self._free()
                if isinstance(worker, JobError) and at_work:
                    break  # the next of these that is done takes the work
                work = next(left, NO_MORE)
                more, again = work is not NO_MORE, time.monotonic() + (POLL if work is None else 0)
                if callable(work) and isinstance(worker, Worker):
                    worker.hand(work)
                    at_work[worker] = next(numbers)
                elif callable(work):
                    yield next(numbers), worker
                elif isinstance(worker, Worker):
                    self.idle.append(worker)
            done = [(worker, answer) for worker in at_work if (answer := worker.look()) is not None]
            for worker, answer in done:
                if worker.process.poll() is None:
                    self.idle.append(worker)
                else:
                    self.workers.remove(worker)
                    worker.close()
                yield at_work.pop(worker), answer
            if not done:
                time.sleep(HEAR_S)

    def _free(self) -> Worker | JobError:
        """A process with nothing to do, another one, or why there is none."""
        try:
            return self.idle.pop() if self.idle else self.start()
        except JobError as error:
            return error

    def stop(self):
        """Lets the processes end, which lets them clean up, and insists where one does not."""
        for worker in self.workers:
            worker.close()
        limit = time.monotonic() + PATIENCE
        for worker in self.workers:
            try:
                worker.process.wait(max(limit - time.monotonic(), 0.1))
            except subprocess.TimeoutExpired:
                worker.process.kill()
                worker.process.wait()


@contextmanager
def crew(jobs: int) -> Iterator[Callable[[Iterable[Callable | None]], Answers]]:
    """Starts so many processes; gives what has them work, each a function of ours with what it is given.

    It yields the number of each, and its answer. Works may come one after the other, each asked for when a process has
    time for it; None among them stands for none at the moment. The processes start up while whoever has begun them
    looks at what they are to do, and end with this block, or with this process.
    """
    with scratch_folder() as scratch:
        workers = Crew(jobs, scratch)
        try:
            with suppress(JobError):  # said of the takes, where none can be started then either
                for _ in range(jobs):
                    workers.idle.append(workers.start())
            yield workers.run
        finally:
            workers.stop()


def door() -> list[str]:
    """The command that comes back to `main`, to be followed by its arguments."""
    blender = sys.modules["bpy"].app.binary_path if "bpy" in sys.modules else ""
    if blender:
        # By its name too: who has just enabled the extension may not have saved the preferences yet.
        package = __name__.removesuffix(".addon.cli.workers")
        named = ["--addons", package] if package.startswith("bl_ext.") else []
        return [blender, "--background", *named, "--command", EXTENSION]
    # Once bpy is imported, Blender's folders of scripts come first, and the bpy in them is none on its own. Without -P
    # the current folder would be looked for, which may be gone.
    paths = [path for path in sys.path if not (Path(path) / "bpy" / "__init__.py").is_file()]
    return [sys.executable, "-P", "-c", SCRIPT, str(ROOT), json.dumps(paths)]
