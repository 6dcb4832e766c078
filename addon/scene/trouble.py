# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person wants to know of a take before trusting it, worked out once for what it is at the moment."""

from dataclasses import dataclass
from typing import Self

import bpy
import numpy as np

from ..core.review.camera_blobs import CameraFinding
from ..core.review.take_trouble import MarkerSight, TakeTrouble
from ..core.review.trouble import Trouble
from .corrections import kept_text
from .opened import opened
from .stored import Stored, changed_between


@dataclass(frozen=True)
class MarkerReview:
    """One marker over a take; what is filled was not found.

    labelled     frames with a position
    gaps         runs of frames without one, those at the ends included
    longest_gap  frames of the longest
    first_gap    index of the frame where the first begins, -1 without gaps
    residual     mean residual, m; NaN when never seen
    """

    name: str
    labelled: int
    gaps: int
    longest_gap: int
    first_gap: int
    residual: float

    @classmethod
    def of(cls, stored: Stored, index: int) -> Self:
        """That of a marker by its index."""
        motion = stored.unfilled
        there = np.isfinite(motion.markers[:, index, 0])  # a place is whole or not at all
        edges = np.flatnonzero(np.diff(there, prepend=True, append=True))
        starts, lengths = edges[::2], edges[1::2] - edges[::2]
        first = int(starts[0]) if len(starts) else -1
        residual = motion.residual[there, index]
        known = residual[np.isfinite(residual)]
        mean = float(known.mean()) if len(known) else float("nan")
        return cls(stored.names[index], int(there.sum()), len(starts), int(lengths.max(initial=0)), first, mean)


def marker_reviews(stored: Stored) -> list[MarkerReview]:
    """That of each marker of a take as it is; of one that was edited since, only what that changed is looked at."""
    before, reviews = opened.looked_at.get("reviews", (None, []))
    changed = None if before is None else changed_between(before, stored)
    if changed is None:
        reviews = [MarkerReview.of(stored, index) for index in range(len(stored.names))]
    for index in changed or ():
        reviews[index] = MarkerReview.of(stored, index)
    opened.looked_at["reviews"] = stored, reviews
    return list(reviews)


QUICK = 20_000  # frames times markers that are looked at in some 0.04 s, measured: 0.17 s for 92,000 on a busy machine


def trouble_of(collection: bpy.types.Collection, scene: bpy.types.Scene) -> tuple[Trouble, ...]:
    """All trouble of a take, the worst first; frames are the source's."""
    stored = opened.take(collection, scene)
    if _known(stored) is None:  # a panel and its buttons ask for the same
        opened.looked_at["trouble"] = stored, _looked_at(stored, collection, scene)
    return opened.looked_at["trouble"][1][0]


def _known(stored: Stored) -> tuple[tuple[Trouble, ...], list[CameraFinding]] | None:
    """The trouble and the cameras of a take; None where they are not worked out."""
    before, found = opened.looked_at.get("trouble", (None, None))
    return found if before is stored else None


def known_trouble(collection: bpy.types.Collection, scene: bpy.types.Scene) -> tuple[Trouble, ...] | None:
    """The same where it is worked out already; None where it is not: drawing waits for nothing."""
    found = _known(opened.take(collection, scene))
    return None if found is None else found[0]


def known_cameras(collection: bpy.types.Collection, scene: bpy.types.Scene) -> list[CameraFinding]:
    """What becomes of each camera's blobs, the camera with the largest part without a name first; none if not known."""
    found = _known(opened.take(collection, scene))
    return sorted(found[1], key=lambda one: -np.nan_to_num(one.unnamed_share)) if found else []


def is_quick(stored: Stored) -> bool:
    """Whether the trouble of a take is worked out while a person does not notice."""
    return stored.motion.residual.size <= QUICK


def _sight_of(stored: Stored) -> MarkerSight:
    """Where the markers of a take are seen: of one that was edited since, only what that changed is looked at again."""
    before, sight = opened.looked_at.get("sight", (None, None))
    same_body = before is not None and before.motion.expected is stored.motion.expected
    changed = changed_between(before, stored) if same_body else None
    if changed is None:
        sight = MarkerSight.of(stored.motion)
    else:
        sight.look_again(stored.motion, changed)
    opened.looked_at["sight"] = stored, sight
    return sight


def _looked_at(stored: Stored, collection: bpy.types.Collection, scene: bpy.types.Scene):
    """The trouble and the cameras of a take."""
    if not len(stored.motion.frames):
        return (), []
    looking = TakeTrouble(stored.names, stored.rate, stored.edits, stored.cameras, stored.words)
    looking.add(stored.rows, stored.labels, stored.motion, _sight_of(stored))
    answered = ()
    if kept_text(collection) is not None:
        left = {(one.words, one.trajectory) for one in stored.suspects}
        all_of_it = opened.unedited(collection, scene).suspects
        answered = tuple(one for one in all_of_it if (one.words, one.trajectory) not in left)
    return looking.found(stored.suspects, answered), looking.by_camera.figures()
