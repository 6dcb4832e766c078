# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes side by side: each in a process of its own that goes through the same door as this one.

Neither threads (NumPy's small steps hold Python's lock) nor `multiprocessing` (it starts `sys.executable`, which in
Blender is not what runs us, and imports a main module that Blender does not have) would do.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from ..core.data.errors import InputError, JobError, UserError

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
    """One process at work: the number of its job, its folder for what it says."""

    number: int
    process: subprocess.Popen
    folder: Path
    outputs: tuple[IO, ...]

    def answer(self) -> dict | UserError:
        """What the process found out, or why it could not."""
        for output in self.outputs:
            output.close()
        result = self.folder / "result.json"
        if self.process.returncode == 0 and result.is_file():
            return json.loads(result.read_text(encoding="utf-8"))
        said = (self.folder / "stderr").read_text(encoding="utf-8", errors="replace").strip().splitlines()
        reason = next((line for line in reversed(said) if line.startswith("mocap-autolabel: ")), "")
        error = InputError if self.process.returncode == InputError.exit_status else JobError
        ended = f"its process ended with status {self.process.returncode}; expected it to finish"
        return error(reason.partition(": ")[2] or ended)


def side_by_side(commands: Sequence[list[str]], jobs: int) -> Iterator[tuple[int, dict | UserError]]:
    """Runs command lines (argv of `main` that take `--result FILE`), `jobs` at a time; yields number and answer.

    Closing the generator stops what runs.
    """
    waiting, running = list(enumerate(commands)), []
    with tempfile.TemporaryDirectory(prefix="mocap-autolabel-") as scratch:
        try:
            while waiting or running:
                while waiting and len(running) < jobs:
                    running.append(_start(*waiting.pop(0), Path(scratch)))
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
    folder.mkdir()
    outputs = tuple((folder / name).open("wb") for name in ("stdout", "stderr"))
    line = [*door(), command[0], "--result", str(folder / "result.json"), *command[1:]]
    process = subprocess.Popen(  # noqa: S603 - it is ourselves
        line,
        stdin=subprocess.DEVNULL,
        stdout=outputs[0],
        stderr=outputs[1],
        start_new_session=True,  # a Ctrl-C reaches us only, and we stop them once
    )
    return Worker(number, process, folder, outputs)


def _stop(running: list[Worker]):
    """Asks the processes to end, which lets them clean up, and insists where one does not.

    On Windows the Ctrl-C that ends us has reached them too.
    """
    for worker in running:
        if os.name == "posix":
            worker.process.send_signal(signal.SIGINT)
    limit = time.monotonic() + PATIENCE
    for worker in running:
        try:
            worker.process.wait(max(limit - time.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            worker.process.kill()
            worker.process.wait()
        for output in worker.outputs:
            output.close()
