# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that a fitted body gave to blobs, asked about in space by the objective that names takes of points.

A body that is followed keeps the names that it began with, and bends to them: two markers of a forearm that a lab wears
the other way round, or an arm that is named one place on. The distances between all points tell. Of two names that they
have otherwise, or do not tell apart, neither is given, and a person is asked.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from threadpoolctl import threadpool_limits

from ..blobs.rereading import REREADING
from ..blobs.subject import Clock
from ..data.markersets import Worn
from ..data.progress import finished
from ..data.takes import NO_MARKER, Blobs, LabelledChunk, Labels, Points, Suspect, summed
from ..edits.applying import apply_edits, cells_of_blobs
from ..edits.kinds import AssignBlob, BlobEdit, Edits, Right, Swap
from ..geometry.cameras import Cameras
from ..geometry.measuring import measured_again
from ..points.models import Model
from ..points.several.together import said_of
from ..points.several.wearers import Wearer
from ..points.tracklets import cut
from ..points.whole_take.deciding import can_be_solved, pairs_in_doubt, words_of_pair
from ..points.whole_take.pipeline import PointOptions, name_frames, solution_for
from .through_points import PointsOfBlobs

Pairs = list[tuple[int, int]]
Held = Sequence[tuple[Blobs, LabelledChunk]]


@dataclass(frozen=True, eq=False)
class Asked:
    """Whose names are asked about, and how sure they must be.

    worn     the markers of all who are in the take, of whom the subject's begin with `first`
    model    that of the subject
    rate     frames a second
    target   the part of cases in which names that are given are right
    edits    what a person said of all
    subject  who it is; None where nobody else is asked about
    points   what points say of a chunk's blobs; None where nothing does. Names that they bear out are not asked about
    """

    worn: Worn
    model: Model
    first: int
    rate: float
    target: float
    edits: Edits
    subject: Wearer | None = None
    points: Callable[[Blobs], Labels] | None = None

    @property
    def own(self) -> slice:
        """Where the subject's markers are among all."""
        return slice(self.first, self.first + len(self.model.markerset))

    def suspect(self, chunk: LabelledChunk, pair: tuple[int, int], named: bool) -> Suspect:
        """What is asked about two markers in a chunk, also after a person `named` blobs so."""
        first, last = (int(frame) for frame in chunk.motion.frames[[0, -1]])
        names = tuple(self.model.markerset.markers[one - self.first] for one in pair)
        suspect = Suspect(first, last, words_of_pair(names, named), markers=names)
        return suspect if self.subject is None else said_of(suspect, self.subject)


def asked_in_space(
    chunks: Iterable[Blobs], labelled: Iterable[LabelledChunk], cameras: Cameras, asked: Asked
) -> Iterator[LabelledChunk]:
    """The labelled chunks without the names that are in doubt in the first of them that shows enough of the subject.

    A blob that a person named as one of two answers which is which in all of the take, whichever the body had it as;
    chunks are held up to the last blob that was named so. That the two are to be exchanged, or that one is right in all
    of the take, answers, too. By two cameras there is no telling, as their rays always meet somewhere.
    """
    both, names = zip(chunks, labelled, strict=True), asked.worn.by_name
    held: list[tuple[Blobs, LabelledChunk]] = []
    for one in both:
        shown = np.count_nonzero(np.isfinite(one[1].motion.expected[:, asked.first, 0]))
        if len(cameras) > 2 and shown >= REREADING.min_frames:
            held.append(one)
            break
        yield from (chunk for _, chunk in held)
        held = [one]  # who comes in at its end has the names of the next
    else:
        yield from (chunk for _, chunk in held)
        return
    clock, (blobs, chunk) = Clock(), held[-1]
    with clock("label"):
        pairs = pairs_of(blobs, _without_person(blobs, chunk, cameras), cameras, asked)
    held[-1] = blobs, replace(chunk, seconds=summed(chunk.seconds, clock.take()))
    # Right in some frames is said of gaps, too.
    told = (edit for edit in asked.edits if isinstance(edit, Swap) or (isinstance(edit, Right) and edit.frames is None))
    settled = [{names[name] for name in edit.names} for edit in told]
    pairs = [pair for pair in pairs if not any(one <= set(pair) for one in settled)]
    if not pairs:
        yield from (chunk for _, chunk in chain(held, both))
        return
    answers = [edit for edit in asked.edits if isinstance(edit, AssignBlob) and names[edit.marker] in chain(*pairs)]
    last = max((edit.frame for edit in answers), default=0)
    while answers and held[-1][0].frames[-1] < last and (more := next(both, None)):
        held.append(more)
    right = _as_answered(held, pairs, cameras, asked)
    named = {names[edit.marker] for edit in answers}
    for blobs, chunk in chain(held, both):
        yield _renamed(blobs, chunk, right, pairs, named, cameras, asked)


def pairs_of(blobs: Blobs, chunk: LabelledChunk, cameras: Cameras, asked: Asked) -> Pairs:
    """Which markers of a chunk may be which others, by the distances between them and all other points."""
    own, model = asked.own, asked.model
    xyz, residual = chunk.motion.markers[:, own], chunk.motion.residual[:, own]
    tracklet = cut(xyz, asked.rate)
    if not can_be_solved(model, tracklet) or _borne_out(blobs, chunk, asked):
        return []
    rest = _points_without_names(blobs, chunk, cameras, asked)
    if rest is not None:
        others = cut(rest.xyz, asked.rate, rest.lanes)
        tracklet = np.hstack([tracklet, np.where(others >= 0, others + tracklet.max() + 1, others)])
        xyz, residual = np.hstack([xyz, rest.xyz[:]]), np.hstack([residual, rest.residual[:]])
    take = Points(("",) * xyz.shape[1], xyz, residual, asked.rate, int(chunk.motion.frames[0]))
    with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
        frames = finished(name_frames(take, tracklet, model, PointOptions("likelihood", asked.target, force=True)))
        solution = finished(solution_for(frames, frames.labels, tracklet))
    found = [] if solution is None else pairs_in_doubt(solution, len(model.markerset), asked.target)
    return [(one + asked.first, other + asked.first) for one, other in found]


def _borne_out(blobs: Blobs, chunk: LabelledChunk, asked: Asked) -> bool:
    """Whether points, if there are some, have most of each marker that is found for a while by the same name."""
    if asked.points is None:
        return False
    labels, points = chunk.labels, asked.points(blobs)
    some = labels.named & points.named, labels.named & (points.marker == labels.marker)
    both, same = (np.bincount(labels.marker[one], minlength=len(asked.worn))[asked.own] for one in some)
    found = np.isfinite(chunk.motion.markers[:, asked.own, 0]).sum(axis=0) >= REREADING.min_frames // 2
    return bool((~found | (2 * same > both)).all())


def _points_without_names(blobs: Blobs, chunk: LabelledChunk, cameras: Cameras, asked: Asked) -> Points | None:
    """The points that blobs without a name make, None where they make none: a chain of names may be one place on.

    Of those in the rectangle of the body's image, as ghosts are everywhere.
    """
    body = cameras.project(chunk.motion.expected[:, asked.own])  # (C, T, M, 2)
    at, free = (blobs.camera, blobs.frame), ~chunk.labels.named
    within = (blobs.xy >= body.min(axis=2)[at]) & (blobs.xy <= body.max(axis=2)[at])
    points = PointsOfBlobs(cameras, asked.rate)
    points.add(blobs.part(slice(0, len(blobs.frames)), np.flatnonzero(free & within.all(axis=1))))
    return points.take() if len(points.spans.lasting(points.frames)) else None


def _without_person(blobs: Blobs, chunk: LabelledChunk, cameras: Cameras) -> LabelledChunk:
    """A chunk with the names that the body gave before a person named some, as it bends to those in a few frames."""
    if chunk.unedited is None:
        return chunk
    motion = measured_again(chunk.motion, blobs, chunk.labels, chunk.unedited, cameras)
    return replace(chunk, labels=chunk.unedited, motion=motion)


def _as_answered(held: Held, pairs: Pairs, cameras: Cameras, asked: Asked) -> np.ndarray:
    """(M,) the marker that each name of the body is, by the blobs that a person named; NO_MARKER where none tells.

    Of markers that may be each other, the last is known by the rest.
    """
    edits, worn = asked.edits.of(edit for edit in asked.edits if isinstance(edit, BlobEdit)), asked.worn
    count = len(worn)
    said = np.zeros((count, count), int)  # how many blobs of each name a person gave each name
    for blobs, chunk in held if edits else ():
        before = chunk.unedited or chunk.labels
        edited = apply_edits(before, edits, cells_of_blobs(blobs, cameras.names, worn.by_name, count)).edited
        own = edited.named & before.named
        np.add.at(said, (before.marker[own], edited.labels.marker[own]), 1)
    right = np.arange(count)
    for alike in _groups(pairs):
        votes = said[np.ix_(alike, alike)]
        most = (2 * votes > votes.sum(axis=0)) & (2 * votes > votes.sum(axis=1, keepdims=True))
        known = np.argwhere(most)
        if len(known) == len(alike) - 1:
            rest = [np.setdiff1d(np.arange(len(alike)), one) for one in known.T]
            known = np.concatenate([known, np.array(rest).T])
        right[alike] = NO_MARKER
        right[alike[known[:, 0]]] = alike[known[:, 1]]
    return right


def _groups(pairs: Pairs) -> list[np.ndarray]:
    """The markers of the pairs, those together that may be each other, be it by way of others."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    doubted, ends = np.unique(pairs, return_inverse=True)
    one, other = ends.reshape(-1, 2).T
    count, group = connected_components(coo_array((np.ones(len(pairs)), (one, other)), (len(doubted),) * 2), False)
    return [doubted[group == number] for number in range(count)]


def _renamed(
    blobs: Blobs, chunk: LabelledChunk, right: np.ndarray, pairs: Pairs, named: set[int], cameras: Cameras, asked: Asked
) -> LabelledChunk:
    """A chunk with the names of the pairs as answered; without those that nothing tells, which are asked about instead.

    By the names that the body gave before a person `named` some, as it bends to those in a few frames only.
    """
    if (right == np.arange(len(right))).all():
        return chunk
    doubted, known = np.unique(pairs), np.flatnonzero(right != NO_MARKER)
    given = chunk.unedited or chunk.labels
    before = replace(given, marker=np.append(right, NO_MARKER)[given.marker])
    before = before.kept(before.named)
    labels = chunk.labels.kept(~np.isin(chunk.labels.marker, doubted))
    own = np.isin(given.marker, doubted)
    labels.put(own, before[own])
    motion = measured_again(chunk.motion, blobs, chunk.labels, labels, cameras)
    # The body stays, under the right names; where it took them over from the person, it has them.
    expected = motion.expected.copy()
    expected[:, right[known]] = motion.expected[:, known]
    off = [np.nansum(np.linalg.norm(motion.markers - one, axis=2), axis=1) for one in (expected, motion.expected)]
    motion = replace(motion, expected=np.where((off[0] <= off[1])[:, None, None], expected, motion.expected))
    unnamed = {asked.worn.markers[one] for one in np.setdiff1d(doubted, right)}
    suspects = tuple(one for one in chunk.suspects if not one.markers or not unnamed.issuperset(one.markers))
    open_pairs = (pair for pair in pairs if not np.isin(pair, right).all())
    suspects += tuple(asked.suspect(chunk, pair, not named.isdisjoint(pair)) for pair in open_pairs)
    unedited = None if chunk.unedited is None else before
    return replace(chunk, labels=labels, unedited=unedited, motion=motion, suspects=suspects)
