# SPDX-License-Identifier: GPL-3.0-or-later
"""A take corrected with the tool Label in a real Blender's window; `tours/label.py` does it, this file judges it."""

import numpy as np
import pytest

from scripts.virtual_take import write_virtual_points

pytestmark = [pytest.mark.real_blender, pytest.mark.window, pytest.mark.slow]
FRAMES, FRAME = 120, 40


@pytest.fixture(scope="module")
def seen(watch, tmp_path_factory):
    folder = tmp_path_factory.mktemp("label")
    write_virtual_points(folder, FRAMES)
    task = {"points": str(folder / "walk.c3d"), "markerset": "body26", "frame": FRAME}
    return watch("label", folder, **task)


def test_the_dot_under_the_pointer_is_picked_and_not_the_body_before_it(seen):
    left, right = seen["knees"]
    assert (seen["clicked"], seen["selected"]) == ([left], ["LKNE"])
    assert seen["with Shift"] == [left, right]
    assert seen["with Shift again"] == [right]
    assert seen["beside"] == []


def test_a_box_and_a_lasso_pick_what_is_inside(seen):
    assert set(seen["knees"]) <= set(seen["in a box"])
    assert seen["in a lasso"] == [seen["knees"][1]]


def test_keys_swap_and_undo_takes_it_back(seen):
    assert seen["swapped"] == ["LKNE and RKNE swapped, all frames"]
    assert seen["undone"] == []
    assert seen["picked after undo"] == seen["knees"]


def test_the_pie_offers_the_missing_marker_first(seen):
    [unlabelled] = seen["unlabelled"]
    assert seen["named by the pie"] == [unlabelled, f"LANK is {unlabelled.split(' has ')[0].lower()}, all frames"]
    assert seen["after Esc"] == seen["named by the pie"]


def test_quick_label_goes_from_marker_to_marker(seen):
    first, after, back, skipped, second = seen["asked"]
    assert {first, second} < set(seen["truth"])
    assert first == back != after, "what was taken back is asked for again"
    assert skipped == after, "what was passed over is not asked for again"
    assert seen["given"] == [f"{second} is trajectory {seen['truth'][second]}, all frames"]
    assert not seen["quick label runs"]


def test_a_marker_is_put_where_nothing_was_seen(seen):
    words, place = seen["placed"]
    assert words.startswith(f"{seen['gap']} is placed by hand, frame")
    assert np.isfinite(place).all()


def test_playback_goes_on_with_the_tool(seen):
    assert seen["played"]
    assert seen["tool"] == "mocap_autolabel.label_tool"
