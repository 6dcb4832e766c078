# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that a body gave to blobs, asked about in space."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from addon.core.data.takes import NO_MARKER, Blobs, LabelledChunk, Suspect
from addon.core.edits.kinds import NO_EDITS, AssignBlob, Edits, Right, Swap, UnlabelMarker
from addon.core.geometry.measuring import measured_again
from addon.core.pipelines.asked_in_space import Asked, asked_in_space
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
    (found,) = asked_in_space([blobs], [chunk], cameras, Asked(model.markerset, model, 0, RATE, 0.999, edits))
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


def blob_of(blobs: Blobs, chunk: LabelledChunk, model, had: str, said: str, frame: int = 20) -> AssignBlob:
    """A person's name for a blob that has a name, in a frame."""
    own = (chunk.labels.marker == model.markerset.by_name[had]) & (blobs.frame == frame)
    row = np.flatnonzero(own)[0]
    x, y = blobs.xy[row].tolist()
    return AssignBlob(CAMERAS.names[blobs.camera[row]], int(blobs.frames[frame]), x, y, said)


@pytest.mark.parametrize("said", WORN_WRONG)
def test_a_blob_that_a_person_named_says_which_is_which_in_the_whole_take(named, blobs, model, said):
    wrong = exchanged(named, model)
    (doubt,) = [one for one in asked(blobs, wrong, model).suspects if EITHER_WAY in one.words]
    edits = Edits([blob_of(blobs, named, model, said, said)])
    found = asked(blobs, wrong, model, edits)
    assert (found.labels.marker == named.labels.marker).all()
    np.testing.assert_allclose(found.motion.markers, named.motion.markers, atol=1e-3)
    assert found.suspects == wrong.suspects
    assert unanswered([doubt], edits, model.markerset.by_name) == ()
    as_the_body = Edits([blob_of(blobs, wrong, model, said, said)])
    assert asked(blobs, wrong, model, as_the_body).labels is wrong.labels


def test_a_body_that_bent_to_a_person_is_asked_as_it_was_before(named, blobs, model):
    wrong = exchanged(named, model)
    labels = wrong.labels.replaced(blobs.frame < 25, named.labels)
    motion = measured_again(wrong.motion, blobs, wrong.labels, labels, CAMERAS)
    bent = replace(wrong, labels=labels, motion=motion, unedited=wrong.labels)
    edits = Edits([blob_of(blobs, named, model, *WORN_WRONG[:1] * 2)])
    found = asked(blobs, bent, model, edits)
    assert (found.labels.marker == named.labels.marker).all()
    assert (found.unedited.marker == named.labels.marker).all()
    np.testing.assert_allclose(found.motion.markers, named.motion.markers, atol=1e-3)


def test_a_person_who_exchanged_the_two_is_not_asked(named, blobs, model):
    wrong = exchanged(named, model)
    assert asked(blobs, wrong, model, Edits([Swap(WORN_WRONG[::-1])])).labels is wrong.labels


def test_a_blob_of_neither_leaves_both_unnamed_and_asked_about(named, blobs, model):
    wrong = exchanged(named, model)
    edits = Edits([blob_of(blobs, named, model, "RHEE", WORN_WRONG[0])])
    found = asked(blobs, wrong, model, edits)
    assert not np.isin(found.labels.marker, [model.markerset.by_name[name] for name in WORN_WRONG]).any()
    (doubt,) = found.suspects
    assert "do not tell which is which" in doubt.words
    assert unanswered([doubt], edits, model.markerset.by_name) == (doubt,)


def test_of_three_that_may_be_each_other_two_names_tell_the_third(named, blobs, model, monkeypatch):
    ring = "LTIB", "LANK", "LHEE"
    one, two, three = (model.markerset.by_name[name] for name in ring)
    monkeypatch.setattr("addon.core.pipelines.asked_in_space.pairs_of", lambda *_: [(one, two), (two, three)])
    said = [blob_of(blobs, named, model, had, new) for had, new in pairwise(ring)]
    found = asked(blobs, named, model, Edits(said[:1]))
    assert ((found.labels.marker == two) == (named.labels.marker == one)).all()
    assert not np.isin(found.labels.marker, [one, three]).any()
    assert len(found.suspects) == 2
    found = asked(blobs, named, model, Edits(said))
    for had, new in ((one, two), (two, three), (three, one)):
        assert ((found.labels.marker == new) == (named.labels.marker == had)).all()


def test_an_answer_late_in_the_take_holds_from_its_start(named, blobs, model):
    wrong, parts = exchanged(named, model), cut(blobs, 40)
    later = replace(parts[0], frames=parts[0].frames + 40)
    said = blob_of(blobs, named, model, *WORN_WRONG[:1] * 2)
    edits = Edits([replace(said, frame=said.frame + 40)])
    given = asked_in_space(
        [blobs, later], [wrong, wrong], CAMERAS, Asked(model.markerset, model, 0, RATE, 0.999, edits)
    )
    for chunk in given:
        assert (chunk.labels.marker == named.labels.marker).all()


def test_names_that_a_person_found_right_in_all_of_the_take_stay(named, blobs, model):
    wrong = exchanged(named, model)
    assert asked(blobs, wrong, model, Edits([Right(WORN_WRONG[1])])).labels is wrong.labels
    for other in (Right(WORN_WRONG[1], frames=(1, 9)), Right("LKNE"), UnlabelMarker(WORN_WRONG[0])):
        assert EITHER_WAY in asked(blobs, wrong, model, Edits([other])).suspects[-1].words


def test_two_cameras_or_a_moment_tell_nothing(named, blobs, model):
    wrong = exchanged(named, model)
    assert asked(blobs, wrong, model, cameras=CAMERAS.select([0, 1])).labels is wrong.labels
    moment = shown_in(wrong, 20)
    assert asked(blobs, moment, model).labels is moment.labels


def shown_in(chunk: LabelledChunk, frames: int) -> LabelledChunk:
    """The chunk with the body in its last frames only."""
    expected = chunk.motion.expected.copy()
    expected[: len(expected) - frames] = np.nan
    return replace(chunk, motion=replace(chunk.motion, expected=expected))


def test_names_of_a_moment_before_are_in_doubt_as_well_unless_nobody_was_there_since(named, blobs, model):
    wrong = exchanged(named, model)
    parts = [replace(blobs, frames=blobs.frames + 40 * number) for number in range(4)]
    shown = [shown_in(wrong, frames) for frames in (20, 0, 20, 40)]
    found = list(asked_in_space(parts, shown, CAMERAS, Asked(model.markerset, model, 0, RATE, 0.999, NO_EDITS)))
    taken = [chunk.labels is not before.labels for chunk, before in zip(found, shown, strict=True)]
    assert taken == [False, False, True, True]
    assert len({tuple(chunk.labels.marker) for chunk in found[2:]}) == 1


def test_what_the_first_chunk_shows_holds_for_all(named, blobs, model):
    wrong, parts = exchanged(named, model), cut(blobs, 40)
    asked = Asked(model.markerset, model, 0, RATE, 0.999, NO_EDITS)
    given = asked_in_space([*parts, *parts], [wrong, wrong], CAMERAS, asked)
    assert len({tuple(chunk.labels.marker) for chunk in given}) == 1
