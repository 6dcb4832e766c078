# SPDX-License-Identifier: GPL-3.0-or-later
"""Marker sets as text, and in words: nothing is lost but digits; those that ship are the contract's, of people."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from addon.core.body.sides import other_side
from addon.core.data.markersets import MarkerSet, Site
from addon.core.points.models import Model
from addon.io.layouts import open_layout, read_layout
from addon.io.markersets import builtin_markersets, document_of, open_markerset, read_markerset
from addon.io.models import write_model
from addon.io.text import json_text
from scripts import anatomy
from tests.accuracy.people import BODY26, GAIT15
from tests.core.toybody import toy_markerset
from tests.io.checks import assert_alike, refused


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "toy.markerset.json"


def text_of(markerset: MarkerSet) -> str:
    return json_text(document_of(markerset)) + "\n"


GONE = object()


def damaged(markerset: MarkerSet, *keys, value=None) -> str:
    """The set's text with another value at these keys, or without them."""
    document = node = document_of(markerset)
    for key in keys[:-1]:
        node = node[key]
    if value is GONE:
        del node[keys[-1]]
    else:
        node[keys[-1]] = value
    return json.dumps(document)


def test_a_marker_set_comes_back_and_its_text_is_made_for_reading(path):
    markerset = replace(
        toy_markerset(), aliases={"s2": "SACR", "sacrum": "SACR", "l_toe": "LTOE"}, source={"people": "nobody"}
    )
    write_model(path, Model(markerset))
    found, text = read_markerset(path), path.read_text(encoding="utf-8")
    assert_alike(found, markerset)
    assert found.skeleton.parents.dtype.kind == found.attachment.dtype.kind == "i"
    assert text_of(found) == text
    lines = text.splitlines()
    sacrum = '    {"name": "SACR", "segment": "pelvis", "offset": [-0.08, 0, 0.02]'
    assert any(line.startswith(sacrum) for line in lines)
    assert '    {"name": "pelvis", "parent": null, "offset": [0, 0, 0.53]},' in lines
    assert all(len(line) < 140 for line in lines if line.startswith('    {"name"'))


def test_keys_of_later_versions_are_let_be(path):
    document = document_of(toy_markerset())
    document["ensemble"] = {"solvers": [1, 2, 3]}
    document["markers"][0]["colour"] = "red"
    path.write_text(json.dumps(document), encoding="utf-8")
    assert_alike(read_markerset(path), toy_markerset())


PARTS = ("mocap_autolabel", "name", "segments", "markers", "capsules", "height", "modes", "pose")
TOO_LONG = [[0.0] * (index + 1) for index in range(3)]


@pytest.mark.parametrize(
    ("keys", "value", "words"),
    [
        (("mocap_autolabel",), 0, 'has no "mocap_autolabel": 1'),
        (("mocap_autolabel",), 2, "of version 2; expected 1"),
        (("name",), "", 'no "name"'),
        (("source",), ["x"], '"source" is not an object of texts'),
        *(((key,), value, "expected") for key, value in (("description", "a\ud800"), ("source", {"who": "\ud800"}))),
        (("segments",), [], '"segments" is missing or empty'),
        (("segments", 3, "parent"), "tail", r"segments\[3\] has the parent 'tail', which is no segment"),
        (("segments", 3, "parent"), "upper_arm.L", "go in a circle"),
        (("segments", 1, "parent"), "head", "go in a circle"),
        (("segments", 1, "parent"), None, "one root"),
        (("segments", 0, "parent"), "head", "one root"),
        (("segments", 2, "name"), "pelvis", "'pelvis' twice"),
        (("segments", 2, "offset"), [0, 1], "not 3 finite numbers"),
        (("segments", 2, "offset"), [0, 1, float("nan")], "not 3 finite numbers"),
        (("segments", 2, "offset"), [0, 1, 10**400], "not 3 finite numbers"),
        (("segments", 2, "offset"), [0, 1, True], "not 3 finite numbers"),
        (("markers", 4, "name"), "A|B", "has a sign that label files need"),
        (("markers", 4, "name"), "*3", "has a sign that label files need"),
        (("markers", 4, "name"), "LASI", "'LASI' twice"),
        (("markers", 4, "segment"), "tail", "'tail', which is no segment; expected one of pelvis"),
        (("markers", 4, "sd"), -1, r'markers\[4\] has no "sd" from 0'),
        (("markers", 4, "aliases"), ["LASI"], "alias 'LASI' of C7 is taken"),
        (("markers", 4, "aliases"), "s2", "not a list of names"),
        (("capsules", 0, "radius"), 0, '"radius"'),
        (("capsules", 0, "segment"), 3, '"segment"'),
        (("height", "mean"), 17, '"mean" from 0.3 to 3'),
        (("height",), None, "height is missing"),
        (("modes", 0, "joints"), {}, "has no 'pelvis'"),
        (("pose", "mean", "head"), [1], "not 3 finite numbers"),
        (("pose", "covariance"), TOO_LONG, "not 39 rows"),
        (("pose", "covariance", 4), [0, 0, 0, 0, -1], "negative in some direction"),
        (("pose", "covariance", 4), [0, 0], "row 4 is not 5 finite numbers"),
        *(((key,), GONE, key) for key in PARTS),
    ],
)
def test_what_cannot_be_is_named(path, keys, value, words):
    path.write_text(damaged(toy_markerset(), *keys, value=value), encoding="utf-8")
    refused(words, read_markerset, path)


def test_broken_json_is_told_with_its_line(path):
    before, key, after = text_of(toy_markerset()).partition('"height"')
    path.write_text(before + key + after.removeprefix(":"), encoding="utf-8")
    refused("not valid JSON", read_markerset, path, line=before.count("\n") + 1)


def test_numbers_that_are_none_are_not_written(tmp_path):
    toy = toy_markerset()
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_model(tmp_path / "a.json", Model(replace(toy, offsets=toy.offsets * np.nan)))
    assert not list(tmp_path.iterdir())


BODY39 = (
    "LFHD RFHD LBHD RBHD C7 T10 CLAV STRN RBAK LSHO LUPA LELB LFRM LWRA LWRB LFIN RSHO RUPA RELB RFRM RWRA RWRB RFIN "
    "LASI RASI LPSI RPSI LTHI LKNE LTIB LANK LHEE LTOE RTHI RKNE RTIB RANK RHEE RTOE"
)


def test_the_built_in_sets_are_the_contracts_and_one_that_is_not_there_is_refused_with_those(tmp_path):
    """Checklist A2."""
    contract = {"body26": BODY26, "body39": tuple(BODY39.split()), "gait15": GAIT15}
    wanted = {name: one.markers for name, one in anatomy.ACTOR_SETS.items()} | contract
    found = {name: open_markerset(name) for name in builtin_markersets()}
    assert {name: one.markers for name, one in found.items()} == wanted
    for name, path in builtin_markersets().items():
        assert found[name].name == open_markerset(path).name == name
    refused(r"no marker set gait99; expected .*gait15", open_markerset, "gait99")
    refused("no such file", open_markerset, tmp_path / "mine.markerset.json")


PLACES = [("name",), ("segments", 2, "name"), ("markers", 3, "name"), ("markers", 3, "aliases")]


@pytest.mark.parametrize("name", ["LA\0SI", "LA\tSI", "LA\u2028SI", "LA\x85SI", "LA\ud800SI"])
@pytest.mark.parametrize("keys", PLACES)
def test_names_that_some_format_cannot_give_back_are_refused(path, keys, name):
    path.write_text(damaged(toy_markerset(), *keys, value=[name] if keys[-1] == "aliases" else name), encoding="utf-8")
    refused("expected letters without control signs", read_markerset, path)


@pytest.mark.parametrize("name", ["Links vorne ü", "左膝", "a b", "L\x92ASI", "नमस्ते\u200d", "L:ASI"])
def test_names_of_all_alphabets_are_read_and_written(path, name):
    toy = toy_markerset()
    markerset = replace(toy, markers=(*toy.markers[:3], name, *toy.markers[4:]))
    write_model(path, Model(markerset))
    assert read_markerset(path).markers == markerset.markers


def test_recorded_poses_may_lack_and_are_whole(path):
    poses = np.ones((5, 13, 3))
    document = document_of(replace(toy_markerset(), spread=replace(toy_markerset().spread, poses=poses)))
    document["pose"]["recorded"][2] = [1, 2]
    path.write_text(json.dumps(document), encoding="utf-8")
    refused("pose 3 is not 39 finite numbers", read_markerset, path)
    del document["pose"]["recorded"]
    path.write_text(json.dumps(document), encoding="utf-8")
    assert not len(read_markerset(path).spread.poses)


HEAD = 'name = "ours"\n[markers]\n'


def read(tmp_path, text: str):
    path = tmp_path / "ours.toml"
    path.write_text(text, encoding="utf-8")
    return read_layout(path)


def test_a_star_is_both_sides(tmp_path):
    rows = (
        '"*ASI" = { segment = "pelvis", at = "ASIS" }\n'
        'HeadSide = { segment = "head", at = "left temple" }\n'
        '"*THI" = { segment = "thigh", at = "front outer", along = 0.5, off_mm = 80 }\n'
    )
    layout = read(tmp_path, HEAD + rows)
    assert layout.name == "ours" and layout.source == ""
    assert list(layout.sites) == ["LASI", "RASI", "HeadSide", "LTHI", "RTHI"]
    assert layout.sites["RASI"] == Site("pelvis", "ASIS", None, "R")
    assert layout.sites["HeadSide"] == Site("head", "temple", None, "L")
    assert layout.sites["LTHI"] == Site("thigh.L", "front outer", 0.5, "L", 0.08)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name = ", ":1: is not valid TOML; expected a marker set in words"),
        ("a." * 5000 + "b = 1", "has a key of more than 8 parts"),
        ("x = " + "[" * 5000, "is not TOML that can be read"),
        ('name = "ours"', r"\[markers\] is missing"),
        (HEAD, r"\[markers\] is empty"),
        ("[markers]\nA = { segment = 'pelvis', at = 'sacrum' }", 'has no "name"'),
        (HEAD + "A = 3", "marker 'A' is missing or not an object"),
        (HEAD + "A = { at = 'sacrum' }", """marker 'A' has no "segment"; expected a text"""),
        (HEAD + "A = { segment = 'pelvis' }", """marker 'A' has no "at"; expected a text"""),
        (HEAD + "A = { segment = 'pelvis', at = 'sacrum', sd = 3 }", "marker 'A' has 'sd'; expected along, at, off_mm"),
        (HEAD + "A = { segment = 'pelvis', at = 'front', along = 2 }", '"along" from 0 to 1'),
        (HEAD + "A = { segment = 'pelvis', at = 'front', along = nan }", '"along" from 0 to 1'),
        (HEAD + "A = { segment = 'pelvis', at = 'front', along = true }", '"along" from 0 to 1'),
        (HEAD + "A = { segment = 'pelvis', at = 'sacrum', off_mm = 1e9 }", '"off_mm" from 0 to 300'),
        (HEAD + "'*A' = { segment = 'thigh', at = 'front' }\nLA = { segment = 'pelvis', at = 'sacrum' }", "'LA' twice"),
        (HEAD + "'a|b' = { segment = 'pelvis', at = 'sacrum' }", r"a\|b"),
        (HEAD + "A = { segment = 'pelvis', at = 'sacrum' }\nA = 1", ":4: is not valid TOML"),
    ],
)
def test_a_broken_layout_is_one_sentence(tmp_path, text, words):
    refused(words, read, tmp_path, text)


def test_an_endless_file_is_not_read_and_one_that_is_not_there_is_said(tmp_path):
    refused("expected", read, tmp_path, HEAD + "#" * 2_000_000)
    refused(r"no layout; expected a file that ends in \.toml, or one of .*helen_hayes", open_layout, "nobody")
    refused("no such file", open_layout, tmp_path / "none.toml")


@pytest.fixture(scope="module", params=["gait15", "body26", "body39"])
def markerset(request):
    return open_markerset(request.param)


def test_left_is_left_and_toes_are_ahead(markerset):
    where = dict(zip(markerset.markers, markerset.rest_markers, strict=True))
    for name, place in where.items():
        if other_side(name) in where and other_side(name) != name:
            assert place[1] * (-1 if name[0] == "R" else 1) > 0.01, name
            np.testing.assert_allclose(where[other_side(name)], place * [1, -1, 1], atol=1e-5)
    assert where["LTOE"][0] > where["LHEE"][0] + 0.08
    assert where["LASI"][0] > where["LPSI" if "LPSI" in where else "SACR"][0] + 0.05


@pytest.mark.parametrize("name", ["actor41", "actor53"])
def test_the_sets_of_actors_are_whole_persons_with_poses(name):
    markerset = open_markerset(name)
    where = dict(zip(markerset.markers, markerset.rest_markers, strict=True))
    for side, sign in (("L", 1), ("R", -1)):
        assert all(sign * place[1] > 0.01 for marker, place in where.items() if marker[0] == side)
        assert 0.25 < where[f"{side}KNE"][2] < 0.32
        assert 0.9 < where[f"{side}FHD"][2] < 0.98
        on = markerset.skeleton.segments[markerset.attachment[markerset.markers.index(f"{side}MT5")]]
        assert on == f"foot.{side}"
    assert {"head", "thorax", "forearm.L", "forearm.R"} <= {
        markerset.skeleton.segments[segment] for segment in markerset.capsules.segment
    }
    assert markerset.spread.poses.shape == (400, 15, 3)
    # Its licence asks to share alike.
    assert "bd" not in markerset.source["people"].split()


def test_markers_sit_on_their_skin_or_outside(markerset):
    """Beside a capsule of its own segment, a marker's centre is not inside."""
    capsules = markerset.capsules
    marker, at = np.nonzero(markerset.attachment[:, None] == capsules.segment)
    line, offset = capsules.end[at] - capsules.start[at], markerset.offsets[marker] - capsules.start[at]
    along = np.clip((offset * line).sum(axis=1) / (line**2).sum(axis=1), 0, 1)
    distance = np.linalg.norm(offset - along[:, None] * line, axis=1) / capsules.radius[at]
    assert len(distance) and ((distance > 1) | (distance < 0.6)).all()


def test_the_gait_papers_names_are_known():
    gait = open_markerset("gait15")
    assert gait.index("s2") == gait.index("SACR")
    assert gait.index("r_l_thigh") == gait.index("RTHI")
    assert gait.index("l_calf") == gait.index("LTIB")
    with pytest.raises(KeyError):
        gait.index("LFHD")
