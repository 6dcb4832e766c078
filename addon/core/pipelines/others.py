# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether blobs that one subject was asked of show two: what a take of points is asked at first, of blobs at the end.

A body takes what it needs of two people's blobs, and what it leaves looks like ghosts. But two leave as many as they
have, so that nothing is looked at in a take of one; and where they do, the blobs of a few frames make points, in which
single frames are sure of two subjects at once, or are not.
"""

from dataclasses import dataclass

import numpy as np

from ..data.takes import Blobs, LabelledChunk, evenly_spread, rows_in_frame
from ..geometry.cameras import Cameras
from ..geometry.views import Sight, split_views
from ..points.models import Model
from ..points.naming import chosen_method, namer_of
from ..points.refusals import REFUSAL, SubjectsError, UnsuitedError, refuse_others
from ..reconstruction.matching import Circumstances, Expected, FrameMatcher
from ..reconstruction.trajectories import RECONSTRUCTION


@dataclass(frozen=True)
class SeekingOptions:
    """Where a take may show two. Reckoned.

    frames  that are looked at, spread over the take
    left    blobs without a name in a frame, as a share of those with one, that may be somebody else's
    """

    frames: int = 12
    left: float = 0.5


SEEKING = SeekingOptions()


class OtherSubjects:
    """Looks at a labelled take of blobs, chunk by chunk, for whoever was not asked for."""

    def __init__(self, cameras: Cameras, model: Model):
        self.cameras, self.model = cameras, model
        self.kept: list[Blobs | None] = []  # every `stride`th frame, None where it shows nobody else
        self.residual: list[np.ndarray] = []
        self.stride, self.frames = 1, 0

    def add(self, blobs: Blobs, chunk: LabelledChunk):
        """Looks at the next chunk, whose rows are in the order of their frames."""
        count = len(blobs.frames)
        named = np.bincount(blobs.frame[chunk.labels.named], minlength=count)
        left = np.bincount(blobs.frame[~chunk.labels.named], minlength=count)
        crowded = (left >= SEEKING.left * named) & (left > 0)
        for index in range(-self.frames % self.stride, count, self.stride):
            one = blobs.part(slice(index, index + 1), rows_in_frame(blobs, index)) if crowded[index] else None
            self.kept.append(one)
            self.residual.append(chunk.motion.residual_px[index])
        self.frames += count
        while len(self.kept) > 2 * SEEKING.frames:
            self.kept, self.residual, self.stride = self.kept[::2], self.residual[::2], 2 * self.stride

    def refuse(self):
        """Raises JobError where the take shows two subjects or more, and says how to ask for both."""
        crowded = [one for one in self.kept if one is not None]
        if not crowded or len(crowded) < REFUSAL.min_often * len(self.kept):
            return
        crowded = [crowded[index] for index in evenly_spread(len(crowded), SEEKING.frames)]
        namer = namer_of(self.model, chosen_method(self.model, "auto"), None)
        try:
            refuse_others(self.model, namer, self._points(crowded))
        except SubjectsError:
            raise
        except UnsuitedError:
            return  # single frames are not sure of anybody

    def _points(self, frames: list[Blobs]) -> np.ndarray:
        """(T, P, 3) m, what the blobs of some frames make, each on its own."""
        sight, believed = Sight(self.cameras), self._circumstances()
        views = split_views(Blobs.join(frames), self.cameras)
        matched = [FrameMatcher(view, sight, self.cameras.size, believed) for view in views]
        found = [one.match(Expected.nothing()).points for one in matched]
        points = np.full((len(found), max(map(len, found)), 3), np.nan)
        for frame, own in enumerate(found):
            points[frame, : len(own)] = own
        return points

    def _circumstances(self) -> Circumstances:
        """What the capture is like, by how far the rays of named blobs miss where they meet."""
        residual = np.concatenate(self.residual)
        residual = residual[np.isfinite(residual)]
        pixel = float(np.median(residual)) if len(residual) else RECONSTRUCTION.tried_px[0]
        pixel = float(np.clip(pixel, RECONSTRUCTION.tried_px[0], RECONSTRUCTION.max_px))
        ghosts = np.full(len(self.cameras), RECONSTRUCTION.first_ghosts)
        return Circumstances(pixel, RECONSTRUCTION.first_seen, ghosts)
