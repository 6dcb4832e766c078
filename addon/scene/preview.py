# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs before they are labelled, kept in the file so that they can be looked at through their cameras."""

import json

import bpy
import numpy as np

from ..core.cameras import Cameras
from ..core.takes import NO_MARKER, NO_STEP, Blobs, Labels, Motion
from . import naming, storage
from .take import Stored, frame_shift

CAMERA_NAMES = "mocap_camera_names"


def store_preview(name: str, blobs: Blobs, cameras: Cameras) -> bpy.types.Mesh:
    """Keeps unlabelled `blobs`, seen by `cameras`, in a mesh of the file."""
    columns = {"frame": blobs.frames[blobs.frame], "camera": blobs.camera, "xy": blobs.xy}
    mesh = storage.store_table(naming.title(name, "blobs"), columns)
    mesh[CAMERA_NAMES] = json.dumps(cameras.names)
    return mesh


def read_preview(mesh: bpy.types.Mesh, cameras: Cameras) -> Stored:
    """The kept blobs as a take without labels, markers or motion; blobs of cameras that are gone are left out."""
    table = storage.read_table(mesh)
    names = json.loads(mesh[CAMERA_NAMES])
    index = np.array([cameras.names.index(name) if name in cameras.names else -1 for name in names], dtype=int)
    camera = index[table["camera"]]
    there = camera >= 0
    number = table["frame"][there]
    frames = np.arange(number[0], number[-1] + 1) if len(number) else np.zeros(0, dtype=int)
    count, rows = len(frames), int(there.sum())
    blobs = Blobs(frames, number - number[:1].sum(), camera[there], table["xy"][there], np.full(rows, np.nan))
    labels = Labels(np.full(rows, NO_MARKER), np.full(rows, NO_STEP), np.zeros(rows))
    shift = frame_shift(frames)
    return Stored(mesh.name, 0.0, cameras, (), blobs, labels, _no_motion(frames, count), (), "", shift)


def _no_motion(frames: np.ndarray, count: int) -> Motion:
    none, points = np.zeros((count, 0)), np.zeros((count, 0, 3))
    return Motion(
        frames,
        points,
        none,
        none,
        none,
        points,
        points,
        np.zeros((count, 0, 3, 3)),
        np.full((count, 3), np.nan),
        np.zeros(count),
    )
