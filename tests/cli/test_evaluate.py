# SPDX-License-Identifier: GPL-3.0-or-later
"""`evaluate`: figures counted by hand, and files that cannot be compared."""

import json

import pytest

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
    some = "\n".join(TRUTH.splitlines()[:4])
    figures = json.loads(evaluate(LABELS, some, "--json").out)
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
