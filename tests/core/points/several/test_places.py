# SPDX-License-Identifier: GPL-3.0-or-later
"""Whose tracklets are whose by where they are: in bodies that stand still, that come near, and that are not there."""

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.points.several import places
from addon.core.points.several.holding import Holding
from addon.core.points.several.parting import parted
from addon.core.points.several.places import NO_BODY, PlacesOptions, bodies_by_place
from addon.core.simulation.virtual import draw_person
from addon.io.models import open_model

RATE = 60.0
MARKERS = 26
ARM = {"ELB": 0.24, "WRA": 0.36, "WRB": 0.36, "FIN": 0.4}  # m that it is held out


def standing(apart: float, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (T, 2 MARKERS, 3) m of two who stand so far from each other; their tracklets, and on which each (N,) is.

    The hands that are next to each other are held out. Each marker is in pieces of a third to one second, with a sixth
    of a second between them.
    """
    generator = np.random.default_rng(5)
    markerset = open_model("body26").markerset
    model, frames, names = BodyModel(markerset), int(seconds * RATE), markerset.markers
    each = [model.pose(draw_person(markerset, generator)).markers[0] for _ in range(2)]
    each = [one - [*one[:, :2].mean(axis=0), 0.0] + [apart * index, 0.0, 0.0] for index, one in enumerate(each)]
    for own, side, out in zip(each, "LR", (1, -1), strict=True):
        for arm, far in ARM.items():
            own[names.index(side + arm), :2] = [apart * (own is each[1]) + out * far, 0.0]
    points = np.concatenate(each) + generator.normal(0, 0.001, (frames, 2 * MARKERS, 3))
    tracklet, whose = np.full(points.shape[:2], NO_BODY), []
    for marker in range(2 * MARKERS):
        begin = int(generator.integers(10))
        while begin < frames:
            end = begin + int(generator.integers(20, 60))
            tracklet[begin:end, marker] = len(whose)
            whose.append(marker // MARKERS)
            begin = end + 10
    return points, tracklet, np.array(whose)


def wrong(body: np.ndarray, truth: np.ndarray) -> int:
    """How many tracklets that are on a body (N,) are on the other one, whichever is called the first."""
    said = body != NO_BODY
    return int(min((body[said] != truth[said]).sum(), (body[said] != 1 - truth[said]).sum()))


def test_who_stands_still_beside_another_is_parted_by_the_place():
    points, tracklet, truth = standing(1.0, 60.0)
    found = parted(points, tracklet, Holding.of(points, tracklet, RATE), 2)
    assert wrong(found.body, truth) < 0.1 * len(truth)


def test_what_lies_between_two_is_left_to_what_it_holds_on_to():
    points, tracklet, truth = standing(1.0, 4.0)
    points[:, 0, :2] = [0.4, 0.0]
    found = bodies_by_place(points, tracklet, np.arange(1, len(points)), len(truth), 2)
    assert wrong(found, truth) == 0
    assert (found != NO_BODY).mean() > 0.7
    own = np.unique(tracklet[tracklet[:, 0] >= 0, 0])
    assert (found[own] == NO_BODY).sum() >= len(own) - 1  # one may be in the frame that all is begun with


@pytest.mark.parametrize("gone_over", [0.03, 1.0])
def test_whose_feet_come_to_another_is_followed_no_farther(monkeypatch, gone_over):
    points, tracklet, truth = standing(1.0, 8.0)
    lying = np.arange(MARKERS, MARKERS + 10)
    way = np.clip((np.arange(len(points)) - 120) / 60, 0, 1)[:, None]
    points[:, lying, 0] += way * (0.05 - points[:, lying, 0])
    monkeypatch.setattr(places, "BY_PLACE", PlacesOptions(gone_over=gone_over))
    found = bodies_by_place(points, tracklet, np.arange(100, len(points)), len(truth), 2)
    assert (found != NO_BODY).sum() > 2 * MARKERS
    assert (wrong(found, truth) > 20) == (gone_over == 1.0)
