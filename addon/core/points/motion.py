# SPDX-License-Identifier: GPL-3.0-or-later
"""From named points to a moving body."""

from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import Bodies, BodyModel
from ..body.prior import Prior
from ..data.columns import Columns, beside_of
from ..data.lanes import PACKING, Lanes, blocks
from ..data.made import IN_MEMORY, Made, MakeTable, Table
from ..data.markersets import MarkerSet
from ..data.progress import finished
from ..data.takes import EditOutcome, LabelledChunk, Labels, Motion, PointRows, Points, Suspect, placed, places_of
from ..posing.posing import POSING, fit_in_steps, markers_there, subject_of
from ..review.suspects import doubtful_flags, suspects_of
from .tracklets import CUTTING

MAX_LEFTOVERS = 16_000  # columns of trajectories without a name: a C3D file has room for 16,320 with the markers
PART_FRAMES = 4096  # whose motion is worked out at once; by memory
# Which a subject's size and shape are taken from. With 12, 16, 24 or 40, bodies were as near to the markers of 11 takes
# (2.84 mm; 5.3 mm and 18.5 mm with a third and two thirds of them hidden).
SUBJECT_FRAMES = 16


def by_marker(values: Table, labels: Labels, markers: int, places: Mapping | None = None) -> Made:
    """What each of M markers has of the values (T, L, …) of a take's points, (T, M, …), of any frames as an array.

    labels (T, L) say which point is which, `places` where a person placed markers, by frame and marker.
    """
    count, shape = len(values), (len(values), markers, *values.shape[2:])

    def of(number: np.ndarray) -> np.ndarray:
        found = np.empty((len(number), *shape[1:]))
        for part in blocks(len(number), values.shape[1]):
            some = number[part]
            found[part] = placed(labels.marker[some], values[some], markers)
        for (frame, marker), place in (places or {}).items():
            found[number == frame, marker] = place
        return found

    if np.prod(shape) > PACKING.whole_cells:
        return Made(shape, lambda frames: of(np.arange(count)[frames]))
    whole = of(np.arange(count))  # of a short take all is asked for several times
    return Made(shape, lambda frames: whole[frames].copy())


@dataclass(frozen=True, eq=False)
class MotionInParts(ABC):
    """The named markers of a take and who is posed on them, of which parts are worked out when they are asked for."""

    markers: Table  # (T, M, 3) m and
    residual: Table  # (T, M) m, NaN where one is not
    frames: np.ndarray  # (T,) the source's numbers

    def __len__(self) -> int:
        return len(self.frames)

    @abstractmethod
    def part(self, frames: slice) -> Motion:
        """The motion in the frames from start to stop."""

    @abstractmethod
    def suspects(self, names: tuple[str, ...], rate: float) -> tuple[Suspect, ...]:
        """Ranges of frames in which a marker is doubtful, as `review.suspects.find_suspects` finds them."""

    def parts(self) -> Iterator[slice]:
        """The take part by part."""
        for start in range(0, len(self), PART_FRAMES):
            yield slice(start, min(start + PART_FRAMES, len(self)))


@dataclass(frozen=True, eq=False)
class TakeMotion(MotionInParts):
    """The motion of one subject."""

    labels: Labels  # (T, L) of the points
    model: BodyModel
    bodies: Bodies  # T of them, NaN where there is none

    def part(self, frames: slice) -> Motion:
        """The motion in the frames from start to stop."""
        bodies, labels = self.bodies.pick(frames), self.labels[frames]
        found = np.isfinite(bodies.translation).all(axis=1)
        expected, joints, turns, scale = _posed(self.model, bodies, found)
        named = labels.named
        mean = np.where(named, labels.confidence, 0).sum(axis=1) / np.maximum(named.sum(axis=1), 1)
        shape = len(found), self.markers.shape[1]
        nothing, conflicts = np.full(shape, np.nan), np.zeros(shape, int)
        own = self.frames[frames], self.markers[frames], self.residual[frames]
        return Motion(*own, nothing, conflicts, expected, joints, turns, scale, np.where(found, mean, 0.0))

    def suspects(self, names: tuple[str, ...], rate: float) -> tuple[Suspect, ...]:
        """What is doubtful of it."""
        flags: list[list[np.ndarray]] = []
        for part in self.parts():
            # A jump is seen by the frames before and after.
            wide = slice(max(part.start - 1, 0), min(part.stop + 1, len(self)))
            own = slice(part.start - wide.start, part.stop - wide.start)
            flags.append([one[own] for one in doubtful_flags(self.part(wide), rate)])
        off_body, jumps = map(np.concatenate, zip(*flags, strict=True))
        return suspects_of(off_body, jumps, self.frames, names)


def take_motion(
    markers: Table,
    residual: Table,
    labels: Labels,
    markerset: MarkerSet,
    frames: np.ndarray,
    make_table: MakeTable = IN_MEMORY,
) -> Generator[float, None, TakeMotion]:
    """The named markers and the body posed on them.

    markers (T, M, 3) m and residual (T, M) m, NaN where one is not, by the labels (T, L); frames (T,) the source's
    numbers. Yields the share that is done; `make_table` says where the poses are kept.
    """
    model = BodyModel(markerset)
    if any(
        (np.isfinite(markers[part][..., 0]).sum(axis=1) >= POSING.min_markers).any()
        for part in blocks(*markers.shape[:2])
    ):
        bodies = yield from fit_in_steps(model, markers, Prior(model), SUBJECT_FRAMES, make_table)
    else:
        bodies = _nobody(model, len(markers))
    return TakeMotion(markers, residual, frames, labels, model, bodies)


def motion_of(
    markers: np.ndarray, residual: np.ndarray, labels: Labels, markerset: MarkerSet, frames: np.ndarray
) -> Motion:
    """All of a `take_motion`."""
    return finished(take_motion(markers, residual, labels, markerset, frames)).part(slice(0, len(frames)))


def _posed(model: BodyModel, bodies: Bodies, found: np.ndarray, at_once: int = 2000) -> tuple[np.ndarray, ...]:
    """Expected markers, joints, rotations and scale of all frames, `at_once` posed at a time; NaN where nobody was."""
    count, joints = len(found), model.joint_count
    shapes = ((model.marker_count, 3), (joints, 3), (joints, 3, 3), (3,))
    whole = [np.full((count, *shape), np.nan) for shape in shapes]
    at = np.flatnonzero(found)
    for first in range(0, len(at), at_once):
        frames = at[first : first + at_once]
        posed = model.pose(bodies.pick(frames))
        values = (posed.markers, posed.joints, posed.rotations, bodies.scale[frames])
        for array, value in zip(whole, values, strict=True):
            array[frames] = value
    return tuple(whole)


@dataclass(frozen=True, eq=False)
class PosedFrames:
    """A body in F frames, as `Motion` has it; NaN where there is none."""

    expected: np.ndarray
    joints: np.ndarray
    rotations: np.ndarray
    scale: np.ndarray


def posed_again(
    markers: np.ndarray, markerset: MarkerSet, frame: int
) -> Generator[PosedFrames | float, None, PosedFrames]:
    """The body posed on the markers (T, M, 3) m of one subject, as `take_motion` poses it, a little at a time.

    Yields first how it is in the frame of that index alone, for whoever looks at it, and then the share that is done.
    """
    model = BodyModel(markerset)
    there = markers_there(markers) >= POSING.min_markers
    prior, here = Prior(model), markers[frame : frame + 1]
    subject = subject_of(model, markers, prior, SUBJECT_FRAMES) if there.any() else None
    yield posed_as(model, here, prior, subject)
    if subject is None:
        return posed_as(model, markers, prior, None)
    return _frames_of(model, (yield from fit_in_steps(model, markers, prior, subject=subject)))


def posed_as(model: BodyModel, markers: np.ndarray, prior: Prior, subject: Bodies | None) -> PosedFrames:
    """One subject posed on its markers (F, M, 3) m; nobody is in frames with too few of them, and where it is None."""
    if subject is None:
        return _frames_of(model, _nobody(model, len(markers)))
    return _frames_of(model, finished(fit_in_steps(model, markers, prior, subject=subject)))


def _frames_of(model: BodyModel, bodies: Bodies) -> PosedFrames:
    return PosedFrames(*_posed(model, bodies, np.isfinite(bodies.translation).all(axis=1)))


def _nobody(model: BodyModel, frames: int) -> Bodies:
    """Bodies of so many frames in which nobody was found."""
    nobody = model.rest(frames, 1.0)
    return replace(nobody, translation=np.full_like(nobody.translation, np.nan))


@dataclass(frozen=True, eq=False)
class LabelledPoints:
    """What the labelling says of a take of points; `LabelledChunk` with the motion part by part.

    labels (T, L) and `unedited` are by lanes; suspects, seconds and outcomes are those of all of it. `doubts` are those
    of the suspects that the motion alone shows, as `MotionInParts.suspects` has them, before they are put together.
    """

    labels: Labels
    motion: MotionInParts
    suspects: tuple[Suspect, ...]
    seconds: dict[str, float]
    unedited: Labels | None
    outcomes: tuple[EditOutcome, ...]
    doubts: tuple[Suspect, ...]

    def whole(self) -> LabelledChunk:
        """All of it at once."""
        motion = self.motion.part(slice(0, len(self.motion)))
        return LabelledChunk(self.labels, motion, self.suspects, self.seconds, self.unedited, self.outcomes)

    def part(self, take: Points, frames: slice) -> tuple[PointRows, LabelledChunk]:
        """Some frames as label files have them: rows, and what is said of each; the first ones say what all of it took.

        Suspects are with the part in which they begin.
        """
        at = places_of(take, frames)
        rows, motion = PointRows.at(take, frames, *at), self.motion.part(frames)
        first, last = int(motion.frames[0]), int(motion.frames[-1])
        own = tuple(one for one in self.suspects if first <= one.first <= last)
        unedited = None if self.unedited is None else self.unedited[frames][at]
        once = (self.seconds, unedited, self.outcomes) if not frames.start else ({}, unedited, ())
        return rows, LabelledChunk(self.labels[frames][at], motion, own, *once)


def labelled_points(take: Points, labelled: LabelledPoints, markerset: MarkerSet) -> Points:
    """A labelled take as points: the model's markers in its order, then what stays unlabelled.

    Each trajectory has a column; where a file has no room for so many, some have one with long gaps between them.
    """
    motion, standing = labelled.motion, take.standing
    left = take.present & ~labelled.labels.named
    there = [(number, np.flatnonzero(left[span, lane]) + span.start) for number, span, lane in standing.each_alone()]
    spans = [(number, int(frames[0]), int(frames[-1])) for number, frames in there if len(frames)]
    number, first, last = np.array(spans, int).reshape(-1, 3).T
    place = np.arange(len(number))
    if len(number) > MAX_LEFTOVERS:
        place = Lanes.packed(first, last + round(2 * CUTTING.max_gap_s * take.rate)).lane
    column = np.full(len(standing), -1)
    column[number] = len(markerset) + place
    names = (*markerset.markers, *[""] * (int(place.max(initial=-1)) + 1))
    own = np.arange(len(markerset))
    xyz, residual = (
        Columns(markers, own, len(names), beside_of(take, values, column, left))
        for markers, values in ((motion.markers, take.xyz), (motion.residual, take.residual))
    )
    return Points(names, xyz, residual, take.rate, take.first_frame)
