# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs made ready for the fit: frames apart, lens out, floods refused; and the fit's own quick projection."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.data.takes import Blobs
from addon.core.geometry.cameras import Cameras
from addon.core.geometry.views import NOWHERE, Sight, split_views
from addon.core.simulation.rigs import paper_rig, ring_rig

RIG = paper_rig()


def blobs_of(frame, camera, xy, frames=None):
    frame = np.asarray(frame)
    frames = np.arange(10, 10 + frame.max(initial=0) + 1) if frames is None else np.asarray(frames)
    return Blobs(frames, frame, np.asarray(camera), np.reshape(xy, (-1, 2)).astype(float), np.full(len(frame), np.nan))


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 3)), max_size=40), st.integers(0, 2**16))
def test_every_blob_is_in_its_own_frame_and_camera_once(where, seed):
    frame, camera = np.array(where, dtype=int).reshape(-1, 2).T
    xy = np.random.default_rng(seed).uniform([0, 0], RIG.size[0], (len(frame), 2))
    blobs = blobs_of(frame, camera, xy, frames=range(5))
    views = split_views(blobs, RIG)
    assert len(views) == 5
    rows = np.concatenate([view.row[view.real] for view in views])
    assert sorted(rows) == list(range(len(frame)))
    ideal = RIG.undistort(xy, camera)
    for index, view in enumerate(views):
        c, k = np.nonzero(view.real)
        assert (frame[view.row[c, k]] == index).all() and (camera[view.row[c, k]] == c).all()
        assert np.array_equal(view.image[c, k], ideal[view.row[c, k]])
        assert (view.image[~view.real] == NOWHERE).all() and (view.row[~view.real] == -1).all()
        assert view.count == (frame == index).sum()


def test_a_blob_that_no_light_can_make_is_left_out():
    lens = np.zeros((4, 5))
    lens[:, 0] = -0.3  # shows nothing beyond 0.703 focal lengths from the middle
    middle = RIG.matrix[0, :2, 2]
    outside, inside = middle - [0.75 * RIG.focal[0], 0], middle - [0.70 * RIG.focal[0], 0]
    view = split_views(blobs_of([0, 0], [0, 0], [outside, inside]), replace(RIG, distortion=lens))[0]
    assert view.count == 1 and view.row[0, 0] == 1


@given(st.integers(0, 2**16))
def test_sight_sees_what_the_reference_pinhole_sees(seed):
    """A7: equation 6's projection, as the one camera model has it, which is the textbook's."""
    points = np.random.default_rng(seed).uniform([-0.8, -0.8, 0], [0.8, 0.8, 2], (1, 9, 3))
    sight = Sight(RIG)
    image = sight.image(sight.local(points))[0]
    assert image == pytest.approx(RIG.normalised(points[0]), abs=1e-12)


@given(st.integers(0, 2**16))
def test_sight_knows_how_images_move_with_points(seed):
    points = np.random.default_rng(seed).uniform([-0.8, -0.8, 0], [0.8, 0.8, 2], (1, 3, 3))
    sight, small = Sight(RIG), 1e-6
    local = sight.local(points)
    slope = sight.derivatives(local, sight.image(local))
    for axis in range(3):
        step = small * np.eye(3)[axis]
        change = sight.image(sight.local(points + step)) - sight.image(sight.local(points - step))
        assert slope[..., axis] == pytest.approx(change / (2 * small), abs=1e-8)


def test_points_behind_a_camera_are_nobodys_nearest_and_not_inside():
    sight = Sight(RIG)
    behind = RIG.centres[0] - RIG.rotation[0, 2]
    image = sight.image(sight.local(behind[None, None]))
    assert np.abs(image[0, 0, 0]).min() > NOWHERE
    assert not sight.inside(image)[0, 0, 0]


@pytest.mark.parametrize("rig", [paper_rig(), ring_rig(3, size=(1280, 720))], ids=["paper", "ring"])
def test_inside_is_never_false_for_what_falls_on_the_sensor(rig: Cameras):
    points = np.random.default_rng(3).uniform([-1.5, -1.5, -0.5], [1.5, 1.5, 2.5], (4000, 3))
    pixels = rig.project(points)
    on_sensor = ((pixels > 0) & (pixels < rig.size[:, None])).all(axis=-1)
    sight = Sight(rig)
    inside = sight.inside(sight.image(sight.local(points[None])))[0]
    assert inside[on_sensor].all()
    margin = ((pixels > -30) & (pixels < rig.size[:, None] + 30)).all(axis=-1)
    assert not inside[~margin].any()


@pytest.mark.filterwarnings("error")
def test_a_lens_whose_middle_is_a_corner_of_the_image_is_none_to_stumble_over():
    matrix, bulged = RIG.matrix.copy(), RIG.distortion.copy()
    matrix[1, :2, 2], bulged[1] = 0.0, [-0.1, 0.05, 0.0, 0.0, 0.0]
    low, high = Sight(replace(RIG, matrix=matrix, distortion=bulged)).corners
    assert (low[1] == 0).all()
    assert np.isfinite(high).all() and (high[1] > 0).all()
