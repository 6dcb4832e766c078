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
from addon.core.points.models import by_subject
from addon.io import models
from addon.io.markersets import read_markerset
from addon.io.models import open_model, read_model, write_model
from tests.core.toybody import toy_markerset
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


def test_training_takes_are_read_from_files_of_the_first_versions_too(tmp_path):
    path = tmp_path / "toy.markerset.json"
    write_model(path, toy_model())
    path.write_text(path.read_text().replace('"training_takes"', '"lessons"'))
    [take] = read_model(path).training_takes
    np.testing.assert_array_equal(take.points, toy_model().training_takes[0].points)


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


def packed_arrays(value, path=()):
    """Where the packed arrays of a document are, as the keys that lead there."""
    if isinstance(value, dict) and "data" in value:
        yield path
    elif isinstance(value, (dict, list)):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from packed_arrays(part, (*path, key))


def other(array: np.ndarray, chance: np.random.Generator) -> np.ndarray:
    """The array with another value, shape or kind."""
    flat, way = array.ravel().copy(), chance.integers(7)
    odd = [np.nan, np.inf, -1, -2, 1e300, 2**31, 7, 255]
    if way <= 2 and flat.size and array.dtype != bool:
        with np.errstate(all="ignore"):
            flat[chance.integers(flat.size)] = np.array(odd)[chance.integers(len(odd))].astype(array.dtype)
        return flat.reshape(array.shape)
    if way == 3:
        return flat[: chance.integers(flat.size + 1)]
    if way == 4:
        return np.concatenate([array, array])
    if way == 5:
        return array.reshape(*array.shape, 1) if array.ndim < 2 else array.T.copy()
    return np.nan_to_num(array, posinf=0).clip(-128, 127).astype(chance.choice(["<i1", "<u1", "<i8", "<f4", "|b1"]))


def test_arrays_with_a_right_digest_are_sound_or_refused(tmp_path):
    path, chance = tmp_path / "toy.markerset.json", np.random.default_rng(8)
    write_model(path, toy_model())
    text, refused = path.read_text(), 0
    points = chance.normal(size=(3, 5, 3))
    for _ in range(600):
        document = json.loads(text)
        part = document["ensemble"] if chance.random() < 0.8 else document["training_takes"][0]
        places = list(packed_arrays(part))
        *before, last = places[chance.integers(len(places))]
        holder = part
        for key in before:
            holder = holder[key]
        holder[last] = models._packed(other(models._unpacked_array(holder[last]), chance))
        part["digest"] = models._digest({key: value for key, value in part.items() if key != "digest"})
        path.write_text(json.dumps(document))
        try:
            model = read_model(path)
        except InputError as error:
            refused += 1
            assert "; expected" in error.message
            continue
        list(SolversNamer(model.partial_solvers).name(points))
        assert by_subject(model.training_takes)["Ann"].shape[1:] == (len(model.markerset), 3)
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
