# SPDX-License-Identifier: GPL-3.0-or-later
"""The two doors and what comes out of them, and `demo`: the project's own take, labelled, scored and shown."""

import json
import subprocess
import sys
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest

from addon.cli import demo
from addon.cli.workers import door
from addon.demo import take as demo_take
from addon.demo.take import MODEL
from addon.io.markersets import open_markerset


def test_models_lists_the_built_in_ones_and_published_sets_in_words(run):
    models = {model["name"]: model for model in json.loads(run("models", "--json").out)["models"]}
    assert {"gait15", "body26", "body39", "actor41", "actor53"} <= set(models)
    assert len(models["gait15"]["markers"]) == 15
    assert models["gait15"]["aliases"]["s2"] == "SACR"
    assert "LASI" in run("models").out
    layouts = {layout["name"]: layout for layout in json.loads(run("models", "--json").out)["layouts"]}
    assert {"helen_hayes", "frontwaist53", "baseline41", "core50", "qualisys_sports", "cast", "ior"} <= set(layouts)
    assert "WaistLFront" in layouts["baseline41"]["markers"]
    assert "ForefootOut" in run("models").out


def test_help_and_version_are_results(run):
    for words in (["--help"], ["--version"], ["label", "--help"]):
        answer = run(*words)
        assert (answer.status, answer.err) == (0, "")
        assert answer.out


def test_a_process_gives_status_and_last_line(tmp_path):
    words = "label", tmp_path / "no.csv", "--model", MODEL, "--cameras", tmp_path / "no.toml", "--out", tmp_path
    done = subprocess.run([*door(), *map(str, words)], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.splitlines()[-1].startswith(
        f"mocap-autolabel: {tmp_path / 'no.csv'}: there is no such file; expected"
    )


@pytest.mark.blender
def test_blenders_door_is_the_same_command_line(capsys):
    from addon import registration

    assert registration._run_command(["models", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["models"]
    assert registration._run_command(["lable"]) == 2
    assert capsys.readouterr().err.startswith("mocap-autolabel: ")


def test_inside_blender_its_own_program_is_started_again(monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", SimpleNamespace(app=SimpleNamespace(binary_path="/opt/blender/blender")))
    assert door() == ["/opt/blender/blender", "--background", "--command", "mocap_autolabel"]


@pytest.fixture
def short(monkeypatch):
    """Only the beginning of the demo's walk."""
    from addon.core.simulation.virtual import DEMO

    monkeypatch.setattr(demo_take, "DEMO", DEMO[:1])


def test_without_blender_everything_but_its_file(run, short, monkeypatch, tmp_path):
    monkeypatch.setattr(demo, "has_blender", lambda: False)
    answer = run("demo", "--out", tmp_path / "demo", "--json")
    assert (answer.status, answer.err) == (0, "")
    result = json.loads(answer.out)
    assert result["figures"]["precision"] > 0.99
    assert result["figures"]["recall"] > 0.95
    assert "no .blend" in result["note"]
    endings = {"c3d", "csv", "csv.truth.csv", "labels.csv", "report.html", "report.json", "svg", "trc"}
    written = {path.name for path in (tmp_path / "demo").iterdir()}
    assert written == {"room.toml", *(f"walk.{ending}" for ending in endings)}
    assert "exists already" in run("demo", "--out", tmp_path / "demo").reason
    drawn = ElementTree.parse(tmp_path / "demo" / "walk.svg").getroot()
    words = ["".join(text.itertext()) for text in drawn.iter("{http://www.w3.org/2000/svg}text")]
    assert set(open_markerset(demo_take.MODEL).markers) <= set(words)
    assert sum(text.endswith("blobs named") for text in words) == 2


@pytest.mark.slow
@pytest.mark.blender
def test_with_blender_a_scene_and_a_picture(run, short, tmp_path):
    answer = run("demo", "--out", tmp_path / "demo")
    assert (answer.status, answer.err) == (0, "")
    assert answer.out.startswith("60 frames of a virtual person, seen by 8 cameras")
    assert (tmp_path / "demo" / "walk.blend").stat().st_size > 10_000
