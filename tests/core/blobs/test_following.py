# SPDX-License-Identifier: GPL-3.0-or-later
"""A subject followed, frames read again, names that jump or are lost put right along what goes on in one image."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from addon.core.blobs import sharing, swaps
from addon.core.blobs.image_tracklets import name_by_tracklets
from addon.core.blobs.rereading import Rereader, known_subject_of
from addon.core.blobs.search import Hints, find_subject
from addon.core.blobs.subject import Setup, refit
from addon.core.blobs.swaps import swap_names
from addon.core.blobs.tracking import FrameResult, Track, follow
from addon.core.geometry.views import View
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import CaptureOptions, capture
from addon.core.simulation.virtual import Act
from tests.core.scenes import RATE, act, built_in, joined

FOOT = ("LANK", "LHEE", "LTOE")
RIG = ring_rig(8, radius=4.5, volume_radius=1.3)


@cache
def walk():
    """A walk of 1.2 s from standing, in `body26`."""
    return act(built_in("body26"), RIG, (Act(0.3), Act(0.9, stride=0.9)), seed=3, options=CaptureOptions(noise=0.3))


def followed():
    """The walk, its setup and views, and its frames by index as followed; the names are the caller's own."""
    setup, views, results = _followed()
    arrays = ("slot", "step", "owner", "partner", "conflicts")
    copied = [{name: getattr(result.naming, name).copy() for name in arrays} for result in results]
    copies = [replace(one, naming=replace(one.naming, **own)) for one, own in zip(results, copied, strict=True)]
    return walk(), setup, views, dict(enumerate(copies))


def begun(scene, occlusion=None):
    """The setup of a scene, its views, who is found in the first of them, and a track that begins there."""
    setup, views = Setup.of(scene.cameras, scene.markerset, occlusion, rate=RATE), scene.views()
    found = find_subject(views[0], setup, Hints())
    track = Track.begin(found.subject, found.naming.meeting.points, found.expected.visible, setup.model)
    return setup, views, found, track


@cache
def _followed():
    setup, views, results = follow_all(walk())
    return setup, views, list(results.values())


def follow_all(scene):
    """The setup of a scene, its views, and its frames by index as followed."""
    setup, views, found, track = begun(scene)
    sure = np.ones(len(scene.markerset))
    results = [FrameResult(found.subject.bodies, found.naming, found.expected, found.confidence, sure)]
    for view in views[1:]:
        one = follow(track, view, setup)
        track = one.track
        results.append(FrameResult(track.subject.bodies, one.naming, one.expected, found.confidence, sure))
    return setup, views, dict(enumerate(results))


def wrong_names(scene, views, results):
    """(F,) how many blobs of each frame have a name that is not theirs."""
    frames = zip(views, results.values(), strict=True)
    return np.array([(~scene.given(view, result.naming)[1]).sum() for view, result in frames])


def exchange(scene, results, frames, *markers):
    """Hands the names of markers around, each the next one's, in some frames."""
    index = [scene.markerset.index(name) for name in markers]
    order = np.arange(len(scene.markerset))
    order[index] = np.roll(index, -1)
    for frame in frames:
        swap_names(results[frame].naming, order)


def part_of(results, first, end):
    return {index - first: results[index] for index in range(first, end)}


@pytest.mark.parametrize("frames", [range(12), range(25, 50), range(60, 72)], ids=["begin", "middle", "end"])
def test_one_foot_of_exchanged_markers_is_put_right(frames):
    scene, setup, views, results = followed()
    exchange(scene, results, frames, *FOOT)
    assert wrong_names(scene, views, results)[list(frames)].min() > 10
    (first, last, track), *_ = Rereader(setup).read_again(results, None)
    assert first <= frames[0] and last >= frames[-1]
    assert not wrong_names(scene, views, results).any()
    assert track is not None or last < len(views) - 1


@pytest.mark.parametrize("edge", [25, 64])
def test_what_lies_beyond_an_edge_that_was_renamed_is_read_too(monkeypatch, edge):
    """A body turned so that it suits its wrong names is doubtful in few frames only."""
    scene, setup, views, results = followed()
    exchange(scene, results, range(25, 65), *FOOT)
    few = np.arange(edge - 4, edge + 4)
    monkeypatch.setattr(Rereader, "_doubtful", lambda self, results, frames, known: np.intersect1d(frames, few))
    assert len(Rereader(setup).read_again(results, None)) > 2
    assert not wrong_names(scene, views, results).any()


def test_what_suits_the_subject_is_left_alone_and_a_few_frames_are_not_judged():
    _, setup, _, results = followed()
    as_they_were = dict(results)
    assert Rereader(setup).read_again(results, None) == []
    assert results == as_they_were
    scene, setup, _, results = followed()
    exchange(scene, results, range(10), *FOOT)
    assert Rereader(setup).read_again(part_of(results, 0, 20), None) == []


def test_of_markers_that_are_far_from_each_other_none_are_exchanged(monkeypatch):
    _, setup, _, results = followed()
    alone = replace(setup, exchanges=np.zeros((0, setup.model.marker_count), int))
    monkeypatch.setattr(swaps, "_neighbours", lambda *_: np.zeros((0, 2), int))
    reader, naming = Rereader(alone), results[40].naming
    reader.read_again(results, None)
    subject, state = refit(naming, reader.known.subject, alone, 2, alone.prior)
    assert not len(swaps.try_swaps(naming, subject, state, alone, alone.prior).loss)


def test_a_chunk_that_begins_wrong_is_read_from_the_one_before():
    """Where no frame after it can be read from, the last frame of the chunk before can."""
    scene, setup, views, results = followed()
    rereader = Rereader(setup)
    rereader.read_again(part_of(results, 0, 40), None)
    rest = part_of(results, 40, len(results))
    exchange(scene, results, range(40, 46), *FOOT)
    assert rereader.read_again(rest, results[39])
    assert not wrong_names(scene, views[40:], rest).any()


def test_what_suits_the_subject_in_no_reading_loses_its_name_unless_a_person_gave_it():
    """From a frame on a toe's marker is hidden, and one that is not of the set is seen before it."""
    scene, hidden = walk(), slice(50, None)
    toe, markers = scene.markerset.index("RTOE"), scene.points.copy()
    other = np.full_like(markers[:, :1], np.nan)
    other[hidden, 0] = 1.4 * markers[hidden, toe] - 0.4 * markers[hidden, scene.markerset.index("RHEE")]
    markers[hidden, toe] = np.nan
    both, names = np.concatenate([markers, other], axis=1), (*scene.markerset.markers, "other")
    seen = joined(capture(both, names, RIG, CaptureOptions(noise=0.3)))
    scene = replace(scene, blobs=seen.blobs, truth=seen.truth)
    setup, views, results = follow_all(scene)
    assert wrong_names(scene, views, results)[hidden].min() == len(RIG)
    reader, naming = Rereader(setup), results[60].naming
    naming.frame.fixed = np.where(np.arange(len(scene.markerset)) == toe, naming.slot, -1)
    known = known_subject_of([results[index] for index in range(50)], setup, None)
    assert not reader._withdrawn(results, np.array([60]), known) and (naming.slot[:, toe] >= 0).all()
    first, last, track = reader.read_again(results, None)[-1]
    assert not wrong_names(scene, views, results).any()
    assert (first, last) == (50, 71) and track is not None, "the track goes on without that name"


def test_what_comes_step_by_step_to_where_it_does_not_suit_keeps_its_name():
    scene = walk()
    toe, heel, markers = scene.markerset.index("RTOE"), scene.markerset.index("RHEE"), scene.points.copy()
    farther = np.interp(np.arange(len(markers)), [40, 55], [1.0, 1.4])[:, None]
    markers[:, toe] = markers[:, heel] + farther * (markers[:, toe] - markers[:, heel])
    seen = joined(capture(markers, scene.markerset.markers, RIG, CaptureOptions(noise=0.3)))
    setup, _, results = follow_all(replace(scene, blobs=seen.blobs, truth=seen.truth))
    before = [(result.naming.slot[:, toe] >= 0).sum() for result in results.values()]
    Rereader(setup).read_again(results, None)
    assert [(result.naming.slot[:, toe] >= 0).sum() for result in results.values()] == before
    assert min(before) >= len(RIG) - 1


FRAMES = range(30, 38)


def slots(results):
    return [result.naming.slot.copy() for result in results.values()]


def seen_by(results, marker: int) -> int:
    """A camera that names the marker in all of FRAMES and a dozen around them, as others do."""
    named = np.array([(result.naming.rays >= 0)[:, marker] for result in results.values()])[20:50]
    assert named.sum(axis=1).min() >= 3
    return int(np.flatnonzero(named.all(axis=0))[0])


@pytest.mark.parametrize("everywhere", [False, True])
def test_names_that_one_camera_or_all_lost_come_back(everywhere):
    scene, _, views, results = followed()
    marker = scene.markerset.index("LKNE")
    camera, before = seen_by(results, marker), slots(results)
    for frame in FRAMES:
        naming = results[frame].naming
        cameras = np.flatnonzero(naming.slot[:, marker] >= 0) if everywhere else np.array([camera])
        naming.withdraw(cameras, np.full(len(cameras), marker))
    name_by_tracklets(views, results, RATE)
    for frame in FRAMES:
        naming = results[frame].naming
        assert (naming.rays[:, marker] >= 0).sum() >= 2
        assert everywhere or naming.slot[camera, marker] == before[frame][camera, marker]
    assert not wrong_names(scene, views, results)[FRAMES.start : FRAMES.stop].any()


def test_most_of_an_exchange_is_undone_and_names_that_suit_stay():
    scene, _, views, results = followed()
    exchange(scene, results, FRAMES, "LANK", "LHEE")
    before = wrong_names(scene, views, results)[FRAMES.start : FRAMES.stop].sum()
    name_by_tracklets(views, results, RATE)
    assert wrong_names(scene, views, results)[FRAMES.start : FRAMES.stop].sum() < before / 2
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


@pytest.mark.parametrize("noise", [0.3, 1.2])
def test_it_learns_the_takes_noise(noise):
    acts = [Act(0.2), Act(1.2, stride=0.9), Act(0.6, stride=0.4, turn=1.5)]
    options = CaptureOptions(noise=noise, reflections=1, flicker=0.1)
    setup, views, _, track = begun(act(built_in("gait15"), RIG, acts, seed=3, options=options))
    for view in views[1:]:
        track = follow(track, view, setup).track
    assert track.subject.pixel == pytest.approx(noise, rel=0.35)


def test_a_blob_that_is_plainly_anothers_is_not_offered(model, monkeypatch):
    """Of markers 10 cm apart: what is on one, what is between both, and what is far from either but nearer to one."""
    cameras = ring_rig(3, (1280, 1024), 4.0, 2.2, 1.4)
    setup = Setup.of(cameras, model.markerset)
    own, other = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.1])
    blobs = np.array([own, (own + other) / 2, other, 1.9 * own - 0.9 * other])
    image = setup.sight.image(setup.sight.local(blobs[None])[0])
    view = View(image, np.ones(image.shape[:2], bool), np.arange(image[..., 0].size).reshape(image.shape[:2]))
    monkeypatch.setattr(sharing, "_led_to", lambda *_: np.array([own[None], other[None]]))
    first, second = sharing.shared(view, [None, None], setup, [None, None])
    assert first.real.tolist() == [[True, True, False, True]] * 3
    assert second.real.tolist() == [[False, True, True, False]] * 3
    assert (first.image[:, 2] == sharing.NOWHERE).all()
    np.testing.assert_array_equal(first.row, view.row)
    fixed = np.array([[2], [-1], [1]])  # by a person, the second one's in two cameras
    first, second = sharing.shared(view, [None, None], setup, [None, fixed])
    assert first.real.tolist() == [[True, True, False, True], [True, True, False, True], [True, False, False, True]]
    assert second.real.tolist() == [[False, True, True, False]] * 3
    first, second = sharing.shared(view, [None, None], setup, [fixed, None])
    assert first.real[:, 2].tolist() == [True, False, False]
    assert second.real[:, 1:3].tolist() == [[True, False], [True, True], [False, True]]
