# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that arrive in a folder, each begun once when it is whole; and the table over a batch of them."""

import csv
import json
import os
import re
import time
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.io.arrivals import Arrivals
from addon.io.batch import TABLE_COLUMNS, TAKE_STATES, TakeRow, is_table, read_table, row_of, worst_first, write_table
from tests.io.checks import refused
from tests.io.samples import tsv


def put(path, text="frame,camera,x,y\n"):
    """Writes a file that is in another state than before, however coarse the clock of its file system is."""
    path.write_text(text)
    later = time.time_ns() + put.count * 1_000_000_000
    put.count += 1
    os.utime(path, ns=(later, later))
    return path


put.count = 1


@pytest.fixture
def watched(tmp_path):
    return Arrivals([tmp_path])


def test_a_take_is_there_when_it_stays_as_it_is(watched, tmp_path):
    one = put(tmp_path / "one.csv", "")
    assert watched.look(0) == []
    assert watched.look(9) == []  # still empty
    assert watched.empty == [one]
    put(one, "frame")
    assert watched.look(10) == []
    assert watched.is_arriving(10)
    put(one, "frame,camera,x,y\n")
    assert watched.look(12.9) == []
    assert watched.look(15.8) == []
    assert watched.look(15.9) == [one]
    assert not watched.is_arriving(15.9)
    assert watched.try_now(one)
    assert watched.look(30) == []


def test_a_take_is_tried_again_only_when_it_or_its_edits_change(watched, tmp_path):
    one = put(tmp_path / "one.csv")
    watched.look(0)
    assert watched.look(3) == [one]
    assert watched.try_now(one)
    put(one, "longer than before")
    assert not watched.try_now(one)
    watched.look(4)
    assert watched.look(7) == [one]
    assert watched.try_now(one)
    put(tmp_path / "one.edits.json", "{}")
    watched.look(8)
    assert watched.look(11) == [one]
    one.unlink()
    assert not watched.try_now(one)
    assert watched.look(20) == []


def test_what_is_no_take_is_left_alone(watched, tmp_path):
    for name in ("walk.csv.truth.csv", "walk.labels.csv", "walk.edits.json", "room.toml", ".hidden.c3d", "~$x.csv"):
        put(tmp_path / name)
    (tmp_path / "folder.csv").mkdir()
    put(tmp_path / "walk.csv")
    put(tmp_path / "walk.c3d")  # what was made of walk.csv
    put(tmp_path / "walk.report.json", json.dumps({"made_of": {"options": {}, "results": {".c3d": "…"}}}))
    put(tmp_path / "full.c3d")
    put(tmp_path / "full.filled.csv")
    put(tmp_path / "walk_6d.tsv", "NO_OF_FRAMES\t5\nDATA_INCLUDED\t6D\n")  # QTM's, beside the points
    write_table(tmp_path / "summary.csv", [TakeRow("a", "a.csv", "failed")])
    watched.look(0)
    assert watched.look(3) == [tmp_path / "walk.csv"]
    assert watched.passed == []
    assert not watched.is_arriving(3)


def test_a_tsv_is_left_alone_only_where_it_says_that_it_is_no_take(watched, tmp_path):
    (tmp_path / "wide.tsv").write_text(tsv(), encoding="utf-16")
    put(tmp_path / "cut.tsv", "NO_OF_FRAMES\t5\nNO_OF_")
    (tmp_path / "wide_6d.tsv").write_text(tsv().replace("\t3D", "\t6D"), encoding="utf-16")
    (tmp_path / "small.tsv").write_text(tsv().replace("\t3D", "\t3d"))
    watched.look(0)
    assert watched.look(3) == [tmp_path / "cut.tsv", tmp_path / "small.tsv", tmp_path / "wide.tsv"]


def test_of_files_of_one_name_what_was_recorded_is_the_take(watched, tmp_path):
    put(tmp_path / "walk.trc")
    put(tmp_path / "Walk.c3d")
    assert watched.look(0) == []
    qtm = put(tmp_path / "walk.qtm")
    assert watched.look(2) == []
    assert watched.look(4) == []  # those that are whole wait for the one before them
    assert watched.look(5) == [qtm]
    assert len(watched.passed) == 2
    assert all(f"is left out, because {qtm} has the same results; expected" in words for words in watched.passed)
    assert watched.look(9) == [qtm]  # nobody began it yet
    assert len(watched.passed) == 2


def test_a_folder_that_is_away_for_a_while_is_said_once_and_keeps_its_takes(watched, tmp_path, monkeypatch):
    one = put(tmp_path / "one.csv")
    watched.look(0)
    assert watched.look(3) == [one]
    assert watched.try_now(one)
    with monkeypatch.context() as patched:
        patched.setattr(os, "scandir", lambda _: (_ for _ in ()).throw(OSError(5, "Input/output error")))
        assert watched.look(4) == watched.look(5) == []
    assert watched.passed == [f"{tmp_path}: cannot be read (Input/output error); expected a folder of takes"]
    assert watched.look(6) == watched.look(20) == []


TROUBLE = {"kind": "left over", "stake": 40.0, "answered": False, "trajectories": [3, 4]}
COUNTS = {"frames": 100, "frames_whole": 90, "points": 200, "unlabelled": 4}
REPORT = COUNTS | {
    "take": "walk",
    "version": "1.2.3",
    "to_look_at": "1 to look at",
    "trouble": [TROUBLE, TROUBLE | {"answered": True, "trajectories": [9]}, TROUBLE | {"kind": "missing", "stake": 2}],
    "timing": {"load": 1.0, "label": 2.5, "frames_per_second": 40.0},
    "markers": {"LASI": {"labelled_frames": 100}, "RASI": {"labelled_frames": 96}},
}


def test_a_row_says_what_the_report_says_and_the_worst_take_comes_first():
    row = row_of(REPORT, "walk.c3d")
    assert (row.trouble, row.at_stake, row.on_body, row.seconds) == (2, 42.0, 2, 3.5)
    assert (row.named, row.found, row.reason, row.gaps) == (0.98, 0.98, "1 to look at", None)
    cameras = {"a": {"unnamed_beside_markers": 5}, "b": {"unnamed_beside_markers": 1}, "c": {}}
    blobs = REPORT | {"blobs": 0, "cameras": cameras, "filled": [{}], "left": [{}, {}]}
    del blobs["points"]
    row = row_of(blobs, "walk.csv")
    assert (row.named, row.on_body, row.gaps) == (None, 6, (1, 3))
    labelled = row_of(REPORT, "b.c3d")
    worse = replace(labelled, state="done before", at_stake=50.0)
    less = replace(labelled, found=0.5)
    others = [TakeRow(state, "x.c3d", state) for state in ("waiting", "at work", "failed")]
    assert worst_first([labelled, *others, less, worse]) == [others[2], worse, less, labelled, others[1], others[0]]


letters = st.text(st.characters(codec="utf-8", exclude_characters="\0/"), min_size=1, max_size=12)
# The names of files may have bytes that are no letters.
names = letters | st.binary(min_size=1, max_size=12).map(lambda name: name.decode("utf-8", "surrogateescape"))
numbers = st.floats(0, 1e6)
count = st.integers(0, 99)
figures = count, numbers, st.none() | numbers, count, numbers, count, count, numbers
measured = st.builds(TakeRow, names, names, st.sampled_from(("labelled", "done before")), *figures, names, names)
others = st.builds(TakeRow, names, names, st.sampled_from(TAKE_STATES), reason=names)


@given(st.lists(measured | others.filter(lambda row: not row.measured), max_size=4))
def test_a_table_comes_back(tmp_path_factory, rows):
    path = tmp_path_factory.getbasetemp() / "summary.csv"
    write_table(path, rows)
    assert is_table(path)
    for was, row in zip(rows, read_table(path), strict=True):
        for name in TABLE_COLUMNS:
            value = getattr(was, name)
            assert getattr(row, name) == (pytest.approx(value, rel=1e-5) if isinstance(value, float) else value)


FORMULAS = ["=1+1", "@SUM(A1)", "+1", "-1", "'=1", "\uff1d1", "\x1b[2J", "\x9b2J", "a\nb", "\\u001b", "\\\x1b"]


@pytest.mark.parametrize("name", FORMULAS)
def test_a_name_is_no_formula_and_moves_no_cursor_in_a_table(tmp_path, name):
    path = tmp_path / "summary.csv"
    write_table(path, [TakeRow(name, f"{name}.c3d", "failed", reason=name)])
    text = path.read_text(encoding="utf-8")
    assert not re.search(r"[\x00-\x09\x0b\x0c\x0e-\x1f\x7f-\x9f]", text)
    [_, *rows] = text.splitlines()
    [row] = csv.reader(rows)
    assert not [cell for cell in row if re.match("[=+@\uff1d-]", cell)]
    assert (read_table(path)[0].take, read_table(path)[0].reason) == (name, name)


def test_what_is_no_table_is_refused(tmp_path):
    path = tmp_path / "summary.csv"
    for text in ("", "take,state\n", "frame,camera,x,y\n"):
        path.write_text(text)
        assert not is_table(path)
        refused("is no table of a batch; expected", read_table, path)
    write_table(path, [TakeRow("a", "a.c3d", "labelled")])
    for damaged in (b'"', b"a,b,c,no number\n", b"x," * 30 + b"\n"):
        path.write_bytes(path.read_bytes() + damaged)
        refused("is damaged; expected the table of a batch", read_table, path)
        path.write_bytes(path.read_bytes().removesuffix(damaged))
    assert not is_table(tmp_path / "none.csv")
