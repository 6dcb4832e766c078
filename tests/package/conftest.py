# SPDX-License-Identifier: GPL-3.0-or-later
"""The built zips and the Blenders to try them in."""

import importlib.util
import json
import platform
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from scripts import build, real_blender

TOURS = Path(__file__).with_name("tours")
FLAVOURS = [(name, platform) for name, blender in build.BLENDERS.items() for platform in blender.platforms]
NOT_SHIPPED = {"addon/cli/label/farm.py"}  # of the addon folder: of labs' machines, not of Blender


@pytest.fixture(scope="session")
def make_zip(tmp_path_factory) -> Callable[..., Path]:
    """Builds the zip for a Blender of build.BLENDERS on this machine, once for each version number."""
    if importlib.util.find_spec("bpy") is None:
        pytest.skip("the bpy module, which brings Blender's packager, is not installed")
    folder = tmp_path_factory.mktemp("zips")
    return cache(lambda name, version=None, **how: build.build(name, this_platform(), folder, version, **how))


@pytest.fixture(scope="session")
def blender_program() -> real_blender.RealBlender:
    try:
        return real_blender.find()
    except LookupError as reason:
        pytest.skip(str(reason))


@pytest.fixture(scope="session")
def watch(blender_program, make_zip) -> Callable[..., dict]:
    """Goes a way of `tours` through a real Blender's window, which finds the zip and its `task` in `task.json`.

    Gives what was seen and the folder in which its pictures are, which all show something. The log has nothing amiss.
    """

    def run(way: str, folder: Path, seconds: float = 600, **task) -> dict:
        from matplotlib.image import imread

        package = str(make_zip(zip_for(blender_program), compiled=True))
        (folder / "task.json").write_text(json.dumps({"zip": package, "way": way, **task}))
        try:
            done = blender_program.window(TOURS / "stage.py", folder, home=folder / "home", seconds=seconds)
        except LookupError as reason:
            pytest.skip(str(reason))
        log = done.stdout + done.stderr
        assert (folder / "seen.json").exists(), log
        assert "Traceback" not in log and "olicy violation" not in log
        assert not [path.name for path in folder.glob("*.png") if imread(path)[..., :3].std() < 0.05]
        return json.loads((folder / "seen.json").read_text()) | {"folder": folder}

    return run


@pytest.fixture(scope="session")
def virtual_take(tmp_path_factory) -> Path:
    """A folder with the first second and a half of the demo's take: take.csv, its truth, and cameras.toml."""
    from scripts.virtual_take import write_virtual_take

    folder = tmp_path_factory.mktemp("take")
    write_virtual_take(folder, 90)
    return folder


def this_platform() -> str:
    """Blender's name for this machine, if zips are built for it."""
    systems = {"linux": "linux", "win32": "windows", "darwin": "macos"}
    machines = {"x86_64": "x64", "amd64": "x64", "arm64": "arm64", "aarch64": "arm64"}
    name = f"{systems.get(sys.platform)}-{machines.get(platform.machine().lower())}"
    if name not in build.WHEEL_TAGS:
        pytest.skip(f"no zip is built for this machine ({name})")
    return name


def zip_for(blender: real_blender.RealBlender) -> str:
    """Which of the built zips a Blender takes."""
    try:
        return build.for_blender(blender.version, blender.python)
    except LookupError as reason:
        pytest.skip(str(reason))
