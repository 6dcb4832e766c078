# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set of one's own, learned from labelled takes in the sidebar, and used at once."""

import shutil
from dataclasses import replace
from functools import wraps
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from addon.core.data.takes import NO_MARKER, Points
from addon.core.evaluation.comparing import Comparison, TakeDifference
from addon.core.evaluation.relabelling import NameCounts
from addon.core.points.models import ModelHistory, ModelVersion
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from addon.io.models import open_model, write_model
from addon.io.points import write_c3d

from .conftest import write_walk
from .hands import choose, ours, press, refused, session, stored_take


@pytest.fixture(scope="module")
def files(tmp_path_factory, made):
    """Two labelled takes of one person and one without labels."""
    folder = tmp_path_factory.mktemp("training_takes")
    markerset = made.markerset()
    for name, names in (("one", markerset.markers), ("two", markerset.markers), ("raw", [""] * len(markerset))):
        motion = made.motion(markerset, 60)
        residual = np.where(np.isfinite(motion.markers[..., 0]), 0.0, np.nan)
        write_c3d(folder / f"{name}.c3d", Points(tuple(names), motion.markers, residual, 60.0, 1))
    return SimpleNamespace(folder=folder, markers=markerset.markers)


@pytest.fixture
def listed(extension, empty, files):
    chosen = [{"name": "one.c3d"}, {"name": "two.c3d"}]
    press("add_training_takes", directory=files.folder, files=chosen)
    return empty


@pytest.fixture
def own_folder(extension, monkeypatch, tmp_path):
    """The folder of the user's own marker sets, for this test alone."""
    for module in ("ops.training", "props"):
        monkeypatch.setattr(ours(module), "markerset_folder", lambda create=False: tmp_path)
    return tmp_path


@pytest.fixture
def jobs_given(extension, monkeypatch):
    """The jobs of trainings, which are not done: a report says that nothing is against its model, and `said`."""
    given = SimpleNamespace(jobs=[], said={})

    @wraps(ours("jobs.train").train_file)
    def train_file(job):
        given.jobs.append(job)
        yield SimpleNamespace(fraction=0.5)
        doubts = [doubt for take in job.shown for doubt in take.doubts]
        known = {"out": str(job.out), "model": job.out.name.partition(".")[0], "markers": ("A",), "doubts": doubts}
        adopted = {"check": None, "not_adopted_for": [], "written": "", "replaced": [], "body": {"segments": {}}}
        return {**known, **adopted, **given.said}

    monkeypatch.setattr(ours("jobs.train"), "train_file", train_file)
    return given


def test_takes_are_listed_once_and_what_is_learned_of_them_is_saved_chosen_and_names_points(listed, files, own_folder):
    settings = listed.scene.mocap_autolabel
    training = settings.training
    found = [(row.name, row.markers, row.subject) for row in training.takes]
    assert found == [(f"{name}.c3d", 18, files.folder.name) for name in ("one", "two")]
    press("add_training_takes", filepath=files.folder / "one.c3d")
    assert len(training.takes) == 2
    refused(r"raw\.c3d: has no named markers", "add_training_takes", filepath=files.folder / "raw.c3d")
    training.trained_name, training.takes[1].subject = "ours", "bob"
    press("train")
    path = own_folder / "ours.markerset.json"
    assert Path(settings.subjects.markerset) == Path(settings.subjects.markerset_path) == path
    model = open_model(path)
    assert model.markerset.markers == files.markers
    assert {row.subject for row in model.training_takes} == {files.folder.name, "bob"}
    refused(r"ours\.markerset\.json: is there already", "train")
    training.take_index = 1
    press("remove_training_take")
    assert ([row.name for row in training.takes], training.take_index) == (["one.c3d"], 0)

    press("import_points", filepath=files.folder / "raw.c3d")
    press("label")
    take = stored_take()
    named = take.labels.marker >= 0
    assert named.mean() > 0.8
    assert (take.labels.marker[named] == take.rows.trajectory[named]).all()


def test_the_file_that_is_open_is_learned_from_by_one_button(empty, files, own_folder):
    refused("Open a take of 3D points whose file names them", "learn_file")
    press("import_points", filepath=files.folder / "raw.c3d")
    refused("Open a take of 3D points whose file names them", "learn_file")
    press("import_points", filepath=files.folder / "one.c3d")
    press("learn_file")
    path = own_folder / "one.markerset.json"
    assert open_model(path).markerset.markers == files.markers
    assert Path(empty.scene.mocap_autolabel.subjects.markerset) == path, "Label names by it"
    refused(r"one\.markerset\.json: is there already", "learn_file")


def test_a_job_is_what_the_list_says(listed, files, own_folder, extension, jobs_given, monkeypatch):
    jobs_given.said = {"doubts": ["one subject"], "body": {"segments": {"all": list(files.markers)}}}
    settings = listed.scene.mocap_autolabel
    settings.training.takes[0].subject = "ann [2]"
    press("train")
    [job] = jobs_given.jobs
    assert [path.name for path in job.takes] == ["one.c3d", "two.c3d"]
    assert (job.name, job.base, job.overwrite, job.kept) == ("mine", None, False, ())
    assert job.by == ours("jobs.models").system_user() != ""
    assert [name for name, _ in job.subjects] == ["ann [2]", files.folder.name]
    assert [row.name for row in session().doubts] == ["one subject"]
    settings.subjects.markerset = "gait15"
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(ours("ops.training").Trains, "_astray", True)
        press("train")
    assert settings.subjects.markerset == "gait15", "it is not chosen in another file than that it was asked for in"
    settings.subjects.markerset, settings.subjects.markerset_path = "FILE", str(job.out)
    settings.training.train_on = True
    press("train")
    other = jobs_given.jobs[-1]
    assert (other.base, other.out, other.overwrite) == (str(job.out), job.out, True)
    settings.subjects.markerset = "gait15"
    settings.training.trained_name = "../elsewhere"
    refused("no name for a marker set", "train")


def worse() -> dict:
    """What is said of a kept take in which a training made one of two markers worse."""
    there = np.array([100, 100])
    before, after = NameCounts(there, there, 0 * there), NameCounts(there, np.array([100, 20]), np.array([0, 30]))
    return Comparison(("A", "B"), (TakeDifference("kept.c3d", "kept", 100, before, after),)).as_dict()


def test_what_is_worse_is_shown_before_a_button_adopts_it(listed, own_folder, extension, jobs_given):
    check = worse()
    candidate, own = own_folder / "ours.v2-candidate.markerset.json", own_folder / "ours.markerset.json"
    jobs_given.said = {"check": check, "not_adopted_for": check["worse"], "written": str(candidate)}
    base = open_model("gait15")
    write_model(own, base)
    fingerprint = open_model(own).fingerprint
    newer = replace(base, history=ModelHistory((ModelVersion(2, origin=fingerprint),)), likelihood=None)
    write_model(candidate, newer)
    settings, state = listed.scene.mocap_autolabel, session()
    refused("Train a marker set on first", "adopt_model")
    settings.subjects.markerset, settings.training.train_on = str(own), True
    settings.training.takes[1].kept = True
    press("train")
    [job] = jobs_given.jobs
    assert [[path.name for path in paths] for paths in (job.takes, job.kept)] == [["one.c3d"], ["two.c3d"]]
    assert Path(state.candidate) == candidate
    words = [row.name for row in state.differences]
    assert any("worse: B 20.00 % right (100 %) and 30.00 % wrong (0 %)" in line for line in words)
    assert words[-1].startswith("Worse: kept.c3d")
    assert open_model(own).fingerprint == fingerprint, "nothing is adopted before the button"
    press("adopt_model")
    assert open_model(own).likelihood is None
    assert open_model(own_folder / "ours.v1.markerset.json").fingerprint == fingerprint
    assert (state.candidate, len(state.differences), candidate.exists()) == ("", 0, False)
    assert Path(settings.subjects.markerset) == own
    items = ours("props")._markerset_items(settings, listed)
    assert [name for name, *_ in items if name.endswith("json")] == [str(own)], "former versions are not in the list"
    settings.training.takes[0].kept = True
    refused("Add labelled takes first", "train")


@pytest.fixture
def standing(empty, settings, own_folder, tmp_path_factory, name_as):
    """A labelled take of the demo's virtual person in a scene, whose heel nobody has named in its second frame."""
    markerset = open_markerset("body26")
    marker = np.tile(np.arange(len(markerset)), (3, 1))
    marker[1, markerset.markers.index("LHEE")] = NO_MARKER
    xyz = make_performance(markerset).take.xyz[:3]
    files = write_walk(tmp_path_factory.mktemp("standing"), xyz, markerset, 100.0)
    name_as(marker)
    press("import_points", filepath=files.take)
    settings.subjects.markerset = "body26"
    press("label")
    return SimpleNamespace(context=empty, settings=settings, names=markerset.markers, xyz=xyz)


def test_one_frame_of_a_labelled_take_is_learned_from(standing, own_folder, jobs_given):
    jobs_given.said = {"doubts": ["one frame"]}
    standing.settings.training.trained_name = "hers"
    standing.context.scene.frame_set(500)
    refused("the current frame is 500; expected one of the take, 101 to 103", "learn_frame")
    assert not list(own_folder.iterdir())
    standing.context.scene.frame_set(102)
    press("learn_frame")
    [job] = jobs_given.jobs
    [frame] = job.shown
    assert (job.name, job.out, job.base) == ("hers", own_folder / "hers.markerset.json", None)
    assert set(frame.names) == set(standing.names) - {"LHEE"}
    assert frame.xyz.shape == (1, 25, 3)
    where = {name: place for name, place in zip(standing.names, standing.xyz[1], strict=True) if name != "LHEE"}
    assert all(np.allclose(frame.xyz[0, frame.names.index(name)], place, atol=1e-4) for name, place in where.items())
    assert not job.takes
    assert [row.name for row in session().doubts] == ["one frame"]
    job.out.touch()
    refused(r"hers\.markerset\.json: is there already", "learn_frame")


def unsure(standing, marker: str, frame: int):
    table = standing.settings.take["mocap_blobs"]
    of, at = ([one.value for one in table.attributes[name].data] for name in ("marker", "frame"))
    [row] = [i for i, pair in enumerate(zip(of, at, strict=True)) if pair == (standing.names.index(marker), frame)]
    table.attributes["confidence"].data[row].value = 0.5
    ours("scene.opened").opened.forget()


def test_a_whole_take_is_learned_from_but_what_is_doubtful_and_nobody_looked_at(standing, own_folder, jobs_given):
    unsure(standing, "RHEE", 1)
    standing.settings.training.trained_name = "hers"
    press("learn_take")
    [job] = jobs_given.jobs
    assert (job.takes, job.out, job.base, job.body) == ((), own_folder / "hers.markerset.json", None, "body26")
    [take] = job.shown
    assert job.markers == take.names == standing.names, "all markers stay in the set"
    seen = np.isfinite(take.xyz[:, :, 0])
    left, lost = standing.names.index("RHEE"), standing.names.index("LHEE")
    assert seen[:, left].tolist() == [True, False, True]
    assert seen[:, lost].tolist() == [True, False, True]
    assert np.delete(seen, [left, lost], axis=1).all()
    said = [row.name for row in session().doubts]
    assert said[0].startswith("RHEE: 1 doubtful frame that nobody looked at was not learned")
    choose("RHEE")
    press("is_right", scope="WHOLE")
    own = own_folder / "ours.markerset.json"
    shutil.copy(Path(__file__).parents[2] / "assets" / "body26.markerset.json", own)
    standing.settings.subjects.markerset = str(own)
    press("learn_take")
    [_, job] = jobs_given.jobs
    assert np.isfinite(job.shown[0].xyz[:, left]).all(), "what was answered is learned"
    assert (Path(job.base), job.out, job.name, job.overwrite) == (own, own, None, True), "an own set goes on"
    standing.settings.subjects.markerset = "gait15"
    refused("the chosen marker set is not the take's; expected the one", "learn_take")
