# SPDX-License-Identifier: GPL-3.0-or-later
"""Finding a real Blender and giving it a screen, tried with stand-ins for both programs."""

import sys
from pathlib import Path

import pytest

from scripts import real_blender

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the stand-ins are shell scripts")
BLENDER = """#!/bin/sh
echo "Blender 5.2.7 LTS"; echo "display $DISPLAY"; echo "home $BLENDER_USER_RESOURCES"; echo "arguments $*"
"""
XVFB = f"""#!{sys.executable}
import os, sys, time
os.write(int(sys.argv[2]), b"77\\n")
time.sleep(60)
"""
BROKEN_XVFB = "#!/bin/sh\nexit 1\n"


def program(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    path.chmod(0o755)
    return path


@pytest.fixture
def nothing_found(monkeypatch, tmp_path):
    """A machine without any Blender, and without a screen."""
    for name in ("MOCAP_BLENDER", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "bin") + ":/usr/bin:/bin")
    monkeypatch.setattr(real_blender, "TOOL", tmp_path / "no-tool")
    monkeypatch.setattr(real_blender.shutil, "which", lambda name: _which(tmp_path / "bin" / name))
    (tmp_path / "bin").mkdir()


def _which(path: Path) -> str | None:
    return str(path) if path.exists() else None


@pytest.mark.skipif(sys.platform != "linux", reason="other systems always have a screen")
def test_a_window_gets_a_screen_of_its_own_or_a_reason(nothing_found, tmp_path):
    program(tmp_path / "bin", "blender", BLENDER)
    blender = real_blender.find()
    with pytest.raises(LookupError, match="no Xvfb"):
        blender.window(tmp_path / "script.py", tmp_path, home=tmp_path)
    program(tmp_path / "bin", "Xvfb", BROKEN_XVFB)
    with pytest.raises(LookupError, match="Xvfb does not start"):
        blender.window(tmp_path / "script.py", tmp_path, home=tmp_path)
    program(tmp_path / "bin", "Xvfb", XVFB)
    done = blender.window(tmp_path / "script.py", tmp_path, home=tmp_path)
    assert "display :77" in done.stdout
    assert f"--python {tmp_path / 'script.py'}" in done.stdout


def test_what_takes_too_long_is_ended(nothing_found, tmp_path):
    slow = program(tmp_path, "slow", "#!/bin/sh\necho started; exec sleep 60\n")
    done = real_blender.RealBlender((str(slow),)).run(home=tmp_path, seconds=2)
    assert "started" in done.stdout
    assert "stopped after" in done.stderr
