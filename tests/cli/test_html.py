# SPDX-License-Identifier: GPL-3.0-or-later
"""`label --html`: a page for each take, whole or not at all with its other files, and one over several takes."""

import errno
import hashlib
import json
import os

from addon.core.data.wording import count_of
from addon.io.html import pages as take_pages
from addon.jobs import pages
from tests.io.pages import read

FEW = ("--frames", "100:103")
FEWEST = ("--frames", "100:100")


def full(*_):
    """Writes to a full disk."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_take_of_blobs_has_a_page_beside_its_other_files(label, room, tmp_path):
    edits = tmp_path / "mine.json"
    said = [
        {"kind": "unlabel", "marker": "C7", "frames": [101, 102]},
        {"kind": "assign", "camera": "cam1", "frame": 103, "x": 2, "y": 3, "marker": "LASI"},
    ]
    edits.write_text(json.dumps({"version": 1, "edits": said}))
    out = tmp_path / "out"
    assert label(*FEW, "--html", "--fill", "--edits", edits).status == 0
    report = json.loads((out / "walk.report.json").read_text())
    assert sorted(report["provenance"]["results"]) == [".c3d", ".labels.csv", ".report.html"]
    text = read(out / "walk.report.html").words
    share = 100 * (report["blobs"] - report["unlabelled"]) / report["blobs"]
    for words in (
        f"{share:.1f} % of {report['blobs']:,} blobs named",
        "4 frames (0.0 s)",
        "Nothing is C7, frames 101–102",
        "cam1 has no blob within 2 px of 2, 3 in frame 103",
        f"{count_of(len(report['filled']), 'gap')} filled by the program, {len(report['left'])} left",
        "Nobody gave the rate: 100 frames a second were assumed",
        "cam8",
        "Edits from mine.json",
        "Where every sample is from",
        f"Input walk.csv, SHA-256 {hashlib.sha256(room.blobs.read_bytes()).hexdigest()}",
        "Model body26, SHA-256",
        "Edits mine.json, SHA-256",
        f"Result walk.c3d, SHA-256 {report['provenance']['results']['.c3d']}",
    ):
        assert words in text, words
    assert not (out / "summary.report.html").exists()
    assert ", done before\n" in label(*FEW, "--html", "--fill", "--edits", edits, "--resume").out


def test_a_page_that_cannot_be_written_costs_all_files(label, tmp_path, monkeypatch):
    monkeypatch.setattr(take_pages, "write_take_page", full)
    assert "No space left on device" in label(*FEW, "--html").reason
    assert list((tmp_path / "out").iterdir()) == []


def test_several_takes_have_a_page_over_all_of_them(label, copies, tmp_path):
    out = tmp_path / "out"
    inputs = copies("one", "two", "broken")
    inputs[2].write_text("no,blobs\n")
    answer = label(*FEWEST, "--html", "--jobs", "2", blobs=inputs)
    assert answer.status == 2
    assert f"over all takes: {out / 'summary.report.html'}" in answer.out
    page = read(out / "summary.report.html")
    links = [each["href"] for each in page.of("a")]
    assert sorted(links) == ["./one.report.html", "./two.report.html"]
    assert all((out / link).is_file() for link in links)
    assert "2 takes labelled, 1 failed" in page.words
    assert "broken" in page.words
    assert str(tmp_path) not in (out / "summary.report.html").read_text(encoding="utf-8")
    assert "would be written twice" in label(*FEWEST, "--html", blobs=copies("summary", "three")).reason


def test_a_page_over_takes_that_cannot_be_written_costs_nothing_else(label, copies, tmp_path, monkeypatch):
    monkeypatch.setattr(pages, "write_folder_page", full)
    answer = label(*FEWEST, "--html", "--json", blobs=copies("one", "two"))
    assert "No space left on device" in answer.reason
    assert [report["take"] for report in json.loads(answer.out)["takes"]] == ["one", "two"]
    assert len(list((tmp_path / "out").glob("*.report.html"))) == 2


def test_a_page_over_takes_is_replaced_only_by_who_may(label, copies, tmp_path):
    out, inputs = tmp_path / "out", copies("one", "two")
    assert json.loads(label(*FEWEST, "--html", "--json", blobs=inputs).out)["summary"] == str(
        out / "summary.report.html"
    )
    (out / "one.report.json").unlink()
    (out / "two.report.json").unlink()
    for path in (*out.glob("one.*"), *out.glob("two.*")):
        path.unlink()
    assert "summary.report.html: exists already" in label(*FEWEST, "--html", blobs=inputs).reason
    assert [path.name for path in out.iterdir()] == ["summary.report.html"]
    assert label(*FEWEST, "--html", "--resume", blobs=inputs).status == 0
    (out / "summary.report.html").write_text("my own")
    assert "summary.report.html: exists already" in label(*FEWEST, "--html", "--resume", blobs=inputs).reason
    assert (out / "summary.report.html").read_text() == "my own"
    assert label(*FEWEST, "--html", "--resume", "--overwrite", blobs=inputs).status == 0
    assert "2 takes labelled" in read(out / "summary.report.html").words
