# SPDX-License-Identifier: GPL-3.0-or-later
"""Virtual captures, which go wrong as often as asked for; and virtual people, who stand, walk and swing their arms."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.geometry.cameras import Cameras
from addon.core.papers.virtual_occlusions.occlusion import CapsuleOcclusion
from addon.core.simulation.rigs import paper_rig, ring_rig
from addon.core.simulation.simulate import CaptureOptions, PosedBody, capture
from addon.core.simulation.virtual import DEMO, Act, draw_person, perform
from tests.core.scenes import joined
from tests.core.toybody import toy_markerset

PERFECT = CaptureOptions(noise=0, dropout=0, reflections=0, flicker=0, merge_gap=-100)


def still(frames=20, height=1.7):
    markerset = toy_markerset()
    model = BodyModel(markerset)
    bodies = model.rest(frames, height)
    posed = model.pose(bodies)
    body = PosedBody(CapsuleOcclusion(markerset), markerset.attachment, posed.rotations, posed.joints, bodies.scale)
    return markerset, posed.markers, body


def one_camera(width=200, height=100, focal=100.0, lens=(0, 0, 0, 0, 0)):
    matrix = np.array([[[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]])
    return Cameras(("c",), np.array([[width, height]]), matrix, np.array([lens]), np.eye(3)[None], np.zeros((1, 3)))


def test_the_body_hides_what_its_occlusion_says_and_nothing_else():
    markerset, markers, body = still(2)
    cameras = paper_rig()
    seen = joined(capture(markers, markerset.markers, cameras, PERFECT, body))
    hidden = body.hidden(slice(0, 2), markers, cameras.centres)
    found = np.zeros_like(hidden)
    found[seen.blobs.frame, seen.blobs.camera, [markerset.index(name) for name in seen.truth]] = True
    assert np.array_equal(found, ~hidden)
    assert 0.1 < hidden.mean() < 0.5


def test_noise_and_dropouts_are_as_asked_for_and_reflections_stay_where_they_are():
    cameras = paper_rig()
    markerset, markers, _ = still(300)
    seen = joined(capture(markers, markerset.markers, cameras, replace(PERFECT, noise=0.7, dropout=0.1)))
    expected = cameras.project(markers[0])[seen.blobs.camera, [markerset.index(name) for name in seen.truth]]
    assert (seen.blobs.xy - expected).std() == pytest.approx(0.7, rel=0.03)
    assert len(seen.blobs) / (300 * 4 * len(markerset)) == pytest.approx(0.9, abs=0.01)
    nobody = np.full((400, 1, 3), np.nan)
    options = replace(PERFECT, reflections=2, reflection_on=0.5)
    fixed = joined(capture(nobody, ("A",), paper_rig(), options)).blobs
    assert len(np.unique(fixed.xy.round(6), axis=0)) == 2 * 4
    assert len(fixed) / (400 * 4 * 2) == pytest.approx(0.5, abs=0.05)
    sudden = joined(capture(nobody, ("A",), paper_rig(), replace(PERFECT, flicker=0.5)))
    assert len(sudden.blobs) / (400 * 4) == pytest.approx(0.5, abs=0.07)
    assert len(np.unique(sudden.blobs.xy.round(6), axis=0)) == len(sudden.blobs)
    assert set(sudden.truth) == {""}


def test_images_that_overlap_or_touch_in_a_chain_are_one_blob_but_never_of_two_frames_or_cameras():
    markers = np.array([[[0.0, 0, 2], [0.015, 0, 2], [0.5, 0, 2]]])
    options = replace(PERFECT, merge_gap=0.0, marker_radius=0.02)
    seen = joined(capture(markers, ("A", "B", "C"), one_camera(focal=400.0, width=400), options))
    assert sorted(seen.truth) == ["A|B", "C"]
    at = seen.blobs.xy[seen.truth.tolist().index("A|B")]
    assert at == pytest.approx([200 + 400 * 0.0075 / 2, 50], abs=0.2)
    assert seen.blobs.area[seen.truth.tolist().index("A|B")] == pytest.approx(2 * np.pi * 16, rel=0.2)
    chain = np.array([[[0.03 * index, 0, 2] for index in range(5)]])
    seen = joined(capture(chain, tuple("EDCBA"), one_camera(focal=400.0), replace(options, marker_radius=0.018)))
    assert seen.truth.tolist() == ["E|D|C|B|A"]
    _, markers, _ = still(5)
    seen = joined(capture(np.repeat(markers[:, :1], 1, axis=1), ("A",), paper_rig(), replace(PERFECT, merge_gap=1.0)))
    assert seen.truth.tolist() == ["A"] * 20


@pytest.mark.parametrize(
    ("point", "seen"),
    [((0, 0, 2), True), ((0, 0, -2), False), ((1.9, 0, 2), True), ((2.1, 0, 2), False), ((0, -1.1, 2), False)],
)
def test_only_what_is_ahead_and_within_the_image_is_seen(point, seen):
    found = joined(capture(np.array([[point]], dtype=float), ("A",), one_camera(), replace(PERFECT, min_area=0)))
    assert (len(found.blobs) == 1) == seen


def test_nothing_is_seen_from_outside_the_reach_of_a_lens_and_the_farthest_are_too_small():
    cameras = one_camera(lens=(-0.3, 0, 0, 0, 0))
    # 2.2 - 0.3 * 2.2³ lies well within the image, yet no light takes that way.
    point = np.array([[[2.2, 0.0, 1.0]]])
    assert abs(cameras.project(point)[0, 0, 0, 0] - 100) < 100
    assert len(joined(capture(point, ("A",), cameras, replace(PERFECT, min_area=0))).blobs) == 0
    near, far = (
        joined(capture(np.array([[[0.0, 0, z]]] * 50), ("A",), one_camera(), replace(PERFECT, min_area=0))).blobs.area
        for z in (1.0, 2.0)
    )
    assert near.mean() / far.mean() == pytest.approx(4, rel=0.05)
    assert near.mean() == pytest.approx(np.pi * 0.7**2, rel=0.05)
    assert len(joined(capture(np.array([[[0.0, 0, 3]]]), ("A",), one_camera(), PERFECT)).blobs) == 0


def test_a_marker_worn_wrongly_stays_wrong_by_the_same_amount_and_turns_with_its_segment():
    markerset, markers, body = still(2)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turned = replace(
        body,
        rotations=np.stack([body.rotations[0], turn @ body.rotations[0]]),
        joints=np.stack([body.joints[0], body.joints[0] @ turn.T]),
    )
    moved = np.stack([markers[0], markers[0] @ turn.T])
    offset = turned.carry(slice(0, 2), np.tile([0.03, 0, 0], (len(markerset), 1)))
    assert offset[0] == pytest.approx(np.tile([0.03, 0, 0], (len(markerset), 1)))
    assert offset[1] == pytest.approx(np.tile([0, 0.03, 0], (len(markerset), 1)))
    cameras = paper_rig()
    seen = joined(capture(moved, markerset.markers, cameras, replace(PERFECT, marker_offset=0.04), turned))
    index = [markerset.index(name) for name in seen.truth]
    off = np.linalg.norm(seen.blobs.xy - cameras.project(moved)[seen.blobs.camera, seen.blobs.frame, index], axis=1)
    assert 1 < off.max() < 0.04 * 1.3 * 695 / 1.5


def test_gaps_and_frames_without_a_pose_do_no_harm():
    markerset, markers, body = still(4)
    markers = markers.copy()
    markers[1] = np.nan
    markers[2, 0] = np.nan
    lost = replace(body, joints=np.where(np.arange(4)[:, None, None] == 1, np.nan, body.joints))
    seen = joined(capture(markers, markerset.markers, paper_rig(), PERFECT, lost))
    assert not (seen.blobs.frame == 1).any()
    assert markerset.markers[0] not in seen.truth[seen.blobs.frame == 2]
    assert np.isfinite(seen.blobs.xy).all()


@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_the_papers_rig_sees_a_tall_person_whole_from_four_corners(seed):
    cameras = paper_rig(None if seed is None else np.random.default_rng(seed))
    assert len(cameras) == 4
    assert (cameras.size == (656, 491)).all()
    assert ((cameras.centres[:, 2] > 2.15) & (cameras.centres[:, 2] < 2.65)).all()
    angle, top = np.meshgrid(np.linspace(0, 2 * np.pi, 24), [0, 2.0])
    pixels = cameras.project(np.stack([0.55 * np.cos(angle), 0.55 * np.sin(angle), top], axis=-1).reshape(-1, 3))
    assert ((pixels > 0) & (pixels < cameras.size[:, None] - 1)).all()
    # The lens is no wider than it must be: the person's volume takes most of the image's height.
    assert (np.ptp(pixels[..., 1], axis=1) > 0.8 * 491).all()


def test_what_cannot_be_seen_is_refused():
    with pytest.raises(ValueError, match="expected"):
        next(capture(np.zeros((3, 2, 3)), ("A",), paper_rig()))
    with pytest.raises(ValueError, match="outside"):
        ring_rig(4, radius=0.5)


MARKERSET = toy_markerset()
MODEL = BodyModel(MARKERSET)
RATE = 60.0


def person(seed=0):
    return draw_person(MARKERSET, np.random.default_rng(seed))


def soles(bodies):
    """(T, 4, 3) heel and toe of the left foot, then of the right, on the underside of their capsules."""
    capsules, posed = MARKERSET.capsules, MODEL.pose(bodies)
    points = []
    for side in "LR":
        foot = MARKERSET.skeleton.segments.index(f"foot.{side}")
        for end in (capsules.start[foot], capsules.end[foot]):
            at = posed.joints[:, foot] + posed.rotations[:, foot] @ (end * bodies.scale[0])
            points.append(at - [0, 0, capsules.radius[foot] * bodies.scale[0].mean()])
    return np.stack(points, axis=1)


def marker(bodies, name):
    return MODEL.pose(bodies).markers[:, MARKERSET.index(name)]


@pytest.fixture(scope="module")
def walk():
    return perform(MODEL, person(), [Act(1), Act(4, stride=1.0), Act(1)], RATE, facing=0.5)


def test_people_differ_as_much_as_the_marker_set_says_and_those_of_one_seed_not_at_all():
    people = [person(seed) for seed in range(300)]
    heights = np.array([one.scale.mean() for one in people])
    assert heights.mean() == pytest.approx(MARKERSET.spread.height, abs=0.02)
    assert heights.std() == pytest.approx(MARKERSET.spread.height_sd, rel=0.2)
    assert np.std([one.shape[0, 0] for one in people]) == pytest.approx(0.9, abs=0.15)
    off = np.array([np.linalg.norm(one.own[0], axis=1) for one in people])
    assert np.sqrt((off**2).mean(axis=0)) == pytest.approx(MARKERSET.spread.marker_sd, rel=0.15)
    assert np.array_equal(person(3).own, person(3).own)
    one, two = (perform(MODEL, person(), DEMO, RATE, seed=4) for _ in range(2))
    assert np.array_equal(one.bends, two.bends)
    assert not np.array_equal(one.bends, perform(MODEL, person(), DEMO, RATE, seed=5).bends)


def test_someone_always_stands_on_the_floor_does_not_slide_and_walks_the_way_they_face(walk):
    points = soles(walk)
    lowest = points[..., 2].min(axis=1)
    assert -0.015 < lowest.min() < lowest.max() < 0.02
    speed = np.linalg.norm(np.diff(points[..., :2], axis=0), axis=-1) * RATE
    # In every frame some part of a sole is as good as still, while the body goes at a walking pace.
    assert np.percentile(speed.min(axis=1), 90) < 0.2
    way = walk.translation[-1, :2] - walk.translation[0, :2]
    assert 0.7 < np.linalg.norm(way) / 4 < 1.6
    assert np.arctan2(way[1], way[0]) == pytest.approx(0.5, abs=0.15)
    assert np.abs(walk.translation[0, :2] + walk.translation[-1, :2]).max() < 0.3


def test_a_marker_set_without_legs_is_told_so():
    names = tuple(name.replace("L", "X") for name in MARKERSET.skeleton.segments)
    legless = replace(MARKERSET, skeleton=replace(MARKERSET.skeleton, segments=names))
    with pytest.raises(ValueError, match=r"foot\.L"):
        perform(BodyModel(legless), draw_person(legless, np.random.default_rng(0)), DEMO, RATE)
