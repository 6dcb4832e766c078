# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels and truth: the input's own text in front, and back again; and what was filled, told from what was measured."""

import csv

import ezc3d
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.data.errors import InputError
from addon.core.data.takes import CONFLICT, EXCLUSIVE, NO_MARKER, NO_STEP, Labels, Points
from addon.core.filling.filling import FilledGap
from addon.core.filling.gaps import Gap
from addon.io.filled import gap_rows, write_filled
from addon.io.labels import BLOB_KEYS, POINT_KEYS, LabelFile, LabelWriter, TruthWriter
from addon.io.points import read_points, write_c3d

MARKERS = ("LASI", "=1+1", 'odd "name", really')


def read(path):
    with LabelFile(path) as file:
        return file.keys, list(file.rows())


def labels(marker, step, confidence) -> Labels:
    return Labels(np.array(marker), np.array(step), np.array(confidence, dtype=float))


def test_rows_are_as_the_contract_says(tmp_path):
    path = tmp_path / "take.labels.csv"
    with LabelWriter(path, MARKERS) as writer:
        writer.write(["1,cam_1,2.50,3", "1,cam_2,2,3"], labels([1, NO_MARKER], [CONFLICT, NO_STEP], [0.98765, 0]))
        writer.write(['2,"a,b",1,1'], labels([0], [EXCLUSIVE], [1.0]))
    assert path.read_text(encoding="utf-8") == (
        "frame,camera,x,y,marker,step,confidence\n1,cam_1,2.50,3,'=1+1,conflict,0.988\n1,cam_2,2,3,,,0\n"
        '2,"a,b",1,1,LASI,exclusive,1\n'
    )


@given(
    st.lists(
        st.tuples(
            st.integers(-9, 999),
            st.sampled_from(["cam", 'x,"y', "Süd"]),
            st.integers(-1, 2),
            st.integers(1, 3),
            st.integers(0, 1000),
        ),
        min_size=1,
        max_size=30,
    ).map(sorted)
)
def test_labels_come_back(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("labels") / "take.labels.csv"
    keys = [f"{frame},{camera},1.5,-2".replace('x,"y', '"x,""y"') for frame, camera, *_ in rows]
    marker = [row[2] for row in rows]
    step = [row[3] if row[2] >= 0 else NO_STEP for row in rows]
    confidence = [row[4] / 1000 if row[2] >= 0 else 0 for row in rows]
    with LabelWriter(path, MARKERS) as writer:
        writer.write(keys, labels(marker, step, confidence))
    columns, found = read(path)
    assert columns == BLOB_KEYS
    assert [row.line for row in found] == list(range(2, len(rows) + 2))
    assert [(row.frame, row.key) for row in found] == [(frame, (camera, 1.5, -2.0)) for frame, camera, *_ in rows]
    assert [row.marker for row in found] == ["" if index < 0 else MARKERS[index] for index in marker]
    words = ("", "exclusive", "conflict", "remaining")
    assert [row.step for row in found] == [words[index] for index in step]
    np.testing.assert_allclose([row.confidence for row in found], confidence, atol=1e-9)


def test_truth_of_blobs_and_of_points_keeps_merged_names(tmp_path):
    with TruthWriter(tmp_path / "a.csv") as writer:
        writer.write(["1,c,2,3", "1,c,2,4", "1,c,2,5"], ["LASI|RASI", "", "=1+1"])
    _, rows = read(tmp_path / "a.csv")
    assert [row.marker for row in rows] == ["LASI|RASI", "", "=1+1"]
    assert (tmp_path / "a.csv").read_text().endswith(",'=1+1\n")
    assert np.isnan([row.confidence for row in rows]).all()
    with TruthWriter(tmp_path / "b.csv", POINT_KEYS) as writer:
        writer.write(["1,0", "1,7"], ["LASI", "RASI"])
    columns, rows = read(tmp_path / "b.csv")
    assert (columns, [row.key for row in rows]) == (POINT_KEYS, [(0,), (7,)])


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("frame,camera,x,y\n", 1, "no column marker"),
        ("frame,marker\n", 1, "no column point"),
        ("frame,point,marker\n2,2,A\n1,2,A\n", 3, "goes back"),
        ("", 0, "is empty"),
        ("frame,point,marker\n1,2,A\n1,2\n", 3, "2 fields; expected 3"),
        ("frame,point,marker\nx,2,A\n", 2, "frame 'x'"),
        ("frame,camera,x,y,marker\n1,a,2,nan,A\n", 2, "key that is no number"),
        ("frame,point,marker,confidence\n1,2,A,1.5\n", 2, "confidence '1.5'"),
        ("frame,point,marker\n1,2,\0\n", 2, "binary"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(tmp_path, text, line, words):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read(tmp_path / "a.csv")
    assert caught.value.line == line


def test_residuals_tell_filled_measured_and_missing_samples_unless_all_are_zero(tmp_path):
    xyz = np.random.default_rng(0).uniform(0.1, 1, (1, 6, 3))
    xyz[0, 5] = np.nan
    residual = np.array([[0.0, np.nan, 1e-6, 0.0005, 1.0, np.nan]])
    path = tmp_path / "a.c3d"
    write_c3d(path, Points(tuple("ABCDEF"), xyz, residual, 100.0, 1))
    found = ezc3d.c3d(str(path))["data"]["meta_points"]["residuals"][0, :, 0]
    np.testing.assert_allclose(found, [0, 0.1, 0.05, 0.5, 6.35, -1], atol=1e-6)
    np.testing.assert_allclose(read_points(path).residual[0, :5], [0, 1e-4, 5e-5, 5e-4, 0.01275], atol=1e-8)
    path = tmp_path / "a.c3d"
    write_c3d(path, Points(("A", "B"), np.ones((3, 2, 3)), np.zeros((3, 2)), 100.0, 1))
    take = read_points(path)
    assert np.isnan(take.residual).all()
    write_c3d(tmp_path / "b.c3d", take)
    np.testing.assert_allclose(read_points(tmp_path / "b.c3d").residual, 1e-4, atol=1e-9)


def test_the_table_has_a_row_a_gap_by_the_sources_frames(tmp_path):
    gaps = [FilledGap(Gap(4, 9, 1), "regression", 0.00213), FilledGap(Gap(0, 1, 0), "rigid", np.nan, (False, True))]
    write_filled(tmp_path / "a.filled.csv", gap_rows(gaps, ["=A", 'B,"x"'], 101))
    assert [row["rests_on"] for row in gap_rows(gaps, ["A", "B"], 101)] == ["both ends", "its end"]
    with (tmp_path / "a.filled.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows == [
        ["marker", "first", "last", "method", "expected_mm"],
        ['B,"x"', "105", "109", "regression", "2.13"],
        ["'=A", "101", "101", "rigid", ""],
    ]
