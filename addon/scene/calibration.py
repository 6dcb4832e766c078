# SPDX-License-Identifier: GPL-3.0-or-later
"""What the scene remembers of calibrations: what is odd about a take's cameras, and what a refining did to each."""

import json
from collections.abc import Sequence

import bpy

from ..core.geometry.cameras import Cameras
from . import cameras as scene_cameras

HEALTH = "mocap_health"
REFINED = "mocap_refined"


def keep_health(take: bpy.types.Collection, sentences: Sequence[str]):
    """Keeps with a take what is odd about its cameras."""
    take[HEALTH] = json.dumps(list(sentences))


def kept_health(take: bpy.types.Collection | None) -> list[str] | None:
    """What is odd about a take's cameras, a sentence each; None where nobody looked."""
    return json.loads(take[HEALTH]) if take is not None and HEALTH in take else None


def kept_refinement(cameras: bpy.types.Collection | None) -> dict | None:
    """The report of the refining that made these cameras; None where none did."""
    return json.loads(cameras[REFINED]) if cameras is not None and REFINED in cameras else None


def show_refined(
    scene: bpy.types.Scene, before: bpy.types.Collection, cameras: Cameras, report: dict
) -> bpy.types.Collection:
    """Adds refined cameras in the place of those before, which are hidden; gives their collection.

    The scene's camera becomes the refined one of the same name.
    """
    through = scene.camera
    collection = scene_cameras.find_or_add_cameras(scene, cameras)
    collection[REFINED] = json.dumps(report)
    if through is not None and through.name in before.all_objects:
        name = scene_cameras.camera_name(through)
        same = [item for item in collection.objects if scene_cameras.camera_name(item) == name]
        scene_cameras.look_through(scene, same[0])
    before.hide_viewport = True
    return collection
