# SPDX-License-Identifier: GPL-3.0-or-later
"""How ambiguous a marker set is: for each marker, each pair and the whole, how far the true naming stands out.

Three kinds of wrong names are looked at: two markers exchange their points; a marker is hidden and a
neighbour's point passes for it; a whole limb, or the whole body turned round, passes for the other side's.

They are judged as naming does it: by how much less likely they make a cloud of the shape. Where that is d²/2, two bell
curves d standard deviations apart share exp(-d²/8): their Bhattacharyya coefficient (A. Bhattacharyya: On a measure of
divergence between two multinomial populations, Sankhyā 7, 1946). It is 1 where the namings cannot be distinguished, and
half of it bounds how often the better guess is wrong.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from ..body.sides import limb_exchanges, mirror_order
from ..data.takes import NO_POINT
from ..geometry.rigid import MIN_POINTS
from ..geometry.upright import turned
from ..points.likelihood.distances import DistanceConstraints
from ..points.likelihood.naming import score_of, settle
from ..points.likelihood.shape import Latent, Shape
from ..points.likelihood.solving import alternatives
from .layout import MarkerLayout

OTHER_SIDE, TURNED_ROUND = "sides", "turn"

MAX_TURNS = 4  # of the whole cloud that are judged, the likeliest; a square has three
MIN_RENAMED_SHARE = 0.5  # of the markers, by a turn of the whole body
YAWS = 24  # turns of the whole cloud that are tried, every 15 degrees
MIN_TURN_RAD = np.pi / 4 - 1e-6  # an eighth of a turn: a body that is turned less is the same body


@dataclass(frozen=True, eq=False)
class Renaming:
    """Many markers that take each other's points at once."""

    kind: str  # OTHER_SIDE: a limb and its mirror image; TURNED_ROUND: the whole set, turned about the vertical
    order: np.ndarray  # (M,) the marker whose point each marker takes, itself where nothing changes
    yaw: float  # rad

    @property
    def moved(self) -> np.ndarray:
        """(N,) the markers that change their points."""
        return np.flatnonzero(self.order != np.arange(len(self.order)))


def renamings(markers: Sequence[str], shape: Shape) -> list[Renaming]:
    """What to try: every limb with the other side's, and the turns after which the cloud looks most like itself."""
    limbs = [Renaming(OTHER_SIDE, order, 0.0) for order in limb_exchanges(mirror_order(markers), shape.mean)]
    return [*limbs, *_turns(shape)]


def _turns(shape: Shape) -> list[Renaming]:
    """The turned clouds that lie best on the cloud itself, each marker on the nearest in standard deviations."""
    from scipy.optimize import linear_sum_assignment

    mean = shape.mean - shape.mean.mean(axis=0)
    variance = shape.noise + (shape.modes**2).sum(axis=(1, 2)) / 3
    both = variance[:, None] + variance
    found: dict[tuple[int, ...], tuple[float, float]] = {}
    yaws = np.arange(1, YAWS) * (2 * np.pi / YAWS)
    for yaw in yaws[np.minimum(yaws, 2 * np.pi - yaws) >= MIN_TURN_RAD]:
        image = turned(mean, np.array(yaw))
        square = ((mean[:, None] - image[None]) ** 2).sum(axis=2) / both
        rows, columns = linear_sum_assignment(square)
        total = float(square[rows, columns].sum())
        key = tuple(columns.tolist())
        if (columns != rows).mean() >= MIN_RENAMED_SHARE and total < found.get(key, (np.inf, 0.0))[0]:
            found[key] = total, float(yaw)
    best = sorted(found.items(), key=lambda row: row[1][0])[:MAX_TURNS]
    return [Renaming(TURNED_ROUND, np.array(key), yaw) for key, (_, yaw) in best]


JUDGING_TRIALS = 13  # that overlaps are averaged over, all markers seen in the first, and each hidden in three others
HIDDEN_SHARE = 0.25  # of the markers, hidden in each of the others: a body hides a quarter
JUDGED_CLOUDS = 16  # drawn from the shape, for each trial the same


@dataclass(frozen=True, eq=False)
class Ambiguity:
    """How much namings of a set of M markers look alike, as overlaps: 0 never mistaken, 1 always."""

    markers: tuple[str, ...]  # M names
    seen: np.ndarray  # (M, M) with every marker seen: the pair exchanged, by itself or with the whole limb or body
    # (M, M) with a part of the markers hidden, a neighbour's point that passes for a hidden marker included
    hidden: np.ndarray
    whole: tuple[Renaming, ...]  # the renamings of limbs and of the whole body that were tried
    overlaps: np.ndarray  # of each of these, with every marker seen

    @property
    def of_markers(self) -> np.ndarray:
        """(M,) of each marker with all others, any of which it may be taken for."""
        return 1 - np.prod(1 - self.hidden, axis=1)

    @property
    def total(self) -> float:
        """The sum of all pairs."""
        return float(np.triu(self.hidden).sum())

    def worst(self) -> list[tuple[int, int]]:
        """All pairs of markers, the most ambiguous first."""
        one, two = np.triu_indices(len(self.markers), 1)
        order = np.argsort(-self.hidden[one, two], kind="stable")
        return list(zip(one[order].tolist(), two[order].tolist(), strict=True))


def judge(layout: MarkerLayout, whole: Sequence[Renaming] | None = None) -> Ambiguity:
    """How ambiguous the layout of a marker set is; the same every time.

    `whole` are the renamings of limbs and of the whole body to judge, those of `renamings` unless given.
    """
    whole = renamings(layout.markerset.markers, layout.shape) if whole is None else whole
    with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
        return _judged(layout, whole)


def _judged(layout: MarkerLayout, whole: Sequence[Renaming]) -> Ambiguity:
    count, judge_ = len(layout.markerset), _Judge(layout.shape)
    swapped, met, passed, apart = np.zeros((4, count, count))
    some = []
    for there in _trials(count):
        swap, move = judge_.of_pairs(there)
        swapped += swap
        met += there[:, None] & there
        passed += np.where(there[:, None] & ~there, move, 0)
        apart += there[:, None] & ~there
        some.append(judge_.of_renamings(whole, there))
        if there.all():
            seen = 1 - (1 - swap) * _left(whole, some[0], count)
    known = np.isfinite(some)
    part = np.where(known, some, 0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    passed /= np.maximum(apart, 1)
    # Any of the three will do for a wrong name, so what is left is what none of them takes.
    hidden = 1 - (1 - swapped / met) * (1 - np.maximum(passed, passed.T)) * _left(whole, part, count)
    for table in (seen, hidden):
        np.fill_diagonal(table, 0)
    return Ambiguity(layout.markerset.markers, seen, hidden, tuple(whole), some[0])


class _Judge:
    """Clouds of a shape, and how likely wrong namings of them are against the true one."""

    def __init__(self, shape: Shape):
        drawn = np.random.default_rng(0).standard_normal((JUDGED_CLOUDS, shape.modes.shape[2]))
        self.model = Latent(shape)
        self.clouds = shape.mean + np.einsum("mik,nk->nmi", shape.modes, drawn)
        self.constraints = DistanceConstraints(np.zeros((0, 2), dtype=int), np.zeros(0), np.zeros(0), 0.0)

    def of_pairs(self, there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Overlaps (M, M), where the markers `there` (M,) are seen: both exchanged; one's point named the other."""
        naming = np.where(there, np.arange(len(there)), NO_POINT)
        shape = len(self.clouds), len(there)
        settled = settle(
            self.model, self.constraints, self.clouds, np.broadcast_to(there, shape), np.tile(naming, (shape[0], 1))
        )
        found = alternatives(self.model, self.constraints, settled)
        swap = _overlap(found.swap)
        return swap + swap.T, _overlap(found.move)

    def of_renamings(self, whole: Sequence[Renaming], there: np.ndarray) -> np.ndarray:
        """(R,) overlaps of renamings; NaN where nothing changes of markers that are seen in both namings."""
        if not whole:
            return np.zeros(0)
        order = np.array([renaming.order for renaming in whole])
        here = there & there[order]
        true, count = np.where(here, np.arange(len(there)), NO_POINT), len(self.clouds)
        namings = np.repeat(np.concatenate([true, np.where(here, order, NO_POINT)]), count, axis=0)
        yaw = np.repeat([0.0] * len(whole) + [renaming.yaw for renaming in whole], count)
        clouds = turned(np.tile(self.clouds, (2 * len(whole), 1, 1)), yaw)
        score = score_of(self.model, self.constraints, clouds, np.zeros(len(yaw)), namings).reshape(2, -1, count)
        changed = (here & (order != np.arange(len(there)))).any(axis=1)
        return np.where(changed, _overlap((score[1] - score[0]).T), np.nan)


def _overlap(gain: np.ndarray) -> np.ndarray:
    """The mean overlap of namings that gain log likelihood (N, ...) in N clouds."""
    return np.exp(np.minimum(gain, 0) / 4).mean(axis=0)


def _trials(count: int) -> np.ndarray:
    """(trials, M) which markers are seen: all in the first trial, then each hidden as often as any other."""
    generator = np.random.default_rng(0)
    gone = min(max(round(HIDDEN_SHARE * count), 1), max(count - MIN_POINTS, 0))
    order = np.concatenate([generator.permutation(count) for _ in range(JUDGING_TRIALS)])
    masks = np.ones((JUDGING_TRIALS, count), dtype=bool)
    for row, mask in enumerate(masks[1:]):
        mask[order[row * gone : (row + 1) * gone]] = False
    return masks


def separation(overlap: np.ndarray) -> np.ndarray:
    """An overlap as the distance of two equal bell curves that have it, in their standard deviations.

    Such curves are mistaken for each other in a part Φ(-d/2) of all cases: 31 % at 1, 2.3 % at 4, 0.1 % at 6.
    """
    logs = np.log(np.clip(overlap, np.finfo(float).tiny, 1))
    return np.sqrt(-8 * logs) + 0.0


def _left(whole: Sequence[Renaming], overlaps: np.ndarray, count: int) -> np.ndarray:
    """(M, M) what renamings leave of the pairs that they exchange: 1 where they exchange none."""
    table = np.ones((count, count))
    for renaming, overlap in zip(whole, overlaps, strict=True):
        moved = renaming.moved
        pairs = np.zeros((count, count), dtype=bool)
        pairs[moved, renaming.order[moved]] = pairs[renaming.order[moved], moved] = True
        table = np.where(pairs, table * (1 - overlap), table)
    return table
