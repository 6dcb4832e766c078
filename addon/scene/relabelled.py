# SPDX-License-Identifier: GPL-3.0-or-later
"""A take that was labelled again: put into what the scene has of it, with the list of what that changed."""

import json
from dataclasses import asdict, replace

import bpy
import numpy as np

from ..core.data.merging import LabelledRange, can_merge, merged
from ..core.review.changes import Change, changes
from . import naming
from .corrections import kept_edits
from .opened import opened
from .ownership import Former, put_in_place
from .performers import colours_in
from .take import MARKER_NAMES, SOURCE, Take, clear_take, remove_take, show_take, takes_of

CHANGES = "mocap_changes"
MAX_KEPT = 500  # changes that a file keeps, the longest first: a list that a person reads


def show_again(context: bpy.types.Context, take: Take, whole: bool) -> bpy.types.Collection:
    """Shows a take in place of what the scene has of the same file in the same markers, which it is put into.

    What is a person's in its collection stays there, and what hung on the take or followed it does so again.
    A take of the same file in other markers stays, hidden. The frame stays where it is, and the range of frames that
    the scene plays unless all of the take was labelled for the first time (`whole`).
    """
    scene = context.scene
    played = scene.frame_start, scene.frame_end, scene.frame_current
    others = [one for one in takes_of(scene) if take.source and one[SOURCE] == take.source]
    found: tuple[Change, ...] | None = None
    before, lay = None, None
    place: bpy.types.Collection | None = None
    former = Former({}, [])
    for collection in reversed(others):
        old = range_of(collection, scene)
        if found is None and _same_markers(collection, take, old):
            # What was said while the labelling went on is said of what came of it as well.
            before, said = old, kept_edits(collection)
            stored = opened.take(collection, scene)
            shift, stale = stored.shift, stored.motion.frames[stored.stale]
            lay = int(old.motion.frames[0]) + shift, int(old.motion.frames[-1]) + shift
            whole_take = merged(old, as_range(take))
            found = changes_of(old, whole_take, take.markerset.markers)
            take = replace(
                take,
                rows=whole_take.rows,
                labels=whole_take.labels,
                motion=whole_take.motion,
                suspects=whole_take.suspects,
                unedited=whole_take.unedited,
                edits=take.edits if said is None else said,
                old_body=np.setdiff1d(stale, take.motion.frames),
                colours={**colours_in(collection), **take.colours},
            )
            if collection.library is None:
                place, former = collection, clear_take(collection)
            else:
                remove_take(collection)
        else:
            collection.hide_viewport = True
    shown = show_take(context, take, place)
    put_in_place(former, shown)
    opened.forget()
    shown.hide_viewport = False
    if found is not None:
        keep_changes(shown, found)
    if before is not None or not whole:
        _keep_playing(scene, played, lay)
    return shown


def as_range(take: Take) -> LabelledRange:
    """What was labelled just now."""
    return LabelledRange(take.rows, take.labels, take.motion, take.suspects, take.unedited)


def range_of(collection: bpy.types.Collection, scene: bpy.types.Scene) -> LabelledRange:
    """What the scene has of a take; fills and smoothing, which are kept beside it, are not in its motion."""
    stored, raw = opened.take(collection, scene), opened.unedited(collection, scene)
    unedited = None if kept_edits(collection) is None else raw.labels
    return LabelledRange(stored.rows, stored.labels, stored.unfilled, raw.suspects, unedited)


def changes_of(old: LabelledRange, new: LabelledRange, names: tuple[str, ...]) -> tuple[Change, ...]:
    """What is otherwise in the frames that both have; nothing where their rows are not the same."""
    frames = np.intersect1d(old.motion.frames, new.motion.frames)
    parts = [_in_frames(one, frames) for one in (old, new)]
    if len(parts[0][0]) != len(parts[1][0]) or (parts[0][0] != parts[1][0]).any():
        return ()
    frame, before = parts[0]
    return changes(frame, before, parts[1][1], names, frames)


def _in_frames(one: LabelledRange, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the rows in some frames, by the index of these: where they are, and the markers that they are."""
    number = one.motion.frames[one.rows.frame]
    inside = np.isin(number, frames)
    return np.searchsorted(frames, number[inside]), one.labels.marker[inside]


def keep_changes(collection: bpy.types.Collection, found: tuple[Change, ...]):
    """Keeps with a take what its last labelling changed."""
    collection[CHANGES] = json.dumps([asdict(one) for one in found[:MAX_KEPT]])


def kept_changes(collection: bpy.types.Collection) -> tuple[Change, ...]:
    """What the last labelling of a take changed."""
    return tuple(Change(**row) for row in json.loads(collection.get(CHANGES, "[]")))


def _same_markers(collection: bpy.types.Collection, take: Take, old: LabelledRange) -> bool:
    # A set that was learned again has the same name, and may have its markers in another order.
    names = tuple(json.loads(collection[MARKER_NAMES]))
    alike = collection[naming.MARKERSET] == take.markerset.name and names == take.markerset.markers
    return alike and can_merge(old, as_range(take))


def _keep_playing(scene: bpy.types.Scene, played: tuple[int, int, int], lay: tuple[int, int] | None):
    """Gives the scene back the frames that it played, and with them those of the take that are new.

    `lay` are the first and last frame of the take before: where a person had the scene begin later or end sooner, so it
    does still. None where there was no take.
    """
    first, last, current = played
    if lay is None or first <= lay[0]:
        first = min(first, scene.frame_start)
    if lay is None or last >= lay[1]:
        last = max(last, scene.frame_end)
    scene.frame_start, scene.frame_end = first, last
    scene.frame_set(current)
