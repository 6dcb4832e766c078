# SPDX-License-Identifier: GPL-3.0-or-later
"""Models and what they learned come back as they were, and what is damaged is said."""

import base64
import json
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.papers.partial_solvers.frames import SolversNamer
from addon.core.points.likelihood.learn import learn_likelihood
from addon.io.markersets import Reader, read_markerset
from addon.io.models import likelihood_document, open_model, read_likelihood, read_model, write_model
from tests.core.toybody import toy_markerset
from tests.fuzz import case, samples
from tests.io.samples import toy_model


def toy_file(folder) -> tuple[Path, dict]:
    """The toy's model in a file, and what stands in it."""
    path = folder / "toy.markerset.json"
    write_model(path, toy_model())
    return path, json.loads(path.read_text())


def test_models_come_back(tmp_path):
    model, path = toy_model(), tmp_path / "toy.markerset.json"
    write_model(path, model)
    found = read_model(path)
    assert found.markerset.markers == read_markerset(path).markers == model.markerset.markers
    [solver], [wanted] = found.partial_solvers.solvers, model.partial_solvers.solvers
    np.testing.assert_array_equal(solver.reached, wanted.reached)
    np.testing.assert_array_equal(solver.record.rates, wanted.record.rates)
    np.testing.assert_array_equal(found.partial_solvers.classifiers.high, model.partial_solvers.classifiers.high)
    solvers = found.partial_solvers
    assert (solvers.search, solvers.seed, solvers.frames) == ("top-down", 3, 17)
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
    path, document = toy_file(tmp_path)
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
    path, document = toy_file(tmp_path)
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
    path, document = toy_file(tmp_path)
    zeros = base64.b64encode(zlib.compress(bytes(50_000_000), 9)).decode()
    points = {"kind": "f4", "shape": [12_500_000], "data": zeros}
    document["training_takes"] = [{**document["training_takes"][0], "points": points}] * 20
    path.write_text(json.dumps(document))
    tracemalloc.start()
    with pytest.raises(InputError, match="over 256 MB of training takes"):
        read_model(path)
    assert tracemalloc.get_traced_memory()[1] < 100e6
    tracemalloc.stop()


NAMES = tuple("abcdefgh")


def learned(rigid: bool):
    rng = np.random.default_rng(0)
    base = rng.normal(size=(8, 3))
    noise, way = (0.001, np.linspace(0, 1, 120)) if rigid else (0.03, np.zeros(120))
    takes = [(base * size + way[:, None, None] + noise * rng.normal(size=(120, 8, 3)), str(size)) for size in (1, 1.02)]
    return learn_likelihood(takes[:1] if rigid else takes, NAMES)


@pytest.mark.parametrize("rigid", [True, False])
def test_reading_and_writing_again_changes_nothing(rigid):
    likelihood = learned(rigid)
    assert (likelihood.rigid_bodies is not None) == rigid
    document = likelihood_document(likelihood)
    again = read_likelihood(Reader("model"), json.loads(json.dumps(document)), NAMES)
    assert likelihood_document(again) == document
    assert np.allclose(again.shape.modes, likelihood.shape.modes, rtol=1e-5, atol=1e-12)
    assert np.allclose(again.calibration.least, likelihood.calibration.least, rtol=1e-5)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("mean", [[0, 0, 0]]),
        ("noise", [0.1] * 7 + [-1]),
        ("modes", [[1, 2]]),
        ("ties", [[0, 99, 0.1, 0.1]]),
        ("rates", [1.0, "all"]),
        ("least", [[1.0]]),
        ("subjects", "two"),
        ("plates", [[0, 0, 1]]),
    ],
)
def test_a_part_that_is_not_as_expected_is_named(key, value):
    document = likelihood_document(learned(True))
    document[key] = value
    with pytest.raises(InputError, match=key):
        read_likelihood(Reader("model"), document, NAMES)
