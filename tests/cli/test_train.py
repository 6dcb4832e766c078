# SPDX-License-Identifier: GPL-3.0-or-later
"""`train`: a model of a made-up creature from its labelled takes, which then names takes; trials side by side."""

import json
import shutil
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from addon.cli import main, train
from addon.cli.parser import build_parser
from addon.core.data.errors import JobError
from addon.core.data.takes import Points
from addon.core.geometry import rotations
from addon.core.points.likelihood import learn
from addon.core.training.imagining import anybody
from addon.core.training.poses import known_poses
from addon.demo.take import make_performance
from addon.io.layouts import shipped_layouts
from addon.io.markersets import open_markerset
from addon.io.models import read_model, write_model
from addon.io.points import read_points, write_c3d
from addon.io.source import read_bytes
from addon.jobs.models import known_bodies
from tests.inputs.walkers import write_truth

NAMES = tuple(f"{part}{number}" for part in ("BODY", "HEAD") for number in range(1, 6))


def creature(seed: int) -> np.ndarray:
    """(T, 10, 3) m: a body with a head that nods, which walks about; everybody's markers sit a little elsewhere."""
    chance, form = np.random.default_rng(seed), np.random.default_rng(42)
    body = form.uniform([-0.4, -0.15, 0.4], [0.4, 0.15, 0.7], (5, 3)) + chance.normal(0, 0.006, (5, 3))
    head = form.uniform([-0.05, -0.1, 0.0], [0.25, 0.1, 0.2], (5, 3)) + chance.normal(0, 0.006, (5, 3))
    time = np.arange(150)[:, None] / 100
    nod = rotations.turn_of(np.column_stack([0 * time, 0.5 * np.sin(3 * time + seed), 0.4 * np.sin(2 * time)]))
    heads = np.einsum("fij,mj->fmi", nod, head) + np.array([0.45, 0, 0.6])
    whole = np.concatenate([np.broadcast_to(body, (150, 5, 3)), heads], axis=1)
    heading = rotations.turn_of(np.column_stack([0 * time, 0 * time, seed + 0.8 * time]))
    walked = np.einsum("fij,fmj->fmi", heading, whole) + np.stack([time, 0.3 * time, 0 * time], axis=-1)
    return walked + chance.normal(0, 0.001, walked.shape)


def write(path, xyz, names=NAMES):
    path.parent.mkdir(exist_ok=True)
    write_c3d(path, Points(tuple(names), xyz, np.full(xyz.shape[:2], 0.0004), 100.0, 1))
    return path


def content_of(path) -> dict:
    """What a model's file holds beside its history."""
    content = json.loads(path.read_text(encoding="utf-8"))
    content.pop("history", None)
    return content


@pytest.fixture(scope="module")
def takes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("creatures")
    return [write(folder / f"c{seed}" / f"walk{seed}.c3d", creature(seed)) for seed in range(3)]


@pytest.fixture(scope="module")
def trained(takes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("model")
    model, report = folder / "dog.markerset.json", folder / "report.json"
    assert main(["train", *map(str, takes[:2]), "--out", str(model), "--report", str(report)]) == 0
    return model, json.loads(report.read_text())


def test_the_report_says_what_was_learned(trained):
    model, report = trained
    assert (report["model"], report["markers"]) == ("dog", list(NAMES))
    assert [(row["subject"], row["frames"]) for row in report["subjects"]] == [("c0", 150), ("c1", 150)]
    assert sorted(map(sorted, report["body"]["segments"].values())) == [list(NAMES[:5]), list(NAMES[5:])]
    assert max(report["residual_mm"].values()) < 12
    assert report["ensemble"] is None
    assert {"read", "body", "evidence", "ensemble"} <= set(report["seconds"])
    found = read_model(model)
    assert found.likelihood.subjects == 2
    assert [training_take.subject for training_take in found.training_takes] == ["c0", "c1"]
    assert found.markerset.source["subject c1"] == "walk1.c3d"


@pytest.fixture
def anonymous(tmp_path):
    """The third creature without names, shuffled, with gaps and a ghost; its truth beside it."""
    chance, xyz = np.random.default_rng(8), creature(2)
    for frame in range(0, 150, 30):
        xyz[frame : frame + 30, chance.permutation(10)[: chance.integers(0, 3)]] = np.nan
    order = chance.permutation(11)
    xyz = np.concatenate([xyz, np.broadcast_to([0.5, 0.5, 1.0], (150, 1, 3))], axis=1)[:, order]
    write_truth(tmp_path / "truth.csv", xyz, [[*NAMES, ""][index] for index in order], 1)
    return write(tmp_path / "anon.c3d", xyz, [""] * 11)


@pytest.mark.parametrize(("method", "least"), [("auto", 0.97), ("ensemble", 0.5)])
def test_the_model_names_a_creature_that_it_has_never_seen(trained, anonymous, run, figures, tmp_path, method, least):
    run("label", anonymous, "--model", trained[0], "--out", tmp_path / "out", "--method", method).quiet()
    found = figures(tmp_path / "out" / "anon.labels.csv", tmp_path / "truth.csv")
    assert found["precision"] > 0.99 and found["recall"] > least


def test_a_model_is_given_its_partial_solvers_later(trained, anonymous, run, tmp_path):
    model, _ = trained
    more = tmp_path / "more.markerset.json"
    report = run("train", "--from", model, "--search", "bottom-up", "--out", more, "--json").done().json
    assert set(report["ensemble"]["of_marker"]) == set(NAMES)
    assert (report["ensemble"]["search"], report["ensemble"]["hit_rate"]) == ("bottom-up", 0.9999)
    before, after = content_of(model), content_of(more)
    assert after.pop("ensemble")
    assert list(after.items()) == list(before.items())
    assert [(one.version, len(one.takes)) for one in read_model(more).history.versions] == [(1, 2), (2, 0)]
    assert read_model(model).partial_solvers is None
    assert run("label", anonymous, "--model", more, "--out", tmp_path / "out", "--method", "ensemble").status == 0
    assert "no take was given" in run("train", "--from", model, "--out", more, "--overwrite").reason
    named = run("train", "--from", model, "--search", "top-down", "--name", "x", "--out", more, "--overwrite")
    assert "only partial solvers are found" in named.reason


def test_what_cannot_find_partial_solvers_later_has_them_at_once(takes, anonymous, run, tmp_path, monkeypatch):
    monkeypatch.setattr(learn.LEARN, "max_frames", 60)
    lean, bare = tmp_path / "lean.markerset.json", tmp_path / "bare.markerset.json"
    assert run("train", *takes[:2], "--out", lean, "--lean").status == 0
    assert read_model(lean).partial_solvers is not None
    assert run("train", *takes[:2], "--out", bare, "--lean", "--search", "none").status == 0
    answer = run("label", anonymous, "--model", bare, "--out", tmp_path / "out", "--method", "ensemble")
    assert "has no partial solvers" in answer.reason
    assert not read_model(bare).training_takes
    assert "would forget them" in run("train", takes[2], "--from", bare, "--out", tmp_path / "x.markerset.json").reason


def test_the_same_takes_teach_the_same_whoever_teaches_and_in_however_many_processes(trained, takes, run, tmp_path):
    model, out = trained[0], tmp_path / "dog.markerset.json"
    assert run("train", *takes[:2], "--out", out, "--by", "Bob", "--jobs", 2).status == 0
    assert content_of(out) == content_of(model)
    one, other = read_model(out), read_model(model)
    assert one.fingerprint == other.fingerprint == trained[1]["model_fingerprint"]
    assert (one.history.versions[0].by, one.history.versions[0].version) == ("Bob", 1)
    known = [take.sha256 for take in one.history.versions[0].takes]
    assert known == [take.sha256 for take in other.history.versions[0].takes] != ["", ""]


def test_training_on_keeps_what_was_known(trained, takes, run, tmp_path):
    model, out = trained[0], tmp_path / "more.markerset.json"
    options = ("--from", model, "--out", out, "--search", "none", "--json")
    report = run("train", *options, "--subject", "c2=*.c3d", takes[2]).done().json
    assert [row["subject"] for row in report["subjects"]] == ["c0", "c1", "c2"]
    assert (report["trained_on"], report["ensemble"]) == (str(model), None)
    check = report["check"]
    told = [(row["take"], row["names"], row["frames"]) for row in check["takes"]]
    assert told == [("walk0.c3d", "taught", 150), ("walk1.c3d", "taught", 150)]
    assert (check["worse"], report["former"], report["written"]) == ([], None, str(out))
    assert all(row["recall"][1] > 0.9 for row in check["takes"])
    found = read_model(out)
    assert found.likelihood.subjects == 3
    assert report["model_fingerprint"] == found.fingerprint != read_model(model).fingerprint
    newest = found.history.versions[-1]
    assert (newest.version, newest.origin) == (2, read_model(model).fingerprint)
    assert [(take.name, take.subject, take.frames) for take in newest.takes] == [("walk2.c3d", "c2", 150)]
    fewer = ",".join([*NAMES[6:], *NAMES[:4]])
    words = "train", takes[2], "--from", model, "--out", tmp_path / "few.markerset.json", "--search", "none", "--json"
    assert ",".join(run(*words, "--markers", fewer).done().json["markers"]) == fewer
    assert "no take has a marker BODY9" in run(*words, "--overwrite", "--markers", f"{fewer},BODY9").reason


@pytest.mark.filterwarnings("error")
def test_a_take_may_lack_markers_of_the_model_that_is_trained_on(trained, run, tmp_path):
    lacking = write(tmp_path / "c3" / "few.c3d", creature(3)[:, :8], NAMES[:8])
    words = "--from", trained[0], "--out", tmp_path / "more.markerset.json", "--search", "none", "--json"
    assert run("train", lacking, *words).quiet().json["markers"] == list(NAMES)


def test_what_is_named_worse_waits_until_it_is_adopted(trained, takes, run, tmp_path):
    """Somebody teaches a creature whose names are a place too far; another one is kept to check the model on."""
    model, kept = tmp_path / "lab" / "lab.markerset.json", write(tmp_path / "kept.c3d", creature(5))
    model.parent.mkdir()
    before = Path(shutil.copy(trained[0], model)).read_bytes()
    wrong = write(tmp_path / "wrong.c3d", creature(2), [*NAMES[1:], NAMES[0]])
    words = ("--search", "none", "--jobs", 1, "--by", "Ann", "--report", tmp_path / "report.json", "--overwrite")
    answer = run("train", wrong, "--from", model, "--out", model, "--check", kept, *words)
    assert answer.refusal(1).startswith(f"{model}: the model trained on does not take this place (")
    assert "lab.v2-candidate.markerset.json; expected nothing worse, or models --adopt" in answer.reason
    assert model.read_bytes() == before
    candidate = model.with_name("lab.v2-candidate.markerset.json")
    report = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert (report["written"], report["former"]) == (str(candidate), None)
    assert report["not_adopted_for"] == report["check"]["worse"] != []
    # The takes of the base lie no longer where they were, as seen from the copy, so what it keeps of them is named.
    rows = {row["take"]: row for row in report["check"]["takes"]}
    assert list(rows) == ["kept.c3d", "frames of c0", "frames of c1"]
    assert rows["kept.c3d"]["recall"][0] > rows["kept.c3d"]["recall"][1] + 0.05
    assert rows["kept.c3d"]["markers_worse"]
    assert "worse               kept.c3d" in answer.out
    # Where no model is, none is lost: it is written, and what got worse is said.
    new = model.with_name("new.markerset.json")
    answer = run("train", wrong, "--from", model, "--out", new, "--check", kept, *words)
    assert (answer.status, "worse               kept.c3d" in answer.out) == (0, True)
    assert read_model(new).history.versions[-1].told

    waiting = read_model(candidate)
    adopted = run("models", "--adopt", candidate).done()
    assert "version 2    " in adopted.out and ", by Ann, from " in adopted.out
    assert "it was adopted all the same" in adopted.out
    assert not candidate.exists()
    assert model.with_name("lab.v1.markerset.json").read_bytes() == before
    found = read_model(model)
    assert found.fingerprint == waiting.fingerprint
    assert found.history.versions[-1].told
    assert [take.path for take in found.history.kept_takes] == ["../kept.c3d"]
    said = run("models", model, "--json").json["models"][0]
    assert (said["version"], said["fingerprint"]) == (2, found.fingerprint)
    assert said["history"][-1]["by"] == "Ann"


def test_only_what_waits_for_the_model_that_is_there_is_adopted(trained, run, tmp_path):
    model, base = tmp_path / "lab.markerset.json", read_model(trained[0])
    candidate = tmp_path / "lab.v2-candidate.markerset.json"
    write_model(candidate, base)
    assert "is no candidate by its name" in run("models", "--adopt", trained[0]).reason
    assert "of one model" in run("models", "gait15", "--adopt", candidate).reason
    write_model(model, replace(base, training_takes=()))
    assert "is another model than the one" in run("models", "--adopt", candidate).reason
    assert candidate.exists()
    model.unlink()
    assert (run("models", "--adopt", candidate).status, read_model(model).fingerprint) == (0, base.fingerprint)


def test_a_corrected_take_replaces_what_was_learned_from_it(takes, run, tmp_path):
    wrong = write(tmp_path / "c1" / "walk1.c3d", creature(1), [*NAMES[1::-1], *NAMES[2:]])
    model, better = tmp_path / "m.markerset.json", tmp_path / "better.markerset.json"
    assert "each other's names" in run("train", takes[0], wrong, takes[2], "--out", model, "--search", "none").out
    right = write(wrong, creature(1))
    said = run("train", right, "--from", model, "--out", better, "--search", "none").out.splitlines()
    assert [line for line in said if line.startswith("replaces")] == ["replaces            walk1.c3d of c1 as it was"]
    assert not any("each other's names" in line for line in said)
    rows = [(row.subject, row.takes) for row in read_model(better).training_takes]
    assert rows == [(f"c{number}", (f"walk{number}.c3d",)) for number in (0, 2, 1)]
    np.testing.assert_allclose(read_model(better).subjects["c1"], read_points(right).xyz, atol=1e-5)


def test_what_cannot_be_trained_or_checks_no_model_is_said_and_leaves_nothing(trained, takes, run, tmp_path):
    out = tmp_path / "m.markerset.json"
    assert "is no subject" in run("train", takes[0], "--out", out, "--subject", "ann").reason
    assert "no take was given" in run("train", "--out", out, "--subject", "ann=*").reason
    other = write(tmp_path / "other.c3d", creature(1), [f"X{index}" for index in range(10)])
    assert "no marker in common" in run("train", takes[0], other, "--out", out).reason
    missing = write(tmp_path / "missing.c3d", np.full((20, 10, 3), np.nan))
    assert "no point that is present in any frame" in run("train", missing, "--out", out).reason
    line = write(tmp_path / "line.c3d", creature(1) * [1, 0, 0])
    reason = run("train", line, "--out", out).refusal(2)
    assert reason.startswith(f"{line}: ") and "two of three axes are zero" in reason
    noise = write(tmp_path / "noise.c3d", np.random.default_rng(1).random((40, 10, 3)))
    reason = run("train", noise, "--out", out, "--force").refusal(2)
    assert reason.startswith(f"{noise}: no two markers keep their distance")
    words = ("train", takes[2], "--from", trained[0], "--out", out, "--check")
    assert "is learned from, so it cannot check" in run(*words, takes[2]).reason
    assert "no such file" in run(*words, tmp_path / "none.c3d").reason
    assert "only partial solvers" in run("train", *words[2:], takes[2], "--search", "top-down").reason
    assert "--adopt is for training on" in run("train", takes[2], "--out", out, "--adopt").reason
    assert not out.exists()


def test_words_alone_make_a_model_that_names_somebody(run, tmp_path):
    layout, model = tmp_path / "ours.toml", tmp_path / "ours.markerset.json"
    layout.write_text(read_bytes(shipped_layouts()["helen_hayes"]).decode().replace("helen_hayes", "ours"), "utf-8")
    report = run("train", "--set", layout, "--out", model, "--json").json
    assert report["model"] == "ours" and report["body"]["how"].startswith("the body of gait15")
    assert "learned from words alone" in report["doubts"][0]
    markerset = read_model(model).markerset
    somebody = anybody(markerset, known_poses(markerset, known_bodies()), 1)[0][:60]
    order = np.random.default_rng(3).permutation(len(markerset))
    cloud = write(tmp_path / "cloud.c3d", somebody[:, order], [f"*{number}" for number in range(len(order))])
    assert run("label", cloud, "--model", model, "--out", tmp_path / "out").status == 0
    named = read_points(tmp_path / "out" / "cloud.c3d")
    given = np.isfinite(named.xyz[:, : len(order), 0])
    off = np.linalg.norm(named.xyz[:, : len(order)] - somebody, axis=2)
    assert given.mean() > 0.9 and (off[given] < 1e-3).mean() > 0.99


def test_a_take_of_one_labelled_frame_is_enough_of_a_person(run, tmp_path, monkeypatch):
    monkeypatch.setattr(learn.LEARN, "max_frames", 60)
    take = make_performance(open_markerset("body26")).take
    one = write(tmp_path / "ann" / "one.c3d", take.xyz[40:41], take.names)
    whole = write(tmp_path / "whole.c3d", take.xyz[:120], [""] * len(take.names))
    model = tmp_path / "ann.markerset.json"
    said = run("train", one, "--out", model, "--search", "none", "--json").done().json
    assert said["doubts"][0].startswith("learned from 1 frame of ann: its other poses are made up")
    assert read_model(model).markerset.source["poses"].startswith("made up on the body of body26")
    assert run("label", whole, "--model", model, "--out", tmp_path / "out").status == 0
    found = read_points(tmp_path / "out" / "whole.c3d")
    assert found.names[:26] == tuple(take.names)
    away = np.linalg.norm(found.xyz[:, :26] - take.xyz[:120], axis=2)
    named = np.isfinite(away)
    assert named.mean() > 0.7
    assert (away[named] < 0.002).mean() > 0.995


def test_several_subjects_may_follow_one_option_and_takes_may_follow_them(takes):
    given = build_parser().parse_args(["train", "--out", "a", "--subject", "ann=a*", "bob=b*", str(takes[0]), "--lean"])
    assert given.subjects == [("ann", "a*"), ("bob", "b*"), Path(takes[0])]


def test_a_trial_whose_process_is_killed_is_one_sentence(monkeypatch):
    killed = JobError("its process was killed; expected it to finish", "1.trial")
    monkeypatch.setattr(train, "crew", lambda _: nullcontext(lambda _: iter([(1, killed)])))
    with pytest.raises(JobError, match=r"^a trial could not be made: its process was killed; expected it to finish$"):
        list(train.try_in(2, [None] * 3))
