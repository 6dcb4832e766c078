# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds a real Blender, the program with a window, and runs it apart from the user's own settings.

Looked for in this order: the command in the environment variable MOCAP_BLENDER, `blender` on PATH, and a
`shared/tools/real-blender` beside the repository that brings one with a screen of its own.
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TOOL = ROOT.parent / "shared" / "tools" / "real-blender"
WINDOW = (
    "--factory-startup",
    "--no-window-focus",
    "--enable-event-simulate",
    "--window-geometry",
    "0",
    "0",
    "1600",
    "1000",
)


@dataclass(frozen=True)
class RealBlender:
    """A Blender program: `command` starts it; `tool` says that the command is the tool beside the repository."""

    command: tuple[str, ...]
    tool: bool = False
    version: tuple[int, int, int] = (0, 0, 0)

    def run(self, *arguments: str, home: Path, seconds: float = 300) -> subprocess.CompletedProcess:
        """Run `blender ARGUMENTS…` with its settings in the folder `home`; output is text."""
        command = [*self.command, *(["run"] if self.tool else []), *arguments]
        return _run(command, self._environment(home), seconds)

    def window(self, script: Path, out: Path, *, home: Path, seconds: float = 120) -> subprocess.CompletedProcess:
        """Open Blender's window and run `script` in it, until the script quits Blender or the time is over.

        The script finds the folder `out` in the environment variable MOCAP_OUT. Raises LookupError, with the reason,
        where no window can be opened.
        """
        environment = self._environment(home) | {"MOCAP_OUT": str(out), "LIBGL_ALWAYS_SOFTWARE": "1"}
        if self.tool:
            return _run([*self.command, "window", str(script), str(out)], environment, seconds)
        command = [*self.command, *WINDOW, "--python", str(script)]
        if sys.platform != "linux" or environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"):
            return _run(command, environment, seconds)
        with _screen() as display:
            return _run(command, environment | {"DISPLAY": display}, seconds)

    def _environment(self, home: Path) -> dict[str, str]:
        names = ("REAL_BLENDER_HOME", "BLENDER_USER_RESOURCES")
        return dict(os.environ) | dict.fromkeys(names, str(home))


def find() -> RealBlender:
    """The first real Blender that starts; raises LookupError with the reason when there is none."""
    if command := os.environ.get("MOCAP_BLENDER"):
        return _started(RealBlender(tuple(shlex.split(command))), "MOCAP_BLENDER")
    if command := shutil.which("blender"):
        return _started(RealBlender((command,)), "blender on PATH")
    if TOOL.exists():
        return _started(RealBlender((str(TOOL),), tool=True), "the tool beside the repository")
    raise LookupError("no real Blender: MOCAP_BLENDER is not set and `blender` is not on PATH")


def _started(blender: RealBlender, where: str) -> RealBlender:
    with tempfile.TemporaryDirectory(prefix="mocap-blender-") as home:
        try:
            done = blender.run("--background", "--version", home=Path(home), seconds=60)
        except OSError as error:
            raise LookupError(f"no real Blender: {where} does not start ({error})") from None
    version = re.search(r"^Blender (\d+)\.(\d+)\.(\d+)", done.stdout, re.MULTILINE)
    if done.returncode or not version:
        raise LookupError(f"no real Blender: {where} does not start ({(done.stdout + done.stderr).strip()[-200:]})")
    return replace(blender, version=tuple(int(number) for number in version.groups()))


@contextmanager
def _screen() -> Iterator[str]:
    """A virtual screen for as long as the context lasts; gives its DISPLAY."""
    if shutil.which("Xvfb") is None:
        raise LookupError("no window: there is no screen (DISPLAY is not set) and no Xvfb")
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1600x1000x24"]
    server = subprocess.Popen(command, pass_fds=(write,), stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read, encoding="utf-8") as answer:
            number = answer.readline().strip()
        if not number:
            raise LookupError("no window: Xvfb does not start")
        yield f":{number}"
    finally:
        server.terminate()
        server.wait()


def _run(command: list[str], environment: dict[str, str], seconds: float) -> subprocess.CompletedProcess:
    """Run to the end or, when the time is over, end the command and all it started and say so among the errors."""
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        env=environment | {"REAL_BLENDER_S": str(int(seconds))},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    try:
        output, errors = process.communicate(timeout=seconds + 10)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        output, errors = process.communicate()
        errors += f"\nstopped after {seconds:.0f} s"
    return subprocess.CompletedProcess(command, process.returncode, output, errors)
