# SPDX-License-Identifier: GPL-3.0-or-later
"""Nothing is lost on a take's whole way through a real Blender's window; `tours/room.py` walks, this file judges."""

import pytest

from scripts.virtual_take import write_virtual_points

pytestmark = [pytest.mark.real_blender, pytest.mark.window, pytest.mark.slow]
FRAMES, FRAME = 120, 40
KEPT = ("range", "edits", "fills", "answered")


@pytest.fixture(scope="module")
def room(watch, tmp_path_factory):
    folder = tmp_path_factory.mktemp("room")
    write_virtual_points(folder, FRAMES)
    task = {"points": str(folder / "walk.c3d"), "markerset": "body26", "frame": FRAME}
    return watch("room", folder, **task)


def test_a_key_shows_what_is_meant_from_where_one_looks(room):
    place, before, after = room["view"]
    assert max(map(abs, place)) < 8, "it was looked at 9 9 9, where nobody is"
    assert after == pytest.approx(before, abs=1e-5)


def test_keys_correct_and_answer(room):
    assert room["labelled"]["edits"] == []
    unlabelled, *answers = room["corrected"]["edits"]
    assert "has no name" in unlabelled
    assert answers
    assert len(room["corrected"]["answered"]) == 1
    assert room["corrected"]["lost"] < room["labelled"]["lost"]


def test_what_is_said_filled_and_cut_reaches_the_file(room):
    labelled, corrected, filled = (room[step] for step in ("labelled", "corrected", "filled"))
    assert filled["fills"]
    assert len({labelled["file"], corrected["file"], filled["file"]}) == 3
    assert filled["edits"] == corrected["edits"]


@pytest.mark.parametrize("step", ["labelled again", "undone", "redone", "reopened"])
def test_nothing_is_lost(room, step):
    assert {what: room[step][what] for what in KEPT} == {what: room["filled"][what] for what in KEPT}


def test_undo_brings_the_labels_and_the_file_back_that_were_before(room):
    assert (room["undone"]["labels"], room["undone"]["file"]) == (room["filled"]["labels"], room["filled"]["file"])


def test_a_reopened_file_is_what_was_saved(room):
    assert room["reopened"] == room["redone"]
