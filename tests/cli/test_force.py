# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that cannot be as they are, mirrored or in another's room: refused, unless `--force` is given."""

import json
from dataclasses import replace

import numpy as np
import pytest

from addon.core.body.sides import mirror_order
from addon.core.points.possible import MEND_BLOBS, Handedness, MirroredError
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from addon.io.points import of_frames, read_points, write_c3d
from addon.jobs.train import known_bodies
from addon.jobs.training_takes import read_takes, refuse_labels
from scripts.virtual_take import write_virtual_take
from tests.inputs.walkers import write_truth

from .conftest import report_of, rows_of

LOPSIDED = "body39"  # by RBAK


@pytest.fixture(scope="module")
def walks(tmp_path_factory):
    """Somebody in `body39` who walks, as recorded and mirrored, with the truth of both; names are in the files."""
    folder = tmp_path_factory.mktemp("walks")
    take = of_frames(make_performance(open_markerset(LOPSIDED)).take, (100, 160))
    write_c3d(folder / "plain.c3d", take)
    write_c3d(folder / "mirrored.c3d", replace(take, xyz=take.xyz * [-1.0, 1.0, 1.0]))
    write_truth(folder / "truth.csv", take.xyz, take.names, take.first_frame)
    return folder


def test_a_mirrored_take_is_refused_and_mended(run, figures, walks, tmp_path):
    out = tmp_path / "out"

    def label(*words, name="mirrored.c3d"):
        return run("label", walks / name, "--model", LOPSIDED, "--out", out, *words)

    assert label(name="plain.c3d").status == 0
    before = sorted(out.iterdir())
    reason = label().refusal(1)
    assert "is left-handed: one axis is mirrored, as RBAK would be on the other side of the body" in reason
    assert reason.endswith("; --force goes on regardless")
    assert sorted(out.iterdir()) == before, "nothing is named"

    reason = run("label", walks / "plain.c3d", "--model", LOPSIDED, "--mirror", "--out", tmp_path).refusal(1)
    assert "; expected points whose file is left-handed, so have these read as they are, without mir" in reason
    assert "--mirror" not in reason, "who mirrored is not told to"
    assert label("--mirror").status == 0
    assert figures(out / "mirrored.labels.csv", walks / "truth.csv")["precision"] > 0.99
    # Which axis is reversed is all the same: distances stay, and the triple product has its sign again.
    products = []
    for take in map(read_points, (walks / "plain.c3d", out / "mirrored.c3d")):
        xyz = take.xyz[0, [take.names.index(name) for name in ("LASI", "RASI", "LTOE", "C7")]]
        products.append(np.linalg.det(xyz[1:] - xyz[0]))
    assert products[0] == pytest.approx(products[1], rel=1e-3)

    assert label("--force", "--overwrite").status == 0
    notes = report_of(out / "mirrored.c3d")["notes"]
    assert len([note for note in notes if note.startswith("is left-handed")]) == 1, notes
    assert "--force" not in json.dumps(notes)


@pytest.mark.parametrize("words", [("--model", LOPSIDED), ("--subject", f"A={LOPSIDED}")])
def test_a_mirrored_take_is_refused_by_the_joints_it_is_named_by(run, walks, tmp_path, words):
    take = read_points(walks / "mirrored.c3d")
    rest = [index for index, name in enumerate(take.names) if name != "T10"]
    write_c3d(tmp_path / "without.c3d", take.picked(rest))
    assert "is left-handed" in run("label", tmp_path / "without.c3d", *words, "--out", tmp_path / "out").refusal(1)


def test_whoever_does_not_wear_what_tells_the_sides_is_named_mirrored_or_not(run, walks, tmp_path):
    take = read_points(walks / "mirrored.c3d")
    write_c3d(tmp_path / "without.c3d", take.picked([at for at, name in enumerate(take.names) if name != "RBAK"]))
    assert run("label", tmp_path / "without.c3d", "--model", LOPSIDED, "--out", tmp_path / "out").status == 0


def test_of_blobs_it_is_images_or_calibration_that_are_mirrored(walks, label, room):
    take = read_points(walks / "mirrored.c3d")
    body = open_markerset(LOPSIDED)
    heard = Handedness(body, MEND_BLOBS)
    exchanged = mirror_order(body.markers)  # as they are named: all but what is lopsided goes with it
    heard.add(take.xyz[:, [take.names.index(name) for name in body.markers]][:, exchanged])
    with pytest.raises(MirroredError, match=r"; expected images and a calibration of which none is mirrored$"):
        heard.refuse()
    said = label("--mirror", blobs=[room.blobs]).done().err
    assert "--mirror is not looked at for blobs: what is mirrored of them is their images" in said


def test_results_are_of_the_same_mirror_and_force(run, walks, tmp_path):
    words = ["label", walks / "mirrored.c3d", "--model", LOPSIDED, "--out", tmp_path]
    assert run(*words, "--mirror").status == 0
    for other in ("--force", "--force --mirror"):
        assert run(*words, "--resume", *other.split()).status == 2, "these results were made otherwise"
    assert run(*words, "--resume", "--mirror").status == 0


@pytest.mark.parametrize("symmetric", ["gait15", "body26"])
def test_of_a_set_that_has_all_twice_nothing_is_said(run, walks, tmp_path, symmetric):
    take = read_points(walks / "mirrored.c3d")
    path, known = tmp_path / "twice.c3d", open_markerset(symmetric).by_name
    write_c3d(path, take.picked([index for index, name in enumerate(take.names) if name in known]))
    assert run("label", path, "--model", symmetric, "--out", tmp_path / "out").status == 0


@pytest.mark.parametrize("turned", [(1, 1, 1), (-1, -1, 1)], ids=["as it is", "turned"])
def test_train_learns_from_what_is_right_handed(run, walks, tmp_path, turned):
    take, out = read_points(walks / "plain.c3d"), tmp_path / "own.markerset.json"
    plain, path = tmp_path / "right.c3d", tmp_path / "left.c3d"
    write_c3d(plain, replace(take, xyz=take.xyz * turned))
    write_c3d(path, replace(take, xyz=take.xyz * turned * [-1, 1, 1]))
    refuse_labels(read_takes([plain], ()), known_bodies())
    reason = run("train", plain, path, "--out", out).refusal(1)
    assert "left.c3d: is left-handed: one axis is mirrored, as the body of its labels is" in reason
    assert not out.exists()


@pytest.mark.parametrize(
    ("times", "status", "words"),
    [
        (
            0.001,
            1,
            "has a unit that cannot be: its points are about 0.001 times as far apart as those of body39; exp",
        ),
        (10, 1, "has a unit that cannot be: its points are about 10 times as far apart as those of body39; expected a"),
        (5000, 2, "odd.c3d: has markers over 1000 m from its origin; expected places in a room, in a file that says"),
    ],
)
def test_train_learns_from_no_other_unit(run, walks, tmp_path, times, status, words):
    take, out = read_points(walks / "plain.c3d"), tmp_path / "own.markerset.json"
    write_c3d(tmp_path / "odd.c3d", replace(take, xyz=take.xyz * times))
    assert words in run("train", tmp_path / "odd.c3d", "--out", out).refusal(status)
    assert not out.exists()


def shifted(row):
    return row | {"x": float(row["x"]) + 40, "y": float(row["y"]) + 40}


def renamed(row):
    return row | {"camera": f"cam{int(row['camera'].removeprefix('cam')) % 8 + 1}"}


@pytest.mark.parametrize(
    ("change", "words"),
    [(shifted, "the room seems not to be this take's"), (renamed, "cameras seem to have the names of others")],
)
def test_nothing_is_named_in_another_room(label, room, tmp_path, change, words):
    lines = [",".join(map(str, change(row).values())) for row in rows_of(room.blobs)]
    head = room.blobs.read_text().partition("\n")[0]
    (tmp_path / "odd.csv").write_bytes("\r\n".join([head, *lines, ""]).encode())
    reason = label(blobs=[tmp_path / "odd.csv"]).refusal(1)
    assert words in reason
    assert reason.endswith("; --force goes on regardless")
    assert not list((tmp_path / "out").glob("odd.*"))
    label("--force", blobs=[tmp_path / "odd.csv"]).done()
    assert words in report_of(tmp_path / "out" / "odd.c3d")["camera_doubts"][0]


def test_blobs_at_a_rate_that_cannot_be_are_not_named(label, tmp_path):
    write_virtual_take(tmp_path, 200, 100, "fast.csv", "room.toml")
    words = {"blobs": [tmp_path / "fast.csv"], "cameras": tmp_path / "room.toml"}
    assert "has a rate that cannot be: at 600 Hz" in label("--rate", "600", **words).refusal(1)
    assert not (tmp_path / "out").exists()
    label("--rate", "600", "--force", **words).done()
    assert report_of(tmp_path / "out" / "fast.c3d")["notes"][0].startswith("has a rate that cannot be")
    label("--rate", "60", "--overwrite", **words).done()
