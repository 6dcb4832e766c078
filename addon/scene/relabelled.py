# SPDX-License-Identifier: GPL-3.0-or-later
"""A take that was labelled again: put into what the scene has of it, with the list of what that changed."""

import json
from dataclasses import asdict, replace

import bpy
import numpy as np

from ..core.data.markersets import Worn
from ..core.data.merging import LabelledRange, can_merge, merged
from ..core.data.takes import Motion
from ..core.points.motion import PosedFrames
from ..core.points.several.together import beside, longer, posed_again
from ..core.review.changes import Change, changes
from . import naming
from .clock import TakeClock, set_moment
from .corrections import kept_edits
from .opened import opened
from .ownership import Former, put_in_place
from .performers import colours_in
from .stored import Stored
from .take import SOURCE, Take, adopt_copies, clear_take, is_linked, leave_out, show_take, takes_of
from .timing import follow_rate, give_range, is_timed_otherwise, kept_clock
from .trouble import answered_doubts

CHANGES = "mocap_changes"
MAX_KEPT = 500  # changes that a file keeps, the longest first: a list that a person reads


def show_again(context: bpy.types.Context, take: Take, whole: bool) -> bpy.types.Collection:
    """Shows a take in place of what the scene has of the same file in the same markers, which it is put into.

    What is a person's in its collection stays there, and what hung on the take or followed it does so again.
    One that is linked from another file is left out instead, with what hangs on it.
    A take of the same file in other markers stays, hidden. The frame of the take stays where it is, and the range of
    frames that the scene plays unless all of the take was labelled for the first time (`whole`).
    """
    scene = context.scene
    adopt_copies()
    others = [one for one in takes_of(scene) if take.source and one[SOURCE] == take.source]
    if any(is_timed_otherwise(scene, one) for one in others):  # the scene's rate was changed since: all goes along
        follow_rate(scene, but=[one for one in takes_of(scene) if one not in others])
    played = scene.frame_start, scene.frame_end, scene.frame_float
    found: tuple[Change, ...] | None = None
    lay, place, former, clock = None, None, Former({}, []), TakeClock()
    new = LabelledRange(take.rows, take.labels, take.motion, take.suspects, take.unedited)
    for collection in reversed(others):
        old = None if found is not None else _same_take(collection, scene, take.markerset, new)
        if old is None:
            collection.hide_viewport = True
            continue
        # What was said while the labelling went on is said of what came of it as well.
        edits, stored = kept_edits(collection), opened.take(collection, scene)
        clock = stored.clock
        lay = clock.whole(old.first), clock.whole(old.last)
        whole_take = merged(old, new)
        found = changes_of(old, whole_take, take.markerset.markers)
        # Labelling leaves out what was answered, which the list of what is done has still.
        done = tuple(one for one in answered_doubts(collection, scene) if one not in whole_take.suspects)
        take = replace(
            take,
            **vars(replace(whole_take, suspects=whole_take.suspects + done)),
            edits=take.edits if edits is None else edits,
            old_body=np.setdiff1d(stored.motion.frames[stored.stale], take.motion.frames),
            colours={**colours_in(collection), **take.colours},
        )
        if is_linked(collection):
            leave_out(collection, scene)
        else:
            place, former = collection, clear_take(collection)
    shown = show_take(context, take, place)
    put_in_place(former, shown)
    opened.forget_read()
    shown.hide_viewport = False
    if found is not None:
        keep_changes(shown, found)
    if lay is not None or not whole:
        now = clock if lay is None else kept_clock(shown, clock.first)
        moment = played[2] if now == clock else now.shown(clock.at(played[2]))
        _keep_playing(scene, (*played[:2], moment), lay)
    return shown


def _same_take(
    collection: bpy.types.Collection, scene: bpy.types.Scene, worn: Worn, new: LabelledRange
) -> LabelledRange | None:
    """What the scene has of a take, where a range of the same markers can be put into it; None where it cannot.

    Fills and smoothing, which are kept beside it, are not in its motion.
    """
    stored, raw = opened.take(collection, scene), opened.unedited(collection, scene)
    unedited = None if kept_edits(collection) is None else raw.labels
    # A set that was learned again has the same name, and may have its markers in another order.
    if collection[naming.MARKERSET] != worn.name or stored.names != worn.markers:
        return None
    motion = _with_joints(stored, worn)
    old = LabelledRange(stored.rows, stored.labels, motion, raw.suspects, unedited)
    return old if can_merge(old, new) else None


def _with_joints(stored: Stored, worn: Worn) -> Motion:
    """What was measured of a take, its bodies with the joints that earlier versions did not give them."""
    each = []
    for performer, (_, markerset) in zip(stored.performers, worn.worn, strict=True):
        own, known, skeleton = performer.motion_of(stored.unfilled), performer.joints[1], markerset.skeleton
        if stored.segments[performer.joint_rows] == skeleton.segments[:known]:
            body = longer(PosedFrames(own.expected, own.joints, own.rotations, own.scale), skeleton)
            own = replace(own, joints=body.joints, rotations=body.rotations)
        elif known != len(skeleton):
            own = posed_again(own, markerset)
        each.append(own)
    return beside(each)


def changes_of(old: LabelledRange, new: LabelledRange, names: tuple[str, ...]) -> tuple[Change, ...]:
    """What is otherwise in the frames that both have; nothing where their rows are not the same."""
    frames, parts = np.intersect1d(old.motion.frames, new.motion.frames), []
    for one in (old, new):  # by the index of these frames where the rows are, and the markers that they are
        number = one.motion.frames[one.rows.frame]
        inside = np.isin(number, frames)
        parts.append((np.searchsorted(frames, number[inside]), one.labels.marker[inside]))
    if len(parts[0][0]) != len(parts[1][0]) or (parts[0][0] != parts[1][0]).any():
        return ()
    frame, before = parts[0]
    return changes(frame, before, parts[1][1], names, frames)


def keep_changes(collection: bpy.types.Collection, found: tuple[Change, ...]):
    """Keeps with a take what its last labelling changed."""
    collection[CHANGES] = json.dumps([asdict(one) for one in found[:MAX_KEPT]])


def kept_changes(collection: bpy.types.Collection) -> tuple[Change, ...]:
    """What the last labelling of a take changed."""
    return tuple(Change(**row) for row in json.loads(collection.get(CHANGES, "[]")))


def _keep_playing(scene: bpy.types.Scene, played: tuple[int, int, float], lay: tuple[int, int] | None):
    """Gives the scene back the frames that it played, and with them those of the take that are new.

    `lay` are the first and last frame of the take before: where a person had the scene begin later or end sooner, so it
    does still. None where there was no take.
    """
    first, last, current = played
    if lay is None or first <= lay[0]:
        first = min(first, scene.frame_start)
    if lay is None or last >= lay[1]:
        last = max(last, scene.frame_end)
    if (scene.frame_start, scene.frame_end) != (first, last):
        give_range(scene, first, last)
    set_moment(scene, current)
