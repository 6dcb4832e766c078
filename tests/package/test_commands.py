# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line's first door: `blender --background --command mocap_autolabel …` with the zip installed."""

import csv
import json
import shutil

import pytest

from .conftest import zip_for

pytestmark = pytest.mark.real_blender


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


def test_takes_of_a_batch_share_blenders(command, virtual_take, tmp_path):
    takes = [shutil.copy(virtual_take / "take.csv", tmp_path / f"{name}.csv") for name in ("one", "two", "three")]
    few = ("--frames", "1:4", "--jobs", "2", "--json")
    given = ("--model", "body26", "--cameras", str(virtual_take / "cameras.toml"), "--out", str(tmp_path / "out"))
    done = command("label", *map(str, takes), *given, *few)
    assert done.returncode == 0, done.stdout + done.stderr
    reports = results(done)["takes"]
    assert [(report["take"], report["frames"], report["occlusion"]) for report in reports] == [
        (name, 4, "bvh") for name in ("one", "two", "three")
    ]
    assert len({report["unlabelled"] for report in reports}) == 1


def test_bad_input_ends_with_one_sentence_and_status_2(command, virtual_take, tmp_path):
    broken = tmp_path / "broken.csv"
    broken.write_text("frame,camera,x,y\n1,nowhere,10,20\n")
    cameras = virtual_take / "cameras.toml"
    done = command("label", str(broken), "--model", "body26", "--cameras", str(cameras), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert "Traceback" not in done.stdout + done.stderr
    assert done.stderr.strip().split("\n")[-1].startswith(f"mocap-autolabel: {broken}:2: ")
    assert not list(tmp_path.glob("out/*"))
