# SPDX-License-Identifier: GPL-3.0-or-later
"""Known bodies with other markers: the right body is chosen, and new markers go where they move with it."""

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.posing.posing import fit_points
from addon.core.training.transfer import known_body, transferred
from addon.demo.take import make_performance
from addon.io.markersets import builtin_markersets, open_markerset


@pytest.fixture(scope="module")
def known():
    return [open_markerset(name) for name in builtin_markersets()]


@pytest.fixture(scope="module")
def take():
    """Names and points (T, M, 3) of the virtual person."""
    performance = make_performance(open_markerset("body26"))
    return list(performance.take.names), performance.take.xyz[::10]


def test_the_body_that_has_most_of_the_markers_is_taken(known, take):
    names, _ = take
    assert known_body(names, known).name == "body26"
    assert known_body([*names, "T10", "STRN"], known).name in ("body26", "body39")
    lower = open_markerset("gait15").markers
    assert known_body(lower, known).name == "gait15"
    assert known_body(["s2", "r_asis", *lower[3:]], known).name == "gait15"
    assert known_body([f"P{index}" for index in range(20)], known) is None
    assert known_body(names[:5] + [f"P{index}" for index in range(30)], known) is None


def test_a_new_marker_goes_to_the_segment_that_carries_it(known, take):
    names, points = take
    body = known_body(names, known)
    model = BodyModel(body)
    order = [names.index(name) for name in body.markers]
    posed = model.pose(fit_points(model, points[:, order]))
    shin = body.skeleton.segments.index("shank.L")
    extra = posed.joints[:, shin] + np.einsum("fij,j->fi", posed.rotations[:, shin], [0.06, 0.02, -0.1])
    shown = np.concatenate([points, extra[:, None]], axis=1)
    found = transferred(body, [shown, shown[::2]], [*names, "LXTRA"], "mine")
    assert found.markers == (*names, "LXTRA")
    assert found.skeleton.segments[found.attachment[-1]] == "shank.L"
    assert found.spread.modes.shape[1] == len(found.skeleton) + len(found.markers)
    fresh = BodyModel(found)
    away = np.linalg.norm(fresh.pose(fit_points(fresh, shown)).markers - shown, axis=2)
    assert np.nanmedian(away) < 0.012
    assert np.nanmedian(away[:, -1]) < 0.012


def test_takes_without_the_known_markers_are_refused(known):
    body = known[0]
    with pytest.raises(ValueError, match="known markers"):
        transferred(body, [np.full((5, len(body), 3), np.nan)], body.markers, "none")
