# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs named through the points that they make: reconstructed without names, named in space, and back to the images.

The second paper after the first one's cameras: it checks the fitted body, which goes the other way round.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from ..data.errors import JobError
from ..data.lanes import Lanes
from ..data.made import IN_MEMORY, MakeTable
from ..data.progress import finished
from ..data.takes import Blobs, LabelledChunk, Labels, Points, Suspect
from ..edits.blobs_in_points import NamedThroughBlobs
from ..geometry.cameras import Cameras
from ..geometry.measuring import measured_again
from ..points.models import Model
from ..points.motion import TakeMotion, take_motion
from ..points.refusals import SubjectsError
from ..points.whole_take.pipeline import PointOptions, label_take
from ..reconstruction.trajectories import Reconstructor, TrajectorySpans


@dataclass(frozen=True, eq=False)
class PointsOfChunk:
    """The points of a chunk of so many frames, from frame `first` of the take on: rows (Q,) as `PointsOfBlobs.kind`."""

    first: int
    frames: int
    rows: np.ndarray


class PointsOfBlobs:
    """The points that the blobs of a take make, chunk by chunk, in tables that `make_table` gives.

    Raises JobError where there are fewer than two cameras.
    """

    def __init__(self, cameras: Cameras, rate: float, make_table: MakeTable = IN_MEMORY):
        if len(cameras) < 2:
            raise JobError(f"{len(cameras)} camera cannot fix a point in space; expected two or more")
        self.rate, self.make_table, self.first_frame, self.frames = rate, make_table, 0, 0
        self.reconstructor = Reconstructor(cameras, rate)
        row = [("frame", "<i4"), ("trajectory", "<i4"), ("xyz", "<f4", 3), ("residual", "<f4")]
        self.kind = np.dtype([*row, ("blobs", "<i4", len(cameras))])
        self.spans = TrajectorySpans()
        self.parts: list[PointsOfChunk] = []
        # Of each trajectory the place among those of the take, -1 where it is none; and the lanes of these.
        self.place, self.lanes = np.zeros(0, int), Lanes.each(0, 0)

    def add(self, blobs: Blobs):
        """Adds the next chunk of the take. Raises JobError where a frame has more blobs than any capture."""
        made = self.reconstructor.reconstruct(blobs)
        rows = np.empty(len(made.points), self.kind)
        rows["frame"], rows["trajectory"] = self.frames + made.frame, made.trajectory
        rows["xyz"], rows["residual"], rows["blobs"] = made.points, made.residual, made.rows
        self.spans.note(made.trajectory, rows["frame"])
        table = self.make_table(rows.shape, self.kind) if len(rows) else rows
        table[:] = rows
        self.first_frame = self.first_frame if self.parts else int(blobs.frames[0])
        self.parts.append(PointsOfChunk(self.frames, len(blobs.frames), table))
        self.frames += len(blobs.frames)

    def take(self) -> Points:
        """All of them as a take, passing coincidences of rays left out; JobError where there are none."""
        kept = self.spans.lasting(self.frames)
        if not len(kept):
            raise JobError(
                "shows no markers that two cameras see together; expected blobs, and the cameras that saw them"
            )
        self.lanes = Lanes.packed(*self.spans.table[kept, 1:].T)
        self.place = np.full(len(self.spans.table), -1)
        self.place[kept] = np.arange(len(kept))
        shape = self.frames, self.lanes.count
        xyz, residual = np.full((*shape, 3), np.nan, np.float32), np.full(shape, np.nan, np.float32)
        for part in self.parts:
            rows, lane = self._lasting(part)
            xyz[rows["frame"], lane] = rows["xyz"]
            residual[rows["frame"], lane] = rows["residual"]
        return Points(("",) * len(kept), xyz, residual, self.rate, self.first_frame, lanes=self.lanes)

    def named(self, index: int, labels: Labels, blobs: int) -> Labels:
        """What labels (T, L) of the take say of so many blobs (N,) of a chunk."""
        part = self.parts[index]
        rows, lane = self._lasting(part)
        own = labels[part.first : part.first + part.frames][rows["frame"] - part.first, lane]
        point, camera = np.nonzero((rows["blobs"] >= 0) & own.named[:, None])
        found, at = Labels.none(blobs), rows["blobs"][point, camera]
        found.marker[at], found.step[at], found.confidence[at] = (
            column[point] for column in (own.marker, own.step, own.confidence)
        )
        return found

    def rows_of(self, index: int, points: np.ndarray) -> np.ndarray:
        """(K,) the blobs of a chunk that make some of the points (T, L) of the take."""
        rows, lane = self._lasting(self.parts[index])
        blobs = rows["blobs"][points[rows["frame"], lane]]
        return blobs[blobs >= 0]

    def _lasting(self, part: PointsOfChunk) -> tuple[np.ndarray, np.ndarray]:
        """The points of a chunk that are in the take, and their lanes."""
        rows = part.rows[:]
        place = self.place[rows["trajectory"]]
        return rows[place >= 0], self.lanes.lane[place[place >= 0]]


def without_number(suspect: Suspect) -> Suspect:
    """A suspect without the numbers of trajectories, which are in no file here."""
    words = suspect.words
    if suspect.trajectory is not None:
        words = f"a trajectory of points {words}"
    elif words.startswith("trajectories "):
        as_one = words.partition(": as trajectory ")[2].partition(" ")[2]
        words = f"several trajectories of points, one of which {as_one}"
    return replace(suspect, words=words, trajectory=None)


VOTING_FRAMES = 1024  # whose trajectories vote together, so that memory does not grow with the take


def label_through_points(
    chunks: Iterable[Blobs], cameras: Cameras, model: Model, rate: float, options: PointOptions
) -> Iterator[LabelledChunk]:
    """Names the blobs of a take as `blobs.pipeline.label_take` does: a `LabelledChunk` for each chunk, in their order.

    About `VOTING_FRAMES` frames are named as a take of points. Where edits name blobs, the points that these make
    have their names, and `unedited` is what was labelled without.
    Raises JobError when there are fewer than two cameras, a frame has more blobs than any capture, or two subjects are
    there.
    """
    window: list[Blobs] = []
    for blobs in chunks:
        window.append(blobs)
        if sum(len(part.frames) for part in window) >= VOTING_FRAMES:
            yield from _labelled(window, cameras, model, rate, options)
            window = []
    if window:
        yield from _labelled(window, cameras, model, rate, options)


def _labelled(
    window: Sequence[Blobs], cameras: Cameras, model: Model, rate: float, options: PointOptions
) -> Iterator[LabelledChunk]:
    """The chunks of one window; nothing in them, and why, where nobody in the model's markers is there."""
    begin = perf_counter()
    points, named = PointsOfBlobs(cameras, rate), NamedThroughBlobs(options.edits, cameras.names, model.markerset)
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
