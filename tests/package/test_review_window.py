# SPDX-License-Identifier: GPL-3.0-or-later
"""Trouble found, shown, mended and answered in a real Blender's window; `tours/review.py` walks, this file judges."""

import numpy as np
import pytest

pytestmark = [pytest.mark.real_blender, pytest.mark.window, pytest.mark.slow]


@pytest.fixture(scope="module")
def tour(watch, tmp_path_factory):
    from scripts.virtual_take import write_virtual_points

    folder = tmp_path_factory.mktemp("review")
    write_virtual_points(folder, 240)
    return watch("review", folder, points=str(folder / "walk.c3d"))


def test_the_panel_says_what_goes_on_and_its_button_cancels(tour):
    assert tour["doing"].startswith("Labelling: ")
    assert tour["after Cancel"] == {"running": False, "take": False}


def test_a_click_shows_what_is_meant_from_where_one_looks(tour):
    assert tour["shown"]["name"] == "LKNE"
    assert "LKNE" in tour["shown"]["reason"]
    assert "trajectory" in tour["shown"]["reason"]
    np.testing.assert_allclose(*tour["view"]["turn"], atol=1e-5)
    assert np.abs(tour["view"]["place"]).max() < 8, "it was looked at 9 9 9, where nobody is"


def test_a_click_mends_it_in_one_step_of_undo_and_a_click_answers(tour):
    assert tour["shown"]["reason"] not in tour["left after mending"]
    assert tour["shown"]["reason"] in tour["back after undo"]
    assert tour["answered"] >= 1
