# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person said of a take of several: each subject hears what is theirs, and that the rest is not.

What is somebody else's marker by an edit is to everyone else as what is no marker at all.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...data.takes import NO_MARKER, Labels, Verdict
from ...edits.applying import AppliedEdits, apply_edits, cells_of_take
from ...edits.kinds import Edits
from ...edits.replay import FREE, Edited
from ..whole_take.pipeline import Steps, decided_of, solution_for, without_deleted
from ..whole_take.rulings import Rulings
from .bodies import Crowd, NamedBody, OnlyWhere
from .together import Everybody, joined, own_labels


@dataclass(frozen=True, eq=False)
class EditedSubjects:
    """A take of several with its edits: the labels (T, L) of which these give those in the end, and what they say."""

    unedited: Labels
    applied: AppliedEdits
    verdict: Verdict


def with_edits(crowd: Crowd, found: Everybody, edits: Edits) -> Steps[EditedSubjects]:
    """Everybody solved again with what the edits say."""
    cells = cells_of_take(crowd.take, found.worn.by_name, len(found.worn))
    before = found.verdict.labels
    first = apply_edits(before, edits, cells)
    verdicts = []
    for one, place in zip(found.found, found.worn.firsts, strict=True):
        size = len(one.subject.model.markerset)
        own = edited_of(first.edited, place, size)
        # Whom an edit has left without a marker takes none that is another's.
        others = (before.marker != NO_MARKER) & ((before.marker < place) | (before.marker >= place + size))
        may = one.may.copy()
        may[crowd.tracklet[others]] = False
        verdicts.append((yield from _corrected(crowd, one.body, own, own_labels(before, place, size), may)))
    again = joined(found.worn, verdicts)
    unedited = first.edited.below(before, again.labels)
    applied = replace(apply_edits(unedited, edits, cells), outcomes=first.outcomes)
    return EditedSubjects(unedited, applied, Verdict(applied.labels, again.suspects))


def _corrected(crowd: Crowd, one: NamedBody, edited: Edited, before: Labels, may: np.ndarray) -> Steps[Verdict]:
    """What is said of one body (N,) once it has heard what the edits say of it."""
    theirs = np.zeros(len(crowd) + 1, bool)
    theirs[crowd.tracklet[edited.named]] = True
    own = np.where(edited.deleted, -1, crowd.tracklets_of(may | theirs[:-1]))
    rulings = Rulings(edited, before, own, one.solution)
    frames = replace(one.frames, take=crowd.points_of(may | theirs[:-1]), tracklet=own)
    frames = replace(frames, labels=OnlyWhere(one.frames.labels, own))
    deleted = edited.deleted & (one.frames.tracklet >= 0)
    ruled = rulings.applied_to((yield from without_deleted(frames, deleted)))
    parted = rulings.parted()
    solution = yield from solution_for(frames, ruled, parted, rulings)
    return decided_of(frames, ruled, parted, solution, crowd.options.target)


def edited_of(edited: Edited, first: int, size: int) -> Edited:
    """What edits say of one subject of all, whose `size` markers begin at `first`, by the subject's own markers."""
    every = edited.claim.shape[1]
    rule, last = edited.rule, first + size
    given = (rule >= 0) & (rule < every)
    mine = given & (rule >= first) & (rule < last)
    others = given & ~mine
    again = np.select([mine, others | (rule == every), rule == every + 1], [rule - first, size, size + 1], FREE)
    refused = edited.refused
    refused = np.where((refused >= first) & (refused < last), refused - first, NO_MARKER)
    return Edited(
        own_labels(edited.labels, first, size),
        edited.row,
        again,
        refused,
        edited.claim[:, first:last],
        (),  # exchanges are told by the labels of all
    )
