# SPDX-License-Identifier: GPL-3.0-or-later
"""What Esc ends in a real Blender's window, and what it leaves alone; `tours/escape.py` presses it."""

import pytest

pytestmark = [pytest.mark.real_blender, pytest.mark.window, pytest.mark.slow]


@pytest.fixture(scope="module")
def tour(watch, tmp_path_factory):
    from scripts.virtual_take import write_virtual_points

    folder = tmp_path_factory.mktemp("escape")
    write_virtual_points(folder, 30)
    return watch("escape", folder, points=str(folder / "walk.c3d"))


def test_escape_meant_for_something_else_leaves_the_work_alone(tour):
    assert tour["in another editor"]
    assert tour["in a menu"]
    assert tour["plays"]
    assert tour["to stop what plays"] == [False, True]


def test_escape_asks_before_much_work_is_lost(tour):
    assert tour["asked"]
    assert tour["said no"] == [True, True], "it goes on"
    assert not tour["said yes"]


def test_escape_over_the_3d_view_ends_work_that_is_young(tour):
    assert not tour["little work"]
