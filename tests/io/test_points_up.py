# SPDX-License-Identifier: GPL-3.0-or-later
"""Which axis of 3D points is up: what a file says, how its points stand, and who knows better."""

import numpy as np
import pytest

from addon.core.data.takes import Points
from addon.io.points import read_points, write_trc
from addon.io.world import SIGNED_AXES, UNSURE_WORDS, find_up, up_rotation
from tests import recorded
from tests.io.c3d_layouts import Layout

RATE = 100.0
NAMES = ("LFHD", "C7", "SACR", "LASI", "LKNE", "RKNE", "LANK", "RANK", "LTOE", "RTOE")
HEIGHTS = (1.65, 1.45, 1.0, 1.0, 0.5, 0.5, 0.1, 0.1, 0.03, 0.03)


def person(walks: bool = True, lies: bool = False, upside_down: bool = False, frames: int = 300) -> np.ndarray:
    """(T, 10, 3) m of somebody who walks along x with feet that stand still by turns, or keeps still."""
    time = np.arange(frames) / RATE
    xyz = np.zeros((frames, len(NAMES), 3))
    xyz[..., 2] = HEIGHTS
    xyz[..., 1] = np.linspace(-0.15, 0.15, len(NAMES)) + 1.0
    if walks:
        xyz[..., 0] = (1.2 * time)[:, None]
        for side in (0, 1):
            phase = time + 0.5 * side
            step = np.floor(phase) + np.clip(2 * (phase % 1) - 1, 0, 1)  # stands for half a second, then swings
            xyz[:, [6 + side, 8 + side], 0] = (1.2 * (step - 0.5 * side))[:, None]
            xyz[:, [6 + side, 8 + side], 2] += (0.1 * np.sin(np.pi * np.clip(2 * (phase % 1) - 1, 0, 1)))[:, None]
    if upside_down:
        xyz[..., 2] = 1.75 - xyz[..., 2]
    if lies:
        xyz = np.stack([1.8 - xyz[..., 2], xyz[..., 1], 0.1 + 0.1 * xyz[..., 0]], axis=2)
    return xyz


def turned(xyz: np.ndarray, up: str) -> np.ndarray:
    """The same in a world in which `up` is up."""
    return xyz @ up_rotation(up)


@pytest.mark.parametrize("up", [axis for axis in SIGNED_AXES if axis not in UNSURE_WORDS])
@pytest.mark.parametrize("pose", [{}, {"walks": False}, {"lies": True}, {"upside_down": True}])
def test_the_word_of_a_file_is_believed_whatever_people_do(up, pose):
    for names in (NAMES, ("",) * len(NAMES)):
        found = find_up(up, turned(person(**pose), up), names)
        if up not in UNSURE_WORDS or not pose.get("upside_down"):
            assert found.axis == up


@pytest.mark.parametrize("word", [axis for axis in SIGNED_AXES if axis not in UNSURE_WORDS])
def test_a_word_that_points_contradict_is_believed_and_that_is_noted(word):
    found = find_up(word, turned(person(), "+Y" if word[1] != "Y" else "+Z"), NAMES)
    assert found.axis == word
    assert f"says that {word} is up, but its points stand along " in found.notes[0]


@pytest.mark.parametrize("word", ["+Y", "-Z", "", "nonsense"])
@pytest.mark.parametrize("up", ["+Z", "+Y"])
@pytest.mark.parametrize("walks", [True, False])
def test_a_word_that_says_little_gives_way_to_how_the_points_stand(word, up, walks):
    for usual in ("+Z", "+Y"):
        found = find_up(word, turned(person(walks), up), ("",) * len(NAMES), usual=usual)
        assert found.axis == up
        assert len(found.notes) == (up != (word if word in SIGNED_AXES else usual))


@pytest.mark.parametrize("usual", ["+Z", "+Y"])
def test_who_lies_does_not_stand(usual):
    assert find_up("", turned(person(walks=False, lies=True), usual), NAMES, usual=usual).axis == usual


def test_arms_spread_out_are_no_height():
    """A T-pose with y up at the origin: as wide as tall, and its width lies on both sides of nought."""
    pose = person(walks=False)
    pose[:, :2, 1], pose[:, 2:4, 1], pose[:, 4:, 1] = 0.8, -0.8, 0.0
    for up in ("+Z", "+Y"):
        assert find_up("", turned(pose, up), NAMES, usual=up).axis == up


def test_nothing_to_look_at_leaves_the_likely():
    nowhere = np.full((50, len(NAMES), 3), np.nan)
    assert (find_up("-Z", nowhere, NAMES).axis, find_up("", nowhere, NAMES, usual="+Y").axis) == ("+Z", "+Y")


def test_minus_z_is_written_where_z_is_up():
    anybody = np.random.default_rng(0).uniform(-0.2, 0.2, (50, 10, 3))
    found = find_up("-Z", anybody, NAMES)
    assert found.axis == "+Z"
    assert "as programs write that" in found.notes[0]
    assert find_up("-Z", turned(person(), "-Z"), NAMES).axis == "-Z"


def test_two_people_side_by_side_are_no_wider_than_one():
    two = np.concatenate([person(walks=False), person(walks=False) + np.array([0, 2.5, 0])], axis=1)
    names = [f"{who}:{name}" for who in ("Ann", "Bob") for name in ("M",) * len(NAMES)]
    assert find_up("+Y", two, names).axis == "+Z"


@pytest.fixture
def upside_down(tmp_path):
    """A C3D that says -Z although z is up."""
    xyz = 1000 * person()
    layout = Layout(frames=len(xyz), points=len(NAMES), up="-Z")
    path = tmp_path / "take.c3d"
    path.write_bytes(layout.content(xyz))
    return path, layout.take()[1] >= 0, xyz / 1000


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_who_knows_better_is_believed(upside_down, tmp_path, up):
    path, there, xyz = upside_down
    axis = ("" if up[0] == "-" else "+") + up.upper()
    take = read_points(path, up=up)
    np.testing.assert_allclose(take.xyz[there], (xyz @ up_rotation(axis).T)[there], atol=1e-5)
    assert (take.up, take.notes) == (axis, ())
    write_trc(tmp_path / "a.trc", Points(NAMES, xyz, np.zeros(xyz.shape[:2]), RATE, 1))
    np.testing.assert_allclose(read_points(tmp_path / "a.trc", up=up).xyz, xyz @ up_rotation(axis).T, atol=1e-5)


def test_recorded_people_keep_the_axis_that_they_have(shared_data):
    """All C3D and TRC of the people and rooms: those with y up are known by name, all others have z up."""
    y_up = {"freeform.c3d", "squat.c3d", "walk_free_01.trc"}
    folders = (*recorded.MCGILL, *recorded.ACTORS, recorded.PLATES, recorded.TENNIS, recorded.GAPS, *recorded.IN_ROOMS)
    for path in recorded.takes(shared_data, *folders):
        take = read_points(path)
        assert take.up == ("+Y" if path.name in y_up else "+Z"), path.name
        assert bool(take.notes) == (path.name in y_up and path.suffix == ".c3d"), (path.name, take.notes)


def test_recorded_takes_that_say_minus_z_are_not_turned_upside_down(shared_data):
    qualisys = shared_data / "blobs" / "qualisys_run" / "run.c3d"
    for path in (qualisys, *recorded.takes(shared_data, *recorded.MCGILL, *recorded.ACTORS, recorded.PLATES)):
        take = read_points(path)
        assert find_up("-Z", take.xyz, take.names).axis == "+Z", path.name
