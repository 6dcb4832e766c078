# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs that go on in one image: what they are called before and after says what they are in between."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.blobs.image_tracklets import name_by_tracklets, tracklets_of
from addon.core.geometry.views import View
from addon.core.papers.virtual_occlusions.labelling import Frame, Naming
from tests.core.blobs.followed import RIG, exchange, followed, take_name, wrong_names
from tests.core.scenes import RATE

FRAMES = range(30, 38)


def slots(results):
    return [result.naming.slot.copy() for result in results]


def seen_by(results, marker: int) -> int:
    """A camera that names the marker in all of FRAMES and a dozen around them, as others do."""
    named = np.array([(result.naming.rays >= 0)[:, marker] for result in results])[20:50]
    assert named.sum(axis=1).min() >= 3
    return int(np.flatnonzero(named.all(axis=0))[0])


def test_a_name_that_one_camera_lost_for_some_frames_comes_back():
    scene, _, views, results = followed()
    marker = scene.markerset.index("LKNE")
    camera, before = seen_by(results, marker), slots(results)
    for frame in FRAMES:
        results[frame].naming.withdraw(np.array([camera]), np.array([marker]))
    changed = name_by_tracklets(views, results, RATE)
    assert all(marker in changed[frame] for frame in FRAMES)
    assert all(results[frame].naming.slot[camera, marker] == before[frame][camera, marker] for frame in FRAMES)
    assert not wrong_names(scene, views, results)[FRAMES.start : FRAMES.stop].any()


def test_a_marker_that_lost_all_its_names_gets_them_back_where_they_meet():
    scene, _, views, results = followed()
    marker = scene.markerset.index("LKNE")
    for frame in FRAMES:
        take_name(results[frame].naming, marker)
    name_by_tracklets(views, results, RATE)
    assert all((results[frame].naming.rays[:, marker] >= 0).sum() >= 2 for frame in FRAMES)
    assert not wrong_names(scene, views, results)[FRAMES.start : FRAMES.stop].any()


def test_most_of_an_exchange_is_undone():
    scene, _, views, results = followed()
    exchange(scene, results, FRAMES, "LANK", "LHEE")
    before = wrong_names(scene, views, results)[FRAMES.start : FRAMES.stop].sum()
    name_by_tracklets(views, results, RATE)
    assert wrong_names(scene, views, results)[FRAMES.start : FRAMES.stop].sum() < before / 2


def test_names_that_suit_stay():
    scene, _, views, results = followed()
    before, wrong = slots(results), wrong_names(scene, views, results).sum()
    name_by_tracklets(views, results, RATE)
    lost = [((old >= 0) & (now != old)).sum() for old, now in zip(before, slots(results), strict=True)]
    assert sum(lost) == 0
    assert wrong_names(scene, views, results).sum() <= wrong


def shifted(result, view, camera: int, marker: int, way: float):
    """The frame with one of its blobs drawn aside by `way` m, and without its name; the view and the result."""
    old = result.naming
    image = view.image.copy()
    image[camera, old.slot[camera, marker], 0] += way / old.frame.depth[camera, marker]
    view = replace(view, image=image)
    rules = replace(old.frame.rules, pixel=0.1)  # of cameras that would notice
    frame = Frame(view, old.frame.sight, old.frame.expected, rules, old.frame.fixed)
    naming = Naming(frame, old.slot, old.step, old.owner, old.partner, old.conflicts)
    naming.withdraw(np.array([camera]), np.array([marker]))
    return view, replace(result, naming=naming)


@pytest.mark.parametrize(("way", "named"), [(0.007, True), (0.03, False)])
def test_a_marker_that_is_partly_hidden_is_named_but_not_met(way, named):
    scene, _, views, results = followed()
    marker = scene.markerset.index("LKNE")
    camera, before, views = seen_by(results, marker), slots(results), list(views)
    points = np.array([result.naming.meeting.points[marker] for result in results])
    for frame in FRAMES:  # it goes aside little by little, as a blob does whose marker goes behind something
        part = way * np.sin(np.pi * (frame - FRAMES.start + 1) / (len(FRAMES) + 1))
        views[frame], results[frame] = shifted(results[frame], views[frame], camera, marker, part)
    name_by_tracklets(views, results, RATE)
    middle = FRAMES[len(FRAMES) // 2]
    naming = results[middle].naming
    assert (naming.slot[camera, marker] == before[middle][camera, marker]) == named
    assert naming.rays[camera, marker] < 0
    assert np.linalg.norm(naming.meeting.points[marker] - points[middle]) < 0.002


def test_what_a_person_named_stays():
    scene, _, views, results = followed()
    marker, other = scene.markerset.index("LKNE"), scene.markerset.index("LTOE")
    camera, frame = seen_by(results, marker), FRAMES[0]
    naming = results[frame].naming
    slot = naming.slot[camera, marker]
    naming.withdraw(np.array([camera]), np.array([marker]))
    if naming.slot[camera, other] >= 0:
        naming.withdraw(np.array([camera]), np.array([other]))
    naming.frame.fixed[camera, other] = slot
    naming.give(camera, other, slot, 1)
    try:
        name_by_tracklets(views, results, RATE)
        assert naming.owner[camera, slot] == other
    finally:
        naming.frame.fixed[camera, other] = -1  # the frame is not this test's own


def images(*paths):
    """Views of one camera in which blobs go along paths (F, 2)."""
    xy = np.array(paths).swapaxes(0, 1)[:, None]
    return [View(one, np.ones(one.shape[:2], bool), np.zeros(one.shape[:2], int)) for one in xy]


def test_blobs_that_meet_are_other_tracklets_afterwards():
    along = np.linspace(-0.2, 0.2, 41)
    near, far = np.stack([along, 0.0005 + 0 * along], axis=1), np.stack([-along, 0 * along], axis=1)
    depths = [np.array([3.0])] * len(along)
    numbers, count = tracklets_of(images(near, far), depths, RATE)
    first, last = set(numbers[0][0].tolist()), set(numbers[-1][0].tolist())
    assert len(first) == 2 and not first & last and count >= 4
    numbers, count = tracklets_of(images(near, far + np.array([0, 0.2])), depths, RATE)
    assert count == 2 and (numbers[0] == numbers[-1]).all()


def test_frames_without_anybody_or_without_blobs():
    assert name_by_tracklets([], [], RATE) == {}
    _, _, views, results = followed()
    assert name_by_tracklets(views, [None] * len(views), RATE) == {}
    nothing = replace(views[0], image=np.zeros((len(RIG), 1, 2)), real=np.zeros((len(RIG), 1), bool))
    name_by_tracklets([*views[:20], nothing, *views[21:]], [*results[:20], None, *results[21:]], RATE)
