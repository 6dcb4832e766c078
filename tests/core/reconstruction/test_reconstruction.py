# SPDX-License-Identifier: GPL-3.0-or-later
"""Points from unnamed blobs: the right ones, no others, and trajectories that stay on their marker."""

import gc
import tracemalloc

import numpy as np
import pytest

from addon.core.data.errors import JobError
from addon.core.data.takes import Blobs
from addon.core.geometry.views import split_views
from addon.core.reconstruction.linking import Links
from addon.core.reconstruction.matching import each_once
from addon.core.reconstruction.trajectories import Reconstructor, reconstruct_take
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import CaptureOptions, capture
from tests.core.scenes import joined, keep

RATE = 100.0


def dance(frames: int, markers: int = 12) -> np.ndarray:
    """(T, M, 3) markers of which each goes round a place of its own in the middle of the room."""
    generator = np.random.default_rng(0)
    places = generator.uniform([-0.4, -0.4, 0.3], [0.4, 0.4, 1.7], (markers, 3))
    phase, speed = generator.uniform(0, 2 * np.pi, markers), generator.uniform(1, 6, markers)
    angle = phase + np.arange(frames)[:, None] / RATE * speed
    return places + 0.15 * np.stack([np.cos(angle), np.sin(angle), np.sin(2 * angle) / 2], axis=-1)


def blobs_of(xyz, cameras, **trouble):
    names = [f"M{index}" for index in range(xyz.shape[1])]
    options = CaptureOptions(**{"reflections": 0, "flicker": 0.0, "merge_gap": -100.0, "noise": 0.2, **trouble})
    return joined(capture(xyz, names, cameras, options))


def matched(points, markers):
    """For each point its nearest marker and the distance to it."""
    distance = np.linalg.norm(points[:, None] - markers, axis=2)
    return distance.argmin(axis=1), distance.min(axis=1)


def test_every_marker_and_nothing_else_in_clean_blobs():
    xyz, cameras = dance(60), ring_rig(6)
    [part] = reconstruct_take([blobs_of(xyz, cameras).blobs], cameras, RATE)
    of_marker = {}
    for frame in range(60):
        mine = part.frame == frame
        marker, off = matched(part.points[mine], xyz[frame])
        assert sorted(marker) == list(range(12))
        assert off.max() < 0.006
        for who, trajectory in zip(marker.tolist(), part.trajectory[mine].tolist(), strict=True):
            of_marker.setdefault(who, set()).add(trajectory)
    assert all(len(trajectories) == 1 for trajectories in of_marker.values())
    assert 0.1 < part.pixel < 0.3
    assert (part.support >= 5).mean() > 0.9


def test_few_false_points_among_ghosts_and_merged_blobs():
    xyz, cameras = dance(50), ring_rig(6)
    seen = blobs_of(xyz, cameras, reflections=3, flicker=2.0, merge_gap=0.5, noise=0.3)
    [part] = reconstruct_take([seen.blobs], cameras, RATE)
    lasting = np.bincount(part.trajectory)[part.trajectory] >= 5
    false = found = 0
    for frame in range(50):
        marker, off = matched(part.points[(part.frame == frame) & lasting], xyz[frame])
        false += (off > 0.01).sum()
        found += len(set(marker[off <= 0.01].tolist()))
    assert found > 0.98 * 50 * 12
    assert false < 0.1 * 50


def test_chunks_make_no_difference_to_trajectories():
    xyz, cameras = dance(40), ring_rig(5)
    blobs = blobs_of(xyz, cameras).blobs
    chunks = [blobs.between(*ends) for ends in ((1, 16), (17, 17), (18, 40))]
    parts = list(reconstruct_take(chunks, cameras, RATE))
    assert [len(part.frames) for part in parts] == [16, 1, 23]
    assert set(np.concatenate([part.trajectory for part in parts]).tolist()) == set(range(12))


def test_a_point_of_two_cameras_needs_blobs_that_nothing_better_explains():
    cameras = ring_rig(4)
    xyz = dance(30, markers=8)
    seen = blobs_of(xyz, cameras)
    hidden = (seen.truth == "M0") & (seen.blobs.camera > 1)
    blobs = keep(seen.blobs, ~hidden)
    [part] = reconstruct_take([blobs], cameras, RATE)
    thin = part.support == 2
    _, off = matched(part.points[thin], xyz[:, 0])
    assert thin.sum() >= 27
    assert np.median(off) < 0.01
    assert len(part.points) <= 30 * 8


def test_no_blobs_and_blobs_of_one_camera_make_no_points():
    cameras = ring_rig(3)
    nothing = Blobs(np.arange(3), np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2)), np.zeros(0))
    lone = Blobs(np.arange(1), np.zeros(2, int), np.zeros(2, int), np.array([[10.0, 10], [20, 20]]), np.ones(2))
    parts = list(reconstruct_take([nothing, lone], cameras, RATE))
    assert [len(part.points) for part in parts] == [0, 0]
    with pytest.raises(JobError, match="two or more"):
        list(reconstruct_take([lone], cameras.select([0])))


def test_the_nearest_blob_to_a_point_is_found_among_all_of_its_image():
    xyz, cameras, rng = dance(2), ring_rig(9), np.random.default_rng(1)
    seen = blobs_of(xyz, cameras, reflections=8).blobs
    matcher = Reconstructor(cameras, RATE).matcher(split_views(seen, cameras))
    matcher.free = matcher.real & (rng.random(matcher.real.shape) < 0.8)
    frame, points = np.repeat([0, 1], 200), xyz[:, rng.integers(12, size=200)].reshape(-1, 3)
    points = np.concatenate([points[:-2] + rng.normal(0, 0.05, (398, 3)), [[0, 0, 50.0], [9e9, 0, 0]]])
    image = matcher.sight.image(matcher.sight.local(points[None])[0])
    asked = matcher.free[:, None] & (matcher.frame_of == frame[:, None])
    off = np.where(asked, np.linalg.norm(image[:, :, None] - matcher.image[:, None], axis=-1), np.inf)
    for deviations in (5.0, 50.0):
        near = off.min(axis=2) < deviations * matcher.pixel / matcher.sight.focal[:, None]
        assert 0.005 < near.mean() < 0.99
        wanted = np.where(near, off.argmin(axis=2), -1).T
        np.testing.assert_array_equal(matcher._nearest_blobs(points, frame, deviations), wanted)


@pytest.mark.parametrize("cameras", [2, 40])
def test_sets_of_blobs_are_there_once_and_in_order(cameras):
    slots = np.random.default_rng(0).integers(-1, 60, (50, cameras))
    np.testing.assert_array_equal(each_once(slots[np.arange(150) % 50]), np.unique(slots, axis=0))
    assert each_once(slots[:0]).shape == (0, cameras)


def test_a_gap_is_bridged_and_a_long_one_is_not():
    xyz = dance(80, markers=1)
    for gap, trajectories in ((6, 1), (40, 2)):
        links, numbers = Links.at(RATE), set()
        for frame in range(80):
            there = xyz[frame] if not 20 <= frame < 20 + gap else np.zeros((0, 3))
            numbers.update(links.link(there).tolist())
        assert len(numbers) == trajectories


def test_memory_does_not_grow_with_the_take():
    xyz, cameras = dance(12, markers=5), ring_rig(4)
    blobs = blobs_of(xyz, cameras).blobs
    reconstructor = Reconstructor(cameras, RATE)
    for _ in range(3):
        reconstructor.reconstruct(blobs)
    tracemalloc.start()
    for _ in range(10):
        reconstructor.reconstruct(blobs)
    gc.collect()  # what calls of the library leave behind goes in rounds
    left = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert left < 50_000
