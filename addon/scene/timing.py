# SPDX-License-Identifier: GPL-3.0-or-later
"""When a take plays in a scene: the scene gets its rate, or it is mapped to the scene's and can follow that."""

import bpy
import numpy as np

from . import animation, ownership
from .clock import TakeClock, fps_of, set_moment
from .lab import move_events
from .storage import is_cloud, read_table, show_moments

FRAME_TABLE = "mocap_frames"  # on a take: the table of its frames
CARRIER = "mocap_carrier"  # on a take that plays from a file: the object with the modifier
RATE, SHIFT, OWN_FIRST, STEP = "mocap_rate", "mocap_frame_shift", "mocap_first_frame", "mocap_step"


def keep_clock(block: bpy.types.ID, clock: TakeClock, rate: float):
    """Keeps with a take, or with what waits to be labelled, its rate and when it plays."""
    # Blender's whole numbers have 32 bits, and these may need 33.
    block[RATE], block[STEP] = float(rate), clock.step
    block[SHIFT], block[OWN_FIRST] = float(clock.shift), float(clock.first)


def kept_clock(block: bpy.types.ID, first: int) -> TakeClock:
    """When a take plays whose frames begin with the source's `first`; frame by frame in files older than other ways."""
    first = int(block.get(OWN_FIRST, first))
    return TakeClock(first, first + int(block.get(SHIFT, 0)), float(block.get(STEP, 1.0)))


def is_free(scene: bpy.types.Scene) -> bool:
    """Whether nothing of a person's goes by the scene's time: no action, no strip, and no rig that waits for one."""
    if scene.sequence_editor is not None and len(scene.sequence_editor.strips_all):
        return False
    if any(item.type == "ARMATURE" and ownership.MADE not in item for item in scene.objects):
        return False
    return not any(one.users > one.use_fake_user and ownership.MADE not in one for one in bpy.data.actions)


def give_time(scene: bpy.types.Scene, rate: float, frames: np.ndarray, clock: TakeClock) -> TakeClock:
    """Has a free scene play a take of `rate`, the source's frames (F,), and maps it to the time of any other.

    `clock` says where it begins; gives the one by which it is to be shown.
    """
    if is_free(scene):
        set_time(scene, rate, clock.shown(frames))
        return clock.at_rate(rate, rate)
    clock = clock.at_rate(fps_of(scene), rate)
    if len(frames) and not clock.shown(frames[0]) <= scene.frame_float <= clock.shown(frames[-1]):
        set_moment(scene, clock.shown(int(frames[0])))
    return clock


def set_time(scene: bpy.types.Scene, rate: float, frames: np.ndarray) -> list[str]:
    """Makes the scene play Blender's frames (F,) at a rate, which Blender keeps as a whole number over a base.

    All that is timed follows; gives the names of what does not.
    """
    scene.render.fps = max(1, round(rate))
    scene.render.fps_base = scene.render.fps / rate
    left = follow_rate(scene)
    if len(frames):
        scene.frame_start, scene.frame_end = int(frames[0]), int(frames[-1])
        scene.frame_set(int(frames[0]))
    return left


def is_timed_otherwise(scene: bpy.types.Scene, block: bpy.types.ID) -> bool:
    """Whether a take, or what waits to be labelled, is not at its own speed, as a person chose another rate since."""
    clock = kept_clock(block, 0)
    return RATE in block and clock.step != clock.at_rate(fps_of(scene), block[RATE]).step


def follow_rate(scene: bpy.types.Scene) -> list[str]:
    """Lets takes, and the rigs and characters that move by them, play at their own speed at the scene's rate.

    Where the scene played the frames of a take, and no others, it does so still. Gives the names of what does not
    follow: keys were changed, or are another file's.
    """
    left = [item.name for item in scene.objects if not animation.retime(item, fps_of(scene))]
    for block, before, now in _clocks(scene):
        if before == now:
            continue
        if block.library is not None:
            left.append(block.name)
            continue
        items = [item for item in scene.objects if item.data == block]
        if isinstance(block, bpy.types.Collection):
            items = list(block.all_objects)
            move_events(scene, block, now)
            ends = read_table(block[FRAME_TABLE])["number"][[0, -1]] if FRAME_TABLE in block else ()
            if [scene.frame_start, scene.frame_end] == [before.whole(end) for end in ends]:
                scene.frame_start, scene.frame_end = map(now.whole, ends)
        _retime(items, before, now)
        for modifier in block[CARRIER].modifiers if block.get(CARRIER) is not None else ():
            if modifier.type == "MESH_CACHE":
                time_cache(modifier, now)
        keep_clock(block, now, block[RATE])
    return left


def _clocks(scene: bpy.types.Scene) -> list[tuple[bpy.types.ID, TakeClock, TakeClock]]:
    """The takes of a scene and what waits to be labelled, by which clock each plays, and by which it would follow."""
    blocks = [*scene.collection.children_recursive, *{item.data for item in scene.objects if item.type == "MESH"}]
    blocks.append(scene.mocap_autolabel.source.preview if hasattr(scene, "mocap_autolabel") else None)
    found = []
    for block in dict.fromkeys(block for block in blocks if block is not None and block.get(RATE)):
        first = 0 if OWN_FIRST in block else int(read_table(block[FRAME_TABLE])["number"][0])  # an old file's take
        clock = kept_clock(block, first)
        found.append((block, clock, clock.at_rate(fps_of(scene), block[RATE])))
    return found


def time_cache(modifier: bpy.types.Modifier, clock: TakeClock):
    """Lets what plays from a file do so by a clock; Blender scales its frame first, and then takes the start off."""
    modifier.frame_scale, modifier.frame_start = 1 / clock.step, clock.start / clock.step


def _retime(items: list[bpy.types.Object], before: TakeClock, now: TakeClock):
    """Moves in time what shows a take: its keys, whoever set them, and the points of the frame."""
    actions = {item.animation_data.action for item in items if item.animation_data is not None}
    for action in actions - {None}:
        if ownership.MADE in action and animation.TIMED not in action:  # which are rigs' that followed before
            animation.move_in_time(action, before, now)
    for item in items:
        if is_cloud(item):
            with ownership.changed_by_us(item):
                show_moments(item, now)
