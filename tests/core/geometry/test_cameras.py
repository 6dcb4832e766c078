# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera model against a projection by hand, calibrations that are none, and blobs made ready for the fit."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.data.errors import InputError
from addon.core.data.takes import Blobs
from addon.core.geometry import inverse_lens
from addon.core.geometry.cameras import LENS_NEWTON, Cameras, distort, lens_reach, straightened
from addon.core.geometry.views import NOWHERE, Sight, split_views
from addon.core.simulation.rigs import paper_rig, ring_rig


def by_hand(cameras, camera, point):
    """One point through one camera, as a textbook has it."""
    x, y, z = cameras.rotation[camera] @ point + cameras.translation[camera]
    x, y = x / z, y / z
    k1, k2, p1, p2, k3 = cameras.distortion[camera]
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    (fx, skew, cx), (_, fy, cy), _ = cameras.matrix[camera]
    return np.array([fx * u + skew * v + cx, fy * v + cy])


def undistort(image, lens):
    """Places (..., 2) without a lens (..., 5)."""
    flat = image.reshape(-1, 2)
    lens = np.broadcast_to(lens, (*image.shape[:-1], 5)).reshape(-1, 5)
    return straightened(flat, lens, lens_reach(lens), *LENS_NEWTON).reshape(image.shape)


def test_projection_is_the_textbooks_and_what_is_behind_is_not_a_number():
    matrix = paper_rig().matrix.copy()
    matrix[:, 0, 1], matrix[:, 1, 1] = 1.5, 650
    cameras = replace(paper_rig(), matrix=matrix)
    points = np.random.default_rng(0).uniform([-0.8, -0.8, 0], [0.8, 0.8, 2], (40, 3))
    found = cameras.project(points)
    for camera in range(4):
        for index, point in enumerate(points):
            assert found[camera, index] == pytest.approx(by_hand(cameras, camera, point), abs=1e-9)
    cameras = ring_rig(1)
    behind = cameras.centres[0] - 2 * cameras.rotation[0, 2]
    assert np.isnan(cameras.project(behind)).all()
    assert np.isfinite(cameras.project(cameras.centres[0] + 2 * cameras.rotation[0, 2])).all()


@pytest.mark.parametrize("x", [-0.994, 0.75, 1.5, -4.0, 30.0])
def test_a_pixel_far_outside_does_not_come_from_beyond_the_turning_point(x):
    """Newton's method finds some root of the polynomial for each of these; light takes none of them."""
    image, lens = np.array([[x, 0.0], [0.3, 0.2], [0.0, 0.0]]), np.tile([-0.3, 0, 0, 0, 0], (3, 1))
    found = undistort(image, lens)
    assert np.isnan(found[0]).all()
    assert distort(found[1:], lens[1:]) == pytest.approx(image[1:], abs=1e-12)


def test_a_lens_reaches_to_its_first_turning_point():
    lenses = np.array([[-0.3, 0, 0, 0, 0], [0, -0.1, 0, 0, 0], [0, 0, 1, 1, -0.1], [0.2, 0.1, 0, 0, 0], np.zeros(5)])
    expected = [0.9**-0.5, 0.5**-0.25, 0.7 ** (-1 / 6), np.inf, np.inf]
    assert lens_reach(lenses) == pytest.approx(expected)


@settings(max_examples=200, deadline=None)
@given(
    st.floats(0, 0.9),
    st.floats(-np.pi, np.pi),
    st.tuples(*[st.floats(-low, low) for low in (0.4, 0.1, 0.001, 0.001, 0.05)]),
)
def test_undistort_keeps_to_the_branch_that_light_takes(share, angle, lens):
    lens = np.array([lens])
    radius = share * np.minimum(lens_reach(lens), 1.2)
    image = radius[:, None] * [[np.cos(angle), np.sin(angle)]]
    assert undistort(distort(image, lens), lens) == pytest.approx(image, abs=1e-11 if share < 0.5 else 1e-8)


@pytest.mark.parametrize(
    ("field", "index", "change", "words"),
    [
        ("matrix", 1, np.zeros_like, "singular"),
        ("rotation", (1, 0), np.negative, "not a rotation"),
        ("translation", (1, 2), lambda _: np.nan, "not a finite number"),
    ],
)
def test_a_calibration_that_is_none_is_refused_in_one_sentence(field, index, change, words):
    cameras = ring_rig(3)
    values = getattr(cameras, field).copy()
    values[index] = change(values[index])
    with pytest.raises(InputError, match=words) as caught:
        replace(cameras, **{field: values})
    assert "\n" not in str(caught.value)
    assert "cam2" in str(caught.value)


@given(
    st.floats(0.0, 0.999),
    st.floats(0, 6.3),
    st.tuples(st.floats(-0.5, 1.5), st.floats(-0.5, 1.5), st.floats(-0.2, 0.5)),
)
def test_a_lens_of_vicons_kind_is_undone_exactly(share, angle, terms):
    lens = np.array(terms)
    seen = np.array([np.cos(angle), np.sin(angle)]) * share * min(inverse_lens.turning_point(lens), 2.0)
    straight = inverse_lens.straighten(seen[None], lens)
    assert np.isfinite(straight).all()
    # Near its fold a lens is flat, and a rounding error in what is straight is a larger one in what is seen.
    assert inverse_lens.bend(straight, lens)[0] == pytest.approx(seen, abs=1e-6)
    if share < 0.9:
        assert inverse_lens.bend(straight, lens)[0] == pytest.approx(seen, abs=1e-11)


def test_beyond_the_fold_of_a_lens_of_vicons_kind_there_is_nothing():
    lens = np.array([-1 / 3, 0.0, 0.0])  # r - r³/3 turns back at 1, where it is 2/3
    assert inverse_lens.turning_point(lens) == pytest.approx(1)
    assert inverse_lens.reach(lens) == pytest.approx(2 / 3)
    image = np.array([[0.99, 0.0], [0.0, 1.01]])
    assert np.isfinite(inverse_lens.straighten(image, lens)).all(axis=1).tolist() == [True, False]
    straight = np.array([[0.0, 0.0], [0.666, 0.0], [0.0, 0.667], [np.nan, 0.0]])
    assert np.isfinite(inverse_lens.bend(straight, lens)).all(axis=1).tolist() == [True, True, False, False]
    cameras = replace(ring_rig(2), distortion=np.zeros((2, 5)), inverse=np.tile(lens, (2, 1)))
    assert cameras.reach == pytest.approx([2 / 3] * 2)


def test_a_rig_of_both_lenses_is_undistorted_camera_by_camera_each_of_which_has_one():
    mixed = np.array([[0, 0, 0], [0.4, 0.2, 0.0], [-0.1, 0.3, 0.05], [0, 0, 0]])
    lenses = np.where(mixed.any(axis=1)[:, None], 0, paper_rig().distortion)
    cameras = replace(paper_rig(), distortion=lenses, inverse=mixed)
    points = np.random.default_rng(1).uniform([-0.8, -0.8, 0], [0.8, 0.8, 2], (200, 3))
    pixels, ideal = cameras.project(points), cameras.normalised(points)
    camera = np.repeat(np.arange(4), len(points))
    assert np.abs(cameras.undistort(pixels.reshape(-1, 2), camera) - ideal.reshape(-1, 2)).max() < 1e-12
    assert np.array_equal(cameras.select([2, 0]).inverse, mixed[[2, 0]])
    with pytest.raises(InputError, match="two lenses"):
        replace(paper_rig(), distortion=np.full((4, 5), 0.01), inverse=np.full((4, 3), 0.01))
    # Almost square to where a camera looks the radius has no end, and Newton's steps from there are many.
    straight = np.array([[1e3, 0.0], [0.0, 1e6], [1e-9, 0.0]])
    lens = np.array([0.65, 0.8, 0.3])
    seen = inverse_lens.bend(straight, lens)
    assert inverse_lens.straighten(seen, lens) == pytest.approx(straight, rel=1e-9)


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
