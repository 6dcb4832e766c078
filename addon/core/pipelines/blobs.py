# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of blobs from end to end: by a fitted body, or by the points that they make.

The counterpart of `points.whole_take.pipeline` for blobs. Memory does not grow with the take. What a person said of a
chunk holds in its labels, its markers in space and its doubts.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import tee

from ..blobs.pipeline import label_take
from ..blobs.search import NO_HINTS, Hints
from ..data.markersets import Worn
from ..data.takes import (
    BY_LIKELIHOOD,
    BY_PARTIAL_SOLVERS,
    BY_TRAJECTORY,
    CONFLICT,
    EXCLUSIVE,
    REMAINING,
    Blobs,
    LabelledChunk,
)
from ..edits.applying import apply_edits, cells_of_blobs
from ..edits.kinds import NO_EDITS, Edits
from ..geometry.cameras import Cameras
from ..geometry.measuring import measured_again, put_places
from ..papers.virtual_occlusions.occlusion import Occlusion
from ..points.models import Model, chosen_method, plain_method
from ..points.several.together import with_bodies_of
from ..points.whole_take.pipeline import USUAL_TARGET, PointOptions
from ..review.answering import unanswered, without_accepted
from .asked_in_space import Asked, asked_in_space
from .through_points import label_through_points


@dataclass(frozen=True, eq=False)
class BlobOptions:
    """How blobs are named."""

    rate: float  # frames a second
    method: str = "auto"  # one of `models.METHODS`
    # the part of the names that must be right, by what is asked in space; what is less sure is left unnamed
    target: float = USUAL_TARGET
    hints: Hints = NO_HINTS  # what the user may say about the take, for the fitted body
    occlusion: Occlusion | None = None  # the body in the way; None for the marker set's capsules
    edits: Edits = NO_EDITS  # what a person said of the labels; those that `edits.applying.refuse_unknown` lets pass
    force: bool = False  # names what labels through points would refuse


def blob_method(options: BlobOptions) -> str:
    """The method that "auto" stands for, or the one that was wanted."""
    return "fit" if options.method == "auto" else plain_method(options.method)


def steps_of(method: str, several: bool = False) -> tuple[int, ...]:
    """The steps by which a method can give labels, by index into STEPS; bodies of several name what has no point."""
    fitted, pointed = (EXCLUSIVE, CONFLICT, REMAINING), (BY_LIKELIHOOD, BY_PARTIAL_SOLVERS, BY_TRAJECTORY)
    return (*fitted, *pointed) if several else fitted if method == "fit" else pointed


def label_blobs(
    chunks: Iterable[Blobs], cameras: Cameras, model: Model, options: BlobOptions
) -> Iterator[LabelledChunk]:
    """Names the blobs of a take: one `LabelledChunk` for each of `chunks`, in their order.

    Raises InputError where the model does not know how, JobError when there are fewer than two cameras, or a frame has
    more blobs than any capture.
    """
    if not options.edits:
        return _labelled(chunks, cameras, model, options)
    own, named = tee(chunks)
    labelled = _labelled(named, cameras, model, options)
    return with_edits(own, labelled, options.edits, cameras, model.markerset)


def _labelled(chunks: Iterable[Blobs], cameras: Cameras, model: Model, options: BlobOptions) -> Iterator[LabelledChunk]:
    """The same with the edits as constraints only."""
    method = blob_method(options)
    if method == "fit":
        own, chunks = tee(chunks)
        given = options.rate, options.hints, options.occlusion, options.edits
        labelled = label_take(chunks, cameras, model.markerset, *given)
        asked = Asked(model.markerset, model, 0, options.rate, options.target, options.edits)
        return asked_in_space(own, labelled, cameras, asked)
    named = PointOptions(chosen_method(model, method), options.target, options.edits, force=options.force, traced=True)
    return label_through_points(chunks, cameras, model, options.rate, named)


def with_edits(
    chunks: Iterable[Blobs], labelled: Iterator[LabelledChunk], edits: Edits, cameras: Cameras, markerset: Worn
) -> Iterator[LabelledChunk]:
    """The labelled chunks with the edits applied; what these mean, a chunk's `unedited` labels tell where it has some.

    A marker whose blobs are others then is where these meet, and one that was placed is there; a body stays, unless it
    is the other one's by its markers.
    """
    names = markerset.by_name
    for blobs, chunk in zip(chunks, labelled, strict=True):
        cells = cells_of_blobs(blobs, cameras.names, names, len(markerset))
        before, first = chunk.labels, None
        if chunk.unedited is not None:
            before = chunk.unedited
            first = apply_edits(before, edits, cells)
            before = first.edited.below(before, chunk.labels)
        applied = apply_edits(before, edits, cells)
        motion = with_bodies_of(chunk.motion, blobs.frame, chunk.labels, applied.labels, markerset)
        motion = measured_again(motion, blobs, chunk.labels, applied.labels, cameras)
        put_places(motion, applied.places)
        yield replace(
            chunk,
            labels=applied.labels,
            motion=motion,
            suspects=without_accepted(unanswered(chunk.suspects, edits, names), edits),
            unedited=before,
            outcomes=(first or applied).outcomes,
        )
