# SPDX-License-Identifier: GPL-3.0-or-later
"""What distances cannot tell, sides do."""

import numpy as np
import pytest

from addon.core.points.likelihood.sides import heights, learn_sides
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from addon.io.models import open_model

# An elbow, thumb's and little finger's side of a wrist as far from it, and the back of the hand as far from both.
FOREARM = np.array([[0, 0, 0], [0.25, 0.03, 0], [0.25, -0.03, 0], [0.32, 0, 0.04]])
EXCHANGED = [0, 2, 1, 3]


def voices(sides, points, layout_m):
    """What the sides of all markers in points (T, M, 3) say together, each marker with one voice."""
    height = np.nanmean(heights(points[:, sides.markers]), axis=0)
    return (sides.odds(height, 1.0, layout_m) * sides.share(np.isfinite(height)[None])[0]).sum()


def turned(points):
    """Five people (5, 40, M, 3) m whose points turn about all axes, with some noise."""
    rng = np.random.default_rng(3)
    turns = np.linalg.qr(rng.normal(size=(5, 40, 3, 3)))[0]
    turns[np.linalg.det(turns) < 0] *= -1
    return points @ turns.swapaxes(2, 3) + 0.004 * rng.normal(size=(5, 40, points.shape[-2], 3))


@pytest.fixture
def clouds():
    return turned(FOREARM)


def test_a_height_is_over_the_plane_of_the_others_by_the_right_hand():
    plane = np.array([[0.2, 0.1, 0.3], [0, 0, 0], [1, 0, 0], [0, 2, 0]])
    assert heights(plane) == pytest.approx(0.3)
    assert heights(plane[[0, 1, 3, 2]]) == pytest.approx(-0.3)
    assert np.isnan(heights(np.where(np.arange(4)[:, None] == 2, np.nan, plane)))
    assert np.isnan(heights(plane[[0, 1, 2, 2]]))


def test_two_markers_that_are_as_far_from_all_else_are_told_apart(clouds):
    sides = learn_sides(list(clouds[:4]), 0.2)
    assert set(sides.markers[:, 0]) == {0, 1, 2, 3}
    right, wrong = (voices(sides, clouds[4][:, names], 0.01) for names in ([0, 1, 2, 3], EXCHANGED))
    assert right > 2 > 0 > -5 > wrong
    assert right <= 4 * np.log(2)


def test_who_is_out_of_sight_says_nothing(clouds):
    sides = learn_sides(list(clouds), 0.2)
    assert sides.odds(np.full(len(sides), np.nan), 1.0, 0.04) == pytest.approx(0)
    hidden = clouds.copy()
    hidden[:, :, 2] = np.nan
    assert not len(learn_sides(list(hidden), 0.2))


def test_a_foot_that_bends_has_an_inner_side_as_its_shank_is_always_above():
    heel, inner, outer = [0, 0, 0], [0.17, 0.05, 0], [0.17, -0.05, 0]
    leg = np.tile([heel, inner, outer, [0.05, 0, 0.3]], (5, 40, 1, 1))
    leg[:, :, 3] += 0.06 * np.random.default_rng(1).normal(size=(5, 40, 3))
    people = turned(leg)
    sides = learn_sides(list(people[:4]), 0.2)
    assert set(sides.markers[:, 0]) == {0, 1, 2, 3}
    right, wrong = (voices(sides, people[4][:, names], 0.04) for names in ([0, 1, 2, 3], EXCHANGED))
    assert right > 1 > -3 > wrong


def test_who_stands_still_and_shows_half_at_a_time_has_no_marker_beside_itself():
    still = np.tile(np.random.default_rng(0).normal(size=(8, 3)) * (0.2, 0.3, 0.5), (120, 1, 1))
    still[:60, 5:] = still[60:, :3] = np.nan
    markers = learn_sides([still], 0.5).markers
    assert len(markers) and all(len(set(four)) == 4 for four in markers.tolist())


def test_what_bends_between_them_has_no_side(clouds):
    clouds[:, :, 3] += np.random.default_rng(0).normal(size=(5, 40, 3))
    assert not len(learn_sides(list(clouds), 0.2))


@pytest.mark.parametrize("pair", [("LWRA", "LWRB"), ("RWRA", "RWRB"), ("LASI", "RASI"), ("LFHD", "RFHD")])
def test_a_built_in_set_knows_which_side_is_which_on_the_demo(pair):
    model = open_model("body26")
    sides, names = model.learned_likelihood.sides, list(model.markerset.markers)
    points = make_performance(open_markerset("body26")).take.xyz[:60].astype(float)
    exchanged = np.arange(len(names))
    exchanged[[names.index(name) for name in pair]] = [names.index(name) for name in pair[::-1]]
    right, wrong = (voices(sides, some, 0.04) for some in (points, points[:, exchanged]))
    assert right - wrong > 1
