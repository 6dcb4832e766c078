# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a labelled take is worth learning: names that a person gave or answered, and those that nobody doubts.

A program that learns its own mistakes makes them again, surer than before. So what is doubtful and nobody looked at is
left out, and reported; and a marker that was never or hardly found stays in the set with what was known of it before.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..data.wording import listed
from ..points.likelihood.learn import LEARN


@dataclass(frozen=True, eq=False)
class Learnable:
    """What is learned of a take: markers (T, M, 3) m, NaN where missing or left out, and what to say of the rest."""

    xyz: np.ndarray
    doubts: tuple[str, ...]


def learnable(xyz: np.ndarray, doubtful: np.ndarray, names: Sequence[str]) -> Learnable:
    """What is worth learning of markers (T, M, 3) m that were measured, of which some samples are `doubtful` (T, M).

    What a person named, or confirmed, is to be no doubt any more. A marker with fewer samples than any model is learned
    from is reported.
    """
    seen = np.isfinite(xyz).all(axis=2)
    left_out, doubts = (seen & doubtful).sum(axis=0), []
    if left_out.any():
        who = listed([names[index] for index in np.argsort(-left_out, kind="stable") if left_out[index]])
        many = "frame that nobody looked at was" if left_out.sum() == 1 else "frames that nobody looked at were"
        doubts.append(
            f"{who}: {left_out.sum()} doubtful {many} not learned; correct them or say It Is Right, and learn again"
        )
    counts = (seen & ~doubtful).sum(axis=0)
    few = counts < min(LEARN.min_frames, max(len(xyz), 1))
    never = [name for name, one in zip(names, counts == 0, strict=True) if one]
    hardly = [f"{name} ({count})" for name, count, one in zip(names, counts, few, strict=True) if one and count]
    if never:
        doubts.append(f"{listed(never)}: found in no frame that could be learned, so what was known before stays")
    if hardly:
        doubts.append(f"{listed(hardly)}: found in hardly any frames that could be learned, so little is new of them")
    return Learnable(np.where((seen & doubtful)[..., None], np.nan, xyz), tuple(doubts))
