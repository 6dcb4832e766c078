# SPDX-License-Identifier: GPL-3.0-or-later
"""What a laboratory recorded beside a take: events as timeline markers, force plates as outlines with an arrow each."""

import json

import bpy
import numpy as np

from ..core.geometry.force_plates import LabRecords
from . import animation, ownership
from .roots import parent_of

EVENTS = "mocap_events"  # on a take: the names and frames of its timeline markers, which hold no properties
METRES_A_NEWTON = 0.001  # m, of an arrow; format
ARROW_POINTS = np.array([0.0, 0.0, 1.0])  # where an arrow points by itself
OUTLINE = ((0, 1), (1, 2), (2, 3), (3, 0))


def show_lab(
    scene: bpy.types.Scene,
    collection: bpy.types.Collection,
    name: str,
    lab: LabRecords,
    frames: np.ndarray,
    shift: int,
    actions: animation.TakeActions,
):
    """Adds what the file of a take called `name` records in the source's `frames` (F,) to scene and collection."""
    here = [(event, round(frame)) for event, frame in lab.events if frames[0] <= round(frame) <= frames[-1]]
    markers = [scene.timeline_markers.new(event, frame=frame + shift) for event, frame in here]
    if markers:
        collection[EVENTS] = json.dumps([(one.name, one.frame) for one in markers])
    if not lab.plates:
        return
    place = ownership.made_collection(collection, collection, f"{name} force plates", "force plates")
    at = np.clip(frames - lab.first, 0, len(lab.plates[0].force) - 1)
    for number, plate in enumerate(lab.plates, 1):
        mesh = bpy.data.meshes.new(f"{name} force plate {number}")
        mesh.from_pydata(plate.corners.tolist(), OUTLINE, [])
        outline, arrow = bpy.data.objects.new(mesh.name, mesh), bpy.data.objects.new(f"{name} force {number}", None)
        for item in (outline, arrow):
            item.hide_render, item.parent = True, parent_of(collection)
            place.objects.link(item)
        arrow.empty_display_type, arrow.empty_display_size = "SINGLE_ARROW", 1.0
        arrow.rotation_mode, arrow.show_in_front = "QUATERNION", True
        force, where = plate.force[at], plate.place[at]
        acting = np.isfinite(where).all(axis=1) & np.isfinite(force).all(axis=1)
        size = np.where(acting, np.linalg.norm(force, axis=1), 0.0)
        keys = {
            "location": np.where(acting[:, None], where, plate.corners.mean(axis=0)),
            "rotation_quaternion": _turns_to(np.where(acting[:, None], force, ARROW_POINTS)),
            "scale": np.tile(METRES_A_NEWTON * size[:, None], 3),
        }
        bag = animation.channels(arrow, actions.for_keys(sum(values.size for values in keys.values())))
        for path, values in keys.items():
            animation.key(bag, path, frames + shift, values, arrow.name)
        ownership.sign(outline, f"plate {number}", collection)
        ownership.sign(arrow, f"force {number}", collection)


def forget_events(collection: bpy.types.Collection):
    """Takes the timeline markers of a take away, but for those that a person moved or renamed."""
    for scene in (one for one in bpy.data.scenes if collection in list(one.collection.children_recursive)):
        for known in json.loads(collection.get(EVENTS, "[]")):
            for marker in scene.timeline_markers:
                if [marker.name, marker.frame] == known:
                    scene.timeline_markers.remove(marker)
                    break


def _turns_to(vectors: np.ndarray) -> np.ndarray:
    """(F, 4) unit quaternions, w x y z, that turn ARROW_POINTS to where vectors (F, 3) point."""
    x, y, z = vectors.T
    turns = np.stack([np.linalg.norm(vectors, axis=1) + z, -y, x, np.zeros(len(x))], axis=1)
    turns[~turns.any(axis=1)] = 0, 1, 0, 0  # straight down
    return turns / np.linalg.norm(turns, axis=1, keepdims=True)
