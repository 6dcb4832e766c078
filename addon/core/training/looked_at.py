# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a labelled take is worth learning: names that a person gave or answered, and those that nobody doubts.

A program that learns its own mistakes makes them again, surer than before. So what is doubtful and nobody looked at is
left out, and said; and a marker that was found never or hardly stays in the set with what was known of it before.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class LookedAtOptions:
    """When a marker teaches little; reckoned.

    min_frames  that a marker must be learned from, or
    min_share   of the take's frames, that it is not said to be found hardly
    most_names  that a sentence lists
    """

    min_frames: int = 10
    min_share: float = 0.02
    most_names: int = 8


LOOKED_AT = LookedAtOptions()


@dataclass(frozen=True, eq=False)
class Learnable:
    """What is learned of a take: markers (T, M, 3) m, NaN where missing or left out, and what to say of the rest."""

    xyz: np.ndarray
    doubts: tuple[str, ...]


def learnable(xyz: np.ndarray, doubtful: np.ndarray, names: Sequence[str]) -> Learnable:
    """What is worth learning of markers (T, M, 3) m that were measured, of which some samples are `doubtful` (T, M).

    What a person named, or said to be right, is to be no doubt any more.
    """
    seen = np.isfinite(xyz).all(axis=2)
    left_out = seen & doubtful
    kept = np.where(left_out[..., None], np.nan, xyz)
    said = [*_not_learned(left_out.sum(axis=0), names), *hardly_found((seen & ~doubtful).sum(axis=0), len(xyz), names)]
    return Learnable(kept, tuple(said))


def _not_learned(counts: np.ndarray, names: Sequence[str]) -> list[str]:
    """What is said of doubtful samples, so many of each marker (M,)."""
    order = [index for index in np.argsort(-counts, kind="stable") if counts[index]]
    if not order:
        return []
    who = listed([names[index] for index in order])
    frames = int(counts.sum())
    many = "frame that nobody looked at was" if frames == 1 else "frames that nobody looked at were"
    return [f"{who}: {frames} doubtful {many} not learned; correct them or say It Is Right, and learn again"]


def hardly_found(counts: np.ndarray, frames: int, names: Sequence[str]) -> list[str]:
    """What is said of markers that so many frames (M,), of all, can be learned from: few or none."""
    least = max(LOOKED_AT.min_frames, LOOKED_AT.min_share * frames)
    few = np.flatnonzero(counts < min(least, max(frames, 1)))
    if not len(few):
        return []
    never = [names[index] for index in few if not counts[index]]
    hardly = [f"{names[index]} ({counts[index]})" for index in few if counts[index]]
    said = []
    if never:
        said.append(f"{listed(never)}: found in no frame that could be learned, so what was known before stays")
    if hardly:
        said.append(f"{listed(hardly)}: found in hardly any frames that could be learned, so little is new of them")
    return said


def listed(names: Sequence[str]) -> str:
    """Names one after the other, not more than a person reads."""
    more = len(names) - LOOKED_AT.most_names
    some = ", ".join(names[: LOOKED_AT.most_names])
    return f"{some} and {more} more" if more > 0 else some
