# SPDX-License-Identifier: GPL-3.0-or-later
"""The poses of a long take: all of them on disk, some evenly spaced ones in memory."""

import numpy as np
import pytest

from addon.core.data.errors import JobError
from addon.core.data.takes import Motion
from addon.io import poses as pose_files
from addon.io.markersets import open_markerset
from addon.io.poses import PoseFile, is_long, refuse_keys

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
        parts = list(poses.parts(64))
        np.testing.assert_array_equal(np.concatenate([joints for _, joints, _ in parts])[:, 0, 0], np.arange(11, 311))
        assert [part.stop - part.start for part, _, _ in parts] == [64, 64, 64, 64, 44]
        frames = poses.sampled().frames
        assert 16 <= len(frames) <= 32
        assert len(set(np.diff(frames).tolist())) == 1
        np.testing.assert_array_equal(poses.expected, 20.0)


def test_a_take_is_long_by_its_keys(monkeypatch):
    monkeypatch.setattr(pose_files, "MOST_KEYS", 1000)
    assert not is_long(10, 10, 10)
    assert is_long(11, 10, 10)


def test_what_fills_a_scene_is_refused_with_the_frames_that_it_has_room_for(monkeypatch):
    worn = open_markerset("gait15")
    keys = 3 * len(worn) + 7 * len(worn.skeleton)
    monkeypatch.setattr(pose_files, "MOST_SHOWN", 10 * keys)
    monkeypatch.setattr(pose_files, "FORESEEN_FROM", 5)
    refuse_keys(10, worn)
    refuse_keys(4, worn, 0.1)  # too few to foresee anything
    refuse_keys(5, worn, 0.25)
    with pytest.raises(JobError, match=r"has 11 frames, whose keys .*; expected at most 10: choose a part") as caught:
        refuse_keys(11, worn)
    assert "Label Folder" in caught.value.message
    with pytest.raises(JobError, match="has 12 frames"):
        refuse_keys(5, worn, 0.2)


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
