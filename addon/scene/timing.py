# SPDX-License-Identifier: GPL-3.0-or-later
"""When a take plays in a scene: the scene gets its rate, or it is mapped to the scene's and can follow that."""

from collections.abc import Sequence

import bpy
import numpy as np

from . import animation, ownership
from .armature import SCALE
from .clock import LAST_FRAME, TakeClock, fps_of, set_moment
from .lab import move_events
from .storage import is_cloud, read_table, show_moments

FRAME_TABLE = "mocap_frames"  # on a take: the table of its frames
CARRIER = "mocap_carrier"  # on a take that plays from a file: the object with the modifier
RATE, SHIFT, STEP = "mocap_rate", "mocap_frame_shift", "mocap_step"
OWN_FIRST, OWN_LAST = "mocap_first_frame", "mocap_last_frame"
GIVEN_START = "mocap_given_start"  # on a scene: the first frame that it plays, where that was given to it
PICKED_RANGE = "mocap_range"  # on a scene: first and last frame of a take that were made its preview range


def keep_clock(block: bpy.types.ID, clock: TakeClock, rate: float, frames: np.ndarray):
    """Keeps with a take of the source's frames (F,), or with what waits to be labelled, its rate and when it plays."""
    # Blender's whole numbers have 32 bits, and these may need 33.
    block[RATE], block[STEP] = float(rate), clock.step
    block[SHIFT], block[OWN_FIRST] = float(clock.shift), float(clock.first)
    block[OWN_LAST] = float(frames[-1] if len(frames) else clock.first)


def kept_clock(block: bpy.types.ID, first: int) -> TakeClock:
    """When a take plays whose frames begin with the source's `first`; frame by frame in files older than other ways."""
    first = int(block.get(OWN_FIRST, first))
    return TakeClock(first, first + int(block.get(SHIFT, 0)), float(block.get(STEP, 1.0)))


def is_free(scene: bpy.types.Scene) -> bool:
    """Whether nothing of a person's goes by the scene's time: no action, no strip, and no rig that waits for one.

    Nor was it said when that begins, as where shots begin at 1001.
    """
    if scene.frame_start not in (1, scene.get(GIVEN_START)):
        return False
    if scene.sequence_editor is not None and len(scene.sequence_editor.strips_all):
        return False
    if any(item.type == "ARMATURE" and not {ownership.MADE, SCALE} & set(item.keys()) for item in scene.objects):
        return False
    return not any(one.users > one.use_fake_user and ownership.MADE not in one for one in bpy.data.actions)


def give_time(scene: bpy.types.Scene, rate: float, frames: np.ndarray, clock: TakeClock) -> TakeClock:
    """Has a free scene play a take of `rate`, the source's frames (F,), and maps it to the time of any other.

    `clock` says where it begins; one that is mapped already is so by a person's choice, which is kept. Gives the one by
    which it is to be shown: frame by frame where it cannot be mapped.
    """
    if clock.step == 1 and is_free(scene):
        set_time(scene, rate, clock.shown(frames))
        if len(frames):
            scene.frame_set(int(clock.shown(frames[0])))
        return clock
    mapped = clock.at_rate(fps_of(scene), rate)
    clock = mapped if not len(frames) or mapped.fits(int(frames[-1])) else clock.at_rate(rate, rate)
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
        give_range(scene, int(frames[0]), int(frames[-1]))
    return left


def give_range(scene: bpy.types.Scene, first: int, last: int):
    """Makes the scene play Blender's frames `first` to `last`, which no person said then."""
    scene.frame_start, scene.frame_end = first, last
    scene[GIVEN_START] = scene.frame_start


def is_timed_otherwise(scene: bpy.types.Scene, block: bpy.types.ID) -> bool:
    """Whether a take, or what waits to be labelled, is not at its own speed, as a person chose another rate since."""
    clock = kept_clock(block, 0)
    return RATE in block and clock.step != clock.at_rate(fps_of(scene), block[RATE]).step


def follow_rate(scene: bpy.types.Scene, but: Sequence[bpy.types.Collection] = ()) -> list[str]:
    """Lets takes, and the rigs and characters that move by them, play at their own speed at the scene's rate.

    All that the scene has do so, `but` some takes. Where the scene played the frames of a take, and no others, it does
    so still; of the active one it shows the same frame, and the preview range has the same. Gives the names of what
    does not follow: keys were changed, are another file's, or would be too near to each other.
    """
    others = {item for take in but for item in take.all_objects}
    moving = [item for item in scene.objects if item not in others and not _moves_by(item, but)]
    left = [item.name for item in moving if not animation.retime(item, fps_of(scene))]
    settings = getattr(scene, "mocap_autolabel", None)
    active = None if settings is None else settings.take or settings.source.preview
    moment, moved = scene.frame_float, set()
    for block, before, now in _clocks(scene):
        if before == now or block in but:
            continue
        first, last = _ends(block)
        cached = block.get(CARRIER) is not None
        if block.library is not None or not now.fits(last) or (cached and not plays_from_file(now)):
            left.append(block.name)
            continue
        if block == active and first <= before.at(moment) <= last:
            moment = now.shown(before.at(moment))
        _follow_ranges(scene, before, now, (first, last), block == active and scene.use_preview_range)
        if isinstance(block, bpy.types.Collection):
            move_events(scene, block, now)
        _retime(_items(scene, block), before, now, moved)
        for modifier in block[CARRIER].modifiers if cached else ():
            if modifier.type == "MESH_CACHE":
                time_cache(modifier, now)
        block[STEP] = now.step
    set_moment(scene, moment)
    return left


def _moves_by(item: bpy.types.Object, takes: Sequence[bpy.types.Collection]) -> bool:
    """Whether an object has an action that was made of one of these takes."""
    action = None if item.animation_data is None else item.animation_data.action
    return action is not None and any(ownership.is_made_for(action, take) for take in takes)


def _follow_ranges(scene: bpy.types.Scene, before: TakeClock, now: TakeClock, ends: tuple[int, int], preview: bool):
    """Lets the scene play the same frames of a take where those were all of it, and preview the same of it."""
    if [scene.frame_start, scene.frame_end] == [before.whole(end) for end in ends]:
        give_range(scene, *map(now.whole, ends))
    begin, end = picked_range(scene, before) if preview else (0, -1)
    if max(begin, ends[0]) <= min(end, ends[1]):
        pick_range(scene, now, begin, end)


def _clocks(scene: bpy.types.Scene) -> list[tuple[bpy.types.ID, TakeClock, TakeClock]]:
    """The takes of a scene and what waits to be labelled, by which clock each plays, and by which it would follow."""
    blocks = [*scene.collection.children_recursive, *{item.data for item in scene.objects if item.type == "MESH"}]
    blocks.append(scene.mocap_autolabel.source.preview if hasattr(scene, "mocap_autolabel") else None)
    found = []
    for block in dict.fromkeys(block for block in blocks if block is not None and block.get(RATE)):
        clock = kept_clock(block, _ends(block)[0])
        found.append((block, clock, clock.at_rate(fps_of(scene), block[RATE])))
    return found


def _ends(block: bpy.types.ID) -> tuple[int, int]:
    """The source's first and last frame of a take, or of what waits to be labelled."""
    if OWN_LAST not in block and FRAME_TABLE in block:  # an old file's take
        first, last = read_table(block[FRAME_TABLE])["number"][[0, -1]]
        return int(first), int(last)
    return int(block[OWN_FIRST]), int(block.get(OWN_LAST, block[OWN_FIRST]))


def _items(scene: bpy.types.Scene, block: bpy.types.ID) -> list[bpy.types.Object]:
    """The objects that show a take, or what waits to be labelled; those of a take that lies in it are not its own."""
    if not isinstance(block, bpy.types.Collection):
        return [item for item in scene.objects if item.data == block]
    inside = [_items(scene, child) for child in block.children if RATE not in child]
    return [*block.objects, *(item for items in inside for item in items)]


def pick_range(scene: bpy.types.Scene, clock: TakeClock, first: int, last: int):
    """Makes frames of the source the scene's preview range, and keeps which: its whole frames may have more."""
    show_range(scene, clock.whole(first), clock.whole(last))
    scene[PICKED_RANGE] = float(first), float(last)


def show_range(scene: bpy.types.Scene, first: int, last: int):
    """Makes Blender's frames `first` to `last` the scene's preview range."""
    scene.use_preview_range = True
    # Each is held apart by the other, so the one that gives way goes first.
    scene.frame_preview_start, scene.frame_preview_end = first, last
    scene.frame_preview_start = first


def picked_range(scene: bpy.types.Scene, clock: TakeClock) -> tuple[int, int]:
    """The source's first and last frame in the preview range: those that were picked, while it is where they are.

    Else those that are nearest to its frames; where they are all between two, the nearest one.
    """
    shown = scene.frame_preview_start, scene.frame_preview_end
    first, last = map(int, scene.get(PICKED_RANGE, clock.inside(*shown)))
    if (clock.whole(first), clock.whole(last)) != shown:
        first, last = clock.inside(*shown)
    nearest = clock.at(sum(shown) / 2)
    return (first, last) if first <= last else (nearest, nearest)


def plays_from_file(clock: TakeClock) -> bool:
    """Whether Blender can play a file by a clock: where it begins is counted in the file's own frames."""
    return clock.start / clock.step <= LAST_FRAME


def time_cache(modifier: bpy.types.Modifier, clock: TakeClock):
    """Lets what plays from a file do so by a clock; Blender scales its frame first, and then takes the start off."""
    modifier.frame_scale, modifier.frame_start = 1 / clock.step, clock.start / clock.step


def _retime(items: list[bpy.types.Object], before: TakeClock, now: TakeClock, moved: set[bpy.types.Action]):
    """Moves in time what shows a take: its keys, whoever set them, and the points of the frame.

    Not the keys of actions that were `moved` already, to which it adds.
    """
    actions = {item.animation_data.action for item in items if item.animation_data is not None} - {None} - moved
    moved |= actions
    for action in actions:
        if ownership.MADE in action and animation.TIMED not in action:  # which are rigs' that followed before
            animation.move_in_time(action, before, now)
    for item in items:
        if is_cloud(item):
            with ownership.changed_by_us(item):
                show_moments(item, now)
