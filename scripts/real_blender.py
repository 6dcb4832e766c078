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
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TOOL = ROOT.parent / "shared" / "tools" / "real-blender"
ABOUT = 'import bpy, sys; print("About", *bpy.app.version, "{}{}".format(*sys.version_info))'
# It takes a number that is free, and ends with its one window.
XVFB = ("Xvfb", "-displayfd", "1", "-screen", "0", "1600x1000x24", "-terminate")
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
    """A Blender program: `command` starts it; `tool` says that the command is the tool beside the repository.

    `python` is that of its Python, such as 313.
    """

    command: tuple[str, ...]
    tool: bool = False
    version: tuple[int, ...] = (0, 0, 0)
    python: str = ""

    def run(self, *arguments: str, home: Path, seconds: float = 300) -> subprocess.CompletedProcess:
        """Run `blender ARGUMENTS…` with its settings in the folder `home`; output is text."""
        return _run(self._line(*arguments), self._environment(home), seconds)

    def window(self, script: Path, out: Path, *, home: Path, seconds: float = 120) -> subprocess.CompletedProcess:
        """Open Blender's window and run `script` in it, until the script quits Blender or the time is over.

        The script finds the folder `out` in the environment variable MOCAP_OUT. Raises LookupError, with the reason,
        where no window can be opened.
        """
        environment = self._environment(home) | {"MOCAP_OUT": str(out), "LIBGL_ALWAYS_SOFTWARE": "1"}
        command = self._line(*WINDOW, "--python", str(script))
        seen = environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY")
        if not self.tool and (sys.platform != "linux" or seen):
            return _run(command, environment, seconds)
        with self._screen(environment) as display:
            return _run(command, environment | {"DISPLAY": display}, seconds)

    @contextmanager
    def _screen(self, environment: dict[str, str]) -> Iterator[str]:
        """A virtual screen for as long as the context lasts; gives its DISPLAY."""
        command = list(XVFB)
        if self.tool:  # only its Blender, which becomes it, can start the Xvfb that it brings
            become = f"import bpy, os; os.rmdir(bpy.app.tempdir); os.execvp('Xvfb', {XVFB})"
            command = self._line("--background", "--python-expr", become)
        elif shutil.which("Xvfb") is None:
            raise LookupError("no window: there is no screen (DISPLAY is not set) and no Xvfb")
        server = _begun(command, environment, stderr=subprocess.DEVNULL)
        try:
            with server.stdout:
                number = next((line.strip() for line in server.stdout if line.strip().isdigit()), None)
            if number is None:
                raise LookupError("no window: Xvfb does not start")
            yield f":{number}"
        finally:
            _end(server, signal.SIGTERM)  # it takes the lock of its number away

    def _line(self, *arguments: str) -> list[str]:
        return [*self.command, *(["run"] if self.tool else []), *arguments]

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
            done = blender.run("--background", "--factory-startup", "--python-expr", ABOUT, home=Path(home), seconds=60)
        except OSError as error:
            raise LookupError(f"no real Blender: {where} does not start ({error})") from None
    about = re.search(r"^About (\d+) (\d+) (\d+) (\d+)$", done.stdout, re.MULTILINE)
    if done.returncode or not about:
        raise LookupError(f"no real Blender: {where} does not start ({(done.stdout + done.stderr).strip()[-200:]})")
    *version, python = about.groups()
    return replace(blender, version=tuple(map(int, version)), python=python)


def _run(command: list[str], environment: dict[str, str], seconds: float) -> subprocess.CompletedProcess:
    """Run to the end or, when the time is over, end the command and all it started and say so among the errors."""
    process = _begun(command, environment, stderr=subprocess.PIPE)
    try:
        output, errors = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        _end(process, signal.SIGKILL)
        output, errors = process.communicate()
        errors += f"\nstopped after {seconds:.0f} s"
    finally:
        _end(process, signal.SIGKILL)
    return subprocess.CompletedProcess(command, process.returncode, output, errors)


def _begun(command: list[str], environment: dict[str, str], stderr: int) -> subprocess.Popen:
    return subprocess.Popen(
        command,
        cwd=ROOT,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
        errors="replace",
        start_new_session=True,
    )


def _end(process: subprocess.Popen, how: signal.Signals) -> None:
    """End a command and all that it started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, how)
    process.wait()
