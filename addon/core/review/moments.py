# SPDX-License-Identifier: GPL-3.0-or-later
"""The worst moments of a labelled take, kept as they are found: what a picture of each is drawn from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from ..data.takes import Blobs, LabelledChunk, Motion, PointRows, Suspect, rows_in_frame
from .suspects import MAX_OFF_BODY_M

MOST_MOMENTS = 6  # format: pictures on a page, and kept of one kind of doubt, each of other markers
# physical: m, from the middle of the markers to unnamed points that are kept; a body with arms held out
AROUND_M = 1.5  # physical


@dataclass(frozen=True, eq=False)
class Moment:
    """A frame that a person should look at."""

    suspect: Suspect  # why, and of which frames
    frame: int  # by the source's number, the one of these in which it shows most
    badness: float  # m s: how far its markers are from where the body has them, for how long
    doubtful: tuple[int, ...]  # indices of its markers
    markers: np.ndarray  # (M, 3) m, NaN where missing
    expected: np.ndarray  # (M, 3) m, where the body has them
    joints: np.ndarray  # (J, 3) m
    heading: np.ndarray  # (2,) where the subject faces, seen from above
    others: np.ndarray  # (U, 3) m, points without a name around
    asked: np.ndarray  # (3,) m, the one of them that it is about, NaN where it is none


class MomentKeeper:
    """Keeps the worst moments of a take while its chunks come; `rate` is in frames a second."""

    def __init__(self, rate: float):
        self.rate = rate
        self.kinds: dict[str, list[Moment]] = {}

    def add(self, rows: Blobs | PointRows, chunk: LabelledChunk, doubts: Sequence[Suspect], words: Mapping[str, int]):
        """Adds the doubts about markers of a chunk."""
        off = np.linalg.norm(chunk.motion.markers - chunk.motion.expected, axis=-1)
        # Where the body has no such marker, or nothing is named, it counts like one that is just too far away.
        summed = np.cumsum(np.nan_to_num(off, nan=MAX_OFF_BODY_M), axis=0)
        summed = np.concatenate([np.zeros((1, off.shape[1])), summed]) / self.rate
        first, kind_of = int(chunk.motion.frames[0]), cache(_kind_of)
        worst: dict[tuple, tuple[float, slice, Suspect]] = {}
        for doubt in doubts:
            doubtful = tuple(words[name] for name in doubt.markers if name in words)
            part = slice(max(doubt.first - first, 0), min(doubt.last - first + 1, len(off)))
            if part.start >= part.stop or not doubtful:
                continue
            badness = sum(float(summed[part.stop, index] - summed[part.start, index]) for index in doubtful)
            key = kind_of(doubt.words, doubt.markers), doubtful
            if key not in worst or worst[key][0] < badness:
                worst[key] = badness, part, doubt
        for (kind, doubtful), (badness, part, doubt) in sorted(worst.items(), key=lambda item: -item[1][0]):
            kept = self.kinds.get(kind, [])
            same = [one for one in kept if one.doubtful == doubtful]
            kept = [one for one in kept if one.doubtful != doubtful]
            if any(one.badness >= badness for one in (*same, *kept[MOST_MOMENTS - 1 :])):
                continue
            # The frame in which most of its markers are there and, of these, they are farthest off the body.
            far = off[part][:, doubtful]
            seen = np.isfinite(far).sum(axis=1)
            most = int(np.where(seen == seen.max(), np.nan_to_num(far).sum(axis=1), -1.0).argmax())
            kept.append(_moment(doubt, badness, doubtful, part.start + most, rows, chunk))
            self.kinds[kind] = sorted(kept, key=lambda one: -one.badness)[:MOST_MOMENTS]

    def worst(self) -> list[Moment]:
        """The worst of each kind first, then the next of each."""
        kinds = sorted(self.kinds.values(), key=lambda kept: -kept[0].badness)
        return [kept[turn] for turn in range(MOST_MOMENTS) for kept in kinds if turn < len(kept)][:MOST_MOMENTS]


def _kind_of(words: str, markers: tuple[str, ...]) -> str:
    """What is said, without of whom."""
    return " ".join(word for word in words.split() if word.rstrip(",:") not in markers)


def _moment(
    doubt: Suspect, badness: float, doubtful: tuple[int, ...], index: int, rows: Blobs | PointRows, chunk: LabelledChunk
) -> Moment:
    motion = chunk.motion
    markers = motion.markers[index]
    others, asked = np.zeros((0, 3)), np.full(3, np.nan)
    if isinstance(rows, PointRows):
        part = rows_in_frame(rows, index)
        xyz, named = rows.xyz[part], chunk.labels.named[part]
        middle = np.nanmedian(np.concatenate([markers, xyz]), axis=0)
        near = np.linalg.norm(xyz - middle, axis=1) < AROUND_M
        others = xyz[~named & near]
        own = rows.trajectory[part] == doubt.trajectory
        asked = xyz[own][0] if own.any() else asked
    return Moment(
        doubt,
        int(motion.frames[index]),
        badness,
        doubtful,
        markers.copy(),  # a view would keep the whole chunk
        motion.expected[index].copy(),
        motion.joints[index].copy(),
        _heading(motion, index),
        others,
        asked,
    )


def _heading(motion: Motion, index: int) -> np.ndarray:
    """(2,) where the root's x axis points, seen from above; without a body, across the markers."""
    ahead = motion.rotations[index, 0, :2, 0]
    size = float(np.linalg.norm(ahead))
    if np.isfinite(motion.joints[index, 0]).all() and size > 0:
        return ahead / size
    flat = motion.markers[index, :, :2]
    flat = flat[np.isfinite(flat).all(axis=1)]
    if len(flat) < 2:
        return np.array([1.0, 0.0])
    return np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2][-1]
