# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes side by side, in processes that go through the same door as this one and take one take after the other.

Neither threads (NumPy's small steps hold Python's lock) nor `multiprocessing` (it starts `sys.executable`, which in
Blender is not what runs us, and imports a main module that Blender does not have) would do.
"""

import json
import queue
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from functools import partial
from itertools import count
from pathlib import Path
from typing import IO, cast

from ..core.data.errors import InputError, JobError, UserError
from ..io.scratch import naming_scratch, scratch_folder
from ..io.source import read_bytes
from .serving import ANSWER, PATIENCE, POLL, SERVE

Answers = Generator[tuple[int, dict | UserError], None, None]  # the number of each command line, and what came of it
ROOT = Path(__file__).resolve().parents[2]
EXTENSION = "mocap_autolabel"
NO_MORE = object()  # of the command lines
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
    """A process that takes one command after the other; `begun` once it had any."""

    def __init__(self, scratch: Path, words: Sequence[str] = (SERVE,)):
        """Starts it with such words; JobError where there can be none."""
        self.errors, self.begun = scratch / f"{time.monotonic_ns()}.stderr", False
        with naming_scratch(scratch):
            output = self.errors.open("wb")
        with output:
            try:
                self.process = subprocess.Popen(  # noqa: S603 - it is ourselves
                    [*door(), *words],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=output,
                    start_new_session=True,  # a Ctrl-C reaches us only, and we stop them once
                )
            except OSError as error:
                reason = error.strerror or error
                raise JobError(f"no process can be started for it ({reason}); expected fewer --jobs") from None
        self.pipe = cast("IO[bytes]", self.process.stdin)

    def run(self, line: list[str], result: Path) -> dict | UserError:
        """What comes of a command line, which leaves that in a file; how the process ended where that is all."""
        self.begun = True
        self.say(json.dumps([line[0], "--result", str(result), *line[1:]]).encode() + b"\n")
        for reply in cast("IO[bytes]", self.process.stdout):
            if reply.startswith(ANSWER.encode()):
                return _answer(line[-1], result, **json.loads(reply[len(ANSWER) :]))
        return self.ended(line[-1], result)

    def say(self, line: bytes):
        """Sends a line to the process; that it is gone shows where it would have answered."""
        with suppress(OSError):
            self.pipe.write(line)
            self.pipe.flush()

    def ended(self, take: str, result: Path) -> dict | UserError:
        """What has come of a process that has ended."""
        errors = self.errors.read_bytes().decode("utf-8", "replace")
        return _answer(take, result, self.process.wait(), errors)

    def close(self):
        """Lets go of the pipe to the process, which ends itself then; at once where it is still starting up."""
        if not self.begun:
            self.process.kill()
        with suppress(OSError):
            self.pipe.close()


def _answer(take: str, result: Path, status: int, errors: str) -> dict | UserError:
    """What came of a command line, or why nothing did, by its exit status and what it said on standard error."""
    if status == 0 and result.is_file():
        return json.loads(read_bytes(result))
    lines = errors.strip().splitlines()
    reason = next((line for line in reversed(lines) if line.startswith("mocap-autolabel: ")), "")
    if reason:
        return (InputError if status == InputError.exit_status else JobError)(reason.partition(": ")[2])
    if status >= 0:
        return JobError(f"its process ended with status {status} and said nothing; expected it to finish", take)
    try:
        killed = signal.Signals(-status).name
    except ValueError:
        killed = str(status)
    return JobError(
        f"its process was killed ({killed}), as systems do when memory is full; expected it to finish, see --jobs", take
    )


class Crew:
    """So many processes at most, those of them that are idle, and a folder for what they leave."""

    def __init__(self, jobs: int, scratch: Path):
        self.jobs, self.scratch = jobs, scratch
        self.workers: list[Worker] = []
        self.idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()

    def start(self) -> Worker:
        """Another process; JobError where there can be none."""
        worker = Worker(self.scratch)
        self.workers.append(worker)
        return worker

    def run(self, pool: ThreadPoolExecutor, commands: Iterable[list[str] | None]) -> Answers:
        """Number and answer of each command line, as they come; processes that ended meanwhile are replaced."""
        at_work: dict[Future, int] = {}
        lines, numbers, more = iter(commands), count(), True
        while more or at_work:
            while more and len(at_work) < self.jobs:
                line = next(lines, NO_MORE)
                more = line is not NO_MORE
                if not isinstance(line, list):
                    break
                number = next(numbers)
                at_work[pool.submit(self._do, line, self.scratch / f"{number}.json")] = number
            if not at_work and more:
                time.sleep(POLL)
            for future in wait(at_work, POLL, FIRST_COMPLETED).done:
                yield at_work.pop(future), future.result()

    def _do(self, line: list[str], result: Path) -> dict | UserError:
        try:
            worker = self._free()
        except JobError as error:
            return JobError(error.message, error.file or line[-1])
        answer = worker.run(line, result)
        if worker.process.poll() is None:
            self.idle.put(worker)
        else:
            self.workers.remove(worker)
            worker.close()
        return answer

    def _free(self) -> Worker:
        """A process with nothing to do; where none can be started, the next of the others that is done."""
        with suppress(queue.Empty):
            return self.idle.get_nowait()
        while True:
            try:
                return self.start()
            except JobError:
                if not self.workers:
                    raise
            with suppress(queue.Empty):
                return self.idle.get(timeout=POLL)

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
def crew(jobs: int) -> Iterator[Callable[[Iterable[list[str] | None]], Answers]]:
    """Starts so many processes; gives what runs command lines by them (argv of `main` that take `--result FILE`).

    It yields the number of each, and its answer. The last word of each is its take. Lines may come one after the other,
    each asked for when a process has time for it; None among them stands for none at the moment. The processes start up
    while whoever has begun them looks at what they are to do, and end with this block, or with this process.
    """
    with scratch_folder() as scratch, ThreadPoolExecutor(jobs) as pool:
        workers = Crew(jobs, scratch)
        try:
            with suppress(JobError):  # said of the takes, where none can be started then either
                for _ in range(jobs):
                    workers.idle.put(workers.start())
            yield partial(workers.run, pool)
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
    # Once bpy is imported, Blender's folders of scripts come first, and the bpy in them is none on its own.
    paths = [path for path in sys.path if not (Path(path) / "bpy" / "__init__.py").is_file()]
    return [sys.executable, "-c", SCRIPT, str(ROOT), json.dumps(paths)]
