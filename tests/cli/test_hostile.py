# SPDX-License-Identifier: GPL-3.0-or-later
"""What somebody may have put in a batch's way, any bytes as a name too: one take's trouble and one sentence at most."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from addon.cli.console import ProgressLine, print_results
from addon.demo.take import MODEL
from addon.io.batch import read_table
from addon.io.labels import LabelFile
from addon.io.points import read_points

ROOT = Path(__file__).resolve().parents[2]
any_bytes = pytest.mark.skipif(sys.platform != "linux", reason="only here any bytes are a name of a file")


@pytest.fixture
def takes(room, tmp_path):
    """A folder of results of the takes a, b and c, and the words that label them."""
    sources = [shutil.copy(room.c3d, tmp_path / f"{name}.c3d") for name in "abc"]
    return tmp_path / "out", ["label", *sources, "--model", MODEL, "--out", tmp_path / "out"]


BAD_REPORTS = [
    lambda report: report.update(take="another"),
    lambda report: report.update(frames=10**400),
    lambda report: report.update(version=["1"]),
    lambda report: report["timing"].update(load=float("nan")),
    dict.clear,
    *(lambda report, key=key: report.pop(key) for key in ("take", "timing", "markers", "trouble", "frames")),
]


def test_a_bad_report_is_one_takes_trouble(run, takes):
    out, words = takes
    assert run(*words).status == 0
    good = (out / "b.report.json").read_text(encoding="utf-8")
    for change in BAD_REPORTS:
        report = json.loads(good)
        change(report)
        (out / "b.report.json").write_text(json.dumps(report), encoding="utf-8")
        answer = run(*words, "--resume", "--json")
        assert "b.report.json: " in answer.refusal(2)
        assert "fault of" not in answer.err
        result = json.loads(answer.out)
        assert [one["take"] for one in result["takes"]] == ["a", "c"]
        assert [one["take"] for one in result["failed"]] == ["b"]


def test_a_name_too_long_is_one_takes_trouble(run, takes, tmp_path):
    out, words = takes
    long = shutil.copy(tmp_path / "a.c3d", tmp_path / f"{'n' * 246}.c3d")
    for more in ([], ["--resume"], ["--overwrite", "--html", "--summary"]):
        answer = run(*words[:2], long, *words[4:], *more)
        if os.name == "nt":  # which says of a path that is too long that nothing is there
            assert "cannot be" in answer.reason
        else:
            assert "File name too long" in answer.refusal(2)
        assert answer.out.startswith("a: 20 frames")
    assert (out / "a.report.json").exists()


@any_bytes
@pytest.mark.parametrize("stem", ["=1+1", "@SUM(A1)", "\x1b[31mred", "a\x9b2J"])
def test_a_hostile_name_reaches_neither_terminal_nor_table(run, room, tmp_path, stem):
    source, broken = shutil.copy(room.c3d, tmp_path / f"{stem}.c3d"), tmp_path / f"{stem}2.c3d"
    broken.touch()
    words = ["label", source, broken, "--model", MODEL, "--out", tmp_path / "out", "--summary", "--html", "--progress"]
    answer = run(*words)
    assert answer.status == 2
    assert not any(sign in answer.out + answer.err for sign in "\x1b\x9b")
    table = tmp_path / "out" / "summary.csv"
    assert {row.take for row in read_table(table)} == {stem, f"{stem}2"}
    for path in (table, *(tmp_path / "out").glob("*.json"), *(tmp_path / "out").glob("*.html")):
        assert not any(sign in path.read_text(encoding="utf-8") for sign in "\x1b\x9b")
    assert not any(line.startswith(("=", "@")) for line in table.read_text().splitlines())
    answer = run(*words, "--resume", "--json")
    assert json.loads(answer.out)["passed_over"] == [stem]


def test_what_a_terminal_is_told_moves_no_cursor(capsys):
    print_results(["a\x1b[2Jb"], {}, False)
    ProgressLine(True).tell("a\x1b[2Jb", at_once=True)
    said = capsys.readouterr()
    assert (said.out, said.err) == ("a\\u001b[2Jb\n", "a\\u001b[2Jb\n")


def test_a_folder_that_is_left_alone_is_said_before_the_last_line(run, takes):
    out, words = takes
    parts = out / ".part-mocap-autolabel-0123456789ab"
    parts.mkdir(parents=True)
    for name, content in ((".mocap-autolabel.lock", ""), (".mocap-autolabel.json", "[]")):
        (parts / name).write_text(content)
    assert run(*words).done().err.startswith(f"mocap-autolabel: {parts}: is left alone")
    assert parts.exists()


@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit that the system keeps")
@pytest.mark.parametrize("megabytes", [100, 120, 135, 140, 160, 200, 300])
def test_whatever_memory_there_is_nothing_is_called_a_fault(room, tmp_path, megabytes):
    script = (
        "import resource, sys; sys.path.insert(0, sys.argv.pop(1)); limit = int(sys.argv.pop(1)) << 20; "
        "resource.setrlimit(resource.RLIMIT_AS, (limit, limit)); "
        "from addon.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    words = [sys.executable, "-c", script, ROOT, megabytes, "label", room.c3d, "--model", MODEL, "--out", tmp_path]
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False)
    lines = done.stderr.splitlines()
    assert done.returncode in (0, 1)
    assert len(lines) == done.returncode
    assert all("memory" in line and line.startswith("mocap-autolabel: ") and "; expected" in line for line in lines)


STEM = b"w\xff\xc3lk\nx\ty\xe2\x80\xa8".decode("utf-8", "surrogateescape")


def readable(folder, frames: int):
    """Whether a take's outputs are there and can be read."""
    for ending in (".c3d", ".trc"):
        assert len(read_points(folder / f"{STEM}{ending}").xyz) == frames
    with LabelFile(folder / f"{STEM}.labels.csv") as labels:
        assert any(row.marker for row in labels.rows())
    assert json.loads((folder / f"{STEM}.report.json").read_text())["frames"] == frames


@any_bytes
def test_points_in_a_file_whose_name_is_any_bytes(run, room, tmp_path):
    source = shutil.copy(room.c3d, tmp_path / f"{STEM}.c3d")
    assert run("label", source, "--model", MODEL, "--out", tmp_path / STEM, "--trc").status == 0
    readable(tmp_path / STEM, 20)


@any_bytes
@pytest.mark.blender
def test_blobs_with_a_blender_file_that_serves_as_calibration(label, room, tmp_path):
    source = shutil.copy(room.blobs, tmp_path / f"{STEM}.csv")
    calibration = shutil.copy(room.cameras, tmp_path / f"{STEM}.toml")
    assert label("--trc", "--blend", blobs=[source], cameras=calibration).status == 0
    readable(tmp_path / "out", 20)
    saved = shutil.move(tmp_path / "out" / f"{STEM}.blend", tmp_path / f"{STEM}.blend")
    assert label("--overwrite", blobs=[source], cameras=saved).status == 0
