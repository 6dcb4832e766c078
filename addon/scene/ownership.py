# SPDX-License-Identifier: GPL-3.0-or-later
"""Whose a thing in the scene is: the add-on's is what it made and nobody changed since, all else is a person's.

What is made is signed with what it is in its take and how it was made. A copy has another name, so it is a person's;
but where all of a scene was copied, what is as its original is the add-on's in the copy, too.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from zlib import crc32

import bpy
import numpy as np
from mathutils import Matrix

from ..core.data.wording import listed
from . import naming

MADE = "mocap_made"  # on what the add-on made: how it was made, and what it is in its take
KEYED = "mocap_keyed"  # on an action: digests of the keys that the add-on made, by slot and curve
LINEAR = 1  # format: the value of BEZT_IPO_LIN behind Keyframe.interpolation, which all keys have that the add-on makes
TURNS_AND_SIZE = "rotation_quaternion", "rotation_euler", "scale"
WITHOUT_NAMES = "unnamed"  # what the object of the points without names is in its take


def sign(block: bpy.types.ID, role: str, take: bpy.types.Collection | None = None):
    """Notes that the add-on made `block` as it is now, and what it is in the take that `take` was made for."""
    block[MADE] = f"{_state(block)} {role}" if take is None else f"{_state(block)} {role_of(take)}\n{role}"


def role_of(block: bpy.types.ID) -> str:
    """What `block` was made as; empty for what the add-on did not make."""
    return str(block.get(MADE, "")).partition(" ")[2]


def is_made_for(block: bpy.types.ID, take: bpy.types.Collection) -> bool:
    """True for what was made for a take, whoever changed it: another's may lie in its collection too."""
    return role_of(block).startswith(f"{role_of(take)}\n")


def is_untouched(block: bpy.types.ID) -> bool:
    """True for what the add-on made and nobody changed since."""
    return _is_as_signed(block) and (not isinstance(block, bpy.types.Object) or is_keyed_by_us(block))


def _is_as_signed(block: bpy.types.ID, called: bpy.types.ID | None = None) -> bool:
    return block.get(MADE) == f"{_state(block, called or block)} {role_of(block)}"


def adopt_copy(scene: bpy.types.Scene, take: bpy.types.Collection):
    """Makes what was copied with a take, to a scene that has it since, the add-on's own, but for what was changed then.

    Nothing where the take is no such copy.
    """
    before = role_of(take)
    actions = {item.animation_data.action for item in scene.objects if item.animation_data is not None} - {None}
    blocks = [take, *take.children_recursive, *actions, *take.all_objects]
    others = [*bpy.data.collections, *bpy.data.actions, *bpy.data.objects]
    twins = {(type(one), one[MADE]): one for one in set(others).difference(blocks) if MADE in one}
    pairs = [(one, twins.get((type(one), one.get(MADE)))) for one in blocks]
    copies = [(one, twin) for one, twin in pairs if twin is not None]
    same = [one for one, twin in copies if _is_as_signed(twin) and _is_as_signed(one, twin)]
    if not any(isinstance(one, bpy.types.Object) for one in same):
        return
    for one, _ in copies:
        role = role_of(one)
        if role == before or role.startswith(f"{before}\n"):
            one[MADE] = f"{one[MADE].partition(' ')[0]} {take.name}{role[len(before) :]}"
    for one in same:
        sign(one, role_of(one))


def note_keys(bag: bpy.types.ActionChannelbag, curve: bpy.types.FCurve, keys: np.ndarray):
    """Notes that the add-on gave one of the curves of an action these keys, (K, 2) frames and values."""
    if KEYED not in bag.id_data:
        bag.id_data[KEYED] = {}
    bag.id_data[KEYED][_place_of(bag.slot_handle, curve)] = _digest_of_keys(keys)


def _place_of(slot: int, curve: bpy.types.FCurve) -> str:
    """What a curve is called where its keys are noted, short enough for Blender."""
    return f"{slot} {crc32(curve.data_path.encode())} {curve.array_index}"


def _digest_of_keys(keys: np.ndarray) -> str:
    return str(crc32(np.ascontiguousarray(keys, np.float32).tobytes()))


def is_keyed_by_us(item: bpy.types.Object) -> bool:
    """Whether all keys of an object are those that the add-on noted."""
    for curve in curves_of(item):
        if not is_noted(item.animation_data.action, item.animation_data.action_slot.handle, curve):
            return False
        if (numbers(curve.keyframe_points, "interpolation", 1, np.int32) != LINEAR).any():
            return False
    return True


def is_noted(action: bpy.types.Action, slot: int, curve: bpy.types.FCurve) -> bool:
    """Whether the keys of one of the curves of an action are those that the add-on noted."""
    noted = action.get(KEYED, {}).get(_place_of(slot, curve))
    return noted == _digest_of_keys(numbers(curve.keyframe_points, "co", 2))


@contextmanager
def changed_by_us(block: bpy.types.ID) -> Iterator[None]:
    """Around a change of the add-on's own: whoever's `block` was before, it is afterwards. Keys are noted beside."""
    as_signed = _is_as_signed(block)
    yield
    if as_signed:
        sign(block, role_of(block))


def release(block: bpy.types.ID):
    """Makes a person's what the add-on made: it is nothing in a take any more."""
    for key in list(block.keys()):
        if key.startswith(naming.OWN_KEYS):
            del block[key]


def made_collection(take: bpy.types.Collection, parent: bpy.types.Collection, name: str, role: str):
    """The collection in a take that was made as `role`, a new one in `parent` that is called `name` where none was."""
    for child in take.children_recursive:
        if role_of(child) == f"{role_of(take)}\n{role}":
            return child
    child = bpy.data.collections.new(name)
    parent.children.link(child)
    sign(child, role, take)
    return child


@dataclass(frozen=True)
class Former:
    """What was made for a take and goes."""

    items: dict[str, bpy.types.Object]  # by what they are in the take
    hanging: list[tuple[bpy.types.Object, Matrix]]  # what of a person's hangs on them, and where in the world that was


def former_of(items: Iterable[bpy.types.Object]) -> Former:
    """Some things that go, and what hangs on them now."""
    going = set(items)
    bpy.context.view_layer.update()
    hanging = [item for item in bpy.data.objects if item.parent in going and item not in going]
    return Former({role_of(item): item for item in going}, [(item, item.matrix_world.copy()) for item in hanging])


def set_aside(collection: bpy.types.Collection, but: Iterable[bpy.types.Object] = ()) -> Former:
    """Takes what is the add-on's out of the collections of a take; what is a person's stays, with its keys.

    `but` is a person's for another reason. The take's root stays. The keys of what goes are gone at once, and its names
    are free.
    """
    made = [one for one in collection.all_objects if is_made_for(one, collection) and naming.TAKE_ROOT not in one]
    kept = set(but)
    going = [item for item in made if item not in kept and is_untouched(item)]
    former = former_of(going)
    for item in set(made) - set(going):
        release(item)
    for item in going:
        for place in made_places(collection):
            if item.name in place.objects:
                place.objects.unlink(item)
        item.name = naming.title("gone")
        if item.data is not None and item.data.users < 2:
            item.data.name = item.name
    _drop_keys(going)
    return former


def made_places(collection: bpy.types.Collection) -> list[bpy.types.Collection]:
    """A take's collection and those below it that the add-on made."""
    return [collection, *(child for child in collection.children_recursive if is_made_for(child, collection))]


def put_in_place(former: Former, collection: bpy.types.Collection):
    """Gives whatever refers to what goes what was made in its place in `collection`, and removes what goes."""
    now = {role_of(item): item for item in collection.all_objects if is_made_for(item, collection)}
    for role, item in former.items.items():
        if role in now:
            item.user_remap(now[role])
    let_go(former)


def let_go(former: Former):
    """Removes what goes. What hung on it, and on nothing else now, stays where it was."""
    items = list(former.items.values())
    data = {item.data for item in items if item.data is not None}
    bpy.data.batch_remove(items)
    for item, world in former.hanging:
        if item.parent is None:
            item.matrix_world = world
    remove_unused(data)


def remove_unused(blocks: Iterable[bpy.types.ID]):
    """Removes those of some data that nothing uses."""
    bpy.data.batch_remove([block for block in set(blocks) if not block.users])


def remove_collections(collection: bpy.types.Collection, name: str) -> bpy.types.Collection | None:
    """Removes a take's collections; what is a person's stays in `collection`, which is called `name` then.

    One that a person renamed stays as well, as it is called. Returns `collection`, None where all is gone.
    """
    for child in made_places(collection)[1:]:
        if not is_untouched(child):
            release(child)
            continue
        for place, things in ((collection.objects, child.objects), (collection.children, child.children)):
            for thing in things:
                if thing.name not in place:
                    place.link(thing)
        bpy.data.collections.remove(child)
    untouched = is_untouched(collection)
    if untouched and not collection.objects and not collection.children:
        bpy.data.collections.remove(collection)
        return None
    release(collection)
    if untouched:
        collection.name = name
    return collection


def persons_in(collection: bpy.types.Collection) -> str:
    """The names of what is a person's in a take's collection, not more than a person reads; empty without any."""
    return listed([item.name for item in collection.all_objects if MADE not in item])


def remove_or_keep(block: bpy.types.ID | None):
    """Removes an action or a material that nothing uses, or keeps it in the file where a person changed it."""
    if block is None or block.users:
        return
    if is_untouched(block):
        bpy.data.batch_remove([block])
    else:
        block.use_fake_user = True


def _drop_keys(items: Iterable[bpy.types.Object]):
    """Takes the keys of some objects away, and the actions that hold no others."""
    actions = set()
    for item in items:
        data = item.animation_data
        if data is None or data.action is None:
            continue
        action, slot = data.action, data.action_slot
        item.animation_data_clear()
        actions.add(action)
        if slot is not None and is_untouched(action) and not slot.users():
            action.slots.remove(slot)
    for action in actions:
        remove_or_keep(action)


def _state(block: bpy.types.ID, called: bpy.types.ID | None = None) -> str:
    """What tells whether a person changed something: its name, what it is made of, what was added to it, its curves.

    Not what Blender changes as it plays, what only says how a thing is shown, nor the colours that the panels choose.
    Its name may be that of another one, after which it is `called`.
    """
    called = called or block
    content: list = _of_any(block, called)
    arrays: list[np.ndarray] = []
    if isinstance(block, bpy.types.Object):
        content += _of_object(block)
        if block.data is not None:
            content += [*_of_any(block.data, called.data), block.data.animation_data is not None]
        if block.type == "MESH":
            mesh = block.data
            content += [len(mesh.polygons), sorted(one.name for one in mesh.attributes if one.name[0] != ".")]
            content.append(mesh.shape_keys is not None)
            arrays.append(numbers(mesh.vertices, "co", 3))
        if block.type == "ARMATURE":
            for bone in block.pose.bones:
                kinds = [one.type for one in bone.constraints]
                content.append((bone.name, _name(bone.parent), kinds, _name(bone.custom_shape), _own_keys(bone)))
            arrays += [
                np.array([getattr(bone, one) for bone in block.data.bones]) for one in ("matrix_local", "tail_local")
            ]
        for curve in curves_of(block):
            content += [curve.data_path, curve.array_index, curve.mute, curve.extrapolation]
            content += [one.type for one in curve.modifiers]
    if isinstance(block, bpy.types.Material) and block.node_tree is not None:
        content += [(node.bl_idname, node.name) for node in block.node_tree.nodes]
    digest = crc32(repr(content).encode("utf-8", "surrogatepass"))
    for array in arrays:
        digest = crc32(array.tobytes(), digest)
    return str(digest)


def _of_any(block: bpy.types.ID, called: bpy.types.ID) -> list:
    return [called.name, block.use_fake_user, block.asset_data is not None, _own_keys(block)]


def _own_keys(block) -> list[str]:
    """The custom properties that the add-on did not make."""
    keys = sorted(block.keys())
    return [key for key in keys if not key.startswith(naming.OWN_KEYS)]


def _of_object(item: bpy.types.Object) -> list:
    data, parent = item.animation_data, item.parent
    action = None if data is None else data.action
    keyed = {curve.data_path for curve in curves_of(item)}
    above: tuple[str | None, str]
    if parent is None and item.parent_bone:  # its armature was deleted, which is no change of its own
        above = f"{role_of(item).rpartition(' capsule ')[0]} armature", "BONE"
    else:
        above = None if parent is None or naming.TAKE_ROOT in parent else role_of(parent), item.parent_type
    content = [
        *above,
        item.parent_bone,
        item.rotation_mode,
        *(list(getattr(item, path)) for path in TURNS_AND_SIZE if path not in keyed),
        [(one.type, one.name) for one in item.constraints],
        [(one.type, one.name, _name(getattr(one, "node_group", None))) for one in item.modifiers],
        [one.name for one in item.vertex_groups],
        [(slot.link, slot.material == item.get(naming.MATERIAL)) for slot in item.material_slots],
        item.rigid_body is not None,
        item.instance_type,
        None if action is None else (str(action.get(MADE)), data.action_slot_handle),
        [] if data is None else [len(data.nla_tracks), len(data.drivers)],
    ]
    if "location" not in keyed:
        content.append(list(item.location))
    return content


def _name(block) -> str | None:
    return None if block is None else block.name


def curves_of(item: bpy.types.Object) -> list[bpy.types.FCurve]:
    """The curves that an object is keyed by."""
    data = item.animation_data
    if data is None or data.action is None or data.action_slot is None:
        return []
    strips = (strip for layer in data.action.layers for strip in layer.strips if strip.type == "KEYFRAME")
    bags = (strip.channelbag(data.action_slot) for strip in strips)
    return [curve for bag in bags if bag is not None for curve in bag.fcurves]


def numbers(things, path: str, width: int, kind: type = np.float32) -> np.ndarray:
    """(N * width,) what each of N things has at `path`."""
    flat = np.empty(len(things) * width, kind)
    things.foreach_get(path, flat)
    return flat
