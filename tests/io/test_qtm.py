# SPDX-License-Identifier: GPL-3.0-or-later
"""Qualisys captures: a real one against what is known of it otherwise, small ones made here, and broken ones."""

import struct
import time
from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pytest
from lzallright import LZOCompressor

from addon.core.data.takes import Blobs
from addon.io.blobs import frames_in, read_blobs, write_blobs
from addon.io.cameras import read_cameras
from addon.io.points import holds_points, read_points, write_c3d
from addon.io.qtm import records
from addon.io.qtm.capture import held_in

from .checks import memory_within, refused
from .qtm_file import (
    EDITED,
    FILLED,
    MEASURED,
    Recording,
    Trajectory,
    compound_file,
    packed_series,
    streams,
    unpacked_series,
    write_qtm,
)
from .samples import ring

NAMES = ("101", "102", "103", "104")
FIRST, LAST = 5, 64


def rig():
    """Four cameras with lenses of the kind that captures have, and numbers as they store them."""
    cameras = ring(4, (-0.1, 0.05, 0.001, -0.002, 0.0), NAMES)
    stored = (64 * cameras.matrix).astype(np.float32).astype(float) / 64
    stored[:, 2] = (0, 0, 1)
    lens = cameras.distortion.astype(np.float32).astype(float)
    return replace(cameras, matrix=stored, distortion=lens, size=np.tile([656, 492], (4, 1)))


def sightings(seed: int = 0, frames: int = LAST - FIRST + 1) -> Blobs:
    """Blobs at 64ths of a pixel; the last frame has one, and some have none."""
    chance = np.random.default_rng(seed)
    frame = np.sort(chance.integers(0, frames, 40 * frames // 4))
    frame = np.append(frame[frame % 7 != 3], frames - 1)
    camera = chance.integers(0, 4, len(frame))
    xy = np.round(64 * chance.uniform(0, 480, (len(frame), 2))) / 64
    order = np.lexsort((camera, frame))  # the order of the file, within a camera as they come
    return Blobs(FIRST + np.arange(frames), frame[order], camera[order], xy[order], chance.uniform(1, 90, len(frame)))


def trajectories() -> list[Trajectory]:
    walk = [(100.0 + frame, -20.0, 900.5, 0.25 + frame / 1000, MEASURED) for frame in range(LAST - FIRST + 1)]
    walk[7] = (*walk[7][:3], 0.0, FILLED)
    walk[8] = (*walk[8][:3], 0.0, FILLED | EDITED)
    walk[9] = (*walk[9][:3], 0.0, MEASURED)
    pieces = [(10.0 * at, 5.0, 300.0, 1.5, MEASURED) for at in range(5)]
    return [
        Trajectory("", [(FIRST + 1, FIRST + 3), (FIRST + 10, FIRST + 11)], pieces),
        Trajectory("LASI", [(FIRST, LAST)], walk),
        Trajectory("Zehe £", [(FIRST, FIRST)], [(1.0, 2.0, 3.0, 0.5, MEASURED)]),
        Trajectory("LASI", [(FIRST, FIRST + 1)], [(1.0, 2.0, 3.0, 0.5, MEASURED)] * 2, discarded=True),
    ]


def recording(**other) -> Recording:
    return Recording(**({"cameras": rig(), "blobs": sightings(), "trajectories": trajectories()} | other))


@pytest.fixture
def take(tmp_path) -> Path:
    return write_qtm(tmp_path / "take.qtm", recording())


def all_blobs(path, cameras, **how) -> tuple[Blobs, list[str]]:
    parts = list(read_blobs(path, cameras, **how))
    return Blobs.join(part.blobs for part in parts), [key for part in parts for key in part.keys]


def test_the_real_cameras_blobs_and_points_are_those_of_the_other_files(shared_data, tmp_path):
    real = shared_data / "blobs" / "qualisys_run"
    ours, known = read_cameras(real / "demo.qtm"), read_cameras(real / "room.toml")
    assert ours.names == known.names
    for name in ("size", "matrix", "distortion", "rotation", "translation"):
        np.testing.assert_allclose(getattr(ours, name), getattr(known, name), atol=1e-12)
    [remark] = ours.remarks
    assert "15478 is not calibrated" in remark and "14807 recorded no blobs" in remark and "14737 rec" in remark
    cameras = read_cameras(real / "room.toml")
    begin = time.process_time()
    ours, keys = all_blobs(real / "demo.qtm", cameras)
    assert time.process_time() - begin < 8
    theirs, known = all_blobs(real / "run.csv", cameras)
    assert len(ours) == 254_071
    assert keys == known
    np.testing.assert_array_equal(ours.frames, theirs.frames)
    np.testing.assert_allclose(ours.area, theirs.area, atol=0.0051)
    assert frames_in(real / "demo.qtm", cameras) == (1, 1000)
    ours, known = read_points(real / "demo.qtm"), read_points(real / "run.c3d")
    assert (ours.rate, ours.first_frame, ours.up, len(ours.names)) == (100.0, 1, "+Z", 89)
    named = ours.picked([ours.names.index(name) for name in known.names])
    np.testing.assert_allclose(named.xyz, known.xyz, atol=1e-6)
    filled = dict(zip(known.names, (named.residual == 0).sum(axis=0).tolist(), strict=True))
    assert {name: count for name, count in filled.items() if count} == {"L_IAS": 796, "L_HME": 9}
    assert {name for name in ours.names if name} - set(known.names) == {f"L-frame - {at}" for at in (1, 2, 3, 4)}
    write_c3d(tmp_path / "demo.c3d", ours, ours.trial)
    head = ezc3d.c3d(str(tmp_path / "demo.c3d"))["header"]["points"]
    assert (head["frame_rate"], head["first_frame"], head["last_frame"]) == (100, 0, 999)  # ezc3d counts from 0


def test_cameras_come_back_others_are_left_out_by_name_and_without_blobs_all_are_kept(tmp_path):
    known = rig()
    cameras = read_cameras(write_qtm(tmp_path / "a.qtm", recording()))
    assert (cameras.names, cameras.remarks) == (NAMES, ())
    for name in ("size", "matrix", "distortion", "rotation", "translation"):
        np.testing.assert_allclose(getattr(cameras, name), getattr(known, name), atol=1e-9)
    path = write_qtm(tmp_path / "b.qtm", recording(uncalibrated=("102",), video=("104",)))
    cameras = read_cameras(path)
    assert cameras.names == ("101", "103")
    assert cameras.remarks[0].endswith("102 is not calibrated, 104 recorded no blobs (a video camera)")
    assert set(all_blobs(path, cameras)[0].camera) == {0, 1}
    path = write_qtm(tmp_path / "a.qtm", recording(blobs=None, uncalibrated=("101",)))
    assert read_cameras(path).names == NAMES[1:]
    assert holds_points(path)


@pytest.mark.parametrize("up", ["x", "-y", "z"])
def test_up_can_be_said(take, up):
    axis = {"x": (1, 0, 0), "-y": (0, -1, 0), "z": (0, 0, 1)}[up]
    turned, plain = read_cameras(take, up=up), rig()
    np.testing.assert_allclose(turned.centres[:, 2], plain.centres @ axis, atol=1e-9)


def test_blobs_are_those_of_a_blob_file(take, tmp_path):
    cameras, known = rig(), sightings()
    write_blobs(tmp_path / "same.csv", known, cameras)
    for how in ({}, {"frames": (10, 20)}, {"chunk_frames": 7}):
        ours, keys = all_blobs(take, cameras, **how)
        theirs, same = all_blobs(tmp_path / "same.csv", cameras, **how)
        assert keys == same
        assert (ours.frames.tolist(), ours.frame.tolist()) == (theirs.frames.tolist(), theirs.frame.tolist())
        np.testing.assert_allclose(ours.area, theirs.area, rtol=0.05)
    np.testing.assert_array_equal(all_blobs(take, cameras)[0].xy, known.xy)
    assert frames_in(take, cameras) == (FIRST, LAST)


def test_sectors_may_be_of_either_size(take, tmp_path):
    path = write_qtm(tmp_path / "large.qtm", recording(), 4096)
    assert path.stat().st_size % 4096 == 0
    assert all_blobs(path, rig())[1] == all_blobs(take, rig())[1]
    np.testing.assert_array_equal(read_points(path).xyz, read_points(take).xyz)


def test_other_cameras_are_found_by_name_in_whatever_order(take):
    cameras = rig().select([3, 0])
    ours, known = all_blobs(take, cameras)[0], sightings()
    for index, name in enumerate(cameras.names):
        np.testing.assert_array_equal(ours.xy[ours.camera == index], known.xy[known.camera == NAMES.index(name)])


def test_blobs_that_the_capture_program_threw_away_are_left_out(tmp_path):
    parts = streams(recording())
    name, known = "Measurement NBC/Data series/114", sightings()
    content = bytearray(unpacked_series(parts[name], parts[name + "Index"]))
    # The first blob of the first frame that has one: its flags are the last four bytes.
    at = 0
    while not int.from_bytes(content[at + 12 : at + 16], "little"):
        at += 16
    content[at + 28 : at + 32] = struct.pack("<I", 4)
    parts[name], parts[name + "Index"] = packed_series(bytes(content))
    path = tmp_path / "a.qtm"
    path.write_bytes(compound_file(parts))
    ours = all_blobs(path, rig())[0]
    assert len(ours) == len(known) - 1


def test_points_and_what_each_sample_is_worth(take):
    points = read_points(take)
    assert points.names == ("", "LASI", "Zehe £")
    assert (points.rate, points.first_frame, points.columns.tolist()) == (200.0, FIRST, [0, 1, 2])
    walk = points.picked([1])
    np.testing.assert_allclose(walk.xyz[:, 0, 0], 0.1 + np.arange(LAST - FIRST + 1) / 1000)
    assert walk.residual[0, 0] == pytest.approx(0.00025)
    assert np.flatnonzero(walk.residual[:, 0] == 0).tolist() == [7, 8]
    assert np.flatnonzero(np.isnan(walk.residual[:, 0])).tolist() == [9]  # measured, and how well is not said
    pieces = points.picked([0])
    assert np.flatnonzero(np.isfinite(pieces.xyz[:, 0, 0])).tolist() == [1, 2, 3, 10, 11]


def test_which_of_both_is_meant(take, tmp_path):
    assert not holds_points(take)
    assert holds_points(take, "points")
    held = held_in(take)
    assert (held.cameras, held.calibrated, held.labelled, held.unlabelled) == (NAMES, NAMES, 2, 1)
    assert held.chosen("blobs").startswith("its blobs (4 cameras) are taken, not its 3D points (2 trajectories")
    assert held.chosen("points").startswith("its 3D points (2 trajectories with a label, 1 without) are taken, not")
    loose = write_qtm(tmp_path / "loose.qtm", recording(uncalibrated=NAMES))
    assert holds_points(loose) and not holds_points(loose, "blobs")
    blobs = write_qtm(tmp_path / "blobs.qtm", recording(trajectories=()))
    refused("holds blobs, and no 3D points; expected", holds_points, blobs, "points")
    nothing = write_qtm(tmp_path / "nothing.qtm", recording(blobs=None, trajectories=()))
    refused("holds neither blobs nor 3D points; expected", holds_points, nothing)


def everything(path: Path):
    """All that can be read of a file, in the order in which a user meets it."""
    cameras = read_cameras(path)
    for _ in read_blobs(path, cameras):
        pass
    read_points(path)
    return cameras


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ({"packing": 0}, r"packs its data in a way that is not known \(0\)"),
        ({"packing": 2}, r"packs its data in a way that is not known \(2\)"),
        ({"uncalibrated": NAMES}, "has no calibrated cameras"),
        ({"lens_rest": 0.5}, "101 has a lens of a kind that is not known"),
        *(({"rate": rate}, "has no rate of its 3D points") for rate in (1e-282, 0.0, 1e300)),
        ({"odd": {"Measurement NBC/Metadata": None}}, "has no part 'Measurement NBC/Metadata'"),
        ({"odd": {"Measurement NBC/Data Items": None}}, "has no part 'Measurement NBC/Data Items'"),
        ({"odd": {"Measurement NBC/Data series/114": None}}, "has no part 'Measurement NBC/Data series/114'"),
        ({"odd": {"Measurement NBC/Data series/114": b"\1" * 90}}, "data series 114"),
        ({"odd": {"Measurement NBC/Data series/114Index": b"\3\0\0\0"}}, "list of blocks that is cut off"),
        ({"odd": {"Measurement/Cameras/Camera - 2": b"\5\0\0\0\1\0\0\0\xff\xff\xff\xff"}}, "Camera - 2' that is cut"),
        ({"odd": {"Measurement/Cameras/Camera - 4": None}}, "has 3 cameras and the blobs of 4"),
        ({"odd": {"Measurement NBC/Metadata": struct.pack("<II", 2**31, 0)}}, "has 2147483648 entries"),
        ({"odd": {"Measurement NBC/Data Items": struct.pack("<IIII", 0, 0, 2**31, 7)}}, "is cut off"),
    ],
)
def test_what_is_not_understood_is_named(other, words, tmp_path):
    refused(words, everything, write_qtm(tmp_path / "odd.qtm", recording(**other)))


@pytest.mark.parametrize("ranges", [[(9, 5)], [(5, 9), (9, 12)], [(5, 1_000)]])
def test_frames_that_are_none_are_named(ranges, tmp_path):
    odd = Trajectory("LASI", ranges, [(1.0, 2.0, 3.0, 0.5, MEASURED)] * 4)
    refused("LASI", everything, write_qtm(tmp_path / "odd.qtm", recording(trajectories=[odd])))


def test_a_file_that_is_cut_off_anywhere_is_refused(take, tmp_path):
    content = take.read_bytes()
    for share in np.linspace(0, 0.999, 25):
        path = tmp_path / "cut.qtm"
        path.write_bytes(content[: int(share * len(content))])
        refused("expected", everything, path)
    path.write_text("frame,camera,x,y\n")
    refused("is no OLE compound file; expected a capture", everything, path)


def test_a_bomb_is_refused_before_it_fills_the_memory(tmp_path):
    """Blocks that are named many times, that promise much, or that hold more than they promise."""
    zeros = LZOCompressor().compress(bytes(1 << 18))
    name = "Measurement NBC/Data series/114"
    bombs = {
        "many": struct.pack("<I", 5000) + struct.pack("<QII", 0, len(zeros), 1 << 18) * 5000,
        "large": struct.pack("<IQII", 1, 0, len(zeros), 0xFFFFFFFF),
        "liar": struct.pack("<IQII", 1, 0, len(zeros), 1000),
    }
    for index in bombs.values():
        path = write_qtm(tmp_path / "bomb.qtm", recording(odd={name: zeros, f"{name}Index": index}))
        begin = time.process_time()
        with memory_within(30 << 20):
            refused("expected", everything, path)
        assert time.process_time() - begin < 2


@pytest.mark.parametrize("place", ["table", "small"])
def test_small_streams_that_go_round_in_a_ring_do_not_fill_the_memory(tmp_path, place):
    """A gigabyte is promised of one sector that follows itself, whether in their table or of the streams themselves."""
    content = bytearray(compound_file(streams(recording())))
    (directory,), (table,) = struct.unpack_from("<I", content, 48), struct.unpack_from("<I", content, 76)
    entry = 512 * (directory + 1)
    start, size = {"table": (60, 64), "small": (entry + 116, entry + 120)}[place]
    (sector,) = struct.unpack_from("<I", content, start)
    struct.pack_into("<I", content, 512 * (table + 1) + 4 * sector, sector)
    struct.pack_into("<I", content, size, {"table": 1 << 21, "small": 1 << 30}[place])
    path = tmp_path / "ring.qtm"
    path.write_bytes(content)
    with memory_within(30 << 20):
        refused("is a damaged compound file", everything, path)


def test_a_frame_of_more_blobs_than_a_camera_finds_is_refused(tmp_path):
    head = struct.pack("<QII", 0, 0, records.MAX_A_FRAME + 1)
    packed, index = packed_series(head + bytes(1000))
    name = "Measurement NBC/Data series/114"
    path = write_qtm(tmp_path / "odd.qtm", recording(odd={name: packed, f"{name}Index": index}))
    refused("has a frame of 20001 blobs of camera 101", everything, path)
