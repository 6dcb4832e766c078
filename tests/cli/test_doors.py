# SPDX-License-Identifier: GPL-3.0-or-later
"""The two doors, what comes out of them, and what an interruption leaves behind."""

import json
import subprocess
import sys
from types import SimpleNamespace

import pytest

from addon.cli.workers import door
from addon.demo.take import MODEL


def test_models_lists_the_built_in_ones(run):
    models = {model["name"]: model for model in json.loads(run("models", "--json").out)["models"]}
    assert {"gait15", "body26", "body39", "actor41", "actor53"} <= set(models)
    assert len(models["gait15"]["markers"]) == 15
    assert models["gait15"]["aliases"]["s2"] == "SACR"
    assert "LASI" in run("models").out


def test_models_lists_published_sets_in_words(run):
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
    blender = SimpleNamespace(app=SimpleNamespace(binary_path="/opt/blender/blender"))
    monkeypatch.setitem(sys.modules, "bpy", blender)
    assert door() == ["/opt/blender/blender", "--background", "--command", "mocap_autolabel"]
