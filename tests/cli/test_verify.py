# SPDX-License-Identifier: GPL-3.0-or-later
"""`verify`: what is otherwise than it was made is told in one line; `evaluate`: figures counted by hand."""

import errno
import hashlib
import json
import shutil
from pathlib import Path

import pytest

from addon.cli import verify
from addon.demo.take import MODEL
from addon.io.markersets import markerset_file
from addon.io.provenance import sealed

RIGHT = {"version": 1, "edits": [{"kind": "right", "marker": "C7"}]}


@pytest.fixture(scope="module")
def made(room, tmp_path_factory) -> Path:
    """A folder with the takes walk and other of blobs, what they were labelled by, and `out` with what came of it."""
    from addon.cli import main

    lab = tmp_path_factory.mktemp("lab")
    (lab / "takes").mkdir()
    for name in ("walk", "other"):
        shutil.copy(room.blobs, lab / "takes" / f"{name}.csv")
    shutil.copy(room.cameras, lab / "room.toml")
    shutil.copy(markerset_file(MODEL), lab / "own.markerset.json")
    (lab / "takes" / "walk.edits.json").write_text(json.dumps(RIGHT))
    words = ["--cameras", lab / "room.toml", "--model", lab / "own.markerset.json", "--out", lab / "out", "--trc"]
    words = ["label", *sorted(lab.glob("takes/*.csv")), *words, "--html", "--frames", "100:102"]
    assert main([str(word) for word in words]) == 0
    return lab


@pytest.fixture
def lab(made, tmp_path) -> Path:
    """The same elsewhere, as a folder that was moved."""
    return Path(shutil.copytree(made, tmp_path / "lab"))


@pytest.mark.parametrize("name", ["walk", "walk.report.json", "walk.c3d", "walk.labels.csv", "walk.report.html"])
def test_results_are_as_they_were_made(run, lab, name):
    said = run("verify", lab / "out" / name).quiet().out
    assert said.startswith("walk: 4 results are as version ")
    assert said.endswith(" made them of walk.csv, room.toml, own.markerset.json, walk.edits.json\n")


def report_in(lab: Path) -> dict:
    return json.loads((lab / "out" / "walk.report.json").read_text(encoding="utf-8"))


def test_a_report_has_the_digests_that_any_program_makes(lab):
    made = report_in(lab)["provenance"]
    for kind, name in (("input", "takes/walk.csv"), ("cameras", "room.toml"), ("edits", "takes/walk.edits.json")):
        sha256 = hashlib.sha256((lab / name).read_bytes()).hexdigest()
        assert made[kind] == [{"file": f"../{name}", "sha256": sha256}]
    assert sorted(made["results"]) == [".c3d", ".labels.csv", ".report.html", ".trc"]
    for ending, sha256 in made["results"].items():
        assert sha256 == hashlib.sha256((lab / "out" / f"walk{ending}").read_bytes()).hexdigest()
    assert (made["options"]["frames"], made["options"]["trc"]) == ([100, 102], True)


def add_line(path: Path):
    with path.open("a") as file:
        file.write("\n")


def doubt_less(path: Path):
    path.write_text(path.read_text(encoding="utf-8").replace('"mean": 0.9', '"mean": 0.8'), encoding="utf-8")


CHANGES = [
    ("takes/walk.csv", add_line, "the input ../takes/walk.csv was changed"),
    ("takes/walk.csv", Path.unlink, "the input ../takes/walk.csv is gone"),
    ("room.toml", add_line, "the cameras ../room.toml was changed"),
    ("room.toml", Path.unlink, "the cameras ../room.toml is gone"),
    ("own.markerset.json", add_line, "the model ../own.markerset.json was changed"),
    ("takes/walk.edits.json", add_line, "the edits ../takes/walk.edits.json was changed"),
    ("takes/walk.edits.json", Path.unlink, "the edits ../takes/walk.edits.json is gone"),
    ("out/walk.trc", add_line, "walk.trc was changed"),
    ("out/walk.c3d", Path.unlink, "walk.c3d is gone"),
    ("out/walk.report.html", add_line, "walk.report.html was changed"),
    ("out/walk.report.json", doubt_less, "the report was changed"),
]


@pytest.mark.parametrize(("name", "change", "words"), CHANGES)
def test_what_was_changed_or_is_gone_is_told(run, lab, name, change, words):
    change(lab / name)
    reason = run("verify", lab / "out" / "walk").refusal(1)
    assert reason == f"{lab / 'out' / 'walk.report.json'}: {words}; expected all as it was when this take was labelled"


def test_an_input_that_moved_is_found_beside_the_results(run, lab):
    for name in ("takes/walk.csv", "takes/walk.edits.json", "room.toml"):
        (lab / name).rename(lab / "out" / Path(name).name)
    assert run("verify", lab / "out" / "walk").status == 0


def test_of_a_folder_every_take_has_its_line(run, lab):
    assert len(run("verify", lab / "out").out.splitlines()) == 2
    add_line(lab / "out" / "walk.trc")
    (lab / "out" / "walk.c3d").unlink()
    (lab / "out" / "bad.report.json").write_text("[]")
    answer = run("verify", lab / "out", "--json")
    assert answer.status == 2
    assert [(one["take"], one["verified"]) for one in answer.json["takes"]] == [("other", True), ("walk", False)]
    assert answer.json["takes"][1]["differences"] == ["walk.c3d is gone", "walk.trc was changed"]
    assert [(one["take"], one["status"]) for one in answer.json["failed"]] == [("bad", 2), ("walk", 1)]
    assert [line.count("; expected ") for line in answer.err.splitlines()] == [1, 1]


def test_a_folder_that_cannot_be_looked_into_is_not_called_empty(run, lab, monkeypatch):
    def refused(path):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(Path, "iterdir", refused)
    assert run("verify", lab / "out").refusal(2).startswith(f"{lab / 'out'}: the system says: Permission denied;")


def test_what_came_later_is_of_another_version_or_no_result_is_told(run, lab, monkeypatch):
    (lab / "takes" / "other.edits.json").write_text(json.dumps(RIGHT))
    assert "other.edits.json is beside the input now;" in run("verify", lab / "out" / "other").refusal(1)
    assert "walk.bvh is none of its results;" in run("verify", lab / "out" / "walk.bvh").refusal(1)
    assert "has no report beside it;" in run("verify", lab / "out" / "nobody.c3d").refusal(2)
    assert "holds no report of a take;" in run("verify", lab / "takes").refusal(2)
    shutil.copy(max(Path(__file__).parents[1].glob("earlier/*/walk.report.json")), lab)
    reason = run("verify", lab / "walk.report.json").refusal(2)
    assert "does not say which files it was made of; expected the report of a take as this version" in reason
    monkeypatch.setattr(verify, "version", lambda: "9.8.7")
    reason = run("verify", lab / "out" / "walk").refusal(1)
    assert f"it was made by version {report_in(lab)['version']} and this is 9.8.7;" in reason


def broken(**changes):
    return lambda report: report["provenance"].update(changes)


BROKEN = [
    lambda report: report.pop("provenance"),
    lambda report: report.update(provenance=[]),
    lambda report: report.update(made_of=5),
    *(broken(**{name: value}) for name in ("input", "cameras", "model", "edits") for value in (None, [5], [{}], "ab")),
    *(broken(**{name: value}) for name in ("version", "report", "options", "results") for value in (None, 5, [])),
    broken(results={"../../room.toml": "ab"}),
    broken(results={".c3d": 5}),
    broken(input=[{"file": "..", "sha256": "ab"}]),
    broken(input=[{"file": "/", "sha256": "ab"}]),
]


@pytest.mark.parametrize("change", BROKEN)
def test_a_broken_report_is_one_sentence(run, lab, change):
    report = report_in(lab)
    change(report)
    (lab / "out" / "walk.report.json").write_text(json.dumps(report))
    answer = run("verify", lab / "out" / "walk")
    assert "walk.report.json: " in answer.refusal(2) or "is a folder; expected a file" in answer.reason
    assert "fault of" not in answer.err
    assert len(answer.err.splitlines()) == 1


def test_a_report_that_cannot_be_read_says_why(run, lab):
    (lab / "out" / "walk.report.json").unlink()
    (lab / "out" / "walk.report.json").mkdir()
    assert "walk.report.json: is a folder; expected a file" in run("verify", lab / "out" / "walk").refusal(2)


def test_a_report_without_a_bottom_is_one_sentence(run, lab):
    text = (lab / "out" / "walk.report.json").read_text(encoding="utf-8")
    for depth in (500, 2000, 50_000):
        (lab / "out" / "walk.report.json").write_text(f'{{"deep": {"[" * depth}{"]" * depth}, {text[1:]}')
        answer = run("verify", lab / "out" / "walk")
        assert answer.reason.count("walk.report.json: ") == 1
        assert "fault of" not in answer.err


@pytest.mark.parametrize(
    ("kind", "file"),
    [
        ("cameras", ""),
        *(("input", far) for far in ("//elsewhere/walk.csv", "\\\\elsewhere\\walk.csv", "\0", "a" * 9000)),
    ],
)
def test_a_report_leads_nowhere_else_and_what_was_in_no_file_cannot_be_verified(run, lab, kind, file):
    report = report_in(lab)
    report["provenance"][kind] = [{"file": file, "sha256": "ab"}]
    (lab / "out" / "walk.report.json").write_text(json.dumps(sealed(report)))
    reason = run("verify", lab / "out" / "walk").refusal(1)
    assert ("nobody knows the file of its cameras;" in reason) == (file == "")


LABELS = """frame,camera,x,y,marker,step,confidence
1,a,10.0,20,LASI,exclusive,1
1,a,30,40,RASI,conflict,0.9
1,b,1,2,,,0
1,b,3,4,RASI,remaining,0.8
2,a,5,6,LASI,exclusive,1
"""
TRUTH = """frame,camera,x,y,marker
1,a,30,40,LASI
1,a,10,20,RASI
1,b,1,2,LASI
1,b,3,4,LASI|RASI
2,a,5,6,
"""


@pytest.fixture
def evaluate(run, tmp_path):
    def call(labels=LABELS, truth=TRUTH, *words):
        (tmp_path / "l.csv").write_text(labels)
        (tmp_path / "t.csv").write_text(truth)
        return run("evaluate", tmp_path / "l.csv", tmp_path / "t.csv", *words)

    return call


def test_figures_are_the_contracts(evaluate):
    figures = evaluate(LABELS, TRUTH, "--json").quiet().json
    # Only the merged blob is right; the swapped two and the ghost are wrong.
    assert figures | {"precision": 1 / 4, "recall": 1 / 4, "false_assignments": 3 / 4, "perfect_frames": 0} == figures
    [swap] = figures["swaps"]
    assert (set(swap["markers"]), swap["count"]) == ({"LASI", "RASI"}, 1)
    assert figures["steps"]["remaining"] == {"labels": 1, "right": 1, "precision": 1}
    out = evaluate().out
    assert "precision             25.000%   1 right of 4 labels given" in out
    assert "of 4 blobs of real markers" in out
    assert " and " in next(line for line in out.splitlines() if line.startswith("swapped"))


def test_only_frames_asked_for_rows_with_truth_and_markers_of_the_model_count_and_points_too(evaluate):
    assert evaluate(LABELS, TRUTH, "--json", "--frames", "1:1").json["frames"] == 1
    figures = evaluate(LABELS, "\n".join(TRUTH.splitlines()[:4]), "--json").json
    assert (figures["rows"], figures["rows_without_truth"]) == (5, 2)
    truth = TRUTH.replace("2,a,5,6,", "2,a,5,6,NOSE")
    counts = [evaluate(LABELS, truth, "--json", *more).json["marker_blobs"] for more in ([], ["--model", "body26"])]
    assert counts == [5, 4]
    labels = "frame,point,marker,step,confidence\n1,0,LASI,exclusive,1\n1,1,,,0\n"
    figures = evaluate(labels, "frame,point,marker\n1,0,LASI\n1,1,RASI\n", "--json").json
    assert (figures["precision"], figures["recall"]) == (1, 0.5)


@pytest.mark.parametrize(
    ("labels", "truth", "reason"),
    [
        (LABELS.replace("1,b,1,2,,,0\n", ""), TRUTH, "l.csv: has no row for frame 1, b 1.0 2.0"),
        (LABELS, TRUTH.replace(",5,6", ",5,7"), "l.csv: has no row for frame 2"),
        (LABELS, "frame,camera,x,y,marker\n", "none of the labels' rows"),
        (LABELS, "frame,point,marker\n1,0,LASI\n", "3D points"),
        ("", TRUTH, "l.csv: is empty"),
        (LABELS.replace("30,40", "x,40"), TRUTH, "l.csv:3: has a key that is no number"),
    ],
)
def test_files_that_cannot_be_compared(evaluate, labels, truth, reason):
    assert reason in evaluate(labels, truth).refusal(2)
