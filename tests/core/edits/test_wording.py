# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits in words: every kind has some, with its frames as they are counted where they are shown."""

import pytest

from addon.core.edits.kinds import (
    EDIT_KINDS,
    Accepted,
    AssignBlob,
    AssignPoint,
    Delete,
    DeleteBlob,
    Place,
    Right,
    Swap,
    UnlabelBlob,
    UnlabelMarker,
    UnlabelPoint,
    counted_on,
    words_of,
)

WORDS = {
    AssignPoint(12, "LKNE", frames=(100, 250)): "LKNE is trajectory 12, frames 100–250",
    AssignPoint(12, "LKNE", frames=(100, 100)): "LKNE is trajectory 12, frame 100",
    AssignBlob("cam1", 100, 512.3, 88.1, "LKNE"): "LKNE is the blob at 512 88 of cam1, frame 100",
    AssignBlob("cam1", 100, 1, 2, "LKNE", frames=(90, 100)): "LKNE is the blob at 1 2 of cam1, frames 90–100",
    UnlabelBlob("cam1", 100, 512.3, 88.1): "The blob at 512 88 of cam1 has no name, frame 100",
    DeleteBlob("cam1", 100, 512.3, 88.1): "The blob at 512 88 of cam1 is no marker, frame 100",
    UnlabelMarker("LKNE"): "Nothing is LKNE, all frames",
    UnlabelPoint(12): "Trajectory 12 has no name, all frames",
    Swap(("LKNE", "RKNE"), frames=(1, 2)): "LKNE and RKNE swapped, frames 1–2",
    Delete(7): "Trajectory 7 is no marker, all frames",
    Place("LKNE", 120, (0.1, 0.2, 0.5)): "LKNE is placed by hand, frame 120",
    Right("LKNE"): "LKNE is right, all frames",
    Accepted("camera B is off", frames=(1, 2)): "It is right that camera B is off, frames 1–2",
}


def test_every_kind_has_words():
    assert {type(edit) for edit in WORDS} == set(EDIT_KINDS)
    assert {edit: words_of(edit) for edit in WORDS} == WORDS


@pytest.mark.parametrize(
    ("words", "shifted"),
    [
        ("LKNE jumps in frame -7, by 30 mm", "LKNE jumps in frame 3, by 30 mm"),
        ("not in frames -9–-2; 3 of 40 frames", "not in frames 1–8; 3 of 40 frames"),
        ("edit 2 is about frames 5 to 12", "edit 2 is about frames 15 to 22"),
        ("trajectory 12 has no name", "trajectory 12 has no name"),
    ],
)
def test_a_sentence_names_frames_as_they_are_counted_elsewhere(words, shifted):
    assert counted_on(words, 10) == shifted
    assert counted_on(words, 0) == words
