# SPDX-License-Identifier: GPL-3.0-or-later
"""What asks whether the body is in the way, through the command line: rays cast at meshes, or the closed form."""

import json
import subprocess

import pytest

from addon import blendfile
from addon.blendfile import has_blender
from addon.cli.workers import door
from addon.core.evaluation.figures import Figures
from addon.demo.take import MODEL
from addon.scoring import compare

needs_blender = pytest.mark.skipif(not has_blender(), reason="needs bpy")


def label_in_a_process(room, out, *words) -> dict:
    """The report of a take that a process of its own has labelled, with the figures against the truth."""
    where = ("--cameras", room.cameras, "--model", MODEL, "--rate", 60, "--out", out)
    done = subprocess.run(
        [*door(), *map(str, ("label", room.blobs, *where, *words))],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    report = json.loads((out / "walk.report.json").read_text(encoding="utf-8"))
    return {**report, "figures": figures_of(out / "walk.labels.csv", room.truth)}


def figures_of(labels, truth) -> dict:
    return compare(labels, truth, Figures()).figures.as_dict()


def markers_in(path) -> list[str]:
    return [line.split(",")[4] for line in path.read_text(encoding="utf-8").splitlines()[1:]]


@pytest.mark.blender
@needs_blender
def test_both_ways_name_a_take_alike_and_the_report_says_which_it_was(room, tmp_path):
    reports = {way: label_in_a_process(room, tmp_path / way, "--occlusion", way) for way in ("bvh", "capsules")}
    assert {way: report["occlusion"] for way, report in reports.items()} == {"bvh": "bvh", "capsules": "capsules"}
    assert all(report["figures"]["precision"] > 0.99 for report in reports.values())
    assert all(report["figures"]["recall"] > 0.95 for report in reports.values())
    rays, closed = (markers_in(tmp_path / way / "walk.labels.csv") for way in reports)
    assert len(rays) == len(closed) > 1000
    assert sum(a != b for a, b in zip(rays, closed, strict=True)) <= 0.005 * len(rays)


@pytest.mark.blender
@needs_blender
def test_rays_are_cast_where_nobody_chose_inside_blender(label, tmp_path, monkeypatch):
    """And they are what the labelling asks: without them nothing is looked up in a mesh."""
    from addon.scene.occlusion import MeshOcclusion  # and with it bpy: from here on this is Blender

    asked = []
    hidden = MeshOcclusion.hidden
    monkeypatch.setattr(MeshOcclusion, "hidden", lambda self, *given: asked.append(self) or hidden(self, *given))
    assert label("--occlusion", "capsules", "--frames", "100:101").status == 0
    assert not asked
    assert label("--overwrite", "--frames", "100:101").status == 0
    assert asked
    assert json.loads((tmp_path / "out" / "walk.report.json").read_text())["occlusion"] == "bvh"


def test_without_blender_rays_are_refused_and_the_closed_form_is_the_default(label, tmp_path, monkeypatch):
    monkeypatch.setattr(blendfile, "has_blender", lambda: False)
    monkeypatch.setattr("addon.jobs.job.inside_blender", lambda: False)
    answer = label("--occlusion", "bvh", "--frames", "100:101")
    assert answer.status == 2
    assert "--occlusion bvh needs Blender or the bpy package" in answer.reason
    assert not (tmp_path / "out" / "walk.labels.csv").exists()
    assert label("--frames", "100:101").status == 0
    assert json.loads((tmp_path / "out" / "walk.report.json").read_text())["occlusion"] == "capsules"
