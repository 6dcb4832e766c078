# SPDX-License-Identifier: GPL-3.0-or-later
"""What goes into the labelling and what comes out of it: blobs, points, labels and the motion of the markers."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from .lanes import Lanes, blocks, standing_in, trajectories_at
from .made import Made, Table

MEDIAN_SD = 1.4826  # a normal distribution's standard deviation is so many medians of its absolute deviations
# How a blob or a point came by its name, in the words of label files: the three steps of the first paper's algorithm 1,
# then what names points, then a person. The index is what `Labels.step` holds.
STEPS = ("", "exclusive", "conflict", "remaining", "evidence", "ensemble", "fit", "trajectory", "edit")
NO_STEP, EXCLUSIVE, CONFLICT, REMAINING, BY_LIKELIHOOD, BY_PARTIAL_SOLVERS, BY_FIT, BY_TRAJECTORY, BY_EDIT = range(
    len(STEPS)
)
NO_MARKER = NO_POINT = -1
LABEL_COLUMNS = ("marker", "step", "confidence")

# C3D files count frames no further than this, and blob files neither.
MAX_FRAME = 2**32 - 1
# Frames a second that every kind of file can hold.
MIN_RATE_HZ, MAX_RATE_HZ = 1e-6, 1e6


@dataclass(frozen=True, eq=False)
class Blobs:
    """The blobs of F consecutive frames of a take, N in all, in the order of their file.

    frames  (F,) the source's own frame numbers, ascending; a frame without blobs is in the list too
    frame   (N,) index into `frames`
    camera  (N,) index of the camera
    xy      (N, 2) px, lens included
    area    (N,) px², NaN where unknown
    """

    frames: np.ndarray
    frame: np.ndarray
    camera: np.ndarray
    xy: np.ndarray
    area: np.ndarray

    @classmethod
    def join(cls, chunks: Iterable[Self]) -> Self:
        """Consecutive chunks of a take as one; none make a take without frames."""
        nothing = cls(np.empty(0, int), np.empty(0, int), np.empty(0, int), np.empty((0, 2)), np.empty(0))
        parts = [nothing, *chunks]
        before = np.cumsum([0, *(len(part.frames) for part in parts)])
        return cls(
            np.concatenate([part.frames for part in parts]),
            np.concatenate([part.frame + first for part, first in zip(parts, before[:-1], strict=True)]),
            *(np.concatenate([getattr(part, name) for part in parts]) for name in ("camera", "xy", "area")),
        )

    def __len__(self) -> int:
        return len(self.frame)

    def between(self, first: int, last: int) -> Self:
        """Those of the frames from `first` to `last`, both included, by the source's numbers."""
        low, high = np.searchsorted(self.frames, [first, last + 1])
        return self.part(slice(low, high), (self.frame >= low) & (self.frame < high))

    def part(self, frames: slice, rows: slice | np.ndarray) -> Self:
        """Those of frames from start to stop, by their index; `rows` are theirs, by any index that arrays take."""
        own = self.frame[rows] - frames.start, self.camera[rows], self.xy[rows], self.area[rows]
        return type(self)(self.frames[frames], *own)


@dataclass(frozen=True, eq=False)
class Labels:
    """The names of blobs or of points: arrays of one shape, N rows or P trajectories over T frames."""

    marker: np.ndarray  # index into the marker set's markers, NO_MARKER where unnamed
    step: np.ndarray  # index into STEPS, NO_STEP where unnamed
    confidence: np.ndarray  # 0 to 1; 0 where unnamed
    rate: np.ndarray | None = None  # the part of labels like this one that is right, where that was measured; else None

    @property
    def measured_rate(self) -> np.ndarray:
        """The rate; 0 where it was not measured."""
        return np.zeros(self.marker.shape) if self.rate is None else self.rate

    @classmethod
    def none(cls, *shape: int) -> Self:
        """Nothing named."""
        return cls(np.full(shape, NO_MARKER, np.int16), np.full(shape, NO_STEP, np.int8), np.zeros(shape))

    @classmethod
    def join(cls, parts: Iterable[Self]) -> Self:
        """Several parts one after the other."""
        whole = tuple(parts)
        rates = [part.rate for part in whole if part.rate is not None]
        marker, step, sure = (np.concatenate([getattr(part, name) for part in whole]) for name in LABEL_COLUMNS)
        return cls(marker, step, sure, np.concatenate(rates) if len(rates) == len(whole) else None)

    def __getitem__(self, index) -> Self:
        """Some of the labels, by any index that arrays take."""
        rate = None if self.rate is None else self.rate[index]
        return type(self)(self.marker[index], self.step[index], self.confidence[index], rate)

    def put(self, index, other: Self) -> None:
        """Writes the labels of `other` over some of these, by any index that arrays take."""
        for name in LABEL_COLUMNS if self.rate is None else (*LABEL_COLUMNS, "rate"):
            getattr(self, name)[index] = getattr(other, name)

    def whole(self) -> Self:
        """All of the labels, as whatever gives some of them when it is asked has them."""
        return self

    @property
    def named(self) -> np.ndarray:
        """True where there is a name."""
        return self.marker != NO_MARKER

    def kept(self, where: np.ndarray) -> Self:
        """The same names where `where` is True, and none elsewhere."""
        rate = None if self.rate is None else np.where(where, self.rate, 0.0)
        return type(self)(
            np.where(where, self.marker, NO_MARKER),
            np.where(where, self.step, NO_STEP),
            np.where(where, self.confidence, 0.0),
            rate,
        )

    def replaced(self, where: np.ndarray, other: Self) -> Self:
        """The labels of `other` where `where` is True, and these elsewhere; without rates."""
        return type(self)(*(np.where(where, getattr(other, name), getattr(self, name)) for name in LABEL_COLUMNS))

    def placed(self, points: np.ndarray, markers: int) -> np.ndarray:
        """(T, M, …), what each of M markers has of points (T, P, …) with these labels (T, P); NaN where none is."""
        return placed(self.marker, points, markers)

    def sure(self, target: float) -> np.ndarray:
        """The markers to accept so that a part `target` of them is right, NO_MARKER elsewhere."""
        return np.where(self.measured_rate >= target, self.marker, NO_MARKER)


def placed(marker: np.ndarray, points: np.ndarray, markers: int) -> np.ndarray:
    """(T, M, …), what each of M markers has of points (T, P, …) that are these markers (T, P); NaN where none is."""
    found = np.full((len(points), markers, *points.shape[2:]), np.nan)
    for part in blocks(*marker.shape):
        frame, column = np.nonzero(marker[part] != NO_MARKER)
        found[part][frame, marker[part][frame, column]] = points[part][frame, column]
    return found


def touched_samples(blobs: Blobs, before: Labels, after: Labels, shape: tuple[int, int]) -> np.ndarray:
    """(T, M) True where a marker has other blobs than before."""
    found = np.zeros(shape, bool)
    changed = np.flatnonzero(before.marker != after.marker)
    for labels in (before, after):
        named = changed[labels.marker[changed] != NO_MARKER]
        found[blobs.frame[named], labels.marker[named]] = True
    return found


@dataclass(frozen=True, eq=False)
class Motion:
    """The person in F frames: the markers in space and the pose of the fitted body."""

    frames: np.ndarray  # (F,) the source's own frame numbers
    markers: np.ndarray  # (F, M, 3) m, triangulated from two or more cameras; NaN in gaps
    residual: np.ndarray  # (F, M) how far the rays of a marker's blobs miss its point, root mean square, m
    residual_px: np.ndarray  # (F, M) the same as reprojection error, px
    conflicts: np.ndarray  # (F, M) number of blobs of the marker that were in conflict
    expected: np.ndarray  # (F, M, 3) m, where the fitted body carries each marker, seen or not
    joints: np.ndarray  # (F, J, 3) m, positions of the skeleton's joints
    rotations: np.ndarray  # (F, J, 3, 3) world rotation of each segment; the identity is the rest pose
    # (F, 3) S of the paper's equation 6: m for one unit of the marker set, along x y z; (F, 3 K) of K subjects side
    # by side, as their markers and joints are
    scale: np.ndarray
    confidence: np.ndarray  # (F,) 0 to 1, how sure the placement is; 0 where nobody was found (poses are NaN there)


@dataclass(frozen=True)
class Suspect:
    """A range of frames (the source's numbers, both included) that a person should look at, and why."""

    first: int
    last: int
    words: str  # what is the matter; of one trajectory only what it does, such as "goes over from A to B"
    trajectory: int | None = None  # the number of that trajectory, None where it is about something else
    # the names of the markers that it is about, where it is about some
    markers: tuple[str, ...] = field(default=(), compare=False)
    doubtful: int | None = field(default=None, compare=False)  # in how many frames of the range, None for all of them

    @property
    def frames(self) -> int:
        """In how many frames there is something to look at."""
        return self.last - self.first + 1 if self.doubtful is None else self.doubtful

    @property
    def reason(self) -> str:
        """Why to look, for a person to read."""
        return self.words if self.trajectory is None else f"trajectory {self.trajectory} {self.words}"


@dataclass(frozen=True, eq=False)
class Verdict:
    """What is said of the points of a take: their labels (T, P), and what a person should look at."""

    labels: Labels
    suspects: tuple[Suspect, ...] = ()


@dataclass(frozen=True)
class EditOutcome:
    """What became of an edit of that kind: how many labels or frames it is about, and where that is none, why."""

    kind: str
    labels: int
    reason: str = ""


@dataclass(frozen=True, eq=False)
class LabelledChunk:
    """What the labelling says of a chunk of blobs, or of a take of points.

    labels    row for row with the blobs, or (T, P) like the points
    motion    frame for frame
    suspects  what a person should look at
    seconds   time by stage
    unedited  what the program itself says, of which the take's edits give the labels; None where there are no edits
    outcomes  what became of each edit
    """

    labels: Labels
    motion: Motion
    suspects: tuple[Suspect, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    unedited: Labels | None = None
    outcomes: tuple[EditOutcome, ...] = ()


def summed(one: dict[str, float], other: dict[str, float]) -> dict[str, float]:
    """The seconds of two labellings by stage, as `LabelledChunk.seconds` has them."""
    return {stage: one.get(stage, 0.0) + other.get(stage, 0.0) for stage in {**one, **other}}


def part_of_take(first: int, last: int, first_frame: int) -> slice:
    """What of a take that begins with `first_frame` is in the frames from the first to the last, both included."""
    return slice(max(first - first_frame, 0), max(last + 1 - first_frame, 0))


def rows_in_frame(rows: "Blobs | PointRows", index: int) -> slice:
    """Which rows of a take, in the order of its frames, are of frame `index`."""
    return slice(*np.searchsorted(rows.frame, [index, index + 1]).tolist())


@dataclass(frozen=True, eq=False)
class Points:
    """A take of 3D points: P trajectories over T frames, in L lanes that several may share one after the other.

    names        P labels as in the file; an unlabelled trajectory has an empty name
    xyz          (T, L, 3) m, z up; NaN where missing; an array, or what makes parts of one
    residual     (T, L) m, NaN where missing or unknown, 0 where a sample was filled and not measured; likewise
    rate         frames a second
    first_frame  the source's number of the first frame
    columns      (P,) the index of each trajectory in its file, what label files call `point`; None where there is none
    lanes        which trajectory stands where; None where each has a lane of its own, in their order
    """

    names: tuple[str, ...]
    xyz: Table
    residual: Table
    rate: float
    first_frame: int
    columns: np.ndarray | None = None
    lanes: Lanes | None = None

    @property
    def frames(self) -> np.ndarray:
        """(T,) the source's frame numbers."""
        return self.first_frame + np.arange(len(self.xyz))

    @property
    def present(self) -> np.ndarray:
        """(T, L) True where there is a point."""
        return there_in(self.xyz)

    @property
    def standing(self) -> Lanes:
        """Which trajectory stands where, whoever has a lane to itself."""
        return standing_in(self.lanes, self.xyz.shape)

    def numbers(self, trajectory: np.ndarray) -> np.ndarray:
        """(N,) the indices in the file of trajectories (N,), by their places in `names`."""
        return trajectory if self.columns is None else self.columns[trajectory]

    def picked(self, trajectories: Sequence[int]) -> "Points":
        """Some trajectories, by their places in `names`, each in a lane of its own; -1 is one that is nowhere."""
        chosen = np.asarray(trajectories, dtype=int)
        names = tuple(self.names[index] if index >= 0 else "" for index in chosen.tolist())
        if self.lanes is None:
            there = (chosen >= 0)[:, None]
            xyz = np.where(there, self.xyz[:, chosen], np.nan)
            residual = np.where(there[:, 0], self.residual[:, chosen], np.nan)
            return Points(names, xyz, residual, self.rate, self.first_frame)
        shape = len(self.xyz), len(chosen)
        xyz, residual = np.full((*shape, 3), np.nan), np.full(shape, np.nan)
        for place, index in enumerate(chosen.tolist()):
            if index >= 0:
                own = slice(self.lanes.first[index], self.lanes.last[index] + 1)
                xyz[own, place] = self.xyz[own, self.lanes.lane[index]]
                residual[own, place] = self.residual[own, self.lanes.lane[index]]
        return Points(names, xyz, residual, self.rate, self.first_frame)

    def ordered(self, frames: np.ndarray) -> Made:
        """(F, W, 3) m, the points of some frames (F,), each in the order of the file, made of those asked for."""
        return Made((len(frames), *self.xyz.shape[1:]), lambda index: self.in_order(frames[index]).xyz)

    def in_order(self, frames: np.ndarray) -> "InOrder":
        """Some frames (F,), ascending, with the points of each in the order of the file."""
        if self.lanes is None:
            return InOrder(self.xyz[frames], None, self.xyz.shape[1])
        count, parts = np.zeros(len(frames), int), []
        for part in blocks(len(self.xyz), self.xyz.shape[1]):
            own = slice(*np.searchsorted(frames, [part.start, part.stop]).tolist())
            if own.stop > own.start:
                lane, count[own] = _ordered(self, part, frames[own] - part.start)
                parts.append((own, lane))
        lane = np.full((len(frames), max(int(count.max(initial=0)), 1)), -1, np.int32)
        xyz = np.full((*lane.shape, 3), np.nan)
        for own, order in parts:
            width = min(order.shape[1], lane.shape[1])
            there = np.arange(width) < count[own, None]
            lane[own, :width] = np.where(there, order[:, :width], -1)
            at = frames[own, None], order[:, :width]
            xyz[own, :width] = np.where(there[..., None], self.xyz[at], np.nan)
        return InOrder(xyz, lane, self.xyz.shape[1])


def _ordered(take: Points, part: slice, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(F, L) the lanes of some frames of a part, those first that have a point, by trajectory; and how many (F,)."""
    present = np.isfinite(take.xyz[part][frames]).all(axis=2)
    standing = take.standing
    number = np.where(present, standing.table(part)[frames], len(standing))
    return np.argsort(number, axis=1, kind="stable").astype(np.int32), present.sum(axis=1)


@dataclass(frozen=True, eq=False)
class InOrder:
    """Points of F frames in the order of their file, whatever lanes they stand in: names hang on none."""

    xyz: np.ndarray  # (F, W, 3) m, NaN behind the last of a frame
    lane: np.ndarray | None  # (F, W) of each, -1 behind the last; None where lanes are in that order
    lanes: int  # how many lanes there are

    def of(self, values: np.ndarray) -> np.ndarray:
        """Values (F, L) by lanes, (F, W) as the points are; what is behind the last of a frame says nothing."""
        return values if self.lane is None else np.take_along_axis(values, np.maximum(self.lane, 0), axis=1)

    def labels(self, given: Labels) -> Labels:
        """Labels (F, W) of the points, (F, L) by lanes."""
        if self.lane is None:
            return given
        found, rate = Labels.none(len(self.xyz), self.lanes), None
        at = np.nonzero(given.named)
        to = at[0], self.lane[at]
        for name in LABEL_COLUMNS:
            getattr(found, name)[to] = getattr(given, name)[at]
        if given.rate is not None:
            rate = np.zeros(found.marker.shape)
            rate[to] = given.rate[at]
        return replace(found, rate=rate)


@dataclass(frozen=True, eq=False)
class PointRows:
    """The points of F frames, N in all, one after the other as label files have them."""

    frames: np.ndarray  # (F,) the source's own frame numbers
    frame: np.ndarray  # (N,) index into `frames`
    trajectory: np.ndarray  # (N,) the index of the point's trajectory in its file
    xyz: np.ndarray  # (N, 3) m
    residual: np.ndarray | None  # (N,) m, NaN where unknown; None where nobody kept it

    def __len__(self) -> int:
        return len(self.frame)

    @classmethod
    def of(cls, take: Points, frames: slice | None = None) -> Self:
        """All points of a take that are there, or those of some frames from start to stop; frame by frame."""
        part = slice(0, len(take.xyz)) if frames is None else frames
        return cls.at(take, part, *places_of(take, part))

    @classmethod
    def at(cls, take: Points, part: slice, frame: np.ndarray, lane: np.ndarray) -> Self:
        """Points of the frames from start to stop, by frame from there on and lane (N,) of each."""
        number = trajectories_at(take.lanes, frame + part.start, lane)
        own = take.xyz[part.start + frame, lane], take.residual[part.start + frame, lane]
        return cls(take.frames[part], frame, take.numbers(number), *own)


def places_of(take: Points, part: slice) -> tuple[np.ndarray, np.ndarray]:
    """Frame from the start of a part on and lane (N,) of all points that are there, in the order of label files."""
    if take.lanes is None:
        row, column = np.nonzero(np.isfinite(take.xyz[part]).all(axis=2))
        return row, column
    found = [(np.zeros(0, int), np.zeros(0, int))]
    for block in blocks(part.stop - part.start, take.xyz.shape[1]):
        own = slice(part.start + block.start, part.start + block.stop)
        order, count = _ordered(take, own, np.arange(own.stop - own.start))
        frame, place = np.nonzero(np.arange(order.shape[1]) < count[:, None])
        found.append((frame + block.start, order[frame, place].astype(int)))
    return np.concatenate([frame for frame, _ in found]), np.concatenate([lane for _, lane in found])


def there_in(points: Table) -> np.ndarray:
    """(T, L) True where there is one of points (T, L, 3), NaN where missing."""
    found = np.empty(points.shape[:2], bool)
    for part in blocks(*found.shape):
        found[part] = np.isfinite(points[part]).all(axis=2)
    return found


def evenly_spread(count: int, most: int) -> np.ndarray:
    """(N,) the indices of `most` of `count` frames, or of all if there are fewer, from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int))
