# SPDX-License-Identifier: GPL-3.0-or-later
"""A take's gaps filled, the shortest first, each by the method that errs least on gaps like it cut into the take."""

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from threadpoolctl import threadpool_limits

from ..data.markersets import MarkerSet
from . import plain
from .fitted import FittedSubject
from .gaps import LEARNED_BY, Gap, KnownMarkers, find_gaps, find_strays
from .kept import KeptFill
from .rays import NO_RAYS, MarkerRays, constrained
from .regression import MarkerModel, learned, neighbours_of, regress
from .trials import Answer, Choice, Way, choose, graded, pace_of, paces

# In the order of the command line; "auto" picks among all but itself. Those carry a marker by what moves with it.
FILL_METHODS = ("auto", "spline", "rigid", "pattern", "pca", "body", "regression")
PLAIN = {"rigid": plain.rigid, "pca": plain.pca, "spline": plain.spline, "pattern": plain.pattern}
FAVOURITE = "regression"  # what errs least by far, where no trial says otherwise
# Measured: with rigid and pattern among them gaps of six takes are filled as well (0.01 mm of 5.1), and slower.
TRIED = (FAVOURITE, "pca", "spline", "body")


@dataclass(frozen=True)
class FillOptions:
    """How gaps are filled.

    method      one of FILL_METHODS
    max_gap     frames of the longest gap to fill; None for any
    markers     indices of the markers to fill; None for all
    frame       index of a frame that is in every gap to fill; None for gaps anywhere
    max_off_m   physical: a gap is left where the error to expect is larger, m: the motion would not be the subject's
    max_open_m  physical: the same at an end of the take, where nothing is measured on the far side
    """

    method: str = "auto"
    max_gap: int | None = None
    markers: tuple[int, ...] | None = None
    frame: int | None = None
    max_off_m: float = 0.1
    max_open_m: float = 0.03

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
    """A take whose gaps were filled.

    xyz     (T, M, 3) m; measured samples as they were
    filled  (T, M) True where a sample was filled
    gaps    that were filled, in the order of the markers and of time; so is what was left
    """

    xyz: np.ndarray
    filled: np.ndarray
    gaps: tuple[FilledGap, ...]
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
    """Which of a take's markers are one subject's, (K,), and the set that is worn, if it is known.

    columns  (M,) the places in `own` of the set's markers, -1 where the take has none
    """

    own: np.ndarray
    markerset: MarkerSet | None = None
    columns: np.ndarray | None = None

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
    xyz: np.ndarray,
    rate: float,
    options: FillOptions,
    subjects: Sequence[SubjectMarkers],
    rays: MarkerRays = NO_RAYS,
) -> Generator[float, None, FilledTake]:
    """The same of the markers (T, M, 3) m of several subjects, each by itself: no body moves as another."""
    if len(subjects) == 1:
        [one] = subjects
        return (yield from fill_take(xyz, rate, options, one.markerset, one.columns, rays))
    whole, filled, gaps, left = xyz.copy(), np.zeros(xyz.shape[:2], bool), [], []
    for number, one in enumerate(subjects):
        place = {int(marker): index for index, marker in enumerate(one.own)}
        asked = options.markers and tuple(place[marker] for marker in options.markers if marker in place)
        rays_used = rays.pick(np.isin(rays.marker, one.own))
        rays_used = replace(rays_used, marker=np.array([place[marker] for marker in rays_used.marker.tolist()], int))
        given = rate, replace(options, markers=asked), one.markerset, one.columns, rays_used
        found = yield from _share_of(fill_take(xyz[:, one.own], *given), number, len(subjects))
        whole[:, one.own], filled[:, one.own] = found.xyz, found.filled
        gaps += [replace(gap, gap=replace(gap.gap, marker=int(one.own[gap.gap.marker]))) for gap in found.gaps]
        left += [replace(gap, gap=replace(gap.gap, marker=int(one.own[gap.gap.marker]))) for gap in found.left]
    return FilledTake(whole, filled, _in_order(gaps), _in_order(left))


def _in_order(gaps: Sequence) -> tuple:
    """Gaps that were filled, or left, by their markers and in time."""
    return tuple(sorted(gaps, key=lambda one: (one.gap.marker, one.gap.start)))


def _share_of(work: Generator[float, None, FilledTake], place: int, count: int) -> Generator[float, None, FilledTake]:
    """One of so many pieces of work."""
    while True:
        try:
            yield (place + next(work)) / count
        except StopIteration as end:
            return end.value


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


@dataclass(eq=False)
class _Filler:
    """What is kept from gap to gap."""

    xyz: np.ndarray
    rate: float
    options: FillOptions
    markerset: MarkerSet | None
    columns: np.ndarray | None
    rays: MarkerRays
    take: KnownMarkers = field(init=False)
    measured: np.ndarray = field(init=False)
    strays: np.ndarray = field(init=False)
    jumps: np.ndarray = field(init=False)
    fitted_subject: FittedSubject | None = field(init=False, default=None)
    done: list[FilledGap] = field(init=False, default_factory=list)
    left: list[LeftGap] = field(init=False, default_factory=list)
    chosen: dict[tuple, Choice | None] = field(init=False, default_factory=dict)
    models: dict[tuple, MarkerModel | None] = field(init=False, default_factory=dict)
    scales: dict[int, np.ndarray] = field(init=False, default_factory=dict)

    def __post_init__(self):
        self.strays, self.jumps = find_strays(np.asarray(self.xyz, dtype=float), self.rate)
        self.take = KnownMarkers(np.where(self.strays[..., None], np.nan, self.xyz))
        self.measured = self.take.known
        if self.markerset is not None:
            self.fitted_subject = FittedSubject.of(self.markerset, self.columns, self.take)

    def outcome(self) -> FilledTake:
        """What became of the take."""
        gaps, left = (tuple(sorted(some, key=_place)) for some in (self.done, self.left))
        xyz = np.where(self.strays[..., None], self.xyz, self.take.xyz)
        return FilledTake(xyz, self.take.length > 0, gaps, left)

    def fill(self, gap: Gap):
        """Fills a gap, or notes why it is left."""
        if self.options.max_gap is not None and len(gap) > self.options.max_gap:
            self.left.append(LeftGap(gap, f"is longer than {self.options.max_gap} frames"))
            return
        if reason := self._beyond_reach(gap):
            self.left.append(LeftGap(gap, reason))
            return
        own, helping = self.measured[:, gap.marker], self.take.helping(gap)
        neighbours = neighbours_of(self.take, helping, own)
        ways = self._ways(neighbours, helping)
        choice = self._chosen(gap, neighbours, own, ways)
        answers = {} if choice is None else {part: ways[part](gap, own) for part in choice.parts}
        answers = {part: answer for part, answer in answers.items() if answer is not None}
        if not answers:
            self.left.append(LeftGap(gap, self._why_not(gap, own)))
            return
        sure = next((answer[1] for answer in answers.values() if answer[1] is not None), None)
        path = sum(answer[0] for answer in answers.values()) / len(answers)
        path, expected, rays_used = constrained(path, gap, choice.expected(sure), self.rays, own, self.rate)
        open_ended = gap.start == 0 or gap.stop == len(own)
        limit = self.options.max_open_m if open_ended else self.options.max_off_m
        if expected > limit:
            where = " at an end of the take" if open_ended else ""
            reason = f"would be off by {1000 * expected:.0f} mm, where {1000 * limit:.0f} mm are allowed{where}"
            self.left.append(LeftGap(gap, reason))
            return
        self.take.put(gap, path)
        method = "+".join([*answers, *(["ray"] if rays_used else [])])
        self.done.append(FilledGap(gap, method, expected, (gap.start > 0, gap.stop < len(own))))

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
            return f"has ends {off:.2f} m apart, too far for its {len(gap)} frames: one of them is named wrongly"
        return ""

    def _ways(self, neighbours: np.ndarray, helping: np.ndarray) -> dict[str, Way]:
        """The methods that are asked for, the favourite first, for a gap with these neighbours."""

        def by_regression(gap: Gap, own: np.ndarray) -> Answer:
            model = self._model(gap.marker, neighbours)
            return None if model is None else regress(self.take, gap, model, own, self.rate)

        def by_body(gap: Gap, own: np.ndarray) -> Answer:
            return _plainly(None if self.fitted_subject is None else self.fitted_subject.fill(self.take, gap, own))

        def by(method: str) -> Way:
            group = helping if method == "pca" else neighbours
            return lambda gap, own: _plainly(PLAIN[method](self.take, gap, group, own))

        ways = {FAVOURITE: by_regression, **{name: by(name) for name in PLAIN}, "body": by_body}
        asked = TRIED if self.options.method == "auto" else (self.options.method,)
        no_body = self.fitted_subject is None and self.options.method == "auto"
        return {name: _sound(ways[name]) for name in asked if not (no_body and name == "body")}

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

    def _chosen(self, gap: Gap, neighbours: np.ndarray, own: np.ndarray, ways: dict[str, Way]) -> Choice | None:
        """The choice for gaps like this one, tried once."""
        sides, summed = (gap.start == 0, gap.stop == len(own)), paces(self.take, neighbours, self.rate)
        pace = graded(pace_of(summed, gap.start, gap.stop))
        key = (gap.marker, graded(len(gap)), pace, sides, *neighbours[: LEARNED_BY.of_axes].tolist())
        if key not in self.chosen:
            self.chosen[key] = choose(self.take, gap, neighbours, own, ways, summed, self.rate) or self._untried()
        return self.chosen[key]

    def _untried(self) -> Choice | None:
        """Where the take has no room for a trial: what was asked for, or what says itself how sure it is."""
        method = FAVOURITE if self.options.method == "auto" else self.options.method
        return Choice((method,), np.nan, np.nan)

    def _why_not(self, gap: Gap, own: np.ndarray) -> str:
        if self.options.method == "body" and self.fitted_subject is None:
            return "has no body to be filled by: that needs a model of these markers"
        if self.options.method == "spline" and (gap.start == 0 or gap.stop == len(own)):
            return "is at an end of the take, and a spline is not drawn beyond what was measured"
        return "has too little around it that is known: no method can be tried on it"


def _place(one: FilledGap | LeftGap) -> tuple[int, int]:
    return one.gap.marker, one.gap.start


def _sound(way: Way) -> Way:
    """The same, with no answer where a part of it is no number: it would be the best of all trials."""

    def answer(gap: Gap, own: np.ndarray) -> Answer:
        answer = way(gap, own)
        return None if answer is None or not np.isfinite(answer[0]).all() else answer

    return answer


def _plainly(positions: np.ndarray | None) -> Answer:
    return None if positions is None else (positions, None)
