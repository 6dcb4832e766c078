# SPDX-License-Identifier: GPL-3.0-or-later
"""`label FOLDER --watch`: takes that arrive are labelled, the summary follows, and who stops it stops it."""

import _thread
import json
import shutil
import threading
from functools import partial
from pathlib import Path

import pytest

from addon.cli.label import watching
from addon.io.arrivals import Arrivals
from addon.io.batch import read_table
from tests.faults.stage import wait_for
from tests.io.pages import read

from .conftest import lengthened

FEW = ("--watch", "--frames", "100:101")
LONG = 200  # times the walk


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder to be watched, where a file is whole as soon as it stays as it is for a moment."""
    monkeypatch.setattr(watching, "Arrivals", partial(Arrivals, look_s=0.1, settled_s=0.3))
    (tmp_path / "in").mkdir()
    return tmp_path / "in"


@pytest.fixture
def meanwhile():
    """Lets somebody do something while a command runs, and stop it by Ctrl-C in the end, whatever happens."""

    def start(steps):
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
        return thread, failed

    return start


def states(out) -> dict[str, str]:
    """What has become of each take, as the table says; nothing where there is none yet."""
    table = out / "summary.csv"
    return {row.source: row.state for row in read_table(table)} if table.exists() else {}


def arrive(source: Path, target: Path):
    """Copies a file whole at once, which a busy machine may stop over in the middle else."""
    Path(shutil.copy(source, target.parent.with_suffix(".part"))).replace(target)


def test_takes_are_labelled_as_they_arrive_until_somebody_stops_it(label, room, folder, tmp_path, meanwhile):
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

    thread, failed = meanwhile(steps())
    answer = label(*FEW, "--summary", "--html", "--jobs", "2", blobs=[folder])
    thread.join()
    assert failed == []
    assert (answer.status, answer.err) == (0, "")
    said = answer.out.splitlines()
    assert sorted(line.partition(":")[0] for line in said[:4]) == ["bad", "bad", "one", "two"]
    assert sum(line.startswith("bad: failed, ") for line in said) == 1
    assert sorted(line.split()[0] for line in said[4:]) == ["bad", "one", "take", "two"]
    links = [each["href"] for each in read(out / "summary.report.html").of("a")]
    assert sorted(links) == ["./bad.report.html", "./one.report.html", "./two.report.html"]
    assert all((out / link).is_file() for link in links)
    assert {path.suffix for path in out.iterdir()} == {".csv", ".c3d", ".html", ".json"}


def test_a_watch_goes_on_where_it_was_and_ends_when_nothing_comes_and_replaces_nothing(label, room, folder):
    shutil.copy(room.blobs, folder / "one.csv")
    words = (*FEW, "--idle", "0", "--out", folder, "--summary", "--json")
    first = json.loads(label(*words, blobs=[folder]).out)
    assert [report["take"] for report in first["takes"]] == ["one"]
    assert first["table"] == str(folder / "summary.csv")
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir() if path.name.startswith("one.")}
    shutil.copy(room.blobs, folder / "two.csv")
    again = json.loads(label(*words, "--resume", blobs=[folder]).out)
    assert [report["take"] for report in again["takes"]] == ["one", "two"]
    assert again["passed_over"] == ["one"]
    assert before == {path: path.stat().st_mtime_ns for path in before}
    assert states(folder) == {"one.csv": "done before", "two.csv": "labelled"}
    (folder / "one.edits.json").write_text('{"version": 1, "edits": []}')
    reason = label(*words, "--resume", blobs=[folder]).refusal(2)
    assert "differs in edits; expected the same as then, --overwrite to make it anew" in reason
    assert before == {path: path.stat().st_mtime_ns for path in before}
    assert states(folder) == {"one.csv": "failed", "two.csv": "done before"}


def test_who_stops_a_watch_leaves_nothing_half_written(label, room, folder, tmp_path, meanwhile):
    lengthened(room.blobs, folder / "long.csv", LONG)
    out = tmp_path / "out"

    def steps():
        yield lambda: list(out.glob(".part-mocap-autolabel-*/long.*"))

    thread, failed = meanwhile(steps())
    answer = label("--watch", "--summary", blobs=[folder])
    thread.join()
    assert failed == []
    assert answer.status == 1
    assert answer.err.endswith("stopped before the end; nothing half-written was left\n")
    assert states(out) == {"long.csv": "waiting"}
    assert sorted(path.name for path in out.iterdir()) == ["summary.csv", "summary.report.html"]


def test_a_summary_is_written_only_where_it_may_be(label, folder, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "summary.csv").write_text("my own")
    for more in ((), ("--resume",)):
        assert "summary.csv: exists already" in label(*FEW, "--idle", "0", "--summary", *more, blobs=[folder]).reason
    assert (tmp_path / "out" / "summary.csv").read_text() == "my own"


def test_a_batch_that_is_named_take_by_take_has_a_table_too(label, room, tmp_path):
    bad = tmp_path / "bad.csv"
    bad.write_text("frame,camera,x,y\n1,nobody,0,0\n")
    said = json.loads(label("--frames", "100:100", "--summary", "--json", blobs=[room.blobs, bad]).out)
    rows = read_table(tmp_path / "out" / "summary.csv")
    assert [(row.take, row.state) for row in rows] == [("bad", "failed"), ("walk", "labelled")]
    assert said["table"] == str(tmp_path / "out" / "summary.csv")
    text = label("--frames", "100:100", "--summary", "--resume", blobs=[room.blobs, bad]).out
    assert text.index("bad ") < text.index("walk  ")
    assert [row.state for row in read_table(tmp_path / "out" / "summary.csv")] == ["failed", "done before"]
