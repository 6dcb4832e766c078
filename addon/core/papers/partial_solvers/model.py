# SPDX-License-Identifier: GPL-3.0-or-later
"""What an ensemble of partial solvers is made of: weak classifiers, strong classifiers, solvers and their record."""

from dataclasses import dataclass

import numpy as np

from ...data.takes import NO_POINT

# The geometric functions; the index is what `Classifiers.kind` holds. The first four are the paper's table 1, g1 to g4.
# None of them can tell a scene from its mirror image, so left and right show in what is lopsided or not at all. The
# table gives them as examples: "turn" is one more of its kind that can. It is ours, and in an ensemble only where it
# was asked for, as `train` does unless it is to keep to the paper.
FUNCTIONS = ("angle", "distance", "ratio", "height", "turn")
KIND_ANGLE, KIND_DISTANCE, KIND_RATIO, KIND_HEIGHT, KIND_TURN = range(len(FUNCTIONS))
PAPER_FUNCTIONS = FUNCTIONS[:4]
# Points that each function takes.
DOMAIN = (3, 2, 4, 2, 3)


@dataclass(frozen=True, eq=False)
class Classifiers:
    """F weak classifiers: each accepts a labelling when its feature lies in a closed interval (equation 1)."""

    kind: np.ndarray  # (F,) index into FUNCTIONS
    points: np.ndarray  # (F, 4) markers in the function's order, NO_POINT beyond its domain
    low: np.ndarray  # (F,) α, and high (F,) β: rad, m, pure number, m, pure number
    high: np.ndarray

    def __len__(self) -> int:
        return len(self.kind)

    def __getitem__(self, rows) -> "Classifiers":
        return Classifiers(self.kind[rows], self.points[rows], self.low[rows], self.high[rows])

    def within(self, markers) -> np.ndarray:
        """(F,) True for those all of whose points are among `markers` (indices): the pool of a partial solver."""
        inside = np.zeros(max(int(self.points.max(initial=-1)), *markers, 0) + 2, dtype=bool)
        inside[list(markers)] = True
        inside[NO_POINT] = True
        return inside[self.points].all(axis=1)


@dataclass(frozen=True, eq=False)
class Strong:
    """A strong classifier φ (equation 2): which weak classifiers of a pool vote, and with what weight."""

    chosen: np.ndarray  # (J,) rows of the pool, in the order in which boosting added them
    weights: np.ndarray  # (J,) weight each had gathered when it was added

    def __len__(self) -> int:
        return len(self.chosen)

    def votes(self, accepted: np.ndarray, evaluated: np.ndarray | None = None) -> np.ndarray:
        """φ of N labellings, 0 to 1; correct when 1. A labelling that no voter can judge counts as 1.

        accepted (N, J) h of each voter; evaluated (N, J) False where a point of the voter is unassigned: not counted.
        """
        weights = np.broadcast_to(self.weights, accepted.shape)
        if evaluated is not None:
            weights = np.where(evaluated, weights, 0.0)
        whole = weights.sum(axis=1)
        part = np.where(accepted, weights, 0.0).sum(axis=1)
        return np.divide(part, whole, out=np.ones(len(whole)), where=whole > 0)


@dataclass(frozen=True, eq=False)
class Record:
    """How a solver did on samples whose truth is known, marker by marker of its subset."""

    hits: np.ndarray  # (s,) samples in which the marker got its right point and no other
    failures: np.ndarray  # (s,) samples in which it got other points only
    answers: np.ndarray  # (s,) samples in which it got any point; what is neither hit nor failure was ambiguous
    samples: int  # number of samples drawn

    def __add__(self, other: "Record") -> "Record":
        return Record(
            self.hits + other.hits,
            self.failures + other.failures,
            self.answers + other.answers,
            self.samples + other.samples,
        )

    @property
    def rates(self) -> np.ndarray:
        """(s,) the hit rates P(S, m_i): hits over answers; NaN where the solver never answered."""
        return np.divide(self.hits, self.answers, out=np.full(self.hits.shape, np.nan), where=self.answers > 0)

    def reaches(self, targets: np.ndarray) -> np.ndarray:
        """(s,) whether each hit rate reaches its target (s,)."""
        return (self.answers > 0) & (self.hits >= targets * self.answers)


@dataclass(frozen=True, eq=False)
class Solver:
    """A partial solver S(C, M_s, φ_s): labels the markers of its subset, all of them or none."""

    markers: np.ndarray  # (s,) indices into the marker set, ascending
    strong: Strong  # φ_s
    record: Record  # its hit rates and the counts behind them
    reached: np.ndarray  # (s,) True for the markers whose hit rate reaches its target

    def hit_rate(self, marker: int) -> float:
        """P(S, m_i). Raises KeyError for a marker outside the solver's subset: there it is undefined."""
        place = np.flatnonzero(self.markers == marker)
        if not len(place):
            raise KeyError(marker)
        return float(self.record.rates[place[0]])


@dataclass(frozen=True, eq=False)
class PartialSolvers:
    """Partial solvers Φ that together cover a marker set."""

    markers: tuple[str, ...]  # M names
    classifiers: Classifiers  # the weak classifiers that any solver uses; `Strong.chosen` are rows of it
    solvers: tuple[Solver, ...]  # the partial solvers
    targets: np.ndarray  # (M,) τ_i, the hit rate asked of each marker
    search: str  # how the solvers were found: "bottom-up", "top-down" or "genetic"
    seed: int  # of everything that was drawn
    frames: int  # number of labelled frames it was trained on

    def __len__(self) -> int:
        return len(self.solvers)

    @property
    def covered(self) -> np.ndarray:
        """(M,) how many solvers reach the target for each marker."""
        counts = np.zeros(len(self.markers), dtype=int)
        for solver in self.solvers:
            counts[solver.markers[solver.reached]] += 1
        return counts
