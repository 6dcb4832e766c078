# SPDX-License-Identifier: GPL-3.0-or-later
"""Models, what they learned and their history come back as they were, and what is damaged is said."""

import base64
import json
import zlib
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.points.likelihood.learn import learn_likelihood
from addon.core.points.models import NO_HISTORY, ModelHistory, ModelVersion
from addon.io.markersets import Reader, read_markerset
from addon.io.model_history import HISTORY, beside, is_beside, model_of, moved, seen_at, seen_from
from addon.io.models import likelihood_document, open_model, read_likelihood, read_model, write_model
from tests.core.toybody import toy_markerset
from tests.fuzz.wounds import digest_anew
from tests.io.checks import assert_alike, memory_within, refused
from tests.io.samples import HISTORY_OF_TWO, SHOWN, WALK, toy_model


def toy_file(folder) -> tuple[Path, dict]:
    path = folder / "toy.markerset.json"
    write_model(path, toy_model())
    return path, json.loads(path.read_text())


def test_models_come_back(tmp_path):
    model, (path, _) = toy_model(), toy_file(tmp_path)
    found = read_model(path)
    assert read_markerset(path).markers == model.markerset.markers
    assert_alike(replace(found, fingerprint=""), model)
    write_model(tmp_path / "again.markerset.json", found)
    assert (tmp_path / "again.markerset.json").read_bytes() == path.read_bytes()


def test_a_marker_set_is_a_model_without_them():
    model = open_model("gait15")
    assert len(model.markerset) == 15
    assert model.likelihood.markers == model.markerset.markers, "as it was written when it was called evidence"
    refused("there is no marker set", open_model, "nothing")


WOUNDS = {
    "value": lambda packed: packed | {"data": packed["data"][::-1].swapcase()},
    "no bytes": lambda packed: packed | {"data": base64.b64encode(b"neither").decode()},
    "too few": lambda packed: packed | {"shape": [*packed["shape"], 2]},
    "no word": lambda packed: packed | {"kind": {}},
    "other kind": lambda packed: packed | {"kind": "f16"},
    "text": lambda _: "five",
    "endless": lambda _: 10**400,
    "missing": lambda _: None,
}


@pytest.mark.parametrize("fits", [False, True])
@pytest.mark.parametrize(
    ("field", "wound"), [*product(["targets", "points"], WOUNDS), ("classifiers", "text"), ("frames", "endless")]
)
def test_what_is_damaged_is_said_whether_its_digest_fits_or_not(tmp_path, field, wound, fits):
    path, document = toy_file(tmp_path)
    part = "training_takes" if field == "points" else "ensemble"
    place = document[part][0] if field == "points" else document[part]
    place[field] = WOUNDS[wound](place[field])
    if fits:
        digest_anew(document)
    path.write_text(json.dumps(document))
    refused(f"damaged {part}", read_model, path)


def test_an_ensemble_of_other_markers_is_refused(tmp_path):
    path, document = toy_file(tmp_path)
    document["markers"][0]["name"] = "OTHER"
    for mode in document["modes"]:
        mode["markers"]["OTHER"] = mode["markers"].pop(toy_markerset().markers[0])
    path.write_text(json.dumps(document))
    refused("other markers than its own", read_model, path)


def test_arrays_that_say_that_they_are_huge_are_not_unpacked(tmp_path):
    path, document = toy_file(tmp_path)
    zeros = base64.b64encode(zlib.compress(bytes(50_000_000), 9)).decode()
    points = {"kind": "f4", "shape": [12_500_000], "data": zeros}
    document["training_takes"] = [{**document["training_takes"][0], "points": points}] * 20
    path.write_text(json.dumps(document))
    with memory_within(100e6), pytest.raises(InputError, match="over 256 MB of training takes"):
        read_model(path)


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
    assert len(likelihood.sides)
    document = likelihood_document(likelihood)
    again = read_likelihood(Reader("model"), json.loads(json.dumps(document)), NAMES)
    assert likelihood_document(again) == document
    shuffled = document | {"sides": sorted(document["sides"], key=lambda row: -row[0])}
    assert likelihood_document(read_likelihood(Reader("model"), shuffled, NAMES)) == document
    assert np.allclose(again.shape.modes, likelihood.shape.modes, rtol=1e-5, atol=1e-12)
    assert np.allclose(again.calibration.least, likelihood.calibration.least, rtol=1e-5)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("mean", [[0, 0, 0]]), ("noise", [0.1] * 7 + [-1]), ("modes", [[1, 2]]), ("ties", [[0, 99, 0.1, 0.1]])),
        *(("rates", [1.0, "all"]), ("least", [[1.0]]), ("subjects", "two"), ("plates", [[0, 0, 1]])),
        *(("sides", [[0, 1, 2, 99, 0.1, 0.1]]), ("sides", [[0, 1, 2, 3, 0.1, -1]])),
        *(("sides", [[0, 1, 1, 3, 0.1, 0.1]]), ("sides", [[0, 1.5, 2, 3, 0.1, 0.1]])),
        ("sides", [[0, 1, 2, 3, 1e6, 0.1]]),
    ],
)
def test_a_part_that_is_not_as_expected_is_named(key, value):
    document = likelihood_document(learned(True))
    document[key] = value
    refused(key, read_likelihood, Reader("model"), document, NAMES)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "toy.markerset.json"
    write_model(path, replace(toy_model(), history=HISTORY_OF_TWO))
    return path


def test_it_comes_back_and_all_before_it_is_the_same_whoever_taught_the_model(path):
    found = read_model(path)
    assert found.history == HISTORY_OF_TWO
    assert found.history.version == 2
    again = path.with_name("again.markerset.json")
    write_model(again, found)
    assert again.read_bytes() == path.read_bytes()
    bare = path.with_name("bare.markerset.json")
    write_model(bare, toy_model())
    text, without = path.read_text(encoding="utf-8"), bare.read_text(encoding="utf-8")
    assert text.startswith(without.removesuffix("\n}\n"))
    assert HISTORY not in without
    assert read_model(bare).fingerprint == read_model(path).fingerprint != ""
    assert read_model(bare).history is NO_HISTORY
    assert NO_HISTORY.version == 1


def test_the_fingerprint_is_of_what_is_in_the_file_and_built_in_models_have_one_and_no_history(path):
    known, document = read_model(path).fingerprint, json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(dict(reversed(document.items())), indent=8), encoding="utf-8", newline="\r\n")
    assert read_model(path).fingerprint == known
    document["markers"][0]["sd"] += 1e-6
    path.write_text(json.dumps(document), encoding="utf-8")
    assert read_model(path).fingerprint != known
    fingerprints = {open_model(name).fingerprint for name in ("gait15", "body26")}
    assert len(fingerprints) == 2
    assert {len(one) for one in fingerprints} == {64}
    assert open_model("gait15").history.version == 1


def test_readers_that_know_no_history_and_what_later_versions_keep_are_let_be(path):
    """As those of earlier versions do, which take the parts that they know."""
    assert read_markerset(path).markers == toy_model().markerset.markers
    document = json.loads(path.read_text(encoding="utf-8"))
    document["history"]["studio"] = "north"
    document["history"]["versions"][0] |= {"weather": "rain", "by": None}
    path.write_text(json.dumps(document), encoding="utf-8")
    assert read_model(path).history.versions[0] == replace(HISTORY_OF_TWO.versions[0], by="")


TAKES_DAMAGED = [{}], [{"take": "a", "frames": -1}], [{"take": "a", "rate": "fast"}], [{"take": "a", "rate": 10**400}]


@pytest.mark.parametrize(
    "wound",
    [
        *([], {}, {"kept_takes": 1}, {"kept_takes": ["a"]}, {"versions": 3}, {"versions": [7]}),
        *({"versions": [{"version": number}]} for number in (0, True)),
        {"versions": [{"version": 2}, {"version": 2}]},
        *({"versions": [{"version": 1, "by": who}]} for who in (5, "a\nb")),
        *({"versions": [{"version": 1, "takes": takes}]} for takes in TAKES_DAMAGED),
        {"versions": [{"version": 1, "checked": [{"take": "a", "recall": [1]}]}]},
    ],
)
def test_a_history_that_is_damaged_is_said(path, wound):
    document = json.loads(path.read_text(encoding="utf-8"))
    document["history"] = document["history"] | wound if wound else wound
    path.write_text(json.dumps(document), encoding="utf-8")
    refused(r"toy\.markerset\.json: has a damaged history; expected", read_model, path)


def test_paths_are_seen_from_the_model_and_follow_it(tmp_path):
    model, other = tmp_path / "lab" / "ours.markerset.json", tmp_path / "far" / "off" / "ours.markerset.json"
    take = tmp_path / "takes" / "walk.c3d"
    assert seen_from(model, take) == "../takes/walk.c3d"
    known = replace(WALK, path="../takes/walk.c3d")
    assert seen_at(known.path, model) == take.resolve()
    assert seen_at(SHOWN.path, model) is None
    for elsewhere in ("//studio/walk.c3d", "\\\\studio\\walk.c3d"):
        assert seen_at(elsewhere, model) is None
    history = ModelHistory((ModelVersion(1, takes=(known, SHOWN)),), (known,))
    assert moved(history, model, model.with_name("b.markerset.json")) is history
    there = moved(history, model, other)
    paths = [take.path for take in (*there.versions[0].takes, *there.kept_takes)]
    assert paths == ["../../takes/walk.c3d", "", "../../takes/walk.c3d"]
    assert seen_from(model, tmp_path / "odd\nname.c3d") == "", "no file of JSON lines can say that"


def test_a_take_that_is_taught_or_kept_again_is_known_once():
    again = replace(WALK, sha256="ef" * 32)
    history = HISTORY_OF_TWO.with_version(ModelVersion(3, takes=(again,)))
    assert history.version == 3
    assert history.taught == [again, SHOWN]


def test_versions_and_candidates_are_known_by_their_names(tmp_path):
    model = tmp_path / "ours.markerset.json"
    former = beside(model, "v2")
    assert former.name == "ours.v2.markerset.json"
    former.touch()
    assert beside(model, "v2").name == "ours.v2-2.markerset.json", "nothing that is there is in the way"
    candidate = beside(model, "v3-candidate")
    assert (candidate.name, model_of(candidate)) == ("ours.v3-candidate.markerset.json", model)
    assert model_of(candidate.with_name("ours.v3-candidate-2.markerset.json")) == model
    names = [former.name, candidate.name, "ours.v2-2.markerset.json"]
    assert all(is_beside(Path(name)) for name in names)
    assert not any(is_beside(Path(name)) for name in ("ours.markerset.json", "ours.vain.markerset.json", "v2.json"))
    assert model_of(former) is model_of(Path("ours.json")) is None
