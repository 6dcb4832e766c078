# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that a fitted body gave to blobs, asked about in space by the objective that names takes of points.

A body that is followed keeps the names that it began with, and bends to them: two markers of a forearm that a lab wears
the other way round, or an arm that is named one place on. The distances between all points tell. Of two names that they
have otherwise, or do not tell apart, neither is given, and a person is asked.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from ..blobs.rereading import REREADING
from ..blobs.subject import Clock
from ..data.progress import finished
from ..data.takes import Blobs, LabelledChunk, Points, Suspect, summed
from ..edits.kinds import AssignBlob, Edits, Right
from ..geometry.cameras import Cameras
from ..geometry.measuring import measured_again
from ..points.models import Model
from ..points.tracklets import cut
from ..points.whole_take.deciding import can_be_solved, pairs_in_doubt, words_of_pair
from ..points.whole_take.pipeline import PointOptions, name_frames, solution_for
from .through_points import PointsOfBlobs

Pairs = list[tuple[int, int]]


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

    Names are given that are right in a part `target` of cases. A doubt is answered by the name of one of its two that a
    person gave to a blob, or said to be right in all of the take; in some frames that is said of gaps, too. By two
    cameras there is no telling, as their rays always meet somewhere.
    """
    told = (edit for edit in edits if isinstance(edit, AssignBlob) or (isinstance(edit, Right) and edit.frames is None))
    named = {model.markerset.by_name.get(name) for edit in told for name in edit.names}
    pairs: Pairs | None = None if len(cameras) > 2 else []
    for blobs, chunk in zip(chunks, labelled, strict=True):
        if pairs is None and np.count_nonzero(chunk.motion.confidence) >= REREADING.min_frames:
            clock = Clock()
            with clock("label"):
                pairs = pairs_of(chunk, points_without_names(blobs, chunk, cameras, rate), model, rate, target)
            pairs = [pair for pair in pairs if named.isdisjoint(pair)]
            chunk = replace(chunk, seconds=summed(chunk.seconds, clock.take()))
        yield _without(blobs, chunk, pairs, cameras, model) if pairs else chunk


def pairs_of(chunk: LabelledChunk, rest: Points | None, model: Model, rate: float, target: float) -> Pairs:
    """Which markers of a chunk may be which others, by the distances between them and all other points."""
    xyz, residual = chunk.motion.markers, chunk.motion.residual
    tracklet = cut(xyz, rate)
    if not can_be_solved(model, tracklet):
        return []
    if rest is not None:
        others = cut(rest.xyz, rate, rest.lanes)
        tracklet = np.hstack([tracklet, np.where(others >= 0, others + tracklet.max() + 1, others)])
        xyz, residual = np.hstack([xyz, rest.xyz[:]]), np.hstack([residual, rest.residual[:]])
    take = Points(("",) * xyz.shape[1], xyz, residual, rate, int(chunk.motion.frames[0]))
    with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
        frames = finished(name_frames(take, tracklet, model, PointOptions("likelihood", target, force=True)))
        solution = finished(solution_for(frames, frames.labels, tracklet))
    return [] if solution is None else pairs_in_doubt(solution, len(model.markerset), target)


def points_without_names(blobs: Blobs, chunk: LabelledChunk, cameras: Cameras, rate: float) -> Points | None:
    """The points that blobs without a name make, None where they make none: a chain of names may be one place on.

    Of those in the rectangle of the body's image, as ghosts are everywhere.
    """
    body = cameras.project(chunk.motion.expected)  # (C, T, M, 2)
    at, free = (blobs.camera, blobs.frame), ~chunk.labels.named
    within = (blobs.xy >= body.min(axis=2)[at]) & (blobs.xy <= body.max(axis=2)[at])
    points = PointsOfBlobs(cameras, rate)
    points.add(blobs.part(slice(0, len(blobs.frames)), np.flatnonzero(free & within.all(axis=1))))
    return points.take() if len(points.spans.lasting(points.frames)) else None


def _without(blobs: Blobs, chunk: LabelledChunk, pairs: Pairs, cameras: Cameras, model: Model) -> LabelledChunk:
    """A chunk in which no marker of the pairs has a name, and each pair is asked about, but nothing of these names."""
    doubted, names = np.unique(pairs), model.markerset.markers
    labels = chunk.labels.kept(~np.isin(chunk.labels.marker, doubted))
    before = chunk.unedited and chunk.unedited.kept(~np.isin(chunk.unedited.marker, doubted))
    first, last = (int(frame) for frame in chunk.motion.frames[[0, -1]])
    of_pairs = [tuple(names[one] for one in pair) for pair in pairs]
    unnamed = set().union(*of_pairs)
    left = tuple(one for one in chunk.suspects if not one.markers or not unnamed.issuperset(one.markers))
    suspects = left + tuple(Suspect(first, last, words_of_pair(pair), markers=pair) for pair in of_pairs)
    motion = measured_again(chunk.motion, blobs, chunk.labels, labels, cameras)
    return replace(chunk, labels=labels, unedited=before, motion=motion, suspects=suspects)
