# SPDX-License-Identifier: GPL-3.0-or-later
"""The report: what chunks add up to is what the whole take says, however it was cut."""

import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.data.takes import STEPS, LabelledChunk, Labels, Motion, Suspect
from addon.core.review.summary import TakeSummary
from addon.io.report import take_report
from addon.io.text import write_json


def chunk(present: np.ndarray, first: int = 0, suspects=(), labels=(0, -1), conflicts: int = 1) -> LabelledChunk:
    """A chunk in which `present` (F, M) says which markers are in space; residuals are 2 mm and 0.5 px."""
    frames, count = present.shape
    value = np.where(present, 1.0, np.nan)
    marker = np.array(labels)
    motion = Motion(
        frames=np.arange(first, first + frames),
        markers=np.repeat(value[..., None], 3, axis=2),
        residual=0.002 * value,
        residual_px=0.5 * value,
        conflicts=np.full((frames, count), conflicts),
        expected=np.zeros((frames, count, 3)),
        joints=np.zeros((frames, 1, 3)),
        rotations=np.tile(np.eye(3), (frames, 1, 1, 1)),
        scale=np.ones((frames, 3)),
        confidence=np.where(present.any(axis=1), 0.9, 0.0),
    )
    said = Labels(marker, np.where(marker < 0, 0, 1 + np.arange(len(marker)) % 3), np.ones(len(marker)))
    return LabelledChunk(said, motion, tuple(suspects), {"place": 0.5, "fit": 1.0, "label": 0.5})


def test_the_report_holds_what_the_contract_lists_and_no_speed_without_a_time(tmp_path):
    summary = TakeSummary(["LASI", "RASI"])
    present = np.array([[1, 0], [0, 0], [0, 0], [1, 0], [1, 0]], dtype=bool)
    summary.add(chunk(present, suspects=[Suspect(1, 2, "nobody is there")], labels=(0, 0, -1)))
    report = take_report(summary, "walk", "gait15", 100.0, "1.2.3", {"load": 0.25, "write": 0.125})
    write_json(tmp_path / "walk.report.json", report)
    assert json.loads((tmp_path / "walk.report.json").read_text()) == report
    assert (report["take"], report["model"], report["version"], report["rate"]) == ("walk", "gait15", "1.2.3", 100)
    assert (report["frames"], report["blobs"], report["unlabelled"], report["frames_without_person"]) == (5, 3, 1, 2)
    assert report["suspect"] == [{"first": 1, "last": 2, "reason": "nobody is there"}]
    assert report["markers"]["LASI"] == {
        "labelled_frames": 3, "gaps": 1, "longest_gap": 2, "mean_residual_mm": 2.0, "mean_residual_px": 0.5,
        "conflicts": 5,
    }  # fmt: skip
    assert report["markers"]["RASI"]["mean_residual_mm"] is None
    assert (report["markers"]["RASI"]["gaps"], report["markers"]["RASI"]["longest_gap"]) == (1, 5)
    assert report["timing"] == {
        "load": 0.25, "place": 0.5, "fit": 1.0, "label": 0.5, "write": 0.125, "frames_per_second": 2.5,
    }  # fmt: skip
    assert report["steps"] == {**dict.fromkeys(STEPS[1:], 0), "exclusive": 1, "conflict": 1}
    report = take_report(TakeSummary(["A"]), "a", "m", 100.0, "1", {})
    assert report["timing"]["frames_per_second"] is None


@given(
    st.lists(st.lists(st.booleans(), min_size=2, max_size=2), min_size=1, max_size=40),
    st.lists(st.integers(1, 7), max_size=8),
)
def test_chunks_add_up_to_the_whole(frames, cuts):
    present = np.array(frames)
    whole, parts = TakeSummary(["A", "B"]), TakeSummary(["A", "B"])
    whole.add(chunk(present, labels=()))
    edges = sorted({0, len(present), *(min(sum(cuts[: index + 1]), len(present)) for index in range(len(cuts)))})
    for start, stop in pairwise(edges):
        parts.add(chunk(present[start:stop], start, labels=()))
    assert parts.of_markers() == whole.of_markers()
    assert parts.whole == whole.whole == int((present[:, present.any(axis=0)].all(axis=1) & present.any(axis=1)).sum())
    for index, name in enumerate("AB"):
        runs = "".join("x" if here else "." for here in present[:, index]).split("x")
        gaps = [len(run) for run in runs if run]
        assert (whole.of_markers()[name]["gaps"], whole.of_markers()[name]["longest_gap"]) == (
            len(gaps),
            max(gaps, default=0),
        )


@pytest.mark.parametrize(
    ("ranges", "merged"),
    [
        ([(1, 2, "a"), (3, 5, "a")], [(1, 5, "a")]),
        ([(1, 2, "a"), (4, 5, "a")], [(1, 2, "a"), (4, 5, "a")]),
        ([(1, 2, "a"), (3, 5, "b"), (3, 6, "a")], [(1, 6, "a"), (3, 5, "b")]),
        ([(1, 9, "a"), (3, 5, "a")], [(1, 9, "a")]),
    ],
)
def test_suspects_that_touch_are_one(ranges, merged):
    summary = TakeSummary(["A"])
    for entry in ranges:
        summary.add(chunk(np.ones((1, 1), bool), suspects=[Suspect(*entry)], labels=()))
    assert [(s.first, s.last, s.reason) for s in summary.suspects] == merged
