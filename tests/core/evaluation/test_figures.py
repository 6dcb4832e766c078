# SPDX-License-Identifier: GPL-3.0-or-later
"""The contract's figures: by hand on small cases, against a slow reading of the contract on random ones."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.evaluation.figures import Figures

MARKERS = ("A", "B", "C")


def figures(rows, markers=MARKERS, **options):
    """Rows are (frame, camera, label, truth)."""
    frame, camera, labels, truth = zip(*rows, strict=True)
    return Figures(markers, **options).add(frame, camera, labels, truth)


def test_by_hand():
    rows = [
        (1, "x", "A", "A"),
        (1, "x", "C", "B"),  # wrong; B is missed, C is not there and not declared occluded
        (1, "x", "", ""),  # a ghost left alone
        (2, "x", "A", "A|B"),  # merged: right, and stands for B
        (2, "x", "", "C"),  # missed
        (2, "y", "B", ""),  # a ghost with a name
        (3, "y", "A", "A"),
    ]
    result = figures(rows).as_dict()
    assert (result["labels"], result["right"], result["wrong"], result["marker_blobs"]) == (5, 3, 2, 5)
    assert result["precision"] == pytest.approx(3 / 5)
    assert result["recall"] == pytest.approx(3 / 5)
    assert result["false_assignments"] == pytest.approx(2 / 5)
    assert result["perfect_frames"] == pytest.approx(1 / 3)
    # Declared occluded: frame 1 x: B; 2 x: B, C; 2 y: A, C; 3 y: B, C. There in truth and not stood for: B, C.
    assert result["false_occlusions"] == pytest.approx(2 / 7)
    assert result["per_marker"]["B"]["false_occlusions"] == pytest.approx(1 / 3)
    assert result["per_marker"]["A"]["precision"] == 1
    assert result["per_marker"]["C"]["perfect_frames"] == pytest.approx(1 / 3)
    assert result["per_marker"]["C"]["precision"] == 0
    assert result["swaps"] == []


def test_swaps_are_pairs_in_one_image():
    rows = [
        (1, 0, "B", "A"),
        (1, 0, "A", "B"),
        (2, 0, "B", "A"),
        (2, 1, "A", "B"),
        (3, 0, "B", "A|C"),
        (3, 0, "C", "B"),
    ]
    assert figures(rows).swaps == {("A", "B"): 1, ("B", "C"): 1}
    assert figures([*rows, (4, 1, "A", "B"), (4, 1, "B", "A")]).swaps[("A", "B")] == 2


def test_markers_of_several_subjects_are_each_their_own():
    rows = [(1, 0, "ann:A", "ann:sacrum"), (1, 0, "ann:B", "bob:B"), (1, 0, "", "bob:A"), (1, 0, "bob:Z", "bob:Z")]
    result = figures(rows, markers=["A", "B"], aliases={"sacrum": "A"}).as_dict()
    assert (result["right"], result["labels"], result["marker_blobs"]) == (1, 3, 3)
    assert result["false_occlusions"] == 1, "bob's two, and nobody without a name"


def test_nothing_given_is_no_number_and_still_json():
    result = Figures(MARKERS).add([], [], [], []).as_dict()
    assert result["precision"] is None
    assert json.loads(json.dumps(result))["perfect_frames"] is None


def test_columns_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match="lengths"):
        Figures(MARKERS).add([1, 2], [0, 0], ["A"], ["A", "B"])


def slow(rows):
    """The contract's sentences, one blob at a time."""
    given = [row for row in rows if row[2]]
    right = [row for row in given if row[2] in row[3].split("|")]
    present = [row for row in rows if row[3]]
    frames = {row[0] for row in rows}
    spoilt = {row[0] for row in rows if not (row[2] in row[3].split("|") if row[3] else not row[2])}
    occluded = missed = 0
    for view in {row[:2] for row in rows}:
        here = [row for row in rows if row[:2] == view]
        for name in MARKERS:
            if any(row[2] == name for row in here):
                continue
            occluded += 1
            holding = [row for row in here if name in row[3].split("|")]
            missed += bool(holding) and not any(row in right for row in holding)
    return len(given), len(right), len(present), occluded, missed, len(spoilt), len(frames)


names = st.sampled_from(["", "A", "B", "C"])
texts = st.sampled_from(["", "A", "B", "C", "A|B", "B|C", "A|B|C"])
row_lists = st.lists(st.tuples(st.integers(0, 4), st.integers(0, 2), names, texts), min_size=1, max_size=30)


@settings(max_examples=200, deadline=None)
@given(row_lists)
def test_agrees_with_the_contract_read_slowly(rows):
    total = figures(rows).total
    found = (total.given, total.right, total.present, total.absent, total.missed, total.spoilt, total.frames)
    assert found == slow(rows)
