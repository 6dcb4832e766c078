# SPDX-License-Identifier: GPL-3.0-or-later
"""Placement quality in Blender: the marker set that is laid out is judged, advice is shown and taken."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from addon.core import placement_quality as core
from addon.io.markersets import open_markerset
from addon.io.models import open_model

from .hands import ours, press, refused


@pytest.fixture
def laid(extension, empty):
    """gait15 laid out, its collection, and the extension's own module of the scene's side."""
    empty.scene.mocap_autolabel.subjects.markerset = "gait15"
    press("edit_markerset")
    empty.view_layer.update()
    module = ours("scene.markerset_edit")
    return module, module.edited_collection(empty.scene)


@pytest.fixture
def judged(laid):
    press("judge_markers")
    return laid


def test_the_set_that_is_laid_out_is_judged_as_it_was_learned_and_advice_is_shown_and_taken(judged, empty):
    quality, collection = judged
    report, known = quality.kept_report(collection), open_model("gait15")
    found = core.judge(core.marker_layout(known.markerset, learned=known.likelihood))
    one, two = found.worst()[0]
    assert set(report["pairs"][0]["markers"]) == {found.markers[one], found.markers[two]}
    assert report["pairs"][0]["separation"] == pytest.approx(float(core.separation(found.hidden[one, two])), abs=0.02)
    assert not quality.changed_since(collection)
    refused("no advice 9", "take_advice", number=9)
    shown = quality.targets(collection)
    assert [target.number for target in shown] == list(range(1, len(report["advice"]) + 1))
    first, row = shown[0], report["advice"][0]
    assert np.linalg.norm(first.end - first.begin) == pytest.approx(np.linalg.norm(row["shift_mm"]) / 1000, abs=2e-4)
    press("take_advice", number=1)
    empty.view_layer.update()
    item = quality.marker_items(collection)[row["marker"]]
    np.testing.assert_allclose(item.matrix_world.translation, first.end, atol=1e-5)
    assert quality.changed_since(collection)
    assert 1 not in [target.number for target in quality.targets(collection)]
    read = quality.read_markerset(collection, open_markerset("gait15"), "mine")
    np.testing.assert_allclose(read.offsets[read.markers.index(row["marker"])], row["offset"], atol=1e-5)


def test_a_locked_marker_stays(laid):
    quality, collection = laid
    for name, item in quality.marker_items(collection).items():
        item.lock_location = (name.endswith(("ANK", "HEE")),) * 3
    press("judge_markers")
    moved = {row["marker"] for row in quality.kept_report(collection)["advice"]}
    assert not {name for name in moved if name.endswith(("ANK", "HEE"))}


def test_its_legend_is_above_that_of_a_take_and_colours_go_from_red_over_orange_to_green(judged, empty, monkeypatch):
    overlay, drawn = ours("ui.overlay"), ours("ui.quality")
    canvas = MagicMock(foot=20.0, scale=1.0, region=7, size=(600, 70))
    overlay.draw_colours(canvas, "12 of 12 points named", [("named", (1, 1, 1, 1))])
    assert canvas.foot == 20 and not canvas.text.called, "in a low view it would lie on Blender's own words"
    canvas.size = 600, 400
    canvas.__enter__.return_value = canvas
    overlay.draw_colours(canvas, "12 of 12 points named", [("named", (1, 1, 1, 1))])
    overlay.legend_ends[canvas.region], canvas.foot = canvas.foot, 20.0
    space = SimpleNamespace(overlay=SimpleNamespace(show_overlays=True))
    context = SimpleNamespace(scene=empty.scene, space_data=space)
    monkeypatch.setattr(drawn, "bpy", SimpleNamespace(context=context))
    monkeypatch.setattr(drawn, "Canvas", lambda _: canvas)
    for name in ("_draw_markers", "_draw_targets"):
        monkeypatch.setattr(drawn, name, lambda *_: None)
    drawn.draw()
    heights = [call.args[2] for call in canvas.text.mock_calls]
    assert len(set(heights)) == len(heights) == 2 + 5
    marks = ours("ui.marks")
    for separation, colour in ((0, marks.RED), (3, marks.ORANGE), (60, marks.GREEN)):
        np.testing.assert_allclose(drawn.clearness(separation, 3), colour)
