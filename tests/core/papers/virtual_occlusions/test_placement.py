# SPDX-License-Identifier: GPL-3.0-or-later
"""Section 3: translation by equations 1 to 5, height and facing from the cloud, starts all around."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from addon.core.body.bodies import BodyModel
from addon.core.data.errors import JobError
from addon.core.geometry.views import Sight, split_views
from addon.core.papers.virtual_occlusions.cloud import Cloud, build_cloud
from addon.core.papers.virtual_occlusions.placement import (
    blob_centroids,
    make_starts,
    principal_guess,
    solve_translation,
)
from addon.core.simulation.rigs import paper_rig, ring_rig
from tests.core.papers.virtual_occlusions.stages import bounding_box_guess
from tests.core.scenes import blobs_at, built_in, stand

RIG = paper_rig()


@given(st.lists(st.integers(0, 6), min_size=4, max_size=4), st.integers(0, 2**16))
def test_a_cameras_centroid_is_the_mean_of_its_blobs(counts, seed):
    """A4: padding does not count, and a camera without blobs is left out."""
    generator = np.random.default_rng(seed)
    pixels = [generator.uniform(0, 480, (count, 2)) for count in counts]
    centroids, seen = blob_centroids(split_views(blobs_at(pixels), RIG)[0])
    assert seen.tolist() == [count > 0 for count in counts]
    for camera in np.flatnonzero(seen):
        ideal = RIG.undistort(pixels[camera], np.full(counts[camera], camera))
        assert centroids[camera] == pytest.approx(ideal.mean(axis=0), abs=1e-12)


@settings(max_examples=60)
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


def body_cloud(facing, height=1.7, ghosts=0, name="body26"):
    """The markers of a rest body as a cloud, with false crossings of little weight above and below."""
    markerset = built_in(name)
    turn = Rotation.from_euler("z", facing).as_matrix()
    points = markerset.rest_markers * height @ turn.T
    false = np.random.default_rng(1).uniform([-0.5, -0.5, -1], [0.5, 0.5, 3], (ghosts, 3))
    weight = np.r_[np.ones(len(points)), np.full(ghosts, 0.01)]
    return Cloud(np.vstack([points, false]), np.full(len(weight), 3), weight), markerset.rest_markers[:, 2].max()


def line_apart(first, second):
    """Angle between two lines, rad: facing one way or its opposite is the same."""
    return abs((first - second + np.pi / 2) % np.pi - np.pi / 2)


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
    starts = make_starts(model, point, 1.5, facings)
    posed = model.pose(starts)
    assert posed.markers.mean(axis=1) == pytest.approx(np.tile(point, (3, 1)))
    assert posed.rotations[:, 0, :, 0] == pytest.approx(np.stack([np.cos(facings), np.sin(facings), 0 * facings], 1))
    assert (starts.scale == 1.5).all()
