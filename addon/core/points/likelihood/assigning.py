# SPDX-License-Identifier: GPL-3.0-or-later
"""Points given to the markers of one frame where several want the same one: the naming of highest total log odds.

By augmenting paths (H. W. Kuhn 1955): marker after marker comes in, takes a point, whoever had that takes another, and
so on along the chain that brings most. What was the best so far stays the best by one such chain, and as hardly any
marker of a frame has more than two points to choose from, a chain is short: plain Python is as fast as SciPy, which
takes a quarter of a second to load. Where markers have many to choose from, as in a frame that is of another unit or
set, chains are endless, and SciPy is asked.
"""

import numpy as np

from ...data.takes import NO_POINT

ROUNDING = 1e-9  # log odds; chains in a circle bring nothing, and must not seem to

DENSE = 4  # measured: points a marker, beyond which chains take longer than SciPy: 10 s for 40 frames in a wrong unit

Worth = dict[int, dict[int, float]]  # of each marker, the log odds of each point that it may be, above 0


def assigned(odds: np.ndarray) -> np.ndarray:
    """(M,) the point of each marker, NO_POINT for none, of the highest total odds (M, P); none at odds below 0."""
    marker, point = np.nonzero(odds > 0)
    if len(marker) > DENSE * len(odds):
        return _by_scipy(odds)
    worth: Worth = {}
    for own, candidate, value in zip(marker.tolist(), point.tolist(), odds[marker, point].tolist(), strict=True):
        worth.setdefault(own, {})[candidate] = value
    holder: dict[int, int] = {}
    for own in worth:
        _let_in(own, worth, holder)
    naming = np.full(len(odds), NO_POINT)
    naming[list(holder.values())] = list(holder)
    return naming


def _by_scipy(odds: np.ndarray) -> np.ndarray:
    """The same by a solver whose time hangs on the size alone."""
    from scipy.optimize import linear_sum_assignment

    naming = np.full(len(odds), NO_POINT)
    marker, point = linear_sum_assignment(np.maximum(odds, 0.0), maximize=True)
    some = odds[marker, point] > 0
    naming[marker[some]] = point[some]
    return naming


def _let_in(newcomer: int, worth: Worth, holder: dict[int, int]):
    """Changes who holds which point, by the best chain that begins with one more marker."""
    # What has been gained where this marker has no point for now, and who took which from it.
    gained, robbed = {newcomer: 0.0}, {}
    best, last, free = 0.0, newcomer, None
    waiting = [newcomer]
    while waiting:
        one = waiting.pop()
        for point, value in worth[one].items():
            other, gain = holder.get(point), gained[one] + value
            if other is None:
                if gain > best:
                    best, last, free = gain, one, point
                continue
            gain -= worth[other][point]
            if other != one and gain > gained.get(other, -np.inf) + ROUNDING:
                gained[other], robbed[other] = gain, (one, point)
                waiting.append(other)
                if gain > best:
                    best, last, free = gain, other, None
    if free is not None:
        holder[free] = last
    while last != newcomer:
        last, point = robbed[last]
        holder[point] = last
