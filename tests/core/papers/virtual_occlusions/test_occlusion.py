# SPDX-License-Identifier: GPL-3.0-or-later
"""The body in the way: analytic scenes, a ray marcher that must agree, and a marker's own skin."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.data.takes import Motion
from addon.core.papers.virtual_occlusions.occlusion import OCCLUDING, CapsuleOcclusion, capsules_hide, hidden_by_any
from tests.core.scenes import motion_of
from tests.core.toybody import toy_markerset

STANDOFF = 0.008


def hide(capsules, markers, eyes, standoff=STANDOFF):
    """(C, M) of one body whose capsules are rows (start, end, radius)."""
    start = np.array([row[0] for row in capsules], dtype=float)
    axis = np.array([row[1] for row in capsules], dtype=float) - start
    radius = np.array([row[2] for row in capsules], dtype=float)
    markers, eyes = np.array(markers, dtype=float), np.array(eyes, dtype=float)
    body = start[None], axis[None], radius[None], markers[None]
    return capsules_hide(*body, eyes, np.array([standoff]), OCCLUDING.min_side_share)[0]


def marched(capsules, marker, eye, standoff=STANDOFF, steps=4001):
    """How near sampled points of the ray come to each capsule's surface; NaN where the marker's side is unclear."""
    margins = []
    for start, end, radius in capsules:
        start, end, point = np.array(start, float), np.array(end, float), np.array(marker, float)
        axis = end - start
        foot = start + axis * np.clip((point - start) @ axis / max(axis @ axis, 1e-12), 0, 1)
        distance = np.linalg.norm(point - foot)
        if distance <= OCCLUDING.min_side_share * radius:
            margins.append(np.nan)
            continue
        if distance < radius + standoff:
            point = foot + (point - foot) / distance * (radius + standoff)
        ray = point + np.linspace(0, 1, steps)[:, None] * (np.array(eye, float) - point)
        along = np.clip((ray - start) @ axis / max(axis @ axis, 1e-12), 0, 1)
        margins.append(np.linalg.norm(ray - start - along[:, None] * axis, axis=1).min() - radius)
    return np.array(margins)


UPRIGHT = [((0, 0, 0), (0, 0, 1), 0.1)]


@pytest.mark.parametrize(
    ("marker", "eye", "expected"),
    [
        ((1, 0, 0.5), (-1, 0, 0.5), True),  # straight through the middle
        ((1, 0, 0.5), (3, 0, 0.5), False),  # the capsule is behind the marker
        ((1, 0, 0.5), (0.3, 0, 0.5), False),  # the camera is in front of the capsule
        ((1, 0.099, 0.5), (-1, 0.099, 0.5), True),  # just inside the radius
        ((1, 0.101, 0.5), (-1, 0.101, 0.5), False),  # just outside it
        ((1, 0, 1.099), (-1, 0, 1.099), True),  # through the round end
        ((1, 0, 1.101), (-1, 0, 1.101), False),  # over it
        ((0, 0, -1), (0, 0, 3), True),  # along the axis
        ((0.2, 0, -1), (0.2, 0, 3), False),  # beside it, parallel
        ((np.nan, 0, 0), (0, 0, 3), False),  # a gap is not hidden
    ],
)
def test_one_upright_capsule(marker, eye, expected):
    assert hide(UPRIGHT, [marker], [eye])[0, 0] == expected


def test_a_sphere_is_a_capsule_without_length():
    ball = [((0, 0, 0), (0, 0, 0), 0.5)]
    assert hide(ball, [(2, 0, 0)], [(-2, 0, 0)])[0, 0]
    assert not hide(ball, [(2, 1.1, 0)], [(-2, 1.1, 0)])[0, 0]


@pytest.mark.parametrize("depth", [-0.004, 0.0, 0.01, 0.03])
def test_a_marker_is_seen_from_the_side_it_sits_on_and_hidden_from_the_other(depth):
    marker = (0.1 - depth, 0, 0.5)
    eyes = [(3, 0, 0.5), (3, 2, 1.5), (0.1, 3, 0.5), (-3, 0, 0.5), (-3, 1, 1.5), (-2, 3, 0.5)]
    assert hide(UPRIGHT, [marker], eyes)[:, 0].tolist() == [False, False, False, True, True, True]


def test_a_marker_next_to_the_axis_or_at_a_joint_is_not_hidden_because_its_side_is_not_known():
    assert not hide(UPRIGHT, [(0.01, 0, 0.5)], [(-3, 0, 0.5)])[0, 0]
    assert not hide(UPRIGHT, [(0, 0, 0.5)], [(-3, 0, 0.5)])[0, 0]
    knee = [((0, 0, 1), (0, 0, 0.5), 0.07), ((0, 0, 0.5), (-0.2, 0, 0.1), 0.05)]
    marker, outside, inside = (0, 0.065, 0.5), (0.3, 3, 1.5), (0.3, -3, 1.5)
    assert hide(knee, [marker], [outside, inside])[:, 0].tolist() == [False, True]


def test_random_bodies_agree_with_the_marched_ray_without_exception():
    markerset = toy_markerset()
    model, generator = BodyModel(markerset), np.random.default_rng(3)
    bodies = model.rest(6, 1.7)
    bodies.bends[:, 1:] = generator.normal(0, 0.4, bodies.bends[:, 1:].shape)
    posed = model.pose(bodies)
    eyes = np.array([[3, 2, 2.2], [-3, 1, 0.4], [0.5, -4, 1.5]])
    found = CapsuleOcclusion(markerset).hidden(posed.rotations, posed.joints, bodies.scale, posed.markers, eyes)
    own, sure = markerset.capsules, 0
    for body in range(6):
        turn, joints = posed.rotations[body, own.segment], posed.joints[body, own.segment]
        start = joints + np.einsum("kij,kj->ki", turn, own.start * 1.7)
        end = joints + np.einsum("kij,kj->ki", turn, own.end * 1.7)
        rows = list(zip(start, end, own.radius * 1.7, strict=True))
        for camera, eye in enumerate(eyes):
            for index, marker in enumerate(posed.markers[body]):
                margins = marched(rows, marker, eye, 0.005 * 1.7, 1501)
                if np.nanmin(np.abs(margins)) > 3e-3:
                    sure += 1
                    assert found[body, camera, index] == bool((margins < 0).any())
    assert sure > 200


def standing(height=1.7, yaw=0.0):
    markerset = toy_markerset()
    model = BodyModel(markerset)
    bodies = model.rest(1, height)
    bodies.quaternion[:] = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
    return markerset, bodies, model.pose(bodies)


@pytest.mark.parametrize("yaw", [0.0, 1.0, 2.5, 4.0])
@pytest.mark.parametrize("height", [1.1, 1.7, 2.0])
def test_the_front_image_discards_the_back_markers_and_the_back_image_the_front_ones(height, yaw):
    markerset, bodies, posed = standing(height, yaw)
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0])
    eyes = np.array([4 * ahead + [0, 0, 1.2], -4 * ahead + [0, 0, 1.2]])
    front, back = CapsuleOcclusion(markerset).hidden(posed.rotations, posed.joints, bodies.scale, posed.markers, eyes)[
        0
    ]
    for name in ("FRONT", "LASI", "RASI", "LFHD"):
        assert (front[markerset.index(name)], back[markerset.index(name)]) == (False, True), name
    for name in ("BACK", "SACR", "RBHD"):
        assert (front[markerset.index(name)], back[markerset.index(name)]) == (True, False), name


def test_a_shrunk_body_hides_a_part_of_what_the_whole_body_hides():
    markerset, bodies, posed = standing()
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    eyes = np.stack([3 * np.cos(angle), 3 * np.sin(angle), np.full(24, 1.5)], axis=1)
    whole, thin = (
        CapsuleOcclusion(markerset, shrink).hidden(posed.rotations, posed.joints, bodies.scale, posed.markers, eyes)[0]
        for shrink in (1.0, 0.5)
    )
    assert thin.sum() < whole.sum()
    assert (thin & ~whole).mean() < 0.01


def waiting(model: BodyModel, places: list[float]) -> Motion:
    """The body at rest at some places along x, frame after frame, m; NaN where it was not found."""
    posed, shift = model.pose(model.rest(1, 1.0)), np.array(places)[:, None, None] * [1.0, 0.0, 0.0]
    markers, turns = posed.markers + shift, np.repeat(posed.rotations, len(places), axis=0)
    return replace(motion_of(markers, markers), joints=posed.joints + shift, rotations=turns)


def test_whoever_stands_between_hides_the_markers_of_others():
    markerset = toy_markerset()
    model, bodies = BodyModel(markerset), (CapsuleOcclusion(markerset),) * 2
    front, behind = waiting(model, [1.0, 1.0, np.nan]), waiting(model, [0.0, 6.0, 0.0])
    centres = np.array([[30.0, 0.0, float(behind.joints[0, :, 2].mean())]])
    each, size = [front, behind], len(markerset)
    markers = np.concatenate([one.markers for one in each], axis=1)
    found = hidden_by_any(bodies, each, markers, centres)
    alone = np.concatenate([hidden_by_any(bodies[:1], [one], one.markers, centres) for one in each], axis=2)
    assert found.shape == (3, 1, 2 * size)
    assert (found >= alone).all()
    assert (found & ~alone)[0, 0, size:].any()
    assert not (found & ~alone)[0, 0, :size].any(), "nobody is in front of the one in front"
    assert (found & ~alone)[1, 0, :size].any(), "now the other is in front"
    assert (found == alone)[2].all(), "a body that was not found hides nothing"
