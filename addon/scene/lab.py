# SPDX-License-Identifier: GPL-3.0-or-later
"""What a laboratory recorded beside a take: events as timeline markers, force plates as outlines with an arrow each."""

import json

import bpy
import numpy as np

from ..core.geometry.force_plates import LabRecords
from . import animation, ownership
from .clock import TakeClock
from .roots import parent_of

# On a take: the names and frames of its timeline markers, which hold no properties, and when in the file each is.
EVENTS = "mocap_events"
METRES_A_NEWTON = 0.001  # m, of an arrow; format
ARROW_POINTS = np.array([0.0, 0.0, 1.0])  # where an arrow points by itself
OUTLINE = ((0, 1), (1, 2), (2, 3), (3, 0))


def show_lab(
    scene: bpy.types.Scene,
    collection: bpy.types.Collection,
    name: str,
    lab: LabRecords,
    frames: np.ndarray,
    clock: TakeClock,
    actions: animation.TakeActions,
):
    """Adds what the file of a take called `name` records in the source's `frames` (F,) to scene and collection."""
    here = [(event, frame) for event, frame in lab.events if frames[0] <= round(frame) <= frames[-1]]
    markers = [scene.timeline_markers.new(event, frame=clock.whole(frame)) for event, frame in here]
    if markers:
        known = [(one.name, one.frame, frame) for one, (_, frame) in zip(markers, here, strict=True)]
        collection[EVENTS] = json.dumps(known)
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
            animation.key(bag, path, clock.shown(frames), values, arrow.name)
        ownership.sign(outline, f"plate {number}", collection)
        ownership.sign(arrow, f"force {number}", collection)


def forget_events(collection: bpy.types.Collection):
    """Takes the timeline markers of a take away, but for those that a person moved or renamed."""
    for scene in (one for one in bpy.data.scenes if collection in list(one.collection.children_recursive)):
        for known in json.loads(collection.get(EVENTS, "[]")):
            marker = _marker_of(scene, known)
            if marker is not None:
                scene.timeline_markers.remove(marker)


def move_events(scene: bpy.types.Scene, collection: bpy.types.Collection, clock: TakeClock):
    """Moves the timeline markers of a take to where its clock has them now, but for those that a person moved."""
    events = json.loads(collection.get(EVENTS, "[]"))
    for known in events:
        marker = _marker_of(scene, known)
        if marker is not None:
            # Files of earlier versions, which knew no other way, counted frame by frame.
            when = known[2] if len(known) > 2 else known[1] - clock.shift
            marker.frame = clock.whole(when)
            known[1:] = marker.frame, when
    if events:
        collection[EVENTS] = json.dumps(events)


def _marker_of(scene: bpy.types.Scene, known: list) -> bpy.types.TimelineMarker | None:
    """The timeline marker that is as it is known; None where a person moved, renamed or removed it."""
    return next((one for one in scene.timeline_markers if [one.name, one.frame] == known[:2]), None)


def _turns_to(vectors: np.ndarray) -> np.ndarray:
    """(F, 4) unit quaternions, w x y z, that turn ARROW_POINTS to where vectors (F, 3) point."""
    x, y, z = vectors.T
    turns = np.stack([np.linalg.norm(vectors, axis=1) + z, -y, x, np.zeros(len(x))], axis=1)
    turns[~turns.any(axis=1)] = 0, 1, 0, 0  # straight down
    return turns / np.linalg.norm(turns, axis=1, keepdims=True)
