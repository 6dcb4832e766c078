# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of points from file to files with a naming that is known; trajectories on disk."""

import csv
import json
import re
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass

import ezc3d
import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.data.progress import finished
from addon.core.data.takes import BY_LIKELIHOOD, NO_MARKER, NO_STEP, Labels, Points
from addon.core.edits.kinds import Edits, Right
from addon.core.points.likelihood.frames import LikelihoodNamer
from addon.core.points.whole_take import pipeline
from addon.core.reconstruction.trajectories import Reconstructed
from addon.io.markersets import AUTO_MODEL, open_markerset
from addon.io.points import read_points, write_c3d
from addon.jobs import LabelJob, label_file, rebuild
from addon.jobs import live as live_file
from addon.jobs.rebuild import TrajectoryFile

FRAMES = 60
COMPUTED = ("LHJC", "RHJC", "CentreOfMass")  # points before the markers that a model computed
OUTPUTS = len(COMPUTED)


def write_source(path, xyz):
    """Writes points without names behind three joint angles."""
    xyz = np.concatenate([np.full((FRAMES, OUTPUTS, 3), 0.3), xyz], axis=1)
    names = (*COMPUTED, *[""] * (xyz.shape[1] - OUTPUTS))
    write_c3d(path, Points(names, xyz, np.full(xyz.shape[:2], 0.0015), 100.0, 11))


@pytest.fixture
def source(tmp_path):
    """A C3D file of somebody who stands there in gait15, and a ghost at the end."""
    model, path = BodyModel(open_markerset("gait15")), tmp_path / "walk.c3d"
    write_source(path, np.concatenate([model.pose(model.rest(FRAMES, 1.7)).markers, np.ones((FRAMES, 1, 3))], axis=1))
    assert read_points(path).columns.tolist() == list(range(OUTPUTS, 19))
    return path


@dataclass(frozen=True)
class Known:
    """A namer of which every answer is known: the markers `said` of a number of frames, all of them equally sure."""

    said: Callable[[int], np.ndarray]
    sure: float
    step: int = BY_LIKELIHOOD

    def name(self, points, rate):
        marker = self.said(len(points))
        named = marker != NO_MARKER
        sure = np.where(named, self.sure, 0.0)
        yield Labels(marker, np.where(named, self.step, NO_STEP), sure, sure)


def right(frames: int) -> np.ndarray:
    """The truth of the markers and the ghost, frame by frame."""
    return np.tile(np.r_[np.arange(15), NO_MARKER], (frames, 1))


def use(monkeypatch, namer):
    """Lets the pipeline name the take by this; the first look at some frames stays the model's own, and unheard."""
    look = pipeline.refuse_others

    def unheard(model, _, *rest):
        look(model, LikelihoodNamer(model.likelihood), *rest)

    monkeypatch.setattr(pipeline, "namer_of", lambda model, method: namer)
    monkeypatch.setattr(pipeline, "refuse_others", unheard)


@pytest.fixture
def of_two_minds(monkeypatch):
    """A naming by which the first marker's trajectory goes over to the second, and back from it, half way."""

    def said(frames: int) -> np.ndarray:
        marker = right(frames)
        marker[frames // 2 :, :2] = 1, 0
        return marker

    use(monkeypatch, Known(said, 0.9999))


def label(source, **more) -> dict:
    """Labels the take into `out` beside it, and gives the report."""
    job = LabelJob(source, None, "gait15", source.parent / "out", **more)
    finished(label_file(job))
    return json.loads(job.path(".report.json").read_text())


def test_suspects_call_a_trajectory_as_the_labels_do(source, of_two_minds):
    xyz = read_points(source).xyz.copy()
    xyz[FRAMES // 2 :, :2] = xyz[FRAMES // 2 :, 1::-1]
    write_source(source, xyz)
    said = [row["reason"] for row in label(source)["suspect"] if "behind a gap or a leap" in row["reason"]]
    assert {int(number) for reason in said for number in re.findall(r"trajectory (\d+)", reason)} == {3, 4}
    with (source.parent / "out" / "walk.labels.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["point"] for row in rows} == {str(number) for number in range(3, 19)}
    assert {row["marker"] for row in rows if row["point"] == "3"} == {"SACR", "RASI"}
    assert ezc3d.c3d(str(source))["parameters"]["POINT"]["LABELS"]["value"][:3] == list(COMPUTED)


@pytest.mark.parametrize(("target", "named"), [(0.999, 15 * 15), (1 - 1e-15, 0)])
def test_a_strict_target_leaves_names_out_and_refuses_no_take(source, monkeypatch, target, named):
    """A naming that is right in every frame, and no surer than one in two thousand."""
    use(monkeypatch, Known(right, 0.9995))
    report = label(source, frames=(11, 25), target=target, edits=Edits((Right("SACR"),)))
    assert report["points"] - report["unlabelled"] == named
    assert [row["file"] for row in report["provenance"]["edits"]] == [""], "they are in no file"


def test_a_set_that_is_saved_while_a_take_is_labelled_is_no_part_of_that(source, monkeypatch):
    listed = iter([["gait15"]])
    monkeypatch.setattr("addon.jobs.job.known_models", lambda _: next(listed, ["body39", "gait15"]))
    job = LabelJob(source, None, AUTO_MODEL, source.parent / "out")
    finished(label_file(job))
    report = json.loads(job.path(".report.json").read_text())
    assert [row["file"] for row in report["provenance"]["model"]] == [report["model"]] == ["gait15"]


def test_progress_only_grows_and_goes_on_while_the_body_is_posed(source, of_two_minds, monkeypatch):
    monkeypatch.setattr("addon.core.posing.posing.BATCH_FRAMES", 5)
    told = list(label_file(LabelJob(source, None, "gait15", source.parent / "out")))
    shares = [one.fraction for one in told]
    assert shares == sorted(shares) and shares[0] == 0 and shares[-1] < 1
    posing = [one.fraction for one in told if one.note == "pose the body"]
    assert len(set(posing)) > 10
    assert max(np.diff(sorted(set(posing)))) < 0.1
    assert max(posing) - min(posing) > 0.15, "it takes as long as naming, or half of that"
    found = LabelJob(source, None, AUTO_MODEL, source.parent / "found", fill=True)
    shares = [one.fraction for one in label_file(found)]
    assert shares == sorted(shares) and shares[0] == 0 and shares[-1] < 1


def test_the_report_says_what_is_the_matter_and_what_labelling_again_changed(source, monkeypatch):
    lost = right(FRAMES)
    lost[:, 6] = NO_MARKER

    def labelled(said) -> dict:
        monkeypatch.setattr(pipeline, "namer_of", lambda *_: Known(said, 0.9999))
        return label(source, method="ensemble", overwrite=True)

    first = labelled(lambda frames: lost[:frames])
    name, worst = open_markerset("gait15").markers[6], first["trouble"][0]
    assert "changed" not in first
    assert (worst["kind"], worst["markers"], worst["stake"]) == ("missing", [name], FRAMES)
    assert first["to_look_at"].endswith(f"worst: {worst['reason']}")
    again = labelled(right)
    assert not any(one["kind"] == "missing" for one in again["trouble"])
    said = [(one["marker"], one["what"], one["first"], one["last"]) for one in again["changed"]]
    assert (said, again["changed_in_all"]) == ([(name, "gained", 11, 70)], "60 labels more")


def part(first: int, frames: int, spans: dict[int, range]) -> Reconstructed:
    """Frames of trajectories: each point is at (its frame, its trajectory, 1) m."""
    pairs = [(f, t) for f in range(frames) for t, span in spans.items() if first + f in span]
    frame, trajectory = np.array(pairs, int).reshape(-1, 2).T
    points = np.column_stack([first + frame, trajectory, np.ones(len(frame))]) / 100
    rows = np.zeros((len(frame), 3), int)
    return Reconstructed(np.arange(first, first + frames), frame, trajectory, points, 0.001 * frame, rows, 0.3)


def test_trajectories_come_back_in_columns_without_the_shortest(tmp_path):
    spans = {0: range(10, 30), 1: range(12, 14), 2: range(20, 40)}
    with TrajectoryFile(tmp_path, 50.0) as file:
        file.add(part(10, 10, spans))
        file.add(part(20, 20, spans))
        points = file.points()
        assert (points.first_frame, points.rate, points.names) == (10, 50.0, ("", ""))
        assert points.xyz.shape == (30, 2, 3)
        whole = points.xyz[:]
        np.testing.assert_allclose(whole[:20, 0, 0], np.arange(10, 30) / 100, atol=1e-6)
        assert np.isnan(whole[20:, 0]).all() and np.isnan(whole[:10, 1]).all()
        np.testing.assert_allclose(whole[10:, 1, 1], 0.02, atol=1e-6)
        np.testing.assert_array_equal(points.xyz[15], whole[15])
        np.testing.assert_allclose(points.residual[3:6][:, 0], [0.003, 0.004, 0.005], atol=1e-6)
        write_c3d(tmp_path / "a.c3d", points)
    np.testing.assert_allclose(read_points(tmp_path / "a.c3d").xyz, whole, atol=1e-6)


def test_many_trajectories_share_columns_when_they_are_far_apart_in_time(tmp_path, monkeypatch):
    monkeypatch.setattr(rebuild, "MAX_COLUMNS", 3)
    spans = {number: range(40 * number, 40 * number + 30) for number in range(5)}
    with TrajectoryFile(tmp_path, 5.0) as file:
        file.add(part(0, 200, spans))
        points = file.points()
        assert points.xyz.shape[1] == 1
        np.testing.assert_allclose(points.xyz[:][[0, 45, 170], 0, 1], [0, 0.01, 0.04], atol=1e-6)


@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize("sizes", [[10] * 40, [45, 40]])
def test_columns_that_no_file_could_hold_stand_nearer_to_each_other(tmp_path, monkeypatch, live, sizes):
    for module in (rebuild, live_file):
        monkeypatch.setattr(module, "MAX_POINTS", 50)
    monkeypatch.setattr(rebuild, "MAX_COLUMNS", 3)
    spans = dict(enumerate(range(4 * at, 4 * at + 4) for at, size in enumerate(sizes) for _ in range(size)))
    with live_file.LiveFile(tmp_path, 100.0, ()) if live else TrajectoryFile(tmp_path, 100.0) as file:
        monkeypatch.setattr(file.spans, "lasting", lambda _: np.arange(len(spans)))
        file.add(part(0, 4 * len(sizes), spans))
        points = file.points()
    assert points.xyz.shape[1] <= 50
    assert np.isfinite(points.xyz[:][..., 0]).sum() == sum(map(len, spans.values()))


def test_memory_stays_flat(tmp_path):
    peaks = []
    for chunks in (45, 120):
        (tmp_path / str(chunks)).mkdir()
        with TrajectoryFile(tmp_path / str(chunks), 100.0) as file:
            tracemalloc.start()
            for number in range(chunks):
                file.add(part(100 * number, 100, {t: range(100_000) for t in range(10)}))
            write_c3d(tmp_path / "a.c3d", file.points())
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0] + 200_000
