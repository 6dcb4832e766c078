# SPDX-License-Identifier: GPL-3.0-or-later
"""Models: partial solvers and training takes come back as they were, and what is damaged is said."""

import base64
import json
import tracemalloc
import zlib

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.papers.partial_solvers.frames import SolversNamer
from addon.io.markersets import read_markerset
from addon.io.models import open_model, read_model, write_model
from tests.core.toybody import toy_markerset
from tests.fuzz import case, samples
from tests.io.samples import toy_model


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


@pytest.mark.parametrize("part", ["ensemble", "training_takes"])
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


def test_whatever_is_read_of_a_broken_model_names_points(tmp_path):
    files, points, refused = samples(tmp_path), np.random.default_rng(8).normal(size=(3, 5, 3)), 0
    contents = {name: file.read_bytes() for name, file in files.items()}
    for number in range(600):
        files["model"].write_bytes(case("model", contents, 8, number))
        try:
            model = read_model(files["model"])
        except InputError as error:
            refused += 1
            assert "; expected" in error.message
            continue
        if model.partial_solvers is not None:
            list(SolversNamer(model.partial_solvers).name(points))
        assert {take.points.shape[1:] for take in model.training_takes} <= {(len(model.markerset), 3)}
    assert 200 < refused < 600


def test_arrays_that_say_that_they_are_huge_are_not_unpacked(tmp_path):
    path = tmp_path / "toy.markerset.json"
    write_model(path, toy_model())
    document = json.loads(path.read_text())
    zeros = base64.b64encode(zlib.compress(bytes(50_000_000), 9)).decode()
    points = {"kind": "f4", "shape": [12_500_000], "data": zeros}
    document["training_takes"] = [{**document["training_takes"][0], "points": points}] * 20
    path.write_text(json.dumps(document))
    tracemalloc.start()
    with pytest.raises(InputError, match="over 256 MB of training takes"):
        read_model(path)
    assert tracemalloc.get_traced_memory()[1] < 100e6
    tracemalloc.stop()
