# SPDX-License-Identifier: GPL-3.0-or-later
"""Several bodies followed through the same frames, which share out the blobs.

Before a frame is named, each track says where the body's markers will be: what is plainly one's is not offered to the
others. All are followed by the code that follows one.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from ..body.bodies import Bodies
from ..geometry.views import NOWHERE, VIEWING, Sight, View
from .pipeline import ChunkInWork, TakeLabeller
from .subject import Setup
from .tracking import TRACKING, Track

PLAINLY = 2.0  # measured: times as far as from another's marker that a blob must be from one's own, not to be offered


def followed_in_step(labellers: Sequence[TakeLabeller], chunks: Sequence[ChunkInWork]) -> Iterator[int]:
    """Names a chunk for each of several at a time, who are found in one frame; gives each frame once it is named.

    Ends early where somebody is lost, so that not all are in the same frame any more.
    """
    works = [labeller.steps(chunk) for labeller, chunk in zip(labellers, chunks, strict=True)]
    at = None
    while True:
        steps = [next(work, None) for work in works]
        if at is not None:
            if not all(at in chunk.results for chunk in chunks):
                return
            yield at
        each = [step for step in steps if step is not None]
        if len(each) < len(works) or len({frame for frame, _ in each}) > 1:
            return
        at = each[0][0]
        given = [track for _, track in each], labellers[0].setup, [chunk.fixed[at] for chunk in chunks]
        for chunk, view in zip(chunks, shared(chunks[0].whole[at], *given), strict=True):
            chunk.views[at] = view


def shared(view: View, tracks: Sequence[Track], setup: Setup, fixed: Sequence[np.ndarray | None]) -> list[View]:
    """What each of several may name of a view, of whose blobs a person named some: for each `fixed` (C, M), or None."""
    off = _off(view, setup.sight, _led_to(tracks, setup))
    for own, slots in enumerate(fixed):
        if slots is not None:
            camera, marker = np.nonzero(slots >= 0)
            off[:, camera, slots[camera, marker]] = np.inf
            off[own, camera, slots[camera, marker]] = 0.0
    found = []
    for own in range(len(tracks)):
        nearest = np.delete(off, own, axis=0).min(axis=0)
        found.append(without(view, PLAINLY**2 * nearest < off[own]))
    return found


def without(view: View, taken: np.ndarray) -> View:
    """The view without the blobs that are `taken` (C, K)."""
    real = view.real & ~taken
    return View(np.where(real[..., None], view.image, NOWHERE), real, view.row)


def _led_to(tracks: Sequence[Track], setup: Setup) -> np.ndarray:
    """(S, M, 3) m, where the markers of each will be in the next frame."""
    bodies = Bodies.join([track.subject.bodies for track in tracks])
    bodies = bodies.moved(TRACKING.velocity_kept * np.concatenate([track.velocity for track in tracks]))
    return setup.model.pose(bodies).markers + np.array([track.lag for track in tracks])


def _off(view: View, sight: Sight, points: np.ndarray) -> np.ndarray:
    """(S, C, K) m², squared distance of blobs from the nearest marker (S, M, 3) m, seen or hidden."""
    local = sight.local(points)
    image = sight.image(local)
    # Axis by axis: NumPy is slow to add up two of something.
    square = (view.image[:, :, None, 0] - image[:, :, None, :, 0]) ** 2
    square += (view.image[:, :, None, 1] - image[:, :, None, :, 1]) ** 2
    square *= np.maximum(local[..., 2], VIEWING.min_depth_m)[:, :, None] ** 2
    return square.min(axis=3)
