# SPDX-License-Identifier: GPL-3.0-or-later
"""A labelled take of 20,000 frames of 62 markers, in pieces, among ghosts: what the scene is timed on.

Runs inside Blender too, so it needs nothing but the extension's own code.
"""

from dataclasses import replace
from itertools import cycle

import numpy as np

from addon.core.body.bodies import BodyModel
from addon.core.data.markersets import MarkerSet
from addon.core.data.takes import BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels, Motion, PointRows, Suspect
from addon.core.geometry import rotations
from addon.core.geometry.cameras import NO_CAMERAS
from addon.io.markersets import open_markerset

FRAMES, MARKERS, RATE = 20_000, 62, 120.0
GAPS, GHOSTS, SUSPECTS = 600, 2, 150


def many_markers() -> MarkerSet:
    """The markers of `actor53`, and some of them once more a little farther out."""
    known = open_markerset("actor53")
    more = MARKERS - len(known)
    of = np.concatenate([np.arange(len(known)), np.arange(more)])
    offsets = known.offsets[of].copy()
    offsets[len(known) :] *= 1.1
    modes = np.zeros((0, len(known.skeleton) + MARKERS, 3))
    return replace(
        known,
        markers=(*known.markers, *(f"X{number}" for number in range(more))),
        aliases={},
        attachment=known.attachment[of],
        offsets=offsets,
        spread=replace(known.spread, modes=modes, marker_sd=np.full(MARKERS, 0.01)),
    )


def long_motion(markerset: MarkerSet, rng: np.random.Generator) -> Motion:
    """Somebody who goes in circles and bends, with gaps of every marker."""
    model, time = BodyModel(markerset), np.arange(FRAMES) / RATE
    bends = 0.3 * np.sin(time[:, None, None] * 3 + np.arange(len(markerset.skeleton))[None, :, None] + np.arange(3))
    bends[:, 0] = 0
    bodies = replace(
        model.rest(FRAMES, 1.75),
        translation=np.column_stack([np.cos(0.3 * time), np.sin(0.3 * time), 0 * time]),
        quaternion=rotations.about_z(0.5 * time),
        bends=bends,
    )
    posed = model.pose(bodies)
    markers = posed.markers.copy()
    for marker, first, length in zip(
        rng.integers(MARKERS, size=GAPS), rng.integers(FRAMES, size=GAPS), rng.integers(5, 200, GAPS), strict=True
    ):
        markers[first : first + length, marker] = np.nan
    seen = np.isfinite(markers[..., 0])
    return Motion(
        np.arange(1, FRAMES + 1),
        markers,
        residual=np.where(seen, 0.0005, np.nan),
        residual_px=np.full(seen.shape, np.nan),
        conflicts=np.zeros(seen.shape, dtype=int),
        expected=posed.markers,
        joints=posed.joints,
        rotations=posed.rotations,
        scale=bodies.scale,
        confidence=np.ones(FRAMES),
    )


def long_take():
    """A labelled take of points: each marker another trajectory behind each of its gaps."""
    from addon.scene.take import Take

    rng = np.random.default_rng(0)
    markerset = many_markers()
    motion = long_motion(markerset, rng)
    seen = np.isfinite(motion.markers[..., 0])
    begins = seen & ~np.vstack([np.zeros((1, MARKERS), dtype=bool), seen[:-1]])
    number = np.cumsum(begins.T.ravel()).reshape(MARKERS, FRAMES).T - 1
    frame, marker = np.nonzero(seen)
    ghosts = np.repeat(np.arange(FRAMES), GHOSTS)
    frame = np.concatenate([frame, ghosts])
    trajectory = np.concatenate([number[seen], number.max() + 1 + np.tile(np.arange(GHOSTS), FRAMES)])
    xyz = np.concatenate([motion.markers[seen], rng.random((len(ghosts), 3))])
    marker = np.concatenate([marker, np.full(len(ghosts), NO_MARKER)])
    order = np.lexsort((trajectory, frame))
    marker, named = marker[order], marker[order] != NO_MARKER
    rows = PointRows(motion.frames, frame[order], trajectory[order], xyz[order], np.full(len(order), 0.0005))
    labels = Labels(marker, np.where(named, BY_TRAJECTORY, NO_STEP), named * 1.0)
    suspects = tuple(
        Suspect(100 * index + 1, 100 * index + 50, f"{name} jumps", None, (name,))
        for index, name in zip(range(SUSPECTS), cycle(markerset.markers), strict=False)
    )
    return Take("long", RATE, NO_CAMERAS, markerset, rows, labels, motion, suspects, "long.c3d")
