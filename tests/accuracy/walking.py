# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole walks of the recorded people in a real room of twelve cameras, seen by six to eight of them."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from xml.etree import ElementTree as ET

import numpy as np

from addon.core.geometry.cameras import Cameras
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import CaptureOptions, capture, joined

from . import people
from .flesh import Move, flesh, moved_flesh
from .people import Trial

ROOM = people.DATA / "rooms" / "vicon12"
RATE = 60.0


@cache
def vicon12() -> Cameras:
    """The recorded room's twelve cameras, less their (small) lens terms; not by the project's own reader."""
    cameras = sorted(ET.parse(ROOM / "walking_1.xcp").getroot().iter("Camera"), key=lambda c: int(c.get("USERID")))
    names, size, matrix, rotation, translation = [], [], [], [], []
    for camera in cameras:
        frame = camera.find(".//KeyFrame")
        focal, aspect = float(frame.get("FOCAL_LENGTH")), float(camera.get("PIXEL_ASPECT_RATIO", "1"))
        x, y, z, w = (float(v) for v in frame.get("ORIENTATION").split())
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        u, v = (float(value) for value in frame.get("PRINCIPAL_POINT").split())
        names.append(f"cam{camera.get('USERID')}")
        size.append([int(value) for value in camera.get("SENSOR_SIZE").split()])
        matrix.append([[focal, 0, u], [0, focal / aspect, v], [0, 0, 1]])
        rotation.append(turn)
        translation.append(-turn @ (np.array([float(v) for v in frame.get("POSITION").split()]) / 1000))
    lens = np.zeros((len(names), 5))
    return Cameras(tuple(names), np.array(size), np.array(matrix), lens, np.array(rotation), np.array(translation))


def walking(
    markers,
    persons,
    count: int | None,
    seed: int = 0,
    options: CaptureOptions | None = None,
    room: str = "vicon12",
    cameras: tuple[int, int] = (6, 8),
) -> Iterator[Trial]:
    """`count` whole takes at 60 Hz, each seen by a random choice of cameras in `room` ("vicon12" or "ring").

    They are every walk and turn of `persons` in turn; None: each once.
    """
    recordings = [take for take in people.takes(persons) if take.kind in ("walk", "turn")]
    options = options or CaptureOptions()
    for number in range(len(recordings) if count is None else count):
        generator = np.random.default_rng([seed, number])
        take = at_rate(recordings[number % len(recordings)], RATE)
        body = flesh(take.names, take.xyz)
        rig, xyz, move = _placed(take, markers, room, int(generator.integers(cameras[0], cameras[1] + 1)), generator)
        moved = moved_flesh(body, slice(None), move)
        seen = joined(capture(xyz, markers, rig, replace(options, seed=int(generator.integers(2**31))), moved))
        yield Trial(f"{take.path.stem}, {take.kind}", rig, seen.blobs, seen.truth, xyz, RATE)


def at_rate(take, rate: float):
    """The take, with `xyz` and `rate`, at another rate, linear between the samples; a gap stays one."""
    count = int((len(take.xyz) - 1) * rate / take.rate) + 1
    at = np.arange(count) * take.rate / rate
    before = np.minimum(at.astype(int), len(take.xyz) - 2)
    part = (at - before)[:, None, None]
    return replace(take, xyz=take.xyz[before] * (1 - part) + take.xyz[before + 1] * part, rate=rate)


def _placed(take, markers, room: str, count: int, generator):
    """Cameras, the markers in the room, and the move that put them there."""
    xyz = take.pick(markers)
    middle = np.append(np.nanmean(xyz, axis=(0, 1))[:2], 0.0)
    if room == "ring":
        half = np.nanmax(np.linalg.norm((xyz - middle)[..., :2], axis=-1))
        rig = ring_rig(count, (1280, 1024), half + 3.0, 2.6, half + 0.1, generator)
        return rig, xyz - middle, Move(0.0, middle, np.zeros(3))
    cameras = vicon12()
    moves = [Move(yaw, middle, room_middle()) for yaw in generator.uniform(0, 2 * np.pi) + np.arange(0, 2 * np.pi, 0.3)]
    sees = [_seen(cameras, move(xyz[::5])) for move in moves]
    # The recorded walks are longer than this room's middle: walk the way on which the cameras that serve see most.
    best = int(np.argmax([np.sort(share)[-count:].sum() for share in sees]))
    good = np.argsort(-sees[best])[: count + 2]
    chosen = np.sort(generator.permutation(good)[:count])
    return cameras.select(chosen), moves[best](xyz), moves[best]


def _seen(cameras: Cameras, xyz: np.ndarray) -> np.ndarray:
    """(C,) share of the markers' samples that are within each camera's image."""
    pixels = cameras.project(xyz)
    with np.errstate(invalid="ignore"):
        return ((pixels >= 0) & (pixels < cameras.size[:, None, None])).all(axis=-1).mean(axis=(1, 2))


@cache
def room_middle() -> np.ndarray:
    """The middle of the walk that was recorded in the room, on the floor."""
    _, walk, _ = people.read_c3d(ROOM / "walking_1.c3d")
    return np.append(np.nanmean(walk, axis=(0, 1))[:2], 0.0)
