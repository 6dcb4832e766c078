# SPDX-License-Identifier: GPL-3.0-or-later
"""A take's motion as an action of somebody's rig, whatever its bones hang on.

Blender itself is asked what carries each bone: all are turned at once, and what turns as another one does follows it.
So constraints, drivers and bones in between count as they are.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..core.body.sides import BODY_SIDES
from ..core.data.errors import InputError
from ..core.posing.character import Character
from ..core.retarget.matching import LIMBS, NEEDED_PARTS, NO_CONTROLS, PARTS, RestBones
from ..core.retarget.moving import Moving
from ..core.retarget.retargeting import Rig, axes_at_rest, place_of, retarget, stands
from . import animation
from .armature import SCALE, armature_of, bone_path, rotation_channel
from .character import moving_in
from .clock import fps_of, refresh_frame
from .ik_controls import Along, carriers_of, controls_by_ik, loose_bones
from .opened import opened
from .ownership import changed_by_us, curves_of, is_keyed_by_us, is_made_for, is_untouched, sign
from .roots import is_even
from .stored import Stored

# What bones of control rigs are switched to, by the name of their property: limbs by FK, and all follow what is above.
SWITCHES = {"IK_FK": 1.0, "ik_fk_switch": 1.0, "FK_limb_follow": 0.0, "neck_follow": 1.0, "head_follow": 1.0}
SWITCHES |= {"pole_vector": 1.0}  # and limbs by IK, which go along, bend towards their poles
BLENRIG_SWITCHES = {f"{name}_{side}": 1.0 for name in ("ik_arm", "ik_leg", "space_hand") for side in BODY_SIDES}
# Constraints that hold a bone from turning by itself.
HOLDING = {"IK", "SPLINE_IK", "COPY_ROTATION", "COPY_TRANSFORMS", "DAMPED_TRACK", "TRACK_TO", "LOCKED_TRACK"}
HOLDING |= {"STRETCH_TO", "LIMIT_ROTATION", "LIMIT_LOCATION"}
KEPT_AT_REST = "hips", "chest"  # Rigify's controls between its torso and the spine's by FK, which they turn, too
PROBE_TURN, PROBE_STEP = 0.5, 0.9  # rad by which bones are turned to see what follows them, and between their axes
TURNED_PARTS = "hips", *LIMBS[0][:2], *LIMBS[1][:2]  # without which a body does not move as another
MATCHED = "mocap_matched"  # on an action: the bones of its rig, by the parts of the body that they are
SWITCHED = "mocap_switched"  # on an action: what it switches on its rig, by paths, and what that was before
PREVIEW = "mocap_preview"  # on an action that follows: what it was made of, the action before with its slot, and poses
MOST_OFF = 0.01  # rad that a bone may be from where it is turned
LEAST_STEP = 1e-4  # that a bone goes at least where it is put one further; less is none
BONE_CHANNELS = "location", "rotation_quaternion", "rotation_euler", "rotation_axis_angle", "scale"


def rest_bones(rig: bpy.types.Object) -> RestBones:
    """The bones of an armature at rest."""
    bones = rig.data.bones
    parents = np.array([-1 if bone.parent is None else bones.find(bone.parent.name) for bone in bones])
    heads, tails = (
        np.array([getattr(bone, end) for bone in bones]).reshape(-1, 3) for end in ("head_local", "tail_local")
    )
    deforming = [bone for bone in rig.pose.bones if bone.name.startswith(("DEF-", "ORG-"))] or rig.pose.bones
    held = any(bone.constraints for bone in deforming)
    return RestBones(tuple(bone.name for bone in bones), parents, heads, tails, held)


def retarget_take(
    context: bpy.types.Context,
    rig: bpy.types.Object,
    collection: bpy.types.Collection,
    stored: Stored,
    matched: Mapping[str, str],
    feet: bool,
    hands: bool,
    action: bpy.types.Action | None = None,
) -> bpy.types.Action:
    """Gives a rig an action of its own that moves it as the take's body; `matched` has its bones by the body's parts.

    That is the one that it has, where this is to be made again; any other stays.
    Raises InputError where the body or the rig is no person's.
    """
    body = moving_in(collection, stored)
    source = armature_of(collection)
    bones, place = checked(rig, matched, body.character, source.matrix_world)
    joints, rotated = _settled(body, stored)
    there = np.flatnonzero(np.isfinite(joints).all(axis=(1, 2)))
    if not len(there):
        raise InputError(f"{stored.name} has nobody in any frame; expected a take in which the body was found")
    if action is not None:  # what it moves no more is as it was before
        pose_bones(rig, json.loads(action[PREVIEW]["posed"]))
    try:
        ready = ReadyRig.of(rig, bones, place)
        with ready.before.or_put_back(rig):
            motion = joints[there[0] : there[-1] + 1], rotated[there[0] : there[-1] + 1]
            moved = retarget(body.character, motion, stored.rate, ready.rest, feet, hands)
            channels = [(*channel, values[there - there[0]]) for *channel, values in ready.channels(*moved)]
    except InputError:
        refresh_frame(context.scene)
        raise
    action = action or _new_action(rig)
    action.name = f"{stored.name} retargeted"
    action[PREVIEW]["posed"] = json.dumps(ready.before.channels)
    clock = stored.clock.at_rate(fps_of(context.scene), stored.rate)
    bag, frames = animation.channels(rig, action), clock.shown(stored.motion.frames)[there]
    kept = {bone_path(bone, channel) for bone, channel, _ in channels}
    for curve in list(bag.fcurves):
        if curve.data_path not in kept or len(curve.keyframe_points) != len(frames):
            bag.fcurves.remove(curve)
    for bone, channel, values in channels:
        animation.key(bag, bone_path(bone, channel), frames, values, bone)
    for bone, path, value, _ in ready.before.switched:
        animation.key(bag, path, frames[:1], np.array([[value]]), bone)
    action[SWITCHED] = rig[SWITCHED] = json.dumps(ready.before.noted)
    action[MATCHED] = json.dumps(dict(matched))
    animation.note_time(action, fps_of(context.scene), clock.start)
    sign(action, stored.name, collection)
    refresh_frame(context.scene)
    return action


def _settled(body: Moving, stored: Stored) -> tuple[np.ndarray, np.ndarray]:
    """What `body.settled` gives, kept for as long as neither the take nor its armature at rest is another."""
    rest = body.begins.tobytes() + body.ends.tobytes()
    before, kept = opened.looked_at.get("settled", (None, (b"",)))
    if before is not stored or kept[0] != rest:
        kept = rest, body.settled()
        opened.looked_at["settled"] = stored, kept
    return kept[1]


def matched_before(rig: bpy.types.Object) -> dict[str, str]:
    """The bones of a rig, by the parts that they are, of its action where that is one of ours; else none.

    Blender saves what is chosen for a rig, but not for an override of one that is linked, nor how its rows differ.
    """
    action = None if rig.animation_data is None else rig.animation_data.action
    kept = {} if action is None else json.loads(action.get(MATCHED, "{}"))
    return kept if all(bone in rig.pose.bones for bone in kept.values()) else {}


def freed_by(action: bpy.types.Action) -> int:
    """How many constraints an action gives no influence, so that what they hold is moved."""
    return sum(path.endswith(".influence") for path in json.loads(action[SWITCHED]))


def _former(rig: bpy.types.Object) -> dict[str, float]:
    """What is as our actions switch it was before the rig's one did, by paths.

    That is kept on the rig, whatever it is called and has by then; a rig that got its action otherwise has it there.
    """
    action = None if rig.animation_data is None else rig.animation_data.action
    noted: dict[str, float] = {}
    for block in (one for one in (action, rig) if one is not None):
        noted |= json.loads(block.get(SWITCHED, "{}"))
    return {path: value for path, value in noted.items() if _value(rig, path) == _switched_to(path)}


def follow_actions(*_, give_back: bool = True):
    """Gives rigs back what our actions switched, where another was put in their place by hand.

    Or lets them keep what they have, as a file was saved.
    """
    for rig in (one for one in bpy.data.objects if one.is_editable):
        action = None if rig.animation_data is None else rig.animation_data.action
        if action is not None and SWITCHED in action:
            noted = json.loads(rig.get(SWITCHED, "{}"))
            found = {path: _value(rig, path) for path in json.loads(action[SWITCHED]) if path not in noted}
            rig[SWITCHED] = json.dumps(noted | {path: value for path, value in found.items() if value is not None})
        elif SWITCHED in rig:
            noted = json.loads(rig[SWITCHED])
            del rig[SWITCHED]
            for path, value in noted.items():
                if give_back and _value(rig, path) == _switched_to(path):  # any other value is a person's
                    _set(rig, path, value)
            rig.update_tag(refresh={"TIME"})


def _switched_to(path: str) -> float | None:
    """What our actions switch a path of a rig to."""
    return 0.0 if path.endswith(".influence") else (SWITCHES | BLENRIG_SWITCHES).get(path.rpartition("[")[2][1:-2])


def _value(rig: bpy.types.Object, path: str) -> float | None:
    """What a path from a rig leads to; None where it is gone."""
    try:
        return float(rig.path_resolve(path))
    except ValueError:
        return None


def is_rig(item: bpy.types.Object) -> bool:
    """Whether it is an armature that a person may change and no take's own."""
    return item.type == "ARMATURE" and SCALE not in item and item.is_editable


def _parents(item: bpy.types.Object) -> Iterator[bpy.types.Object]:
    while item := item.parent:
        yield item


def _is_placed_by_keys(item: bpy.types.Object) -> bool:
    """Whether keys or drivers place an object, and do not only hide it, say."""
    curves = [*curves_of(item), *getattr(item.animation_data, "drivers", ())]
    return any(curve.data_path.startswith(("location", "rotation", "scale", "delta")) for curve in curves)


def checked(
    rig: bpy.types.Object, matched: Mapping[str, str], character: Character, world: Matrix
) -> tuple[list[tuple[str, str]], np.ndarray]:
    """The parts that a character moves, with their bones, and (4, 4) the place of a rig in the character's `world`."""
    bones = _bones_by_part(rig, {part: bone for part, bone in matched.items() if part in character.names})
    place = np.array(world.inverted() @ rig.matrix_world)
    if not is_even(place):
        raise InputError(f"{rig.name} is mirrored or scaled unevenly; expected its scale applied, with Ctrl A")
    if moving := next(filter(_is_placed_by_keys, _parents(rig)), None):
        raise InputError(f"{rig.name} hangs on {moving.name}, which is animated; expected it on what stands still")
    if rig.hide_viewport:
        raise InputError(f"{rig.name} is disabled in viewports; expected it enabled, in the Outliner")
    refuse_tweaking(rig)
    return bones, place


def refuse_tweaking(rig: bpy.types.Object):
    """InputError where the action of a rig is one of a strip, which no other can take the place of."""
    if rig.animation_data is not None and rig.animation_data.use_tweak_mode:
        raise InputError(f"a strip of {rig.name} is in tweak mode; expected you to leave that, with Tab in the editor")


def pose_bones(rig: bpy.types.Object, channels: Mapping[str, Sequence]):
    """Gives bones, if they are still there, these values of `BONE_CHANNELS`."""
    for name in channels.keys() & set(rig.pose.bones.keys()):
        for channel, value in zip(BONE_CHANNELS, channels[name], strict=True):
            setattr(rig.pose.bones[name], channel, value)


@dataclass(frozen=True)
class KeptPose:
    """What bones of a rig had before it was readied."""

    channels: dict[str, list]  # of each of the bones, the values of `BONE_CHANNELS`
    switched: list[tuple[str, str, float, float]]  # bones with the paths of what is switched, what to, and from what
    former: dict[str, float]  # what is as it is switched already was before, by its path
    strips: bool  # whether an action takes the place of what strips pose
    shown: str  # its pose position

    @classmethod
    def of(cls, rig: bpy.types.Object, names: Iterable[str], turned: Sequence[str]) -> "KeptPose":
        """That of the bones of these names; nothing is to hold those that are turned."""
        channels = {name: [getattr(rig.pose.bones[name], one)[:] for one in BONE_CHANNELS] for name in names}
        bones, driven = rig.pose.bones, {one.data_path for one in getattr(rig.animation_data, "drivers", ())}
        switches = SWITCHES | (BLENRIG_SWITCHES if "master_torso" in turned else {})
        switched = [
            (bone.name, f'{bone_path(bone.name, "")[:-1]}["{name}"]', switches[name], bone[name])
            for bone in bones
            for name in switches.keys() & bone.keys()
        ]
        former = _former(rig)
        for bone in turned:
            holding = HOLDING | ({"ARMATURE"} if bones[bone].parent else set())  # which hangs on others, too
            for held in (one for one in bones[bone].constraints if one.type in holding and not one.mute):
                path = held.path_from_id("influence")
                held_by = held.influence or path in former
                if held_by and path not in driven and path.replace(".influence", ".mute") not in driven:
                    switched.append((bone, path, 0.0, held.influence))
        data = rig.animation_data
        strips = data is not None and data.use_nla and bool(data.nla_tracks) and data.action_blend_type == "REPLACE"
        return cls(channels, switched, former, strips, rig.data.pose_position)

    @property
    def noted(self) -> dict[str, float]:
        """What is switched was before any action of ours, by its paths."""
        return {path: self.former.get(path, before) for _, path, _, before in self.switched}

    def switch(self, rig: bpy.types.Object):
        """Switches the rig, and puts it in pose position."""
        rig.data.pose_position = "POSE"
        for path, value in (self.former | {path: value for _, path, value, _ in self.switched}).items():
            _set(rig, path, value)
        rig.update_tag()

    @contextmanager
    def or_put_back(self, rig: bpy.types.Object) -> Iterator[None]:
        """Puts the rig back as it was where what is done fails."""
        try:
            yield
        except Exception:
            self.put_back(rig)
            raise

    def put_back(self, rig: bpy.types.Object):
        """Puts the rig back as it was; what else somebody posed meanwhile stays."""
        pose_bones(rig, self.channels)
        for path in self.former:
            _set(rig, path, _switched_to(path))
        for _, path, _, before in self.switched:
            _set(rig, path, before)
        rig.data.pose_position = self.shown
        rig.update_tag()


@dataclass(frozen=True, eq=False)
class ReadyRig:
    """A rig that was asked how it moves."""

    bones: tuple[str, ...]  # the names of its C bones that move, and
    modes: dict[str, str]  # how each of them and of `resting` turns
    mover: str  # the name of the one whose location moves all: the first, or what that is connected to
    resting: list[str]  # the names of those that stay as at rest, because they would turn or move the others
    rest: Rig  # what they are, and where, in the axes of a character
    turners: np.ndarray  # (C,) index of the one that each turns with, -1 for none of them
    place: np.ndarray  # (4, 4) where it stands
    axes: np.ndarray  # (3, 3) of a character in its own, and
    matrices: np.ndarray  # (C, 4, 4) its bones at rest in its own
    steps: np.ndarray  # (3, 3) how far the first one goes there for a unit of each channel of the mover's location
    along: list[Along]  # the controls by IK that go along, and those of its bones that nothing carries
    before: KeptPose  # what those bones had

    @classmethod
    def of(cls, rig: bpy.types.Object, bones: list[tuple[str, str]], place: np.ndarray) -> "ReadyRig":
        """Readies a rig, by the parts that its bones are: it is in pose position, switched to FK, and unturned.

        What drivers or constraints turn is left out. InputError, and the rig as it was, where hips do not go where they
        are put, one of `TURNED_PARTS` does not turn so, or it does not stand at rest.
        """
        parts, names = zip(*bones, strict=True)
        mover = rig.data.bones[names[0]]
        while mover.use_connect and mover.parent is not None:
            mover = mover.parent
        found = controls_by_ik(rig, bones)
        movers, count = [mover.name, *(name for name, _ in found)], len(names)
        resting = [one for one in KEPT_AT_REST if "torso" in names and one not in names and one in rig.pose.bones]
        resting += [mover.name] * (mover.name not in names)
        resting += [one for one in _posed_above(rig, names, mover) if one not in resting]
        modes = {name: rig.pose.bones[name].rotation_mode for name in (*names, *movers, *resting)}
        before = KeptPose.of(rig, list(modes), names)
        before.switch(rig)
        with before.or_put_back(rig):
            with _without_action(rig), _alone(rig) as layer:
                for name in {mover.name, *resting}:
                    rig.pose.bones[name].matrix_basis = Matrix()
                turners, carriers, matrices, turn_off = _probe(layer, rig, [*names, *movers[1:]], mover.name)
                loose = loose_bones(parts, carriers)
                found += [(names[at], (at,)) for at in loose]
                steps = _steps(layer, rig, [(mover.name, names[0]), *((name, name) for name, _ in found)])
            goes = np.linalg.svd(steps, compute_uv=False)[:, -1] >= LEAST_STEP
            if not goes[0]:
                raise InputError(
                    f"{names[0]} of {rig.name} does not go where it is put; expected it without constraints"
                )
            off = np.flatnonzero(turn_off[:count] > MOST_OFF).tolist()
            if held := [names[at] for at in off if parts[at].partition(".")[0] in TURNED_PARTS]:
                raise InputError(
                    f"{held[0]} of {rig.name} does not turn as it is put; expected it without drivers and constraints"
                )
            if off:
                before.put_back(rig)
                return cls.of(rig, [bone for at, bone in enumerate(bones) if at not in off], place)
            by = carriers_of(turners, count, [limb for _, limb in found], goes[1:])
            by, turn_with = [*by, *carriers[list(loose)]], [*by, *turners[list(loose)]]
            places = [*range(count, len(turners)), *loose]
            along = [
                Along(name, limb, by[at], turn_with[at], modes[name], matrices[places[at]], steps[1 + at])
                for at, (name, limb) in enumerate(found)
                if goes[1 + at]
            ]
            going = {one.bone for one in along}
            pose_bones(rig, {name: before.channels[name] for name in set(movers[1:]) - going})
            carriers = np.array([loose[at] if names[at] in going else carriers[at] for at in range(count)])
            matrices = matrices[:count]
            # What carries the hips may be posed, as files come in; how a rig stands, its rest says.
            posed = matrices[0, :3, :3] @ np.array(rig.data.bones[names[0]].matrix_local)[:3, :3].T
            axes = posed @ axes_at_rest(dict(zip(parts, matrices[:, :3, 3] @ posed, strict=True)))
            if not stands(dict(zip(parts, matrices[:, :3, 3] @ axes, strict=True))):
                raise InputError(
                    f"{rig.name} does not stand at rest; expected its head over its hips, and these over its knees"
                )
        unit = np.linalg.norm(place[:3, :3], axis=0).mean()
        heads = matrices[:, :3, 3] @ axes * unit
        ends = np.array([_end(rig.data.bones[bone], part) for part, bone in bones])
        tails = heads + (matrices[:, :3, :3] @ ends[..., None])[..., 0] @ axes * unit
        rest = Rig(parts, carriers, heads, tails)
        at_rest = rest, turners[:count], place, axes, matrices
        return cls(names, modes, mover.name, resting, *at_rest, steps[0], along, before)

    def channels(self, turns: np.ndarray, hips: np.ndarray) -> Iterator[tuple[str, str, np.ndarray]]:
        """The bones with the channels that move them, (F, …), by what `retarget` says."""
        unit = np.linalg.norm(self.place[:3, :3], axis=0).mean()
        # To the armature's own axes and unit, and from its axes to the character's.
        back, smaller = (self.place[:3, :3] / unit).T, np.linalg.inv(self.place[:3, :3]).T
        to_axes = np.ascontiguousarray(self.axes.T)  # a view takes three times as long
        head = (hips - self.place[:3, 3]) @ smaller
        yield self.mover, "location", (head - self.matrices[0, :3, 3]) @ np.linalg.inv(self.steps)
        going = {one.bone for one in self.along}
        for index, bone in enumerate(self.bones):
            if bone in going:
                continue
            above, own = self.turners[index], self.matrices[index, :3, :3]
            carried = own.T @ back if above < 0 else (turns[:, above] @ (to_axes @ own)).swapaxes(1, 2)
            yield bone, *rotation_channel(self.modes[bone], carried @ (turns[:, index] @ (to_axes @ own)))
        for bone in self.resting:
            yield bone, *rotation_channel(self.modes[bone], np.tile(np.eye(3), (len(hips), 1, 1)))
        for bone in (*self.resting, *(self.bones if self.before.strips else ())):
            if bone not in going | {self.mover}:
                yield bone, "location", np.zeros((len(hips), 3))
            yield bone, "scale", np.ones((len(hips), 3))
        if self.along:
            heads = np.stack([place_of(self.rest, turns, hips, at) for at in range(len(self.bones))], axis=1)
            heads = (heads - self.place[:3, 3]) @ smaller
            turns = (back @ turns.swapaxes(0, 1) @ to_axes).swapaxes(0, 1)
        for control in self.along:
            yield from control.channels(heads, turns, self.matrices[:, :3, 3])


def _bones_by_part(rig: bpy.types.Object, matched: Mapping[str, str]) -> list[tuple[str, str]]:
    """The parts with their bones, the hips first, with those between the lowest bone of the spine and the chest."""
    there = [part for part in PARTS if matched.get(part, "") in rig.pose.bones]
    if lacking := [part for part in NEEDED_PARTS if part not in there]:
        raise InputError(
            f"{rig.name} has no bone for {', '.join(lacking)}; expected one for each, under Bones in Use It"
        )
    found = [(part, matched[part]) for part in there]
    if {"spine", "chest"} <= set(there):
        between, bone = [], rig.data.bones[matched["chest"]].parent
        while bone is not None and bone.name != matched["spine"]:
            if not bone.name.startswith(NO_CONTROLS):
                between.insert(0, ("between", bone.name))
            bone = bone.parent
        at = there.index("chest")
        found[at:at] = between if bone is not None else []
    if twice := [bone for number, (_, bone) in enumerate(found) if bone in [one for _, one in found[:number]]]:
        raise InputError(f"{twice[0]} of {rig.name} stands for two parts of the body; expected a bone for each")
    return found


def _posed_above(rig: bpy.types.Object, names: Sequence[str], mover: bpy.types.Bone) -> list[str]:
    """The bones that are posed and carry some of these, but not all: as files come in, which makes legs longer.

    What carries all is where a person put the rig, but not where its action, whose place another takes, has keys.
    """
    above = [set(rig.data.bones[name].parent_recursive) for name in names]
    keyed = {curve.data_path.rpartition(".")[0] for curve in curves_of(rig)}
    put = {bone for bone in set.intersection(*above) if bone_path(bone.name, "")[:-1] not in keyed}
    found = {bone.name for bone in set.union(*above) - put} - {*names, mover.name}
    return sorted(name for name in found if rig.pose.bones[name].matrix_basis != Matrix())


def _end(bone: bpy.types.Bone, part: str) -> Vector:
    """Where a bone ends in its own axes; a foot whose toes are apart where they begin, toes where bones after them do.

    Importers lay bones anywhere.
    """
    end, toes, own = Vector((0, bone.length, 0)), bone.children, bone.matrix_local.inverted()
    if part.startswith("foot") and len(toes) > 1:
        begin = own @ (sum((toe.head_local for toe in toes), Vector()) / len(toes))
        end = max(end, begin, key=lambda place: place.length)
    if part.startswith("toes") and bone.parent is not None:
        ahead = own.to_3x3() @ (bone.head_local - bone.parent.head_local)
        tip = max((own @ one.head_local for one in bone.children_recursive), key=ahead.dot, default=end)
        end = tip if ahead.dot(tip) > 0 else end
    return end


def _set(rig: bpy.types.Object, path: str, value: float):
    """Sets what a path from a rig leads to, a property or one that a person added, if it is still there."""
    if _value(rig, path) is None:
        return
    head, _, name = path.rpartition("." if not path.endswith("]") else "[")
    owner = rig.path_resolve(head)
    if path.endswith("]"):
        name = name[1:-2]
        owner[name] = type(owner[name])(value)
    else:
        setattr(owner, name, value)


def _new_action(rig: bpy.types.Object) -> bpy.types.Action:
    """A new preview beside what a rig has, which notes that."""
    data = rig.animation_data_create()
    before = {} if data.action is None else {"action": data.action, "slot": data.action_slot_handle}
    if data.action is not None:
        with changed_by_us(data.action):  # a preview that another rig has as well is one still
            data.action.use_fake_user = True
    data.action = action = bpy.data.actions.new("")
    action[PREVIEW] = before | {"posed": "{}"}
    return action


def preview_on(rig: bpy.types.Object, take: bpy.types.Collection | None = None) -> bpy.types.Action | None:
    """The action of a rig, where it is a preview, and where a take is given one of that, of whichever performer."""
    action = None if rig.animation_data is None else rig.animation_data.action
    is_preview = action is not None and PREVIEW in action
    return action if is_preview and (take is None or is_made_for(action, take)) else None


def is_ours(rig: bpy.types.Object) -> bool:
    """Whether the action that a rig has is one that we made for it alone, and nobody changed."""
    action = rig.animation_data.action
    return is_untouched(action) and is_keyed_by_us(rig) and action.users == 1 + action.use_fake_user


@contextmanager
def _without_action(rig: bpy.types.Object) -> Iterator[None]:
    """Lets a rig be posed without its action and strips, which would pose it otherwise."""
    data = rig.animation_data
    action, slot, strips = (None, None, False) if data is None else (data.action, data.action_slot, data.use_nla)
    if action is not None:
        data.action = None
    if strips:
        data.use_nla = False
    try:
        yield
    finally:
        if strips:
            data.use_nla = True
        if action is not None:
            data.action, data.action_slot = action, slot


@contextmanager
def _alone(rig: bpy.types.Object) -> Iterator[bpy.types.ViewLayer]:
    """A view layer that has a rig, and of all else what moves it: none of the meshes that hang on it."""
    shown, scene = bpy.context.scene, bpy.data.scenes.new(rig.name)
    scene.frame_current = shown.frame_current  # drivers may ask for it, and for the rate
    scene.render.fps, scene.render.fps_base = shown.render.fps, shown.render.fps_base
    try:
        scene.collection.objects.link(rig)
        yield scene.view_layers[0]
    finally:
        bpy.data.scenes.remove(scene)


def _shown(layer: bpy.types.ViewLayer, rig: bpy.types.Object, names: Sequence[str]) -> np.ndarray:
    """(C, 4, 4) where bones are as a view layer has the rig, in the armature's axes."""
    rig.update_tag()
    layer.update()
    found = rig.evaluated_get(layer.depsgraph).pose.bones
    return np.array([found[name].matrix for name in names])


def _steps(layer: bpy.types.ViewLayer, rig: bpy.types.Object, moved: Sequence[tuple[str, str]]) -> np.ndarray:
    """(K, 3, 3) how far a bone goes for a unit of each channel of a mover's location; `moved` has movers with bones."""
    steps = np.zeros((len(moved), 3, 3))
    for number, (mover, name) in enumerate(moved):
        rest = _shown(layer, rig, [name])
        for axis, way in enumerate(np.eye(3)):
            rig.pose.bones[mover].location = way
            steps[number, axis] = (_shown(layer, rig, [name]) - rest)[0, :3, 3]
        rig.pose.bones[mover].location = (0, 0, 0)
    return steps


def _probe(
    layer: bpy.types.ViewLayer, rig: bpy.types.Object, names: Sequence[str], mover: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Which of C bones each turns with, and which carries where it begins, (C,) and (C,), -1 for none.

    And where they are unturned (C, 4, 4), in the armature's axes, and how far (C,) rad from where they were turned
    they were. Leaves them unturned.
    """
    bones = [rig.pose.bones[name] for name in names]

    def posed(basis: list[Matrix], moved: float) -> np.ndarray:
        for bone, matrix in zip(bones, basis, strict=True):
            bone.matrix_basis = matrix
        rig.pose.bones[mover].location = (moved, moved, moved)
        return _shown(layer, rig, names)

    still = [Matrix()] * len(bones)
    rest = posed(still, 0.0)
    axes = [
        Vector((np.sin(PROBE_STEP * index), np.cos(PROBE_STEP * index), np.sin(index)))
        for index in range(1, 1 + len(bones))
    ]
    basis = [Matrix.Rotation(PROBE_TURN + PROBE_STEP * index, 4, axis) for index, axis in enumerate(axes)]
    found = posed(basis, rig.data.bones[mover].length)
    posed(still, 0.0)
    gone, near = found @ np.linalg.inv(rest), LEAST_STEP * np.ptp(rest[:, :3, 3], axis=0).max()
    heads = rest[:, :, 3]
    rest[:, :3, :3] /= np.linalg.norm(rest[:, :3, :3], axis=1)[:, None]
    turned = _turns(found, rest)
    before = _turns(found @ np.linalg.inv(np.array(basis)), rest)  # of what carries each
    (turners, carriers), turn_off = np.full((2, len(bones)), -1), np.zeros(len(bones))
    even = np.allclose(before @ before.swapaxes(1, 2), np.eye(3), atol=LEAST_STEP)  # else they shear
    for index in range(len(bones)):
        # The cosine of the angle between, which is one for what it turns with.
        alike = [np.trace(before[index]), *(np.trace(before[index] @ turn.T) for turn in turned[:index])]
        turners[index] = int(np.argmax(alike)) - 1
        turn_off[index] = even * np.arccos(np.clip((max(alike) - 1) / 2, -1, 1))
        missed = [np.linalg.norm(found[index, :3, 3] - (way @ heads[index])[:3]) for way in (np.eye(4), *gone[:index])]
        same = missed[turners[index] + 1] < min(missed) + near
        carriers[index] = turners[index] if same else int(np.argmin(missed)) - 1
    return turners, carriers, rest, turn_off


def _turns(posed: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """(C, 3, 3) how bones are turned from rest, by where they are (C, 4, 4) and were."""
    axes = posed[:, :3, :3] / np.linalg.norm(posed[:, :3, :3], axis=1)[:, None]
    return axes @ rest[:, :3, :3].swapaxes(1, 2)
