# SPDX-License-Identifier: GPL-3.0-or-later
"""`quality`: a report for people and one for programs, and models that cannot be judged."""

import json
from dataclasses import replace

import pytest

from addon.io.markersets import markerset_text, open_markerset


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """gait15 as a file that has learned nothing of points."""
    path = tmp_path_factory.mktemp("bare") / "bare.markerset.json"
    path.write_text(markerset_text(replace(open_markerset("gait15"), name="bare")))
    return path


def test_a_built_in_model_is_judged(run, tmp_path):
    path = tmp_path / "quality.json"
    answer = run("quality", "gait15", "--advice", 1, "--report", path, "--json")
    assert (answer.status, answer.err) == (0, "")
    report = json.loads(answer.out)
    assert report == json.loads(path.read_text())
    assert set(report["markers"]) == set(open_markerset("gait15").markers)
    separations = [pair["separation"] for pair in report["pairs"]]
    assert separations == sorted(separations)
    assert all(pair["all_seen"] >= pair["separation"] for pair in report["pairs"])
    assert report["subjects"] > 1
    [advice] = report["advice"]
    assert advice["after"] > advice["before"]
    assert set(advice["for"]) <= set(report["markers"])
    assert max(map(abs, advice["shift_mm"])) < 65


def test_a_model_without_evidence_is_judged_by_its_spread_and_keeps_the_markers_it_is_to_keep(run, bare):
    answer = run("quality", bare, "--advice", 0)
    assert answer.status == 0
    assert answer.out.startswith("bare: 15 markers, drawn from its spread")
    assert "ambiguous" in answer.out
    assert "advice" not in answer.out
    report = json.loads(run("quality", bare, "--advice", 2, "--goal", 8, "--keep", "LANK,RANK", "--json").out)
    assert report["advice"]
    assert not {row["marker"] for row in report["advice"]} & {"LANK", "RANK"}


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["nobody"], "there is no marker set nobody"),
        (["gait15", "--keep", "NOSE"], "gait15 has no marker NOSE"),
        (["gait15", "--goal", "0"], "'0' is no separation"),
        (["gait15", "--advice", "99"], "'99' is no number of changes"),
        ([], "MODEL"),
    ],
)
def test_what_cannot_be_judged(run, words, reason):
    assert reason in run("quality", *words).refusal(2)


def test_a_report_is_not_overwritten_unasked(run, bare, tmp_path):
    path = tmp_path / "quality.json"
    path.write_text("mine")
    assert "exists already" in run("quality", bare, "--advice", 0, "--report", path).reason
    assert path.read_text() == "mine"
    assert run("quality", bare, "--advice", 0, "--report", path, "--overwrite").status == 0
    assert json.loads(path.read_text())["model"] == "bare"
