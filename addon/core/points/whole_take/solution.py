# SPDX-License-Identifier: GPL-3.0-or-later
"""What solving a take as a whole comes to."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ...data.takes import NO_MARKER
from ..refusals import NO_FIT, SetFit
from .layout import Question
from .tracklets import Tracklets


@dataclass(frozen=True, eq=False)
class Solution:
    """What a take as a whole says of its N tracklets."""

    tracklets: Tracklets
    marker: np.ndarray  # (N,) of each, NO_MARKER for none
    every: np.ndarray  # (N,) the same with the names of `extras` unmodelled markers, which follow on the set's
    extras: int
    margin: np.ndarray  # (N,) log odds by which that is ahead of any other name, or none
    rivals: tuple[np.ndarray, ...]  # other names (N,), of which each tracklet's nearest rival is one
    likely: np.ndarray  # (N,) the name that is likeliest for each on its own, NO_MARKER where that is none
    questions: tuple[Question, ...]  # markers that may have another's name in most of the take
    crowd: bool = False  # whether more is on the subject than the set's markers
    fit: SetFit = NO_FIT  # how the markers sit as their set has them; the residual in a crowd alone
    # (M, K) the nearest of each marker, one of which has to be there with it; None where that is not asked
    near: np.ndarray | None = None

    def doubted(self, other: Self) -> Self:
        """The same, of which no name is sure whose tracklet, or marker, is another's by the `other` solution.

        What a person named is; of a marker that is nowhere by the other this says nothing.
        """
        at = self.tracklets.first, self.tracklets.lane
        theirs = np.append(other.marker, NO_MARKER)[other.tracklets.table[at]]
        differs = (theirs != self.marker) & ((theirs != NO_MARKER) | np.isin(self.marker, other.marker))
        return replace(self, margin=np.where(differs & (self.tracklets.held == NO_MARKER), 0.0, self.margin))
