# SPDX-License-Identifier: GPL-3.0-or-later
"""`label --overwrite`: what an earlier run wrote and this one does not is not taken for its results."""

import json
import os
import shutil

import pytest

from addon.demo.take import MODEL

ALWAYS = {"take.labels.csv", "take.c3d", "take.report.json"}


@pytest.fixture
def label(run, room, tmp_path):
    """Labels a few frames of `tmp_path/take.c3d` into `tmp_path/out`; gives the report."""
    shutil.copy(room.c3d, tmp_path / "take.c3d")

    def call(*words, source=tmp_path / "take.c3d"):
        answer = run("label", source, "--model", MODEL, "--out", tmp_path / "out", "--frames", ":110", *words)
        assert answer.status == 0, answer.reason
        call.said = answer.out
        return json.loads((tmp_path / "out" / "take.report.json").read_text())

    return call


def names_in(folder):
    return {path.name for path in folder.iterdir()}


def test_files_that_only_the_earlier_run_wrote_stay_and_are_told(label, tmp_path):
    label("--trc", "--html")
    out = tmp_path / "out"
    before = (out / "take.trc").read_bytes()
    (out / "taken.trc").write_text("somebody's")
    report = label("--overwrite", "--html")
    assert report["notes"] == ["take.trc is not of this run, and stays as it is"]
    assert report["notes"][0] in label.said
    assert (out / "take.trc").read_bytes() == before
    assert len(label("--overwrite")["notes"]) == 2
    assert names_in(out) == ALWAYS | {"take.trc", "take.report.html", "taken.trc"}


@pytest.mark.skipif(os.name == "nt", reason="links need leave there")
@pytest.mark.parametrize("link", [False, True])
def test_an_earlier_result_that_is_read_now_stays(label, tmp_path, link):
    label("--trc")
    source = tmp_path / "out" / "take.trc"
    if link:
        (tmp_path / "elsewhere").mkdir()
        os.link(source, tmp_path / "elsewhere" / "take.trc")
    before = source.read_bytes()
    label("--overwrite", source=tmp_path / "elsewhere" / "take.trc" if link else source)
    assert source.read_bytes() == before


def test_a_run_that_fails_takes_nothing_away(label, run, tmp_path):
    label("--trc")
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    words = "--model", MODEL, "--out", tmp_path / "out", "--overwrite", "--frames", "900000:"
    assert run("label", tmp_path / "take.c3d", *words).status != 0
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before
