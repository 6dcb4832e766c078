# SPDX-License-Identifier: GPL-3.0-or-later
"""`verify`: what is otherwise than it was made is told in one line; `evaluate`: figures counted by hand."""

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
    answer = run("verify", lab / "out" / name)
    assert (answer.status, answer.err) == (0, "")
    assert answer.out.startswith("walk: 4 results are as version ")
    assert answer.out.endswith(" made them of walk.csv, room.toml, own.markerset.json, walk.edits.json\n")


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
    said = json.loads(answer.out)
    assert [(one["take"], one["verified"]) for one in said["takes"]] == [("other", True), ("walk", False)]
    assert said["takes"][1]["differences"] == ["walk.c3d is gone", "walk.trc was changed"]
    assert [(one["take"], one["status"]) for one in said["failed"]] == [("bad", 2), ("walk", 1)]
    assert [line.count("; expected ") for line in answer.err.splitlines()] == [1, 1]


def test_edits_that_came_later_are_told(run, lab):
    (lab / "takes" / "other.edits.json").write_text(json.dumps(RIGHT))
    assert "other.edits.json is beside the input now;" in run("verify", lab / "out" / "other").refusal(1)


def test_another_version_is_told(run, lab, monkeypatch):
    monkeypatch.setattr(verify, "version", lambda: "9.8.7")
    reason = run("verify", lab / "out" / "walk").refusal(1)
    assert f"it was made by version {report_in(lab)['version']} and this is 9.8.7;" in reason


def test_what_was_in_no_file_cannot_be_verified(run, lab):
    report = report_in(lab)
    report["provenance"]["cameras"] = [{"file": "", "sha256": "ab"}]
    (lab / "out" / "walk.report.json").write_text(json.dumps(sealed(report)))
    assert "nobody knows the file of its cameras;" in run("verify", lab / "out" / "walk").refusal(1)


def test_what_is_no_result_is_told(run, lab):
    assert "walk.bvh is none of its results;" in run("verify", lab / "out" / "walk.bvh").refusal(1)
    assert "has no report beside it;" in run("verify", lab / "out" / "nobody.c3d").refusal(2)
    assert "holds no report of a take;" in run("verify", lab / "takes").refusal(2)


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


@pytest.mark.parametrize("number", range(len(BROKEN)))
def test_a_broken_report_is_one_sentence(run, lab, number):
    report = report_in(lab)
    BROKEN[number](report)
    (lab / "out" / "walk.report.json").write_text(json.dumps(report))
    answer = run("verify", lab / "out" / "walk")
    assert "walk.report.json: " in answer.refusal(2) or "is a folder; expected a file" in answer.reason
    assert "fault of" not in answer.err
    assert len(answer.err.splitlines()) == 1


def test_a_report_without_a_bottom_is_one_sentence(run, lab):
    text = (lab / "out" / "walk.report.json").read_text(encoding="utf-8")
    for depth in (500, 2000, 50_000):
        (lab / "out" / "walk.report.json").write_text(f'{{"deep": {"[" * depth}{"]" * depth}, {text[1:]}')
        answer = run("verify", lab / "out" / "walk")
        assert answer.reason.count("walk.report.json: ") == 1
        assert "fault of" not in answer.err


@pytest.mark.parametrize("file", ["//elsewhere/walk.csv", "\\\\elsewhere\\walk.csv", "\0", "a" * 9000])
def test_no_report_leads_anywhere_else(run, lab, file):
    report = report_in(lab)
    report["provenance"]["input"][0]["file"] = file
    (lab / "out" / "walk.report.json").write_text(json.dumps(sealed(report)))
    assert run("verify", lab / "out" / "walk").status == 1


def test_a_report_of_an_earlier_version_is_one_sentence(run, tmp_path):
    shutil.copy(max(Path(__file__).parents[1].glob("earlier/*/walk.report.json")), tmp_path)
    reason = run("verify", tmp_path / "walk.report.json").refusal(2)
    assert "does not say which files it was made of; expected the report of a take as this version" in reason


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
    answer = evaluate(LABELS, TRUTH, "--json")
    assert (answer.status, answer.err) == (0, "")
    figures = json.loads(answer.out)
    assert figures["precision"] == 1 / 4  # only the merged blob is right; the swapped two and the ghost are wrong
    assert figures["recall"] == 1 / 4
    assert figures["false_assignments"] == 3 / 4
    assert figures["perfect_frames"] == 0
    [swap] = figures["swaps"]
    assert (set(swap["markers"]), swap["count"]) == ({"LASI", "RASI"}, 1)
    assert figures["steps"]["remaining"] == {"labels": 1, "right": 1, "precision": 1}


def test_figures_for_people(evaluate):
    out = evaluate().out
    assert "precision             25.000%   1 right of 4 labels given" in out
    assert "of 4 blobs of real markers" in out
    assert " and " in next(line for line in out.splitlines() if line.startswith("swapped"))


def test_only_frames_asked_for_rows_with_truth_and_markers_of_the_model_count_and_points_too(evaluate):
    assert json.loads(evaluate(LABELS, TRUTH, "--json", "--frames", "1:1").out)["frames"] == 1
    figures = json.loads(evaluate(LABELS, "\n".join(TRUTH.splitlines()[:4]), "--json").out)
    assert (figures["rows"], figures["rows_without_truth"]) == (5, 2)
    truth = TRUTH.replace("2,a,5,6,", "2,a,5,6,NOSE")
    assert json.loads(evaluate(LABELS, truth, "--json").out)["marker_blobs"] == 5
    assert json.loads(evaluate(LABELS, truth, "--json", "--model", "body26").out)["marker_blobs"] == 4
    labels = "frame,point,marker,step,confidence\n1,0,LASI,exclusive,1\n1,1,,,0\n"
    truth = "frame,point,marker\n1,0,LASI\n1,1,RASI\n"
    figures = json.loads(evaluate(labels, truth, "--json").out)
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
