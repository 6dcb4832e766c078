# SPDX-License-Identifier: GPL-3.0-or-later
"""A rig's action of the active take is a preview until it is baked: made again of another body, bones or choices."""

import json
from contextlib import suppress

import bpy

from ..core.data.errors import InputError
from .clock import refresh_frame
from .later import soon
from .opened import opened
from .ownership import is_made_for, role_of
from .performers import Performer, homes
from .retargeting import (
    PREVIEW,
    follow_actions,
    is_ours,
    is_rig,
    pose_bones,
    preview_on,
    refuse_tweaking,
    retarget_take,
)
from .stored import Stored, alone
from .take import is_linked, is_take


def retarget_rig(context: bpy.types.Context, rig: bpy.types.Object, ours: bool = False) -> bpy.types.Action:
    """Gives a rig the preview of the active take, by the bones and with the choices that it keeps.

    That is the one that it has, of whichever take, where nobody changed it, which is looked at unless it is known to be
    `ours`.
    """
    own, (stored, performer, home) = rig.mocap_autolabel, _chosen(context, rig)
    before = preview_on(rig)
    again = before if before is not None and (ours or is_ours(rig)) else None
    choices = matched_in(rig), own.keep_feet, own.keep_hands
    action = retarget_take(context, rig, home, alone(stored, performer), *choices, again)
    action[PREVIEW]["of"] = _made_of(rig, stored)
    return action


def matched_in(rig: bpy.types.Object) -> dict[str, str]:
    """The bones that are chosen for a rig, by the parts that they are."""
    return {row.name: row.bone for row in rig.mocap_autolabel.bones if row.bone}


def _chosen(context: bpy.types.Context, rig: bpy.types.Object) -> tuple[Stored, Performer, bpy.types.Collection]:
    """The active take, and whose motion of it a rig gets, with the collection of that."""
    name, collection = rig.mocap_autolabel.performer, context.scene.mocap_autolabel.take
    stored = opened.take(collection, context.scene)
    performer = next((one for one in stored.performers if one.name == name), stored.performers[0])
    return stored, performer, homes(collection).get(performer.name, collection)


def _made_of(rig: bpy.types.Object, stored: Stored) -> str:
    own = rig.mocap_autolabel
    return json.dumps([matched_in(rig), own.keep_feet, own.keep_hands, stored.body_digest], sort_keys=True)


def is_left_behind(context: bpy.types.Context, rig: bpy.types.Object) -> bool:
    """Whether a rig's preview of the active take was made of another body, performer, bones or choices."""
    take = context.scene.mocap_autolabel.take
    action = preview_on(rig, take) if is_take(take) else None
    if action is None:
        return False
    stored, _, home = _chosen(context, rig)
    return not is_made_for(action, home) or action[PREVIEW].get("of") != _made_of(rig, stored)


def follow_rigs_soon(_settings, _context):
    """Lets previews follow, at once all that is chosen together; without a window each choice."""
    soon(follow_rigs)


def follow_rigs():
    """Makes previews of the active take again that are left behind, but one that cannot be or that a person changed."""
    context = bpy.context
    for rig in [one for one in context.scene.objects if is_rig(one) and one.mode in ("OBJECT", "POSE")]:
        if is_left_behind(context, rig) and is_ours(rig):
            with suppress(InputError):
                retarget_rig(context, rig, ours=True)


def bake(rig: bpy.types.Object):
    """Makes the preview of a rig a person's own action, which is kept in the file."""
    action = rig.animation_data.action
    if is_ours(rig):  # else it may have a person's name
        action.name = role_of(action).rpartition("\n")[2] + f" on {rig.name}"
    _give(action)


def _give(action: bpy.types.Action):
    """Leaves an action to a person, kept in the file."""
    del action[PREVIEW]
    action.use_fake_user = True


def discard(context: bpy.types.Context, rig: bpy.types.Object):
    """Puts back what a rig had before its preview: action, pose and switches. One that a person changed is kept."""
    refuse_tweaking(rig)
    data, action, ours = rig.animation_data, rig.animation_data.action, is_ours(rig)
    before = action[PREVIEW].to_dict()
    data.action = before.get("action")
    if data.action is not None:
        data.action_slot = next((one for one in data.action.slots if one.handle == before["slot"]), None)
    if ours:
        bpy.data.actions.remove(action)
    else:
        _give(action)
    pose_bones(rig, json.loads(before["posed"]))
    follow_actions()
    refresh_frame(context.scene)


def leave_take(context: bpy.types.Context, take: bpy.types.Collection):
    """Discards the previews of a take that is to be removed; one that a person changed stays on its rig, as baked.

    In all scenes, but of a linked take, which stays in the others.
    """
    near = context.scene.objects if is_linked(take) else bpy.data.objects
    for rig in [one for one in near if is_rig(one) and preview_on(one, take)]:
        if is_ours(rig):
            discard(context, rig)
        else:
            _give(rig.animation_data.action)
