# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs named through the points that they make: reconstructed without names, named in space, and back to the images.

The second paper after the first one's cameras: it checks the fitted body, which goes the other way round.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np

from ..data.errors import JobError
from ..data.progress import finished
from ..data.takes import Blobs, LabelledChunk, Labels, Suspect
from ..edits.blobs_in_points import NamedThroughBlobs
from ..edits.kinds import NO_EDITS, Edits
from ..geometry.cameras import Cameras
from ..geometry.measuring import measured_again
from ..points.models import Model
from ..points.motion import TakeMotion, take_motion
from ..points.refusals import SubjectsError
from ..points.whole_take.pipeline import PointOptions, label_take
from .points_of_blobs import PointsOfBlobs, without_number

VOTING_FRAMES = 1024  # whose trajectories vote together, so that memory does not grow with the take


def label_through_points(
    chunks: Iterable[Blobs], cameras: Cameras, model: Model, rate: float, options: PointOptions, edits: Edits = NO_EDITS
) -> Iterator[LabelledChunk]:
    """Names the blobs of a take as `blobs.pipeline.label_take` does: a `LabelledChunk` for each chunk, in their order.

    About `VOTING_FRAMES` frames are named as a take of points. Where `edits` name blobs, the points that these make
    have their names, and `unedited` is what was labelled without.
    Raises JobError when there are fewer than two cameras, a frame has more blobs than any capture, or two subjects are
    there.
    """
    window: list[Blobs] = []
    for blobs in chunks:
        window.append(blobs)
        if sum(len(part.frames) for part in window) >= VOTING_FRAMES:
            yield from _labelled(window, cameras, model, rate, options, edits)
            window = []
    if window:
        yield from _labelled(window, cameras, model, rate, options, edits)


def _labelled(
    window: Sequence[Blobs], cameras: Cameras, model: Model, rate: float, options: PointOptions, edits: Edits
) -> Iterator[LabelledChunk]:
    """The chunks of one window; nothing in them, and why, where nobody in the model's markers is there."""
    begin = perf_counter()
    points, named = PointsOfBlobs(cameras, rate), NamedThroughBlobs(edits, cameras.names, model.markerset)
    for blobs in window:
        points.add(blobs)
        rows = points.parts[-1].rows
        named.add(blobs, rows["blobs"], rows["trajectory"])
    spent = {"place": perf_counter() - begin}
    frames = np.concatenate([blobs.frames for blobs in window])
    try:
        take = points.take()
        found = finished(label_take(take, model, replace(options, edits=named.edits_of(points.place))))
        motion, suspects, spent = found.motion, tuple(map(without_number, found.suspects)), spent | found.seconds
    except SubjectsError:
        raise
    except JobError:
        found, motion = None, _nobody(model, frames)
        words = f"no subject that wears {model.markerset.name} was recognised"
        suspects = (Suspect(int(frames[0]), int(frames[-1]), words),)
    for index, (blobs, part) in enumerate(zip(window, points.parts, strict=True)):
        nothing = Labels.none(len(blobs))
        labels, unedited = nothing, None if found else nothing
        if found is not None:
            labels = points.named(index, found.labels, len(blobs))
            unedited = found.unedited and points.named(index, found.unedited, len(blobs))
        here = motion.part(slice(part.first, part.first + part.frames))
        here = measured_again(here, blobs, nothing, labels, cameras)
        own = tuple(one for one in suspects if blobs.frames[0] <= one.first <= blobs.frames[-1])
        yield LabelledChunk(labels, here, own, spent, unedited)
        spent = {}


def _nobody(model: Model, frames: np.ndarray) -> TakeMotion:
    """The motion in frames (T,) where nobody is."""
    shape = len(frames), len(model.markerset)
    nowhere = np.full((*shape, 3), np.nan)
    return finished(take_motion(nowhere, nowhere[..., 0], Labels.none(*shape), model.markerset, frames))
