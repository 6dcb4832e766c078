# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person wants to know of a take before trusting it, worked out once for what it is at the moment."""

import bpy
import numpy as np

from ..core.data.takes import Suspect
from ..core.review.suspects import runs
from ..core.review.take_trouble import TakeTrouble
from ..core.review.trouble import Trouble
from .corrections import kept_text
from .opened import opened
from .stored import Stored


def marker_rows(stored: Stored) -> list[tuple[str, float, int, int, float, float]]:
    """Of each marker, the least found first; what is filled was not found.

    Its name, the part of the frames in which it was found, its gaps, those at the ends included, frames of the longest,
    Blender's frame in which the first begins, -1 without gaps, and its mean residual in mm, NaN when never seen.
    """
    motion, rows = stored.unfilled, []
    for index, name in enumerate(stored.names):
        there = np.isfinite(motion.markers[:, index, 0])  # a place is whole or not at all
        gaps = runs(~there)
        first = float(stored.clock.shown(motion.frames[gaps[0][0]])) if gaps else -1.0
        longest = max((stop - start for start, stop in gaps), default=0)
        residual = motion.residual[there, index]
        known = residual[np.isfinite(residual)]
        mean = 1000 * float(known.mean()) if len(known) else float("nan")
        found = float(there.sum()) / max(len(there), 1)
        rows.append((name, found, len(gaps), longest, first, mean))
    return sorted(rows, key=lambda row: (row[1], -row[2]))


QUICK = 20_000  # frames times markers that are looked at in some 0.04 s, measured: 0.17 s for 92,000 on a busy machine


def trouble_of(collection: bpy.types.Collection, scene: bpy.types.Scene) -> tuple[Trouble, ...]:
    """All trouble of a take, the worst first; frames are the source's."""
    found = known_trouble(collection, scene)
    if found is None:  # a panel and its buttons ask for the same
        stored = opened.take(collection, scene)
        found = _looked_at(stored, collection, scene)
        opened.looked_at["trouble"] = stored, found
    return found


def known_trouble(collection: bpy.types.Collection, scene: bpy.types.Scene) -> tuple[Trouble, ...] | None:
    """The same where it is worked out already; None where it is not: drawing waits for nothing."""
    before, found = opened.looked_at.get("trouble", (None, None))
    return found if before is opened.take(collection, scene) else None


def is_quick(stored: Stored) -> bool:
    """Whether the trouble of a take is worked out while a person does not notice."""
    return stored.motion.residual.size <= QUICK


def _looked_at(stored: Stored, collection: bpy.types.Collection, scene: bpy.types.Scene) -> tuple[Trouble, ...]:
    if not len(stored.motion.frames):
        return ()
    looking = TakeTrouble(stored.names, stored.rate, stored.edits, stored.cameras, stored.words)
    looking.add(stored.rows, stored.labels, stored.motion)
    return looking.found(stored.suspects, answered_doubts(collection, scene))


def answered_doubts(collection: bpy.types.Collection, scene: bpy.types.Scene) -> tuple[Suspect, ...]:
    """What the program doubted of a take and a person answered."""
    if kept_text(collection) is None:
        return ()
    left = {(one.words, one.trajectory) for one in opened.take(collection, scene).suspects}
    all_of_it = opened.unedited(collection, scene).suspects
    return tuple(one for one in all_of_it if (one.words, one.trajectory) not in left)
