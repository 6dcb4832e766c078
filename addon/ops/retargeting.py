# SPDX-License-Identifier: GPL-3.0-or-later
"""The take's motion on somebody's rig: its bones matched, and an action made of the motion."""

from collections.abc import Mapping
from pathlib import Path

import bpy
from bpy.props import StringProperty

from ..core.data.errors import InputError
from ..core.data.wording import count_of
from ..core.retarget.matching import FINGER_PARTS, PARTS, match_bones, match_map
from ..io import bone_maps
from ..scene.clock import fps_of, plays_at
from ..scene.retargeting import freed_by, is_rig, matched_before, preview_on, rest_bones
from ..scene.rig_preview import bake, discard, matched_in, retarget_rig
from .base import Ours, lacks_take, operator, taken, unless
from .importing import ImportsFile
from .reposing import follow_now


def active_rig(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active object, where it is an armature that a person may change and no take's own."""
    rig = context.object
    return rig if rig is not None and is_rig(rig) else None


lacks_rig = unless(active_rig, "Make the armature of your rig the active object first")
lacks_mode = unless(lambda context: context.mode in ("OBJECT", "POSE"), "Go to object or pose mode first")
lacks_preview = unless(lambda context: preview_on(context.object), "Press Retarget first")


def _keep(rig: bpy.types.Object, matched: Mapping[str, str]):
    """Keeps on a rig which bone is which part, an empty row for a part without one, but for fingers."""
    rows = rig.mocap_autolabel.bones
    for part in (part for part in PARTS if part in matched or part not in FINGER_PARTS):
        row = rows.get(part) or rows.add()  # those of a linked rig stay
        row.name, row.bone = part, matched.get(part, "")


@operator(lacks_take, lacks_rig, lacks_mode)
def retarget(self, context):
    """Give the active rig an action that moves it as the take's body: any names, proportions and rest pose."""
    rig = active_rig(context)
    if not rig.mocap_autolabel.bones:
        _keep(rig, matched_before(rig) or match_bones(rest_bones(rig)))
    follow_now(context)
    action = retarget_rig(context, rig)
    freed = freed_by(action)
    off = f", and leaves {count_of(freed, 'constraint')} of its bones without influence" if freed else ""
    keyed = f", keyed for the scene's {fps_of(context.scene):g} frames a second"
    speed = "" if plays_at(context.scene, taken(context).rate) else keyed
    words = f"{rig.name} has the action {action.name}, of {len(matched_in(rig))} parts of the body"
    self.report({"INFO"}, f"{words}{speed}{off}")


@operator(lacks_rig, lacks_preview, label="Bake")
def bake_retarget(_self, context):
    """Make the rig's action your own: nothing changes it any more, and the next Retarget makes another."""
    bake(active_rig(context))


@operator(lacks_rig, lacks_preview, lacks_mode, label="Discard")
def discard_retarget(_self, context):
    """Put back the action, pose and switches that the rig had before Retarget; what you changed stays in the file."""
    discard(context, active_rig(context))


class MOCAP_AUTOLABEL_OT_match_bones(Ours, bpy.types.Operator):
    """Find which bones of the active rig are which parts of the body, by names and form, in place of those below."""

    needs = (lacks_rig,)

    def work(self, context):
        matched = match_bones(rest_bones(active_rig(context)))
        if not matched:
            raise InputError(f"{active_rig(context).name} looks like no person; expected arms, legs and a spine")
        _keep(active_rig(context), matched)


@operator(lacks_rig, of=ImportsFile, filter_glob=StringProperty(default="*.bmap;*.json", options={"HIDDEN"}))
def read_bone_map(_self, context, path: Path) -> str:
    """Take the bones of the active rig from a map of Auto-Rig Pro (.bmap) or KeeMap (.json) that drives it."""
    matched, rig = match_map(bone_maps.read_bone_map(path)), active_rig(context)
    matched = {part: bone for part, bone in matched.items() if bone in rig.data.bones}
    if not matched:
        raise InputError(f"names no bone of {rig.name}; expected a map onto this rig", path)
    _keep(rig, matched)
    return f"{len(matched)} parts of the body have a bone of {rig.name}"
