# SPDX-License-Identifier: GPL-3.0-or-later
"""A calibration refined by a take of its own: label, find what was moved, adjust, label again.

Parts of the take are labelled, spread over it. The odd ones are adjusted to; the even ones say how good it is, so that
what is told of errors is of blobs that no camera was fitted to.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from ..blobs.pipeline import label_take
from ..data.errors import JobError
from ..data.markersets import MarkerSet
from ..data.physical import MARKER_LIMITS, SIGMAS
from ..data.takes import NO_MARKER, Blobs, LabelledChunk
from ..data.wording import count_of
from ..geometry.cameras import Cameras
from ..review.camera_order import CAMERA_HEALTH
from ..review.odd_cameras import CameraCheck
from .adjusting import Sightings, adjusted, held

# Of a take so many parts are labelled, spread over it, of so many frames at most: what a subject is known by after, and
# little enough to do twice. A second of each says where cameras are within their noise.
REFINING_PARTS, REFINED_AT_ONCE = 12, 40
REFINING_ROUNDS = 3  # of labelling and adjusting: cameras that were moved get their names in the second


@dataclass(frozen=True, eq=False)
class Refinement:
    """What became of C cameras."""

    cameras: Cameras  # refined, or as they were where nothing was to be refined
    refined: bool  # whether they were
    # (C,) px: reprojection error with the calibration as it was, median over blobs that nothing was fitted to
    before: np.ndarray
    after: np.ndarray  # (C,) px: the same with `cameras`; NaN in both where a camera has no such blobs
    blobs: np.ndarray  # (C,) how many these are
    shifted: np.ndarray  # (C,) m that each camera was moved
    turned: np.ndarray  # (C,) rad that each was turned
    rounds: int  # of labelling
    frames: int  # that were labelled
    doubts: tuple[str, ...] = ()  # sentences about what was odd of the cameras


def parts_of(first: int, last: int) -> list[tuple[int, int]]:
    """The frames of a take from `first` to `last` that are looked at: first and last frame of each part, ascending."""
    count = last - first + 1
    parts = min(REFINING_PARTS, count)
    length = min(REFINED_AT_ONCE, count // parts)
    starts = first + np.linspace(0, count - length, parts).round().astype(int)
    return [(int(start), int(start) + length - 1) for start in starts]


def refine_cameras(
    parts: Sequence[Blobs], cameras: Cameras, markerset: MarkerSet, rate: float
) -> Generator[tuple[float, str], None, Refinement]:
    """Moves and turns the cameras so that the named blobs of the parts of a take meet. Intrinsics stay.

    Raises JobError where this calibration cannot be refined by this take: too few cameras, cameras with each other's
    names, another room's calibration or unit, nobody recognised, too little seen. Yields the share that is done, and
    what it is doing.
    """
    if len(cameras) < 3:
        raise JobError(f"{len(cameras)} cameras cannot tell which of them was moved; expected three or more")
    yield 0.0, "look at the room"
    _refuse_room(_unlabelled(parts, cameras, markerset))
    given, rounds = cameras, 0
    doubts: tuple[str, ...] = ()
    while True:
        span = (rounds / REFINING_ROUNDS, (rounds + 1) / REFINING_ROUNDS)
        labelled, check = yield from _labelled(parts, given, markerset, rate, span)
        if not rounds:
            _refuse_room(check)
            _refuse_nobody(check, markerset.name)
            doubts = tuple(suspect.reason for suspect in check.suspects())
        rounds += 1
        places, more = check.moved, rounds < REFINING_ROUNDS
        if places and more:
            rotation, translation = given.rotation.copy(), given.translation.copy()
            for index, place in places.items():
                rotation[index], translation[index] = place.rotation, place.translation
            given = replace(given, rotation=rotation, translation=translation)
            continue
        yield span[1], "adjust the cameras"
        with threadpool_limits(1, user_api="blas"):
            fitted, kept_back = (_seen(parts, labelled, cameras, first) for first in (0, 1))
            chosen = fitted.spread(given)
            free = chosen.blobs(len(given)) >= CAMERA_HEALTH.enough
            adjusted_now = held(cameras, adjusted(given, chosen, free), chosen)
            still = _image_shift(given, adjusted_now, fitted) < MARKER_LIMITS.noise_px
        given = adjusted_now
        if still or not more:
            break
    yield 1.0, "compare"
    frames = sum(len(part.frames) for part in parts)
    return _judged(cameras, given, kept_back, rounds, frames, doubts)


def _labelled(
    parts: Sequence[Blobs], cameras: Cameras, markerset: MarkerSet, rate: float, span: tuple[float, float]
) -> Generator[tuple[float, str], None, tuple[list[LabelledChunk], CameraCheck]]:
    """Each part labelled on its own, and what that says of the cameras."""
    check, labelled = CameraCheck(cameras, markerset), []
    for number, part in enumerate(parts):
        yield span[0] + (span[1] - span[0]) * number / len(parts), f"label frames from {part.frames[0]}"
        [chunk] = label_take([part], cameras, markerset, rate)
        check.add(part, chunk.labels.marker, chunk.motion.expected)
        labelled.append(chunk)
    return labelled, check


def _unlabelled(parts: Sequence[Blobs], cameras: Cameras, markerset: MarkerSet) -> CameraCheck:
    """What the blobs alone say of the room: labelling in a wrong one takes long and shows nothing."""
    check = CameraCheck(cameras, markerset)
    for part in parts:
        nowhere = np.full((len(part.frames), len(markerset), 3), np.nan)
        check.add(part, np.full(len(part), NO_MARKER), nowhere)
    return check


def _refuse_room(check: CameraCheck):
    """JobError where moving cameras would mend nothing."""
    if check.wrong_room:
        raise JobError(f"{check.wrong_room}; expected the calibration that the take was recorded with, in metres")
    if check.order is not None:
        raise JobError(f"{check.suspects()[0].reason}; expected every camera's blobs under its own name")


def _refuse_nobody(check: CameraCheck, name: str):
    """JobError where nobody was labelled to go by."""
    seen = check.counts[0].max()
    if 0 < seen < CAMERA_HEALTH.enough:
        return  # somebody, in too few frames: what is named in them is counted next
    if not check.usual > 1 - CAMERA_HEALTH.max_lacking:
        raise JobError(
            f"nobody was recognised, so there are no named blobs to go by; expected a take of somebody who wears {name}"
        )


def _seen(parts: Sequence[Blobs], labelled: Sequence[LabelledChunk], cameras: Cameras, first: int) -> Sightings:
    """What every other part shows, from the first or the second on."""
    pairs = [(part, chunk.labels) for part, chunk in zip(parts, labelled, strict=True)]
    found = Sightings.of(pairs[first::2] or pairs, cameras)
    if found.count < CAMERA_HEALTH.enough:
        raise JobError(
            f"three cameras see {count_of(found.count, 'named marker')} at a time; expected {CAMERA_HEALTH.enough} or "
            "more, so a longer take, or more cameras that look at the same place"
        )
    return found


def _image_shift(one: Cameras, other: Cameras, seen: Sightings) -> float:
    """The px by which the camera that moved most sees the points elsewhere, median over its blobs."""
    points, away = seen.met(other), []
    for index in np.unique(seen.camera):
        mine = points[seen.point[seen.camera == index]]
        there, here = (cameras.select([index]).project(mine)[0] for cameras in (one, other))
        away.append(np.nanmedian(np.linalg.norm(there - here, axis=1)))
    return float(np.max(away))


def _judged(
    before: Cameras, after: Cameras, kept_back: Sightings, rounds: int, frames: int, doubts: tuple[str, ...]
) -> Refinement:
    """The refined cameras where they are clearly better in the blobs kept back, else those before."""
    old, new = kept_back.errors(before), kept_back.errors(after)
    gain, count = old - new, kept_back.blobs(len(before))
    with np.errstate(invalid="ignore", divide="ignore"):
        # About how surely a median of so many is known, of blobs that are never more exact than their noise.
        better = gain > SIGMAS * np.maximum(old, MARKER_LIMITS.noise_px) / np.sqrt(count)
    refined = bool(better.any() and np.nanmean(gain) > 0)
    cameras, errors = (after, new) if refined else (before, old)
    shifted = np.linalg.norm(cameras.centres - before.centres, axis=1)
    turned = 2 * np.arcsin(np.linalg.norm(cameras.rotation - before.rotation, axis=(1, 2)) / np.sqrt(8))
    return Refinement(cameras, refined, old, errors, count, shifted, turned, rounds, frames, doubts)
