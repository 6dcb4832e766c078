# SPDX-License-Identifier: GPL-3.0-or-later
"""Single frames of standing people in the paper's rig: any facing, up to 0.3 m off the middle, each in a new rig."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from addon.core.simulation.rigs import paper_rig, ring_rig
from addon.core.simulation.simulate import CaptureOptions, capture, joined

from . import people
from .flesh import Move, flesh, moved_flesh
from .people import Trial

OFF_THE_MIDDLE = 0.3


def standing(
    markers,
    persons,
    count: int,
    seed: int = 0,
    options: CaptureOptions | None = None,
    cameras: int | None = None,
) -> Iterator[Trial]:
    """`count` captures of one frame each of `persons` wearing `markers`, everything about them drawn from `seed`.

    cameras  that many in a ring instead of the paper's four
    """
    recordings = people.takes(persons, "standing")
    whole = [flesh(take.names, take.xyz) for take in recordings]
    options = options or CaptureOptions()
    for number in range(count):
        generator = np.random.default_rng([seed, number])
        which = number % len(recordings)
        take, body = recordings[which], whole[which]
        frame = int(generator.integers(len(take.xyz)))
        yaw, place = generator.uniform(0, 2 * np.pi), generator.uniform(-OFF_THE_MIDDLE, OFF_THE_MIDDLE, 2)
        middle = np.nanmean(take.xyz[frame], axis=0) * [1, 1, 0]
        move = Move(yaw, middle, np.append(place, 0.0))
        part = slice(frame, frame + 1)
        moved = moved_flesh(body, part, move)
        rig = paper_rig(generator) if cameras is None else ring_rig(cameras, generator=generator)
        xyz = move(take.pick(markers)[part])
        seen = joined(capture(xyz, markers, rig, replace(options, seed=int(generator.integers(2**31))), moved))
        title = f"{take.person} frame {frame} trial {number} of seed {seed}"
        yield Trial(title, rig, seen.blobs, seen.truth, xyz, take.rate)
