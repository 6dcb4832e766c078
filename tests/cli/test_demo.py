# SPDX-License-Identifier: GPL-3.0-or-later
"""`demo`: the project's own take, labelled, scored and shown."""

import json
from xml.etree import ElementTree

import pytest

from addon.cli import demo
from addon.demo import take as demo_take
from addon.io.markersets import open_markerset


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
    assert sorted(path.name for path in (tmp_path / "demo").iterdir()) == [
        "room.toml",
        "walk.c3d",
        "walk.csv",
        "walk.csv.truth.csv",
        "walk.labels.csv",
        "walk.report.html",
        "walk.report.json",
        "walk.svg",
        "walk.trc",
    ]
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
