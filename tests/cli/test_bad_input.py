# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever is wrong with the input, the user reads one sentence with the file in it, and nothing is written."""

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from addon.demo.take import MODEL
from addon.io.batch import read_table
from addon.io.labels import LabelFile
from addon.io.points import read_points, write_c3d

HEADER = "frame,camera,x,y\n"


def blob_file(folder, text: str):
    path = folder / "bad.csv"
    path.write_bytes(text.encode())
    return path


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", r"bad\.csv: is empty; expected a blob file .*, or a take of 3D points"),
        ("<xml/>", r"bad\.csv:1: holds neither blobs nor 3D points, for it has no header; expected .*Motive"),
        ("frame,camera,x,y\r1,cam1,2,3\r", r"bad\.csv:1: ends its lines with carriage returns alone; expected line"),
        ("frame,camera,x\n1,cam1,2\n", r"bad\.csv:1: has no column y; expected"),
    ],
)
def test_a_file_is_only_said_to_hold_blobs_when_it_does(run, room, tmp_path, text, reason):
    for more in ((), ("--cameras", room.cameras)):
        answer = run("label", blob_file(tmp_path, text), "--model", "gait15", "--out", tmp_path / "out", *more)
        assert re.search(reason, answer.refusal(2))


def test_one_camera_and_more_ghosts_than_any_capture_are_refused_and_nobody_there_is_no_error(label, room, tmp_path):
    rows = room.blobs.read_text().splitlines(keepends=True)
    (tmp_path / "alone.toml").write_text(room.cameras.read_text().split("\n\n")[0] + "\n")
    alone = blob_file(tmp_path, "".join(row for row in rows if row.split(",")[1] in ("camera", "cam1")))
    assert "expected two or more" in label(cameras=tmp_path / "alone.toml", blobs=[alone]).refusal(1)
    assert "bad: camera cam1 alone has blobs, and nobody is found by one" in label(blobs=[alone]).done().out
    ghosts = (f"1,cam{n % 8 + 1},{n % 1280},{n / 250}\n" for n in range(200_000))
    said = label("--overwrite", blobs=[blob_file(tmp_path, HEADER + "".join(ghosts))]).refusal(1)
    assert "bad.csv: frame 1 has 25000 blobs in camera cam1; expected at most 500" in said
    kept = [row for row in rows if not row.startswith(("105,", "106,", "107,"))]
    assert "20 frames" in label("--overwrite", blobs=[blob_file(tmp_path, "".join(kept))]).quiet().out
    said = label("--overwrite", blobs=[blob_file(tmp_path, HEADER + "1,cam1,3,4\n2,cam2,300,200\n")]).done().out
    assert "0 of 2 blobs named" in said


# What is refused of what is typed, beside take.c3d, walk.csv with blobs and room.toml: for each beginning what follows.
REFUSED = {
    "": {
        "": "the following arguments are required: VERB; expected arguments as mocap-autolabel --help tells",
        "lable": "argument VERB: invalid choice: 'lable' (choose from 'label', 'train',",
        "models extra": "there is no marker set extra; expected actor41, actor53, body26, body39, gait15 or the path",
        "reconstruct walk.csv --cameras room.toml --out a.c3d --up w": "argument --up: invalid choice: 'w'",
        "label x.c3d --model helen_hayes --out b": "train --set helen_hayes --out helen_hayes.markerset.json",
    },
    "label": {
        "": "the following arguments are required: INPUT, --out; expected arguments as mocap-autolabel label --help",
        " . --out b --watch": "nothing says what is worn; expected --model MODEL or auto, or",
        " . --out b --watch --model gait15 --subjects 2 --method fit": "several subjects need a model",
        " walk.csv --model body26 --out b": "walk.csv: holds blobs, and there is no calibration of their cameras;",
        " take.c3d --model body26 --out b --use blobs": "holds 3D points; expected a take of blobs, or no --use",
    },
    "label walk.csv --out b --cameras room.toml --model": {
        " nobody15": "there is no marker set nobody15",
        " body26 --frames 7": "'7' is no range of frames; expected A:B, such as 100:250",
        " body26 --frames 1_0:2_0": "'1_0:2_0' is no range of frames",
        " body26 --frames \u0661:\u0662": "'\u0661:\u0662' is no range of frames",
        f" body26 --frames {'1' * 5000}:": "is no range of frames",
        " body26 --frames=": "'' is no range of frames",
        " body26 --frames 9:3": "frames 9:3 end before they begin",
        " body26 --jobs 0": "'0' is no number of jobs",
        " body26 --height tall": "'tall' is no height; expected a number from 0.9 to 2.2",
        " body26 --height 3": "'3' is no height; expected a number from 0.9 to 2.2",
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
        " --model gait15 --subjects 2 --method fit": "several subjects need a model",
        " --model gait15 --subject ann=gait15": "--subject and --model both say",
        " --subject ann=gait15 --subjects 2": "--subject and --subjects both say",
        " --subject ann=gait15 --subject Ann=gait15": "--subject names somebody twice",
        " --subject Ren\u00e9=gait15 --subject rene\u0301=gait15": "--subject names somebody twice",
        " --subject =gait15": "'=gait15' says not who wears what",
        " --subject ann=": "'ann=' says not who wears what",
        " --subject ann=auto": "'ann=auto' says not who wears what",
    },
    "fill take.c3d": {
        " --out a.trc": "a.trc: is no file that can say which samples are filled; expected a name that ends in .c3d",
        " --out a.c3d --markers LKNE,NOSE": "take.c3d: has no marker NOSE; expected",
        " --out a.c3d --method body": "the method body needs a body to fit; expected --model",
        " --out a.c3d --max-gap 0": "'0' is no number of frames; expected a whole number from 1",
        " --out a.c3d --model nobody": "there is no marker set nobody",
    },
    "simulate take.c3d --cameras room.toml --out a.csv": {
        " --frames 900:": "expected frames with markers, of its own 100 to 119",
        " --noise loud": "argument --noise: 'loud' is no amount",
    },
    "quality": {
        " gait15 --keep NOSE": "gait15 has no marker NOSE",
        " gait15 --goal 0": "'0' is no separation",
        " gait15 --advice 99": "'99' is no number of changes",
    },
    "train --set helen_hayes --out a.markerset.json": {
        " take.c3d": "--set makes a model from words alone; expected no take with it",
        " --from gait15": "expected no --from with it",
        " --lean --search genetic": "expected no --search and no --lean with it",
    },
    "train --set helen_hayes --out": {
        " .markerset.json": ".markerset.json: is no name for a model; expected one such as mine.markerset.json",
        " mine.json": "mine.json: is no name for a model; expected one such as mine.markerset.json",
    },
}


@pytest.mark.parametrize(
    ("line", "reason"), [(verb + more, reason) for verb, rows in REFUSED.items() for more, reason in rows.items()]
)
def test_what_cannot_be_asked(run, room, tmp_path, monkeypatch, line, reason):
    for file in room.files:
        shutil.copy(file, tmp_path)
    monkeypatch.chdir(tmp_path)
    answer = run(*line.split())
    assert reason in answer.refusal(2)
    assert answer.out == "" and len(answer.reason) < 400
    assert {path.name for path in tmp_path.iterdir()} == {"take.c3d", "walk.csv", "room.toml"}


def test_a_take_without_names_is_bad_input_to_all_who_need_them(run, room, tmp_path):
    take, made = read_points(room.c3d), tmp_path / "made"
    write_c3d(tmp_path / "anon.c3d", replace(take, names=("",) * len(take.names)))
    for verb, out, *more in (
        ("fill", "a.c3d"),
        ("train", "a.markerset.json"),
        ("simulate", "a.csv", "--cameras", room.cameras),
    ):
        reason = run(verb, tmp_path / "anon.c3d", "--out", made / out, *more).refusal(2)
        assert reason == f"{tmp_path / 'anon.c3d'}: has no named markers; expected a labelled take"
    assert not made.exists()


def test_a_model_of_a_later_version_a_folder_and_a_fault_of_our_own_are_said_so(run, room, tmp_path, monkeypatch):
    later = tmp_path / "later.markerset.json"
    later.write_text('{"mocap_autolabel": 2, "name": "later"}')
    words = "label", room.c3d, "--out", tmp_path / "out", "--model"
    assert "version 2; expected 1, so a newer Mocap Autolabel is needed" in run(*words, later).refusal(2)
    assert "is a folder; expected takes" in run("label", room.folder, *words[2:], "gait15").refusal(2)
    monkeypatch.setattr("addon.cli.models.builtin_markersets", lambda: 1 / 0)
    assert "ZeroDivisionError" in run("models").refusal(1)


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
                assert re.search(r"is empty; expected|names no pictures; expected", answer.refusal(2)), (line, place)
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
        assert [[one["take"] for one in answer.json[kind]] for kind in ("takes", "failed")] == [["a", "c"], ["b"]]


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
    assert answer.json["passed_over"] == [stem]


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


@any_bytes
@pytest.mark.blender
def test_files_whose_names_are_any_bytes_with_a_blender_file_that_serves_as_calibration(label, run, room, tmp_path):
    files = {path.suffix: shutil.copy(path, tmp_path / (STEM + path.suffix)) for path in room.files}
    assert run("label", files[".c3d"], "--model", MODEL, "--out", tmp_path / STEM, "--trc").status == 0
    assert label("--trc", "--blend", blobs=[files[".csv"]], cameras=files[".toml"]).status == 0
    for out in (tmp_path / STEM, tmp_path / "out"):
        assert [len(read_points(out / (STEM + ending)).xyz) for ending in (".c3d", ".trc")] == [20, 20]
        with LabelFile(out / f"{STEM}.labels.csv") as labels:
            assert any(row.marker for row in labels.rows())
        assert json.loads((out / f"{STEM}.report.json").read_text())["frames"] == 20
        run("verify", out).done()
    saved = shutil.move(tmp_path / "out" / f"{STEM}.blend", tmp_path / f"{STEM}.blend")
    assert label("--overwrite", blobs=[files[".csv"]], cameras=saved).status == 0
