# SPDX-License-Identifier: GPL-3.0-or-later
"""Whose tracklets are whose by where they are: in bodies that stand still, that come near, and that are not there."""

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.points.several import places
from addon.core.points.several.affinity import Affinity
from addon.core.points.several.parting import parted
from addon.core.points.several.places import NO_BODY, PlacesOptions, bodies_by_place
from addon.core.simulation.virtual import draw_person
from addon.io.models import open_model

RATE = 60.0
MARKERS = 26
THING = 4  # markers on it
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
    found = parted(points, tracklet, Affinity.of(points, tracklet, RATE), 2, MARKERS)
    assert wrong(found.body, truth) < 0.1 * len(truth)


def walked(points: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Points (T, 2 MARKERS, 3) m of two who go so far (T, 2, 2) m on the floor."""
    moved = points.copy()
    moved[:, :, :2] += np.repeat(way, MARKERS, axis=1)
    return moved


def test_two_who_walk_side_by_side_are_followed():
    points, tracklet, truth = standing(1.0, 8.0)
    way = np.zeros((len(points), 2, 2))
    way[..., 0] = np.linspace(0, 6, len(points))[:, None]
    found = bodies_by_place(walked(points, way), tracklet, np.arange(0, len(points), 3), len(truth), 2)
    assert wrong(found, truth) == 0
    assert (found != NO_BODY).mean() > 0.8


def gone(points: np.ndarray, tracklet: np.ndarray, frames: slice) -> tuple[np.ndarray, np.ndarray]:
    """Points and tracklets without the second body in some frames, and with four of a thing 1.6 m from it in all."""
    thing = np.full((len(points), THING, 3), [2.9, 0.7, 0.5]) + np.linspace(0, 0.1, THING)[:, None]
    points = np.concatenate([points, thing], axis=1)
    points[frames, MARKERS : 2 * MARKERS] = np.nan
    things = np.tile(tracklet.max() + 1 + np.arange(THING), (len(points), 1))
    tracklet = np.concatenate([np.where(np.isnan(points[:, : 2 * MARKERS, 0]), NO_BODY, tracklet), things], axis=1)
    return points, tracklet


def test_what_is_left_where_somebody_went_away_does_not_become_them():
    points, tracklet, truth = standing(1.5, 12.0)
    way = np.zeros((len(points), 2, 2))
    way[480:, 1, 0] = -0.9  # is nearer to the first when it is back
    points, tracklet = gone(walked(points, way), tracklet, slice(240, 480))
    found = bodies_by_place(points, tracklet, np.arange(0, len(points), 3), len(truth) + THING, 2)
    assert (found[: len(truth)] != NO_BODY).sum() > 2 * MARKERS
    assert wrong(found[: len(truth)], truth) <= MARKERS


@pytest.mark.parametrize(("frames", "followed"), [(9, True), (30, False)])
def test_who_is_not_seen_for_a_moment_is_followed_and_no_longer(frames, followed):
    points, tracklet, truth = standing(1.0, 12.0)
    empty = slice(300, 300 + frames)
    tracklet[empty], points[empty] = NO_BODY, np.nan
    looked = np.arange(0, len(points), 3)
    found = bodies_by_place(points, tracklet, looked, len(truth), 2)
    assert wrong(found, truth) == 0
    ends = [tracklet[part][tracklet[part] >= 0] for part in (slice(200), slice(500, None))]
    assert all((found[own] != NO_BODY).mean() > 0.8 for own in ends) == followed


def test_what_lies_between_two_or_now_with_one_and_now_with_the_other_is_left_to_what_it_holds_on_to(monkeypatch):
    points, tracklet, truth = standing(1.0, 4.0)
    points[:, 0, :2] = [0.4, 0.0]
    assert_left(points, tracklet, truth)
    points, tracklet, truth = standing(1.0, 4.0)
    points[:, 0, 0] = np.arange(len(points)) // 5 % 2
    monkeypatch.setattr(places, "BY_PLACE", PlacesOptions(gone_over=0.1))
    assert_left(points, tracklet, truth)


def assert_left(points: np.ndarray, tracklet: np.ndarray, truth: np.ndarray):
    """That the first marker's tracklets are on no body, but for that in the frame that is begun with."""
    found = bodies_by_place(points, tracklet, np.arange(1, len(points)), len(truth), 2)
    rest = np.setdiff1d(tracklet[:, 1:], [NO_BODY])
    assert wrong(found[rest], truth[rest]) == 0
    assert (found != NO_BODY).mean() > 0.7
    own = np.unique(tracklet[tracklet[:, 0] >= 0, 0])
    assert (found[own] == NO_BODY).sum() >= len(own) - 1
    on = np.append(found, 0)[tracklet[1:]] != NO_BODY
    assert on.all(axis=1).any()


@pytest.mark.parametrize("followed", [False, True])
def test_whose_feet_come_to_another_is_followed_no_farther(monkeypatch, followed):
    points, tracklet, truth = standing(1.0, 8.0)
    lying = np.arange(MARKERS, MARKERS + 10)
    way = np.clip((np.arange(len(points)) - 120) / 60, 0, 1)[:, None]
    points[:, lying, 0] += way * (0.05 - points[:, lying, 0])
    monkeypatch.setattr(places, "BY_PLACE", PlacesOptions(gone_over=1.0) if followed else PlacesOptions())
    found = bodies_by_place(points, tracklet, np.arange(100, len(points)), len(truth), 2)
    assert (found != NO_BODY).sum() > 2 * MARKERS
    assert (wrong(found, truth) > 10) == followed
