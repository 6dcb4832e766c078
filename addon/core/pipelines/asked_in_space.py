# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that a fitted body gave to blobs, asked about in space by the objective that names takes of points.

A body that is followed keeps the names that it began with, and bends to them: two markers of a forearm that a lab wears
the other way round, or an arm that is named one place on. The distances between all points tell. Of two names that they
have otherwise, or do not tell apart, neither is given, and a person is asked.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
from threadpoolctl import threadpool_limits

from ..blobs.rereading import REREADING
from ..blobs.subject import Clock
from ..data.progress import finished
from ..data.takes import NO_MARKER, Blobs, LabelledChunk, Points, Suspect, summed
from ..edits.applying import apply_edits, cells_of_blobs
from ..edits.kinds import AssignBlob, BlobEdit, Edits, Right, Swap
from ..geometry.cameras import Cameras
from ..geometry.measuring import measured_again
from ..points.models import Model
from ..points.tracklets import cut
from ..points.whole_take.deciding import can_be_solved, pairs_in_doubt, words_of_pair
from ..points.whole_take.pipeline import PointOptions, name_frames, solution_for
from .through_points import PointsOfBlobs

Pairs = list[tuple[int, int]]
Held = Sequence[tuple[Blobs, LabelledChunk]]


def asked_in_space(
    chunks: Iterable[Blobs],
    labelled: Iterable[LabelledChunk],
    cameras: Cameras,
    model: Model,
    rate: float,
    target: float,
    edits: Edits,
) -> Iterator[LabelledChunk]:
    """The labelled chunks without the names that are in doubt in the first of them that shows enough of the subject.

    Names are given that are right in a part `target` of cases. A blob that a person named as one of two answers which
    is which in all of the take, whichever the body had it as; chunks are held up to the last blob that was named so.
    That the two are to be exchanged, or that one is right in all of the take, answers, too. By two cameras there is no
    telling, as their rays always meet somewhere.
    """
    both = zip(chunks, labelled, strict=True)
    for first in both:
        if len(cameras) > 2 and np.count_nonzero(first[1].motion.confidence) >= REREADING.min_frames:
            break
        yield first[1]
    else:
        return
    clock, names = Clock(), model.markerset.by_name
    with clock("label"):
        asked = _without_person(*first, cameras)
        pairs = pairs_of(first[0], asked, cameras, model, rate, target)
    first = first[0], replace(first[1], seconds=summed(first[1].seconds, clock.take()))
    # Right in some frames is said of gaps, too.
    told = (edit for edit in edits if isinstance(edit, Swap) or (isinstance(edit, Right) and edit.frames is None))
    settled = [{names[name] for name in edit.names} for edit in told]
    pairs = [pair for pair in pairs if not any(one <= set(pair) for one in settled)]
    if not pairs:
        yield first[1]
        yield from (chunk for _, chunk in both)
        return
    answers = [edit for edit in edits if isinstance(edit, AssignBlob) and names[edit.marker] in chain(*pairs)]
    held, last = [first], max((edit.frame for edit in answers), default=0)
    while answers and held[-1][0].frames[-1] < last and (more := next(both, None)):
        held.append(more)
    right = _as_answered(held, pairs, edits.of(edit for edit in edits if isinstance(edit, BlobEdit)), cameras, model)
    named = {names[edit.marker] for edit in answers}
    for blobs, chunk in chain(held, both):
        yield _renamed(blobs, chunk, right, pairs, named, cameras, model)


def pairs_of(blobs: Blobs, chunk: LabelledChunk, cameras: Cameras, model: Model, rate: float, target: float) -> Pairs:
    """Which markers of a chunk may be which others, by the distances between them and all other points."""
    xyz, residual = chunk.motion.markers, chunk.motion.residual
    tracklet = cut(xyz, rate)
    if not can_be_solved(model, tracklet):
        return []
    rest = _points_without_names(blobs, chunk, cameras, rate)
    if rest is not None:
        others = cut(rest.xyz, rate, rest.lanes)
        tracklet = np.hstack([tracklet, np.where(others >= 0, others + tracklet.max() + 1, others)])
        xyz, residual = np.hstack([xyz, rest.xyz[:]]), np.hstack([residual, rest.residual[:]])
    take = Points(("",) * xyz.shape[1], xyz, residual, rate, int(chunk.motion.frames[0]))
    with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
        frames = finished(name_frames(take, tracklet, model, PointOptions("likelihood", target, force=True)))
        solution = finished(solution_for(frames, frames.labels, tracklet))
    return [] if solution is None else pairs_in_doubt(solution, len(model.markerset), target)


def _points_without_names(blobs: Blobs, chunk: LabelledChunk, cameras: Cameras, rate: float) -> Points | None:
    """The points that blobs without a name make, None where they make none: a chain of names may be one place on.

    Of those in the rectangle of the body's image, as ghosts are everywhere.
    """
    body = cameras.project(chunk.motion.expected)  # (C, T, M, 2)
    at, free = (blobs.camera, blobs.frame), ~chunk.labels.named
    within = (blobs.xy >= body.min(axis=2)[at]) & (blobs.xy <= body.max(axis=2)[at])
    points = PointsOfBlobs(cameras, rate)
    points.add(blobs.part(slice(0, len(blobs.frames)), np.flatnonzero(free & within.all(axis=1))))
    return points.take() if len(points.spans.lasting(points.frames)) else None


def _without_person(blobs: Blobs, chunk: LabelledChunk, cameras: Cameras) -> LabelledChunk:
    """A chunk with the names that the body gave before a person named some, as it bends to those in a few frames."""
    if chunk.unedited is None:
        return chunk
    motion = measured_again(chunk.motion, blobs, chunk.labels, chunk.unedited, cameras)
    return replace(chunk, labels=chunk.unedited, motion=motion)


def _as_answered(held: Held, pairs: Pairs, edits: Edits, cameras: Cameras, model: Model) -> np.ndarray:
    """(M,) the marker that each name of the body is, by the blobs that a person named; NO_MARKER where none tells.

    Of markers that may be each other, the last is known by the rest.
    """
    count = len(model.markerset)
    said = np.zeros((count, count), int)  # how many blobs of each name a person gave each name
    for blobs, chunk in held if edits else ():
        before = chunk.unedited or chunk.labels
        edited = apply_edits(before, edits, cells_of_blobs(blobs, cameras.names, model.markerset.by_name, count)).edited
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
    blobs: Blobs, chunk: LabelledChunk, right: np.ndarray, pairs: Pairs, named: set[int], cameras: Cameras, model: Model
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
    first, last = (int(frame) for frame in chunk.motion.frames[[0, -1]])
    markers = model.markerset.markers
    unnamed = {markers[one] for one in np.setdiff1d(doubted, right)}
    suspects = tuple(one for one in chunk.suspects if not one.markers or not unnamed.issuperset(one.markers))
    for pair in pairs:
        if not np.isin(pair, right).all():
            names = tuple(markers[one] for one in pair)
            words = words_of_pair(names, named=not named.isdisjoint(pair))
            suspects += (Suspect(first, last, words, markers=names),)
    unedited = None if chunk.unedited is None else before
    return replace(chunk, labels=labels, unedited=unedited, motion=motion, suspects=suspects)
