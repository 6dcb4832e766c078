# SPDX-License-Identifier: GPL-3.0-or-later
"""Single frames of standing people in the paper's rig: any facing, up to 0.3 m off the middle, each in a new rig."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from addon.core.geometry.cameras import Cameras
from addon.core.simulation.rigs import paper_rig, ring_rig
from addon.core.simulation.simulate import CaptureOptions, capture, joined

from . import people
from .flesh import Flesh, Move, flesh, moved_flesh
from .people import Take, Trial

OFF_THE_MIDDLE = 0.3


def standing(
    markers, persons, count: int, seed: int = 0, options: CaptureOptions | None = None, cameras: int | None = None
) -> Iterator[Trial]:
    """`count` captures of one frame each of `persons` wearing `markers`, everything about them drawn from `seed`.

    cameras  that many in a ring instead of the paper's four
    """
    recordings = people.takes(persons, "standing")
    whole = [flesh(take.markers, take.xyz) for take in recordings]
    for number in range(count):
        generator = np.random.default_rng([seed, number])
        take, body = recordings[number % len(recordings)], whole[number % len(recordings)]
        frame = int(generator.integers(len(take.xyz)))
        move = moved_anywhere(np.nanmean(take.xyz[frame], axis=0) * [1, 1, 0], generator)
        rig = paper_rig(generator) if cameras is None else ring_rig(cameras, generator=generator)
        title = f"{take.subject} frame {frame} trial {number} of seed {seed}"
        worn = replace(take, markers=markers, xyz=take.pick(markers))
        yield captured(title, worn, body, frame, move, rig, generator, options or CaptureOptions())


def moved_anywhere(middle: np.ndarray, generator: np.random.Generator) -> Move:
    """A turn about a person's middle on the floor (3,) m, and a place near the room's."""
    yaw, place = generator.uniform(0, 2 * np.pi), generator.uniform(-OFF_THE_MIDDLE, OFF_THE_MIDDLE, 2)
    return Move(yaw, middle, np.append(place, 0.0))


def captured(
    title: str,
    take: Take,
    body: Flesh,
    frame: int,
    move: Move,
    rig: Cameras,
    generator: np.random.Generator,
    options: CaptureOptions,
) -> Trial:
    """What cameras see of a take's frame."""
    part = slice(frame, frame + 1)
    xyz, options = move(take.xyz[part]), replace(options, seed=int(generator.integers(2**31)))
    seen = joined(capture(xyz, take.markers, rig, options, moved_flesh(body, part, move)))
    return Trial(title, rig, seen.blobs, seen.truth, xyz, take.rate)
