# SPDX-License-Identifier: GPL-3.0-or-later
"""Two and three people seen by cameras, one often behind the other.

Walkers of McGill in the recorded room vicon12, seen by eight of its twelve cameras, 0.5 m apart: passing each other, or
side by side all the time. `behind` is side by side in eight made-up cameras on one side, from which one walks behind
the other. All real bodies, which the model knows nothing of, are in the way of all markers. The model of body26 was
learned from five others. In `returning` the second of two who walk side by side leaves for the middle third of the
take, and comes back at the other side of the first.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from addon.core.data.progress import finished
from addon.core.data.takes import Blobs
from addon.core.geometry.cameras import Cameras
from addon.core.pipelines.several_through_points import label_several_blobs
from addon.core.points.several.wearers import SeveralOptions
from addon.core.points.whole_take.pipeline import PointOptions
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import BodiesTogether, CaptureOptions, capture, joined

from .actors import PASSING_M, Meeting, middle_of, passing, returning
from .captures import RATE, at_rate, best_way, vicon12
from .flesh import flesh
from .people import BODY26
from .whole_takes import case_few

CAMERAS = 8
RING = 24  # of which eight that are next to each other are on one side, a third of the way round
ONE_SIDE = ring_rig(RING, (1280, 1024), 4.5, 1.2, 1.8)
CHUNK = 256


@dataclass(frozen=True, eq=False)
class Seen:
    """What cameras saw of a meeting, with the true names of all blobs: 1:LASI, 2:LASI …, several joined with `|`."""

    cameras: Cameras
    blobs: Blobs
    truth: np.ndarray

    def chunks(self) -> Iterator[tuple[Blobs, float]]:
        """The blobs chunk by chunk."""
        first, last = int(self.blobs.frames[0]), int(self.blobs.frames[-1])
        for start in range(first, last + 1, CHUNK):
            yield self.blobs.between(start, min(start + CHUNK - 1, last)), (start - first) / (last + 1 - first)


def meetings(kind: str) -> Iterator[Meeting]:
    """Strangers of McGill: `passing`, `beside` or `behind`, `three` who pass each other, or one `returning`."""
    if kind == "returning":
        yield from returning(meetings("beside"))
        return
    for case in case_few("body26", BODY26, False):
        count = 3 if kind == "three" else 2
        for first in range(len(case.tested) - count + 1):
            some = [at_rate(one, RATE) for one in case.tested[first : first + count]]
            lanes = [PASSING_M * index for index in range(count)]
            ways = [(-1) ** index if kind in ("passing", "three") else 1 for index in range(count)]
            yield Meeting(" ".join(one.subject for one in some), passing(some, lanes, ways), case)


def seen(meeting: Meeting, seed: int, one_side: bool = False) -> Seen:
    """The meeting in the room, or in front of eight cameras on `one_side`."""
    generator = np.random.default_rng([17, seed])
    centre = np.append(np.mean([middle_of(one.xyz)[len(one.xyz) // 2] for one in meeting.people], axis=0), 0.0)
    if one_side:
        cameras = ONE_SIDE.select(np.sort(np.argsort(ONE_SIDE.centres[:, 1])[:CAMERAS]))
        placed = [one.xyz - centre for one in meeting.people]
    else:
        move, share = best_way(meeting.together().xyz, centre, CAMERAS, generator)
        cameras = vicon12().select(np.sort(np.argsort(-share)[:CAMERAS]))
        placed = [move(one.xyz) for one in meeting.people]
    bodies = tuple(flesh(one.markers, xyz) for one, xyz in zip(meeting.people, placed, strict=True))
    together = BodiesTogether(bodies, tuple(xyz.shape[1] for xyz in placed))
    names = meeting.together().markers
    options = replace(CaptureOptions(), seed=int(generator.integers(2**31)))
    xyz = np.concatenate(placed, axis=1)
    taken = joined(capture(xyz, names, cameras, options, together))
    return Seen(cameras, taken.blobs, taken.truth)


def named(shot: Seen, asked: SeveralOptions) -> np.ndarray:
    """(N,) the names that the product gives to the blobs, "" for none."""
    made = finished(label_several_blobs(shot.chunks, shot.cameras, asked, PointOptions("likelihood"), RATE))
    marker = np.concatenate([chunk.labels.marker for chunk in made.chunks(part for part, _ in shot.chunks())])
    return np.array([*made.worn.markers, ""], object)[marker]
