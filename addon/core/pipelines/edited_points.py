# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of points labelled again with what a person said of it: edits are evidence, and they hold in the end.

What edits such as an exchange mean, the labels without them tell. From there on every edit says of points what they
are, or are not; the take is solved again with that, and the edits are applied to what comes of it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..data.takes import BY_FIT, EditOutcome, Labels, Points, Suspect, Verdict
from ..edits.answering import unanswered
from ..edits.applying import AppliedEdits, PointCells, apply_to_points
from ..edits.kinds import Edits
from ..points.naming import Namer
from ..points.whole_take.rulings import Rulings

# Decides again: what frames say (T, P), the tracklets (T, P) and rulings in, a verdict out.
Decider = Callable[[Labels, np.ndarray, Rulings], Verdict]


@dataclass(frozen=True, eq=False)
class EditedVerdict:
    """A verdict of which a person edited nothing, or something.

    verdict   labels (T, P) and suspects, as the edits have them
    unedited  labels (T, P) of which the edits give these; None where nothing was edited
    applied   what the edits say; None where nothing was edited
    """

    verdict: Verdict
    unedited: Labels | None = None
    applied: AppliedEdits | None = None

    @property
    def outcomes(self) -> tuple[EditOutcome, ...]:
        """What became of each edit."""
        return () if self.applied is None else self.applied.outcomes

    def unanswered(self, suspects: tuple[Suspect, ...], cells: PointCells | None) -> tuple[Suspect, ...]:
        """The suspects, of trajectories by their column, that no edit answers."""
        if self.applied is None:
            return suspects
        return unanswered(suspects, self.applied.edited, cells.names, cells.first_frame, cells.present)


def with_edits(
    verdict: Verdict,
    named: Labels,
    tracklet: np.ndarray,
    take: Points,
    namer: Namer,
    edits: Edits,
    cells: PointCells,
    decide_again: Decider,
) -> EditedVerdict:
    """The verdict on a take, decided again with its edits.

    named is what frames said on their own, tracklet (T, P) the tracklets, and verdict what came of the two.
    """
    first = apply_to_points(verdict.labels, edits, cells)
    rulings = Rulings(first.edited, verdict.labels, tracklet)
    heard = rulings.heard(_without_deleted(named, take, namer, rulings))
    again = decide_again(heard, rulings.parted(), rulings)
    unedited = first.edited.below(verdict.labels, again.labels)
    applied = apply_to_points(unedited, edits, cells)
    return EditedVerdict(
        Verdict(applied.labels, again.suspects),
        unedited,
        AppliedEdits(applied.labels, applied.edited, first.outcomes, applied.places),
    )


def _without_deleted(named: Labels, take: Points, namer: Namer, rulings: Rulings) -> Labels:
    """What frames say once the points that are no markers are gone from them."""
    deleted = rulings.edited.deleted
    frames = np.flatnonzero(deleted.any(axis=1))
    if not len(frames) or namer.step == BY_FIT:  # which needs all frames in their order
        return named
    seen = np.where(deleted[frames, :, None], np.nan, take.xyz[frames])
    anew = Labels.join(namer.name(seen, take.rate))
    columns = ("marker", "step", "confidence", "rate")
    copies = [getattr(named, name).copy() for name in columns]
    for name, whole in zip(columns, copies, strict=True):
        whole[frames] = getattr(anew, name)
    return Labels(*copies)
