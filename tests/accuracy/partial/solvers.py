# SPDX-License-Identifier: GPL-3.0-or-later
"""What the paper says of partial solvers, asked of all 2^15 - 1 of them."""

import numpy as np

from addon.core.papers.partial_solvers.features import tables
from addon.core.papers.partial_solvers.masks import Masks
from addon.core.papers.partial_solvers.search import members
from addon.core.papers.partial_solvers.solver import TreeSearch
from addon.core.papers.partial_solvers.training import SolverStudy, Training

from .methods import HIDES, Faithful
from .studies import Test

TARGETS = (0.99, 0.999, 0.9999)


def claims(method: Faithful, test: Test) -> dict:
    """All that follows, by the name of its table."""
    study = method.study
    record = study.surveyed[None].everything
    rates = np.nan_to_num(record.rates)
    return {
        "growth": growth(rates),
        "sizes": sizes(rates),
        "smallest": smallest(rates, record.answers, test.names),
        "voters": voters(study),
    }


def growth(rates: np.ndarray) -> list:
    """B13: rates compared with those after one more marker, those of them that fall, and the greatest fall."""
    compared_rates = violated = 0
    worst = 0.0
    subsets = np.arange(len(rates))
    for added in range(rates.shape[1]):
        without = subsets[(subsets >> added & 1) == 0]
        for marker in range(rates.shape[1]):
            own = without[(without >> marker & 1) == 1]
            fall = rates[own, marker] - rates[own | 1 << added, marker]
            compared_rates += len(own)
            violated += int((fall > 0).sum())
            worst = max(worst, float(fall.max(initial=0.0)))
    return [compared_rates, violated, worst]


def sizes(rates: np.ndarray) -> list[list]:
    """B13, B14: of each size the solvers, the mean rate, how many reach a target for any marker, the same for any but
    the first, which alone is in the middle of the body."""
    size = np.array([subset.bit_count() for subset in range(len(rates))])
    inside = (np.arange(len(rates))[:, None] >> np.arange(rates.shape[1]) & 1).astype(bool)
    rows = []
    for count in range(1, rates.shape[1] + 1):
        mine = rates[size == count]
        row = [count, len(mine), float(mine[inside[size == count]].mean())]
        row += [int((mine.max(axis=1) >= target).sum()) for target in TARGETS]
        rows.append(row + [int((mine[:, 1:].max(axis=1) >= target).sum()) for target in TARGETS])
    return rows


def smallest(rates: np.ndarray, answers: np.ndarray, names: tuple[str, ...], least_answers: int = 100) -> list[list]:
    """B14: for each marker the smallest solver that reaches the paper's target, the one of them that answers most."""
    rows = []
    for marker, name in enumerate(names):
        good = np.flatnonzero((rates[:, marker] >= 0.9999) & (answers[:, marker] >= least_answers))
        if len(good):
            best = min((int(subset) for subset in good), key=lambda at: (at.bit_count(), -int(answers[at, marker])))
            own = [names[member] for member in members(best)]
            rows.append([name, len(own), " ".join(own), float(rates[best, marker])])
        else:
            rows.append([name, 0, "", float(rates[:, marker].max())])
    return rows


def optimal(frames: np.ndarray, options: Training) -> list[int]:
    """B15: whole frames, and those in which the solver of all markers finds one labelling only, the right one."""
    study, whole = SolverStudy(frames, options), frames[np.isfinite(frames).all(axis=(1, 2))]
    cloud, chosen = TreeSearch(range(study.markers), study.pool)(Masks(tables(whole)))
    doubled = np.unique(cloud[(chosen != np.arange(study.markers)).any(axis=1)])
    return [len(whole), len(whole) - len(doubled)]


def voters(study: SolverStudy) -> list[list]:
    """B30: hidden markers, weak classifiers that can still vote, and their share."""
    rows = []
    for hide in HIDES:
        mine = study.pool.within(range(study.markers - hide))
        rows.append([hide, int(mine.sum()), float(mine.mean())])
    return rows
