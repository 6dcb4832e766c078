# SPDX-License-Identifier: GPL-3.0-or-later
"""`STEM.edits.json`: to the letter of the contract, back as it was written, and bad ones refused in one sentence."""

import json
import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from addon.core.data.takes import MAX_FRAME
from addon.core.edits.kinds import (
    AssignBlob,
    AssignPoint,
    Delete,
    DeleteBlob,
    Edits,
    Place,
    Right,
    Swap,
    UnlabelBlob,
    UnlabelMarker,
    UnlabelPoint,
)
from addon.core.edits.rows import MAX_EDITS
from addon.io.edits import read_edits, write_edits

from .checks import refused

CONTRACT = """{"version": 1, "edits": [
{"kind": "assign",  "point": 12, "marker": "LKNE", "frames": [100, 250]},
{"kind": "assign",  "camera": "cam1", "frame": 100, "x": 512.3, "y": 88.1, "marker": "LKNE"},
{"kind": "unlabel", "marker": "LKNE", "frames": [100, 250]},
{"kind": "unlabel", "point": 3},
{"kind": "swap",    "markers": ["LKNE", "RKNE"], "frames": [100, 250]},
{"kind": "delete",  "point": 7, "frames": [1, 50]},
{"kind": "place",   "marker": "LKNE", "frame": 120, "xyz": [0.1, 0.2, 0.5]},
{"kind": "right",   "marker": "LKNE", "frames": [100, 250]}
]}"""

number = st.integers(-MAX_FRAME, MAX_FRAME)
near = st.integers(0, 1000)
frames = st.none() | st.tuples(number, number).map(lambda two: (min(two), max(two)))
name = st.text(st.characters(exclude_categories=["Cs"]), min_size=1).filter(str.strip)
point = st.integers(0, 2**31 - 1)
pixel = st.floats(-1e6, 1e6)
word = st.text(st.characters(exclude_categories=["Cs"]), max_size=5).map("my ".__add__)
more = st.dictionaries(word, st.none() | st.booleans() | st.integers() | st.text(max_size=5).map(ascii), max_size=2)
edit = st.one_of(
    st.builds(AssignPoint, point, name, frames=frames, more=more),
    st.builds(AssignBlob, name, number, pixel, pixel, name, more=more),
    st.builds(lambda at, off, *rest: AssignBlob("a", at, *rest, frames=(at, at + off)), near, near, pixel, pixel, name),
    st.builds(UnlabelBlob, name, number, pixel, pixel),
    st.builds(DeleteBlob, name, number, pixel, pixel, more=more),
    st.builds(UnlabelMarker, name, frames=frames),
    st.builds(UnlabelPoint, point, frames=frames),
    st.builds(Swap, st.lists(name, min_size=2, max_size=2, unique=True).map(tuple), frames=frames),
    st.builds(Delete, point, frames=frames),
    st.builds(Place, name, number, st.tuples(*[st.floats(-1e4, 1e4)] * 3)),
    st.builds(Right, name, frames=frames),
)


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "walk.edits.json"


def test_the_contracts_own_lines_are_read(path):
    path.write_text(CONTRACT)
    assert read_edits(path).items == (
        AssignPoint(12, "LKNE", frames=(100, 250)),
        AssignBlob("cam1", 100, 512.3, 88.1, "LKNE"),
        UnlabelMarker("LKNE", frames=(100, 250)),
        UnlabelPoint(3),
        Swap(("LKNE", "RKNE"), frames=(100, 250)),
        Delete(7, frames=(1, 50)),
        Place("LKNE", 120, (0.1, 0.2, 0.5)),
        Right("LKNE", frames=(100, 250)),
    )


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)
@given(st.lists(edit, max_size=4), more)
def test_what_is_written_comes_back(path, monkeypatch, items, beside):
    # Waiting for the disk at every example takes longer than all else.
    monkeypatch.setattr("addon.io.whole.os.fsync", lambda _: None)
    edits = Edits(tuple(items), beside)
    write_edits(path, edits)
    assert read_edits(path) == edits


def test_an_edit_has_a_line_and_what_is_not_known_is_kept(path):
    path.write_text('{"by": "Ann", "version": 1, "edits": [{"kind": "right", "marker": "C7", "why": ["seen"]}]}')
    edits = read_edits(path)
    write_edits(path, edits.added(UnlabelPoint(4, frames=(2, 9))))
    assert path.read_text().splitlines() == [
        "{",
        '  "version": 1,',
        '  "by": "Ann",',
        '  "edits": [',
        '    {"kind": "right", "marker": "C7", "why": ["seen"]},',
        '    {"kind": "unlabel", "point": 4, "frames": [2, 9]}',
        "  ]",
        "}",
    ]
    write_edits(path, Edits())
    assert json.loads(path.read_text()) == {"version": 1, "edits": []}


def test_a_file_is_written_whole_or_not_at_all(path, monkeypatch):
    write_edits(path, Edits((Right("A"),)))
    before = path.read_bytes()
    monkeypatch.setattr("addon.io.edits.write_json", lambda part, _: part.write_text("half") / 0)
    with pytest.raises(ZeroDivisionError):
        write_edits(path, Edits((Right("B"),)))
    assert path.read_bytes() == before and list(path.parent.iterdir()) == [path]


def read(path: Path, text: str) -> Edits:
    path.write_text(text)
    return read_edits(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("[]", "is no object"),
        ('{"version": 1', "is not valid JSON"),
        ('{"version": 1, "edits": [{"kind": "right", "marker": "A"}', "is not valid JSON"),
        ("[" * 100_000, "is not JSON that can be read"),
        ('{"edits": []}', "has the version none"),
        ('{"version": true, "edits": []}', "has the version True"),
        ('{"version": "1", "edits": []}', "has the version '1'"),
        ('{"version": 2, "edits": []}', "is of version 2"),
        ('{"version": 1}', 'has no list "edits"'),
        ('{"version": 1, "edits": {"kind": "right"}}', 'has no list "edits"'),
        ('{"version": 1, "edits": [], "x": NaN}', "holds beside its edits what JSON cannot hold"),
    ],
)
def test_files_that_are_no_edits_are_refused(path, text, said):
    refused(re.escape(said), read, path, text)


BLOB, PLACED = '{"kind": "assign", "camera": "c"', '{"kind": "place", "marker": "A", "frame": 1, "xyz": '


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("5", "is no object"),
        ("{}", "is of the kind none"),
        ('{"kind": "rename", "marker": "A"}', "is of the kind 'rename'"),
        ('{"kind": ["assign"]}', "is of the kind ['assign']"),
        ('{"kind": "assign", "marker": "A"}', "lacks point"),
        ('{"kind": "assign", "marker": "A", "camera": "c", "x": 1}', "lacks point"),
        ('{"kind": "assign", "point": 3}', "lacks marker"),
        ('{"kind": "assign", "point": 3, "marker": "A", "frame": 5}', "has 'frame' beside point marker"),
        (BLOB + ', "frame": 3, "x": 1, "y": 2, "marker": "A", "frames": [1, 2]}', "of frame 3, in frames 1–2"),
        ('{"kind": "unlabel", "camera": "c", "frame": 1, "x": 1}', "lacks marker"),
        ('{"kind": "delete", "camera": "c", "frame": 1, "x": 1}', "lacks point"),
        ('{"kind": "assign", "point": -1, "marker": "A"}', "has the point -1"),
        ('{"kind": "assign", "point": 1.0, "marker": "A"}', "has the point 1.0"),
        ('{"kind": "assign", "point": true, "marker": "A"}', "has the point True"),
        ('{"kind": "assign", "point": 1' + "0" * 30 + ', "marker": "A"}', "has the point of too many digits"),
        ('{"kind": "assign", "point": 1, "marker": 5}', "has the marker 5"),
        ('{"kind": "assign", "point": 1, "marker": " "}', "has the marker ' '"),
        ('{"kind": "assign", "point": 1, "marker": "\\ud800"}', "has the marker"),
        (BLOB + ', "frame": 1, "x": NaN, "y": 2, "marker": "A"}', "looks for a blob at nan"),
        (BLOB + ', "frame": 1, "x": 1e9, "y": 2, "marker": "A"}', "1000000000.0; expected x and y in px, up to 10,0"),
        ('{"kind": "assign", "camera": "c", "frame": 1.5, "x": 1, "y": 2, "marker": "A"}', "has the frame 1.5"),
        ('{"kind": "unlabel"}', "lacks marker"),
        ('{"kind": "unlabel", "marker": "A", "point": 3}', "has 'point' beside marker"),
        ('{"kind": "swap", "markers": ["A"]}', "has the markers ['A']; expected two names"),
        ('{"kind": "swap", "markers": ["A", "A"]}', "swaps 'A' with itself"),
        ('{"kind": "right", "marker": "A", "frames": [5, 4]}', "has the frames 5 to 4"),
        ('{"kind": "right", "marker": "A", "frames": [5]}', "has the frames [5]; expected the first"),
        ('{"kind": "right", "marker": "A", "frames": [1, Infinity]}', "has the frame inf; expected a whole number"),
        ('{"kind": "right", "marker": "A", "frames": [1, [2], {}, 4, 5, 6]}', "[1, a list, an object, 4, …]; expected"),
        ('{"kind": "right", "marker": "A", "frames": 5}', "has the frames 5"),
        (PLACED + "[0, 0]}", "has the place [0, 0]; expected x, y and z"),
        (PLACED + "[0, 0, NaN]}", "has the place [0, 0, nan]; expected x, y and z in m, finite and"),
        (PLACED + "[0, 0, 1e5]}", "[0, 0, 100000.0]; expected x, y and z in m, finite and up to 10,000 either"),
        (PLACED + '[0, 0, "1"]}', """has the place [0, 0, '1'];"""),
        ('{"kind": "right", "marker": "A", "note": NaN}', "holds what JSON cannot hold"),
    ],
)
def test_edits_that_are_none_are_refused_by_their_number(path, row, said):
    text = f'{{"version": 1, "edits": [{{"kind": "right", "marker": "A"}}, {row}]}}'
    refused(f": edit 2 .*{re.escape(said)}", read, path, text)


def test_a_list_of_more_than_anybody_makes_is_refused(path):
    row = '{"kind": "right", "marker": "A"}'
    text = f'{{"version": 1, "edits": [{",".join([row] * (MAX_EDITS + 1))}]}}'
    refused(f"has {MAX_EDITS + 1} edits; expected at most", read, path, text)
