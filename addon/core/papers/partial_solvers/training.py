# SPDX-License-Identifier: GPL-3.0-or-later
"""Training an ensemble of partial solvers from labelled frames.

The paper trains and assesses every solver that its searches come by. Boosting driven to its end accepts exactly what
all weak classifiers of a subset together accept, so here the searches ask what those accept, which can be had for all
subsets at once, and only the solvers that are kept are boosted; what they then do is measured once more and recorded.
"""

from collections.abc import Generator, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from ...data.errors import InputError
from ...data.progress import Progress, within
from . import search as searches
from .assess import Occlusions, assess, draw_occlusions
from .boosting import Boosting, boost, learn_intervals, rejections, wrong_labellings
from .features import all_features, tables
from .masks import Masks
from .model import KIND_DISTANCE, PAPER_FUNCTIONS, PartialSolvers, Record, Solver, Strong
from .search import Genetics
from .solver import TreeSearch
from .survey import Survey, survey

EARLY_FRAMES = 192, 800  # of those on which solvers are measured, after which a hopeless one is given up
# Of so many markers, as the paper's set has, all solvers are gone through; of more those of a marker within a group.
MAX_SURVEYED, GROUP = 15, 12
PATTERNS = 2000  # of occlusions that are thought through when solvers are chosen
MIN_COVER_GAIN = 0.002  # share of them in which one more solver must answer first to be kept
SEARCHES = ("bottom-up", "top-down", "genetic")


@dataclass(frozen=True)
class Training:
    """How an ensemble is trained."""

    # "bottom-up", "top-down" or "genetic"; each runs once for every marker and asks for its target
    search: str = "top-down"
    seed: int = 0  # format: of the generator, any will do
    functions: tuple[str, ...] = PAPER_FUNCTIONS  # the geometric functions; the paper's four, or "turn" with them
    wrong: int = 2048  # memory: wrong labellings drawn for the boosting
    survey_frames: int = 128  # memory: frames on which all subsets are tried
    check_frames: int = 2500  # memory: frames on which good ones are measured
    max_features: int = 60_000  # memory: above that many, ratios are drawn by chance
    max_solvers: int = 16  # memory: kept of each run of the search: those that together answer in the most occlusions
    boosting: Boosting = field(default_factory=Boosting)
    occlusions: Occlusions = field(default_factory=Occlusions)
    genetics: Genetics = field(default_factory=Genetics)


def training(
    points: np.ndarray, markers, targets: float | np.ndarray = Boosting.accuracy, options: Training | None = None
) -> Generator[Progress, None, PartialSolvers]:
    """The ensemble of labelled frames (T, M, 3) m, z up, NaN where missing, of one or many people.

    targets: τ, for all markers or (M,). Raises InputError when there are too few frames or markers to learn from.
    """
    options = options or Training()
    points = np.asarray(points, dtype=float)
    points = points[np.isfinite(points).all(axis=-1).sum(axis=1) >= 2]
    _check(points, markers, options)
    yield Progress(0.0, "learning intervals")
    study = SolverStudy(points, options)
    yield from within(study.survey(), 0.05, 0.55)
    return (yield from within(study.partial_solvers(tuple(markers), targets), 0.55, 1.0))


def _check(points: np.ndarray, markers, options: Training):
    if options.search not in SEARCHES:
        raise ValueError(f"search {options.search!r}; expected one of {SEARCHES}")
    if points.ndim != 3 or points.shape[1:] != (len(markers), 3):
        raise ValueError(f"points {points.shape}; expected (frames, {len(markers)}, 3)")
    if len(markers) < 3:
        raise InputError(f"only {len(markers)} markers to learn from; expected three or more")
    if len(points) < 2:
        raise InputError("fewer than two frames with labelled markers; expected takes that show the markers moving")


class SolverStudy:
    """Labelled frames, the weak classifiers learned from them, and what solvers made of those can do.

    Ensembles for different targets can be made from one study.

    pool      all weak classifiers, those that reject the most wrong labellings first
    surveyed  the records of all subsets for each marker, when `survey` has been run through: one survey of all markers
              for all, or where they are too many one of the group that tells most about each
    """

    def __init__(self, points: np.ndarray, options: Training):
        self.options, self.markers = options, points.shape[1]
        self.targets = np.ones(self.markers)
        self.frames = len(points)
        self.surveyed: list[Survey] = []
        self._generator = np.random.default_rng(options.seed)
        clouds = tables(points)
        learned = learn_intervals(
            clouds, *all_features(self.markers, options.functions, options.max_features, options.seed)
        )
        wrong = wrong_labellings(np.arange(len(points)), self.markers, options.wrong, self._generator)
        rejected = rejections(learned, wrong.frame, wrong.labelling, clouds)
        telling = np.argsort(-rejected.sum(axis=1), kind="stable")
        self.pool, self._rejected, self._wrong = learned[telling], rejected[telling], wrong
        order = self._generator.permutation(len(points))
        self._look = self._sample(points, order[: options.survey_frames])
        checked = order[options.survey_frames :] if len(order) > 2 * options.survey_frames else order
        checked = checked[: options.check_frames]
        self._checks = [self._sample(points, part) for part in np.split(checked, EARLY_FRAMES) if len(part)]
        self._checked: dict[int, np.ndarray] = {}

    def _sample(self, points: np.ndarray, frames: np.ndarray) -> tuple[Masks, np.ndarray]:
        masks = Masks(tables(points[frames]))
        return masks, draw_occlusions(masks, self.options.occlusions, self._generator)

    def survey(self) -> Generator[Progress, None, None]:
        """Goes through all subsets, or through those of each marker's group."""
        whole = self.markers <= MAX_SURVEYED
        groups = [None] if whole else [self._group(own) for own in range(self.markers)]
        found: list[Survey] = []
        for done, group in enumerate(groups):
            work, first, last = (
                survey(self.pool, *self._look, group, not whole),
                done / len(groups),
                (done + 1) / len(groups),
            )
            found.append((yield from within(work, first, last, "surveying partial solvers")))
        self.surveyed = found * self.markers if whole else found

    def _group(self, own: int) -> list[int]:
        """A marker and those whose distance from it rejects the most wrong labellings."""
        pairs = np.flatnonzero((self.pool.kind == KIND_DISTANCE) & (self.pool.points == own).any(axis=1))
        telling = self._rejected[pairs].sum(axis=1).argsort(kind="stable")[::-1]
        others = self.pool.points[pairs[telling], :2].sum(axis=1) - own
        return [own, *(int(other) for other in others[: GROUP - 1])]

    def partial_solvers(
        self, markers: tuple[str, ...], targets: float | np.ndarray
    ) -> Generator[Progress, None, PartialSolvers]:
        """Searches and boosts the solvers for these targets, one or (M,)."""
        self.targets = np.broadcast_to(np.asarray(targets, dtype=float), self.markers).copy()
        self._checked = {}
        found: set[int] = set()
        for own in range(self.markers):
            first, last = 0.6 * own / self.markers, 0.6 * (own + 1) / self.markers
            found |= yield from within(self.find(own), first, last, "searching partial solvers")
        solvers = []
        for place, subset in enumerate(sorted(found, key=lambda subset: (subset.bit_count(), subset))):
            solvers.append(self.solver(subset))
            yield Progress(0.6 + 0.4 * place / len(found), "boosting partial solvers")
        return _joined(solvers, self, markers)

    def find(self, own: int) -> Generator[float, None, set[int]]:
        """The solvers that the search finds for a marker; yields about how much of it is done.

        What a survey of few frames took for good is measured on more. Where that fails, the greedy searches go on with
        one marker more, as they would have had they known.
        """
        known = self.surveyed[own]
        seems, place = self._promising(known, own), known.group.index(own)

        def good(subset: int) -> bool:
            return bool(seems[subset])

        def holds(subset: int) -> bool:
            return bool(self._checked_flags(_outside(known, subset))[own])

        def heirs(subset: int) -> list[int]:
            """The good ones with one marker more that nobody has come by yet."""
            larger = {subset | 1 << new for new in range(len(known.group))} - seen
            seen.update(larger)
            return [other for other in sorted(larger) if good(other)]

        *_, found = self._run(known, place, good)
        seen = set(found)
        limits = (self._hidden(known, place), self.options.max_solvers, MIN_COVER_GAIN)
        genetic = self.options.search == "genetic"
        for taken in searches.covering(sorted(found), holds, (lambda _: ()) if genetic else heirs, *limits):
            yield len(taken) / self.options.max_solvers
        return {_outside(known, subset) for subset in taken}

    def _run(self, known: Survey, place: int, good: searches.Good) -> Iterator[set[int]]:
        """The search among the subsets of a survey's group, for the marker at a place in it."""
        markers, own = len(known.group), known.group[place]
        if self.options.search == "genetic":

            def fitness(subset: int) -> float:
                places = searches.members(subset)
                return float(np.nan_to_num(known.record(places).rates)[places.index(place)])

            generator = np.random.default_rng([self.options.seed, own + 1])
            for _, population in searches.genetic(markers, fitness, self.options.genetics, generator, place):
                yield {subset for subset in population if good(subset)}
            return
        run = searches.bottom_up if self.options.search == "bottom-up" else searches.top_down
        for _, found in run(markers, good, place):
            yield found

    def _promising(self, known: Survey, own: int) -> np.ndarray:
        """(2^G,) which solvers may well reach a marker's target: a survey has few frames, maybe the unlucky ones."""
        target, frames, place = self.targets[own], len(self._look[1]), known.group.index(own)
        unlucky = 1.0 + 2.0 * np.sqrt((1.0 - target) * frames)
        hits, answers = known.hits[:, place], known.answers[:, place]
        hits = np.minimum(hits + unlucky * answers / frames, answers)
        return Record(hits, hits, answers, known.samples).reaches(target)

    def _hidden(self, known: Survey, place: int) -> np.ndarray:
        """(N,) random subsets of hidden markers, the search's own not among them."""
        generator = np.random.default_rng([self.options.seed, self.markers])
        rank = generator.random((PATTERNS, self.markers)).argsort(axis=1).argsort(axis=1)
        hide = rank < generator.integers(0, self.options.occlusions.most + 1, PATTERNS)[:, None]
        hide = hide[:, known.group]
        hide[:, place] = False
        return hide @ (1 << np.arange(len(known.group), dtype=np.int64))

    def _checked_flags(self, subset: int) -> np.ndarray:
        """(M,) which markers' targets a solver reaches on the frames for checking."""
        if subset not in self._checked:
            markers = searches.members(subset)
            search = TreeSearch(markers, self.pool[self.pool.within(markers)])
            self._checked[subset] = self._flags(markers, self._measured(search))
        return self._checked[subset]

    def _flags(self, markers, record: Record) -> np.ndarray:
        flags = np.zeros(self.markers, dtype=bool)
        flags[markers] = record.reaches(self.targets[markers])
        return flags

    def solver(self, subset: int) -> Solver:
        """The partial solver of a subset, boosted and measured."""
        markers = np.array(searches.members(subset))
        rows = np.flatnonzero(self.pool.within(markers))
        strong = self._boosted(markers, rows)
        record = self._measured(TreeSearch(markers, self.pool[strong.chosen]), to_the_end=True)
        return Solver(markers, strong, record, self._flags(markers, record)[markers])

    def _boosted(self, markers: np.ndarray, rows: np.ndarray) -> Strong:
        """The strong classifier of a subset's pool (rows of the whole pool); `chosen` are rows of the whole pool.

        Wrong labellings come in two rounds. First those that were drawn, each with a random part of the markers
        assigned, because the tree search judges partial labellings. Then those that the search still finds: among all
        permutations that could be drawn, just the ones that would not be passed over.
        """
        assigned = self._assigned(markers)
        severity = (self._wrong.moved & assigned).sum(axis=1)
        no_point = np.ones((1, len(assigned)), dtype=bool)
        judged = np.concatenate([assigned.T, no_point])[self.pool.points[rows]].all(axis=1)
        useful = severity > 0
        strong = boost((self._rejected[rows] & judged)[:, useful], severity[useful], self.options.boosting)
        for masks in (masks for masks, _ in (self._look, *self._checks)):
            strong = self._taught(markers, rows, strong, masks)
        return Strong(rows[strong.chosen], strong.weights)

    def _taught(self, markers: np.ndarray, rows: np.ndarray, strong: Strong, masks: Masks) -> Strong:
        """Goes on boosting with the wrong labellings that the solver still finds in some clouds."""
        cloud, chosen = TreeSearch(markers, self.pool[rows[strong.chosen]])(masks)
        wrong = chosen != markers
        mistaken = wrong.any(axis=1)
        labelling = np.zeros((int(mistaken.sum()), self.markers), dtype=int)
        labelling[:, markers] = chosen[mistaken]
        rejected = rejections(self.pool[rows], cloud[mistaken], labelling, masks.clouds)
        every = replace(self.options.boosting, accuracy=1.0)
        return boost(rejected, wrong[mistaken].sum(axis=1), every, strong)

    def _assigned(self, markers: np.ndarray) -> np.ndarray:
        """(K, M) a random part of the markers, two at least, for every wrong labelling; the same every time."""
        generator = np.random.default_rng([self.options.seed, *markers])
        count = generator.integers(2, max(len(markers), 2) + 1, len(self._wrong))
        rank = generator.random((len(self._wrong), len(markers))).argsort(axis=1).argsort(axis=1)
        assigned = np.zeros((len(self._wrong), self.markers), dtype=bool)
        assigned[:, markers] = rank < count[:, None]
        return assigned

    def _measured(self, search: TreeSearch, to_the_end: bool = False) -> Record:
        record = assess(search, *self._checks[0])
        for masks, removed in self._checks[1:]:
            if not to_the_end and self._hopeless(record, search.markers):
                break
            record = record + assess(search, masks, removed)
        return record

    def _hopeless(self, record: Record, markers) -> bool:
        """Whether no target can be reached any more, even were all that is still to come hits."""
        to_come = sum(removed.shape[0] * removed.shape[1] for _, removed in self._checks) - record.samples
        hoped = replace(record, hits=record.hits + to_come, answers=record.answers + to_come)
        return not hoped.reaches(self.targets[markers]).any()


def _outside(known: Survey, subset: int) -> int:
    """A subset of a survey's group, given by places in it, by the markers themselves."""
    return searches.subset_of(known.group[place] for place in searches.members(subset))


def _joined(solvers: list[Solver], study: SolverStudy, markers: tuple[str, ...]) -> PartialSolvers:
    """The ensemble, with only those weak classifiers that some solver uses."""
    useful = [solver for solver in solvers if solver.reached.any()]
    used = np.unique(np.concatenate([np.empty(0, dtype=int), *(solver.strong.chosen for solver in useful)]))
    renumbered = [
        replace(solver, strong=replace(solver.strong, chosen=np.searchsorted(used, solver.strong.chosen)))
        for solver in useful
    ]
    return PartialSolvers(
        markers,
        study.pool[used],
        tuple(renumbered),
        study.targets,
        study.options.search,
        study.options.seed,
        study.frames,
    )
