# SPDX-License-Identifier: GPL-3.0-or-later
"""The trajectory timeline under a person's mouse in a real window; `tours/timeline.py` moves it, this file judges."""

import pytest
from matplotlib.image import imread

pytestmark = [pytest.mark.real_blender, pytest.mark.window, pytest.mark.slow]
FRAMES = 2000
MARKERS, LONG_GHOSTS, FLICKERS = 62, 20, 600
A_PIXEL = 3  # frames, about


@pytest.fixture(scope="module")
def seen(watch, tmp_path_factory):
    folder = tmp_path_factory.mktemp("timeline")
    return watch("timeline", folder, frames=FRAMES)


def test_markers_and_what_has_no_name_have_rows(seen):
    assert seen["rows"][0] == MARKERS + LONG_GHOSTS + 1, "the short ones share one"
    assert seen["timing"]["redraws"] > 10
    assert seen["rows unfolded"] == MARKERS + LONG_GHOSTS + FLICKERS


def test_a_click_goes_there_and_picks(seen):
    assert abs(seen["click"]["frame"] - seen["click"]["asked"]) <= A_PIXEL
    assert seen["click"]["selected"] == ["RFHD"]
    assert seen["ghost"]["picked"] == seen["ghost"]["wanted"]


def test_a_drag_selects_a_range_and_undo_takes_it_back(seen):
    used, *ends = seen["drag"]["range"]
    assert used
    assert all(abs(one - other) <= A_PIXEL for one, other in zip(ends, seen["drag"]["wanted"], strict=True))
    assert seen["drag"]["selected"] == [seen["drag"]["row"]]
    for after in ("undone", "stopped"):
        assert seen[after]["range"][0] is False
        assert seen[after]["selected"] == ["RFHD"]


def test_a_name_is_clicked_and_shift_adds(seen):
    assert seen["name clicked"]["selected"] == [seen["name clicked"]["row"]]
    assert seen["name clicked"]["frame"] == seen["undone"]["frame"], "a name is no time"
    assert len(seen["added"]) == 2


def test_the_wheel_scrolls_and_zooms_as_usual(seen):
    assert seen["scrolled"] == 8 * 3
    assert seen["scrolled by names"] == 9 * 3
    assert seen["panned"] == pytest.approx(9 * 3 - 4, abs=0.5)
    assert seen["zoomed"] < 0.95


def test_keys_that_are_not_seen_are_left_alone(seen):
    assert seen["keys left"]


@pytest.mark.parametrize("name", ["timeline-whole", "timeline-range", "timeline-ghosts", "timeline-unfolded"])
def test_the_rows_are_coloured(seen, name):
    picture = imread(seen["folder"] / f"{name}.png")[..., :3]
    grey = picture.max(axis=2) - picture.min(axis=2) < 0.1
    assert (~grey[len(grey) // 2 :]).mean() > 0.02


def test_switched_off_it_leaves_blenders_own(seen):
    on, off = (imread(seen["folder"] / f"timeline-{name}.png")[..., :3] for name in ("unfolded", "off"))
    assert abs(on - off).mean() > 0.02
