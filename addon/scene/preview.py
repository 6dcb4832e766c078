# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs and points before they are labelled, kept in the file so that they can be looked at."""

import json
from dataclasses import replace

import bpy
import numpy as np

from ..core.data.takes import Blobs, Labels, Motion, PointRows, Points
from ..core.geometry.cameras import NO_CAMERAS, Cameras
from . import naming, ownership, storage
from .clock import TakeClock
from .ownership import numbers
from .storage import FRAME, add_cloud, cloud_table
from .stored import Stored
from .timing import SHIFT, keep_clock, kept_clock
from .units import METRE, metre_in

CAMERA_NAMES = "mocap_camera_names"


def store_preview(
    scene: bpy.types.Scene, name: str, blobs: Blobs, cameras: Cameras, rate: float, clock: TakeClock
) -> bpy.types.Mesh:
    """Keeps unlabelled `blobs`, seen by `cameras`, in a mesh of the file; as a take that plays by a clock."""
    columns = {"frame": blobs.frames[blobs.frame], "camera": blobs.camera, "xy": blobs.xy}
    mesh = storage.store_table(naming.title(name, "blobs"), columns)
    mesh[CAMERA_NAMES], mesh[METRE] = json.dumps(cameras.names), metre_in(scene)
    keep_clock(mesh, clock, rate, blobs.frames)
    return mesh


def read_preview(mesh: bpy.types.Mesh, cameras: Cameras) -> Stored:
    """The kept blobs as a take without labels, markers or motion; blobs of cameras that are gone are left out."""
    table, names = storage.read_table(mesh), json.loads(mesh[CAMERA_NAMES])
    index = np.array([cameras.names.index(name) if name in cameras.names else -1 for name in names], dtype=int)
    camera = index[table["camera"]]
    there = camera >= 0
    number = table["frame"][there]
    frames = np.arange(number[0], number[-1] + 1) if len(number) else np.zeros(0, dtype=int)
    area = np.full(len(number), np.nan)
    blobs = Blobs(frames, number - number[:1].sum(), camera[there], table["xy"][there], area)
    start = TakeClock.of(frames)  # of files older than choosing that
    return _unlabelled(mesh, cameras, blobs, kept_clock(mesh, start.first) if SHIFT in mesh else start)


def show_points(scene: bpy.types.Scene, name: str, take: Points, clock: TakeClock) -> bpy.types.Mesh:
    """Adds the points of an unlabelled take, which plays by a clock, to a scene as one object.

    Returns the mesh that keeps them.
    """
    rows = PointRows.of(replace(take, columns=None))
    title = naming.title(name, "points")
    mesh = cloud_table(title, rows.frames[rows.frame] + clock.shift, rows.xyz, trajectory=rows.trajectory)
    keep_clock(mesh, clock, take.rate, rows.frames)
    item, mesh[METRE] = add_cloud(scene.collection, mesh, clock), metre_in(scene)
    item.scale = [mesh[METRE]] * 3
    ownership.sign(item, "points")
    return mesh


def holds_points(mesh: bpy.types.Mesh) -> bool:
    """Whether a mesh keeps points, and not blobs."""
    return CAMERA_NAMES not in mesh


def read_points_preview(mesh: bpy.types.Mesh) -> Stored:
    """The kept points as a take without labels, markers, motion or cameras."""
    table = storage.read_table(mesh)
    number = table[FRAME] - int(mesh[SHIFT])
    frames, xyz = np.arange(number[0], number[-1] + 1), numbers(mesh.vertices, "co", 3).reshape(-1, 3).astype(float)
    rows = PointRows(frames, number - number[0], table["trajectory"], xyz, None)
    return _unlabelled(mesh, NO_CAMERAS, rows, kept_clock(mesh, int(number[0])))


def hide_preview(mesh: bpy.types.Mesh | None, hidden: bool):
    """Hides the object that shows unlabelled points, or shows it again."""
    for item in _objects(mesh):
        item.hide_viewport = hidden


def remove_preview(mesh: bpy.types.Mesh):
    """Removes unlabelled blobs or points with the object that shows them; one that a person changed or copied stays."""
    made = [item for item in _objects(mesh) if ownership.is_untouched(item)]
    ownership.let_go(ownership.former_of(made))
    if not made:
        ownership.remove_unused([mesh])


def _objects(mesh: bpy.types.Mesh | None) -> list[bpy.types.Object]:
    return [item for item in bpy.data.objects if mesh is not None and item.data == mesh]


def _unlabelled(mesh: bpy.types.Mesh, cameras: Cameras, rows: Blobs | PointRows, clock: TakeClock) -> Stored:
    """Rows as a take with nothing else."""
    count = len(rows.frames)
    none, points, turns = np.zeros((count, 0)), np.zeros((count, 0, 3)), np.zeros((count, 0, 3, 3))
    scale, confidence = np.full((count, 3), np.nan), np.zeros(count)
    motion = Motion(rows.frames, points, none, none, none, points, points, turns, scale, confidence)
    return Stored(mesh.name, 0.0, cameras, (), rows, Labels.none(len(rows)), motion, (), "", clock)
