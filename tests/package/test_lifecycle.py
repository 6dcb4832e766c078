# SPDX-License-Identifier: GPL-3.0-or-later
"""The zip in a Blender: it installs, works, is disabled, updated and uninstalled, and leaves nothing behind.

Tried in the bpy module of this Python and in a real Blender, the program. `tours/lifecycle.py` lives it.
"""

import json
import sys

import pytest

from scripts import build, real_blender

from .conftest import TOURS, zip_for

SCRIPT = TOURS / "lifecycle.py"
NEWER = "9.9.9"


@pytest.fixture(scope="module", params=["module", pytest.param("program", marks=pytest.mark.real_blender)])
def life(request, make_zip, tmp_path_factory):
    """What was seen of the extension at each point of its life."""
    folder = tmp_path_factory.mktemp("life")
    if request.param == "module":
        import bpy

        python = "{}{}".format(*sys.version_info)
        blender = real_blender.RealBlender((sys.executable, str(SCRIPT)), version=bpy.app.version, python=python)
        before = []
    else:
        blender = request.getfixturevalue("blender_program")
        before = ["--background", "--factory-startup", "--python-exit-code", "3", "--python", str(SCRIPT)]
    name = zip_for(blender)
    report = folder / "report.json"
    zips = str(make_zip(name)), str(make_zip(name, NEWER))
    done = blender.run(*before, "--", *zips, str(report), home=folder / "home")
    assert report.exists(), done.stdout + done.stderr
    return json.loads(report.read_text()) | {"log": done.stdout + done.stderr}


def test_installing_enables_all_of_it_and_blender_sees_no_violation_of_its_policies(life):
    assert life["installed"]["enabled"]
    assert life["installed"]["version"] == build.version()
    assert life["installed"]["tabs"] == ["Mocap"]
    # A Python of another version keeps what a class declares otherwise, and bases of operators add to that.
    assert {"filter_glob", "performer", "room", "unit"} <= set(life["installed"]["operators"]["export_bvh"])
    files = [path for path in (build.ROOT / "addon").rglob("*.py") if path.name != "__init__.py"]
    assert len(files) <= len(life["modules"])
    assert life["warnings"] == {}
    assert "olicy violation" not in life["log"]
    assert "Traceback" not in life["log"]


@pytest.mark.parametrize("moment", ["disabled", "uninstalled"])
def test_nothing_stays_in_the_running_blender(life, moment):
    assert not life[moment]["enabled"]
    assert life[moment]["traces"] == life["before"]
    assert life[moment]["operators"] == {}


def test_enabling_again_restores_all_of_it_an_update_replaces_it_and_uninstalling_removes_it(life):
    assert life["enabled again"] == life["installed"]
    assert life["installed"]["traces"]["data"] == life["before"]["data"]
    assert life["updated"]["version"] == NEWER
    assert life["updated"] == life["installed"] | {"version": NEWER}
    # What stays is Blender's own: its list of checked extensions, and the byte code beside wheels it removed.
    assert [name for name in life["files left"] if name != ".cache/compat.dat" and "/__pycache__/" not in name] == []
    assert not any("mocap" in name for name in life["files left"])
