# SPDX-License-Identifier: GPL-3.0-or-later
"""`label --watch`, `--html` and `--summary`: takes that arrive are labelled; a page for each, and one over several."""

import _thread
import hashlib
import json
import shutil
import threading
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest

from addon.cli.label import watching
from addon.core.data.wording import count_of
from addon.io.arrivals import Arrivals
from addon.io.batch import read_table
from addon.io.html import pages as take_pages
from addon.jobs import pages
from tests.faults.stage import wait_for
from tests.io.pages import read

from .conftest import lengthened, no_room, report_of

WATCH = ("--watch", "--frames", "100:101")
FEW = ("--frames", "100:103")
FEWEST = ("--frames", "100:100")
LONG = 200  # times the walk


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder to be watched, where a file is whole as soon as it stays as it is for a moment."""
    monkeypatch.setattr(watching, "Arrivals", partial(Arrivals, look_s=0.1, settled_s=0.3))
    (tmp_path / "in").mkdir()
    return tmp_path / "in"


@contextmanager
def meanwhile(steps):
    """Lets somebody do something while a command runs, and stop it by Ctrl-C in the end, whatever happens."""
    failed = []

    def act():
        try:
            for ready in steps:
                wait_for(ready)
        except Exception as error:  # noqa: BLE001 - told where it is seen
            failed.append(error)
        _thread.interrupt_main()

    thread = threading.Thread(target=act, daemon=True)
    thread.start()
    yield
    thread.join()
    assert failed == []


def states(out) -> dict[str, str]:
    """What has become of each take, as the table says; nothing where there is none yet."""
    table = out / "summary.csv"
    return {row.source: row.state for row in read_table(table)} if table.exists() else {}


def arrive(source: Path, target: Path):
    """Copies a file whole at once, which a busy machine may stop over in the middle else."""
    Path(shutil.copy(source, target.parent.with_suffix(".part"))).replace(target)


def test_takes_are_labelled_as_they_arrive_until_somebody_stops_it(label, room, folder, tmp_path):
    out = tmp_path / "out"
    shutil.copy(room.blobs, folder / "one.csv")
    shutil.copy(room.truth, folder / "one.csv.truth.csv")
    (folder / "bad.csv").write_text("no,blobs\n")

    def steps():
        yield lambda: states(out) == {"one.csv": "labelled", "bad.csv": "failed"}
        arrive(room.blobs, folder / "two.csv")
        yield lambda: states(out).get("two.csv") == "labelled"
        arrive(room.blobs, folder / "bad.csv")
        yield lambda: states(out).get("bad.csv") == "labelled"

    with meanwhile(steps()):
        said = label(*WATCH, "--summary", "--html", "--jobs", "2", blobs=[folder]).quiet().out.splitlines()
    assert sorted(line.partition(":")[0] for line in said[:4]) == ["bad", "bad", "one", "two"]
    assert sum(line.startswith("bad: failed, ") for line in said) == 1
    assert sorted(line.split()[0] for line in said[4:]) == ["bad", "one", "take", "two"]
    links = [each["href"] for each in read(out / "summary.report.html").of("a")]
    assert sorted(links) == ["./bad.report.html", "./one.report.html", "./two.report.html"]
    assert all((out / link).is_file() for link in links)
    assert {path.suffix for path in out.iterdir()} == {".csv", ".c3d", ".html", ".json"}


def test_a_watch_goes_on_where_it_was_and_ends_when_nothing_comes_and_replaces_nothing(label, room, folder):
    shutil.copy(room.blobs, folder / "one.csv")
    words = (*WATCH, "--idle", "0", "--out", folder, "--summary", "--json")
    (folder / "none.c3d").touch()
    answer = label(*words, blobs=[folder]).done()
    assert f"{folder / 'none.c3d'}: is empty, and was left out; expected a file with content" in answer.err
    first = answer.json
    assert [report["take"] for report in first["takes"]] == ["one"]
    assert first["table"] == str(folder / "summary.csv")
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir() if path.name.startswith("one.")}
    shutil.copy(room.blobs, folder / "two.csv")
    again = label(*words, "--resume", blobs=[folder]).json
    assert [report["take"] for report in again["takes"]] == ["one", "two"]
    assert again["passed_over"] == ["one"]
    assert before == {path: path.stat().st_mtime_ns for path in before}
    assert states(folder) == {"one.csv": "done before", "two.csv": "labelled"}
    (folder / "one.edits.json").write_text('{"version": 1, "edits": []}')
    reason = label(*words, "--resume", blobs=[folder]).refusal(2)
    assert "differs in edits; expected the same as then, --overwrite to make it anew" in reason
    assert before == {path: path.stat().st_mtime_ns for path in before}
    assert states(folder) == {"one.csv": "failed", "two.csv": "done before"}


def test_who_stops_a_watch_leaves_nothing_half_written(label, room, folder, tmp_path):
    lengthened(room.blobs, folder / "long.csv", LONG)
    out = tmp_path / "out"
    with meanwhile([lambda: list(out.glob(".part-mocap-autolabel-*/long.*"))]):
        answer = label("--watch", "--summary", blobs=[folder])
    assert answer.status == 1
    assert answer.err.endswith("stopped before the end; nothing half-written was left\n")
    assert states(out) == {"long.csv": "waiting"}
    assert sorted(path.name for path in out.iterdir()) == ["summary.csv", "summary.report.html"]


def test_a_take_of_blobs_has_a_page_beside_its_other_files(label, room, tmp_path):
    edits = tmp_path / "mine.json"
    said = [
        {"kind": "unlabel", "marker": "C7", "frames": [101, 102]},
        {"kind": "assign", "camera": "cam1", "frame": 103, "x": 2, "y": 3, "marker": "LASI"},
    ]
    edits.write_text(json.dumps({"version": 1, "edits": said}))
    out = tmp_path / "out"
    assert label(*FEW, "--html", "--fill", "--edits", edits).status == 0
    report = report_of(out / "walk.c3d")
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


def test_several_takes_have_a_page_and_a_table_over_all_of_them(label, copies, tmp_path):
    out, inputs = tmp_path / "out", copies("one", "two", "broken")
    inputs[2].write_text("no,blobs\n")
    answer = label(*FEWEST, "--html", "--summary", "--jobs", "2", blobs=inputs)
    assert answer.status == 2
    assert f"over all takes: {out / 'summary.report.html'}" in answer.out
    page = read(out / "summary.report.html")
    links = [each["href"] for each in page.of("a")]
    assert sorted(links) == ["./one.report.html", "./two.report.html"]
    assert all((out / link).is_file() for link in links)
    assert "2 takes labelled, 1 failed" in page.words and "broken" in page.words
    assert str(tmp_path) not in (out / "summary.report.html").read_text(encoding="utf-8")
    assert states(out) == {"broken.csv": "failed", "one.csv": "labelled", "two.csv": "labelled"}
    text = label(*FEWEST, "--html", "--summary", "--resume", blobs=inputs).out
    assert text.index("broken ") < text.index("one  ")
    told = [("broken.csv", "failed"), ("one.csv", "done before"), ("two.csv", "done before")]
    assert list(states(out).items()) == told
    assert "would be written twice" in label(*FEWEST, "--html", blobs=copies("summary", "three")).reason


def test_a_page_that_cannot_be_written_costs_all_files_of_its_take_and_one_over_takes_itself(
    label, copies, tmp_path, monkeypatch
):
    inputs, out = copies("one", "two"), tmp_path / "out"
    with monkeypatch.context() as changed:
        changed.setattr(take_pages, "write_take_page", lambda *_: no_room())
        assert "No space left on device" in label(*FEW, "--html", blobs=inputs[:1]).reason
    assert not out.exists()
    monkeypatch.setattr(pages, "write_folder_page", lambda *_: no_room())
    answer = label(*FEWEST, "--html", "--json", blobs=inputs)
    assert "No space left on device" in answer.reason
    assert [report["take"] for report in answer.json["takes"]] == ["one", "two"]
    assert len(list(out.glob("*.report.html"))) == 2


def test_what_is_over_all_takes_is_replaced_only_by_who_may(label, copies, folder, tmp_path):
    out, inputs, words = tmp_path / "out", copies("one", "two"), (*FEWEST, "--html", "--summary")
    watched = (*WATCH, "--idle", "0", "--summary")
    said = label(*words, "--json", blobs=inputs).json
    files = {Path(said[key]): Path(said[key]).read_bytes() for key in ("summary", "table")}
    for path in set(out.iterdir()) - set(files):
        path.unlink()
    assert "exists already" in label(*words, blobs=inputs).reason
    assert "exists already" in label(*watched, blobs=[folder]).reason
    for path, content in files.items():
        path.write_text("my own")
        assert f"{path.name}: exists already" in label(*words, "--resume", blobs=inputs).reason
        assert f"{path.name}: exists already" in label(*watched, "--resume", blobs=[folder]).reason
        assert path.read_text() == "my own"
        path.write_bytes(content)
    assert set(out.iterdir()) == set(files)
    assert label(*words, "--resume", blobs=inputs).status == 0
    path.write_text("my own")
    assert label(*words, "--resume", "--overwrite", blobs=inputs).status == 0
    assert "2 takes labelled" in read(out / "summary.report.html").words
