# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that a body gave to blobs, asked about in space."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.takes import NO_MARKER, Blobs, LabelledChunk, Suspect
from addon.core.edits.kinds import NO_EDITS, AssignBlob, Edits, Right, Swap, UnlabelMarker
from addon.core.pipelines.asked_in_space import asked_in_space
from addon.core.pipelines.blobs import BlobOptions, label_blobs
from addon.core.review.answering import unanswered
from addon.core.review.suspects import EITHER_WAY
from tests.core.pipelines.pair import CAMERAS, RATE, shot_of
from tests.core.scenes import cut

WORN_WRONG = "LTIB", "LANK"  # each has the other's name


@pytest.fixture(scope="module")
def blobs(model) -> Blobs:
    return shot_of(model, (1,))[0]


@pytest.fixture(scope="module")
def named(blobs, model) -> LabelledChunk:
    (chunk,) = label_blobs([blobs], CAMERAS, model, BlobOptions(RATE))
    return chunk


def exchanged(chunk: LabelledChunk, model) -> LabelledChunk:
    """The chunk with two names the wrong way round."""
    one, other = (model.markerset.by_name[name] for name in WORN_WRONG)
    order = np.arange(len(model.markerset) + 1)
    order[[one, other]] = other, one
    motion = {name: getattr(chunk.motion, name)[:, order[:-1]] for name in ("markers", "residual", "residual_px")}
    labels = replace(chunk.labels, marker=np.append(order[:-1], NO_MARKER)[chunk.labels.marker])
    return replace(chunk, labels=labels, motion=replace(chunk.motion, **motion))


def asked(blobs: Blobs, chunk: LabelledChunk, model, edits: Edits = NO_EDITS, cameras=CAMERAS) -> LabelledChunk:
    (found,) = asked_in_space([blobs], [chunk], cameras, model, RATE, 0.999, edits)
    return found


def test_names_that_distances_bear_out_stay(named, blobs, model):
    assert set(named.labels.marker) == {NO_MARKER, *range(len(model.markerset))}
    found = asked(blobs, named, model)
    assert (found.labels, found.suspects) == (named.labels, named.suspects)
    assert found.seconds["label"] > named.seconds["label"], "to ask takes time, too"


def test_neither_of_two_names_that_distances_have_otherwise_is_given(named, blobs, model):
    wrong = exchanged(named, model)
    found = asked(blobs, wrong, model)
    pair = [model.markerset.by_name[name] for name in WORN_WRONG]
    taken = np.isin(wrong.labels.marker, pair)
    assert taken.sum() > 100
    assert (found.labels.marker == np.where(taken, NO_MARKER, wrong.labels.marker)).all()
    assert np.isnan(found.motion.markers[:, pair]).all()
    (doubt,) = [one for one in found.suspects if EITHER_WAY in one.words]
    assert set(doubt.markers) == set(WORN_WRONG)
    assert (doubt.first, doubt.last) == tuple(blobs.frames[[0, -1]])


def test_a_doubt_about_a_name_that_is_not_given_goes_with_it(named, blobs, model):
    about = [(), WORN_WRONG, WORN_WRONG[:1], (WORN_WRONG[0], "LKNE"), ("LKNE",)]
    doubts = tuple(Suspect(0, 0, str(number), markers=markers) for number, markers in enumerate(about))
    found = asked(blobs, replace(exchanged(named, model), suspects=doubts), model).suspects
    assert [one.words for one in found[:-1]] == ["0", "3", "4"]
    assert EITHER_WAY in found[-1].words


def test_a_blob_that_a_person_named_answers_for_both(named, blobs, model):
    wrong = exchanged(named, model)
    (doubt,) = [one for one in asked(blobs, wrong, model).suspects if EITHER_WAY in one.words]
    edits = Edits([AssignBlob(camera="1", x=0.0, y=0.0, frame=int(blobs.frames[0]), marker=WORN_WRONG[0])])
    assert asked(blobs, wrong, model, edits).labels is wrong.labels
    assert unanswered([doubt], edits, model.markerset.by_name) == ()


def test_names_that_a_person_found_right_in_all_of_the_take_stay(named, blobs, model):
    wrong = exchanged(named, model)
    assert asked(blobs, wrong, model, Edits([Right(WORN_WRONG[1])])).labels is wrong.labels
    for other in (Right(WORN_WRONG[1], frames=(1, 9)), Right("LKNE"), Swap(WORN_WRONG), UnlabelMarker(WORN_WRONG[0])):
        assert EITHER_WAY in asked(blobs, wrong, model, Edits([other])).suspects[-1].words


def test_two_cameras_or_a_moment_tell_nothing(named, blobs, model):
    wrong = exchanged(named, model)
    assert asked(blobs, wrong, model, cameras=CAMERAS.select([0, 1])).labels is wrong.labels
    moment = replace(wrong, motion=replace(wrong.motion, confidence=np.where(np.arange(40) < 20, 1.0, 0.0)))
    assert asked(blobs, moment, model).labels is moment.labels


def test_what_the_first_chunk_shows_holds_for_all(named, blobs, model):
    wrong, parts = exchanged(named, model), cut(blobs, 40)
    given = asked_in_space([*parts, *parts], [wrong, wrong], CAMERAS, model, RATE, 0.999, NO_EDITS)
    assert len({tuple(chunk.labels.marker) for chunk in given}) == 1
