# SPDX-License-Identifier: GPL-3.0-or-later
"""What labelling again changed, told from files of which only the frames that differ are read."""

from dataclasses import asdict
from itertools import zip_longest

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.data.takes import NO_MARKER
from addon.core.review.changes import changes, summary_of_changes
from addon.io.labels import MAX_LISTED, LabelFile, facts_of_changes

MARKERS = ("LASI", "RASI", "Bob:LKNE", "a,b")
NAMES = ("", "LASI", "RASI", "Bob:LKNE", '"a,b"', "of another model")


def all_rows_read(before, after) -> dict:
    """The same by every row of both files: what it is to be."""
    index = {name: number for number, name in enumerate(MARKERS)}
    table = []
    try:
        with LabelFile(before) as old, LabelFile(after) as new:
            for one, other in zip_longest(old.rows(), new.rows()):
                if one is None or other is None or (one.frame, one.key) != (other.frame, other.key):
                    return {}
                table.append((one.frame, index.get(one.marker, NO_MARKER), index.get(other.marker, NO_MARKER)))
    except InputError:
        return {}
    frame, was, now = np.array(table, dtype=np.int64).reshape(-1, 3).T
    frames, at = np.unique(frame, return_inverse=True)
    found = changes(at.ravel(), was, now, MARKERS, frames)
    return {"changed": [asdict(one) for one in found[:MAX_LISTED]], "changed_in_all": summary_of_changes(found)}


def labels(rng, blobs: bool) -> tuple[str, list[list[str]]]:
    """A header and the rows of some frames, of which a few numbers are left out."""
    frames = np.sort(rng.choice(np.arange(95, 140), 30, replace=False))
    rows = []
    for frame in frames.tolist():
        for point in range(rng.integers(1, 6)):
            key = [f"cam {point % 2}", f"{point}.5", "7"] if blobs else [str(point)]
            rows.append([str(frame), *key, NAMES[rng.integers(len(NAMES))], "fit", "0.9"])
    keys = "frame,camera,x,y" if blobs else "frame,point"
    return f"{keys},marker,step,confidence", rows


def otherwise(rng, rows: list[list[str]]) -> list[list[str]]:
    """The rows with some names, confidences and ways of writing a number changed."""
    found = [list(row) for row in rows]
    for row in found:
        if rng.random() < 0.2:
            row[-3] = NAMES[rng.integers(len(NAMES))]
        if rng.random() < 0.1:
            row[-1] = "0.8"
        if rng.random() < 0.1:
            row[0] = f" {row[0]}.0"
        if rng.random() < 0.1:
            row[-4] += ".00" if len(row) > 5 else ""
    return found


def write(path, header: str, rows: list[list[str]], end: str = "\n"):
    path.write_bytes("".join(line + end for line in (header, *map(",".join, rows))).encode())
    return path


@pytest.mark.parametrize("blobs", [True, False])
@pytest.mark.parametrize("seed", range(8))
def test_the_changes_are_those_of_all_rows(tmp_path, blobs, seed):
    rng = np.random.default_rng(seed)
    header, rows = labels(rng, blobs)
    before = write(tmp_path / "before.csv", header, rows)
    after = write(tmp_path / "after.csv", header, otherwise(rng, rows), "\r\n" if seed % 4 == 3 else "\n")
    found = facts_of_changes(before, after, MARKERS)
    assert found["changed"]
    assert found == all_rows_read(before, after)


def test_the_order_of_the_columns_is_each_files_own(tmp_path):
    rng = np.random.default_rng(1)
    header, rows = labels(rng, True)
    turned = [[row[4], row[0], *row[1:4], *row[5:]] for row in rows]
    before = write(tmp_path / "before.csv", "marker,frame,camera,x,y,step,confidence", turned)
    after = write(tmp_path / "after.csv", header, otherwise(rng, rows))
    assert facts_of_changes(before, after, MARKERS) == all_rows_read(before, after) != {}
    assert facts_of_changes(before, before, MARKERS) == {"changed": [], "changed_in_all": ""}


@pytest.mark.parametrize(
    "spoil",
    [
        lambda lines: lines[:-1],
        lambda lines: [*lines, b"999,cam 0,1,2,LASI,fit,1"],
        lambda lines: [lines[0], *lines[2:], lines[1]],
        lambda lines: [*lines[:5], lines[5].replace(b"cam", b"lens"), *lines[6:]],
        lambda lines: [*lines[:5], lines[5] + b",more", *lines[6:]],
        lambda lines: [*lines[:5], lines[5] + b"\0", *lines[6:]],
        lambda lines: [*lines[:5], b'100,cam 0,1,2,"LASI', *lines[6:]],
        lambda lines: [b"frame,point,marker", *lines[1:]],
        lambda lines: [b"something else"],
        lambda lines: [],
    ],
)
def test_of_other_rows_and_other_files_nothing_is_said(tmp_path, spoil):
    header, rows = labels(np.random.default_rng(2), True)
    after = write(tmp_path / "after.csv", header, rows)
    before = tmp_path / "before.csv"
    before.write_bytes(b"\n".join(spoil(after.read_bytes().splitlines())))
    assert facts_of_changes(before, after, MARKERS) == all_rows_read(before, after) == {}


def test_an_empty_line_is_no_row(tmp_path):
    header, rows = labels(np.random.default_rng(3), False)
    after = write(tmp_path / "after.csv", header, rows)
    before = tmp_path / "before.csv"
    before.write_bytes(after.read_bytes().replace(b"\n", b"\n\n"))
    assert facts_of_changes(before, after, MARKERS) == all_rows_read(before, after) != {}
