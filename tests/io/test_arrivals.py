# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that arrive in a folder: begun when they are whole, once, and nothing that is no take."""

import json
import os
import time

import pytest

from addon.io.arrivals import Arrivals
from addon.io.batch import TakeRow, write_table


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
    write_table(tmp_path / "summary.csv", [TakeRow("a", "a.csv", "failed")])
    watched.look(0)
    assert watched.look(3) == [tmp_path / "walk.csv"]
    assert watched.passed == []
    assert not watched.is_arriving(3)


def test_of_files_of_one_name_what_was_recorded_is_the_take(watched, tmp_path):
    put(tmp_path / "walk.trc")
    put(tmp_path / "Walk.c3d")
    assert watched.look(0) == []
    qtm = put(tmp_path / "walk.qtm")
    assert watched.look(2) == []
    assert watched.look(4) == []  # those that are whole wait for the one before them
    assert watched.look(5) == [qtm]
    assert len(watched.passed) == 2
    assert all("is left out, because walk.qtm has the same results; expected" in words for words in watched.passed)
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
