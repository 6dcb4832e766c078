# SPDX-License-Identifier: GPL-3.0-or-later
"""Blob files, labels and truth: what is read is what is there, in its own text; what is wrong has a line."""

import csv
import re
from itertools import pairwise

import ezc3d
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.data.errors import InputError
from addon.core.data.takes import CONFLICT, EXCLUSIVE, NO_MARKER, NO_STEP, Blobs, Labels, Points
from addon.core.filling.filling import FilledGap
from addon.core.filling.gaps import Gap
from addon.io import blobs as blob_files
from addon.io.blobs import BlobWriter, read_blobs, write_blobs
from addon.io.filled import gap_rows, write_filled
from addon.io.labels import BLOB_KEYS, POINT_KEYS, LabelFile, LabelWriter, TruthWriter
from addon.io.points import read_points, write_c3d
from addon.io.rows import parse_lines, parse_plain, read_header
from tests.io.checks import memory_within, refused
from tests.io.samples import BLOBS, ring

CAMERAS = ring()


def read(path, text, cameras=CAMERAS, **options):
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return list(read_blobs(path, cameras, **options))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "take.csv"


def test_rows_frames_and_keys_are_those_of_the_file_whatever_the_order_of_its_columns(path):
    (rows,) = read(path, BLOBS)
    assert rows.blobs.frames.tolist() == [7, 8, 9, 10, 11]
    assert np.bincount(rows.blobs.frame, minlength=5).tolist() == [4, 8, 0, 4, 4]
    assert rows.keys == [line.rsplit(",", 1)[0] for line in BLOBS.splitlines()[1:]]
    assert rows.blobs.camera[:4].tolist() == [0, 1, 2, 0]
    assert rows.blobs.xy[1].tolist() == [107.25, -2.5]
    assert np.isnan(rows.blobs.area[0])
    assert rows.blobs.area[1] == 12.5
    assert rows.fraction == 1
    text = 'note,Y,x,camera,"frame"\nhi,2.50,1,cam_2,5\n,3,+1.0e1, cam_3 ,6.0\n'
    (rows,) = read(path, text)
    assert rows.blobs.xy.tolist() == [[1, 2.5], [10, 3]]
    assert rows.blobs.camera.tolist() == [1, 2]
    assert rows.blobs.frames.tolist() == [5, 6]
    assert rows.keys == ["5,cam_2,1,2.50", "6.0, cam_3 ,+1.0e1,3"]
    assert np.isnan(rows.blobs.area).all()


@pytest.mark.parametrize(
    "names", [("a,b", 'say "hi"', "c"), ("Kamera Süd", "カメラ", "x" * 30), ("=1+1", "-A", "'@SUM")]
)
def test_names_that_need_quotes_or_look_like_formulas_keep_their_own_text(path, names):
    cameras = ring(3, names=names)
    blobs = Blobs(np.array([1]), np.zeros(3, int), np.arange(3), np.ones((3, 2)), np.full(3, np.nan))
    keys = write_blobs(path, blobs, cameras)
    (rows,) = read_blobs(path, cameras)
    assert rows.blobs.camera.tolist() == [0, 1, 2]
    assert rows.keys == keys == path.read_text(encoding="utf-8").splitlines()[1:]
    assert not [key for key in keys if re.match("1,[=+@-]", key)], "no table takes a name for a formula"


@pytest.mark.parametrize(
    "change", [lambda t: t.replace("\n", "\r\n"), lambda t: "\ufeff" + t, lambda t: t.rstrip() + "\n\n\n"]
)
def test_line_ends_marks_and_empty_lines_change_nothing(path, change):
    (plain,) = read(path, BLOBS)
    (other,) = read(path, change(BLOBS))
    assert other.keys == plain.keys
    np.testing.assert_array_equal(other.blobs.xy, plain.blobs.xy)


def test_a_range_of_frames_keeps_both_ends(path):
    (rows,) = read(path, BLOBS, frames=(8, 10))
    assert rows.blobs.frames.tolist() == [8, 9, 10]
    assert len(rows.keys) == 12
    (rest,) = read(path, BLOBS, frames=(10, None))
    assert rest.blobs.frames.tolist() == [10, 11]
    refused("no blobs in frames 100:", read, path, BLOBS, frames=(100, None))


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("1,cam_1,2,3\n", 1, "no header"),
        ("frame,camera,x\n1,cam_1,2\n", 1, "no column y"),
        ("frame,camera,x,y,x\n", 1, "twice"),
        ("frame,camera,x,y\n1,cam_1,2,3\n1,nobody,2,3\n", 3, "'nobody' is not in the calibration.*cam_1"),
        ("frame,camera,x,y\n1,cam_1,nan,3\n", 2, "x is 'nan'"),
        ("frame,camera,x,y\n1,cam_1,2,inf\n", 2, "y is 'inf'"),
        ("frame,camera,x,y\n1,cam_1,2,1_0\n", 2, "y is '1_0'"),
        ("frame,camera,x,y\n1,cam_1,2,1e300\n", 2, "no image"),
        ("frame,camera,x,y\n1.5,cam_1,2,1\n", 2, "whole number"),
        ("frame,camera,x,y\n1e30,cam_1,2,1\n", 2, "whole number"),
        ("frame,camera,x,y\n4294967296,cam_1,2,1\n", 2, "whole number up to 4294967295"),
        ("frame,camera,x,y\n,cam_1,2,1\n", 2, "frame is ''"),
        ("frame,camera,x,y\n1,cam_1,2,\u0661\n", 2, "y is '\u0661'"),
        ("frame,camera,x,y\n" + "1,cam_1,2,3\n" * 500 + "1,cam_1,2,\0\n", 502, "no text"),
        ("frame,camera,x,y\n1,cam_1,2,3\n1,cam_1,2\n", 3, "3 fields; expected 4"),
        ("frame,camera,x,y\n1,cam_1,2,3\n2,cam_1,7", 3, "3 fields; expected 4.*cut off"),
        ("frame,camera,x,y\n5,cam_1,2,3\n4,cam_1,2,3\n", 3, "goes back from frame 5 to 4"),
        ("frame,camera,x,y\n5,cam_1,2,3\n9000000,cam_1,2,3\n", 3, "leaps from frame 5 .*at most 100000 without"),
        ('frame,camera,x,y\n5,"cam_1,2,3\n', 2, "quote"),
        ("frame,camera,x,y,area\n5,cam_1,2,3,-4\n", 2, "area is -4"),
        ("frame,camera,x,y\n" + 2 * "5,cam_1,2,3\n" + 2 * "7,cam_1,2,3\n", 0, "every blob of frames 5:7 twice"),
        ("frame,camera,x,y\n", 0, "has no blobs"),
        ("", 0, "is empty"),
        ("frame;camera;x;y\n1;cam_1;2;3\n", 1, "semicolons"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(path, text, line, words):
    refused(words, read, path, text, line=line)


def test_lines_are_counted_over_blocks(path, monkeypatch):
    monkeypatch.setattr(blob_files, "BLOCK_BYTES", 256)
    text = "frame,camera,x,y\n" + "".join(f"{n // 3},cam_1,{n},1\n" for n in range(500))
    chunks = read(path, text, chunk_frames=16)
    assert np.concatenate([c.blobs.frames for c in chunks]).tolist() == list(range(167))
    assert [key for c in chunks for key in c.keys] == text.splitlines()[1:]
    assert [len(c.blobs.frames) for c in chunks] == [16] * 10 + [7]
    assert all(a.fraction <= b.fraction for a, b in pairwise(chunks))
    with pytest.raises(InputError) as caught:
        read(path, text + "3,cam_1,1,1\n")
    assert caught.value.line == 502


def test_a_frame_of_very_many_ghosts_is_one_frame(path, monkeypatch):
    monkeypatch.setattr(blob_files, "CHUNK_ROWS", 50)
    counts = [3, 120, 40, 1, 60, 5]
    text = "frame,camera,x,y\n" + "".join(f"{f},cam_1,{n},1\n" for f, count in enumerate(counts) for n in range(count))
    chunks = read(path, text)
    found = [np.bincount(c.blobs.frame, minlength=len(c.blobs.frames)).tolist() for c in chunks]
    assert found == [[3], [120], [40, 1], [60], [5]]


def test_memory_does_not_grow_with_the_take(path, monkeypatch):
    monkeypatch.setattr(blob_files, "BLOCK_BYTES", 1 << 18)
    rng, index = np.random.default_rng(0), np.repeat(np.arange(500), 40)
    with BlobWriter(path, CAMERAS) as writer:
        for start in range(0, 6000, 500):
            seen = index, index % 4, rng.uniform(0, 600, (len(index), 2)), rng.uniform(1, 9, len(index))
            writer.write(Blobs(np.arange(start, start + 500), *seen))
    with memory_within(8e6):  # all of it is 25 MB and more
        assert sum(len(rows.blobs) for rows in read_blobs(path, CAMERAS)) == 240_000


FIELD = st.one_of(
    st.integers(-2000, 2000).map(str),
    st.floats(-2000, 2000).map(lambda value: f"{value:.3f}"),
    st.floats(-2000, 2000).map(repr),
    st.sampled_from(["", "-", ".", "1.", ".5", "-.5", "1..2", "00012", "1e2", "12345678901234567", "nan", " 7", "+3"]),
    st.sampled_from(["1-2", "9" * 19]),
)
CAMERA = st.sampled_from(["cam_1", "cam_4", "cam_9", "", " cam_2"])
LINE = st.tuples(st.sampled_from(["3", "4", "5", "x"]), CAMERA, FIELD, FIELD, FIELD)


@given(st.lists(LINE, min_size=1, max_size=6), st.sampled_from(["frame,camera,x,y,area", "frame,camera,x,y,note"]))
def test_the_fast_way_says_what_the_careful_way_says_or_steps_aside(lines, head):
    header, _ = read_header((head + "\n").encode(), "take.csv")
    block = "".join(",".join(fields) + "\n" for fields in lines).encode()
    fast = parse_plain(block, header, CAMERAS, 2)
    if fast is None:
        return
    slow = parse_lines(block, header, CAMERAS, "take.csv", 2)
    for name in ("frame", "camera", "lines"):
        np.testing.assert_array_equal(getattr(fast, name), getattr(slow, name))
    np.testing.assert_allclose(fast.xy, slow.xy, rtol=3e-16)
    np.testing.assert_allclose(fast.area, slow.area, rtol=3e-16)
    assert fast.keys == slow.keys


@given(
    st.lists(
        st.tuples(st.integers(-5, 40), st.integers(0, 3), st.integers(-(10**8), 10**9), st.integers(0, 10**6)),
        min_size=1,
        max_size=60,
        unique=True,
    ),
    st.booleans(),
    st.integers(1, 50),
)
def test_what_is_written_is_read(tmp_path_factory, rows, area, chunk_frames):
    rows = sorted(rows, key=lambda row: row[0])
    frame, camera, x, y = (np.array(column) for column in zip(*rows, strict=True))
    frames = np.arange(frame[0], frame[-1] + 1)
    xy = np.stack([x / 1000 % 1e6, y / 1000], axis=1)
    size = np.round(np.abs(y) / 100 % 90, 1) if area else np.full(len(y), np.nan)
    blobs = Blobs(frames, frame - frame[0], camera, xy, size)
    path = tmp_path_factory.mktemp("blobs") / "take.csv"
    with BlobWriter(path, CAMERAS, area) as writer:
        keys = writer.write(blobs)
    chunks = list(read_blobs(path, CAMERAS, chunk_frames=chunk_frames))
    assert [key for chunk in chunks for key in chunk.keys] == keys
    np.testing.assert_array_equal(np.concatenate([c.blobs.frames for c in chunks]), frames)
    np.testing.assert_array_equal(np.concatenate([c.blobs.frames[c.blobs.frame] for c in chunks]), frame)
    np.testing.assert_array_equal(np.concatenate([c.blobs.camera for c in chunks]), camera)
    np.testing.assert_allclose(np.concatenate([c.blobs.xy for c in chunks]), xy, atol=1e-6)
    np.testing.assert_allclose(np.concatenate([c.blobs.area for c in chunks]), size, rtol=1e-3)


def sparse(*frames: int) -> str:
    return "frame,camera,x,y\n" + "".join(f"{frame},cam_1,2,3\n" for frame in frames)


def test_gaps_are_bounded_together_and_only_within_the_frames_that_are_wanted(path):
    with pytest.raises(InputError, match=r"take\.csv:4: leaps from frame 99999 to 199998, .* 3 with some; expected"):
        read(path, sparse(*range(0, 900_000, 99_999)))
    (rows,) = read(path, sparse(1, 5_000_000, 5_000_002, 9_000_000), frames=(5_000_000, 5_000_010))
    assert rows.blobs.frames.tolist() == [5_000_000, 5_000_001, 5_000_002]


MARKERS = ("LASI", "=1+1", 'odd "name", really')


def read_labels(path):
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
    columns, found = read_labels(path)
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
    _, rows = read_labels(tmp_path / "a.csv")
    assert [row.marker for row in rows] == ["LASI|RASI", "", "=1+1"]
    assert (tmp_path / "a.csv").read_text().endswith(",'=1+1\n")
    assert np.isnan([row.confidence for row in rows]).all()
    with TruthWriter(tmp_path / "b.csv", POINT_KEYS) as writer:
        writer.write(["1,0", "1,7"], ["LASI", "RASI"])
    columns, rows = read_labels(tmp_path / "b.csv")
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
def test_what_is_wrong_with_labels_is_told_with_its_line(tmp_path, text, line, words):
    (tmp_path / "a.csv").write_text(text)
    refused(words, read_labels, tmp_path / "a.csv", line=line)


def test_residuals_tell_filled_measured_and_missing_samples_unless_all_are_zero(tmp_path):
    xyz = np.random.default_rng(0).uniform(0.1, 1, (1, 6, 3))
    xyz[0, 5] = np.nan
    residual = np.array([[0.0, np.nan, 1e-6, 0.0005, 1.0, np.nan]])
    path = tmp_path / "a.c3d"
    write_c3d(path, Points(tuple("ABCDEF"), xyz, residual, 100.0, 1))
    found = ezc3d.c3d(str(path))["data"]["meta_points"]["residuals"][0, :, 0]
    np.testing.assert_allclose(found, [0, 0.1, 0.05, 0.5, 6.35, -1], atol=1e-6)
    np.testing.assert_allclose(read_points(path).residual[0, :5], [0, 1e-4, 5e-5, 5e-4, 0.01275], atol=1e-8)
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
