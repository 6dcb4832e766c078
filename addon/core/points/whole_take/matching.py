# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracklets and markers matched over a take at once: the most likely naming in which no marker is twice anywhere.

A linear programme: a variable for each name that a tracklet may have; a tracklet has one at most, and of the tracklets
that are there at a time one at most has each name.
"""

import numpy as np

from ...data.takes import NO_MARKER
from ..tracklets import VOTE


def matched(odds: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """(N,) the marker of every tracklet, NO_MARKER for none, of the highest total log odds (N, M).

    first, last (N,) are the tracklets' frames, both included.
    """
    from scipy.optimize import LinearConstraint, milp
    from scipy.sparse import csr_array

    tracklet, marker = np.nonzero(odds > 0)
    found = np.full(len(odds), NO_MARKER)
    if not len(tracklet):
        return found
    rows, columns, count = [tracklet], [np.arange(len(tracklet))], len(odds)
    for name in np.unique(marker):
        own = np.flatnonzero(marker == name)
        for clique in cliques(first[tracklet[own]], last[tracklet[own]]):
            rows.append(np.full(len(clique), count))
            columns.append(own[clique])
            count += 1
    row, column = np.concatenate(rows), np.concatenate(columns)
    once = csr_array((np.ones(len(row)), (row, column)), shape=(count, len(tracklet)))
    solved = milp(
        -odds[tracklet, marker],
        integrality=np.ones(len(tracklet)),
        bounds=(0, 1),
        constraints=LinearConstraint(once, ub=1),
    )
    chosen = solved.x > 0.5
    found[tracklet[chosen]] = marker[chosen]
    return found


def cliques(first: np.ndarray, last: np.ndarray) -> list[np.ndarray]:
    """The sets of tracklets, by index, that are there when one of them begins; those of one are left out."""
    end = _ends(first, last)
    found: list[np.ndarray] = []
    for start in np.unique(first):
        there = np.flatnonzero((first <= start) & (end >= start))
        if len(there) > 1:
            found.append(there)
    return found


def _ends(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """(N,) the last frames of tracklets that are shortened, so that those that hardly overlap do not meet."""
    return np.maximum(last - VOTE.max_overlap_frames, first)


def margins(odds: np.ndarray, marker: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """(N,) by how much the names (N,) are ahead of the next best naming in which the tracklet has another, or none."""
    index = np.flatnonzero(marker != NO_MARKER)
    own = np.zeros(len(odds))
    own[index] = odds[index, marker[index]]
    end = _ends(first, last)
    found = np.zeros(len(odds))
    for one in index.tolist():
        name = marker[one]
        others = np.flatnonzero((first <= end[one]) & (end >= first[one]))
        others = others[others != one]
        # Without its name, which another tracklet of the time may take over.
        free = (odds[others, name] - own[others]).max(initial=0)
        # With another name, for which whoever has it gives it up, or takes this one in exchange.
        rest = odds[one].copy()
        holders = others[marker[others] != NO_MARKER]
        np.add.at(rest, marker[holders], np.maximum(odds[holders, name], 0) - own[holders])
        rest[name] = -np.inf
        found[one] = own[one] - max(free, rest.max())
    return found
