# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole takes, chunk by chunk: followed, lost and found again, the same however they are cut, in flat memory."""

import gc
import tracemalloc
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from addon.core.blobs.pipeline import TakeLabeller, label_take
from addon.core.blobs.search import FINDING, NO_HINTS, Hints
from addon.core.blobs.subject import TIMED_STAGES, Setup
from addon.core.blobs.tracking import FOLLOWING_STEPS
from addon.core.data.takes import NO_MARKER, NO_STEP, Labels
from addon.core.review.answering import WHOLE_FRAME
from addon.core.simulation.rigs import paper_rig, ring_rig
from addon.core.simulation.simulate import CaptureOptions, disturbed
from addon.core.simulation.virtual import Act
from tests.core.scenes import CLEAN, RATE, act, blobs_at, built_in, cut, film, keep, stand

RIG = ring_rig(6, radius=4.5, volume_radius=1.3)
ROOM = CaptureOptions(noise=0.3, reflections=1, flicker=0.1)
WALK = (Act(0.3), Act(1.2, stride=0.9), Act(0.7, stride=0.4, turn=np.pi / 2))


@cache
def walk(name="gait15"):
    return act(built_in(name), RIG, WALK, seed=3, options=ROOM)


class Outcome:
    """All chunks of a labelled take as one, row for row with the blobs that were given."""

    def __init__(self, scene, kept=None, size=1000, hints=NO_HINTS, rig=RIG):
        self.rows = np.flatnonzero(np.ones(len(scene.blobs), dtype=bool) if kept is None else kept)
        blobs = keep(scene.blobs, self.rows)
        self.chunks = list(label_take(cut(blobs, size), rig, scene.markerset, RATE, hints))
        labels = Labels.join(chunk.labels for chunk in self.chunks)
        self.marker, self.step, self.confidence = labels.marker, labels.step, labels.confidence
        self.right = replace(scene, truth=scene.truth[self.rows]).right(scene.names(self.marker))
        self.given = self.marker >= 0
        self.wrong = int((self.given & ~self.right).sum())
        self.suspects = [suspect for chunk in self.chunks for suspect in chunk.suspects]
        self.found = np.concatenate([chunk.motion.confidence for chunk in self.chunks]) > 0
        self.frame = blobs.frame


@cache
def outcome(name="gait15", size=1000):
    return Outcome(walk(name), size=size)


@pytest.mark.parametrize("name", ["gait15", "body26"])
def test_a_walk_is_named(name):
    """A2, A34: every blob of a walk in a room with ghosts."""
    assert FOLLOWING_STEPS == 2, "iterations a frame"
    whole = outcome(name)
    assert whole.right.mean() > 0.998
    assert whole.wrong <= 0.0005 * whole.given.sum()
    assert whole.found.all() and not whole.suspects


def test_a_marker_that_somebody_wears_elsewhere_is_found(monkeypatch):
    """12 cm off, farther than single frames look; where it is not worn, nothing has its name, or loses one by it."""
    scene = walk("body26")
    marker = scene.markerset.index("C7")
    own = scene.bodies.own.copy()
    own[:, marker, 0] += 0.07
    scene = film(scene.markerset, RIG, replace(scene.bodies, own=own), ROOM)
    worn = np.array(["C7" in truth.split("|") for truth in scene.truth])
    monkeypatch.setattr(FINDING, "clear_confidence", 1.0)
    whole = Outcome(scene)
    assert whole.right[worn].mean() > 0.99 and whole.wrong <= 0.0005 * whole.given.sum()
    assert any(one.words.startswith(WHOLE_FRAME) for one in whole.suspects), "how sure the start was is still said"
    without = Outcome(scene, ~worn)
    assert not (without.marker == marker).any()
    assert without.right.mean() > 0.999


def test_labels_are_well_formed():
    whole = outcome()
    assert ((whole.confidence >= 0) & (whole.confidence <= 1)).all()
    assert ((whole.step > NO_STEP) == whole.given).all()
    assert ((whole.confidence > 0) == whole.given).all()
    assert (whole.marker[~whole.given] == NO_MARKER).all()
    cells = np.stack([whole.frame, walk().blobs.camera, whole.marker])[:, whole.given]
    assert len(np.unique(cells, axis=1).T) == whole.given.sum()  # no marker twice in one image


def test_motion_is_where_the_person_was():
    scene, whole = walk(), outcome()
    (motion,) = [chunk.motion for chunk in whole.chunks]
    count, markers = len(scene.blobs.frames), len(scene.markerset)
    assert np.array_equal(motion.frames, scene.blobs.frames)
    assert motion.markers.shape == motion.expected.shape == (count, markers, 3)
    there = np.isfinite(motion.markers[..., 0])
    assert there.mean() > 0.95
    off = np.linalg.norm(motion.markers - scene.points, axis=-1)
    assert np.nanmedian(off) < 0.003 and np.nanpercentile(off, 99) < 0.01
    assert all(np.array_equal(np.isfinite(one), there) for one in (motion.residual, motion.residual_px))
    assert np.nanmedian(motion.residual_px) == pytest.approx(0.3, rel=0.5)
    assert np.linalg.norm(motion.expected - scene.points, axis=-1).mean() < 0.006
    turn = motion.rotations
    assert turn @ turn.swapaxes(-1, -2) == pytest.approx(np.broadcast_to(np.eye(3), turn.shape), abs=1e-9)
    assert motion.scale.mean() == pytest.approx(scene.bodies.scale.mean(), rel=0.05)
    assert ((motion.confidence > 0) & (motion.confidence <= 1)).all()


@pytest.mark.parametrize("size", [60, 7, 1])
def test_chunks_of_any_size_give_the_same_labels(size):
    """But for a blob in ten thousand: the frame to start from is chosen among those of the first chunk."""
    whole, pieces = outcome(), outcome(size=size)
    assert (pieces.marker == whole.marker).mean() > 0.999
    assert pieces.wrong <= whole.wrong + 2
    assert len(pieces.chunks) == -(-len(walk().blobs.frames) // size)


def test_who_was_found_already_is_not_looked_for(monkeypatch):
    scene, setup = walk(), Setup.of(RIG, built_in("gait15"), rate=RATE)
    one, other = TakeLabeller(setup), TakeLabeller(setup)
    other.person = False
    marker = one.label(scene.blobs).labels.marker
    monkeypatch.setattr("addon.core.blobs.pipeline.find_subject", None)
    assert (other.label(scene.blobs, marker, one.found).labels.marker == marker).mean() > 0.999


def test_the_same_take_gives_the_same_labels_and_every_chunk_when_it_comes():
    first, second = outcome(), Outcome(walk())
    assert np.array_equal(first.marker, second.marker) and np.array_equal(first.confidence, second.confidence)
    assert np.array_equal(first.chunks[0].motion.expected, second.chunks[0].motion.expected)
    # A generator: no chunk is asked for before the one before it was given back.
    asked = []

    def source():
        for chunk in cut(walk().blobs, 40):
            asked.append(len(chunk.frames))
            yield chunk

    for number, labelled in enumerate(label_take(source(), RIG, walk().markerset, RATE), 1):
        assert len(asked) == number
        assert len(labelled.motion.frames) == asked[-1]
        assert set(labelled.seconds) == set(TIMED_STAGES) and min(labelled.seconds.values()) >= 0


@pytest.mark.parametrize("size", [1000, 25])
def test_lost_and_found_again(size):
    """A34: the person leaves for half a second: lost, said so, and found again by a fresh start."""
    scene = walk()
    away = slice(60, 92)
    frame = scene.blobs.frame
    whole = Outcome(scene, (frame < away.start) | (frame >= away.stop), size)
    assert whole.right.mean() > 0.998 and whole.wrong <= 2
    assert whole.found[: away.start].all() and whole.found[away.stop :].all()
    assert not whole.found[away.start + 1 : away.stop - 1].any()
    assert any("lost" in suspect.reason for suspect in whole.suspects)
    first = next(suspect.first for suspect in whole.suspects if "lost" in suspect.reason)
    assert first == scene.blobs.frames[away.start]


def test_nobody_there_is_said():
    generator, scene = np.random.default_rng(1), walk()
    ghosts = scene.truth == ""
    empty = Outcome(scene, ghosts)
    assert not empty.given.any() and not empty.found.any()
    assert [(s.first, s.last) for s in empty.suspects] == [(scene.blobs.frames[0], scene.blobs.frames[-1])]
    assert "no subject" in empty.suspects[0].reason
    (motion,) = [chunk.motion for chunk in empty.chunks]
    assert np.isnan(motion.markers).all() and np.isnan(motion.expected).all() and (motion.confidence == 0).all()
    noise = [generator.uniform([0, 0], RIG.size[0], (15, 2)) for _ in range(6)]
    (crowd,) = label_take([blobs_at(noise)], RIG, scene.markerset, RATE)
    assert (crowd.labels.marker == NO_MARKER).all() and len(crowd.suspects) == 1


def test_one_camera_out_of_place_is_survived():
    """A16: one camera was knocked by 20 mm after its calibration; the others' names stay right."""
    scene = walk()
    moved = disturbed(RIG, 20.0, 0.0, np.random.default_rng(2))
    translation = RIG.translation.copy()
    translation[4] = moved.translation[4]
    knocked = replace(RIG, translation=translation)
    whole = Outcome(scene, scene.blobs.frame < 40, rig=knocked)
    others = scene.blobs.camera[whole.rows] != 4
    assert whole.right[others].mean() > 0.97
    assert whole.wrong <= 0.003 * whole.given.sum()


@pytest.mark.parametrize("name", ["gait15", "body26"])
@pytest.mark.parametrize(("gap", "start"), [(1, 20), (2, 40), (5, 60)])
def test_a_short_dropout_of_all_cameras_exchanges_no_names(name, gap, start):
    frame = walk(name).blobs.frame
    whole = Outcome(walk(name), (frame < start) | (frame >= start + gap))
    assert whole.wrong <= 2 and whole.right.mean() > 0.995


def test_a_facing_hint_is_for_the_beginning_only():
    acts = [Act(0.3), Act(1.5, stride=0.9), Act(1.2, stride=0.4, turn=np.pi), Act(1.5)]
    scene = act(built_in("gait15"), RIG, acts, seed=3, options=ROOM)
    frame = scene.blobs.frame
    whole = Outcome(scene, (frame < 150) | (frame >= 200), hints=Hints(None, 0.0))
    assert whole.wrong <= 5


def test_twelve_frames_a_second():
    acts = [Act(0.3), Act(1.5, stride=1.0), Act(1.0, stride=0.6, turn=np.pi)]
    scene = act(built_in("gait15"), RIG, acts, seed=4, options=ROOM, rate=12)
    (chunk,) = label_take([scene.blobs], RIG, scene.markerset, 12.0)
    given = chunk.labels.named
    assert (given & ~scene.right(scene.names(chunk.labels.marker))).sum() <= 0.005 * given.sum()


def test_memory_does_not_grow_with_the_take():
    rig = paper_rig()
    scene = stand(built_in("gait15"), rig, 2)
    chunk = film(scene.markerset, rig, scene.bodies.pick(np.zeros(6, dtype=int)), CLEAN).blobs
    held = []
    tracemalloc.start()
    try:
        for labelled in label_take((chunk for _ in range(14)), rig, scene.markerset, RATE):
            assert labelled.motion.confidence.all()
            del labelled
            gc.collect()
            held.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert max(held[8:]) - max(held[2:5]) < 20_000
