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


def test_files_that_only_the_earlier_run_wrote_go(label, tmp_path):
    label("--trc", "--html")
    assert names_in(tmp_path / "out") == ALWAYS | {"take.trc", "take.report.html"}
    report = label("--overwrite", "--html")
    assert names_in(tmp_path / "out") == ALWAYS | {"take.report.html"}
    assert report["notes"] == []
    label("--overwrite")
    assert names_in(tmp_path / "out") == ALWAYS


def test_a_file_that_was_changed_or_that_no_report_knows_stays_and_is_told(label, tmp_path):
    label("--trc")
    out = tmp_path / "out"
    (out / "take.trc").write_text("changed")
    for name in ("take.report.html", "take.mp4", "taken.trc"):
        (out / name).write_text("somebody's")
    for _ in range(2):  # the report that is there now knows nothing of them
        report = label("--overwrite")
        assert (out / "take.trc").read_text() == "changed"
        assert names_in(out) == ALWAYS | {"take.trc", "take.report.html", "take.mp4", "taken.trc"}
        words = [f"{name} is not of this run, and stays as it is" for name in ("take.trc", "take.report.html")]
        assert report["notes"] == words
        assert all(one in label.said for one in words)


def test_results_without_a_report_stay(label, tmp_path):
    label("--trc")
    (tmp_path / "out" / "take.report.json").unlink()
    label("--overwrite")
    assert "take.trc" in names_in(tmp_path / "out")


def test_nothing_else_goes_that_a_report_names(label, tmp_path):
    label()
    out = tmp_path / "out"
    report = json.loads((out / "take.report.json").read_text())
    report["made_of"]["results"][".edits.json"] = report["made_of"]["input"]
    shutil.copy(tmp_path / "take.c3d", out / "take.edits.json")
    (out / "take.report.json").write_text(json.dumps(report))
    label("--overwrite")
    assert "take.edits.json" in names_in(out)


def test_motion_stays_as_other_blender_files_may_play_from_it(label, tmp_path):
    label()
    out = tmp_path / "out"
    shutil.copy(tmp_path / "take.c3d", out / "take.motion.pc2")
    report = json.loads((out / "take.report.json").read_text())
    report["made_of"]["results"][".motion.pc2"] = report["made_of"]["input"]
    (out / "take.report.json").write_text(json.dumps(report))
    assert "take.motion.pc2 is not of this run" in label("--overwrite")["notes"][0]
    assert "take.motion.pc2" in names_in(out)


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
