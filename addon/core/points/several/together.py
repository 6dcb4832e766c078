# SPDX-License-Identifier: GPL-3.0-or-later
"""What is said of each subject put together: labels that count the markers of all in a row, what to look at, motion.

The markers and joints of one come after those of the other. Of what a person said, each subject hears what is theirs,
and that the rest is not: what is somebody else's marker by an edit is to everyone else as what is no marker at all.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Self

import numpy as np

from ...body.bodies import Bodies, BodyModel
from ...body.prior import Prior
from ...data.lanes import blocks
from ...data.made import Made, Table
from ...data.markersets import MarkerSet, Skeleton, Worn
from ...data.progress import finished
from ...data.takes import NO_MARKER, Labels, Motion, Points, Suspect, Verdict
from ...edits.applying import AppliedEdits, apply_edits, cells_of_take
from ...edits.kinds import Edits
from ...edits.replay import FREE, Edited
from ...geometry.rotations import carried
from ...posing.posing import subject_of
from ..motion import (
    SUBJECT_FRAMES,
    LabelledPoints,
    MotionInParts,
    PosedFrames,
    TakeMotion,
    by_marker,
    posed_as,
    take_motion,
)
from ..whole_take.pipeline import (
    PointOptions,
    Steps,
    decided_of,
    name_frames,
    refuse_solved,
    solution_for,
    without_deleted,
)
from ..whole_take.rulings import Rulings
from .bodies import Crowd, NamedBody, OnlyWhere, recognised_before
from .identification import MAX_OVERLAP, UnidentifiedPresence, doubt_contested
from .parting import NO_BODY
from .wearers import SetsWorn, Wearer


@dataclass(frozen=True, eq=False)
class SubjectsMotion(MotionInParts):
    """The motion of each subject of a take."""

    subjects: tuple[TakeMotion, ...]

    @classmethod
    def of(cls, subjects: Sequence[TakeMotion]) -> Self:
        """That of subjects in the same frames."""
        markers = _tables_beside([one.markers for one in subjects])
        residual = _tables_beside([one.residual for one in subjects])
        return cls(markers, residual, subjects[0].frames, tuple(subjects))

    def part(self, frames: slice) -> Motion:
        """The motion of all in the frames from start to stop: and where anybody is found at all."""
        return beside(self.each(frames))

    def each(self, frames: slice) -> list[Motion]:
        """The motion of each subject in the frames from start to stop."""
        return [one.part(frames) for one in self.subjects]

    def suspects(self, names: tuple[str, ...], rate: float) -> tuple[Suspect, ...]:
        """What each body shows that is doubtful, by the names of all markers in a row."""
        found: list[Suspect] = []
        first = 0
        for one in self.subjects:
            size = one.markers.shape[1]
            found += one.suspects(names[first : first + size], rate)
            first += size
        return tuple(found)


def beside(each: Sequence[Motion]) -> Motion:
    """The motion of several subjects in the same frames as one, as `SubjectsMotion.part` has it."""
    tables = {
        name: np.concatenate([getattr(one, name) for one in each], axis=1)
        for name in ("markers", "residual", "residual_px", "conflicts", "expected", "joints", "rotations", "scale")
    }
    confidence = np.max([one.confidence for one in each], axis=0)
    return Motion(frames=each[0].frames, confidence=confidence, **tables)


def measured_of_first(motion: Motion, each: Sequence[Motion]) -> Motion:
    """That of some subjects, with their markers as they were measured in that of all, of whom they are the first."""
    own = beside(each)
    measured = ("markers", "residual", "residual_px", "conflicts")
    return replace(own, **{name: getattr(motion, name)[:, : own.markers.shape[1]] for name in measured})


OF_BODIES = "joints", "rotations", "scale"


class BodiesAnew:
    """One subject of a take that comes chunk by chunk, posed with the joints of a set, on who the first chunk shows."""

    def __init__(self, markerset: MarkerSet):
        self.model = BodyModel(markerset)
        self.prior = Prior(self.model)
        self.subject: Bodies | None = None

    def of(self, places: np.ndarray) -> PosedFrames:
        """The body on markers at places (F, M, 3) m."""
        if self.subject is None and np.isfinite(places).any():
            self.subject = subject_of(self.model, places, self.prior, SUBJECT_FRAMES)
        return posed_as(self.model, places, self.prior, self.subject)


class FinerBodies:
    """The bodies of a take that comes chunk by chunk, posed again with the joints that a finer set has more."""

    def __init__(self, worn: Worn, finer: Worn):
        """By the sets that the bodies were fitted with, and those with the same markers that they are to have."""
        self._sets = [markerset for _, markerset in worn.worn]
        self._finer = [markerset for _, markerset in finer.worn]
        # Where markers are on the same segments, nothing shows how more joints bend.
        self._anew = [
            None if np.array_equal(one.attachment, more.attachment) else BodiesAnew(more)
            for one, more in zip(self._sets, self._finer, strict=True)
        ]

    def of(self, motion: Motion) -> Motion:
        """The motion with those bodies: on the markers that were measured, and where the fitted body has the others."""
        places, each = _places(motion), []
        for number, (finer, anew) in enumerate(zip(self._finer, self._anew, strict=True)):
            own = places[:, _columns("expected", self._sets, number)]
            if anew is None:
                parts = (getattr(motion, name)[:, _columns(name, self._sets, number)] for name in OF_BODIES)
                each.append(longer(PosedFrames(own, *parts), finer.skeleton))
            else:
                each.append(anew.of(own))
        return replace(
            motion, **{name: np.concatenate([getattr(one, name) for one in each], axis=1) for name in OF_BODIES}
        )


def posed_again(motion: Motion, markerset: MarkerSet) -> Motion:
    """The motion of one subject with the body of a set of the same markers whose joints are others."""
    body = BodiesAnew(markerset).of(_places(motion))
    return replace(motion, **{name: getattr(body, name) for name in OF_BODIES})


def _places(motion: Motion) -> np.ndarray:
    """(F, M, 3) m where markers were measured and, where they were not, where the fitted body has them."""
    return np.where(np.isfinite(motion.markers) & np.isfinite(motion.expected), motion.markers, motion.expected)


def longer(body: PosedFrames, skeleton: Skeleton) -> PosedFrames:
    """A body with the joints at the end of a skeleton that it lacks, which are turned as those above them."""
    joints, turns = body.joints, body.rotations
    for at in range(joints.shape[1], len(skeleton)):
        above = [skeleton.parents[at]]
        way = carried(turns[:, above], (skeleton.offsets[at] * body.scale)[:, None])
        joints = np.concatenate([joints, joints[:, above] + way], axis=1)
        turns = np.concatenate([turns, turns[:, above]], axis=1)
    return replace(body, joints=joints, rotations=turns)


def with_bodies_of(motion: Motion, frame: np.ndarray, before: Labels, after: Labels, worn: Worn) -> Motion:
    """The motion with the bodies of two exchanged in the frames in which their markers are, or most of them.

    frame (N,) is that of each row, and before and after (N,) are the labels that the bodies were fitted to and those
    that edits gave. Only bodies of one skeleton can be exchanged; of a single set nothing changes.
    """
    sets = [markerset for _, markerset in worn.worn]
    if len(sets) < 2 or (before.marker == after.marker).all():
        return motion
    count, frames = len(sets), len(motion.frames)
    whose = np.repeat(np.arange(count), [len(one) for one in sets])
    rows = before.named & after.named
    moved = np.zeros((frames, count, count), int)
    np.add.at(moved, (frame[rows], whose[before.marker[rows]], whose[after.marker[rows]]), 1)
    every = moved.sum(axis=2)
    most = 2 * moved > every[..., None]
    tables = {name: getattr(motion, name).copy() for name in ("expected", "joints", "rotations", "scale")}
    for one, other in combinations(range(count), 2):
        # Of whom nothing is there the markers cannot go to anybody.
        to, back = most[:, one, other] | (every[:, one] == 0), most[:, other, one] | (every[:, other] == 0)
        at = np.flatnonzero(to & back & (every[:, one] + every[:, other] > 0))
        if not len(at) or sets[one].skeleton.parents.tolist() != sets[other].skeleton.parents.tolist():
            continue
        for name, table in tables.items():
            first, second = (_columns(name, sets, number) for number in (one, other))
            if first.stop - first.start == second.stop - second.start:
                table[at, first], table[at, second] = table[at, second], table[at, first]
    return replace(motion, **tables)


def _columns(name: str, sets: Sequence[MarkerSet], number: int) -> slice:
    """Where a subject's columns of a table of `beside` are."""
    size = {"expected": len, "scale": lambda _: 3}.get(name, lambda one: len(one.skeleton))
    first = sum(size(one) for one in sets[:number])
    return slice(first, first + size(sets[number]))


def _tables_beside(tables: Sequence[Table]) -> Made:
    """Tables (T, M, …) of several subjects as one, of any frames as an array."""
    first, width = tables[0].shape, sum(one.shape[1] for one in tables)
    shape = (first[0], width, *first[2:])
    return Made(shape, lambda frames: np.concatenate([one[frames] for one in tables], axis=1))


@dataclass(frozen=True, eq=False)
class LabelledSubjects(LabelledPoints):
    """What the labelling says of a take of several; labels count the markers of all subjects in a row, by `worn`."""

    motion: SubjectsMotion
    worn: SetsWorn
    left: np.ndarray  # (T, L) True for the points of who is left without names, as it may be several


@dataclass(frozen=True, eq=False)
class FoundSubject:
    """A subject, the body, the tracklets (N,) that it may have, and what is said of it alone."""

    subject: Wearer
    body: NamedBody
    may: np.ndarray
    verdict: Verdict


@dataclass(frozen=True, eq=False)
class Everybody:
    """Who is in a take, the verdict on all of them, labels (T, L) by `worn`; and presences that may be anybody's."""

    found: tuple[FoundSubject, ...]
    worn: SetsWorn
    verdict: Verdict
    unidentified: tuple[UnidentifiedPresence, ...] = ()

    @classmethod
    def of(cls, found: Sequence[FoundSubject], unidentified: tuple[UnidentifiedPresence, ...] = ()) -> Self:
        """Those who were found, in their order."""
        worn = SetsWorn(tuple(one.subject for one in found))
        return cls(tuple(found), worn, joined(worn, [one.verdict for one in found]), unidentified)


def verdict_on(one: NamedBody, target: float) -> Verdict:
    """What is said of one; UnsuitedError where the model is not for it."""
    verdict = decided_of(one.frames, one.frames.labels, one.frames.tracklet, one.solution, target)
    refuse_solved(one.frames, one.solution, verdict.labels)
    return verdict


def joined(worn: SetsWorn, verdicts: Sequence[Verdict]) -> Verdict:
    """What is said of all of them; what two have is nobody's. Those whom nobody asked for have nothing to look at."""
    whole = Labels.none(*verdicts[0].labels.marker.shape)
    suspects: list[Suspect] = []
    for part in blocks(*whole.marker.shape):
        taken = np.sum([verdict.labels.marker[part] != NO_MARKER for verdict in verdicts], axis=0)
        for first, verdict in zip(worn.firsts, verdicts, strict=True):
            own = verdict.labels[part]
            at = own.named & (taken == 1)
            whole.marker[part][at] = own.marker[at] + first
            whole.step[part][at], whole.confidence[part][at] = own.step[at], own.confidence[at]
    for subject, verdict in zip(worn.asked.subjects, verdicts, strict=False):
        suspects += [said_of(suspect, subject) for suspect in verdict.suspects]
    return Verdict(whole, tuple(suspects))


def said_of(suspect: Suspect, subject: Wearer) -> Suspect:
    """What is said of a subject, with whom it is said of."""
    markers = tuple(f"{subject.name}:{marker}" for marker in suspect.markers)
    return replace(suspect, words=f"{subject.name}: {suspect.words}", markers=markers)


def own_labels(labels: Labels, first: int, size: int) -> Labels:
    """The labels (T, L) of one subject of all, whose `size` markers begin at `first`, by the subject's own markers."""
    own = labels.kept((labels.marker >= first) & (labels.marker < first + size))
    return replace(own, marker=np.where(own.named, own.marker - first, NO_MARKER))


def motion_of_all(
    take: Points, labels: Labels, worn: SetsWorn, options: PointOptions, places: Mapping[tuple[int, int], np.ndarray]
) -> SubjectsMotion:
    """Everybody's markers and body, by the labels (T, L) of all; `places` are where a person placed markers of all."""
    parts = []
    for subject, first in zip(worn.subjects, worn.firsts, strict=True):
        size = len(subject.model.markerset)
        own = own_labels(labels, first, size)
        put = {(at, marker - first): xyz for (at, marker), xyz in places.items() if first <= marker < first + size}
        markers = by_marker(take.xyz, own, size, put)
        residual = by_marker(take.residual, own, size, dict.fromkeys(put, 0.0))  # not measured
        given = markers, residual, own, subject.model.markerset, take.frames, options.room
        parts.append(finished(take_motion(*given)))
    return SubjectsMotion.of(parts)


def with_edits(crowd: Crowd, found: Everybody, edits: Edits) -> Steps[tuple[Labels, AppliedEdits, Verdict]]:
    """Everybody solved again with what the edits say, as of a take of one.

    The labels (T, L) of which the edits give those in the end, what the edits say, and the verdict with them.
    """
    cells = cells_of_take(crowd.take, found.worn.by_name, len(found.worn))
    before = found.verdict.labels
    first = apply_edits(before, edits, cells)
    corrected, given = [], _said_of_left(crowd, found, first.edited)
    for one, place, more in zip(found.found, found.worn.firsts, given.T, strict=True):
        size = len(one.subject.model.markerset)
        own = edited_of(first.edited, place, size)
        # Whom an edit has left without a marker takes none that is another's.
        others = (before.marker != NO_MARKER) & ((before.marker < place) | (before.marker >= place + size))
        may = one.may | more
        may[crowd.tracklet[others]] = False
        body = (yield from _with_frames(crowd, one.body, more)) if more.any() else one.body
        corrected.append((yield from _Corrected.of(crowd, body, own, own_labels(before, place, size), may)))
    doubt_contested([one.body for one in corrected], crowd.options)
    again = joined(found.worn, [one.verdict(crowd.options.target) for one in corrected])
    unedited = first.edited.below(before, again.labels)
    applied = replace(apply_edits(unedited, edits, cells), outcomes=first.outcomes)
    return unedited, applied, Verdict(applied.labels, again.suspects)


def _with_frames(crowd: Crowd, one: NamedBody, more: np.ndarray) -> Steps[NamedBody]:
    """The body with what frames say on their own of `more` tracklets (N,) that are found to be its."""
    own = crowd.tracklets_of(more)
    frames = yield from name_frames(crowd.points_of(more), own, one.model, crowd.options, recognised_before)
    labels = one.frames.labels.whole().kept(own < 0)
    labels.put(own >= 0, frames.labels.whole()[own >= 0])
    return replace(one, frames=replace(one.frames, labels=labels))


def _said_of_left(crowd: Crowd, found: Everybody, edited: Edited) -> np.ndarray:
    """(N, S) the tracklets of those who were left without names that are each one's, as a person named some of them.

    Whoever is there at the same time is somebody else, and so may have become known, too.
    """
    worn, left = found.worn, list(found.unidentified)
    whose = np.repeat(np.arange(len(worn.subjects)), [len(one.model.markerset) for one in worn.subjects])
    given = np.zeros((len(crowd), len(worn.subjects)), bool)
    if not left:
        return given
    named = np.append(whose, NO_BODY)[found.verdict.labels.marker]
    there = np.stack([(named == one).any(axis=1) for one in range(len(worn.subjects))], axis=1)
    while left:
        for one in left:
            own = edited.named & np.append(one.tracklets, False)[crowd.tracklet]
            may = np.unique(whose[edited.labels.marker[own]])
            if not len(may):
                may = np.flatnonzero(there[one.there].mean(axis=0) <= MAX_OVERLAP)
            if len(may) == 1:
                given[one.tracklets, may] = True
                there[one.there, may] = True
                left.remove(one)
                break
        else:
            break
    return given


@dataclass(frozen=True, eq=False)
class _Corrected:
    """A body that has heard what edits say of it: what frames say now, and its tracklets (T, L), parted by them."""

    body: NamedBody
    rulings: Rulings
    ruled: Labels
    parted: np.ndarray

    @classmethod
    def of(cls, crowd: Crowd, one: NamedBody, edited: Edited, before: Labels, may: np.ndarray) -> Steps[Self]:
        """That of a body which may have tracklets (N,), with its labels before."""
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
        return cls(NamedBody(one.model, frames, solution, one.sure), rulings, ruled, parted)

    def verdict(self, target: float) -> Verdict:
        """What is said of it, where no edit makes another name less sure."""
        solution = self.body.solution
        if solution is not None:
            margin = self.rulings.sure(solution.tracklets, solution.marker, solution.margin)
            solution = replace(solution, margin=margin)
        return decided_of(self.body.frames, self.ruled, self.parted, solution, target)


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
