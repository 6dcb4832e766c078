# SPDX-License-Identifier: GPL-3.0-or-later
"""Reports and the pages that people pass on: what they say, that nothing runs or is fetched, and what they weigh."""

import json
import time
import xml.etree.ElementTree as ElementTree
from dataclasses import asdict, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.data.takes import (
    BY_EDIT,
    NO_MARKER,
    STEPS,
    EditOutcome,
    LabelledChunk,
    Labels,
    PointRows,
    Suspect,
)
from addon.core.edits.kinds import AssignPoint, Edits, Place
from addon.core.review.changes import changes, summary_of_changes
from addon.core.review.overview import OverviewSubject, TakeOverview
from addon.core.review.summary import TakeSummary
from addon.core.review.take_trouble import TakeTrouble
from addon.io.batch import TakeRow, row_of
from addon.io.html.markup import is_page, percent
from addon.io.html.pages import write_folder_page, write_take_page
from addon.io.labels import MAX_LISTED, LabelFile, facts_of_changes
from addon.io.report import facts_of_trouble, take_report
from addon.io.text import write_json
from tests.core.scenes import motion_of
from tests.io.pages import read
from tests.io.test_arrivals import REPORT

HOSTILE = '</title><script>alert("1")</script><img src=x onerror=alert(1)>&\'"\u202e\x07\udc80'


def take(frames: int, markers: int, first: int = 1, seed: int = 0) -> tuple[PointRows, LabelledChunk]:
    """Points of somebody who walks on, every marker within 2 cm of where the body has it, gaps here and there."""
    rng = np.random.default_rng(seed)
    rest = rng.uniform((-0.3, -0.3, 0), (0.3, 0.3, 1.8), (markers, 3))
    expected = rest + np.linspace(0, 3, frames)[:, None, None] * (1, 0, 0)
    xyz = expected + rng.normal(0, 0.005, expected.shape)
    for _ in range(markers // 2):
        start = rng.integers(frames)
        xyz[start : start + frames // 20 + 1, rng.integers(markers)] = np.nan
    here = np.isfinite(xyz[..., 0])
    frame, marker = np.nonzero(here)
    joints = np.tile(rest[:3], (frames, 1, 1)) + np.linspace(0, 3, frames)[:, None, None] * (1, 0, 0)
    motion = motion_of(xyz, expected, first)
    motion = replace(motion, joints=joints, rotations=np.repeat(motion.rotations, 3, axis=1))
    rows = PointRows(motion.frames, frame, marker, xyz[here], np.full(len(frame), 0.0005))
    return rows, LabelledChunk(Labels(marker, np.full(len(frame), 4), np.ones(len(frame))), motion)


def page_of(tmp_path, rows, chunk, names, said=None, **more) -> str:
    """The text of the page of a take."""
    subject = OverviewSubject(tuple(names), {name: i for i, name in enumerate(names)}, (-1, 0, 1))
    overview = TakeOverview(subject, 100.0, edits=said or Edits())
    overview.add(rows, chunk)
    summary = TakeSummary(names)
    summary.add(chunk)
    report = take_report(summary, more.pop("take", "walk"), more.pop("model", "body26"), 100.0, "1.2.3", {})
    report["points"] = report.pop("blobs")
    report |= more
    for row in report.get("filled", ()):
        overview.fill(row["marker"], row["first"], row["last"])
    trouble = TakeTrouble(subject.markers, 100.0, said or Edits())
    trouble.add(rows, chunk.labels, chunk.motion)
    report |= facts_of_trouble(trouble, chunk.suspects)
    path = tmp_path / "walk.report.html"
    write_take_page(path, report, overview, more.get("source", "walk.c3d"), "2026-11-22")
    return path.read_text(encoding="utf-8")


def test_a_page_says_what_the_report_says(tmp_path):
    rows, chunk = take(80, 5)
    names = ["LASI", "RASI", "SACR", "LKNE", "RKNE"]
    markers = chunk.motion.markers.copy()
    markers[30:34, 3] += (0, 0, 0.4)
    suspect = Suspect(31, 34, "LKNE is far from where the body has it", markers=("LKNE",))
    edits = Edits((AssignPoint(3, "LKNE", frames=(10, 12)), AssignPoint(4, "RKNE")))
    outcomes = EditOutcome("assign", 3), EditOutcome("assign", 0, "it is so already")
    motion = replace(chunk.motion, markers=markers)
    chunk = replace(chunk, motion=motion, suspects=(suspect,), outcomes=outcomes)
    gaps = [{"marker": "LASI", "first": 3, "last": 4, "method": "spline", "expected_mm": 1.25}]
    left = [{"marker": "RASI", "first": 70, "last": 80, "reason": "is longer than 5 frames"}]
    made = {"method": "likelihood", "model_version": 3, "model_fingerprint": "0123abcd"}
    text = page_of(tmp_path, rows, chunk, names, edits, filled=gaps, left=left, notes=["the file has no axis"], **made)
    page = read(text)
    for words in (
        "80 frames (0.8 s), marker set body26 , version 3", "Fingerprint of the marker set 0123abcd", "Frames 31–34",
        "LKNE is far from where the body has it", "The file has no axis", "Frames 1–80",
        "LKNE is trajectory 3, frames 10–12", "it is so already", "1 gap filled by the program, 1 left",
        "It is longer than 5 frames", "likelihood",
        "Mocap Autolabel 1.2.3 on 2026-11-22", "by the program: by likelihood", "walk.c3d",
    ):  # fmt: skip
        assert words in page.words, words
    drawn = list(ElementTree.fromstring(text).iter("svg"))
    svg = next(each for each in drawn if "from the front" in "".join(each.itertext()))
    rings = [each for each in svg.iter("circle") if each.get("class") == "ring"]
    assert len(rings) == 1
    assert "LKNE" in [each.text for each in svg.iter("text")]
    strip = next(each for each in drawn if (each.get("aria-label") or "").startswith("LKNE: "))
    assert {each.get("class") for each in strip.iter("path")} == {"base named", "base doubtful"}
    # Frames 31–34, and on both sides the one from which it jumps there.
    assert [each.get("d") for each in strip.iter("path") if each.get("class") == "base doubtful"] == ["M29 5h6"]


def test_whatever_names_hold_is_text(tmp_path):
    rows, chunk = take(40, 3)
    names = [HOSTILE, HOSTILE + "2", "LKNE"]
    suspects = (Suspect(3, 9, f"{HOSTILE} jumps", markers=(HOSTILE,)),)
    chunk = replace(chunk, suspects=suspects, outcomes=(EditOutcome("assign", 0, HOSTILE),))
    words = dict.fromkeys(("take", "model", "source", "method"), HOSTILE)
    words |= {name: [HOSTILE] for name in ("notes", "camera_doubts", "calibration")}
    gap = {"marker": HOSTILE, "first": 1, "last": 2}
    words |= {"filled": [gap | {"method": HOSTILE, "expected_mm": None}], "left": [gap | {"reason": HOSTILE}]}
    words |= {"edits": {"file": HOSTILE}, "c3d_names": {HOSTILE: HOSTILE}, "steps": {HOSTILE: 2}}
    text = page_of(tmp_path, rows, chunk, names, Edits((AssignPoint(0, HOSTILE),)), **words)
    page = read(text)
    assert "<script" not in text
    assert text.count("alert(") == " ".join(page.said).count("alert(") + sum(
        "".join(map(str, attributes.values())).count("alert(") for _, attributes in page.found
    )
    assert "\x07" not in text
    assert "\\udc80" in text


def test_a_long_take_is_a_small_page_soon(tmp_path):
    rows, chunk = take(20_000, 62)
    names = [f"MARK{index}" for index in range(62)]
    rng = np.random.default_rng(1)
    markers = chunk.motion.markers.copy()
    markers[rng.random(markers.shape[:2]) < 0.02] += 0.2  # doubts all over it
    chunk = replace(chunk, motion=replace(chunk.motion, markers=markers))
    begin = time.process_time()
    text = page_of(tmp_path, rows, chunk, names)
    assert time.process_time() - begin < 6  # 2 s on a machine of its own
    assert len(text) < 1_000_000
    read(text)


def test_a_take_of_one_frame_and_one_without_anybody_have_pages(tmp_path):
    rows, chunk = take(1, 3)
    read(page_of(tmp_path, rows, chunk, ["A", "B", "C"]))
    nothing = np.full_like(chunk.motion.markers, np.nan)
    motion = replace(
        chunk.motion,
        markers=nothing,
        expected=nothing,
        residual=nothing[..., 0],
        joints=np.full_like(chunk.motion.joints, np.nan),
        confidence=np.zeros(1),
    )
    labels = Labels.none(len(rows))
    page = read(page_of(tmp_path, rows, replace(chunk, motion=motion, labels=labels), ["A", "B", "C"]))
    assert "Never found: A, B, C" in page.said


def test_cells_are_what_was_done_to_them(tmp_path):
    rows, chunk = take(10, 2)
    motion, present = chunk.motion, np.isfinite(chunk.motion.markers[..., 0])
    assert present[:4].all()
    residual = motion.residual.copy()
    residual[0, 0] = 0.0  # filled
    residual[1, 0] = 0.0  # placed
    step = np.where((rows.frame == 2) & (chunk.labels.marker == 1), BY_EDIT, chunk.labels.step)
    labels = Labels(chunk.labels.marker, step, chunk.labels.confidence)
    subject = OverviewSubject(("A", "B"), {"A": 0, "B": 1})
    overview = TakeOverview(subject, 100.0, edits=Edits((Place("A", 2, (0.0, 0.0, 1.0)),)))
    overview.add(rows, replace(chunk, labels=labels, motion=replace(motion, residual=residual)))
    cells = overview.cells.values[:4].argmax(axis=2)
    assert cells.tolist() == [[3, 1], [4, 1], [1, 4], [1, 1]]
    assert NO_MARKER not in labels.marker


GOOD = REPORT | {"take": "good", "trouble": []}


def test_the_page_over_a_folder_leads_to_each_take_the_worst_first(tmp_path):
    doubt = {"kind": "missing", "stake": 90.0, "answered": False, "trajectories": []}
    bad = GOOD | {"take": "bad & worse #1", "frames_whole": 0, "trouble": [doubt]}
    hostile = GOOD | {"take": HOSTILE, "filled": [{}], "left": []}
    path = tmp_path / "summary.report.html"
    rows = [row_of(one, one["take"], page=f"{one['take']}.report.html") for one in (GOOD, bad, hostile)]
    rows.append(TakeRow("broken", "broken.c3d", "failed", reason=f"is no take {HOSTILE}"))
    rows.append(TakeRow("a", "a.c3d", "waiting"))
    write_folder_page(path, rows, "2026-11-22")
    page = read(path)
    links = [each["href"] for each in page.of("a")]
    assert links[0] == "./bad%20%26%20worse%20%231.report.html"
    assert sorted(links[1:])[1] == "./good.report.html"
    said = " ".join(page.said)
    assert "3 takes labelled, 1 failed, 1 to come" in said
    assert said.index("broken") < said.index("bad & worse #1") < said.index("good")
    assert is_page(path)
    path.write_text("<html></html>")
    assert not is_page(path)
    assert not is_page(tmp_path / "none.html")


@pytest.mark.parametrize(
    ("share", "said"), [(0, "0 %"), (1, "100 %"), (0.99999, "99.9 %"), (1e-6, "<0.1 %"), (0.5, "50.0 %")]
)
def test_all_and_nothing_are_said_of_all_and_nothing(share, said):
    assert percent(share) == said


def chunk(present: np.ndarray, first: int = 0, suspects=(), labels=(0, -1), conflicts: int = 1) -> LabelledChunk:
    """A chunk in which `present` (F, M) says which markers are in space; residuals are 2 mm and 0.5 px."""
    frames, count = present.shape
    value = np.where(present, 1.0, np.nan)
    marker = np.array(labels)
    motion = motion_of(np.repeat(value[..., None], 3, axis=2), np.zeros((frames, count, 3)), first)
    measured = {"residual": 0.002 * value, "residual_px": 0.5 * value, "conflicts": np.full((frames, count), conflicts)}
    motion = replace(motion, **measured, confidence=np.where(present.any(axis=1), 0.9, 0.0))
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
        facts = whole.of_markers()[name]
        assert (facts["gaps"], facts["longest_gap"]) == (len(gaps), max(gaps, default=0))


OTHERS = [(3, 3, str(number)) for number in range(20)]


@pytest.mark.parametrize(
    ("ranges", "merged"),
    [
        ([(1, 2, "a"), (3, 5, "a")], [(1, 5, "a")]),
        ([(1, 2, "a"), (4, 5, "a")], [(1, 2, "a"), (4, 5, "a")]),
        ([(1, 2, "a"), (3, 5, "b"), (3, 6, "a")], [(1, 6, "a"), (3, 5, "b")]),
        ([(1, 9, "a"), (3, 5, "a")], [(1, 9, "a")]),
        ([(1, 2, "a"), *OTHERS, (3, 5, "a")], [(1, 5, "a"), *OTHERS]),
    ],
)
def test_suspects_that_touch_are_one(ranges, merged):
    summary = TakeSummary(["A"])
    for entry in ranges:
        summary.add(chunk(np.ones((1, 1), bool), suspects=[Suspect(*entry)], labels=()))
    assert [(s.first, s.last, s.reason) for s in summary.suspects] == merged


MARKERS = ("LASI", "RASI", "Bob:LKNE", "a,b")
NAMES = ("", "LASI", "RASI", "Bob:LKNE", '"a,b"', "of another model")


def all_rows_read(before, after) -> dict:
    """The same by every row of both files: what it is to be."""
    index = {"": NO_MARKER, "of another model": NO_MARKER} | {name: number for number, name in enumerate(MARKERS)}
    with LabelFile(before) as old, LabelFile(after) as new:
        both = zip(old.rows(), new.rows(), strict=True)
        table = [(one.frame, index[one.marker], index[other.marker]) for one, other in both]
    frame, was, now = np.array(table).T
    frames, at = np.unique(frame, return_inverse=True)
    found = changes(at, was, now, MARKERS, frames)
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


def test_the_order_of_the_columns_is_each_files_own_and_an_empty_line_is_no_row(tmp_path):
    rng = np.random.default_rng(1)
    header, rows = labels(rng, True)
    turned = [[row[4], row[0], *row[1:4], *row[5:]] for row in rows]
    before = write(tmp_path / "before.csv", "marker,frame,camera,x,y,step,confidence", turned, "\n\n")
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
    assert facts_of_changes(before, after, MARKERS) == {}
