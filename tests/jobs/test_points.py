# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of points from file to files, with a naming that is known: what is said of which trajectory, what is saved."""

import csv
import json
import re

import ezc3d
import numpy as np
import pytest

from addon.blendfile import has_blender
from addon.core.body.bodies import BodyModel
from addon.core.data.errors import JobError
from addon.core.data.takes import NO_MARKER, Points, Suspect
from addon.io.markersets import open_markerset
from addon.io.points import read_points, write_c3d
from addon.jobs import LabelJob, label_file
from addon.jobs import points as job
from addon.jobs.naming import NamedFrames

FRAMES = 60
OUTPUTS = 3  # points before the markers that a model computed


@pytest.fixture
def source(tmp_path):
    """A C3D file of somebody who stands there in gait15 behind three joint angles, and a ghost at the end."""
    markerset = open_markerset("gait15")
    model = BodyModel(markerset)
    markers = model.pose(model.rest(FRAMES, 1.7)).markers
    ghost = np.tile([1.0, 1.0, 1.0], (FRAMES, 1, 1))
    xyz = np.concatenate([np.zeros((FRAMES, OUTPUTS, 3)) + 0.3, markers, ghost], axis=1)
    names = ("LHJC", "RHJC", "CentreOfMass", *[""] * 16)
    path = tmp_path / "walk.c3d"
    write_c3d(path, Points(names, xyz, np.full(xyz.shape[:2], 0.0015), 100.0, 11))
    assert read_points(path).columns.tolist() == list(range(OUTPUTS, 19))
    return path


@pytest.fixture
def of_two_minds(monkeypatch):
    """A naming by which the first marker's trajectory goes over to the second, and back from it, half way."""

    def name_frames(model, method, points, rate, options):
        marker = np.tile(np.r_[np.arange(15), NO_MARKER], (FRAMES, 1))
        marker[FRAMES // 2 :, :2] = 1, 0
        sure = np.where(marker == NO_MARKER, 0.0, 0.9999)
        yield NamedFrames(marker, sure, sure)

    monkeypatch.setattr(job, "name_frames", name_frames)


def label(source, **more):
    for _ in label_file(LabelJob(source, None, "gait15", source.parent / "out", **more)):
        pass
    return source.parent / "out"


def test_suspects_call_a_trajectory_as_the_labels_do(source, of_two_minds):
    out = label(source)
    report = json.loads((out / "walk.report.json").read_text())
    said = [row["reason"] for row in report["suspect"] if "goes over" in row["reason"]]
    assert {int(number) for reason in said for number in re.findall(r"trajectory (\d+)", reason)} == {3, 4}
    with (out / "walk.labels.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["point"] for row in rows} == {str(number) for number in range(3, 19)}
    assert {row["marker"] for row in rows if row["point"] == "3"} == {"SACR", "RASI"}
    labels = ezc3d.c3d(str(source))["parameters"]["POINT"]["LABELS"]["value"]
    assert labels[:3] == ["LHJC", "RHJC", "CentreOfMass"]


@pytest.mark.blender
@pytest.mark.skipif(not has_blender(), reason="needs bpy")
def test_a_saved_file_shows_what_stayed_unnamed(source, of_two_minds):
    import bpy

    from addon.scene.cloud import cloud_points
    from addon.scene.take import stored_take, takes_of

    out = label(source, blend=True)
    bpy.ops.wm.open_mainfile(filepath=str(out / "walk.blend"))
    [collection] = takes_of(bpy.context.scene)
    [cloud] = [thing for thing in collection.all_objects if thing.modifiers]
    np.testing.assert_allclose(cloud_points(cloud.data), np.ones((FRAMES, 3)), atol=1e-5)
    stored = stored_take(collection, bpy.context.scene)
    assert stored.points.shape == (16 * FRAMES, 3)
    np.testing.assert_allclose(stored.residual, 0.0015, rtol=1e-5)
    assert set(stored.blobs.camera.tolist()) == set(range(3, 19))
    assert (stored.labels.marker == NO_MARKER).sum() == FRAMES


@pytest.fixture
def fairly_sure(monkeypatch):
    """A naming that is right in every frame, and no surer than one in two thousand."""

    def name_frames(model, method, points, rate, options):
        marker = np.tile(np.r_[np.arange(15), NO_MARKER], (len(points), 1))
        sure = np.where(marker == NO_MARKER, 0.0, 0.9995)
        yield NamedFrames(marker, sure, sure)

    monkeypatch.setattr(job, "name_frames", name_frames)


@pytest.mark.parametrize(("target", "named"), [(0.999, 15 * 15), (0.99999, 0)])
def test_a_strict_target_leaves_names_out_and_refuses_no_take(source, fairly_sure, target, named):
    report = json.loads((label(source, frames=(11, 25), target=target) / "walk.report.json").read_text())
    assert report["points"] - report["unlabelled"] == named


def test_a_lax_target_makes_no_take_the_model_s(source, monkeypatch):
    def name_frames(model, method, points, rate, options):
        marker = np.tile(np.r_[np.arange(15), NO_MARKER], (len(points), 1))
        sure = np.where(marker == NO_MARKER, 0.0, 0.6)
        yield NamedFrames(marker, sure, sure)

    monkeypatch.setattr(job, "name_frames", name_frames)
    with pytest.raises(JobError, match="does not look like a take of model gait15"):
        label(source, frames=(11, 25), target=0.5)


def test_progress_is_told_from_the_first_look_at_the_take(source, of_two_minds, monkeypatch):
    said = []
    looks = job.refuse_others, job.find_wearer
    monkeypatch.setattr(job, "refuse_others", lambda *given: said.append("refuse_others") or looks[0](*given))
    monkeypatch.setattr(job, "find_wearer", lambda *given: said.append("find_wearer") or looks[1](*given))
    fractions = []
    for progress in label_file(LabelJob(source, None, "gait15", source.parent / "out")):
        said.append(progress.note)
        fractions.append(progress.fraction)
    before = said[: said.index("frame 11")]
    assert before == [
        "look who wears the markers",
        "find_wearer",
        "look whether the model is for this take",
        "refuse_others",
    ]
    assert fractions == sorted(fractions)
    assert 0 == fractions[0] < fractions[1] < fractions[-1] < 1


def test_only_the_number_of_a_trajectory_is_made_the_file_s():
    said = (Suspect(1, 2, "goes over from trajectory 1 to B", 1), Suspect(1, 2, "trajectory 1 jumps"))
    assert [suspect.reason for suspect in job.by_file_number(said, np.array([0, 7]))] == [
        "trajectory 7 goes over from trajectory 1 to B",
        "trajectory 1 jumps",
    ]


def test_progress_only_grows_and_goes_on_while_the_body_is_posed(source, of_two_minds, monkeypatch):
    monkeypatch.setattr("addon.core.body.posing.BATCH", 5)
    told = list(label_file(LabelJob(source, None, "gait15", source.parent / "out")))
    shares = [one.fraction for one in told]
    assert shares == sorted(shares)
    assert shares[0] == 0 and shares[-1] < 1
    posing = [one.fraction for one in told if one.note == "pose the body"]
    assert len(set(posing)) > 10
    assert max(np.diff(sorted(set(posing)))) < 0.1


def test_each_part_begins_where_the_work_before_it_is_done():
    for method in ("evidence", "fit"):
        for frames in (1, 100, 100_000):
            shares = job.begins(frames, method)
            assert list(shares) == ["wearer", "others", "name", "vote", "pose", "write"]
            assert list(shares.values()) == sorted(shares.values())
            assert shares["wearer"] == 0 and shares["write"] < 1
    long = job.begins(100_000, "evidence")
    assert long["name"] < 0.01
    assert long["vote"] > 0.8
