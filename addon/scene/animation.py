# SPDX-License-Identifier: GPL-3.0-or-later
"""Keys in bulk: thousands of frames of many channels into one action, one slot an object."""

import bpy
import numpy as np

LINEAR = 1  # the value of BEZT_IPO_LIN behind Keyframe.interpolation
# The values of BEZT_KEYTYPE_KEYFRAME and BEZT_KEYTYPE_GENERATED behind Keyframe.type, from Blender 4.4 on: the second
# is for keys that are "set automatically by a tool", and is drawn and selected apart.
SET_BY_HAND, SET_BY_TOOL = 0, 5


def bind(item: bpy.types.Object, action: bpy.types.Action) -> bpy.types.ActionChannelbag:
    """Gives `item` a slot of its own in `action` and returns that slot's channels."""
    slot = action.slots.new(id_type="OBJECT", name=item.name)
    data = item.animation_data_create()
    data.action = action
    data.action_slot = slot
    layer = action.layers[0] if len(action.layers) else action.layers.new("Take")
    strip = layer.strips[0] if len(layer.strips) else layer.strips.new(type="KEYFRAME")
    return strip.channelbag(slot, ensure=True)


def channels(item: bpy.types.Object, action: bpy.types.Action | None) -> bpy.types.ActionChannelbag:
    """The channels of `item` but those of its location, which go; new ones in `action` where it has none."""
    data = item.animation_data
    if data is None or data.action is None or data.action_slot is None:
        return bind(item, action or bpy.data.actions.new(item.name))
    bag = data.action.layers[0].strips[0].channelbag(data.action_slot, ensure=True)
    for curve in [curve for curve in bag.fcurves if curve.data_path == "location"]:
        bag.fcurves.remove(curve)
    return bag


def key(
    bag: bpy.types.ActionChannelbag,
    path: str,
    frames: np.ndarray,
    values: np.ndarray,
    group: str,
    generated: np.ndarray | None = None,
):
    """Keys the property at `path` with `values` (F, n) at Blender's `frames` (F,); rows with NaN stay unkeyed.

    Where `generated` (F,) is True, the keys are of the type that Blender has for what a tool made up.
    """
    there = np.isfinite(values).all(axis=1)
    if not there.any():
        return
    owner = bag.groups.get(group) or bag.groups.new(group)
    points = np.empty((int(there.sum()), 2), dtype=np.float32)
    points[:, 0] = frames[there]
    some = generated is not None and generated[there].any()
    kinds = np.where(generated[there], SET_BY_TOOL, SET_BY_HAND).astype(np.int32) if some else None
    for index in range(values.shape[1]):
        points[:, 1] = values[there, index]
        curve = bag.fcurves.new(path, index=index)
        curve.group = owner
        curve.keyframe_points.add(len(points))
        curve.keyframe_points.foreach_set("co", points.ravel())
        curve.keyframe_points.foreach_set("interpolation", np.full(len(points), LINEAR, dtype=np.int32))
        if kinds is not None:
            curve.keyframe_points.foreach_set("type", kinds)
        curve.update()
