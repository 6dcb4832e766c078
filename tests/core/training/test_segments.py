# SPDX-License-Identifier: GPL-3.0-or-later
"""Skeletons found from how markers move: the right groups, the right joints, and a body that fits."""

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.geometry import rotations
from addon.core.posing.posing import fit_points
from addon.core.training.segments import find_segments, segment_markerset

NAMES = [f"{part}{number}" for part in ("HIP", "SHIN", "TOE") for number in range(1, 5)]


def turn_of(vectors) -> np.ndarray:
    return rotations.exponential(np.asarray(vectors, dtype=float))[0]


def leg(frames: int = 120, size: float = 1.0, seed: int = 0, noise: float = 0.0005) -> np.ndarray:
    """(T, 12, 3) a hanging chain of three rigid parts with four markers each; it swings and twists as it walks."""
    form, motion = np.random.default_rng(7), np.random.default_rng(seed)
    shapes = [
        form.uniform([-0.08, -0.08, height - 0.08], [0.08, 0.08, height + 0.08], (4, 3))
        for height in (0.1, -0.25, -0.2)
    ]
    time = np.arange(frames)[:, None] / 60
    swing = [
        amount * np.sin(time * rate + motion.uniform(0, 6, 3))
        for amount, rate in ((0.3, 1.3), (0.7, [2, 1.1, 0.7]), (0.6, [1.7, 0.9, 2.3]))
    ]
    knee, ankle = np.array([0, 0, -0.05]), np.array([0.02, 0, -0.5])
    place = np.column_stack([time * 0.5, 0 * time, 1 + 0 * time])
    turn, parts = turn_of(swing[0]), []
    parts.append(place[:, None] + np.einsum("fij,mj->fmi", turn, shapes[0]))
    place = place + np.einsum("fij,j->fi", turn, knee)
    turn = turn @ turn_of(swing[1])
    parts.append(place[:, None] + np.einsum("fij,mj->fmi", turn, shapes[1]))
    place = place + np.einsum("fij,j->fi", turn, ankle)
    turn = turn @ turn_of(swing[2])
    parts.append(place[:, None] + np.einsum("fij,mj->fmi", turn, shapes[2]))
    return size * np.concatenate(parts, axis=1) + motion.normal(0, noise, (frames, 12, 3))


def test_what_moves_together_is_a_segment_and_gaps_and_a_swapped_stretch_change_nothing():
    found = find_segments([leg()])
    assert sorted(found.members) == [(0, 1, 2, 3), (4, 5, 6, 7), (8, 9, 10, 11)]
    by_first = {group[0]: index for index, group in enumerate(found.members)}
    assert found.members[0] == (4, 5, 6, 7)
    assert [found.parents[by_first[0]], found.parents[by_first[8]]] == [0, 0]
    # From the knee to the ankle, whatever the markers.
    assert np.linalg.norm(found.joints[by_first[0]] - found.joints[by_first[8]]) == pytest.approx(0.5, abs=0.01)
    points = leg(200)
    chance = np.random.default_rng(3)
    points[chance.random(points.shape[:2]) < 0.15] = np.nan
    points[50:56, [0, 4]] = points[50:56, [4, 0]]
    found = find_segments([points])
    assert sorted(found.members) == [(0, 1, 2, 3), (4, 5, 6, 7), (8, 9, 10, 11)]


def test_the_marker_set_poses_takes_it_has_not_seen():
    markerset = segment_markerset([leg(seed=1), leg(seed=2, size=1.2)], NAMES, "leg")
    assert set(markerset.skeleton.segments) == {"HIP segment", "SHIN segment", "TOE segment"}
    assert markerset.spread.height_sd > 0.05
    assert (markerset.spread.marker_sd >= 0.01).all()
    assert (markerset.capsules.radius > 0).all()
    assert markerset.rest_markers[:, 2].min() == pytest.approx(0, abs=0.02)
    model, fresh = BodyModel(markerset), leg(60, size=1.1, seed=9)
    away = np.linalg.norm(model.pose(fit_points(model, fresh)).markers - fresh, axis=2)
    assert np.median(away) < 0.006


def test_nothing_to_see_is_said():
    with pytest.raises(ValueError, match="three or more"):
        segment_markerset([np.full((5, 4, 3), np.nan)], list("ABCD"), "none")
