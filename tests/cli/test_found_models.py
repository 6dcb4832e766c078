# SPDX-License-Identifier: GPL-3.0-or-later
"""`label --model auto`: the marker set is found, take by take; where two fit, or none, nobody guesses."""

import shutil

import numpy as np
import pytest

from addon.core.data.takes import Points
from addon.demo.take import MODEL
from addon.io.markersets import SUFFIX, builtin_markersets
from addon.io.model_history import known_models
from addon.io.points import write_c3d
from tests.core.pipelines.test_known_sets import drawn, standing

from .conftest import report_of


@pytest.fixture
def found(run, room, tmp_path):
    """Labels the room's take, or another, with its marker set to be found."""

    def label(*words, takes=(room.c3d,)):
        return run("label", *takes, "--model", "auto", "--out", tmp_path / "out", *words)

    return label


def test_the_set_that_points_show_is_found_told_and_verified(found, run, room, tmp_path):
    answer = found()
    assert answer.status == 0
    assert f"{MODEL} was found among {len(builtin_markersets())} marker sets" in answer.out
    report = report_of(tmp_path / "out" / f"{room.c3d.stem}.labels.csv")
    assert report["model"] == MODEL
    assert report["unlabelled"] == 0
    assert [row["file"] for row in report["provenance"]["model"]] == [MODEL]
    assert run("verify", tmp_path / "out").status == 0


def test_the_set_that_blobs_show_is_found(found, room, tmp_path):
    assert found("--cameras", room.cameras, "--rate", "60", takes=(room.blobs,)).status == 0
    assert report_of(tmp_path / "out" / f"{room.blobs.stem}.labels.csv")["model"] == MODEL


def test_each_take_of_a_batch_is_found_its_own_and_done_before_is_passed_over(found, room, tmp_path):
    takes = room.c3d, shutil.copy(room.c3d, tmp_path / "other.c3d")
    assert found("--jobs", "2", takes=takes).status == 0
    assert {report_of(path)["model"] for path in (tmp_path / "out").glob("*.labels.csv")} == {MODEL}
    again = found("--resume", takes=takes)
    assert again.status == 0
    assert again.out.count("done before") == 2
    shutil.copy(builtin_markersets()["gait15"], tmp_path / f"more{SUFFIX}")
    assert "is of a run that differs in --models; " in found("--resume", "--models", tmp_path).refusal(2)


def test_a_set_of_the_same_markers_in_the_own_folder_is_no_other_and_versions_are_none(found, tmp_path):
    own = tmp_path / "own"
    own.mkdir()
    for name in (f"ours{SUFFIX}", f"ours.v1{SUFFIX}"):
        shutil.copy(builtin_markersets()[MODEL], own / name)
    assert known_models(own) == [*builtin_markersets(), str(own / f"ours{SUFFIX}")]
    answer = found("--models", own)
    assert answer.status == 0
    assert f"was found among {len(builtin_markersets()) + 1} marker sets" in answer.out


def test_where_two_fit_both_are_named(found, tmp_path):
    write_c3d(tmp_path / "feet.c3d", standing(drawn("actor41")))
    reason = found(takes=(tmp_path / "feet.c3d",)).refusal(1)
    words = "looks like a take of actor41 as well as body39; expected the one that is worn, by --model actor41"
    assert reason.endswith(words)


def test_where_none_fits_that_is_said(found, tmp_path):
    rng, thing = np.random.default_rng(0), tmp_path / "thing.c3d"
    xyz = rng.uniform(0, [1.0, 1.0, 2.0], (20, 3)) + rng.normal(0, 0.001, (50, 20, 3))
    write_c3d(thing, Points(("",) * 20, xyz, np.zeros((50, 20)), 100.0, 1))
    reason = found(takes=(thing,)).refusal(1)
    assert f"looks like a take of none of the {len(builtin_markersets())} known marker sets; expected " in reason
    assert reason.endswith("the one that is worn, by --model MODEL, or a model that is trained")


def test_a_take_with_another_axis_up_says_so(found):
    assert "to be given, by --up z" in found("--up", "-y").refusal(1)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--models", "nowhere"), "nowhere: is no folder; expected the one of your own marker sets"),
        (("--model", MODEL, "--models", "."), "--models is of --model auto; expected both of them or neither"),
        (("--subjects", "2"), "--model auto finds what one subject wears; expected --model MODEL beside --subjects"),
    ],
)
def test_what_does_not_go_with_it(found, words, reason):
    assert found(*words).refusal(2) == reason
