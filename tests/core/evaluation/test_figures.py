# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures counted by hand and slowly, and what a take labelled again by another model got worse in."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.data.takes import Points
from addon.core.evaluation.comparing import Comparison, TakeDifference, WorseOptions, difference_lines, share
from addon.core.evaluation.figures import Figures
from addon.core.evaluation.relabelling import NO_NAME, UNTOLD, NameCounts, count_names, without_names

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


def test_swaps_are_pairs_in_one_image_and_markers_of_several_subjects_each_their_own():
    rows = [(1, 0, "B", "A"), (1, 0, "A", "B"), (2, 0, "B", "A"), (2, 1, "A", "B")]
    rows += [(3, 0, "B", "A|C"), (3, 0, "C", "B")]
    assert figures(rows).swaps == {("A", "B"): 1, ("B", "C"): 1}
    assert figures([*rows, (4, 1, "A", "B"), (4, 1, "B", "A")]).swaps[("A", "B")] == 2
    rows = [(1, 0, "ann:A", "ann:sacrum"), (1, 0, "ann:B", "bob:B"), (1, 0, "", "bob:A"), (1, 0, "bob:Z", "bob:Z")]
    result = figures(rows, markers=["A", "B"], aliases={"sacrum": "A"}).as_dict()
    assert (result["right"], result["labels"], result["marker_blobs"]) == (1, 3, 3)
    assert result["false_occlusions"] == 1, "bob's two, and nobody without a name"


def test_nothing_given_is_no_number_and_still_json_and_columns_of_different_lengths_are_refused():
    result = Figures(MARKERS).add([], [], [], []).as_dict()
    assert result["precision"] is None
    assert json.loads(json.dumps(result))["perfect_frames"] is None
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


def named(xyz: np.ndarray, rate: float = 10.0) -> Points:
    names = tuple(f"M{number}" for number in range(xyz.shape[1]))
    return Points(names, xyz, np.where(np.isfinite(xyz[..., 0]), 0.001, np.nan), rate, 5)


@given(st.integers(1, 80), st.integers(1, 6), st.integers(0, 1000), st.integers(1, 30))
def test_every_point_is_there_once_with_its_name_and_in_a_piece_of_its_own(frames, count, seed, longest):
    chance = np.random.default_rng(seed)
    xyz = np.where(chance.random((frames, count, 1)) < 0.7, chance.normal(size=(frames, count, 3)), np.nan)
    truth = np.broadcast_to(np.arange(count), xyz.shape[:2])
    names = tuple(f"M{number}" for number in range(count))
    found = without_names("take", names, named(xyz), truth, 1000.0, longest / 10)
    points, standing = found.points, found.points.lanes
    assert set(points.names) <= {""}
    there = np.isfinite(points.xyz[..., 0])
    np.testing.assert_array_equal(np.isfinite(xyz[..., 0]).sum(axis=1), there.sum(axis=1))
    for frame, lane in zip(*np.nonzero(there), strict=True):
        np.testing.assert_array_equal(points.xyz[frame, lane], xyz[frame, found.truth[frame, lane]])
    covered = np.zeros_like(there, dtype=int)
    for _, span, lane in standing.each_alone():
        assert span.stop - span.start <= longest
        assert there[span, lane].all()
        covered[span, lane] += 1
    np.testing.assert_array_equal(covered, there)
    again = without_names("take", names, named(xyz), truth, 1000.0, longest / 10)
    np.testing.assert_array_equal(again.truth, found.truth)


def test_names_are_counted_where_they_are_known():
    truth = np.array([[0, 1, NO_NAME, UNTOLD], [0, 1, NO_NAME, UNTOLD]])
    given_names = np.array([[0, 0, 1, 1], [0, NO_NAME, NO_NAME, 0]])
    present = np.array([[True] * 4, [False, True, True, True]])
    counts = count_names(given_names, truth, present, 3)
    assert (counts.present.tolist(), counts.right.tolist(), counts.wrong.tolist()) == ([1, 2, 0], [1, 0, 0], [1, 1, 0])
    assert (counts.recall, counts.wrong_share) == (1 / 3, 2 / 3)


def counts(right, wrong, refused=""):
    return NameCounts(np.array([100, 100]), np.array(right), np.array(wrong), refused)


def compared(*pairs, **options):
    takes = [TakeDifference(f"{n}.c3d", "kept", 100, *pair) for n, pair in enumerate(pairs)]
    return Comparison(("A", "B"), tuple(takes), (("gone.c3d", "there is no such file"),), WorseOptions(**options))


def test_what_got_worse_beyond_its_margin_is_said():
    same = counts([90, 90], [0, 0])
    assert compared((same, same), (same, counts([100, 90], [0, 0]))).worse == []
    assert compared((same, counts([85, 86], [1, 0])), *[(same, same)] * 9).worse == [], "within the margins"
    many = [(same, same)] * 20
    assert compared((same, counts([90, 90], [3, 0])), *many).worse == ["0.c3d: 1.50 % wrong names, 0 % before"]
    assert compared((same, counts([79, 90], [0, 0])), *many).worse == ["0.c3d: 84.50 % named right, 90.00 % before"]
    refused = counts([0, 0], [0, 0], "does not look like it; expected another")
    assert "0.c3d is refused now: does not look like it" in compared((same, refused), *many).worse
    assert compared((refused, refused)).worse == []
    little = counts([89, 90], [1, 0])
    assert compared((same, little), (same, little), recall=0.004).worse == [
        "all takes together: 0.50 % wrong names, 0 % before",
        "all takes together: 89.50 % named right, 90.00 % before",
    ]


def test_a_wrong_name_throughout_a_take_is_never_let_pass():
    there = np.full(60, 100)
    before = NameCounts(there, there, 0 * there)
    after = NameCounts(there, there - 100 * (np.arange(60) == 7), 100 * (np.arange(60) == 9))
    takes = [TakeDifference(f"{n}.c3d", "kept", 100, before, after if n == 3 else before) for n in range(20)]
    comparison = Comparison(tuple(f"M{n}" for n in range(60)), tuple(takes))
    assert comparison.worse == ["3.c3d: 1.67 % wrong names, 0 % before"]
    rows = comparison.markers_worse(takes[3])
    found = [(row["marker"], row["right"], row["wrong"]) for row in rows]
    assert found == [("M7", [100, 0], [0, 0]), ("M9", [100, 100], [0, 100])]


def test_a_share_is_whole_only_where_it_is_all_or_nothing():
    said = [share(value) for value in (0.0, 1e-9, 0.5, 1 - 1e-9, 1.0)]
    assert said == ["0 %", "0.01 %", "50.00 %", "99.99 %", "100 %"]


def test_the_difference_is_told_to_people():
    same, other = counts([90, 90], [0, 0]), counts([100, 60], [0, 5])
    shares = "80.00 % named right (90.00 % before), 2.50 % wrong (0 % before)"
    lines = difference_lines(compared((same, same), (same, other)).as_dict())
    assert lines == [
        "2 takes labelled again: 85.00 % named right (90.00 % before), 1.25 % wrong (0 % before)",
        f"1.c3d (kept): {shares}; worse: B 60.00 % right (90.00 %) and 5.00 % wrong (0 %)",
        "gone.c3d was not labelled again: there is no such file",
    ]
    nothing = difference_lines(Comparison(("A",), ()).as_dict())
    assert nothing == ["no take was labelled again, so nobody knows what got worse: keep labelled takes for it"]
