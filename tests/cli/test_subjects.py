# SPDX-License-Identifier: GPL-3.0-or-later
"""`label --subjects` and `--subject`: whose markers are whose in every file, and what is asked in vain."""

import contextlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pytest

from addon.cli.label.farm import _for_elsewhere
from addon.cli.label.options import as_job, settle_subjects
from addon.cli.parcels import read_parcel
from addon.cli.parser import build_parser
from addon.core.data.errors import InputError
from addon.core.data.takes import Points
from addon.core.points.several.wearers import is_subject_name
from addon.io.markersets import markerset_file, open_markerset
from addon.io.points import read_points, write_c3d
from addon.io.provenance import earlier_run, sealed
from addon.io.text import write_json
from addon.jobs.job import made_of
from tests.inputs.walkers import RATE, WORN, write_pair, write_seen

from .conftest import report_of, rows_of


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Two virtual people who walk side by side, 1 m apart, without names, and the truth of it."""
    folder = tmp_path_factory.mktemp("pair")
    write_pair(folder)
    return folder


@pytest.fixture
def label(run, pair, tmp_path):
    def call(*words):
        return run("label", pair / "pair.c3d", "--out", tmp_path / "out", *words)

    return call


def in_every_file(out, stem: str):
    """Whether the markers of two stand in all results."""
    markers = [f"{number}:{name}" for number in (1, 2) for name in open_markerset(WORN).markers]
    assert {row["marker"] for row in rows_of(out / f"{stem}.labels.csv")} <= {"", *markers}
    assert ezc3d.c3d(str(out / f"{stem}.c3d"))["parameters"]["POINT"]["LABELS"]["value"][:30] == markers
    assert ezc3d.c3d(str(out / f"{stem}.c3d"))["parameters"]["SUBJECTS"]["NAMES"]["value"] == ["1", "2"]
    assert "1:LASI" in (out / f"{stem}.trc").read_text()
    report = report_of(out / f"{stem}.c3d")
    assert [(one["name"], one["model"]) for one in report["subjects"]] == [("1", WORN), ("2", WORN)]
    assert list(report["markers"]) == markers


def test_two_are_named_in_every_file(label, figures, pair, tmp_path):
    assert "; expected a take of one, so ask for all of them by --model MODEL and" in label("--model", WORN).reason
    label("--model", WORN, "--subjects", "2", "--trc").quiet()
    found = figures(tmp_path / "out/pair.labels.csv", pair / "truth.csv")
    assert found["precision"] == 1 and found["recall"] > 0.95
    in_every_file(tmp_path / "out", "pair")
    reason = label("--subject", f"zoe={WORN}", "--subject", f"ann={WORN}", "--resume").reason
    assert "differs in model, --subjects, --subject, --trc; expected" in reason


def test_gaps_of_each_are_filled_and_the_page_shows_both(label, run, pair, tmp_path):
    take = read_points(pair / "pair.c3d")
    order = np.array([int(row["point"]) for row in rows_of(pair / "truth.csv") if row["marker"] == "2:LKNE"][:1])
    xyz = take.xyz[:].copy()
    xyz[15:22, order] = np.nan
    write_c3d(tmp_path / "pair.c3d", Points(take.names, xyz, take.residual[:], take.rate, take.first_frame))
    words = "--model", WORN, "--subjects", "2", "--fill", "--html"
    assert run("label", tmp_path / "pair.c3d", "--out", tmp_path / "out", *words).status == 0
    report = report_of(tmp_path / "out/pair.c3d")
    assert [(row["marker"], row["first"], row["last"]) for row in report["filled"]] == [("2:LKNE", 22, 28)]
    filled = read_points(tmp_path / "out/pair.c3d")
    place = filled.names.index("2:LKNE")
    assert np.linalg.norm(filled.xyz[15:22, place] - take.xyz[15:22, order[0]], axis=1).max() < 0.03
    assert (filled.residual[15:22, place] == 0).all()
    page = (tmp_path / "out/pair.report.html").read_text()
    assert "1:LKNE" in page and "2:LKNE" in page


def test_edits_say_whose_a_trajectory_is(label, pair, tmp_path):
    assert label("--model", WORN, "--subjects", "2").status == 0
    plain = rows_of(tmp_path / "out/pair.labels.csv")
    [point] = {row["point"] for row in plain if row["marker"] == "1:LKNE"}
    said = [
        {"kind": "assign", "point": int(point), "marker": "2:LKNE", "frames": [10, 14]},
        {"kind": "swap", "markers": ["1:LANK", "2:LANK"], "frames": [20, 25]},
        {"kind": "place", "marker": "2:LTOE", "frame": 12, "xyz": [0.1, 0.2, 0.3]},
    ]
    (tmp_path / "own.json").write_text(json.dumps({"version": 1, "edits": said}))
    words = "--model", WORN, "--subjects", "auto", "--edits", tmp_path / "own.json", "--overwrite"
    assert label(*words).status == 0
    rows = rows_of(tmp_path / "out/pair.labels.csv")
    own = {int(row["frame"]): (row["marker"], row["step"]) for row in rows if row["point"] == point}
    assert {own[frame] for frame in range(10, 15)} == {("2:LKNE", "edit")}
    assert {own[frame][0] for frame in (*range(7, 10), *range(15, 47))} == {"1:LKNE"}
    before = {(row["frame"], row["point"]): row["marker"] for row in plain}
    for row in rows:
        was = before[row["frame"], row["point"]]
        if 20 <= int(row["frame"]) <= 25 and was in ("1:LANK", "2:LANK"):
            assert row["marker"] == ("2:LANK" if was == "1:LANK" else "1:LANK")
        elif was not in ("1:LKNE", "2:LKNE"):
            # What is said of an ankle that leaps from one to the other, and of a toe elsewhere, is evidence, too.
            assert row["marker"] == was or (not row["marker"] and was in ("1:LANK", "2:LANK", "2:LTOE"))
    written = read_points(tmp_path / "out/pair.c3d")
    assert np.allclose(written.xyz[5, written.names.index("2:LTOE")], [0.1, 0.2, 0.3], atol=1e-5)
    assert report_of(tmp_path / "out/pair.c3d")["edits"]["applied"] == {"assign": 1, "swap": 1, "place": 1}


@pytest.mark.parametrize("sign", [*' :,*|"', "\x01", "\x7f", "\u200b", "\u202e", "\udcff", 40 * "o"])
def test_what_nobody_can_be_called(label, tmp_path, sign):
    reason = label("--subject", f"a{sign}b={WORN}", "--subject", f"bob={WORN}").refusal(2)
    assert "is no name of a subject; expected up to 40 letters and signs that can be printed" in reason
    assert reason.isprintable()
    assert not (tmp_path / "out").exists()


def test_names_of_any_alphabet_are_names():
    names = ["ann", "1", "Ren\u00e9", "rene\u0301", "\u5c71\u7530", "\u0905\u0928\u0940\u0924\u093e", "a" * 40]
    assert all(is_subject_name(name) for name in names)


def test_who_wears_what_is_said_to_other_processes(run, pair, tmp_path):
    model = tmp_path / "own.markerset.json"
    shutil.copy(markerset_file(WORN), model)
    words = f"--subject=ann={WORN}", f"--subject=bob={model.name}"
    given = build_parser().parse_args(["label", str(pair / "pair.c3d"), f"--out={tmp_path}", *words])
    settle_subjects(given)
    job = as_job(given, pair / "pair.c3d")
    with contextlib.chdir(tmp_path):
        (tmp_path / "parcel").write_bytes(_for_elsewhere(replace(job, own=Path("own"))))
    elsewhere = read_parcel(tmp_path / "parcel")
    assert (elsewhere.wearers, elsewhere.own) == ((("ann", WORN), ("bob", str(model))), tmp_path / "own")
    swapped = replace(job, wearers=(("ann", str(model)), ("bob", WORN)))
    report = tmp_path / "pair.report.json"
    write_json(report, sealed({"take": "pair", "provenance": made_of(swapped) | {"results": {}}}))
    now = made_of(replace(job, wearers=(("ann", WORN), ("bob", str(model)))))
    assert earlier_run(report, now)[0] is not None, "the same content"
    with pytest.raises(InputError, match="differs in --subject;"):
        earlier_run(report, made_of(replace(swapped, wearers=(("bob", str(model)), ("ann", WORN)))))


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """The same two in a ring of eight cameras: blobs, their truth and the calibration."""
    folder = tmp_path_factory.mktemp("seen")
    write_seen(folder)
    return folder


def test_cameras_see_several_with_all_bodies_in_the_way(run, seen, tmp_path):
    truth = (seen / "seen.csv.truth.csv").read_text()
    assert "1:LASI" in truth and "2:LASI" in truth
    words = "--cameras", seen / "room.toml", "--centre", "--calibration-mm", "0.3", "--json"
    take, alone = read_points(seen / "named.c3d"), []
    for who in "12":
        one = take.picked([place for place, name in enumerate(take.names) if name.startswith(who)])
        write_c3d(tmp_path / f"{who}.c3d", one)
        alone.append(run("simulate", tmp_path / f"{who}.c3d", *words, "--out", tmp_path / who).json)
    both = run("simulate", seen / "named.c3d", *words, "--out", tmp_path / "both.csv").json
    assert both["model"] == WORN
    assert both["markers"] == [f"{who}:{name}" for who in "12" for name in open_markerset(WORN).markers]
    shown = [one["blobs"] - one["ghosts"] + one["merged"] for one in (*alone, both)]
    assert shown[2] < shown[0] + shown[1]


def test_blobs_of_two_are_named_in_every_file(run, figures, seen, tmp_path):
    words = "label", seen / "seen.csv", "--cameras", seen / "room.toml", "--rate", RATE
    more = "--trc", "--fill", "--html", "--json"
    run(*words, "--model", WORN, "--subjects", "2", "--out", tmp_path, *more).quiet()
    truth, other = seen / "seen.csv.truth.csv", tmp_path / "other.csv"  # nothing says which of them is 1
    other.write_text(truth.read_text().replace("1:", "0:").replace("2:", "1:").replace("0:", "2:"))
    found = [figures(tmp_path / "seen.labels.csv", one) for one in (truth, other)]
    assert max(one["precision"] for one in found) > 0.998
    assert max(one["recall"] for one in found) > 0.99
    in_every_file(tmp_path, "seen")
    report = report_of(tmp_path / "seen.c3d")
    assert report["method"] == "likelihood"
    assert sum(report["steps"].values()) == sum(row["marker"] != "" for row in rows_of(tmp_path / "seen.labels.csv"))
    assert set(report["timing"]) >= {"place", "label", "fit"}
    said = run(*words, "--subject", f"zoe={WORN}", "--subject", f"ann={WORN}", "--out", tmp_path / "called").out
    assert "zoe is who stands first along a line across the room" in said
    numbered, called = (rows_of(path / "seen.labels.csv") for path in (tmp_path, tmp_path / "called"))
    assert [row["marker"].replace("zoe", "1").replace("ann", "2") for row in called] == [
        row["marker"] for row in numbered
    ]


@pytest.mark.parametrize("method", ["auto", "likelihood"])
def test_blobs_of_two_are_refused_as_of_one_unless_that_is_forced(run, seen, tmp_path, method):
    words = "--model", WORN, "--cameras", seen / "room.toml", "--rate", RATE, "--out", tmp_path, "--method", method
    reason = run("label", seen / "seen.csv", *words).refusal(1)
    assert "by --model MODEL and --subjects 2 or auto; --force goes on regardless" in reason
    run("label", seen / "seen.csv", *words, "--force").done()


def test_edits_of_blobs_land_on_who_they_were_made_of(run, seen, tmp_path):
    """By whichever way the take is named: who is 1 in one of them is so in all."""
    words = "label", seen / "seen.csv", "--model", WORN, "--cameras", seen / "room.toml", "--rate", RATE
    assert run(*words, "--subjects", "2", "--out", tmp_path / "first").status == 0
    before = rows_of(tmp_path / "first/seen.labels.csv")
    said = [{"kind": "swap", "markers": ["2:LKNE", "2:LANK"], "frames": [10, 15]}]
    (tmp_path / "own.json").write_text(json.dumps({"version": 1, "edits": said}))
    for number, asked in enumerate((("2",), ("auto",), ("2", "--target", "0.99"))):
        edited = "--subjects", *asked, "--edits", tmp_path / "own.json", "--out", tmp_path / str(number)
        assert run(*words, *edited).status == 0
        after = rows_of(tmp_path / str(number) / "seen.labels.csv")
        names = np.array([[row["marker"] for row in rows] for rows in (before, after)])
        inside = np.array([10 <= int(row["frame"]) <= 15 for row in before])
        own, other = inside & (names[0] == "2:LKNE"), inside & (names[0] == "2:LANK")
        assert own.sum() > 10
        assert min((names[1, own] == "2:LANK").mean(), (names[1, other] == "2:LKNE").mean()) > 0.95
        rest = ~(own | other) & (names != "").all(axis=0)
        assert (names[1, rest] == names[0, rest]).mean() > 0.99
        report = report_of(tmp_path / str(number) / "seen.c3d")
        assert report["method"] == "likelihood" and report["edits"]["applied"] == {"swap": 1}


def test_a_file_of_two_is_filled_one_by_one(run, pair, tmp_path):
    assert run("label", pair / "pair.c3d", "--model", WORN, "--subjects", "2", "--out", tmp_path / "out").status == 0
    take = read_points(tmp_path / "out/pair.c3d")
    xyz, place = take.xyz[:].copy(), take.names.index("2:LKNE")
    xyz[10:16, place] = np.nan
    write_c3d(tmp_path / "gap.c3d", Points(take.names, xyz, take.residual[:], take.rate, take.first_frame))
    words = "fill", tmp_path / "gap.c3d", "--model", WORN, "--json", "--out"
    found = run(*words, tmp_path / "one.c3d", "--markers", "2:LKNE").json
    assert [(row["marker"], row["first"], row["last"]) for row in found["filled"]] == [("2:LKNE", 17, 22)]
    filled = read_points(tmp_path / "one.c3d").xyz[10:16, place]
    assert np.linalg.norm(filled - take.xyz[10:16, place], axis=1).max() < 0.03
    assert run(*words, tmp_path / "two.c3d", "--markers", "LKNE").status == 2, "whose?"
