# SPDX-License-Identifier: GPL-3.0-or-later
"""Keys in bulk: thousands of frames of many channels into few actions, one slot an object.

Keys and not samples (`FCurve.convert_to_samples`), though 30 empties of 10,000 frames are 15 MB as those and 65 MB as
keys, 5 and 15 compressed: of samples none can be moved or inserted, and neither gaps nor what was filled is told. Nor
is smoothing the modifier *Smooth* (5.2): at best it leaves 1.5 mm of 2 mm of noise, and moves the ends of gaps by 9 mm.
"""

from collections.abc import Callable
from dataclasses import dataclass

import bpy
import numpy as np

from .clock import KEYS_APART, TakeClock, is_rate
from .ownership import LINEAR, is_keyed_by_us, is_noted, note_keys, numbers, sign

TIMED = "mocap_timed"  # on an action: for how many frames a second it is keyed, and the frame that it begins at
# The values of BEZT_KEYTYPE_KEYFRAME and BEZT_KEYTYPE_GENERATED behind Keyframe.type, from Blender 4.4 on: the second
# is for keys that are "set automatically by a tool", and is drawn and selected apart.
SET_BY_HAND, SET_BY_TOOL = 0, 5


# Those that an action has before the next object's go into another. Blender copies an action whole whenever one of its
# keys moved, which takes 7 ms of a processor for a million (5.2): with an action for all of 20,000 frames of 62 markers
# each correction would wait 35 ms for it. Takes of usual length fit in one.
KEYS_AN_ACTION = 500_000
MOST_SINGLE = 300  # keys of a curve that are moved one by one; for more it is quicker to give all of them their places
MOST_REMOVED = 1500  # that are taken away one by one, 2 µs each; for more it is quicker to make all again
# Values (F, n) by which something is keyed, NaN where it is not, and (F,) True where a tool made them up; None nowhere.
Keyed = tuple[np.ndarray, np.ndarray | None]


@dataclass(eq=False)
class TakeActions:
    """The actions that a take's keys go into: one called `name`, and further ones where they are many."""

    name: str
    action: bpy.types.Action | None = None
    keys: int = 0
    count: int = 0

    def for_keys(self, keys: int) -> bpy.types.Action:
        """The action that the next object's keys go into, which are so many."""
        if self.action is None or self.keys + keys > KEYS_AN_ACTION:
            self.count, self.keys = self.count + 1, 0
            self.action = bpy.data.actions.new(self.name if self.count == 1 else f"{self.name} {self.count}")
            sign(self.action, f"action {self.count}")
        self.keys += keys
        return self.action


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
    """The channels of `item`; new ones in `action` where it has none."""
    data = item.animation_data
    if data is None or data.action is None or data.action_slot is None:
        return bind(item, action or bpy.data.actions.new(item.name))
    return data.action.layers[0].strips[0].channelbag(data.action_slot, ensure=True)


def clear(bag: bpy.types.ActionChannelbag, path: str):
    """Empties the channels of the property at `path`."""
    for curve in bag.fcurves:
        if curve.data_path == path:
            curve.keyframe_points.clear()


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
    Channels that are there are empty, or have as many straight keys; without a row to key they go. Straight lines need
    no handles, so Blender sets these only where somebody makes curves of the lines: `update`, which would set them now,
    takes twice as long as all the rest.
    """
    there = np.isfinite(values).all(axis=1)
    if not there.any():
        for curve in [curve for curve in bag.fcurves if curve.data_path == path]:
            bag.fcurves.remove(curve)
        return
    owner = bag.groups.get(group) or bag.groups.new(group)
    points = np.empty((int(there.sum()), 2), dtype=np.float32)
    points[:, 0] = frames[there]
    kinds = _kinds(generated, there)
    for index in range(values.shape[1]):
        points[:, 1] = values[there, index]
        curve = bag.fcurves.find(path, index=index)
        if curve is None:
            curve = bag.fcurves.new(path, index=index)
            curve.group = owner
        if len(curve.keyframe_points):
            curve.keyframe_points.foreach_set("co", points.ravel())
        else:
            curve.keyframe_points.add(len(points))
            curve.keyframe_points.foreach_set("co", points.ravel())
            curve.keyframe_points.foreach_set("interpolation", np.full(len(points), LINEAR, dtype=np.int32))
            if kinds.any():
                curve.keyframe_points.foreach_set("type", kinds)
        note_keys(bag, curve, points)


def move_key(bag: bpy.types.ActionChannelbag, path: str, frame: float, values: np.ndarray):
    """Puts the keys at Blender's `frame` of those channels of the property at `path` that there are to values (n,)."""
    for index, value in enumerate(values):
        curve = bag.fcurves.find(path, index=index)
        if curve is not None:
            curve.keyframe_points.insert(frame, value, options={"FAST"}).interpolation = "LINEAR"
            note_keys(bag, curve, numbers(curve.keyframe_points, "co", 2))


def move(bag: bpy.types.ActionChannelbag, path: str, frames: np.ndarray, before: Keyed, after: Keyed) -> bool:
    """Moves the keys of `before`, as `key` made them at Blender's `frames` (F,), to where `after` is.

    Does no more than what is other needs. False, and nothing is done, where that is not enough: the keys are not those
    of `before`, all have to go, or very many.
    """
    (was_at, was_made), (now_at, now_made) = before, after
    was, now = np.isfinite(was_at).all(axis=1), np.isfinite(now_at).all(axis=1)
    curves = [bag.fcurves.find(path, index=index) for index in range(now_at.shape[1])]
    more = int(now.sum()) - int(was.sum())
    if not now.any() or -more > MOST_REMOVED:
        return False
    if any(curve is None or len(curve.keyframe_points) != was.sum() for curve in curves):
        return False
    kinds, were = _kinds(now_made, now), _kinds(was_made, was)
    retyped = bool(kinds.any() or were.any()) and not np.array_equal(kinds, were)
    rows = np.flatnonzero(((was_at != now_at) & now[:, None]).any(axis=1))
    few = len(rows) <= MOST_SINGLE and bool((was == now).all())
    places = np.empty((int(now.sum()), 2), np.float32)
    places[:, 0] = frames[now]
    single = (np.cumsum(now)[rows] - 1).tolist() if few else [0]
    for index, curve in enumerate(curves):
        points = curve.keyframe_points
        places[:, 1] = now_at[now, index]
        if not few:
            for _ in range(-more):
                points.remove(points[-1], fast=True)
            if more > 0:
                points.add(more)
                points.foreach_set("interpolation", np.full(len(points), LINEAR, dtype=np.int32))
            points.foreach_set("co", places.ravel())
        if retyped:
            points.foreach_set("type", kinds)
        for place in single:  # Blender notices what is set one by one only
            points[place].co = places[place]
        note_keys(bag, curve, places)
    return True


def _kinds(made: np.ndarray | None, there: np.ndarray) -> np.ndarray:
    """The types of the keys of the rows that are there (F,), where a tool made some (F,) up."""
    some = np.zeros(len(there), bool) if made is None else made
    return np.where(some[there], SET_BY_TOOL, SET_BY_HAND).astype(np.int32)


def note_time(action: bpy.types.Action, fps: float, first: float):
    """Notes that an action is keyed for so many frames a second, from a frame on, so that `retime` can change that."""
    action[TIMED] = float(fps), float(first)


def retime(item: bpy.types.Object, fps: float) -> bool:
    """Moves the keys of what was keyed for another rate to so many frames a second; whether that is it now.

    It is not where a person changed the keys, they are another file's, or they would be one to Blender.
    """
    data = item.animation_data
    action = None if data is None else data.action
    if action is None or TIMED not in action or is_rate(action[TIMED][0], fps):
        return True
    if not action.is_editable or not is_keyed_by_us(item):
        return False
    before, first = action[TIMED]
    bag = channels(item, action)
    times = [numbers(curve.keyframe_points, "co", 2).reshape(-1, 2)[:, 0] for curve in bag.fcurves]
    if any(np.diff(one).min(initial=np.inf) * fps / before < KEYS_APART for one in times):
        return False
    _move_keys(bag, lambda frames: first + (frames - first) * (fps / before))
    note_time(action, fps, first)
    return True


def move_in_time(action: bpy.types.Action, before: TakeClock, now: TakeClock):
    """Moves all keys of a take's action from where one clock has them to where another has them."""

    def moved(frames: np.ndarray) -> np.ndarray:
        after = (frames - before.start) / before.step
        # A key of a sample lies on it again: what single precision rounds does not grow from one rate to the next.
        whole, rounding = np.rint(after), np.spacing(np.abs(frames).astype(np.float32)) / before.step
        return now.start + np.where(np.abs(after - whole) <= rounding, whole, after) * now.step

    for strip in (strip for layer in action.layers for strip in layer.strips if strip.type == "KEYFRAME"):
        for bag in strip.channelbags:
            _move_keys(bag, moved)


def _move_keys(bag: bpy.types.ActionChannelbag, moved: Callable[[np.ndarray], np.ndarray]):
    """Moves keys and their handles in time, by where `moved` puts frames (K,); those that were ours still are."""
    for curve in bag.fcurves:
        points, ours = curve.keyframe_points, is_noted(bag.id_data, bag.slot_handle, curve)
        for path in ("handle_left", "handle_right", "co"):
            places = numbers(points, path, 2).reshape(-1, 2)
            places[:, 0] = moved(places[:, 0].astype(float))
            points.foreach_set(path, places.ravel())
        curve.update()
        if ours:
            note_keys(bag, curve, places)
