# SPDX-License-Identifier: GPL-3.0-or-later
"""Captures of the recorded people: walks in a real room of twelve cameras, and single frames in the paper's rig."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np

from addon.core.geometry.cameras import Cameras
from addon.core.simulation.rigs import paper_rig, ring_rig
from addon.core.simulation.simulate import CaptureOptions, capture
from addon.io.cameras import read_cameras
from addon.io.points import read_points
from tests.core.scenes import joined

from . import people
from .flesh import Flesh, Move, flesh, moved_flesh
from .people import Take, Trial

ROOM = people.DATA / "rooms" / "vicon12"
RATE = 60.0
OFF_THE_MIDDLE = 0.3  # m that who stands is from the middle of the room, at most


@cache
def vicon12() -> Cameras:
    """The recorded room's twelve cameras, less their (small) lens terms."""
    found = read_cameras(ROOM / "walking_1.xcp")
    found = found.select(np.argsort([int(name) for name in found.names]))
    return Cameras(found.names, found.size, found.matrix, 0 * found.distortion, found.rotation, found.translation)


def walking(markers, persons, count, seed=0, options=None, room="vicon12", cameras=(6, 8)) -> Iterator[Trial]:
    """`count` whole takes at 60 Hz, each seen by a random choice of cameras in `room` ("vicon12" or "ring").

    They are every walk and turn of `persons` in turn; None: each once.
    """
    recordings = people.takes(persons, "walk", "turn")
    for number in range(len(recordings) if count is None else count):
        generator = np.random.default_rng([seed, number])
        yield taken(recordings[number % len(recordings)], markers, generator, options, room, cameras)


def taken(take: Take, markers, generator, options=None, room="vicon12", cameras=(6, 8)) -> Trial:
    """A whole take at 60 Hz, as a random choice of cameras in `room` sees it."""
    take = at_rate(take, RATE)
    body = flesh(take.markers, take.xyz)
    rig, xyz, move = _placed(take, markers, room, int(generator.integers(cameras[0], cameras[1] + 1)), generator)
    return captured(take.name, xyz, markers, rig, moved_flesh(body, slice(None), move), RATE, generator, options)


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
    move, seen = best_way(xyz, middle, count, generator)
    chosen = np.sort(generator.permutation(np.argsort(-seen)[: count + 2])[:count])
    return vicon12().select(chosen), move(xyz), move


def best_way(xyz: np.ndarray, middle: np.ndarray, count: int, generator) -> tuple[Move, np.ndarray]:
    """The way through the room on which the `count` cameras that serve see most, and what share each of all sees.

    The recorded walks are longer than this room's middle.
    """
    moves = [Move(yaw, middle, room_middle()) for yaw in generator.uniform(0, 2 * np.pi) + np.arange(0, 2 * np.pi, 0.3)]
    sees = [_seen(vicon12(), move(xyz[::5])) for move in moves]
    best = int(np.argmax([np.sort(share)[-count:].sum() for share in sees]))
    return moves[best], sees[best]


def _seen(cameras: Cameras, xyz: np.ndarray) -> np.ndarray:
    """(C,) share of the markers' samples that are within each camera's image."""
    pixels = cameras.project(xyz)
    with np.errstate(invalid="ignore"):
        return ((pixels >= 0) & (pixels < cameras.size[:, None, None])).all(axis=-1).mean(axis=(1, 2))


@cache
def room_middle() -> np.ndarray:
    """The middle of the walk that was recorded in the room, on the floor."""
    walk = read_points(ROOM / "walking_1.c3d", everything=True, up="z")
    return np.append(np.nanmean(walk.xyz[:], axis=(0, 1))[:2], 0.0)


def standing(markers, persons, count: int, seed=0, options=None, cameras: int | None = None) -> Iterator[Trial]:
    """`count` captures of one frame each of `persons` wearing `markers`, everything about them drawn from `seed`.

    cameras  that many in a ring instead of the paper's four
    """
    recordings = people.takes(persons, "standing")
    whole = [flesh(take.markers, take.xyz) for take in recordings]
    for number in range(count):
        generator = np.random.default_rng([seed, number])
        take, body = recordings[number % len(recordings)], whole[number % len(recordings)]
        frame = int(generator.integers(len(take.xyz)))
        middle = np.nanmean(take.xyz[frame], axis=0) * [1, 1, 0]
        title = f"{take.subject} frame {frame} trial {number} of seed {seed}"
        worn = replace(take, markers=markers, xyz=take.pick(markers))
        yield captured_frame(title, worn, body, frame, middle, generator, cameras, options)


def captured_frame(
    title: str, take: Take, body: Flesh, frame: int, middle: np.ndarray, generator, cameras=None, options=None
) -> Trial:
    """What cameras see of a take's frame, turned about the `middle` on the floor (3,) m and put near the room's."""
    yaw, place = generator.uniform(0, 2 * np.pi), generator.uniform(-OFF_THE_MIDDLE, OFF_THE_MIDDLE, 2)
    rig = paper_rig(generator) if cameras is None else ring_rig(cameras, generator=generator)
    part, move = slice(frame, frame + 1), Move(yaw, middle, np.append(place, 0.0))
    moved = moved_flesh(body, part, move)
    return captured(title, move(take.xyz[part]), take.markers, rig, moved, take.rate, generator, options)


def captured(title: str, xyz: np.ndarray, names, rig: Cameras, body, rate: float, generator, options=None) -> Trial:
    """What cameras see of markers (T, M, 3) m and of the bodies in their way."""
    options = replace(options or CaptureOptions(), seed=int(generator.integers(2**31)))
    seen = joined(capture(xyz, names, rig, options, body))
    return Trial(title, rig, seen.blobs, seen.truth, rate)
