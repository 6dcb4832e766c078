# SPDX-License-Identifier: GPL-3.0-or-later
"""Great files are read, or refused in one sentence, within a gigabyte and five seconds."""

import json

import pytest

from addon.io.markersets import write_markerset
from tests.core.toybody import toy_markerset
from tests.fuzz.limits import read_within


def markerset(path, change) -> None:
    """The toy marker set's file after `change` to its document."""
    write_markerset(path, toy_markerset())
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document, ensure_ascii=False), encoding="utf-8")


def many_markers(document):
    document["markers"] = [{**document["markers"][0], "name": f"M{number}"} for number in range(30_000)]


def many_segments(document):
    more = [{"name": f"s{number}", "parent": "head", "offset": [0, 0, 0]} for number in range(40_000)]
    document["segments"] += more


def many_aliases(document):
    document["markers"][0]["aliases"] = [f"alias {number}" for number in range(300_000)]


def many_capsules(document):
    document["capsules"] = [document["capsules"][0]] * 30_000


def many_numbers(document):
    document["notes"] = [[number, 0.5] for number in range(3_000_000)]


def deep(document):
    document["notes"] = json.loads("[" * 900 + "]" * 900)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (many_markers, '"markers" has 30000 rows; expected at most 1000'),
        (many_segments, '"segments" has 40013 rows; expected at most 1000'),
        (many_capsules, '"capsules" has 30000 rows; expected at most 1000'),
        (many_numbers, "has more than 2000000 values; expected a m"),
        (many_aliases, "read"),
        (deep, "read"),
    ],
)
def test_great_marker_sets_and_models(tmp_path, change, said):
    """A model is read as its marker set is, and then the rest of it."""
    path = tmp_path / "great.markerset.json"
    markerset(path, change)
    assert said in read_within("model", path)


def test_a_model_with_much_to_keep_is_read(tmp_path):
    path = tmp_path / "great.markerset.json"
    markerset(path, lambda document: document.update(notes="é€" * 9_000_000 + "\U0001f600"))
    assert read_within("model", path) == "read"


HEAD = "frame,camera,x,y,marker\n"
BLOBS = "frame,camera,x,y\n"


@pytest.mark.parametrize(
    ("kind", "content", "said"),
    [
        ("labels", HEAD + "1,a,2,3,LASI\n" * 500_000, "read"),
        ("labels", HEAD + '"\n",' * 12_000_000, "quote that is not closed; expected"),
        ("labels", HEAD + "1," * 30_000_000, "line of over 1 MB; expected"),
        ("labels", "frame," * 10_000_000, "line of over 1 MB; expected"),
        ("labels", HEAD + '"' + "\n" * 60_000_000, "quote that is not closed; expected"),
        ("blobs", BLOBS + "1,cam_1,2,3\n" * 5_000_000, "over 500000 blobs in frame 1; expected"),
        ("blobs", BLOBS + "1," * 30_000_000, "line of over 1 MB; expected"),
        ("blobs", "frame," * 10_000_000, "expected"),
        ("blobs", BLOBS + "".join(f"{frame},cam_1,2,3\n" for frame in range(400_000)), "read"),
    ],
    ids=["many", "quotes", "fields", "header", "newlines", "one frame", "a line", "columns", "long take"],
)
def test_great_labels_and_blobs(tmp_path, kind, content, said):
    path = tmp_path / "great.csv"
    path.write_text(content)
    assert said in read_within(kind, path)
