# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames whose names do not suit the subject: found by what the other frames show, and read again."""

import numpy as np
import pytest

from addon.core.blobs.known_subject import judged, known_subject_of
from addon.core.blobs.rereading import REREADING, Rereader
from tests.core.blobs.followed import exchange, followed, wrong_names

FOOT = ("LANK", "LHEE", "LTOE")
ENOUGH = REREADING.min_frames // 2


def test_right_names_suit_the_subject_and_exchanged_ones_do_not():
    scene, setup, views, results = followed()
    exchange(scene, results, range(30, 45), *FOOT)
    known = known_subject_of(results, setup, None, ENOUGH)
    _, off = judged(views, results, known, setup)
    exchanged = np.isin(np.arange(len(results)), range(30, 45))
    foot = [scene.markerset.index(name) for name in FOOT]
    assert (off[exchanged][:, foot].max(axis=1) > setup.rules.max_on_point).all()
    assert (off[~exchanged] < setup.rules.max_on_point).all()


def test_a_marker_that_is_hardly_seen_sits_where_it_did_before():
    _, setup, _, results = followed()
    before, few = known_subject_of(results, setup, None, ENOUGH), known_subject_of(results[:5], setup, None, ENOUGH)
    assert before.known.all() and not few.known.any()
    assert (few.subject.bodies.own == 0).all()
    after = known_subject_of(results[:5], setup, before, ENOUGH)
    assert after.known.all()
    assert np.array_equal(after.subject.bodies.own, before.subject.bodies.own)


@pytest.mark.parametrize("frames", [range(12), range(25, 50), range(60, 72)], ids=["begin", "middle", "end"])
def test_one_foot_of_exchanged_markers_is_put_right(frames):
    """At either end of the take, and within."""
    scene, setup, views, results = followed()
    exchange(scene, results, frames, *FOOT)
    assert wrong_names(scene, views, results)[list(frames)].min() > 10
    (stretch,) = Rereader(setup).read_again(views, results, None)
    assert stretch.first <= frames[0] and stretch.last >= frames[-1]
    assert not wrong_names(scene, views, results).any()
    assert (stretch.track is not None) == (stretch.last == len(views) - 1)


def test_what_suits_the_subject_is_left_alone():
    _, setup, views, results = followed()
    as_they_were = list(results)
    assert Rereader(setup).read_again(views, results, None) == []
    assert all(one is other for one, other in zip(results, as_they_were, strict=True))


def test_a_few_frames_are_not_judged():
    scene, setup, views, results = followed()
    exchange(scene, results, range(10), *FOOT)
    assert Rereader(setup).read_again(views[:20], results[:20], None) == []


def test_a_chunk_that_begins_wrong_is_read_from_the_one_before():
    """Where no frame after it can be read from, the last frame of the chunk before can."""
    scene, setup, views, results = followed()
    rereader = Rereader(setup)
    rereader.read_again(views[:40], results[:40], None)
    rest = [*results[40:]]
    exchange(scene, results, range(40, 46), *FOOT)
    assert rereader.read_again(views[40:], rest, results[39])
    assert not wrong_names(scene, views[40:], rest).any()
