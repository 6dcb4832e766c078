# SPDX-License-Identifier: GPL-3.0-or-later
"""The body of a take made to follow its labels: which frames it is out of date in, and the new one put in its place.

With each frame the file keeps a digest of the labels that its pose was made of, so what is out of date follows from
labels and file alone, whatever was undone, saved or labelled in between. Keys are in actions, which undo takes back on
their own, so an action says whose poses it shows.
"""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import fields, replace

import bpy
import numpy as np

from ..core.data.markersets import MarkerSet
from ..core.data.takes import Blobs, Motion
from ..core.points.motion import PosedFrames
from . import animation, ownership
from . import armature as armatures
from .body import fit_body
from .performers import Performer, armatures_of, homes
from .stored import Stored, digest_of
from .take import SHOWN_BODY, is_linked, keep_body

HALF_KEYED = "half keyed"  # what an action says whose keys are not all of one body


def is_out_of_date(collection: bpy.types.Collection, stored: Stored) -> bool:
    """Whether the body that is shown is another than the labels and the smoothing of a take, as they are now, make."""
    if stored.stale.any():
        return True
    others = (armature for _, armature, action in _given(collection) if action[SHOWN_BODY] != stored.body_digest)
    return any(map(ownership.is_keyed_by_us, others))  # which takes too long for each time that a panel is drawn


def _given(collection: bpy.types.Collection) -> Iterator[tuple[str, bpy.types.Object, bpy.types.Action]]:
    """The performers whose armatures have the actions that they were given, and both."""
    for name, armature in armatures_of(collection):
        action = None if armature.animation_data is None else armature.animation_data.action
        if action is not None and SHOWN_BODY in action:
            yield name, armature, action


def _actions(collection: bpy.types.Collection) -> dict[str, bpy.types.Action]:
    """The same actions by performer, but those that a person changed."""
    return {name: action for name, armature, action in _given(collection) if ownership.is_keyed_by_us(armature)}


def lacks_to_repose(context: bpy.types.Context, collection: bpy.types.Collection) -> str:
    """What to do before bones can be laid again; empty where they can."""
    if context.mode != "OBJECT":
        return "go to object mode"
    if is_linked(collection):
        return "open the file that it is linked from"
    there = context.view_layer.objects
    hidden = [item.name for _, item in armatures_of(collection) if item.hide_viewport or item.name not in there]
    return f"show {hidden[0]}" if hidden else ""


def show_posed_frame(
    collection: bpy.types.Collection, performer: Performer, markerset: MarkerSet, frame: float, posed: PosedFrames
):
    """Puts an armature where a body is in Blender's `frame`, before all of it is there: the take keeps none of it."""
    action = _actions(collection).get(performer.name)
    if action is None or not np.isfinite(posed.joints).all():
        return
    action[SHOWN_BODY] = HALF_KEYED
    armature = dict(armatures_of(collection))[performer.name]
    bag = animation.channels(armature, action)
    channels = armatures.pose_channels(armature, markerset, posed)
    for name, (location, turn) in zip(markerset.skeleton.segments, channels, strict=True):
        animation.move_key(bag, armatures.bone_path(name, "location"), frame, location[0])
        animation.move_key(bag, armatures.bone_path(name, "rotation_quaternion"), frame, turn[0])


def put_body(
    context: bpy.types.Context,
    collection: bpy.types.Collection,
    stored: Stored,
    markersets: Sequence[MarkerSet],
    bodies: Sequence[PosedFrames],
) -> Generator[None, None, None]:
    """Puts new bodies of all performers in the place of those that a take has, a little at a time.

    Of a take of blobs in the frames whose labels are others: elsewhere the body rests on rays, which labelling alone
    follows. Needs what `lacks_to_repose` asks for; adds no undo step of its own.
    """
    actions, motion = _actions(collection), _with_bodies(stored, bodies)
    for action in actions.values():
        action[SHOWN_BODY] = HALF_KEYED
    yield
    keep_body(collection, motion, stored.performers, stored.label_digests)
    yield
    shown, frames = dict(armatures_of(collection)), stored.clock.shown(motion.frames)
    for performer, markerset in zip(stored.performers, markersets, strict=True):
        if performer.name not in actions:
            continue
        armature, own = shown[performer.name], performer.motion_of(motion)
        build = armatures.build_of(markerset, own)
        if not armatures.is_laid(armature, markerset, build):
            with ownership.changed_by_us(armature):
                armatures.lay_bones(context, armature, markerset, build)
            fit_body(homes(collection).get(performer.name, collection), armature, markerset, build.scale)
        yield
        own = armatures.on_ground(own, markerset, build, stored.rate, stored.cutoff)
        yield from _key_again(armature, actions[performer.name], markerset, own, frames)
    for action in actions.values():
        action[SHOWN_BODY] = digest_of(stored.label_digests, stored.cutoff)


def _key_again(
    armature: bpy.types.Object, action: bpy.types.Action, markerset: MarkerSet, motion: Motion, frames: np.ndarray
) -> Generator[None, None, None]:
    """Keys every bone as `armatures.pose_armature` does, bone by bone, in the place of the keys that there are."""
    bag = animation.channels(armature, action)
    channels = armatures.pose_channels(armature, markerset, motion)
    for number, (name, own) in enumerate(zip(markerset.skeleton.segments, channels, strict=True)):
        for channel, values in zip(("location", "rotation_quaternion"), own, strict=True):
            path = armatures.bone_path(name, channel)
            needed = channel != "location" or not number or armatures.moves(values)
            if needed or bag.fcurves.find(path) is not None:
                with ownership.changed_by_us(armature):
                    animation.clear(bag, path)
                    animation.key(bag, path, frames, values, name)
        yield


def _with_bodies(stored: Stored, bodies: Sequence[PosedFrames]) -> Motion:
    """The motion of a take, as it is without fills and smoothing, with other bodies of its performers."""
    before, names = stored.unfilled, [one.name for one in fields(PosedFrames)]
    now = {name: np.concatenate([getattr(body, name) for body in bodies], axis=1) for name in names}
    sure = [_confidence(stored, *both) for both in zip(stored.performers, bodies, strict=True)]
    now["confidence"] = np.max(sure, axis=0)
    if isinstance(stored.rows, Blobs):
        for name, values in now.items():
            stale = stored.stale.reshape(-1, *[1] * (values.ndim - 1))
            now[name] = np.where(stale, values, getattr(before, name))
    return replace(before, **now)


def _confidence(stored: Stored, performer: Performer, body: PosedFrames) -> np.ndarray:
    """(F,) the mean confidence of a performer's labels where there is a body, else 0."""
    labels, rows = stored.labels, performer.marker_rows
    mine = (labels.marker >= rows.start) & (labels.marker < rows.stop)
    frame, count = stored.rows.frame[mine], len(body.joints)
    mean = np.bincount(frame, labels.confidence[mine], count) / np.maximum(np.bincount(frame, minlength=count), 1)
    return np.where(np.isfinite(body.joints).all(axis=(1, 2)), mean, 0.0)
