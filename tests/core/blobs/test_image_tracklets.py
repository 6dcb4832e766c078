# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs that go on in one image: what they are called before and after says what they are in between."""

import numpy as np

from addon.core.blobs.image_tracklets import name_by_tracklets
from tests.core.blobs.followed import exchange, followed, take_name, wrong_names
from tests.core.scenes import RATE

FRAMES = range(30, 38)


def slots(results):
    return [result.naming.slot.copy() for result in results.values()]


def seen_by(results, marker: int) -> int:
    """A camera that names the marker in all of FRAMES and a dozen around them, as others do."""
    named = np.array([(result.naming.rays >= 0)[:, marker] for result in results.values()])[20:50]
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
