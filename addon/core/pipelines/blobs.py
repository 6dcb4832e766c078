# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of blobs from end to end: by a fitted body, by the points that they make, or both ways at once.

The counterpart of `pipelines.points` for blobs. Memory does not grow with the take.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import tee

from ..blobs.pipeline import Options, label_take
from ..body.occlusion import Occlusion
from ..data.errors import InputError
from ..data.models import Model
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
from ..geometry.cameras import Cameras
from ..points.naming import chosen_method
from .cross_check import Agreement, label_both_ways
from .points import USUAL_TARGET
from .through_points import label_through_points

Way = Callable[[Iterable[Blobs]], Iterator[LabelledChunk]]


@dataclass(frozen=True, eq=False)
class BlobOptions:
    """How blobs are named.

    method     one of `naming.METHODS`
    rate       frames a second
    target     of labels by way of points: the part that must be right; what is less sure is left unnamed
    hints      what the user may say about the take, for the fitted body
    occlusion  the body in the way; None for the marker set's capsules
    """

    method: str = "auto"
    rate: float = 100.0
    target: float = USUAL_TARGET
    hints: Options = field(default_factory=Options)
    occlusion: Occlusion | None = None


def blob_method(options: BlobOptions) -> str:
    """The method that "auto" stands for, or the one that was wanted."""
    return {"auto": "fit", "evidence": "likelihood"}.get(options.method, options.method)


def steps_of(method: str) -> tuple[int, ...]:
    """The steps by which a method can give labels, by index into STEPS."""
    fitted, pointed = (EXCLUSIVE, CONFLICT, REMAINING), (BY_LIKELIHOOD, BY_PARTIAL_SOLVERS, BY_TRAJECTORY)
    return {"fit": fitted, "both": (*fitted, *pointed)}.get(method, pointed)


def label_blobs(
    chunks: Iterable[Blobs], cameras: Cameras, model: Model, options: BlobOptions, agreement: Agreement
) -> Iterator[LabelledChunk]:
    """Names the blobs of a take: one `LabelledChunk` for each of `chunks`, in their order.

    With both ways `agreement` is added to.
    Raises InputError where the model does not know how, JobError when there are fewer than two cameras, or a frame has
    more blobs than any capture.
    """
    ways = _ways(cameras, model, options)
    if len(ways) == 1:
        return ways[0](chunks)
    own, *each = tee(chunks, 3)
    named = (way(part) for way, part in zip(ways, each, strict=True))
    return label_both_ways(own, *named, model.markerset.markers, agreement)


def _ways(cameras: Cameras, model: Model, options: BlobOptions) -> list[Way]:
    """The ways in which blobs are to be named."""

    def fit(chunks: Iterable[Blobs]) -> Iterator[LabelledChunk]:
        return label_take(chunks, cameras, model.markerset, options.rate, options.hints, options.occlusion)

    wanted = blob_method(options)
    if wanted == "fit":
        return [fit]
    method = chosen_method(model, "auto" if wanted == "both" else wanted)
    if method == "fit":
        raise InputError(
            f"model {model.markerset.name} has nothing to name points by; expected one made by train, or --method fit"
        )

    def points(chunks: Iterable[Blobs]) -> Iterator[LabelledChunk]:
        return label_through_points(chunks, cameras, model, method, options.rate, options.hints, options.target)

    return [fit, points] if wanted == "both" else [points]
