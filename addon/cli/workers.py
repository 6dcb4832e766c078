# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes side by side: each in a process of its own that goes through the same door as this one.

Neither threads (NumPy's small steps hold Python's lock) nor `multiprocessing` (it starts `sys.executable`, which in
Blender is not what runs us, and imports a main module that Blender does not have) would do.
"""

import _thread
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from ..core.data.errors import InputError, JobError, UserError
from ..io.scratch import naming_scratch, scratch_folder

ROOT = Path(__file__).resolve().parents[2]
EXTENSION = "mocap_autolabel"
PAUSE = 0.05
PATIENCE = 10.0
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


@dataclass
class Worker:
    """One process at work: the number of its job and the take that it is for, its folder for what it says."""

    number: int
    take: str
    process: subprocess.Popen
    folder: Path
    outputs: tuple[IO, ...]

    def answer(self) -> dict | UserError:
        """What the process found out, or why it could not."""
        self.close()
        result = self.folder / "result.json"
        if self.process.returncode == 0 and result.is_file():
            return json.loads(result.read_text(encoding="utf-8"))
        said = (self.folder / "stderr").read_text(encoding="utf-8", errors="replace").strip().splitlines()
        reason = next((line for line in reversed(said) if line.startswith("mocap-autolabel: ")), "")
        error = InputError if self.process.returncode == InputError.exit_status else JobError
        return error(reason.partition(": ")[2]) if reason else self._ended()

    def close(self):
        """Lets go of what leads to and from the process; where it still runs, it ends itself then."""
        self.process.stdin.close()
        for output in self.outputs:
            output.close()

    def _ended(self) -> JobError:
        """How a process ended that had no last word."""
        status = self.process.returncode
        if status >= 0:
            return JobError(
                f"its process ended with status {status} and said nothing; expected it to finish", self.take
            )
        with suppress(ValueError):
            status = signal.Signals(-status).name
        return JobError(
            f"its process was killed ({status}), as systems do when memory is full; expected it to finish, see --jobs",
            self.take,
        )


def side_by_side(commands: Sequence[list[str]], jobs: int) -> Iterator[tuple[int, dict | UserError]]:
    """Runs command lines (argv of `main` that take `--result FILE`), `jobs` at a time; yields number and answer.

    The last word of each is its take. Closing the generator stops what runs, and so does the end of this process.
    """
    waiting, running = list(enumerate(commands)), []
    with scratch_folder() as scratch:
        try:
            while waiting or running:
                while waiting and len(running) < jobs:
                    number, command = waiting.pop(0)
                    try:
                        running.append(_start(number, command, scratch))
                    except JobError as error:
                        yield number, error
                finished = [worker for worker in running if worker.process.poll() is not None]
                running = [worker for worker in running if worker not in finished]
                for worker in finished:
                    yield worker.number, worker.answer()
                if not finished:
                    time.sleep(PAUSE)
        finally:
            _stop(running)


def door() -> list[str]:
    """The command that comes back to `main`, to be followed by its arguments."""
    blender = sys.modules["bpy"].app.binary_path if "bpy" in sys.modules else ""
    if blender:
        return [blender, "--background", "--command", EXTENSION]
    # Once bpy is imported, Blender's folders of scripts come first, and the bpy in them is none on its own.
    paths = [path for path in sys.path if not (Path(path) / "bpy" / "__init__.py").is_file()]
    return [sys.executable, "-c", SCRIPT, str(ROOT), json.dumps(paths)]


def _start(number: int, command: list[str], scratch: Path) -> Worker:
    folder = scratch / str(number)
    with naming_scratch(scratch):
        folder.mkdir()
        outputs = tuple((folder / name).open("wb") for name in ("stdout", "stderr"))
    line = [*door(), command[0], "--result", str(folder / "result.json"), *command[1:]]
    try:
        process = subprocess.Popen(  # noqa: S603 - it is ourselves
            line,
            stdin=subprocess.PIPE,  # see end_with_parent
            stdout=outputs[0],
            stderr=outputs[1],
            start_new_session=True,  # a Ctrl-C reaches us only, and we stop them once
        )
    except OSError as error:
        for output in outputs:
            output.close()
        reason = error.strerror or error
        raise JobError(f"no process can be started for it ({reason}); expected fewer --jobs", command[-1]) from None
    return Worker(number, command[-1], process, folder, outputs)


def end_with_parent():
    """Ends this process, as Ctrl-C does, when the one that started it is gone: the pipe to it closes then.

    That holds on every system, however the parent ended.
    """

    def watch():
        with suppress(OSError):
            while os.read(0, 1024):
                pass
        _thread.interrupt_main()
        time.sleep(PATIENCE)
        os._exit(JobError.exit_status)

    threading.Thread(target=watch, daemon=True).start()


def _stop(running: list[Worker]):
    """Lets the processes end, which lets them clean up, and insists where one does not."""
    for worker in running:
        worker.close()
    limit = time.monotonic() + PATIENCE
    for worker in running:
        try:
            worker.process.wait(max(limit - time.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            worker.process.kill()
            worker.process.wait()
