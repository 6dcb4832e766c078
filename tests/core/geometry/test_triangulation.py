# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers in space from named blobs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.geometry.triangulation import Rays, meet_rows
from addon.core.geometry.views import Sight, split_views
from addon.core.simulation.rigs import paper_rig, ring_rig
from tests.core.scenes import blobs_at

RIG = paper_rig()


def rays_to(points, cameras=RIG, noise=None):
    """Rays of one blob a point in every camera, in the points' order."""
    pixels = cameras.project(points) + (0 if noise is None else noise)
    view = split_views(blobs_at(list(pixels)), cameras)[0]
    return Rays(view, Sight(cameras))


def slots(count, cameras=4):
    return np.tile(np.arange(count), (cameras, 1))


@given(st.integers(0, 2**16), st.integers(2, 4))
def test_rays_without_noise_meet_in_the_marker(seed, cameras):
    generator = np.random.default_rng(seed)
    points = generator.uniform([-0.7, -0.7, 0.1], [0.7, 0.7, 1.9], (6, 3))
    chosen = slots(6)
    for marker in range(6):
        chosen[generator.permutation(4)[cameras:], marker] = -1
    met = rays_to(points).meet(chosen)
    assert met.points == pytest.approx(points, abs=1e-9)
    assert met.residual == pytest.approx(np.zeros(6), abs=1e-7)
    assert (met.miss[chosen < 0] == 0).all()


def test_one_camera_none_and_parallel_rays_fix_no_point():
    chosen = slots(2)
    chosen[1:, 0] = -1
    chosen[:, 1] = -1
    met = rays_to(np.array([[0.1, 0, 1.0], [0, 0.2, 1.2]])).meet(chosen)
    assert np.isnan(met.points).all() and np.isnan(met.residual).all()
    assert (met.miss == 0).all()
    # Two cameras side by side look along one line at a far point: its depth is anybody's guess.
    near = ring_rig(2)
    centres = near.centres.copy()
    centres[1] = centres[0] + [0, 0, 0.01]
    rotation = np.repeat(near.rotation[:1], 2, axis=0)
    pair = type(near)(
        near.names, near.size, near.matrix, near.distortion, rotation, -np.einsum("cij,cj->ci", rotation, centres)
    )
    assert np.isnan(rays_to(np.array([[0.0, 0, 1]]), pair).meet(slots(1, 2)).points).all()


def test_weights_make_the_reprojection_error_least():
    """A pixel is worth more metres to a far camera, so the near one's ray counts for more."""
    cameras = ring_rig(4)
    point = np.array([[1.6, 0.3, 1.0]])
    noise = np.random.default_rng(5).normal(0, 1, (4, 1, 2))
    met = rays_to(point, cameras, noise).meet(slots(1))

    def error(candidate):
        return np.sum((cameras.project(candidate) - cameras.project(point) - noise) ** 2)

    best = error(met.points)
    moved = [error(met.points + step) for step in 0.002 * np.vstack([np.eye(3), -np.eye(3)])]
    assert best < min(moved)


def test_rows_of_rays_meet_where_a_frames_rays_do():
    cameras = ring_rig(5, generator=np.random.default_rng(1))
    points = np.random.default_rng(2).uniform([-0.5, -0.5, 0.1], [0.5, 0.5, 1.8], (6, 3))
    ideal = cameras.normalised(points)
    camera, point = np.divmod(np.arange(30), 6)
    image = ideal[camera, point]
    assert np.allclose(meet_rows(cameras, camera, image, point, 6), points, atol=1e-6)
    image[3] += 0.05  # camera 0's ray of point 3
    without = meet_rows(cameras, camera, image, point, 6, others=True)
    assert np.linalg.norm(without[3] - points[3]) < 1e-6 < np.linalg.norm(without[9] - points[3])
    one = point == 2
    one[2] = False
    lone = meet_rows(cameras, camera[point == 2][:1], image[point == 2][:1], np.zeros(1, int), 2)
    assert np.isnan(lone).all()
    assert np.allclose(meet_rows(cameras, camera[one], image[one], 0 * point[one], 1), points[2:3], atol=1e-6)
