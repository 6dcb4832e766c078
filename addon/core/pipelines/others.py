# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether blobs that one subject was asked of show two, who would have to be asked for.

The blobs of a few frames make points, in which single frames are sure of two subjects at once, or are not. That is
asked before anything is named, and at the end, when it is known how far rays miss and what is left: a body takes what
it needs of two people's blobs, and the rest looks like ghosts, but two leave as many as they have.
"""

from collections.abc import Callable, Iterable

import numpy as np

from ..blobs.subject import SUBJECT
from ..data.takes import Blobs, LabelledChunk, evenly_spread, rows_in_frame
from ..geometry.cameras import Cameras
from ..geometry.views import Sight, split_views
from ..points.models import Model, chosen_method, namer_of
from ..points.refusals import REFUSAL, SubjectsError, UnsuitedError, is_crowd, refuse_others, refuse_two_groups
from ..reconstruction.matching import Circumstances, Matcher, padded
from ..reconstruction.trajectories import RECONSTRUCTION

FIRST = 4  # frames of a take's beginning, whose points are counted before any is named, in 0.1 s
MOST_FRAMES = 12  # that are looked at, spread over the take


def refuse_two(beginning: Blobs, read: Callable[[], Iterable[Blobs]], cameras: Cameras, model: Model):
    """Raises JobError where a take, which `read` reads, shows two subjects before any of it is named.

    Whether all of it is read for that, the number of points in its beginning says.
    """
    begun, whole = OtherSubjects(cameras, model), OtherSubjects(cameras, model)
    begun.add(beginning)
    if is_crowd(begun.some_points(FIRST), model):
        for blobs in read():
            whole.add(blobs)
        whole.refuse()


class OtherSubjects:
    """Looks at a take of blobs, chunk by chunk, for whoever was not asked for."""

    def __init__(self, cameras: Cameras, model: Model):
        self.cameras, self.model = cameras, model
        self.kept: list[Blobs | None] = []  # every `stride`th frame, None where it shows nobody else
        self.residual: list[np.ndarray] = []
        self.stride, self.frames = 1, 0

    def add(self, blobs: Blobs, chunk: LabelledChunk | None = None):
        """Looks at the next chunk, whose rows are in the order of their frames; at all of it before it is labelled."""
        count = len(blobs.frames)
        crowded, residual = np.ones(count, bool), np.full(count, np.nan)
        if chunk is not None:
            named = np.bincount(blobs.frame[chunk.labels.named], minlength=count)
            left = np.bincount(blobs.frame[~chunk.labels.named], minlength=count)
            # Two have as many blobs, and one of them hides half of the other's.
            crowded, residual = (left >= REFUSAL.min_half * named) & (left > 0), chunk.motion.residual_px
        for index in range(-self.frames % self.stride, count, self.stride):
            one = blobs.part(slice(index, index + 1), rows_in_frame(blobs, index)) if crowded[index] else None
            self.kept.append(one)
            self.residual.append(np.atleast_1d(residual[index]))
        self.frames += count
        while len(self.kept) > 2 * MOST_FRAMES:
            self.kept, self.residual, self.stride = self.kept[::2], self.residual[::2], 2 * self.stride

    def refuse(self):
        """Raises JobError where the take shows two subjects or more, and says how to ask for both."""
        crowded = sum(one is not None for one in self.kept)
        if not crowded or crowded < REFUSAL.min_half * len(self.kept):
            return
        points = self.some_points(MOST_FRAMES)
        if not self.model.has_learned:
            refuse_two_groups(self.model, points)
            return
        try:
            refuse_others(self.model, namer_of(self.model, chosen_method(self.model, "auto")), points)
        except SubjectsError:
            raise
        except UnsuitedError:
            return  # single frames are not sure of anybody

    def some_points(self, count: int) -> np.ndarray:
        """(T, P, 3) m, what the blobs of so many of the frames that may show two make, each on its own."""
        crowded = [one for one in self.kept if one is not None]
        frames = [crowded[index] for index in evenly_spread(len(crowded), count)]
        sight, believed = Sight(self.cameras), self._circumstances()
        views = split_views(Blobs.join(frames), self.cameras)
        found = [Matcher([view], sight, self.cameras.size, believed).match(0, 1).points for view in views]
        frame = np.repeat(np.arange(len(found)), [len(points) for points in found])
        return padded(np.concatenate(found), frame, len(found), np.nan)

    def _circumstances(self) -> Circumstances:
        """What the capture is like, by how far the rays of named blobs miss where they meet."""
        residual = np.concatenate(self.residual)
        residual = residual[np.isfinite(residual)]
        pixel = float(np.median(residual)) if len(residual) else SUBJECT.min_noise_px
        pixel = float(np.clip(pixel, SUBJECT.min_noise_px, SUBJECT.max_noise_px))
        ghosts = np.full(len(self.cameras), RECONSTRUCTION.first_ghosts)
        return Circumstances(pixel, RECONSTRUCTION.max_seen, ghosts)
