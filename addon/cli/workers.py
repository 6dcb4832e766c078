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
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
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


@dataclass(frozen=True)
class Command:
    """A command line, the last word of which is its take, and the file that it leaves its result in."""

    number: int
    line: list[str]
    result: Path

    @property
    def take(self) -> str:
        """What it labels."""
        return self.line[-1]

    def sent(self) -> bytes:
        """It as one line for a process to read."""
        return json.dumps([self.line[0], "--result", str(self.result), *self.line[1:]]).encode() + b"\n"

    def answer(self, status: int, said: str) -> dict | UserError:
        """What came of it, or why nothing did, by its exit status and what it said on standard error."""
        if status == 0 and self.result.is_file():
            return json.loads(read_bytes(self.result))
        lines = said.strip().splitlines()
        reason = next((line for line in reversed(lines) if line.startswith("mocap-autolabel: ")), "")
        error = InputError if status == InputError.exit_status else JobError
        return error(reason.partition(": ")[2]) if reason else self._without_a_word(status)

    def _without_a_word(self, status: int) -> JobError:
        """How a process ended that had no last word."""
        if status >= 0:
            return JobError(
                f"its process ended with status {status} and said nothing; expected it to finish", self.take
            )
        try:
            killed = signal.Signals(-status).name
        except ValueError:
            killed = str(status)
        return JobError(
            f"its process was killed ({killed}), as systems do when memory is full; expected it to finish, see --jobs",
            self.take,
        )


@dataclass(eq=False)
class Worker:
    """One process, the pipe to it, the file of what it says on standard error, where all are heard, what it is at."""

    process: subprocess.Popen
    pipe: IO[bytes]
    errors: Path
    heard: "queue.SimpleQueue[tuple[Worker, bytes | None]]"
    command: Command | None = field(default=None, init=False)
    begun: bool = field(default=False, init=False)  # whether it ever had one

    def __post_init__(self):
        threading.Thread(target=self._listen, daemon=True).start()

    def begin(self, command: Command):
        """Sends it a command; that it is gone shows where it would have answered."""
        self.command, self.begun = command, True
        with suppress(OSError):
            self.pipe.write(command.sent())
            self.pipe.flush()

    def close(self):
        """Lets go of the pipe to the process, which ends itself then."""
        with suppress(OSError):
            self.pipe.close()

    def ending(self) -> dict:
        """How it ended, and what it said before."""
        said = self.errors.read_bytes().decode("utf-8", "replace")
        return {"status": self.process.returncode, "said": said}

    def _listen(self):
        for line in self.process.stdout:
            if line.startswith(ANSWER.encode()):
                self.heard.put((self, line[len(ANSWER) :]))
        self.process.wait()
        self.heard.put((self, None))


@contextmanager
def crew(jobs: int) -> Iterator[Callable[[Iterable[list[str] | None]], Answers]]:
    """Starts so many processes; gives what runs command lines by them (argv of `main` that take `--result FILE`).

    It yields the number of each, and its answer. The last word of each is its take. Lines may come one after the other,
    each asked for when a process has time for it; None among them stands for none at the moment. The processes start up
    while whoever has begun them looks at what they are to do, and end with this block, or with this process.
    """
    with scratch_folder() as scratch:
        workers: list[Worker] = []
        heard: queue.SimpleQueue[tuple[Worker, bytes | None]] = queue.SimpleQueue()
        try:
            with suppress(JobError):  # said of the takes, where none can be started then either
                while len(workers) < jobs:
                    workers.append(start_process(scratch, heard))
            yield partial(_run, scratch, workers, heard, jobs)
        finally:
            _stop(workers)


def _run(
    scratch: Path, workers: list[Worker], heard: queue.SimpleQueue, jobs: int, commands: Iterable[list[str] | None]
) -> Answers:
    """Number and answer of each command line, as they come; processes that ended meanwhile are replaced."""
    waiting: list[Command] = []
    lines, numbers, more, pausing = iter(commands), count(), True, False
    while more or waiting or any(worker.command for worker in workers):
        wanted, pausing = jobs - sum(worker.command is not None for worker in workers), False
        while more and not pausing and len(waiting) < wanted:
            line = next(lines, NO_MORE)
            more, pausing = line is not NO_MORE, line is None
            if isinstance(line, list):
                number = next(numbers)
                waiting.append(Command(number, line, scratch / f"{number}.json"))
        yield from _man(scratch, workers, heard, jobs, waiting)
        for worker in workers:
            if waiting and worker.command is None:
                worker.begin(waiting.pop(0))
        if not workers and not pausing:  # none could be started
            continue
        try:
            worker, said = heard.get(timeout=POLL)
        except queue.Empty:
            continue
        command, worker.command = worker.command, None
        if said is None:
            workers.remove(worker)
            worker.close()
        if command is not None:
            ending = json.loads(said) if said else worker.ending()
            yield command.number, command.answer(**ending)


def _man(
    scratch: Path, workers: list[Worker], heard: queue.SimpleQueue, jobs: int, waiting: list[Command]
) -> Iterator[tuple[int, UserError]]:
    """Starts processes for what waits; where there can be none, number and answer of a command that nobody takes."""
    while waiting and len(workers) < jobs:
        try:
            workers.append(start_process(scratch, heard))
        except JobError as error:
            if workers:  # which take what is left
                return
            command = waiting.pop(0)
            yield command.number, JobError(error.message, error.file or command.take)


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


def start_process(scratch: Path, heard: queue.SimpleQueue) -> Worker:
    """A new process that waits for commands; JobError where there can be none."""
    errors = scratch / f"{time.monotonic_ns()}.stderr"
    with naming_scratch(scratch):
        output = errors.open("wb")
    with output:
        try:
            process = subprocess.Popen(  # noqa: S603 - it is ourselves
                [*door(), SERVE],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=output,
                start_new_session=True,  # a Ctrl-C reaches us only, and we stop them once
            )
        except OSError as error:
            reason = error.strerror or error
            raise JobError(f"no process can be started for it ({reason}); expected fewer --jobs") from None
    return Worker(process, cast("IO[bytes]", process.stdin), errors, heard)


def _stop(workers: list[Worker]):
    """Lets the processes end, which lets them clean up, and insists where one does not."""
    for worker in workers:
        if not worker.begun:  # it is still starting up, and has nothing to clean up
            worker.process.kill()
        worker.close()
    limit = time.monotonic() + PATIENCE
    for worker in workers:
        try:
            worker.process.wait(max(limit - time.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            worker.process.kill()
            worker.process.wait()
