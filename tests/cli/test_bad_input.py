# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever is wrong with the input, the user reads one sentence with the file in it, and nothing is written."""

import re

import pytest

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


@pytest.mark.parametrize("model", ["nobody15", "missing.markerset.json"])
def test_models_that_are_not_there(run, room, tmp_path, model):
    assert model in run("label", room.blobs, "--cameras", room.cameras, "--out", tmp_path, "--model", model).refusal(2)


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("lable",),
        ("label",),
        ("label", "a.csv", "--model", "body26", "--out", "b"),
        ("label", "a.csv", "--model", "body26", "--out", "b", "--cameras", "c.toml", "--frames", "7"),
        ("label", "a.csv", "--model", "body26", "--out", "b", "--cameras", "c.toml", "--frames", "9:3"),
        ("label", "a.csv", "--model", "body26", "--out", "b", "--cameras", "c.toml", "--jobs", "0"),
        ("label", "a.csv", "--model", "body26", "--out", "b", "--cameras", "c.toml", "--height", "tall"),
        ("label", "a.csv", "--model", "body26", "--out", "b", "--cameras", "c.toml", "--method", "magic"),
        ("label", "a.csv", "--model", "body26", "--out", "b", "--cameras", "c.toml", "--overwite"),
        ("evaluate", "a.csv"),
        ("simulate", "a.c3d"),
        ("models", "extra"),
    ],
)
def test_arguments(run, words):
    answer = run(*words)
    assert answer.refusal(2)
    assert answer.out == ""


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
