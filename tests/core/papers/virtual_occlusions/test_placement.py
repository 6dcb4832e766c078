# SPDX-License-Identifier: GPL-3.0-or-later
"""Section 3: translation by equations 1 to 5, height and facing from the cloud; equation 7 and its derivatives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from addon.core.body.bodies import BodyModel
from addon.core.data.errors import JobError
from addon.core.geometry.cameras import Cameras
from addon.core.geometry.views import Sight, split_views
from addon.core.papers.virtual_occlusions import placement
from addon.core.papers.virtual_occlusions.cloud import Cloud, build_cloud
from addon.core.papers.virtual_occlusions.cost import BlobPull, RayPull
from addon.core.papers.virtual_occlusions.placement import principal_guess, solve_translation
from addon.core.simulation.rigs import paper_rig, ring_rig
from tests.core.scenes import FLAWLESS, blobs_at, built_in, stand

RIG = paper_rig()


@given(st.lists(st.integers(0, 6), min_size=4, max_size=4), st.integers(0, 2**16))
def test_a_cameras_centroid_is_the_mean_of_its_blobs(counts, seed):
    """A4: padding does not count, and a camera without blobs is left out."""
    generator = np.random.default_rng(seed)
    pixels = [generator.uniform(0, 480, (count, 2)) for count in counts]
    centroids, seen = placement.blob_centroids(split_views(blobs_at(pixels), RIG)[0])
    assert seen.tolist() == [count > 0 for count in counts]
    for camera in np.flatnonzero(seen):
        ideal = RIG.undistort(pixels[camera], np.full(counts[camera], camera))
        assert centroids[camera] == pytest.approx(ideal.mean(axis=0), abs=1e-12)


@given(st.integers(0, 2**16), st.integers(2, 8))
def test_translation_is_recovered_exactly(seed, count):
    """A5: equations 1 to 5 on noise-free centroids give T to 1e-9."""
    generator = np.random.default_rng(seed)
    cameras = ring_rig(count, generator=generator)
    centre, translation = generator.normal(0, 0.3, 3), generator.uniform([-0.5, -0.5, 0.4], [0.5, 0.5, 1.4])
    found = solve_translation(cameras.normalised(centre + translation), cameras.extrinsics, centre)
    assert found == pytest.approx(translation, abs=1e-9)


def equations(centroids, extrinsics, centre):
    """E and B of equation 4, row by row from the paper's skew matrices."""
    rows, right = [], []
    for centroid, matrix in zip(centroids, extrinsics, strict=True):
        x, y = centroid
        skew = np.array([[0, -1, y], [1, 0, -x], [-y, x, 0]])
        rows.append(skew @ matrix[:, :3])
        right.append(-skew @ (matrix @ np.append(centre, 1)))
    return np.array(rows), np.array(right)


@given(st.integers(0, 2**16))
def test_translation_equals_the_papers_closed_form(seed):
    """A5: T = (EᵀE)⁻¹ EᵀB on the same rows, scaled as ours are, and the same as lstsq's."""
    generator = np.random.default_rng(seed)
    point, centre = generator.uniform([-0.4, -0.4, 0.6], [0.4, 0.4, 1.4]), generator.normal(0, 0.1, 3)
    centroids = RIG.normalised(point) + generator.normal(0, 0.01, (4, 2))
    rows, right = equations(centroids, RIG.extrinsics, centre)
    size = np.linalg.norm(np.column_stack([centroids, np.ones(4)]), axis=1)
    first = np.linalg.lstsq((rows / size[:, None, None]).reshape(-1, 3), (right / size[:, None]).ravel(), rcond=None)[0]
    depth = np.linalg.norm(RIG.rotation @ (centre + first) + RIG.translation, axis=1)
    E = (rows / (size * depth)[:, None, None]).reshape(-1, 3)
    B = (right / (size * depth)[:, None]).ravel()
    found = solve_translation(centroids, RIG.extrinsics, centre)
    assert found == pytest.approx(np.linalg.inv(E.T @ E) @ E.T @ B, abs=1e-9)
    assert found == pytest.approx(np.linalg.lstsq(E, B, rcond=None)[0], abs=1e-9)


def test_one_camera_is_reported():
    """A5: rank-deficient input is a job that cannot be done, not a crash."""
    one = RIG.select([2])
    with pytest.raises(JobError, match="do not fix a position") as caught:
        solve_translation(one.normalised(np.array([0.1, 0, 1])), one.extrinsics, np.zeros(3))
    assert caught.value.exit_status == 1 and "\n" not in str(caught.value)


def body_cloud(facing, height=1.7, ghosts=0):
    """The markers of a rest body as a cloud, with false crossings of little weight above and below."""
    markerset = built_in("body26")
    turn = Rotation.from_euler("z", facing).as_matrix()
    points = markerset.rest_markers * height @ turn.T
    false = np.random.default_rng(1).uniform([-0.5, -0.5, -1], [0.5, 0.5, 3], (ghosts, 3))
    weight = np.r_[np.ones(len(points)), np.full(ghosts, 0.01)]
    return Cloud(np.vstack([points, false]), np.full(len(weight), 3), weight), markerset.rest_markers[:, 2].max()


def line_apart(first, second):
    """Angle between two lines, rad: facing one way or its opposite is the same."""
    return abs((first - second + np.pi / 2) % np.pi - np.pi / 2)


def bounding_box_guess(cloud: Cloud, tallest_marker: float) -> placement.Guess:
    """Height and facing from the cloud's upright bounding box: a body is wider than it is deep.

    `tallest_marker` is the height of the model's highest marker, heights. The narrowest of boxes turned about the
    vertical says along which line the subject faces, not in which of two directions.
    """
    angles = np.arange(0, np.pi, np.pi / 36)
    across = cloud.points[:, :2] @ np.stack([np.cos(angles), np.sin(angles)])
    width = placement.extent(across, cloud.weight)
    narrowest = int(np.argmin(width))
    return placement.Guess(placement.stature(cloud, tallest_marker), float(angles[narrowest]))


@pytest.mark.parametrize("guess", [bounding_box_guess, principal_guess], ids=["box", "axes"])
@pytest.mark.parametrize("facing", np.radians([0, 33, 90, 151, 200, 290, 345]))
def test_facing_up_to_its_opposite_and_height(guess, facing):
    """A3, A30: through 360°, from the bounding box and from the principal components."""
    found = guess(*body_cloud(facing))
    assert line_apart(found.facing, facing) < np.radians(10)
    assert found.height == pytest.approx(1.7, rel=0.08)


@pytest.mark.parametrize("guess", [bounding_box_guess, principal_guess], ids=["box", "axes"])
@pytest.mark.parametrize("height", [1.1, 1.5, 2.0])
def test_height_survives_false_crossings(guess, height):
    """A3: the outermost two per cent of a cloud's weight do not stretch the person."""
    assert guess(*body_cloud(0.4, height, ghosts=20)).height == pytest.approx(height, rel=0.12)


@pytest.mark.parametrize("guess", [bounding_box_guess, principal_guess], ids=["box", "axes"])
def test_a_flat_or_tiny_cloud_gives_a_human_height(guess):
    cloud = Cloud(np.random.default_rng(0).normal(0, 0.01, (5, 3)), np.full(5, 3), np.ones(5))
    found = guess(cloud, 1.0)
    assert 0.9 <= found.height <= 2.2 and np.isfinite(found.facing)


def test_guesses_from_blobs_are_good_starts_for_most():
    """A3, A30: errors of both first guesses, over people, facings and statures."""
    markerset = built_in("body26")
    errors = {bounding_box_guess: [], principal_guess: []}
    for seed in range(12):
        facing, height = seed * np.pi / 6, 1.1 + 0.9 * seed / 11
        scene = stand(markerset, RIG, seed, facing, height)
        cloud = build_cloud(scene.views()[0], Sight(RIG))
        for guess, rows in errors.items():
            found = guess(cloud, markerset.rest_markers[:, 2].max())
            rows.append((line_apart(found.facing, facing), abs(found.height / height - 1)))
    for rows in errors.values():
        turn, size = np.median(rows, axis=0)
        assert turn < np.radians(15) and size < 0.08
    # The default must be the better of the two.
    assert np.median(errors[principal_guess], axis=0)[0] <= np.median(errors[bounding_box_guess], axis=0)[0]


def test_starts_stand_around_the_point():
    model = BodyModel(built_in("gait15"))
    point, facings = np.array([0.3, -0.2, 0.5]), np.array([0, 2.0, 4.0])
    starts = placement.make_starts(model, point, 1.5, facings)
    posed = model.pose(starts)
    assert posed.markers.mean(axis=1) == pytest.approx(np.tile(point, (3, 1)))
    assert posed.rotations[:, 0, :, 0] == pytest.approx(np.stack([np.cos(facings), np.sin(facings), 0 * facings], 1))
    assert (starts.scale == 1.5).all()


# One camera looks along +x from (-2, 0, 0), one along +y from (0, -4, 0): focal length 100 px, no lens.
MATRIX = [[100.0, 0, 200], [0, 100, 200], [0, 0, 1]]
TURNS = np.array([[[0.0, -1, 0], [0, 0, -1], [1, 0, 0]], [[1, 0, 0], [0, 0, -1], [0, 1, 0]]])
AWAY = np.array([[0, 0, 2.0], [0, 0, 4.0]])
PAIR = Cameras(("a", "b"), [(400, 400)] * 2, [MATRIX] * 2, np.zeros((2, 5)), TURNS, AWAY)
# Two markers in the plane x = 0, y = 0: 2 m before camera a, 4 m before camera b.
MARKERS = np.array([[[0.0, 0, 0], [0, 0, 0.5]]])
# Camera a shows the markers at (200, 200) and (200, 175): 1 px is 0.02 m there, 0.04 m for camera b at (200, 187.5).
TOY_BLOBS = [np.array([[203.0, 204.0], [200.0, 175.0]]), np.array([[200.0, 190.0]])]


def toy(visible, blobs=TOY_BLOBS, softness=0.01, reach=0.2):
    view = split_views(blobs_at(blobs), PAIR)[0]
    return BlobPull(np.array(visible, dtype=bool)[None], view, Sight(PAIR), softness, reach)(MARKERS)


def test_two_cameras_by_hand():
    """A8: over cameras, over visible markers, the distance to the nearest blob, truncated; and the same from the blobs.

    Camera a: the first marker's blob is 3 and 4 px off, 0.1 m; the second's exactly there. Camera b, in which only the
    second is visible: 2.5 px, 0.1 m. The first marker, hidden from b, has no blob there to answer for it: it stays at
    the truncation, whatever the pose.
    """
    reach = 0.2
    markers = 0.1**2 + 0 + reach**2 + 0.1**2
    blobs = 0.1**2 + 0 + 0.1**2
    cost = toy([[1, 1], [0, 1]], reach=reach).cost
    assert cost * 0.01**2 == pytest.approx([(markers + blobs) / 2], abs=1e-9)


def test_a_hidden_marker_pulls_at_nothing():
    """A8: equation 7 sums over visible markers only."""
    pull = toy([[0, 1], [0, 1]])
    assert (pull.gradient[0, 0] == 0).all() and (pull.hessian[0, 0] == 0).all()
    assert np.abs(pull.gradient[0, 1]).max() > 0


@pytest.mark.parametrize("far", [0.5, 1.0, 3.0])
def test_a_far_blob_does_not_pull(far):
    """A14: only small values of equation 7 are considered; what is beyond the reach costs, but does not pull."""
    softness, reach = 0.02, 0.1
    alone = toy([[1, 1], [1, 1]], softness=softness, reach=reach)
    ghosts = [np.vstack([TOY_BLOBS[0], [[200 + far / 0.02, 200]]]), TOY_BLOBS[1]]
    more = toy([[1, 1], [1, 1]], ghosts, softness, reach)
    assert more.gradient == pytest.approx(alone.gradient, abs=1e-6 * np.abs(alone.gradient).max())
    assert more.cost - alone.cost == pytest.approx([(reach / softness) ** 2 / 2], rel=1e-6)


def reference(markers, visible, image, cameras, depth, softness, reach):
    """F of one body, halved as in the code, with the body's depth in every camera given."""
    seen, outside = cameras.normalised(markers)[:, :, None], np.exp(-(reach**2) / (2 * softness**2))
    away = np.linalg.norm(image[:, None] - seen, axis=-1) * depth[:, None, None]
    chance = np.exp(-(away**2) / (2 * softness**2)) * visible[..., None]
    return -sum(np.log(chance.sum(axis=axis) + outside).sum() for axis in (1, 2))


@given(st.integers(0, 2**16), st.sampled_from([(0.2, 0.6), (0.05, 0.2), (0.02, 0.08)]))
def test_equation_7_and_its_gradient_against_finite_differences(seed, stage):
    """A8, A9: the code's cost is the formula's, its gradient half the formula's slope at the body's depth."""
    softness, reach = stage
    rig, generator, small = paper_rig(), np.random.default_rng(seed), 1e-6
    markers = generator.uniform([-0.4, -0.4, 0.4], [0.4, 0.4, 1.6], (4, 3))
    visible = generator.random((4, 4)) < 0.7
    pixels = list(rig.project(markers + generator.normal(0, 0.05, markers.shape)))
    view, sight = split_views(blobs_at(pixels), rig)[0], Sight(rig)
    depth = sight.local(markers[None])[0, ..., 2].mean(axis=1)
    pull = BlobPull(visible[None], view, sight, softness, reach)(markers[None])

    def cost(moved):
        return reference(moved, visible, view.image, rig, depth, softness, reach)

    assert pull.cost == pytest.approx([cost(markers)], rel=1e-9)
    for marker in range(4):
        for axis in range(3):
            step = np.zeros_like(markers)
            step[marker, axis] = small
            slope = (cost(markers + step) - cost(markers - step)) / (2 * small)
            assert 2 * pull.gradient[0, marker, axis] == pytest.approx(slope, rel=1e-4, abs=1e-3 / softness)


def test_named_rays_by_hand_and_switched_off():
    """A marker 0.06 m to the side of its ray at a deviation of 0.02 m is three deviations off: cost 9."""
    sight = Sight(PAIR)
    image = np.zeros((1, 2, 1, 2))
    off = np.array([[[0.02], [np.inf]]])
    pull = RayPull(image, off, sight)(np.array([[[0.0, 0.06, 0]]]))
    assert pull.cost == pytest.approx([9])
    assert pull.gradient[0, 0, 1] == pytest.approx(0.06 / 0.02**2)
    assert pull.hessian[0, 0, 1, 1] == pytest.approx(0.02**-2)
    nothing = RayPull(image, np.full((1, 2, 1), np.inf), sight)(np.array([[[0.0, 0.06, 0]]]))
    assert nothing.cost == 0 and not nothing.gradient.any() and not nothing.hessian.any()


def cloud_of(points, drop=()):
    """The cloud of points that every camera sees, but for dropped (camera, point) pairs."""
    pixels = RIG.project(points)
    kept = [np.array([p for i, p in enumerate(row) if (c, i) not in drop]) for c, row in enumerate(pixels)]
    return build_cloud(split_views(blobs_at(kept), RIG)[0], Sight(RIG))


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


def test_of_many_cameras_the_neighbours_are_enough():
    cameras = ring_rig(16)
    scene = stand(built_in("body26"), cameras, seed=3, facing=1.0, options=FLAWLESS)
    cloud = build_cloud(scene.views()[0], Sight(cameras))
    seen = np.array([sum(mark in text.split("|") for text in scene.truth) for mark in scene.markerset.markers])
    distance = np.linalg.norm(cloud.points[:, None] - scene.points[0][None], axis=-1)
    assert (distance.min(axis=0)[seen >= 4] < 0.01).all()
    assert cloud.weight[distance.min(axis=1) > 0.03].sum() < 3
