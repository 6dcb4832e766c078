# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that cannot be as they are, mirrored or in another's room: refused, unless `--force` is given."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from addon.core.body.sides import mirror_order
from addon.core.data.takes import Points
from addon.core.points.possible import MEND_BLOBS, Handedness, MirroredError
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from addon.io.points import of_frames, read_points, write_c3d
from addon.jobs.train import known_bodies
from addon.jobs.training_takes import read_takes, refuse_mirrored
from tests.inputs.walkers import write_truth

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


def precision(run, folder, labels) -> float:
    return json.loads(run("evaluate", labels, folder / "truth.csv", "--json").done().out)["precision"]


def test_a_mirrored_take_is_refused_and_mended(run, walks, tmp_path):
    def label(*words, name="mirrored.c3d"):
        return run("label", walks / name, "--model", LOPSIDED, "--out", tmp_path / "out", *words)

    assert label(name="plain.c3d").status == 0
    before = sorted((tmp_path / "out").iterdir())
    reason = label().refusal(1)
    assert "is left-handed: one axis is mirrored, as RBAK would be on the other side of the body" in reason
    assert reason.endswith("; --force goes on regardless")
    assert sorted((tmp_path / "out").iterdir()) == before, "nothing is named"

    assert label("--mirror").status == 0
    assert precision(run, walks, tmp_path / "out" / "mirrored.labels.csv") > 0.99
    written = read_points(tmp_path / "out" / "mirrored.c3d")
    recorded = read_points(walks / "plain.c3d")
    # Which axis is reversed is all the same: distances stay, and the triple product has its sign again.
    across, forward = (
        recorded.xyz[0, [recorded.names.index(name) for name in ("LASI", "RASI", "LTOE", "C7")]],
        written.xyz[0, [written.names.index(name) for name in ("LASI", "RASI", "LTOE", "C7")]],
    )
    assert np.linalg.det(across[1:] - across[0]) == pytest.approx(np.linalg.det(forward[1:] - forward[0]), rel=1e-3)

    assert label("--force", "--overwrite").status == 0
    report = json.loads((tmp_path / "out" / "mirrored.report.json").read_text())
    assert any(note.startswith("is left-handed") for note in report["notes"])
    assert "--force" not in json.dumps(report["notes"])


@pytest.mark.parametrize("words", [("--model", LOPSIDED), ("--subject", f"A={LOPSIDED}")])
def test_a_mirrored_take_is_refused_by_the_joints_it_is_named_by(run, walks, tmp_path, words):
    take = read_points(walks / "mirrored.c3d")
    rest = [index for index, name in enumerate(take.names) if name != "T10"]
    write_c3d(tmp_path / "without.c3d", take.picked(rest))
    assert "is left-handed" in run("label", tmp_path / "without.c3d", *words, "--out", tmp_path / "out").refusal(1)


def test_a_take_that_is_mirrored_once_too_often_is_not_told_to_be_mirrored(run, walks, tmp_path):
    reason = run("label", walks / "plain.c3d", "--model", LOPSIDED, "--mirror", "--out", tmp_path).refusal(1)
    assert "; expected points whose file is left-handed, so have these read as they are, without mir" in reason
    assert "--mirror" not in reason


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
    kept = [index for index, name in enumerate(take.names) if name in open_markerset(symmetric).by_name]
    path = tmp_path / "twice.c3d"
    write_c3d(path, Points(tuple(take.names[i] for i in kept), take.xyz[:, kept], take.residual[:, kept], take.rate, 1))
    assert run("label", path, "--model", symmetric, "--out", tmp_path / "out").status == 0


@pytest.mark.parametrize("turned", [(1, 1, 1), (-1, -1, 1)], ids=["as it is", "turned"])
def test_train_learns_from_what_is_right_handed(run, walks, tmp_path, turned):
    take, out = read_points(walks / "plain.c3d"), tmp_path / "own.markerset.json"
    plain, path = tmp_path / "right.c3d", tmp_path / "left.c3d"
    write_c3d(plain, replace(take, xyz=take.xyz * turned))
    write_c3d(path, replace(take, xyz=take.xyz * turned * [-1, 1, 1]))
    refuse_mirrored(read_takes([plain], ()), known_bodies())
    reason = run("train", plain, path, "--out", out).refusal(1)
    assert "left.c3d: is left-handed: one axis is mirrored, as the body of its labels is" in reason
    assert not out.exists()


def moved_blobs(room, path, change) -> None:
    with room.blobs.open(newline="") as file:
        head, *rows = csv.reader(file)
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([head, *map(change, rows)])


def shifted(row):
    return [*row[:2], float(row[2]) + 40, float(row[3]) + 40, *row[4:]]


def renamed(row):
    return [row[0], f"cam{int(row[1].removeprefix('cam')) % 8 + 1}", *row[2:]]


@pytest.mark.parametrize(
    ("change", "words"),
    [(shifted, "the room seems not to be this take's"), (renamed, "cameras seem to have the names of others")],
)
def test_nothing_is_named_in_another_room(label, room, tmp_path, change, words):
    moved_blobs(room, tmp_path / "odd.csv", change)
    reason = label(blobs=[tmp_path / "odd.csv"]).refusal(1)
    assert words in reason
    assert reason.endswith("; --force goes on regardless")
    assert not list((tmp_path / "out").glob("odd.*"))

    label("--force", blobs=[tmp_path / "odd.csv"]).done()
    assert words in json.loads((tmp_path / "out" / "odd.report.json").read_text())["camera_doubts"][0]
