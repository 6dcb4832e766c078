# SPDX-License-Identifier: GPL-3.0-or-later
"""Work that is handed to another process: what comes of it is what would here, and its end is told in a sentence."""

import sys
from functools import partial
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from addon.cli import serving
from addon.cli.parcels import read_parcel, write_parcel
from addon.cli.workers import Worker
from addon.core.data.errors import ForceableError
from addon.core.data.progress import finished
from addon.demo.take import MODEL
from addon.io.markersets import open_markerset
from addon.jobs import LabelJob, label_to_show
from tests.faults.stage import wait_for


def looked_at(worker):
    found = []
    wait_for(lambda: found.append(worker.look()) or found[-1] is not None)
    return found[-1]


@pytest.fixture
def worker(tmp_path):
    worker = Worker(tmp_path)
    yield worker
    worker.close()
    worker.process.wait(120)


def test_what_is_handed_over_is_the_same_on_the_other_side(tmp_path):
    body, table = open_markerset(MODEL), np.asfortranarray(np.arange(6.0).reshape(2, 3))
    given = [1, 0.5, float("nan"), None, True, "ü\ud800", (Path("a b"), {Path("c"): (np.int64(3),)}), table, body, body]
    write_parcel(tmp_path / "one", given)
    found = read_parcel(tmp_path / "one")
    assert repr(found[:7]) == repr([*given[:6], (Path("a b"), {Path("c"): (3,)})])
    assert np.array_equal(found[7], table)
    assert found[8] is found[9] and found[8].markers == body.markers
    assert np.array_equal(found[8].skeleton.offsets, body.skeleton.offsets)
    write_parcel(tmp_path / "two", ForceableError("odd; expected even", "a.c3d", 3))
    trouble = read_parcel(tmp_path / "two")
    assert (type(trouble), str(trouble)) == (ForceableError, "a.c3d:3: odd; expected even")


@pytest.mark.parametrize("thing", [object(), open, np.dtype(float), {1, 2}, lambda: None])
def test_nothing_else_is_handed_over(tmp_path, thing):
    with pytest.raises((TypeError, AttributeError)):
        write_parcel(tmp_path / "one", [thing])


def test_a_take_is_labelled_elsewhere_as_it_is_here_by_a_process_that_is_kept(worker, room):
    work = partial(label_to_show, LabelJob(room.c3d, None, MODEL, Path(), keep=True, html=True))
    here, _ = finished(work())
    for _ in range(2):
        worker.hand(work)
        there, changed = looked_at(worker)
        assert changed is None
        assert not worker.busy
        [(rows, chunk)], [(own_rows, own)] = there.chunks, here.chunks
        for name in ("marker", "step", "confidence"):
            assert np.array_equal(getattr(chunk.labels, name), getattr(own.labels, name), equal_nan=True)
        assert np.array_equal(chunk.motion.markers, own.motion.markers, equal_nan=True)
        assert np.array_equal(rows.xyz, own_rows.xyz)
        assert there.report["markers"] == here.report["markers"]
        assert there.worn.markers == here.worn.markers


def test_how_far_the_work_is_is_told(monkeypatch, room, tmp_path):
    said = StringIO()
    monkeypatch.setattr(sys, "__stdout__", said)
    monkeypatch.setattr(serving, "WORD_EVERY", 0.0)
    monkeypatch.setattr(serving, "left", lambda: False)
    write_parcel(tmp_path / "work", partial(label_to_show, LabelJob(room.c3d, None, MODEL, Path(), keep=True)))
    assert serving.run_work(tmp_path / "result", tmp_path / "work") == 0
    words = [line.partition(serving.SHARE)[2] for line in said.getvalue().splitlines()]
    shares = [float(word) for word in words if word]
    assert shares == sorted(shares) and 0.0 < shares[-1] <= 1.0


def test_trouble_elsewhere_is_told_here_and_a_process_that_nobody_waits_for_ends(worker, room, tmp_path):
    worker.hand(partial(label_to_show, LabelJob(tmp_path / "none.c3d", None, MODEL, Path())))
    assert str(looked_at(worker)).startswith(f"{tmp_path / 'none.c3d'}: there is no such file")
    work = partial(label_to_show, LabelJob(room.c3d, None, MODEL, Path(), keep=True))
    worker.hand(work)
    worker.process.kill()
    assert "its process was killed" in str(looked_at(worker)) or worker.process.returncode > 0
    other = Worker(tmp_path)
    other.hand(work)
    other.close()
    wait_for(lambda: other.process.poll() is not None)
