# SPDX-License-Identifier: GPL-3.0-or-later
"""What a training on is checked by: takes that are kept, those that were taught, and what the model itself keeps."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.data.progress import finished
from addon.core.data.takes import Points
from addon.core.evaluation.relabelling import NO_NAME, UNTOLD
from addon.core.points.history import ModelHistory, ModelVersion
from addon.core.points.models import Model, TrainingTake
from addon.io.models import open_model, write_model
from addon.io.points import write_c3d
from addon.jobs import checking, models, train
from addon.jobs.checking import FRAMES, KEPT, TAUGHT, files_of, kept_file, takes_to_check
from addon.jobs.models import VersionPlaces, adopt, system_user
from addon.jobs.train import TrainJob, train_file
from addon.jobs.training_takes import KnownBetter, read_takes
from tests.core.toybody import toy_markerset

NAMES = toy_markerset().markers
CHANCE = np.random.default_rng(4)


def write(path, names=NAMES, residual=0.0004, xyz=None):
    path.parent.mkdir(exist_ok=True)
    xyz = CHANCE.normal(size=(20, len(names), 3)) if xyz is None else xyz
    residual = np.broadcast_to(np.asarray(residual, float), xyz.shape[:2])
    write_c3d(path, Points(tuple(names), xyz, np.where(np.isfinite(xyz[..., 0]), residual, np.nan), 100.0, 1))
    return path


def base_of(tmp_path, taught=(), kept=(), subjects=("ann", "bob")):
    """A model at tmp_path/m.markerset.json, taught some takes and checked on others."""
    file = tmp_path / "m.markerset.json"
    rows = tuple(kept_file(path, file, KnownBetter()).take for path in taught)
    history = ModelHistory((ModelVersion(1, takes=rows),), tuple(kept_file(p, file, KnownBetter()).take for p in kept))
    takes = tuple(
        TrainingTake(who, (f"{who}.c3d",), 9, CHANCE.normal(size=(9, len(NAMES), 3)).astype(np.float32))
        for who in subjects
    )
    return Model(toy_markerset(), training_takes=takes, history=history), file


def told(check):
    return [(take.name, kind) for take, kind in check.takes]


def test_takes_that_are_there_are_checked_on_and_else_what_the_model_keeps(tmp_path):
    ann, kept = write(tmp_path / "ann" / "ann.c3d"), write(tmp_path / "kept" / "k.c3d")
    new = write(tmp_path / "cora" / "c.c3d")
    base, file = base_of(tmp_path, [ann], [kept])
    given = read_takes([new], ())
    check = takes_to_check(base, file, files_of(base.history.kept_takes, file), given, ())
    assert told(check) == [("k.c3d", KEPT), ("ann.c3d", TAUGHT), ("frames of bob", FRAMES)]
    assert check.left_out == ()
    ann.unlink()
    write(kept)
    check = takes_to_check(base, file, files_of(base.history.kept_takes, file), given, ())
    assert told(check) == [("frames of ann", FRAMES), ("frames of bob", FRAMES)]
    assert check.left_out == (("k.c3d", "was changed since"),)
    kept.unlink()
    check = takes_to_check(base, file, files_of(base.history.kept_takes, file), given, ())
    assert check.left_out == (("k.c3d", "there is no such file"),)
    [row] = base.history.kept_takes
    base = replace(base, history=replace(base.history, kept_takes=(replace(row, path="//studio/takes/k.c3d"),)))
    assert files_of(base.history.kept_takes, file) == [], "nobody's model asks another computer"
    assert takes_to_check(base, file, [], given, ()).left_out == (("k.c3d", "nobody knows where it is"),)


def test_what_is_given_again_or_had_wrong_names_checks_nothing(tmp_path):
    ann, bob = (write(tmp_path / who / f"{who}.c3d") for who in ("ann", "bob"))
    base, file = base_of(tmp_path, [ann, bob])
    check = takes_to_check(base, file, [], read_takes([ann], ()), base.training_takes[:1])
    assert told(check) == [("bob.c3d", TAUGHT)]
    corrected = write(tmp_path / "corrected" / "bob.c3d")
    check = takes_to_check(base, file, [], read_takes([corrected], ()), base.training_takes[1:])
    assert told(check) == [("ann.c3d", TAUGHT)], "the names of the old file are not right"


def test_of_many_takes_some_of_all_are_chosen(tmp_path, monkeypatch):
    monkeypatch.setattr(checking, "MAX_TAUGHT", 3)
    takes = [write(tmp_path / f"s{n}" / f"{n}.c3d") for n in range(7)]
    base, file = base_of(tmp_path, takes, subjects=())
    assert told(takes_to_check(base, file, [], [], ())) == [(f"{n}.c3d", TAUGHT) for n in (0, 3, 6)]


def test_what_nobody_knows_of_a_take_is_not_counted(tmp_path):
    names = (*NAMES[:-1], "", f"Ann:{NAMES[0]}")
    residual = np.full((20, len(names)), 0.0004)
    residual[:5, 1] = 0.0
    path = write(tmp_path / "ann" / "a.c3d", names, residual)
    for kind, nothing in ((KEPT, NO_NAME), (TAUGHT, UNTOLD)):
        one = kept_file(path, tmp_path / "m.markerset.json", KnownBetter())
        base, file = base_of(tmp_path, [path] if kind == TAUGHT else [], subjects=())
        check = takes_to_check(base, file, [one] if kind == KEPT else [], [], ())
        [(take, found)] = check.takes
        assert found == kind
        there = take.points.present
        assert there.sum() == 20 * len(names) - 5, "what was filled is no point"
        counts = {int(value): int((take.truth[there] == value).sum()) for value in np.unique(take.truth[there])}
        unknown = 40 + (20 if nothing == UNTOLD else 0)  # a name that is there twice
        assert counts[UNTOLD] == unknown
        assert counts.get(NO_NAME, 0) == (20 if nothing == NO_NAME else 0)
        assert counts[take.names.index(NAMES[1])] == 15


def test_frames_that_a_model_keeps_are_named_by_the_model(tmp_path):
    """Those of a built-in set, put into poses that it knows."""
    model = open_model("gait15")
    rng, shape = np.random.default_rng(5), model.likelihood.shape
    modes = rng.standard_normal((8, shape.modes.shape[2]))
    xyz = shape.mean + np.einsum("mck,fk->fmc", shape.modes, modes) + [0.0, 0.0, 0.8]
    take = TrainingTake("ann", ("ann.c3d",), 8, xyz.astype(np.float32))
    base = replace(model, training_takes=(take,))
    check = takes_to_check(base, tmp_path / "m.markerset.json", [], [], ())
    found = finished(checking.checking(base, base, check))
    [one] = found.takes
    assert (one.name, one.kind, one.frames, one.before.present.sum()) == ("frames of ann", FRAMES, 8, 8 * 15)
    assert one.before.recall > 0.5
    assert one.before.wrong_share < 0.1
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
    points = CHANCE.normal(size=(9, 15, 3)).astype(np.float32)
    base = replace(open_model("gait15"), training_takes=(TrainingTake("ann", ("ann.c3d",), 9, points),))
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
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "m.markerset.json",
        "m.v1.markerset.json",
        "m.v3-candidate.markerset.json",
    ]


def test_who_is_logged_in_need_not_be_known(monkeypatch):
    monkeypatch.setattr(models.getpass, "getuser", lambda: "ann")
    assert system_user() == "ann"

    def unknown():
        raise OSError("no such user")

    monkeypatch.setattr(models.getpass, "getuser", unknown)
    assert system_user() == ""
