# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes to learn from, and by which a training on is checked: whose, which markers, and what cannot be used."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.data.progress import finished
from addon.core.data.takes import Points
from addon.core.edits.kinds import Edits, Right
from addon.core.evaluation.relabelling import NO_NAME, UNTOLD
from addon.core.points.models import Model, ModelHistory, ModelVersion, TrainingTake, by_subject
from addon.core.training.takes import gathered, of_markers, training_takes_of, without_replaced
from addon.io.edits import write_edits
from addon.io.markersets import open_markerset
from addon.io.models import open_model, write_model
from addon.io.points import read_points, write_c3d
from addon.io.source import digest
from addon.jobs import checking, train
from addon.jobs.checking import FRAMES, KEPT, TAUGHT, files_of, kept_file, takes_to_check
from addon.jobs.models import VersionPlaces, adopt
from addon.jobs.train import TrainJob, train_file
from addon.jobs.training_takes import KnownBetter, chosen_markers, read_takes, unseen_markers
from tests.core.toybody import toy_markerset
from tests.io.checks import refused
from tests.io.qtm_file import FILLED, MEASURED, Trajectory, write_qtm
from tests.io.samples import capture

NAMES, WORN = tuple("ABCDE"), toy_markerset().markers
BOTH = tuple(f"{who}:{name}" for who in ("Ann", "Bob") for name in NAMES)


def write(
    path: Path, names=NAMES, frames: int = 30, size: float = 1.0, seed: int = 0, hidden=(), residual=0.0004
) -> Path:
    """A labelled take of markers that stand around each other and move a little, but for those hidden."""
    path.parent.mkdir(exist_ok=True)
    places = np.random.default_rng(1).uniform([-0.4, -0.3, 0.1], [0.4, 0.3, 1.7], (len(names), 3))
    xyz = size * (places + np.random.default_rng(seed).normal(0, 0.02, (frames, len(names), 3)))
    xyz[:, [names.index(name) for name in hidden]] = np.nan
    write_c3d(path, Points(tuple(names), xyz, np.broadcast_to(residual, xyz.shape[:2]), 100.0, 1))
    return path


def test_folders_or_patterns_tell_the_subjects(tmp_path):
    paths = [write(tmp_path / "ann" / "1.c3d"), write(tmp_path / "bob" / "1.c3d"), write(tmp_path / "bob" / "2.c3d")]
    assert [take.subject for take in read_takes(paths, ())] == ["ann", "bob", "bob"]
    assert [take.subject for take in read_takes(paths, [("x", "*/bob/*"), ("y", "1.c3d")])] == ["y", "x", "x"]
    assert [take.subject for take in read_takes(paths[1:], ())] == ["bob", "bob"]
    refused("no take suits the subject", read_takes, paths, [("x", "*.trc")])


def test_markers_are_those_in_common_or_those_asked_for(tmp_path):
    paths = write(tmp_path / "1.c3d", (*NAMES, "X")), write(tmp_path / "2.c3d", ("Ann:Y", *NAMES[::-1]))
    takes = read_takes(paths, ())
    assert chosen_markers(takes, None) == NAMES
    assert chosen_markers(takes, ["B", "C", "X", "A"]) == ("B", "C", "X", "A")
    refused("no take has a marker Z", chosen_markers, takes, ["A", "B", "C", "Z"])
    odd = read_takes([write(tmp_path / "3.c3d", (*NAMES, "a,b"))], ())
    refused("'a,b', which has a sign that label files need", chosen_markers, odd, None)
    assert chosen_markers(odd, NAMES) == NAMES
    refused("2 markers cannot be told apart", chosen_markers, takes, ["A", "B"])
    [points] = gathered(takes, ("X", "A", "Y")).values()
    assert points.shape == (60, 3, 3)
    assert np.isfinite(points[:, 1]).all()
    assert np.isnan(points[30:, 0]).all()


def test_a_model_that_is_trained_on_keeps_its_markers_and_what_is_known_their_order(tmp_path):
    takes = read_takes([write(tmp_path / "1.c3d", NAMES[:4])], ())
    assert chosen_markers(takes, None, NAMES) == NAMES
    refused("few of the model's markers", chosen_markers, takes, None, tuple("VWXYZA"))
    assert chosen_markers(takes, ["E", "B", "A", "C"], NAMES) == ("E", "B", "A", "C")
    refused("no take has a marker Z", chosen_markers, takes, ["A", "B", "C", "Z"], NAMES)
    points = np.arange(12, dtype=np.float32).reshape(1, 4, 3)
    [found] = of_markers([TrainingTake("ann", ("1",), 9, points)], NAMES[:4], ("C", "E", "A"))
    np.testing.assert_array_equal(found.points[0], [points[0, 2], [np.nan] * 3, points[0, 0]])
    assert (found.subject, found.takes, found.frames, found.points.dtype) == ("ann", ("1",), 9, np.float32)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("names", "hidden", "words"),
    [
        (("", "", "*3", "", ""), (), "no named markers"),
        (("A", "A", "B", "C"), (), "label A twice"),
        (BOTH, (), "has 2 subjects (Ann, Bob)"),
        (NAMES[:3], (), "3 named markers; expected 4"),
        ((*NAMES, ""), NAMES, "none of its named markers in any frame"),
        (None, (), "does not begin"),
    ],
)
def test_takes_that_cannot_be_used(tmp_path, names, hidden, words):
    path = tmp_path / "take.c3d"
    path.write_text("nothing") if names is None else write(path, names, hidden=hidden)
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        read_takes([path], ())
    assert caught.value.file == str(path)


def test_one_of_the_subjects_of_a_take_is_learned(tmp_path):
    path = write(tmp_path / "take.c3d", BOTH)
    for place, who in enumerate(("Ann", "Bob")):
        [take] = read_takes([path], [(who, "take.*")])
        assert (take.subject, take.names) == (who, NAMES)
        np.testing.assert_array_equal(take.xyz, read_points(path).xyz[:, place * len(NAMES) :][:, : len(NAMES)])


def test_what_was_filled_is_not_learned(tmp_path):
    """By the residual of a C3D file, and by what a capture says of each sample."""
    take = read_points(write(tmp_path / "ann" / "walk.c3d"))
    residual = np.full(take.xyz.shape[:2], 0.001)
    residual[5:9, 1] = 0.0
    write_c3d(tmp_path / "ann" / "filled.c3d", Points(take.names, take.xyz, residual, take.rate, take.first_frame))
    tracks = []
    for index, name in enumerate(take.names):
        kinds = [FILLED if index == 1 and 5 <= frame < 9 else MEASURED for frame in range(len(take.xyz))]
        rows = [(*xyz.tolist(), 0.5, kind) for xyz, kind in zip(1000 * take.xyz[:, index], kinds, strict=True)]
        tracks.append(Trajectory(name, [(1, len(take.xyz))], rows))
    write_qtm(tmp_path / "ann" / "filled.qtm", replace(capture(), trajectories=tracks))
    for name in ("filled.c3d", "filled.qtm"):
        [learned] = read_takes([tmp_path / "ann" / name], [])
        missing = np.isnan(learned.xyz[..., 0]) & np.isfinite(take.xyz[..., 0])
        assert np.argwhere(missing).tolist() == [[frame, 1] for frame in range(5, 9)]
        assert f"{name}: 4 samples filled and not measured, so not learned" in learned.doubts


def test_a_take_in_another_unit_is_found_by_its_size(tmp_path):
    paths = [write(tmp_path / f"{index}.c3d", seed=index) for index in range(3)]
    refused(r"9\.\d+ times as large", read_takes, [*paths, write(tmp_path / "big.c3d", size=10.0)], ())


def test_a_row_is_kept_of_every_take_and_a_subject_has_its_takes_together(tmp_path):
    paths = [write(tmp_path / who / f"{take}.c3d", seed=take) for who, take in (("ann", 1), ("bob", 2), ("ann", 3))]
    kept = training_takes_of(read_takes(paths, ()), NAMES)
    rows = [(row.subject, row.takes, row.frames) for row in kept]
    assert rows == [("ann", ("1.c3d",), 30), ("ann", ("3.c3d",), 30), ("bob", ("2.c3d",), 30)]
    for row, path in zip(kept, (paths[0], paths[2], paths[1]), strict=True):
        np.testing.assert_allclose(row.points, read_points(path).xyz, atol=1e-6)
    whole = by_subject(kept)
    assert list(whole) == ["ann", "bob"]
    np.testing.assert_array_equal(whole["ann"], np.concatenate([row.points for row in kept[:2]]))


def test_another_take_of_the_same_name_is_added_and_said(tmp_path):
    before = training_takes_of(read_takes([write(tmp_path / "ann" / "1.c3d", seed=1)], ()), NAMES)
    other = read_takes([write(tmp_path / "monday" / "1.c3d", seed=9)], [("ann", "*")])
    left, gone, doubts = without_replaced(before, other)
    assert (left, gone) == (before, [])
    assert doubts == ["1.c3d of ann is another take than the one that the model knows by that name, so both are kept"]
    assert without_replaced(before, read_takes([write(tmp_path / "bob" / "1.c3d", seed=1)], ())) == (before, [], [])


def own_output(path: Path, report: dict | None = None) -> Path:
    """A take as `label` writes it, with its report beside it, which doubts a marker and filled another."""
    write(path)
    rows = {"doubtful": {"A": [[5, 14]]}, "filled": [{"marker": "B", "first": 1, "last": 3}]}
    made = {"provenance": {"results": {".c3d": digest(path)}, "options": {}}}
    path.with_name(f"{path.stem}.report.json").write_text(json.dumps({**made, **rows, **(report or {})}))
    return path


@pytest.mark.parametrize("first", [1, -40])
def test_of_our_own_output_only_what_somebody_looked_at_is_learned(tmp_path, first):
    """Its file's first frame is 1, whatever its source called it."""
    filled = {"marker": "B", "first": first, "last": first + 2}
    report = {"first_frame": first, "doubtful": {"A": [[first + 4, first + 13]]}, "filled": [filled]}
    [take] = read_takes([own_output(tmp_path / "walk.c3d", report)], ())
    column = [take.names.index(name) for name in "ABC"]
    seen = np.isfinite(take.xyz[:, column, 0])
    assert np.flatnonzero(~seen[:, 0]).tolist() == list(range(4, 14)), "what is doubtful"
    assert np.flatnonzero(~seen[:, 1]).tolist() == [0, 1, 2], "what was filled"
    assert seen[:, 2].all()
    [said] = take.doubts
    assert said.startswith("walk.c3d: A: 10 doubtful frames that nobody looked at were not learned")
    write_edits(tmp_path / "walk.edits.json", Edits((Right("A", frames=(first + 4, first + 8)),)))
    [take] = read_takes([tmp_path / "walk.c3d"], ())
    missing = np.flatnonzero(np.isnan(take.xyz[:, take.names.index("A"), 0]))
    assert missing.tolist() == list(range(9, 14))


def test_a_take_changed_since_is_what_somebody_says_and_one_all_doubtful_teaches_nothing(tmp_path):
    path = own_output(tmp_path / "walk.c3d")
    write(path, seed=5)
    [take] = read_takes([path], ())
    assert np.isfinite(take.xyz).all()
    assert take.doubts == ()
    (tmp_path / "walk.report.json").write_text('{"made_of": 5}')
    assert np.isfinite(read_takes([path], ())[0].xyz).all()
    every = {name: [[1, 30]] for name in NAMES}
    with pytest.raises(InputError, match="is doubtful in all of its frames, and nobody looked at it; expected"):
        read_takes([own_output(tmp_path / "walk.c3d", {"doubtful": every, "filled": []})], ())
    for damaged in ({"first_frame": "one"}, {"first_frame": 10**400}, {"first_frame": 7, "doubtful": {"A": [[1]]}}):
        refused("is damaged in its frames; expected", read_takes, [own_output(tmp_path / "walk.c3d", damaged)], ())


def test_markers_that_no_take_shows_stay_where_a_known_body_has_them(tmp_path):
    markerset = open_markerset("gait15")
    every, heels = set(markerset.markers), ("LHEE", "RHEE")
    path = write(tmp_path / "walk.c3d", (*markerset.markers, "NOTHING"), hidden=(*heels, "NOTHING"))
    takes = read_takes([path], ())
    known, lost = unseen_markers(takes, [markerset])
    assert (known, lost) == (heels[::-1], ("NOTHING",))
    assert set(chosen_markers(takes, None, (), known)) == every
    assert set(chosen_markers(takes, None)) == every - {*heels}
    assert unseen_markers(takes, []) == ((), (*heels[::-1], "NOTHING"))
    takes = read_takes([write(path, (*markerset.markers, "NOTHING"), hidden=(*heels, "NOTHING", "LTOE"))], ())
    known, _ = unseen_markers(takes, [markerset])
    assert set(chosen_markers(takes, None, (), known)) == every - {*known}, "a part of it was worn"
    assert set(chosen_markers(takes, markerset.markers, (), known)) == every, "who asks for it knows"


def taught_frames(who: str, markers: int = len(WORN)) -> TrainingTake:
    points = np.random.default_rng(4).normal(size=(9, markers, 3)).astype(np.float32)
    return TrainingTake(who, (f"{who}.c3d",), 9, points)


def base_of(tmp_path, taught=(), kept=(), subjects=("ann", "bob")):
    """A model at tmp_path/m.markerset.json, taught some takes and checked on others."""
    file = tmp_path / "m.markerset.json"
    taught, kept = (tuple(kept_file(path, file, KnownBetter()).take for path in paths) for paths in (taught, kept))
    history = ModelHistory((ModelVersion(1, takes=taught),), kept)
    return Model(toy_markerset(), training_takes=tuple(map(taught_frames, subjects)), history=history), file


def told(check):
    return [(take.name, kind) for take, kind in check.takes]


def test_takes_that_are_there_are_checked_on_and_else_what_the_model_keeps(tmp_path):
    ann, kept = write(tmp_path / "ann" / "ann.c3d", WORN), write(tmp_path / "kept" / "k.c3d", WORN, seed=1)
    base, file = base_of(tmp_path, [ann], [kept])
    given = read_takes([write(tmp_path / "cora" / "c.c3d", WORN, seed=2)], ())

    def check():
        return takes_to_check(base, file, files_of(base.history.kept_takes, file), given, ())

    assert told(check()) == [("k.c3d", KEPT), ("ann.c3d", TAUGHT), ("frames of bob", FRAMES)]
    assert check().left_out == ()
    ann.unlink()
    write(kept, WORN, seed=3)
    assert told(check()) == [("frames of ann", FRAMES), ("frames of bob", FRAMES)]
    assert check().left_out == (("k.c3d", "was changed since"),)
    kept.unlink()
    assert check().left_out == (("k.c3d", "there is no such file"),)
    [row] = base.history.kept_takes
    base = replace(base, history=replace(base.history, kept_takes=(replace(row, path="//studio/takes/k.c3d"),)))
    assert files_of(base.history.kept_takes, file) == [], "nobody's model asks another computer"
    assert check().left_out == (("k.c3d", "nobody knows where it is"),)


def test_what_is_given_again_or_had_wrong_names_checks_nothing(tmp_path):
    ann, bob = (write(tmp_path / who / f"{who}.c3d", WORN, seed=ord(who[0])) for who in ("ann", "bob"))
    base, file = base_of(tmp_path, [ann, bob])
    check = takes_to_check(base, file, [], read_takes([ann], ()), base.training_takes[:1])
    assert told(check) == [("bob.c3d", TAUGHT)]
    corrected = write(tmp_path / "corrected" / "bob.c3d", WORN, seed=9)
    check = takes_to_check(base, file, [], read_takes([corrected], ()), base.training_takes[1:])
    assert told(check) == [("ann.c3d", TAUGHT)], "the names of the old file are not right"


@pytest.mark.parametrize(("kind", "nothing"), [(KEPT, NO_NAME), (TAUGHT, UNTOLD)])
def test_what_nobody_knows_of_a_take_is_not_counted(tmp_path, kind, nothing):
    names, residual = (*WORN[:-1], "", f"Ann:{WORN[0]}"), np.full((20, len(WORN) + 1), 0.0004)
    residual[:5, 1] = 0.0
    path = write(tmp_path / "ann" / "a.c3d", names, 20, residual=residual)
    base, file = base_of(tmp_path, [path] if kind == TAUGHT else [], subjects=())
    kept = [kept_file(path, file, KnownBetter())] if kind == KEPT else []
    [(take, found)] = takes_to_check(base, file, kept, [], ()).takes
    assert found == kind
    there = take.points.present
    assert there.sum() == 20 * len(names) - 5, "what was filled is no point"
    counts = {int(value): int((take.truth[there] == value).sum()) for value in np.unique(take.truth[there])}
    assert counts[UNTOLD] == 40 + (20 if nothing == UNTOLD else 0)  # a name that is there twice
    assert counts.get(NO_NAME, 0) == (20 if nothing == NO_NAME else 0)
    assert counts[take.names.index(WORN[1])] == 15


def test_frames_that_a_model_keeps_are_named_by_the_model(tmp_path):
    """Those of a built-in set, put into poses that it knows."""
    model = open_model("gait15")
    rng, shape = np.random.default_rng(5), model.likelihood.shape
    modes = rng.standard_normal((8, shape.modes.shape[2]))
    xyz = shape.mean + np.einsum("mck,fk->fmc", shape.modes, modes) + [0.0, 0.0, 0.8]
    take = TrainingTake("ann", ("ann.c3d",), 8, xyz.astype(np.float32))
    base = replace(model, training_takes=(take,))
    found = finished(checking.checking(base, base, takes_to_check(base, tmp_path / "m.markerset.json", [], [], ())))
    [one] = found.takes
    assert (one.name, one.kind, one.frames, one.before.present.sum()) == ("frames of ann", FRAMES, 8, 8 * 15)
    assert one.before.recall > 0.5 and one.before.wrong_share < 0.1
    assert found.worse == []


def test_the_version_before_is_kept_and_nothing_that_is_there_is_lost(tmp_path):
    out, base = tmp_path / "ours.markerset.json", Model(toy_markerset())
    assert VersionPlaces.of(out, 1).former is None
    write_model(out, base)
    places = VersionPlaces.of(out, 2)
    assert (places.former.name, places.candidate.name) == ("ours.v1.markerset.json", "ours.v2-candidate.markerset.json")
    assert places.is_as_it_was
    write_model(out, replace(base, history=ModelHistory((ModelVersion(4),))))
    assert not places.is_as_it_was
    assert VersionPlaces.of(out, 5).former.name == "ours.v4.markerset.json"
    out.write_text("nothing of ours")
    assert VersionPlaces.of(out, 5).former is None
    with pytest.raises(InputError, match="does not say what it was trained on from"):
        write_model(tmp_path / "ours.v2-candidate.markerset.json", base)
        adopt(tmp_path / "ours.v2-candidate.markerset.json")


def test_what_somebody_else_taught_meanwhile_is_not_written_over(tmp_path, monkeypatch):
    base = replace(open_model("gait15"), training_takes=(taught_frames("ann", 15),))
    file = tmp_path / "m.markerset.json"
    write_model(file, base)

    def train_solvers(model, _options, _bodies):
        yield 0.5, "find partial solvers"
        return model

    monkeypatch.setattr(train, "train_solvers", train_solvers)
    job = TrainJob((), file, base=str(file), search="top-down", overwrite=True, by="Ann")
    report = finished(train_file(job))
    assert (report["written"], report["model_version"], report["not_adopted_for"]) == (str(file), 2, [])
    assert report["former"] == str(tmp_path / "m.v1.markerset.json")
    work = train_file(job)
    next(work)
    others = replace(base, history=ModelHistory((ModelVersion(7, by="Bob"),)))
    write_model(file, others)
    report = finished(work)
    assert report["not_adopted_for"] == ["m.markerset.json was changed meanwhile by somebody else"]
    assert open_model(file).history == others.history
    assert report["written"] == str(tmp_path / "m.v3-candidate.markerset.json")
    assert open_model(report["written"]).history.versions[-1].by == "Ann"
    assert {path.name for path in tmp_path.iterdir()} == {f"m.{v}markerset.json" for v in ("", "v1.", "v3-candidate.")}
