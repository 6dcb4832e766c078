# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras moved until their blobs meet."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.calibration.adjusting import MIN_RAYS, Sightings, adjusted, held
from addon.core.geometry.cameras import Cameras
from addon.core.geometry.rotations import turn_of
from addon.core.simulation.rigs import ring_rig

NOISE = 0.3  # px
EVERYWHERE = np.array([[x, y, z] for x in (-0.6, 0, 0.6) for y in (-0.6, 0, 0.6) for z in (0.1, 1, 1.8)])


def moved(cameras: Cameras, which, degrees: float, millimetres: float, seed: int = 0) -> Cameras:
    """Some cameras turned and shifted by so much, each in a direction of its own."""
    random = np.random.default_rng(seed)
    rotation, centres = cameras.rotation.copy(), cameras.centres.copy()
    for index in which:
        axis, way = (row / np.linalg.norm(row) for row in random.standard_normal((2, 3)))
        rotation[index] = turn_of(axis * np.radians(degrees)) @ rotation[index]
        centres[index] += way * millimetres / 1000
    return replace(cameras, rotation=rotation, translation=-np.einsum("cij,cj->ci", rotation, centres))


def seen_by(true: Cameras, calibrated: Cameras, count: int = 400, seed: int = 0, wrong: float = 0.0) -> Sightings:
    """Points that most cameras see, by their true places; a part of the blobs are of something else."""
    random = np.random.default_rng(seed)
    points = random.uniform([-0.8, -0.8, 0.05], [0.8, 0.8, 1.9], (count, 3))
    pixels = true.project(points)
    camera, point = np.nonzero(random.random(pixels.shape[:2]) < 0.75)
    xy = pixels[camera, point] + NOISE * random.standard_normal((len(camera), 2))
    xy += (random.random((len(xy), 1)) < wrong) * random.uniform(-40, 40, (len(xy), 2))
    seen = Sightings(camera, xy, calibrated.undistort(xy, camera), point, count)
    return seen.kept(np.bincount(point, minlength=count) >= MIN_RAYS)


def image_error(cameras: Cameras, true: Cameras) -> np.ndarray:
    """(C,) px by which cameras see places elsewhere than the true ones do, root mean square."""
    off = cameras.project(EVERYWHERE) - true.project(EVERYWHERE)
    return np.sqrt((off**2).sum(axis=-1).mean(axis=-1))


@pytest.mark.parametrize(("count", "which"), [(4, [2]), (5, [0]), (8, [3]), (8, [1, 6])])
@pytest.mark.parametrize(("degrees", "millimetres"), [(0.3, 10.0), (2.0, 50.0)])
def test_cameras_that_were_moved_are_where_they_are_within_the_noise(count, which, degrees, millimetres):
    true = ring_rig(count, generator=np.random.default_rng(count))
    calibrated = moved(true, which, degrees, millimetres, seed=count)
    seen = seen_by(true, calibrated)
    found = held(calibrated, adjusted(calibrated, seen, np.ones(count, bool)), seen)
    assert image_error(calibrated, true).max() > 5 * NOISE
    assert image_error(found, true).max() < 0.5 * NOISE
    assert np.array_equal(found.matrix, true.matrix) and np.array_equal(found.distortion, true.distortion)
    assert seen.errors(found) == pytest.approx(1.1 * NOISE, rel=0.35)


def test_wrong_names_pull_little_and_cameras_that_are_not_free_stay():
    true = ring_rig(6, generator=np.random.default_rng(1))
    calibrated = moved(true, [4], 0.5, 20)
    seen = seen_by(true, calibrated, wrong=0.02)
    found = held(calibrated, adjusted(calibrated, seen, np.ones(6, bool)), seen)
    assert image_error(found, true).max() < NOISE
    true = ring_rig(6, generator=np.random.default_rng(2))
    calibrated = moved(true, [4], 0.5, 20)
    free = np.arange(6) == 4
    found = adjusted(calibrated, seen_by(true, calibrated), free)
    assert np.array_equal(found.rotation[~free], calibrated.rotation[~free])
    assert np.array_equal(found.translation[~free], calibrated.translation[~free])
    assert image_error(found, true).max() < 0.5 * NOISE


@pytest.mark.parametrize("seed", range(3))
def test_the_world_is_that_of_the_cameras_that_stayed(seed):
    """Cameras that moved, turned and grew together, and one besides: held, only that one is elsewhere."""
    random = np.random.default_rng(seed)
    before = ring_rig(6, generator=random)
    alone = moved(before, [2], 1.0, 40, seed)
    turn, scale, shift = turn_of(0.02 * random.standard_normal(3)), 1.01, 0.05 * random.standard_normal(3)
    rotation = alone.rotation @ turn.T
    together = replace(alone, rotation=rotation, translation=scale * alone.translation - rotation @ shift)
    found = held(before, together, seen_by(alone, before, seed=seed))
    stayed = np.arange(6) != 2
    assert np.abs(found.centres - alone.centres)[stayed].max() < 5e-4
    assert np.abs(found.rotation - alone.rotation).max() < 2e-4
    assert image_error(found, alone).max() < 0.1
