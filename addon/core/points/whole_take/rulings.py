# SPDX-License-Identifier: GPL-3.0-or-later
"""What edits are to a take that is solved: tracklets that are surely a marker, surely not, or not there at all.

Edits are constraints. A tracklet that a person named keeps that name through all rounds, and what is named beside it,
how far markers are from each other in this take, and which of two is which follow from it as from any other name.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...data.takes import BY_EDIT, BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels
from ...edits.replay import ANYBODY, FREE, NOBODY, Edited
from ..refusals import REFUSAL
from .solution import Solution
from .tracklets import RULING, Tracklets


@dataclass(frozen=True, eq=False)
class Rulings:
    """What edits say of the points (T, P) of a take."""

    edited: Edited
    before: Labels  # its labels without them, and `edited` with them
    tracklet: np.ndarray  # (T, P) the number of each point's tracklet
    solved: Solution | None  # what the take came to without them, None where it was not solved

    @cached_property
    def carried(self) -> np.ndarray:
        """(T, P) the marker of points on a tracklet that a person named in other frames, NO_MARKER elsewhere.

        Where nothing else has a name: not the tracklet, and not, at the time, the marker.
        """
        edited, found = self.edited, np.full(self.tracklet.shape, NO_MARKER)
        marker, count = edited.labels.marker, int(self.tracklet.max(initial=-1)) + 1
        row, column = np.nonzero((self.tracklet >= 0) & (marker != NO_MARKER))
        number, name = self.tracklet[row, column], marker[row, column]
        least, most, held = np.full(count, edited.claim.shape[1]), np.full(count, NO_MARKER), np.zeros(count, bool)
        np.minimum.at(least, number, name)
        np.maximum.at(most, number, name)
        held[number[edited.named[row, column]]] = True
        taken = edited.claim != ANYBODY
        taken[row, name] = True
        row, column = np.nonzero((self.tracklet >= 0) & (marker == NO_MARKER) & (edited.rule == FREE))
        number = self.tracklet[row, column]
        one = held[number] & (least[number] == most[number])
        row, column, name = row[one], column[one], most[number[one]]
        free = ~taken[row, name] & (edited.refused[row, column] != name)
        found[row[free], column[free]] = name[free]
        return found

    @property
    def start(self) -> np.ndarray:
        """(T, P) the markers that a solution begins with."""
        return np.where(self.edited.labels.named, self.edited.labels.marker, self.carried)

    def applied_to(self, named: Labels) -> Labels:
        """What frames say on their own (T, P), with what a person said in its place."""
        edited, given, carried = self.edited, self.edited.named, self.carried != NO_MARKER
        kept = named.named & (edited.rule == FREE) & (edited.refused != named.marker)
        row, column = np.nonzero(kept)
        kept[row, column] = edited.claim[row, named.marker[row, column]] == ANYBODY
        ruled = given | carried
        return Labels(
            np.where(ruled, np.where(given, edited.rule, self.carried), np.where(kept, named.marker, NO_MARKER)),
            np.where(ruled, np.where(given, BY_EDIT, BY_TRAJECTORY), np.where(kept, named.step, NO_STEP)),
            np.where(ruled, 1.0, np.where(kept, named.confidence, 0.0)),
            np.where(ruled, 1.0, np.where(kept, named.measured_rate, 0.0)),
        )

    def parted(self) -> np.ndarray:
        """(T, P) the tracklets without what is no marker, cut where what is said of them changes.

        They are cut at gaps, too, in which an edit says what their marker is: it may be another trajectory.
        """
        edited, tracklet = self.edited, self.tracklet
        column, row = np.nonzero(((tracklet >= 0) & ~edited.deleted).T)
        number = tracklet[row, column]
        order = np.lexsort((row, number))
        row, column, number = row[order], column[order], number[order]
        rule, refused = edited.rule[row, column], edited.refused[row, column]
        new = (np.diff(number) != 0) | (np.diff(rule) != 0) | (np.diff(refused) != 0)
        ruled = np.cumsum(np.pad(edited.claim != ANYBODY, ((1, 0), (0, 0))), axis=0, dtype=np.int32)
        name = edited.labels.marker[row[:-1], column[:-1]]
        elsewhere = ruled[row[1:], name] > ruled[np.minimum(row[:-1] + 1, len(ruled) - 1), name]
        new |= (np.diff(row) > 1) & (name != NO_MARKER) & elsewhere
        found = np.full(tracklet.shape, -1)
        found[row, column] = np.concatenate([[0], np.cumsum(new)]) if len(row) else 0
        return found

    def of(self, tracklets: Tracklets) -> Tracklets:
        """Tracklets as `parted` cuts them, with what a person says of each as votes that nothing outweighs."""
        edited, markers = self.edited, self.edited.claim.shape[1]
        at = tracklets.first, tracklets.lane
        rule, refused = edited.rule[at], edited.refused[at]
        held = np.where((rule >= 0) & (rule < markers), rule, NO_MARKER)
        votes = tracklets.votes.copy()
        some = np.flatnonzero(refused != NO_MARKER)
        votes[some, refused[some]] = -RULING.odds
        for marker in np.flatnonzero((edited.claim == NOBODY).any(axis=0)):
            own = tracklets.table[edited.claim[:, marker] == NOBODY]
            part = np.bincount(own[own >= 0], minlength=len(tracklets)) / tracklets.count
            votes[part >= REFUSAL.min_half, marker] = -RULING.odds
        votes[rule >= markers] = -RULING.odds  # what has no name by an edit takes none from another
        some = np.flatnonzero(held != NO_MARKER)
        votes[some] = -RULING.odds
        votes[some, held[some]] = RULING.odds
        return replace(tracklets, votes=votes, held=held)

    def _solved_before(self, tracklets: Tracklets, marker: np.ndarray) -> np.ndarray:
        """The markers (N,) that tracklets are begun with, and where they have none, what they were solved to, if free.

        What was not sure enough to be named is so still, and what else it may be is tried again; but what is a marker
        that a person has named, or was the one that turned out to be it, follows from there.
        """
        if self.solved is None:
            return marker
        at = tracklets.first, tracklets.lane
        own = np.append(self.solved.every, NO_MARKER)[self.solved.tracklets.table[at]]
        open_ones = (marker == NO_MARKER) & (self.edited.rule[at] == FREE) & (own != self.edited.refused[at])
        named = tracklets.held != NO_MARKER
        open_ones &= ~np.isin(own, [*tracklets.held[named], *own[named]])
        return np.where(open_ones, own, marker)

    @property
    def extras(self) -> int:
        """How many unmodelled markers the take was solved with."""
        return 0 if self.solved is None else self.solved.extras

    def rivals(self, tracklets: Tracklets, marker: np.ndarray) -> Iterator[np.ndarray]:
        """What else the take may have been without the edits, as changes to names (N,) that it has now."""
        if self.solved is not None:
            at = self.solved.tracklets.table[tracklets.first, tracklets.lane]
            before = np.append(self.solved.every, NO_MARKER)[at]
            for rival in self.solved.rivals:
                other = np.append(rival, NO_MARKER)[at]
                yield np.where((other != before) & (marker == before), other, marker)

    def begun(self, tracklets: Tracklets) -> np.ndarray:
        """The markers (N,) that tracklets are begun with, where a person named one of two that may have been exchanged.

        What had the name until then is tried with the name that the other had.
        """
        first, last, held = tracklets.first, tracklets.last, tracklets.held
        at = tracklets.first, tracklets.lane
        marker = tracklets.with_held(self._solved_before(tracklets, self.start[at]))
        was, refused = self.before.marker[at], self.edited.refused[at]
        for index in np.flatnonzero((held != NO_MARKER) & (was != NO_MARKER) & (was != held)).tolist():
            beside = (first <= last[index]) & (last >= first[index])
            robbed = beside & (refused == held[index]) & (marker == NO_MARKER)
            if not (beside & (marker == was[index])).any():
                marker[robbed] = was[index]
        return marker

    def sure(self, tracklets: Tracklets, marker: np.ndarray, margin: np.ndarray) -> np.ndarray:
        """(N,) by how much names (N,) are ahead: those that no edit concerns are as sure at least as without any."""
        at = tracklets.first, tracklets.lane
        same = (self.before.marker[at] == marker) & (marker != NO_MARKER) & (self.edited.rule[at] == FREE)
        same &= self.edited.refused[at] == NO_MARKER
        with np.errstate(divide="ignore"):
            sure = np.log(self.before.confidence[at]) - np.log1p(-self.before.confidence[at])
        return np.where(same, np.maximum(margin, sure), margin)
