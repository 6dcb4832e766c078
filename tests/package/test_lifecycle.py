# SPDX-License-Identifier: GPL-3.0-or-later
"""The zip in a Blender: it installs, works, is disabled, updated and uninstalled, and leaves nothing behind.

Tried in the bpy module of this Python and in a real Blender, the program, whose command line is tried as well.
`tours/lifecycle.py` lives it.
"""

import csv
import json
import shutil
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
    assert life["installed"]["enabled"] and life["installed"]["version"] == build.version()
    assert life["installed"]["tabs"] == ["Mocap"]
    # A Python of another version keeps what a class declares otherwise, and bases of operators add to that.
    assert {"filter_glob", "performer", "room", "unit"} <= set(life["installed"]["operators"]["export_bvh"])
    files = [path for path in (build.ROOT / "addon").rglob("*.py") if path.name != "__init__.py"]
    assert len(files) <= len(life["modules"])
    assert life["warnings"] == {}
    assert "olicy violation" not in life["log"] and "Traceback" not in life["log"]


@pytest.mark.parametrize("moment", ["disabled", "uninstalled"])
def test_nothing_stays_in_the_running_blender(life, moment):
    assert not life[moment]["enabled"] and life[moment]["traces"] == life["before"]
    assert life[moment]["operators"] == {}


def test_enabling_again_restores_all_of_it_an_update_replaces_it_and_uninstalling_removes_it(life):
    assert life["enabled again"] == life["installed"]
    assert life["installed"]["traces"]["data"] == life["before"]["data"] and life["updated"]["version"] == NEWER
    assert life["updated"] == life["installed"] | {"version": NEWER}
    # What stays is Blender's own: its list of checked extensions, and the byte code beside wheels it removed.
    assert [name for name in life["files left"] if name != ".cache/compat.dat" and "/__pycache__/" not in name] == []
    assert not any("mocap" in name for name in life["files left"])


@pytest.fixture(scope="module")
def command(blender_program, make_zip, tmp_path_factory):
    """Runs a command of the installed extension; the extension goes away again through Blender's own command line."""
    home = tmp_path_factory.mktemp("home")
    install = ["install-file", "--repo", "user_default", "--enable", str(make_zip(zip_for(blender_program)))]
    done = blender_program.run("--background", "--command", "extension", *install, home=home)
    assert done.returncode == 0, done.stdout + done.stderr
    yield lambda *arguments: blender_program.run("--background", "--command", "mocap_autolabel", *arguments, home=home)
    done = blender_program.run("--background", "--command", "extension", "remove", "mocap_autolabel", home=home)
    assert done.returncode == 0, done.stdout + done.stderr
    assert not list(home.glob("extensions/**/*mocap*"))


def results(done):
    """The one JSON object that a command printed, among what Blender itself prints."""
    return json.loads(done.stdout[done.stdout.index("{") : done.stdout.rindex("}") + 1])


@pytest.mark.real_blender
def test_label_names_a_take_and_evaluate_agrees(command, virtual_take, tmp_path):
    blobs, cameras = virtual_take / "take.csv", virtual_take / "cameras.toml"
    done = command("label", str(blobs), "--model", "body26", "--cameras", str(cameras), "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} >= {"take.labels.csv", "take.c3d", "take.report.json"}
    with blobs.open() as given, (tmp_path / "take.labels.csv").open() as labelled:
        key = ("frame", "camera", "x", "y")
        rows = [[tuple(row[name] for name in key) for row in csv.DictReader(file)] for file in (given, labelled)]
    assert rows[0] == rows[1]
    done = command("evaluate", str(tmp_path / "take.labels.csv"), str(blobs) + ".truth.csv", "--json")
    assert done.returncode == 0, done.stderr
    assert results(done)["f1"] > 0.97


@pytest.mark.real_blender
def test_takes_of_a_batch_share_blenders(command, virtual_take, tmp_path):
    takes = [shutil.copy(virtual_take / "take.csv", tmp_path / f"{name}.csv") for name in ("one", "two", "three")]
    few = ("--frames", "1:4", "--jobs", "2", "--json")
    given = ("--model", "body26", "--cameras", str(virtual_take / "cameras.toml"), "--out", str(tmp_path / "out"))
    done = command("label", *map(str, takes), *given, *few)
    assert done.returncode == 0, done.stdout + done.stderr
    reports = results(done)["takes"]
    told = [(report["take"], report["frames"], report["occlusion"]) for report in reports]
    assert told == [(name, 4, "bvh") for name in ("one", "two", "three")]
    assert len({report["unlabelled"] for report in reports}) == 1


@pytest.mark.real_blender
def test_bad_input_ends_with_one_sentence_and_status_2(command, virtual_take, tmp_path):
    broken = tmp_path / "broken.csv"
    broken.write_text("frame,camera,x,y\n1,nowhere,10,20\n")
    cameras = virtual_take / "cameras.toml"
    done = command("label", str(broken), "--model", "body26", "--cameras", str(cameras), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert "Traceback" not in done.stdout + done.stderr
    assert done.stderr.strip().split("\n")[-1].startswith(f"mocap-autolabel: {broken}:2: ")
    assert not list(tmp_path.glob("out/*"))
