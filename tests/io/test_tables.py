# SPDX-License-Identifier: GPL-3.0-or-later
"""The poses of a long take and other tables on disk, as arrays are; and the point caches that play them."""

import re
from contextlib import ExitStack

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from addon.core.data.errors import JobError
from addon.core.data.takes import Motion
from addon.io import poses as pose_files
from addon.io.poses import PC2_HEADER, PoseFile, cache_mark, check_cache, write_cache
from addon.io.tables import FileTable, Room
from tests.io.checks import refused

MARKERS, JOINTS = 4, 3


def motion_of(first, last):
    """Frames whose joints say their number; the body is found from frame 20 on."""
    frames = np.arange(first, last)
    joints = np.broadcast_to(frames[:, None, None], (len(frames), JOINTS, 3)).astype(float)
    expected = np.where((frames >= 20)[:, None, None], np.tile(frames[:, None, None], (1, MARKERS, 3)), np.nan)
    none = np.zeros((len(frames), MARKERS))
    turns = np.tile(np.eye(3), (len(frames), JOINTS, 1, 1))
    size = np.ones((len(frames), 3))
    return Motion(frames, expected, none, none, none, expected, joints, turns, size, np.ones(len(frames)))


@pytest.mark.parametrize("chunk", [1, 9, 50, 1000])
def test_poses_come_back_and_the_sample_is_evenly_spaced(tmp_path, chunk, monkeypatch):
    monkeypatch.setattr(pose_files, "SAMPLED_FRAMES", 32)
    with PoseFile(tmp_path) as poses:
        for start in range(11, 311, chunk):
            poses.append(motion_of(start, min(start + chunk, 311)))
        assert (poses.frames, poses.first_frame) == (300, 11)
        parts = [(part, *pose) for part, _, *pose in poses.parts(64)]
        np.testing.assert_array_equal(np.concatenate([joints for _, joints, _ in parts])[:, 0, 0], np.arange(11, 311))
        assert [part.stop - part.start for part, _, _ in parts] == [64, 64, 64, 64, 44]
        frames = poses.sampled().frames
        assert 16 <= len(frames) <= 32
        assert len(set(np.diff(frames).tolist())) == 1
        np.testing.assert_array_equal(poses.expected, 20.0)


@pytest.mark.parametrize(("fraction", "long"), [(0.4, False), (0.04, True), (1.0, False)])
def test_a_long_take_is_foreseen_from_what_was_read(tmp_path, fraction, long, monkeypatch):
    keys = 3 * MARKERS + 7 * JOINTS
    monkeypatch.setattr(pose_files, "MOST_KEYS", 1000 * keys)
    monkeypatch.setattr(pose_files, "FORESEEN_FROM", 100)
    with PoseFile(tmp_path) as poses:
        poses.append(motion_of(0, 99), fraction)
        assert not poses.long
        poses.append(motion_of(99, 101), fraction)
        assert poses.long == long


FRAMES, VERTICES = 40, 3


@pytest.fixture
def known():
    """(F, V, 3) frames with gaps at both ends, in the middle and between, and a vertex that is never known."""
    frames = np.random.default_rng(5).normal(size=(FRAMES, VERTICES, 3))
    frames[:7, 0] = frames[33:, 0] = frames[10:30, 0] = np.nan
    frames[::2, 1, 0] = np.nan
    frames[:, 2] = np.nan
    return frames


@pytest.mark.parametrize("part", [1, 3, 7, 64])
def test_gaps_are_straight_lines_whatever_the_parts(tmp_path, monkeypatch, known, part):
    monkeypatch.setattr(pose_files, "PART_BYTES", part * 12 * VERTICES)
    path, absent = tmp_path / "walk.pc2", np.arange(9.0).reshape(3, 3)
    write_cache(path, (known[start : start + 11] for start in range(0, FRAMES, 11)), absent)
    data = path.read_bytes()
    assert PC2_HEADER.unpack(data[: PC2_HEADER.size]) == (b"POINTCACHE2\0", 1, VERTICES, 0.0, 1.0, FRAMES)
    found = np.frombuffer(data[PC2_HEADER.size :], "<f4").reshape(known.shape)
    there, at = np.isfinite(known), np.arange(FRAMES)
    np.testing.assert_array_equal(found[there], known[there].astype(np.float32))
    for column in np.ndindex(VERTICES, 3):
        seen, values = there[:, *column], known[:, *column]
        lines = np.interp(at, at[seen], values[seen]) if seen.any() else absent[column]
        np.testing.assert_allclose(found[:, *column], lines, rtol=1e-6)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda path: path.unlink(), "is not there"),
        (lambda path: path.write_bytes(path.read_bytes()[:-4]), "is shorter than it was saved"),
        (lambda path: path.write_bytes(b"Something else altogether" * 99), "is no point cache"),
        (lambda path: path.write_bytes(path.read_bytes()[:-4] + b"1234"), "is of another take"),
        (lambda path: path.write_bytes(path.read_bytes() + b"1234"), "is of another take"),
    ],
)
def test_another_file_is_told(tmp_path, known, spoil, words):
    path = tmp_path / "walk.pc2"
    write_cache(path, iter([known]), np.zeros((3, 3)))
    mark = cache_mark(path)
    check_cache(path, mark)
    spoil(path)
    refused(re.escape(words), check_cache, path, mark)


SHAPE = 7, 3, 2
WANTED = st.one_of(
    st.slices(SHAPE[0]).filter(lambda part: part.step is None or part.step > 0),
    arrays(int, st.integers(0, 5), elements=st.integers(0, SHAPE[0] - 1), unique=True),
    arrays(bool, SHAPE[0]),
    st.just((np.array([4, 2, 5]), np.array([0, 2, 1]))),  # by frame and lane
)


@settings(max_examples=60)
@given(st.lists(st.tuples(WANTED, st.integers(-9, 9)), max_size=4), WANTED)
def test_a_table_on_disk_is_as_an_array(tmp_path_factory, written, wanted):
    array, table = np.zeros(SHAPE), FileTable(tmp_path_factory.mktemp("room") / "table", SHAPE, float)
    for index, value in written:
        array[index] = table[index] = value
    np.testing.assert_array_equal(table[wanted], array[wanted])
    np.testing.assert_array_equal(np.asarray(table), array)
    assert (len(table), table.size, table.ndim) == (7, 42, 3)


def test_only_large_tables_are_on_disk_and_go_with_the_job_and_a_folder_without_room_is_said(tmp_path):
    with ExitStack() as stack:
        room = Room(stack, min_bytes=1000)
        assert isinstance(room((10, 12), np.float64), np.ndarray)
        assert room.folder is None
        large = room((10, 13), np.float64)
        assert large.path.exists()
        assert not large[2:5].any()
    assert not large.path.parent.exists()
    with pytest.raises(JobError, match="cannot hold temporary files"):
        FileTable(tmp_path / "gone" / "table", SHAPE, float)
