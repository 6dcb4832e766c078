# SPDX-License-Identifier: GPL-3.0-or-later
"""A take's gaps filled, the shortest first, with the mean error to expect of each."""

from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from ..data.markersets import MarkerSet
from ..data.progress import Progress, within
from ..data.takes import evenly_spread
from ..data.wording import count_of
from . import plain
from .gaps import Gap, KnownMarkers, find_gaps, find_strays
from .kept import KeptFill
from .plain import FittedSubject
from .rays import NO_RAYS, MarkerRays, constrained
from .regression import MEAN_OF_DISTANCE, MarkerModel, learned, neighbours_of, regress

# In the order of the command line; "auto" takes the first of IN_TURN whose error to expect is allowed. Measured: to try
# all of them on gaps cut into the take, and take the best, errs as much on six takes.
FILL_METHODS = ("auto", "spline", "rigid", "pattern", "pca", "body", "regression")
IN_TURN = ("regression", "pca", "body", "spline")
PLAIN = {"rigid": plain.rigid, "pca": plain.pca, "spline": plain.spline, "pattern": plain.pattern}
TRIALS = 4  # gaps cut into the take to see how a method errs that does not say it itself


@dataclass(frozen=True)
class FillOptions:
    """How gaps are filled."""

    method: str = "auto"  # one of FILL_METHODS
    max_gap: int | None = None  # frames of the longest gap to fill; None for any
    markers: tuple[int, ...] | None = None  # indices of the markers to fill; None for all
    frame: int | None = None  # index of a frame that is in every gap to fill; None for gaps anywhere
    # a gap is left where the error to expect is larger, m: the motion would not be the subject's
    max_off_m: float = 0.1  # physical
    max_open_m: float = 0.03  # physical: the same at an end of the take, where nothing is measured on the far side

    def asks_for(self, gap: Gap) -> bool:
        """Whether a gap is one of those to fill."""
        here = self.frame is None or gap.start <= self.frame < gap.stop
        return here and (self.markers is None or gap.marker in self.markers)


@dataclass(frozen=True)
class FilledGap:
    """A gap that was filled, by which method, and the mean error to expect, m; NaN where no trial could say.

    `ends` says whether the marker was measured right before and right after.
    """

    gap: Gap
    method: str
    expected: float
    ends: tuple[bool, bool] = (True, True)


@dataclass(frozen=True)
class LeftGap:
    """A gap that was not filled, and why, for a person to read."""

    gap: Gap
    reason: str


@dataclass(frozen=True, eq=False)
class FilledTake:
    """A take whose gaps were filled."""

    xyz: np.ndarray  # (T, M, 3) m; measured samples as they were
    filled: np.ndarray  # (T, M) True where a sample was filled
    gaps: tuple[FilledGap, ...]  # that were filled, in the order of the markers and of time; so is what was left
    left: tuple[LeftGap, ...]


def fill_take(
    xyz: np.ndarray,
    rate: float,
    options: FillOptions,
    markerset: MarkerSet | None = None,
    columns: np.ndarray | None = None,
    rays: MarkerRays = NO_RAYS,
) -> Generator[float, None, FilledTake]:
    """Fills the gaps of named markers (T, M, 3) m, NaN where missing; yields the share of the work that is done.

    With a `markerset` its body fills too; `columns` are the take's indices of its markers, -1 where it has none.
    Without one the method "body" leaves all gaps. `rays` of cameras that see a marker alone constrain what is filled.
    """
    filler = _Filler(xyz, rate, options, markerset, columns, rays)
    gaps = find_gaps(np.isfinite(xyz[..., 0]))
    wanted = [gap for gap in gaps if options.asks_for(gap)]
    done, whole = 0, sum(_cost(gap) for gap in wanted)
    with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
        for gap in wanted:
            yield done / whole
            filler.fill(gap)
            done += _cost(gap)
    return filler.outcome()


@dataclass(frozen=True, eq=False)
class SubjectMarkers:
    """Which of a take's markers are one subject's, (K,), and the set that is worn, if it is known."""

    own: np.ndarray
    markerset: MarkerSet | None = None
    columns: np.ndarray | None = None  # (M,) the places in `own` of the set's markers, -1 where the take has none

    @classmethod
    def side_by_side(cls, worn: Iterable[MarkerSet]) -> "list[SubjectMarkers]":
        """Those of subjects whose sets' markers stand in a row, one set after the other."""
        found, first = [], 0
        for markerset in worn:
            own = np.arange(len(markerset))
            found.append(cls(first + own, markerset, own))
            first += len(own)
        return found


def fill_subjects(
    xyz: np.ndarray, rate: float, options: FillOptions, subjects: Sequence[SubjectMarkers], rays: MarkerRays = NO_RAYS
) -> Generator[Progress, None, FilledTake]:
    """The same of the markers (T, M, 3) m of several subjects, each by itself: no body moves as another."""
    whole, filled, gaps, left = xyz.copy(), np.zeros(xyz.shape[:2], bool), [], []
    for number, one in enumerate(subjects):
        place = {int(marker): index for index, marker in enumerate(one.own)}
        asked = options.markers and tuple(place[marker] for marker in options.markers if marker in place)
        rays_used = rays.pick(np.isin(rays.marker, one.own))
        rays_used = replace(rays_used, marker=np.array([place[marker] for marker in rays_used.marker.tolist()], int))
        given = rate, replace(options, markers=asked), one.markerset, one.columns, rays_used
        ends = number / len(subjects), (number + 1) / len(subjects)
        found = yield from within(fill_take(xyz[:, one.own], *given), *ends, "fill gaps")
        whole[:, one.own], filled[:, one.own] = found.xyz, found.filled
        gaps += [replace(gap, gap=replace(gap.gap, marker=int(one.own[gap.gap.marker]))) for gap in found.gaps]
        left += [replace(gap, gap=replace(gap.gap, marker=int(one.own[gap.gap.marker]))) for gap in found.left]
    return FilledTake(whole, filled, tuple(sorted(gaps, key=_place)), tuple(sorted(left, key=_place)))


def kept_fills_of(filled: FilledTake, names: Sequence[str], frames: np.ndarray) -> tuple[KeptFill, ...]:
    """What was filled of a take of these markers, whose frames (T,) have these numbers in the source."""
    padded = np.pad(filled.xyz, ((1, 1), (0, 0), (0, 0)), constant_values=np.nan)
    made = []
    for one in filled.gaps:
        path = padded[one.gap.start : one.gap.stop + 2, one.gap.marker].copy()
        first, last = int(frames[one.gap.start]), int(frames[one.gap.stop - 1])
        made.append(KeptFill(names[one.gap.marker], first, last, one.method, one.expected, path))
    return tuple(made)


def _cost(gap: Gap) -> int:
    """What a gap takes, in the same unit for all."""
    return 200 + len(gap)


class _Filler:
    """What is kept from gap to gap."""

    def __init__(
        self,
        xyz: np.ndarray,
        rate: float,
        options: FillOptions,
        markerset: MarkerSet | None,
        columns: np.ndarray | None,
        rays: MarkerRays,
    ):
        self.xyz, self.rate, self.options, self.rays = xyz, rate, options, rays
        self.strays, self.jumps = find_strays(np.asarray(xyz, dtype=float), rate)
        self.take = KnownMarkers(np.where(self.strays[..., None], np.nan, xyz))
        self.measured = self.take.known
        known = None if markerset is None or columns is None else (markerset, columns)
        self.fitted_subject = None if known is None else FittedSubject.of(*known, self.take)
        self.done: list[FilledGap] = []
        self.left: list[LeftGap] = []
        self.models: dict[tuple[int, ...], MarkerModel | None] = {}
        self.scales: dict[int, np.ndarray] = {}

    def outcome(self) -> FilledTake:
        """What became of the take."""
        xyz = np.where(self.strays[..., None], self.xyz, self.take.xyz)
        gaps, left = tuple(sorted(self.done, key=_place)), tuple(sorted(self.left, key=_place))
        return FilledTake(xyz, self.take.length > 0, gaps, left)

    def fill(self, gap: Gap):
        """Fills a gap, or notes why it is left."""
        if self.options.max_gap is not None and len(gap) > self.options.max_gap:
            reason = f"is longer than {count_of(self.options.max_gap, 'frame')}"
        else:
            reason = self._beyond_reach(gap) or self._fill_in_turn(gap)
        if reason:
            self.left.append(LeftGap(gap, reason))

    def _fill_in_turn(self, gap: Gap) -> str:
        """Fills a gap by the first method whose error to expect is allowed; gives why there is none."""
        own, least = self.measured[:, gap.marker], np.inf
        open_ended = gap.start == 0 or gap.stop == len(own)
        limit = self.options.max_open_m if open_ended else self.options.max_off_m
        for method, path, expected in self._paths(gap, own):
            path, expected, rays_used = constrained(path, gap, expected, self.rays, own, self.rate)
            if not expected > limit:
                self.take.put(gap, path)
                ends = gap.start > 0, gap.stop < len(own)
                self.done.append(FilledGap(gap, f"{method}+ray" if rays_used else method, expected, ends))
                return ""
            least = min(least, expected)
        if np.isinf(least):
            return self._why_not(gap, own)
        where = " at an end of the take" if open_ended else ""
        return f"would be off by {1000 * least:.0f} mm, where {1000 * limit:.0f} mm are allowed{where}"

    def _beyond_reach(self, gap: Gap) -> str:
        """Why nothing is drawn between the ends of a gap: one is no sample of the marker, by how far away it is."""
        path, ends = self.xyz[:, gap.marker], [gap.start - 1, gap.stop]
        for end, side in zip(ends, ("before", "after"), strict=True):
            if 0 <= end < len(path) and self.strays[end, gap.marker]:
                others = np.flatnonzero(self.measured[:, gap.marker])
                off = np.linalg.norm(path[end] - path[others[np.abs(others - end).argmin()]])
                return (
                    f"rests on a stray point: what is right {side} it is {off:.2f} m from where the marker is otherwise"
                )
        if gap.stop < len(path) and self.jumps[gap.stop, gap.marker] and gap.start > 0:
            off = np.linalg.norm(path[gap.stop] - path[gap.start - 1])
            room = count_of(len(gap), "frame")
            return f"has ends {off:.2f} m apart, too far for its {room}: one of them is named wrongly"
        return ""

    def _paths(self, gap: Gap, own: np.ndarray) -> Iterator[tuple[str, np.ndarray, float]]:
        """What each method says in its turn: its name, the path (L, 3) m, and the mean error to expect of it, m."""
        neighbours, asked = neighbours_of(self.take, gap, own), self.options.method
        for method in IN_TURN if asked == "auto" else (asked,):
            if method == "regression":
                model = self._model(gap.marker, neighbours)
                answer = None if model is None else regress(self.take, gap, model, own, self.rate)
                if answer is not None:
                    yield method, answer[0], MEAN_OF_DISTANCE * float(answer[1].mean())
                continue
            path = self._carried(method, gap, neighbours, own)
            expected = np.nan if path is None else self._error_of(method, gap, neighbours, own)
            if path is not None and (np.isfinite(expected) or asked == method):
                yield method, path, expected

    def _carried(self, method: str, gap: Gap, neighbours: np.ndarray, own: np.ndarray) -> np.ndarray | None:
        """The path (L, 3) m by a method that does not say how sure it is; None where a part of it is no number."""
        if method == "body":
            path = None if self.fitted_subject is None else self.fitted_subject.fill(self.take, gap, own)
        else:
            path = PLAIN[method](self.take, gap, neighbours, own)
        return path if path is not None and np.isfinite(path).all() else None

    def _error_of(self, method: str, gap: Gap, neighbours: np.ndarray, own: np.ndarray) -> float:
        """m, mean error of a method on gaps cut where it and neighbours are known; NaN where there is room for none."""
        there = own & np.isfinite(self.take.xyz[:, neighbours, 0]).all(axis=1)
        total, half = np.r_[0, np.cumsum(there)], max(len(gap) // 2, 1)
        # Where the marker is never there for so long: one of its samples with the gaps at both sides of it.
        for length, least in dict.fromkeys(((len(gap), len(gap)), (half, half), (2 * len(gap) + 1, 1))):
            inside = total[length + 1 : -1] - total[1 : -length - 1]
            starts = np.flatnonzero(there[: -length - 1] & there[length + 1 :] & (inside >= least)) + 1
            errors = []
            for start in starts[evenly_spread(len(starts), TRIALS)].tolist():
                trial, hidden = Gap(start, start + length, gap.marker), own.copy()
                # At no end that the real gap lacks is anything known in the trial.
                hidden[start - (gap.start == 0) : start + length + (gap.stop == len(own))] = False
                path = self._carried(method, trial, neighbours, hidden)
                if path is not None:
                    known = np.flatnonzero(own[trial.start : trial.stop])
                    truth = self.take.xyz[trial.start + known, gap.marker]
                    errors.append(float(np.linalg.norm(path[known] - truth, axis=1).mean()))
            if errors:
                return float(np.mean(errors))
        return np.nan

    def _model(self, marker: int, neighbours: np.ndarray) -> MarkerModel | None:
        """The regression of a marker on these neighbours, learned once."""
        key = (marker, *neighbours.tolist())
        if key not in self.models:
            own = self.measured[:, marker]
            model = learned(self.take, marker, neighbours, own, self.rate, self.scales.get(marker))
            self.models[key] = model
            if model is not None:
                self.scales.setdefault(marker, model.scales)
        return self.models[key]

    def _why_not(self, gap: Gap, own: np.ndarray) -> str:
        if self.options.method == "body" and self.fitted_subject is None:
            return "has no body to be filled by: that needs a model of these markers"
        if self.options.method == "spline" and (gap.start == 0 or gap.stop == len(own)):
            return "is at an end of the take, and a spline is not drawn beyond what was measured"
        return "has too little around it that is known: no method can be tried on it"


def _place(one: FilledGap | LeftGap) -> tuple[int, int]:
    return one.gap.marker, one.gap.start
