# SPDX-License-Identifier: GPL-3.0-or-later
"""A character's own mesh as an animator has one: one smooth skin around the bones, weighted by Blender, no capsules.

It stands for the meshes that users bring. Its shape comes from the marker set's capsules, with more flesh, so it knows
no more of the person who is labelled than the marker set does. It needs bpy.
"""

import bpy
import numpy as np

from addon.core.data.markersets import MarkerSet
from addon.scene.armature import Build, add_armature, mean_build
from addon.scene.body import capsule_in_metres, capsule_place, capsule_shape
from addon.scene.occlusion import MeshOcclusion, occlusion_of

FLESH = 1.06  # times the capsules' radii, before smoothing takes some of it
VOXEL = 0.008  # m: fingers would be lost, which no marker set has
SMOOTHINGS = 10


def character_occlusion(markerset: MarkerSet) -> MeshOcclusion:
    """The body in the way that the sidebar makes of a character on a marker set's skeleton. The open scene is gone."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    armature, skin = add_character(bpy.context, markerset)
    return occlusion_of(bpy.context, armature, [skin], markerset)


def add_character(context: bpy.types.Context, markerset: MarkerSet) -> tuple[bpy.types.Object, bpy.types.Object]:
    """Adds the skeleton of the marker set's mean person and a skin around it: armature and mesh object."""
    build = mean_build(markerset)
    armature = add_armature(context, context.scene.collection, "Character", markerset, build)
    skin = bpy.data.objects.new("Skin", _smooth_union(context, markerset, build))
    context.scene.collection.objects.link(skin)
    skin.select_set(True)
    armature.select_set(True)
    context.view_layer.objects.active = armature
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    return armature, skin


def capsule_corners(markerset: MarkerSet, build: Build, flesh: float) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """Corners (V, 3) m and faces of all capsules of the person at rest, their radii times `flesh`."""
    corners, faces, count = [], [], 0
    for index, segment in enumerate(markerset.capsules.segment):
        capsule = capsule_in_metres(markerset, index, build.scale)
        place, half = capsule_place(capsule)
        shape, sides = capsule_shape(half, flesh * capsule.radius)
        corners.append(shape @ place[:3, :3].T + place[:3, 3] + build.joints[segment])
        faces += [tuple(count + corner for corner in side) for side in sides]
        count += len(shape)
    return np.concatenate(corners), faces


def _smooth_union(context: bpy.types.Context, markerset: MarkerSet, build: Build) -> bpy.types.Mesh:
    """One closed skin around all capsules, its creases smoothed."""
    corners, faces = capsule_corners(markerset, build, FLESH)
    mesh = bpy.data.meshes.new("Skin")
    mesh.from_pydata(corners.tolist(), [], faces)
    raw = bpy.data.objects.new("Raw", mesh)
    context.scene.collection.objects.link(raw)
    remesh = raw.modifiers.new("Union", "REMESH")
    remesh.mode, remesh.voxel_size = "VOXEL", VOXEL
    smooth = raw.modifiers.new("Smooth", "SMOOTH")
    smooth.factor, smooth.iterations = 0.5, SMOOTHINGS
    skin = bpy.data.meshes.new_from_object(raw.evaluated_get(context.evaluated_depsgraph_get()))
    bpy.data.objects.remove(raw)
    return skin
