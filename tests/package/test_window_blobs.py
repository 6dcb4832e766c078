# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs named through cameras in a real Blender's window; `tours/blobs.py` does it, this file judges it."""

import numpy as np
import pytest

pytestmark = [pytest.mark.real_blender, pytest.mark.window, pytest.mark.slow]
FRAME = 40


@pytest.fixture(scope="module")
def seen(watch, virtual_take, tmp_path_factory):
    folder = tmp_path_factory.mktemp("blobs")
    task = {"blobs": str(virtual_take / "take.csv"), "cameras": str(virtual_take / "cameras.toml")}
    return watch("blobs", folder, seconds=400, markerset="body26", frame=FRAME, **task)


def test_a_marker_that_is_named_in_two_cameras_is_in_space_at_once(seen):
    assert seen["lost"][1] is None
    first, second = seen["cameras"][:2]
    assert seen["picked"] == [seen["rows"][first]]
    words, place = seen["in one camera"]
    assert words.startswith("RKNE is the blob at") and f"of {first}, frames" in words
    assert place is None, "one camera makes a ray"
    assert seen["asked"] == "RKNE?"
    words, place = seen["in two cameras"]
    assert words.endswith(f"of {second}, frame {FRAME}")
    np.testing.assert_allclose(place, seen["truth"], atol=0.01)


def test_shift_adds_and_a_box_picks_what_is_inside(seen):
    other, picked = seen["with Shift"]
    assert other in picked and len(picked) == 2
    assert seen["in a box"] == [other]
    assert seen["beside"] == []


def test_each_name_is_one_step_of_undo(seen):
    assert seen["undone"] == [2, None]
    count, place = seen["redone"]
    assert count == 3
    np.testing.assert_allclose(place, seen["truth"], atol=0.01)


def test_a_marker_is_put_on_the_ray_of_its_blob(seen):
    words, place, expected = seen["placed"]
    assert words.startswith("RKNE is placed by hand, frame")
    assert seen["off the ray"] < 1e-4
    np.testing.assert_allclose(place, expected, atol=0.05)


def test_what_was_said_holds_in_what_is_labelled_again(seen):
    count, place = seen["labelled again"]
    assert count == 4
    np.testing.assert_allclose(place, seen["truth"], atol=0.01)
