# SPDX-License-Identifier: GPL-3.0-or-later
"""A take for the trajectory timeline, as long as one likes: 62 markers with gaps, doubts and ghosts, nothing measured.

Runs inside Blender too, so it takes the extension's modules by name.
"""

import importlib
from dataclasses import replace

import numpy as np

MARKERS = 62
RATE, HEIGHT = 120.0, 1.75
GHOSTS, FLICKERS = 20, 600  # trajectories without a name, long and short ones


def make_take(extension: str, frames: int):
    """A `Take` of points; `extension` is the name of the package that holds `addon`."""
    of = lambda name: importlib.import_module(f"{extension}.addon.{name}")  # noqa: E731
    data, scenes = of("core.data.takes"), of("scene.take")
    rng = np.random.default_rng(5)
    markerset = wide_markerset(of("io.markersets").open_markerset("actor53"))
    joints = len(markerset.skeleton)
    time = np.arange(frames) / RATE
    way = np.column_stack([np.sin(time), np.sin(0.7 * time), 0 * time])
    markers = HEIGHT * markerset.rest_markers + way[:, None]
    bodies = HEIGHT * markerset.skeleton.rest_joints + way[:, None]
    whole = markers.copy()
    for marker in range(0, MARKERS, 2):
        for start in rng.integers(0, frames, max(2, frames // 400)):
            markers[start : start + rng.integers(1, 90), marker] = np.nan
    present = np.isfinite(markers[..., 0])
    residual = np.where(present, 0.0003, np.nan)
    unturned = np.broadcast_to(np.eye(3), (frames, joints, 3, 3)).copy()
    motion = data.Motion(
        1 + np.arange(frames), markers, residual, residual * np.nan, np.zeros(present.shape, int), whole,
        bodies, unturned, np.full((frames, 3), HEIGHT), np.ones(frames),
    )  # fmt: skip
    frame, marker = np.nonzero(present)
    rows = [(frame, marker, markers[present], marker)]
    for ghost in range(GHOSTS + FLICKERS):
        length = rng.integers(frames // 3, frames) if ghost < GHOSTS else rng.integers(1, 60)
        start = rng.integers(0, frames - length + 1)
        own = start + np.arange(length)
        place = np.tile(rng.uniform(-2, 2, 3), (length, 1))
        rows.append((own, np.full(length, MARKERS + ghost), place, np.full(length, data.NO_MARKER)))
    frame, trajectory, xyz, name = (np.concatenate(column) for column in zip(*rows, strict=True))
    order = np.lexsort((trajectory, frame))
    frame, trajectory, xyz, name = frame[order], trajectory[order], xyz[order], name[order]
    named = name != data.NO_MARKER
    sure = np.where((name % 7 == 3) & ((frame // 50) % 9 == 4), 0.9, 0.999)
    labels = data.Labels(name, np.where(named, data.BY_LIKELIHOOD, data.NO_STEP), np.where(named, sure, 0.0))
    points = data.PointRows(motion.frames, frame, trajectory, xyz, np.full(len(frame), 0.0003))
    doubts = tuple(
        data.Suspect(int(at), int(at) + 30, f"{markerset.markers[at % MARKERS]} jumps", None)
        for at in rng.integers(1, frames, 20)
    )
    cameras = of("core.geometry.cameras").NO_CAMERAS
    return scenes.Take("long", RATE, cameras, markerset, points, labels, motion, doubts)


def wide_markerset(markerset):
    """A marker set with so many markers, some of them worn twice."""
    own = np.arange(MARKERS) % len(markerset)
    names = tuple(markerset.markers[i] if n < len(markerset) else f"{markerset.markers[i]}B" for n, i in enumerate(own))
    spread = markerset.spread
    joints = len(markerset.skeleton)
    modes = np.concatenate([spread.modes[:, :joints], spread.modes[:, joints:][:, own]], axis=1)
    spread = replace(spread, modes=modes, marker_sd=spread.marker_sd[own])
    attachment, offsets = markerset.attachment[own], markerset.offsets[own]
    return replace(markerset, markers=names, aliases={}, attachment=attachment, offsets=offsets, spread=spread)
