# SPDX-License-Identifier: GPL-3.0-or-later
"""What is worn on plates, which points of a group may be which markers of one, and volumes of four things that move."""

import numpy as np
import pytest
from addon.core.points.rigid_bodies.correspondences import MAX_ALL, correspondences
from scipy.spatial.transform import Rotation

from addon.core.data.takes import NO_POINT
from addon.core.points.rigid_bodies.model import learn_rigid_bodies
from addon.core.points.rigid_bodies.volumes import MedianVolumes, signed_volumes
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


def limbs(markers: int, seed: int = 0) -> np.ndarray:
    """A figure whose skin gives: (T, 4 * markers, 3) m, four limbs, each of which bends along its whole length."""
    rng = np.random.default_rng(seed)
    phase = np.linspace(0, 4 * np.pi, FRAMES)[:, None]
    parts = []
    for limb in range(4):
        along = np.linspace(0, 1, markers)
        swing = 0.05 * along**2 * np.sin(phase + limb * np.pi / 2)
        place = np.stack([swing, np.full_like(swing, 0.2 * limb), np.broadcast_to(along, swing.shape)], axis=2)
        parts.append(place + 0.01 * rng.normal(size=(markers, 3)))
    return np.concatenate(parts, axis=1) + rng.normal(0, 0.0004, (FRAMES, 4 * markers, 3))


def test_rigid_things_that_move_against_each_other_are_plates():
    rigid_bodies = learn_rigid_bodies([things(3, 4)], RADIUS)
    assert sorted(group.tolist() for group in rigid_bodies.members) == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 11]]


def test_limbs_that_keep_their_form_roughly_are_no_plates():
    """In a short walk the markers of a shank keep together within millimetres: on another person they sit otherwise."""
    assert learn_rigid_bodies([limbs(5)], RADIUS) is None


def test_a_prop_is_one_plate():
    rigid_bodies = learn_rigid_bodies([things(1, 5)], RADIUS)
    assert [group.tolist() for group in rigid_bodies.members] == [[0, 1, 2, 3, 4]]


def test_who_stands_still_is_no_prop():
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


@pytest.mark.parametrize(("markers", "points", "ways"), [(3, 3, 6), (3, 5, 60), (4, 3, 24), (3, 12, 210)])
def test_of_a_small_plate_all_ways_are_tried(markers, points, ways):
    rng = np.random.default_rng(0)
    tried = correspondences(rng.normal(size=(markers, 3)), rng.normal(size=(points, 3)))
    assert len(np.unique(tried, axis=0)) == ways
    assert ((tried != NO_POINT).sum(axis=1) == min(markers, points)).all()


@pytest.mark.parametrize("markers", [8, 13, 20])
@pytest.mark.parametrize("gone", [0, 2])
def test_of_a_large_plate_the_likely_ways_have_the_right_one_and_are_few(markers, gone):
    rng = np.random.default_rng(markers)
    form = rng.normal(0, 0.1, (markers, 3))
    order = rng.permutation(markers)[gone:]
    turn = Rotation.random(random_state=markers).as_matrix()
    tried = correspondences(form, form[order] @ turn.T + rng.normal(0, 0.001, (len(order), 3)))
    right = np.full(markers, NO_POINT)
    right[order] = np.arange(len(order))
    assert (tried == right).all(axis=1).any()
    assert markers > MAX_ALL and len(tried) < 10_000
    for way in tried:
        used = way[way != NO_POINT]
        assert len(np.unique(used)) == len(used)


QUAD = np.array([4, 1, 3, 0])


@pytest.fixture
def place():
    """(F, G, 3) of six things, of which each is missing now and then and the last two are never seen together."""
    rng = np.random.default_rng(3)
    place = rng.normal(size=(40, 6, 3))
    place[rng.random((40, 6)) < 0.2] = np.nan
    place[:20, 4], place[20:, 5] = np.nan, np.nan
    return place


def test_a_volume_is_the_median_of_those_frames_that_show_all_four(place):
    each = signed_volumes(*(place[:, corner] for corner in QUAD))
    assert MedianVolumes(place).of(*QUAD) == pytest.approx(np.nanmedian(each))


def test_volumes_are_the_same_in_blocks_and_asked_for_again(place, monkeypatch):
    rng = np.random.default_rng(4)
    asked = rng.integers(0, 6, (4, 5, 7))
    volumes = MedianVolumes(place)
    first = volumes.of(*asked)
    monkeypatch.setattr("addon.core.points.rigid_bodies.volumes.VOLUMES_AT_ONCE", 50)
    assert first.shape == (5, 7)
    assert (volumes.of(*asked) == first).all()
    assert (MedianVolumes(place).of(*asked) == first).all()
