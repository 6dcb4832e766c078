# SPDX-License-Identifier: GPL-3.0-or-later
"""Algorithm 1 on scenes made for each of its branches; names that do not meet in space are withdrawn."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.takes import CONFLICT, EXCLUSIVE, NO_STEP, REMAINING
from addon.core.geometry.views import Sight, split_views
from addon.core.papers.virtual_occlusions import labelling
from addon.core.papers.virtual_occlusions.labelling import Expectation, Frame, Naming, Rules, name_markers
from addon.core.simulation.rigs import paper_rig, ring_rig
from tests.core.scenes import blobs_at

RIG = paper_rig()
SIGHT = Sight(RIG)
# Four markers well apart.
MARKERS = np.array([[0.0, 0, 1.0], [0.4, 0, 1.2], [0, 0.5, 0.7], [-0.4, -0.2, 1.5]])
RULES = Rules(pixel=1.0)
OFF = np.array([0.006, -0.004, 0.005])  # m, by which the model is off everywhere in some scenes


def expect_at(points, deviation=0.02, visible=True, cameras=4):
    """The fit expects markers at points (M, 3), each with its standard deviation, m, visible everywhere or as said."""
    spread = np.broadcast_to(deviation, len(points))[:, None, None] ** 2 * np.eye(3)
    shown = np.broadcast_to(np.array(visible, dtype=bool), (cameras, len(points)))
    return Expectation(np.array(points, dtype=float), spread, shown)


def pixels_of(points, rig=RIG):
    """A list of (M, 2) px, one a camera: every marker's blob, in the markers' order."""
    return [np.array(row) for row in rig.project(np.array(points, dtype=float))]


def frame_of(pixels, expected, rules=RULES, rig=RIG):
    return Frame(split_views(blobs_at(pixels), rig)[0], Sight(rig), expected, rules)


def label(pixels, expected, rules=RULES, rig=RIG):
    return name_markers(split_views(blobs_at(pixels), rig)[0], Sight(rig), expected, rules)


def consistent(naming):
    """Slots and owners say the same, and a step goes with every name."""
    camera, marker = np.nonzero(naming.slot >= 0)
    assert np.array_equal(naming.owner[camera, naming.slot[camera, marker]], marker)
    assert (naming.owner >= 0).sum() == len(camera)
    assert ((naming.step > 0) == (naming.slot >= 0)).all()
    return naming


def test_a_marker_without_blob_nearby_is_not_associated():
    """A15: beyond the neighbourhood (four deviations, at most 0.12 m) nothing is taken."""
    away = MARKERS.copy()
    away[0] += [0, 0, 0.13]
    frame = frame_of(pixels_of(away), expect_at(MARKERS, 0.5))
    naming = Naming.empty(frame)
    labelling.identify_visible(frame, naming)
    assert (naming.slot[:, 0] == -1).all() and (naming.slot[:, 1:] >= 0).all()
    near = frame_of(pixels_of(away), expect_at(MARKERS, 0.5), replace(RULES, max_distance_m=0.2))
    assert (near.nll[:, 0, 0] < labelling.TOO_FAR).all()


@pytest.mark.parametrize("seed", range(6))
def test_every_visible_marker_is_exclusive_or_in_conflict_or_not_associated(seed):
    """A15: in each camera the three counts sum to the visible markers, and hidden markers claim nothing."""
    generator = np.random.default_rng(seed)
    points = generator.uniform([-0.4, -0.4, 0.6], [0.4, 0.4, 1.4], (12, 3))
    visible = generator.random((4, 12)) < 0.8
    pixels = [
        np.vstack([row[generator.random(12) < 0.8], generator.uniform(100, 500, (6, 2))]) for row in pixels_of(points)
    ]
    frame = frame_of(pixels, expect_at(points + generator.normal(0, 0.02, points.shape), 0.03, visible))
    naming = Naming.empty(frame)
    claims = labelling.identify_visible(frame, naming)
    exclusive, conflicting = naming.step == EXCLUSIVE, claims.any(axis=2)
    misfit = np.where(visible[..., None], frame.nll, labelling.TOO_FAR)
    free = ~exclusive & ~conflicting
    assert not ((exclusive & conflicting) | (exclusive & ~visible) | (conflicting & ~visible)).any()
    assert ((exclusive.sum(1) + conflicting.sum(1) + (free & visible).sum(1)) == visible.sum(1)).all()
    # A visible marker is without association only where every blob in reach is another's or clearly nearer to another.
    best = misfit.min(axis=1)
    for camera, marker in np.argwhere(free & visible):
        slots = np.flatnonzero(misfit[camera, marker] < labelling.TOO_FAR)
        assert all(naming.owner[camera, k] >= 0 or misfit[camera, marker, k] > best[camera, k] for k in slots)


def conflict(helpers, offset, generator):
    """One marker with an exclusive blob in `helpers` cameras; in camera 0 the right blob (slot 0) and a false one.

    The model is `offset` m off the marker, so that the false blob is the nearer to the model's projection.
    """
    point = generator.uniform([-0.2, -0.2, 0.7], [0.2, 0.2, 1.3], (1, 3))
    expected = expect_at(point + offset, 0.03)
    pixels = [row if index <= helpers else np.zeros((0, 2)) for index, row in enumerate(pixels_of(point))]
    pixels[0] = np.vstack([pixels[0], RIG.project(point + offset)[0]])
    return pixels, expected, point


@pytest.mark.parametrize("seed", range(10))
def test_conflict_case_one_is_decided_by_the_reprojected_point(seed):
    """A16: two or more exclusive cameras triangulate; the blob nearest to the reprojection wins, not to the model."""
    generator = np.random.default_rng(seed)
    pixels, expected, _ = conflict(2 + seed % 2, generator.uniform([-0.02, -0.02, 0.01], [0.02, 0.02, 0.05]), generator)
    naming = consistent(label(pixels, expected))
    assert naming.slot[0, 0] == 0 and naming.step[0, 0] == CONFLICT
    assert naming.owner[0].tolist() == [0, -1]
    assert naming.conflicts[0] == 2


def test_conflict_case_two_is_decided_by_the_point_nearest_to_the_model():
    """A17: one exclusive camera: every candidate makes a point with it; the point nearest to the model's marker wins.

    The false blob lies exactly on the model's projection, but the point that it makes with the helper is 5 cm nearer to
    the camera than the model's marker; the right blob is 23 mm beside the projection and makes the nearer point.
    """
    point = np.array([0.0, 0.0, 1.0])
    line = (point - RIG.centres[[0, 2]]) / np.linalg.norm(point - RIG.centres[[0, 2]], axis=1)[:, None]
    false = point - 0.05 * line[0]
    helper = (false - RIG.centres[2]) / np.linalg.norm(false - RIG.centres[2])
    right = false + helper * (helper @ (point - false))
    pixels = [np.zeros((0, 2))] * 4
    pixels[0] = np.vstack([RIG.project(right)[0], RIG.project(false)[0]])
    pixels[2] = RIG.project(right)[2:3]
    frame = frame_of(pixels, expect_at(point[None], 0.03))
    assert frame.nll[0, 0, 1] < frame.nll[0, 0, 0]  # the model's projection alone would be wrong
    naming = consistent(label(pixels, frame.expected))
    assert naming.slot[:, 0].tolist() == [0, -1, 0, -1]
    assert naming.step[[0, 2], 0].tolist() == [CONFLICT, EXCLUSIVE]


def test_conflict_case_three_is_decided_by_the_nearest_blob():
    """A18: no other camera knows the marker: the blob nearest to the model's projection, where that is clear."""
    point = np.array([[0.0, 0.0, 1.0]])
    pixels = [pixels_of(point)[0] + np.array([[0, 0], [0, 11]]), *[np.zeros((0, 2))] * 3]
    naming = consistent(label(pixels, expect_at(point, 0.02)))
    assert naming.slot[:, 0].tolist() == [0, -1, -1, -1] and naming.step[0, 0] == CONFLICT
    assert naming.owner[0].tolist() == [0, -1]


def test_conflict_case_three_names_nothing_when_two_blobs_are_as_near():
    """A18, A28: conservative: where nearest means nothing, no name."""
    point = np.array([[0.0, 0.0, 1.0]])
    pixels = [pixels_of(point)[0] + np.array([[0, 5], [0, -5.2]]), *[np.zeros((0, 2))] * 3]
    assert (consistent(label(pixels, expect_at(point, 0.02))).slot == -1).all()


@pytest.mark.parametrize("distance", [0.03, 0.05])
def test_two_close_markers_are_told_apart_by_the_cameras_that_see_them_apart(distance):
    """A16: where they overlap from one camera, the others' triangulation says which is which; all names right."""
    eye = RIG.centres[0]
    first = np.array([0.05, 0.1, 1.1])
    aside = np.cross(eye - first, [0, 0, 1.0])
    second = first + distance * aside / np.linalg.norm(aside)
    points = np.array([first, second])
    naming = consistent(label(pixels_of(points), expect_at(points + OFF, 0.015)))
    right = (naming.slot == [0, 1]) | (naming.slot == -1)
    assert right.all() and (naming.slot >= 0).sum() >= 6


def test_a_wrong_capsule_does_not_lose_a_marker():
    """A19: the body wrongly hides a marker everywhere; the third step looks without the occlusion test."""
    visible = np.ones((4, 4))
    visible[:, 3] = 0
    naming = consistent(label(pixels_of(MARKERS), expect_at(MARKERS + 0.004, visible=visible)))
    assert np.array_equal(naming.slot, np.tile(np.arange(4), (4, 1)))
    assert (naming.step[:, 3] == REMAINING).all() and (naming.step[:, :3] == EXCLUSIVE).all()


def test_of_several_blobs_for_one_remaining_marker_the_nearest_wins_and_the_rest_are_false():
    """A19: several pre-assigned blobs: minimum distance."""
    visible = np.ones((4, 4))
    visible[1, 3] = 0
    pixels = pixels_of(MARKERS)
    pixels[1] = np.vstack([pixels[1][:3], pixels[1][3] + [5, 2], pixels[1][3] + [0.3, 0]])
    naming = consistent(label(pixels, expect_at(MARKERS, visible=visible)))
    assert naming.slot[1, 3] == 4 and naming.step[1, 3] == REMAINING
    assert naming.owner[1, 3] == -1


@pytest.mark.parametrize("seed", range(5))
def test_ghosts_end_unnamed(seed):
    """A19: blobs that are nobody's are false markers, in every camera."""
    generator = np.random.default_rng(seed)
    pixels = [np.vstack([row, generator.uniform([0, 0], RIG.size[0], (8, 2))]) for row in pixels_of(MARKERS)]
    naming = consistent(label(pixels, expect_at(MARKERS + generator.normal(0, 0.01, MARKERS.shape), 0.02)))
    assert (naming.owner[:, 4:] == -1).all()
    assert np.mean(naming.slot == np.arange(4)) >= 0.9


def test_algorithm_1_by_hand():
    """A20: a hand trace of the algorithm over three cameras and three markers.

    Marker 0 is seen everywhere, with a false blob beside it in camera 0: exclusive in 1 and 2, so case 1 in 0.
    Marker 1 is seen by cameras 0 and 1, with a false blob in 1: exclusive in 0, case 2 in 1.
    Marker 2 is seen by camera 2 alone, and the body wrongly hides it there: step 3.
    Each camera has one ghost far from everything.
    """
    rig = ring_rig(3)
    points = np.array([[0.0, 0.0, 1.0], [0.3, 0.1, 1.3], [-0.2, 0.3, 0.6]])
    own = pixels_of(points, rig)
    far = np.array([[30.0, 30.0]])
    up = rig.project(points + np.array([0, 0, 0.045]))
    pixels = [
        np.vstack([own[0][0], up[0][0], own[0][1], far]),
        np.vstack([own[1][0], own[1][1], up[1][1], far]),
        np.vstack([own[2][0], own[2][2], far]),
    ]
    visible = np.ones((3, 3))
    visible[2, 2] = 0
    frame = frame_of(pixels, expect_at(points, 0.02, visible, cameras=3), rig=rig)
    naming = Naming.empty(frame)

    claims = labelling.identify_visible(frame, naming)
    assert naming.slot.tolist() == [[-1, 2, -1], [0, -1, -1], [0, -1, -1]]
    assert np.argwhere(claims).tolist() == [[0, 0, 0], [0, 0, 1], [1, 1, 1], [1, 1, 2]]
    labelling.withdraw_unmet(frame, naming)
    labelling.resolve_conflicts(frame, naming, claims)
    assert naming.slot.tolist() == [[0, 2, -1], [0, 1, -1], [0, -1, -1]]
    labelling.name_remaining(frame, naming)
    assert naming.slot.tolist() == [[0, 2, -1], [0, 1, -1], [0, -1, 1]]
    assert naming.step.tolist() == [
        [CONFLICT, EXCLUSIVE, NO_STEP],
        [EXCLUSIVE, CONFLICT, NO_STEP],
        [EXCLUSIVE, NO_STEP, REMAINING],
    ]
    assert naming.owner.tolist() == [[0, -1, 1, -1], [0, 1, -1, -1], [0, 2, -1, -1]]
    assert naming.conflicts.tolist() == [2, 2, 0]
    whole = consistent(label(pixels, frame.expected, rig=rig))
    assert np.array_equal(whole.slot, naming.slot) and np.array_equal(whole.step, naming.step)


def test_nothing_seen_nothing_named():
    naming = consistent(label([np.zeros((0, 2))] * 4, expect_at(MARKERS)))
    assert (naming.slot == -1).all() and (naming.owner == -1).all() and np.isnan(naming.meeting.points).all()
    assert np.isnan(labelling.pixel_noise(naming, SIGHT))


def test_of_two_markers_on_one_line_the_nearer_has_the_blob():
    """Whatever hides the nearer marker hides the farther too: one blob for both is the nearer one's."""
    eye, near = RIG.centres[0], np.array([0.1, 0.05, 1.2])
    ahead = (near - eye) / np.linalg.norm(near - eye)
    points = np.array([near + 0.12 * ahead, near])  # the first stands behind the second
    own = pixels_of(points)
    pixels = [own[0][1:], own[1], own[2], own[3]]
    naming = consistent(label(pixels, expect_at(points + OFF / 2, 0.015)))
    assert naming.owner[0, 0] in (1, -1)
    assert naming.slot[0, 0] == -1
    assert (naming.slot[1:] == [0, 1]).mean() > 0.8 and not (naming.slot[1:] == [1, 0]).any()


def test_two_cameras_that_disagree_lose_both_names():
    pixels = [row[:1] if index < 2 else np.zeros((0, 2)) for index, row in enumerate(pixels_of(MARKERS))]
    pixels[0] = pixels[0] + [0, 12]
    expected = expect_at(MARKERS[:1], 0.05)
    frame = frame_of(pixels, expected)
    naming = Naming.empty(frame)
    labelling.identify_visible(frame, naming)
    assert (naming.slot[:2, 0] == 0).all()
    labelling.withdraw_unmet(frame, naming)
    assert (naming.slot == -1).all() and (naming.owner == -1).all()


def test_labels_do_not_depend_on_the_order_of_blobs():
    generator = np.random.default_rng(11)
    points = generator.uniform([-0.4, -0.4, 0.6], [0.4, 0.4, 1.4], (10, 3))
    expected = expect_at(points + generator.normal(0, 0.01, points.shape), 0.02)
    pixels = pixels_of(points)
    plain = label(pixels, expected)
    orders = [generator.permutation(10) for _ in range(4)]
    mixed = label([row[order] for row, order in zip(pixels, orders, strict=True)], expected)
    for camera, order in enumerate(orders):
        back = np.where(mixed.slot[camera] >= 0, order[mixed.slot[camera]], -1)
        assert np.array_equal(back, plain.slot[camera])


@pytest.mark.parametrize(("first", "found"), [(5, [False, True]), (1, [True, False]), (4, [False, False])])
def test_a_single_ray_on_another_markers_point_is_a_double(first, found):
    """One marker between two that are expected, the one of which `first` cameras see, the other the rest of six."""
    rig, real, seen = ring_rig(6), np.array([0.05, 0.1, 1.1]), np.arange(6) < first
    expected = expect_at(real + np.array([[0.03, 0, 0], [-0.03, 0, 0]]), 0.03, np.stack([seen, ~seen], axis=1), 6)
    naming = consistent(label(pixels_of([real], rig), expected, rig=rig))
    assert (naming.slot >= 0).sum(axis=0).tolist() == [first, 6 - first]
    assert np.array_equal(labelling.doubles(naming), (naming.slot >= 0) & found)
