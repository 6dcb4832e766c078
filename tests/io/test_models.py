# SPDX-License-Identifier: GPL-3.0-or-later
"""Models: partial solvers and training takes come back as they were, and what is damaged is said."""

import json

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.data.models import Model, TrainingTake
from addon.core.points.partial_solvers.model import Classifiers, PartialSolvers, Record, Solver, Strong
from addon.io.markersets import read_markerset
from addon.io.models import open_model, read_model, write_model
from tests.core.toybody import toy_markerset


def toy_model() -> Model:
    markerset = toy_markerset()
    count = len(markerset)
    classifiers = Classifiers(np.array([1, 3]), np.array([[0, 1, -1, -1], [1, 2, -1, -1]]), np.zeros(2), np.ones(2) / 3)
    record = Record(np.array([3.0, 2]), np.array([0.0, 1]), np.array([3.0, 3]), 4)
    solver = Solver(np.array([0, 1]), Strong(np.array([0]), np.array([0.5])), record, np.array([True, False]))
    partial_solvers = PartialSolvers(
        markerset.markers, classifiers, (solver,), np.full(count, 0.9999), "top-down", 3, 17
    )
    points = np.random.default_rng(0).normal(size=(4, count, 3)).astype(np.float32)
    points[1, 0] = np.nan
    takes = (TrainingTake("Ann", ("walk ü", "run"), 900, points),)
    return Model(markerset, partial_solvers=partial_solvers, training_takes=takes)


def test_models_come_back(tmp_path):
    model, path = toy_model(), tmp_path / "toy.markerset.json"
    write_model(path, model)
    found = read_model(path)
    assert found.markerset.markers == read_markerset(path).markers == model.markerset.markers
    [solver], [wanted] = found.partial_solvers.solvers, model.partial_solvers.solvers
    np.testing.assert_array_equal(solver.reached, wanted.reached)
    np.testing.assert_array_equal(solver.record.rates, wanted.record.rates)
    np.testing.assert_array_equal(found.partial_solvers.classifiers.high, model.partial_solvers.classifiers.high)
    assert (found.partial_solvers.search, found.partial_solvers.seed, found.partial_solvers.frames) == (
        "top-down",
        3,
        17,
    )
    [training_takes] = found.training_takes
    assert (training_takes.subject, training_takes.takes, training_takes.frames) == ("Ann", ("walk ü", "run"), 900)
    np.testing.assert_array_equal(training_takes.points, model.training_takes[0].points)
    write_model(tmp_path / "again.markerset.json", found)
    assert (tmp_path / "again.markerset.json").read_bytes() == path.read_bytes()


def test_a_marker_set_is_a_model_without_them():
    model = open_model("gait15")
    assert len(model.markerset) == 15
    assert model.likelihood.markers == model.markerset.markers, "as it was written when it was called evidence"
    with pytest.raises(InputError, match="there is no marker set"):
        open_model("nothing")


@pytest.mark.parametrize("part", ["ensemble", "lessons"])
@pytest.mark.parametrize("wound", ["value", "missing", "kind"])
def test_what_is_damaged_is_said(tmp_path, part, wound):
    path = tmp_path / "toy.markerset.json"
    write_model(path, toy_model())
    document = json.loads(path.read_text())
    place = document[part] if part == "ensemble" else document[part][0]
    field = "targets" if part == "ensemble" else "points"
    if wound == "value":
        place[field]["data"] = place[field]["data"][::-1].swapcase()
    elif wound == "missing":
        del place[field]
    else:
        place[field] = "five"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=f"damaged {part}"):
        read_model(path)


def test_an_ensemble_of_other_markers_is_refused(tmp_path):
    path = tmp_path / "toy.markerset.json"
    write_model(path, toy_model())
    document = json.loads(path.read_text())
    document["markers"][0]["name"] = "OTHER"
    for mode in document["modes"]:
        mode["markers"]["OTHER"] = mode["markers"].pop(toy_markerset().markers[0])
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="other markers than its own"):
        read_model(path)
