# SPDX-License-Identifier: GPL-3.0-or-later
"""What asks whether the body is in the way, through the command line: rays cast at meshes, or the closed form."""

import json

import pytest

from addon import blendfile


@pytest.mark.blender
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
