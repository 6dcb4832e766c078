# SPDX-License-Identifier: GPL-3.0-or-later
"""Readers against rooms that were really built: what was recorded there must fit the cameras that saw it."""

import csv
from collections import defaultdict

import numpy as np

from addon.io.cameras import read_cameras
from addon.io.points import read_points


def triangulated_residuals(cameras, sightings) -> np.ndarray:
    """Mean reprojection error, px, of each point out of {key: {camera: (x, y)}}, by linear triangulation."""
    residuals = []
    for seen in sightings:
        if len(seen) < 2:
            continue
        camera = np.array(sorted(seen))
        pixels = np.array([seen[index] for index in camera], dtype=float)
        image, rays = cameras.undistort(pixels, camera), cameras.extrinsics[camera]
        rows = np.concatenate([image[:, :1] * rays[:, 2] - rays[:, 0], image[:, 1:] * rays[:, 2] - rays[:, 1]])
        point = np.linalg.svd(rows)[2][-1]
        found = cameras.project(point[:3] / point[3])[camera]
        residuals.append(np.linalg.norm(found - pixels, axis=1).mean())
    return np.array(residuals)


def test_the_vicon_walk_is_seen_by_its_cameras_and_the_leds_real_blobs_triangulate(shared_data):
    cameras = read_cameras(shared_data / "rooms" / "vicon12" / "walking_1.xcp")
    walk = read_points(shared_data / "rooms" / "vicon12" / "walking_1.c3d")
    assert len(cameras) == 12
    present = np.isfinite(walk.xyz[..., 0])
    pixels = cameras.project(walk.xyz)
    inside = ((pixels >= 0) & (pixels <= cameras.size[:, None, None])).all(axis=-1)
    seen = (inside & present).sum(axis=(1, 2)) / present.sum()
    assert (seen > 0.95).sum() == 11, f"shares of the walk in each image: {np.round(seen, 3)}"
    # The room: cameras at 1 to 2.5 m, within 8 m of each other, the walk between them.
    assert (np.abs(cameras.centres[:, 2] - 1.7) < 0.8).all()
    assert np.ptp(cameras.centres, axis=0).max() < 9
    folder = shared_data / "rooms" / "led4"
    cameras = read_cameras(folder)
    blobs = np.loadtxt(folder / "points.dat").reshape(4, 3, -1)
    seen = np.loadtxt(folder / "IdMat.dat").astype(bool)
    frames = ({int(c): blobs[c, :2, t] for c in np.flatnonzero(seen[:, t])} for t in range(blobs.shape[2]))
    residuals = triangulated_residuals(cameras, frames)
    words = f"mean residual {residuals.mean():.3f} px, median {np.median(residuals):.3f} px of {len(residuals)} frames"
    assert len(residuals) == 464, words
    assert residuals.mean() < 0.45, words
    assert np.median(residuals) < 0.35, words


def test_real_charuco_corners_triangulate(shared_data):
    folder = shared_data / "rooms" / "caliscope4"
    cameras = read_cameras(folder / "camera_array.toml")
    assert cameras.names == ("0", "1", "2", "3")
    sightings = defaultdict(dict)
    with (folder / "charuco_xy.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            camera = cameras.names.index(row["cam_id"])
            sightings[row["sync_index"], row["keypoint_id"]][camera] = (
                float(row["img_loc_x"]),
                float(row["img_loc_y"]),
            )
    residuals = triangulated_residuals(cameras, sightings.values())
    words = f"mean residual {residuals.mean():.3f} px, median {np.median(residuals):.3f} px of {len(residuals)} corners"
    assert len(residuals) > 500, words
    assert residuals.mean() < 0.7, words


def test_both_files_of_a_room_say_the_same(shared_data):
    folder = shared_data / "rooms" / "qualisys4"
    ours, theirs = read_cameras(folder / "Calib.qca.txt"), read_cameras(folder / "Calib_qualisys.toml")
    np.testing.assert_allclose(ours.matrix, theirs.matrix, rtol=1e-9)
    np.testing.assert_allclose(ours.size, theirs.size)
    np.testing.assert_allclose(ours.rotation, theirs.rotation, atol=1e-8)
    np.testing.assert_allclose(ours.translation, theirs.translation, atol=1e-8)
    # The .toml has the lens divided by 64 as if it were pixels, which it is not.
    np.testing.assert_allclose(ours.distortion[:, :4], theirs.distortion[:, :4] * 64, rtol=1e-6)
    folder = shared_data / "rooms" / "caliscope4"
    cameras, other = read_cameras(folder / "camera_array.toml"), read_cameras(folder / "config.toml")
    np.testing.assert_array_equal(cameras.rotation, other.rotation)
    np.testing.assert_array_equal(cameras.distortion, other.distortion)
