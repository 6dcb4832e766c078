# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever is wrong with the input, the user reads one sentence with the file in it, and nothing is written."""

import json
import os
import re
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

HEADER = "frame,camera,x,y\n"


def blob_file(folder, text: str):
    path = folder / "bad.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", r"bad\.csv: is empty; expected a blob file .*, or a take of 3D points"),
        ("<xml/>", r"bad\.csv:1: holds neither blobs nor 3D points, for it has no header; expected .*Motive"),
        ("frame,camera,x\n1,cam1,2\n", r"bad\.csv:1: has no column y; expected"),
        (HEADER + "1,cam1,3,4\n", r"bad\.csv: holds blobs, and there is no calibration .*; expected --cameras"),
    ],
)
def test_a_file_is_only_said_to_hold_blobs_when_it_does(run, tmp_path, text, reason):
    assert re.search(
        reason, run("label", blob_file(tmp_path, text), "--model", "gait15", "--out", tmp_path / "out").refusal(2)
    )


def test_one_camera_is_read_but_cannot_do_the_job(label, room, tmp_path):
    first = room.cameras.read_text().split("\n\n")[0]
    alone = tmp_path / "alone.toml"
    alone.write_text(first + "\n")
    rows = [line for line in room.blobs.read_text().splitlines()[1:] if ",cam1," in line]
    assert "expected two or more" in label(
        cameras=alone, blobs=[blob_file(tmp_path, HEADER + "".join(f"{','.join(r.split(',')[:4])}\n" for r in rows))]
    ).refusal(1)


def test_frames_without_blobs_and_nobody_there_are_no_error(label, room, tmp_path):
    rows = room.blobs.read_text().splitlines(keepends=True)
    kept = [row for row in rows if not row.startswith(("105,", "106,", "107,"))]
    answer = label(blobs=[blob_file(tmp_path, "".join(kept))])
    assert (answer.status, answer.err) == (0, "")
    assert "20 frames" in answer.out
    said = label("--overwrite", blobs=[blob_file(tmp_path, HEADER + "1,cam1,3,4\n2,cam2,300,200\n")]).done().out
    assert "0 of 2 blobs named" in said


def test_more_ghosts_than_any_capture_end_soon(label, tmp_path):
    rows = (f"1,cam{n % 8 + 1},{n % 1280},{n % 960}\n" for n in range(200_000))
    said = label(blobs=[blob_file(tmp_path, HEADER + "".join(rows))]).refusal(1)
    assert "bad.csv: frame 1 has 25000 blobs in camera cam1; expected at most 500" in said


# What is refused of what is typed, beside take.c3d, walk.csv with blobs and room.toml: for each beginning what follows.
REFUSED = {
    "": {
        "": "the following arguments are required: VERB; expected arguments as mocap-autolabel --help tells",
        "lable": "argument VERB: invalid choice: 'lable' (choose from 'label', 'train',",
        "evaluate a.csv": "the following arguments are required: TRUTH",
        "models extra": "there is no marker set extra; expected actor41, actor53, body26, body39, gait15 or the path",
        "simulate take.c3d": "the following arguments are required: --out, --cameras",
        "reconstruct walk.csv --cameras room.toml --out a.c3d --up w": "argument --up: invalid choice: 'w'",
        "label x.c3d --model helen_hayes --out b": "train --set helen_hayes --out helen_hayes.markerset.json",
    },
    "label": {
        "": "the following arguments are required: INPUT, --out; expected arguments as mocap-autolabel label --help",
        " walk.csv --model body26 --out b": "walk.csv: holds blobs, and there is no calibration of their cameras;",
        " take.c3d --model body26 --out b --use blobs": "holds 3D points; expected a take of blobs, or no --use",
    },
    "label walk.csv --out b --cameras room.toml --model": {
        " nobody15": "there is no marker set nobody15",
        " missing.markerset.json": "missing.markerset.json: there is no such file",
        " body26 --frames 7": "'7' is no range of frames; expected A:B, such as 100:250",
        " body26 --frames 1_0:2_0": "'1_0:2_0' is no range of frames",
        " body26 --frames \u0661:\u0662": "'\u0661:\u0662' is no range of frames",
        f" body26 --frames {'1' * 5000}:": "is no range of frames",
        " body26 --frames=": "'' is no range of frames",
        " body26 --frames 9:3": "frames 9:3 end before they begin",
        " body26 --jobs 0": "'0' is no number of jobs",
        " body26 --height tall": "'tall' is no height; expected a number from 0.3 to 3",
        " body26 --method magic": "invalid choice: 'magic' (choose from 'auto', 'fit',",
        " body26 --overwite": "unrecognized arguments: --overwite",
        " body26 --use points": "holds blobs; expected a take of points, or no --use",
        " body26 --idle 3": "--idle is for folders that are watched; expected --watch",
        " body26 --watch": "walk.csv: is no folder; expected one to watch",
        " body26 --watch --edits mine.json": "--edits is of one take; expected none with --watch",
        " body26 --watch --engine dask --scheduler tcp://there": "expected --watch without --engine dask",
        " body26 --watch --idle -1": "'-1' is no time; expected a number from 0",
    },
    "label take.c3d --out b": {
        "": "nothing says what is worn; expected --model MODEL or auto, or --subject NAME=MODEL for each subject",
        " --model auto --models nowhere": "nowhere: is no folder; expected the one of your own marker sets",
        " --model body26 --models .": "--models is of --model auto; expected both of them or neither",
        " --model auto --subjects 2": "--model auto finds what one subject wears; expected --model MODEL beside",
        " --model gait15 --subjects 0": "'0' is no number of subjects",
        " --model gait15 --subjects many": "'many' is no number of subjects",
        " --model gait15 --subjects 2 --method fit": "several subjects need a model",
        " --model gait15 --subject ann=gait15": "--subject and --model both say",
        " --subject ann=gait15 --subjects 2": "--subject and --subjects both say",
        " --subject ann=gait15 --subject Ann=gait15": "--subject names somebody twice",
        " --subject Ren\u00e9=gait15 --subject rene\u0301=gait15": "--subject names somebody twice",
        " --subject gait15": "'gait15' says not who wears what",
        " --subject =gait15": "'=gait15' says not who wears what",
        " --subject ann=": "'ann=' says not who wears what",
    },
    "fill take.c3d": {
        "": "the following arguments are required: --out",
        " --out a.trc": "a.trc: is no file that can say which samples are filled; expected a name that ends in .c3d",
        " --out a.c3d --markers LKNE,NOSE": "take.c3d: has no marker NOSE; expected",
        " --out a.c3d --method body": "the method body needs a body to fit; expected --model",
        " --out a.c3d --method magic": "invalid choice: 'magic'",
        " --out a.c3d --max-gap 0": "'0' is no number of frames; expected a whole number from 1",
        " --out a.c3d --model nobody": "nobody: there is no such file",
    },
    "simulate take.c3d --cameras room.toml --out a.csv": {
        " --frames 900:": "expected frames with markers, of its own 100 to 119",
        " --noise loud": "argument --noise: 'loud' is no amount",
        " --model nobody": "there is no marker set nobody",
    },
    "quality": {
        "": "the following arguments are required: MODEL",
        " nobody": "there is no marker set nobody",
        " gait15 --keep NOSE": "gait15 has no marker NOSE",
        " gait15 --goal 0": "'0' is no separation",
        " gait15 --advice 99": "'99' is no number of changes",
    },
    "train --set helen_hayes --out a.markerset.json": {
        " take.c3d": "--set makes a model from words alone; expected no take with it",
        " --from gait15": "expected no --from with it",
        " --lean --search genetic": "expected no --search and no --lean with it",
    },
}


@pytest.mark.parametrize(
    ("line", "reason"), [(verb + more, reason) for verb, rows in REFUSED.items() for more, reason in rows.items()]
)
def test_what_cannot_be_asked(run, room, tmp_path, monkeypatch, line, reason):
    for file in (room.c3d, room.blobs, room.cameras):
        shutil.copy(file, tmp_path)
    monkeypatch.chdir(tmp_path)
    answer = run(*line.split())
    assert reason in answer.refusal(2)
    assert answer.out == "" and len(answer.reason) < 400
    assert {path.name for path in tmp_path.iterdir()} == {"take.c3d", "walk.csv", "room.toml"}


def test_a_model_of_a_later_version_and_a_folder_are_said_so(run, room, tmp_path):
    later = tmp_path / "later.markerset.json"
    later.write_text('{"mocap_autolabel": 2, "name": "later"}')
    reason = run("label", room.c3d, "--out", tmp_path / "out", "--model", later).refusal(2)
    assert "version 2; expected 1, so a newer Mocap Autolabel is needed" in reason
    reason = run("label", room.folder, "--out", tmp_path / "out", "--model", "gait15").refusal(2)
    assert "is a folder; expected takes" in reason


def test_a_fault_of_our_own_is_one_sentence_too(run, monkeypatch):
    monkeypatch.setattr("addon.cli.models.builtin_markersets", lambda: 1 / 0)
    answer = run("models")
    assert answer.status == 1
    assert "ZeroDivisionError" in answer.err
    assert "Traceback" not in answer.err


def test_a_path_that_is_empty_is_not_the_folder_one_is_in(run, room, tmp_path, monkeypatch):
    """As of a variable of the shell that is not set."""
    monkeypatch.chdir(tmp_path)
    blobs, cameras = str(room.blobs), str(room.cameras)
    lines = [
        ["label", blobs, "--model", "body26", "--cameras", cameras, "--out", "out"],
        ["label", blobs, "--model", "body26", "--cameras", cameras, "--out", "out", "--edits", "edits.json"],
        ["reconstruct", blobs, "--cameras", cameras, "--out", "a.c3d"],
        ["simulate", "take.c3d", "--cameras", cameras, "--model", "body26", "--out", "a.csv"],
        ["fill", "take.c3d", "--model", "body26", "--out", "a.c3d"],
        ["refine", blobs, "--cameras", cameras, "--model", "body26", "--out", "a.toml"],
        ["train", "take.c3d", "--from", "gait15", "--out", "a.markerset.json", "--report", "a.json"],
        ["evaluate", "a.labels.csv", "truth.csv", "--model", "gait15"],
        ["quality", "gait15", "--report", "a.json"],
        ["blobs", "film.mp4", "--cameras", cameras, "--out", "a.csv"],
        ["blobs", "cam1=", "--cameras", cameras, "--out", "a.csv"],
        ["demo", "--out", "demo"],
    ]
    for line in lines:
        for place in range(1, len(line)):
            if not line[place].startswith("-"):
                answer = run(*line[:place], "", *line[place + 1 :])
                assert answer.status == 2, (line, place)
                assert re.search(r"is empty; expected|names no pictures; expected", answer.reason), answer.reason
    assert not list(tmp_path.iterdir())


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
