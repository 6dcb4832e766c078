# SPDX-License-Identifier: GPL-3.0-or-later
"""Points from unnamed blobs: the markers are there, false crossings weigh less, nothing gives nothing."""

import numpy as np
import pytest

from addon.core.geometry.views import Sight, split_views
from addon.core.papers.virtual_occlusions.cloud import build_cloud
from addon.core.simulation.rigs import paper_rig, ring_rig
from tests.core.scenes import FLAWLESS, blobs_at, built_in, stand

RIG = paper_rig()


def cloud_of(points, cameras=RIG, drop=()):
    """The cloud of points that every camera sees, but for dropped (camera, point) pairs."""
    pixels = cameras.project(points)
    kept = [np.array([p for i, p in enumerate(row) if (c, i) not in drop]) for c, row in enumerate(pixels)]
    return build_cloud(split_views(blobs_at(kept), cameras)[0], Sight(cameras))


SPREAD = np.array([[0.1, 0.3, 0.3], [-0.4, 0.1, 0.8], [0.3, -0.35, 1.2], [-0.1, -0.2, 1.7], [0.5, 0.5, 1.0]])


def test_points_that_two_cameras_or_all_see_are_the_cloud():
    cloud = cloud_of(SPREAD)
    distance = np.linalg.norm(cloud.points[:, None] - SPREAD[None], axis=-1)
    assert (distance.min(axis=0) < 1e-6).all()
    assert (cloud.support[distance.argmin(axis=0)] == 4).all()
    assert (cloud.weight[distance.argmin(axis=0)] == 1).all()
    cloud = cloud_of(SPREAD, drop={(0, 2), (1, 2)})
    nearest = np.linalg.norm(cloud.points - SPREAD[2], axis=1)
    assert nearest.min() < 1e-6 and cloud.support[nearest.argmin()] == 2
    cloud = cloud_of(np.zeros((0, 3)))
    assert cloud.points.shape == (0, 3) and cloud.support.shape == (0,)


@pytest.mark.parametrize("name", ["gait15", "body26"])
def test_a_persons_cloud_holds_what_two_cameras_see_and_little_else(name):
    scene = stand(built_in(name), RIG, seed=3, facing=1.0, options=FLAWLESS)
    cloud = build_cloud(scene.views()[0], Sight(RIG))
    seen = [sum(mark in text.split("|") for text in scene.truth) for mark in scene.markerset.markers]
    distance = np.linalg.norm(cloud.points[:, None] - scene.points[0][None], axis=-1)
    merged = {mark for text in scene.truth if "|" in text for mark in text.split("|")}
    alone = np.array([mark not in merged for mark in scene.markerset.markers])
    reachable = (np.array(seen) >= 2) & alone
    assert (distance.min(axis=0)[reachable] < 0.01).mean() > 0.9
    real = distance.min(axis=1) < 0.03
    assert cloud.weight[~real].sum() < 0.5 * cloud.weight[real].sum()


def test_of_many_cameras_the_neighbours_are_enough():
    cameras = ring_rig(16)
    scene = stand(built_in("body26"), cameras, seed=3, facing=1.0, options=FLAWLESS)
    cloud = build_cloud(scene.views()[0], Sight(cameras))
    seen = np.array([sum(mark in text.split("|") for text in scene.truth) for mark in scene.markerset.markers])
    distance = np.linalg.norm(cloud.points[:, None] - scene.points[0][None], axis=-1)
    assert (distance.min(axis=0)[seen >= 4] < 0.01).all()
    assert cloud.weight[distance.min(axis=1) > 0.03].sum() < 3
