# SPDX-License-Identifier: GPL-3.0-or-later
"""A model's history: it comes back, changes nothing else of the file, and what is damaged of it is said."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from addon.core.data.errors import InputError
from addon.core.points.history import NO_HISTORY, ModelHistory, ModelVersion
from addon.io.markersets import read_markerset
from addon.io.model_history import HISTORY, beside, is_beside, model_of, moved, seen_at, seen_from
from addon.io.models import open_model, read_model, write_model
from tests.io.samples import HISTORY_OF_TWO, SHOWN, WALK, toy_model


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


@pytest.mark.parametrize(
    "wound",
    [
        lambda history: [],
        lambda history: {},
        lambda history: history | {"versions": 3},
        lambda history: history | {"versions": [7]},
        lambda history: history | {"versions": [{"version": 0}]},
        lambda history: history | {"versions": [{"version": True}]},
        lambda history: history | {"versions": [{"version": 2}, {"version": 2}]},
        lambda history: history | {"versions": [{"version": 1, "by": 5}]},
        lambda history: history | {"versions": [{"version": 1, "by": "a\nb"}]},
        lambda history: history | {"versions": [{"version": 1, "takes": [{}]}]},
        lambda history: history | {"versions": [{"version": 1, "takes": [{"take": "a", "frames": -1}]}]},
        lambda history: history | {"versions": [{"version": 1, "takes": [{"take": "a", "rate": "fast"}]}]},
        lambda history: history | {"versions": [{"version": 1, "checked": [{"take": "a", "recall": [1]}]}]},
        lambda history: history | {"versions": [{"version": 1, "takes": [{"take": "a", "rate": 10**400}]}]},
        lambda history: history | {"kept_takes": 1},
        lambda history: history | {"kept_takes": ["a"]},
    ],
)
def test_what_is_damaged_is_said(path, wound):
    document = json.loads(path.read_text(encoding="utf-8"))
    document["history"] = wound(document["history"])
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError, match=r"toy\.markerset\.json: has a damaged history; expected"):
        read_model(path)


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
