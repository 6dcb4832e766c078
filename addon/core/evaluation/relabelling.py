# SPDX-License-Identifier: GPL-3.0-or-later
"""A labelled take without its names, labelled again by a model, and how many of the names come back."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np

from ..data.errors import JobError
from ..data.lanes import Lanes
from ..data.progress import Progress
from ..data.takes import Points
from ..points.models import Model, chosen_method
from ..points.whole_take.pipeline import PointOptions, label_take

NO_NAME, UNTOLD = -1, -2  # a point that is known to be none of the named; one of which nobody knows
RELABELLED_S = 60.0  # physical: from a take's middle that are labelled again; of a gait or sports trial that is all
# physical: of a trajectory at most; raw ones break about as often, and a whole one would be named by its easiest moment
PIECE_S = 2.0  # physical


@dataclass(frozen=True, eq=False)
class KnownNames:
    """A take whose names are known."""

    name: str  # of its file
    names: tuple[str, ...]  # of its markers
    points: Points  # the same without names: trajectories in pieces, in an order that tells nothing
    truth: np.ndarray  # (T, L) which of `names` each point is, NO_NAME or UNTOLD


def without_names(
    name: str,
    names: Sequence[str],
    points: Points,
    truth: np.ndarray,
    most_s: float = RELABELLED_S,
    piece_s: float = PIECE_S,
) -> KnownNames:
    """A take of trajectories (T, P), each in a lane of its own, as if nobody had named it; `truth` (T, P) says who is.

    The same take is always cut and shuffled the same way.
    """
    most = min(len(truth), max(round(most_s * points.rate), 1))
    middle = slice((len(truth) - most) // 2, (len(truth) + most) // 2)
    chance = np.random.default_rng(points.xyz.shape[1])
    order = chance.permutation(points.xyz.shape[1])
    xyz, residual = points.xyz[middle][:, order], points.residual[middle][:, order]
    longest = max(round(piece_s * points.rate), 1)
    pieces = []
    for lane, there in enumerate(np.isfinite(xyz).all(axis=2).T):
        # Not all at once: then a frame would be where everything begins.
        ends = np.arange(int(chance.integers(1, longest + 1)), len(there), longest)
        pieces += [(lane, *piece) for piece in _pieces(there, ends)]
    lane, first, last = np.array(pieces, int).reshape(-1, 3)[chance.permutation(len(pieces))].T
    lanes, begin = Lanes(lane, first, last), points.first_frame + middle.start
    unnamed = Points(("",) * len(pieces), xyz, residual, points.rate, begin, np.arange(len(pieces)), lanes)
    return KnownNames(name, tuple(names), unnamed, truth[middle][:, order])


def _pieces(there: np.ndarray, ends: np.ndarray) -> list[tuple[int, int]]:
    """First and last frames of a trajectory's pieces, where its points (T,) are, cut before the frames `ends` too."""
    begins = there & ~np.r_[False, there[:-1]]
    begins[ends] = there[ends]
    stops = there & ~np.r_[there[1:], False]
    stops[ends - 1] |= there[ends - 1]
    return list(zip(np.flatnonzero(begins).tolist(), np.flatnonzero(stops).tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class NameCounts:
    """What became of a take's names, by marker (M,)."""

    present: np.ndarray  # points that are known to be it, and
    right: np.ndarray  # those of them that are named so
    wrong: np.ndarray  # wrong names
    refused: str = ""  # why the model did not name the take at all; empty where it did

    @property
    def recall(self) -> float:
        """Right names over points of markers; 1 where there is none."""
        return float(self.right.sum() / max(self.present.sum(), 1)) if self.present.any() else 1.0

    @property
    def wrong_share(self) -> float:
        """Wrong names over points of markers."""
        return float(self.wrong.sum() / max(self.present.sum(), 1))


def relabelled(take: KnownNames, model: Model, markers: Sequence[str]) -> Generator[Progress, None, NameCounts]:
    """How the model names the take, counted for `markers` in their order; those that it lacks it never names.

    A model that refuses the take names nothing of it.
    """
    place = {name: number for number, name in enumerate(markers)}
    known = np.array([*(place.get(name, NO_NAME) for name in take.names), UNTOLD, NO_NAME])
    truth = known[take.truth]
    # What stands for nothing at the end of the table is what the two numbers below nought point at.
    try:
        labelled = yield from label_take(take.points, model, PointOptions(chosen_method(model, "auto")))
    except JobError as error:
        return count_names(np.full(truth.shape, NO_NAME), truth, take.points.present, len(markers), error.message)
    own = np.array([*(place.get(name, NO_NAME) for name in model.markerset.markers), NO_NAME])
    return count_names(own[labelled.labels.whole().marker], truth, take.points.present, len(markers))


def count_names(
    named: np.ndarray, truth: np.ndarray, present: np.ndarray, markers: int, refused: str = ""
) -> NameCounts:
    """Counts names (T, L) against the truth (T, L) where points are present (T, L), each the number of a marker."""
    known = present & (truth != UNTOLD)
    named, truth = named[known], truth[known]
    right = (named >= 0) & (named == truth)
    counted = (truth[truth >= 0], truth[right], named[(named >= 0) & ~right])
    present_of, right_of, wrong_of = (np.bincount(which, minlength=markers) for which in counted)
    return NameCounts(present_of, right_of, wrong_of, refused)
