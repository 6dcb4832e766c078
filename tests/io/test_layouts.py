# SPDX-License-Identifier: GPL-3.0-or-later
"""Marker sets in words, as files."""

import pytest

from addon.core.data.errors import InputError
from addon.core.data.layouts import Site
from addon.io.layouts import open_layout, read_layout

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
    with pytest.raises(InputError, match=words) as error:
        read(tmp_path, text)
    assert str(tmp_path / "ours.toml") in str(error.value) and "expected" in error.value.message


def test_an_endless_file_is_not_read_and_one_that_is_not_there_is_said(tmp_path):
    with pytest.raises(InputError, match="expected"):
        read(tmp_path, HEAD + "#" * 2_000_000)
    with pytest.raises(InputError, match=r"no layout; expected a file that ends in \.toml, or one of .*helen_hayes"):
        open_layout("nobody")
    with pytest.raises(InputError):
        open_layout(tmp_path / "none.toml")
