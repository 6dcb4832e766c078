# SPDX-License-Identifier: GPL-3.0-or-later
"""What is worn on plates, and what only keeps its form for a while."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from addon.core.points.rigid_bodies.model import learn_rigid_bodies
from addon.io.points import read_points

RADIUS = 0.5
FRAMES = 100


def things(count: int, markers: int, seed: int = 0) -> np.ndarray:
    """Rigid things that tumble about, each on its own: (T, count * markers, 3) m."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0, 1, FRAMES)[:, None]
    parts = []
    for _ in range(count):
        form = rng.normal(0, 0.06, (markers, 3))
        turn = Rotation.from_rotvec(time * rng.normal(0, 2, 3)).as_matrix()
        parts.append(
            np.einsum("fij,nj->fni", turn, form) + rng.normal(0, 0.5, 3) + (time * rng.normal(0, 1, 3))[:, None]
        )
    return np.concatenate(parts, axis=1) + rng.normal(0, 0.0004, (FRAMES, count * markers, 3))


def test_rigid_things_that_move_against_each_other_are_plates_and_who_stands_still_is_no_prop():
    rigid_bodies = learn_rigid_bodies([things(3, 4)], RADIUS)
    assert sorted(group.tolist() for group in rigid_bodies.members) == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 11]]
    rigid_bodies = learn_rigid_bodies([things(1, 5)], RADIUS)
    assert [group.tolist() for group in rigid_bodies.members] == [[0, 1, 2, 3, 4]]
    rng = np.random.default_rng(1)
    still = rng.normal(0, 0.4, (15, 3)) + rng.normal(0, 0.001, (FRAMES, 1, 3)) + rng.normal(0, 0.0005, (FRAMES, 15, 3))
    assert learn_rigid_bodies([still], RADIUS) is None


@pytest.mark.parametrize("takes", [["KneeltoProne01"], ["PronetoRun01"], ["KneeltoProne01", "PronetoRun01"]])
def test_a_recorded_set_on_plates_is_one_whatever_takes_teach_it(shared_data, takes):
    recorded = [read_points(shared_data / "people" / "clouthier" / f"{name}.c3d").xyz for name in takes]
    rigid_bodies = learn_rigid_bodies([np.concatenate(recorded)], RADIUS)
    assert rigid_bodies is not None and len(rigid_bodies.members) == 13


@pytest.mark.parametrize("take", ["HC038A/HC038A11", "HC044A/HC044A15", "HC030A/HC030A05"])
def test_a_recorded_walk_in_markers_on_the_skin_is_no_set_on_plates(shared_data, take):
    points = read_points(shared_data / "people" / "mcgill" / f"{take}.c3d").xyz
    assert learn_rigid_bodies([points[:, np.isfinite(points[..., 0]).mean(axis=0) > 0.5]], RADIUS) is None


@pytest.mark.parametrize("radius", [0.03, 0.1, 0.2])
def test_what_is_apart_but_not_rigid_for_its_size_is_no_set_on_plates(radius):
    """Of a small creature millimetres are a lot: without a group that is rigid there is no plate to know it by."""
    rng = np.random.default_rng(4)
    points = things(3, 4) + rng.normal(0, 0.002, (FRAMES, 12, 3))
    rigid_bodies = learn_rigid_bodies([points], radius)
    assert rigid_bodies is None or rigid_bodies.members
