# SPDX-License-Identifier: GPL-3.0-or-later
"""Labelling again and Remove Take take what was made for the take, and nothing that a person made or changed."""

import shutil
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core.data.takes import NO_MARKER
from addon.core.edits.kinds import Swap
from addon.io.markersets import open_markerset
from addon.scene import naming, ownership, performers
from addon.scene import take as takes
from addon.scene.character import add_character, moving_in
from addon.scene.opened import Opened
from addon.scene.relabelled import show_again
from addon.scene.stored import alone
from tests.inputs.rigs import bones_of, mixamo

from .conftest import write_walk_and_ghost
from .hands import ours, out_of_another_file, press, reopen, session, shown, stored_take
from .test_retarget import retargeted

KINDS = ("objects", "meshes", "armatures", "actions", "collections", "materials", "node_groups")


def counts() -> dict[str, list[str]]:
    """The names of everything in the file that a take is made of."""
    return {kind: sorted(block.name for block in getattr(bpy.data, kind)) for kind in KINDS}


def own_mesh(name: str, place: bpy.types.Collection) -> bpy.types.Object:
    item = bpy.data.objects.new(name, bpy.data.meshes.new(name))
    place.objects.link(item)
    return item


def new_mesh(name: str) -> bpy.types.Object:
    return own_mesh(name, bpy.context.scene.collection)


def item_of(collection: bpy.types.Collection, kind: str) -> bpy.types.Object:
    """One of the things that were made for a take: a marker of bob's, his armature, a capsule, what has no name."""
    if kind == "unnamed":
        return next(item for item in collection.all_objects if item.name.endswith("unnamed"))
    bob = collection.children["bob"]
    if kind == "marker":
        return next(item for item in bob.all_objects if item.get(naming.MARKER) == "bob:LKNE")
    mark = {"armature": "mocap_scale", "capsule": naming.CAPSULE}[kind]
    return next(item for item in bob.all_objects if mark in item)


def in_scene(name: str) -> bool:
    return name in bpy.context.scene.objects


@pytest.fixture(params=["labelled again", "removed", "saved, opened and labelled again", "saved, opened and removed"])
def over(request, tmp_path):
    """Does what deletes: labels the take again or removes it, in this session or in one after it was saved."""

    def delete(take: takes.Take) -> bpy.types.Collection | None:
        name = next(one.name for one in takes.takes_of(bpy.context.scene) if one[naming.TAKE] == take.name)
        if request.param.startswith("saved"):
            reopen(tmp_path / "own.blend")
        collection = bpy.data.collections[name]
        if request.param.endswith("removed"):
            return takes.remove_take(collection, bpy.context.scene)
        return show_again(bpy.context, take, whole=True)

    delete.removes = request.param.endswith("removed")
    return delete


@pytest.fixture
def duet(empty, made):
    """A take of two in a scene, with the points that have no name."""
    take = made.pair()
    return SimpleNamespace(take=take, collection=takes.show_take(empty, take))


def curve_of(item: bpy.types.Object) -> bpy.types.FCurve:
    return ownership.curves_of(item)[0]


def turn(item):
    item.rotation_quaternion = item.rotation_euler.to_quaternion() if item.rotation_mode == "XYZ" else (0.6, 0.8, 0, 0)
    item.rotation_euler, item.scale = (0.1, 0.2, 0.3), (2, 2, 2)


def move_joint(item):
    with bones_of(item) as bones:
        bones[2].tail.z += 0.1


def give_material(item, link="DATA"):
    item.material_slots[0].link = link
    item.material_slots[0].material = bpy.data.materials.new("mine too")


ALL, MOVED = "marker armature capsule unnamed", "marker armature"
# What a person does to something, and to which kinds of things that were made.
CHANGES = {
    "rename": (ALL, lambda one: setattr(one, "name", "mine")),
    "add constraint": (ALL, lambda one: setattr(one.constraints.new("COPY_ROTATION"), "target", new_mesh("target"))),
    "add property": (ALL, lambda one: one.__setitem__("note", "look here")),
    "turn": ("marker armature capsule", turn),
    "key scale": (ALL, lambda one: one.keyframe_insert("scale", frame=105)),
    "push down": (
        MOVED,
        lambda one: one.animation_data.nla_tracks.new().strips.new("own", 101, one.animation_data.action),
    ),
    "move a key": (MOVED, lambda one: setattr(curve_of(one).keyframe_points[2].co, "y", 0.25)),
    "protect": ("marker", lambda one: setattr(one, "use_fake_user", True)),
    "drive": ("marker", lambda one: setattr(one.driver_add("rotation_euler", 0).driver, "expression", "frame")),
    "own action": ("marker", lambda one: setattr(one.animation_data, "action", bpy.data.actions.new("mine too"))),
    "make constant": ("marker", lambda one: setattr(curve_of(one).keyframe_points[1], "interpolation", "CONSTANT")),
    "smooth keys": ("marker", lambda one: curve_of(one).modifiers.new("NOISE")),
    "hang elsewhere": ("marker capsule", lambda one: setattr(one, "parent", new_mesh("hook"))),
    "constrain bone": ("armature", lambda one: one.pose.bones[2].constraints.new("LIMIT_ROTATION")),
    "shape bone": ("armature", lambda one: setattr(one.pose.bones[2], "custom_shape", new_mesh("shape"))),
    "move joint": ("armature", move_joint),
    "give material": ("capsule", give_material),
    "give material to the object": ("capsule", lambda one: give_material(one, "OBJECT")),
    "sculpt": ("capsule", lambda one: setattr(one.data.vertices[3].co, "x", 0.02)),
    "add modifier": ("capsule", lambda one: one.modifiers.new("mine", "SUBSURF")),
    "add uv": ("capsule", lambda one: one.data.uv_layers.new(name="mine")),
    "add group": ("capsule", lambda one: one.vertex_groups.new(name="mine")),
}
EVERY_CHANGE = [(kind, name) for name, (kinds, _) in CHANGES.items() for kind in kinds.split()]


def keys_in(item) -> list[list[float]]:
    return [list(key.co) for curve in ownership.curves_of(item) for key in curve.keyframe_points]


@pytest.mark.parametrize("over", ["labelled again", "saved, opened and removed"], indirect=True)
@pytest.mark.parametrize(("kind", "change"), EVERY_CHANGE)
def test_what_a_person_changed_is_that_persons(duet, over, kind, change):
    item = item_of(duet.collection, kind)
    CHANGES[change][1](item)
    name = item.name
    bpy.context.view_layer.update()
    action = item.animation_data.action.name if item.animation_data and item.animation_data.action else None
    keys = keys_in(item)
    left = over(duet.take)
    assert in_scene(name), "it is in a collection of the scene"
    kept = bpy.data.objects[name]
    assert name in left.all_objects
    assert ownership.role_of(kept) == ""
    assert not any(key.startswith("mocap_") for key, _ in kept.items())
    assert (kept.animation_data.action.name if action else None) == action
    assert keys_in(kept) == keys
    assert change != "move a key" or len(kept.animation_data.action.slots) == 1, "the keys of what went are gone"
    assert name in ownership.persons_in(left)
    assert left in bpy.context.scene.collection.children_recursive
    if over.removes:
        assert left.name == "Kept from duet"
        assert not takes.is_take(left)
        assert not [child for child in left.children_recursive if ownership.MADE in child]
        assert not [one for one in left.all_objects if ownership.MADE in one]
    else:
        assert takes.is_take(left)
        same = [one for one in left.all_objects if ownership.role_of(one)]
        assert len(same) == 2 * (1 + 13 + 18) + 3
        assert all(ownership.is_untouched(one) for one in same)


@pytest.mark.parametrize("where", ["take", "performer", "markers", "nested", "moved"])
def test_a_persons_own_things_stay(duet, over, where):
    own = bpy.data.collections.new("own")
    bob = duet.collection.children["bob"]
    places = {"take": duet.collection, "performer": bob, "nested": own, "moved": own}
    place = places.get(where) or next(child for child in bob.children if child.name.endswith("markers"))
    {"nested": bob, "moved": duet.collection}.get(where, bpy.context.scene.collection).children.link(own)
    item = own_mesh("stage", place)
    item.location = (1, 2, 3)
    left = over(duet.take)
    assert in_scene("stage")
    assert "stage" in left.all_objects
    assert bpy.data.objects["stage"].data.name == "stage"
    if where in ("nested", "moved"):
        assert [one.name for one in bpy.data.objects["stage"].users_collection] == ["own"]


def test_a_copy_of_what_was_made_is_who_copied_its(duet, over):
    names = []
    for kind in ("marker", "armature", "capsule", "unnamed"):
        item = item_of(duet.collection, kind)
        copy = item.copy()
        if item.data is not None:
            copy.data = item.data.copy() if kind != "capsule" else item.data
        if kind == "marker":
            copy.animation_data.action = item.animation_data.action.copy()
        item.users_collection[0].objects.link(copy)
        names.append(copy.name)
    corrected = takes.scene_markers.marker_empties(duet.collection)["bob:LKNE"]
    assert corrected == item_of(duet.collection, "marker") and corrected.name != names[0]
    over(duet.take)
    assert all(in_scene(name) for name in names)
    assert not any(ownership.MADE in bpy.data.objects[name] for name in names)
    assert all(len(bpy.data.objects[name].data.vertices) for name in names[2:])


def test_what_hung_on_an_armature_that_was_deleted_goes_with_the_take(duet, over):
    count = len([item for item in bpy.data.objects if naming.CAPSULE in item])
    bpy.data.objects.remove(item_of(duet.collection, "armature"))
    over(duet.take)
    assert len([item for item in bpy.data.objects if naming.CAPSULE in item]) == (0 if over.removes else count)


def test_what_was_promised_stays_even_unchanged(empty, made, over):
    take = made.pair(markerset=open_markerset("body26"))
    collection = takes.show_take(empty, take)
    stored = Opened().take(collection, empty.scene)
    homes = performers.homes(collection)
    at = [(homes[one.name], alone(stored, one)) for one in stored.performers]
    names = [add_character(empty, home, moving_in(home, own), "HUMANIK").name for home, own in at]
    bpy.data.objects[names[0]].name = "hero"
    over(take)
    for name in ("hero", names[1]):
        assert in_scene(name)
        data = bpy.data.objects[name].animation_data
        assert sum(len(curve.keyframe_points) for curve in ownership.curves_of(bpy.data.objects[name])) > 0
        assert data.action_slot is not None


def test_what_hangs_on_the_take_stays_where_it_is_or_follows_what_comes(duet, over):
    marker, armature = (item_of(duet.collection, kind) for kind in ("marker", "armature"))
    scene = bpy.context.scene
    on_marker, on_bone = (new_mesh(name) for name in ("on marker", "on bone"))
    on_marker.parent = marker
    on_bone.parent, on_bone.parent_type, on_bone.parent_bone = armature, "BONE", "head"
    constraint = new_mesh("follower").constraints.new("COPY_LOCATION")
    constraint.target = marker
    skin = new_mesh("skin")
    skin.modifiers.new("skin", "ARMATURE").object = armature
    scene.frame_set(110)
    bpy.context.view_layer.update()
    items = ("on marker", "on bone", "follower")
    before = [np.array(bpy.data.objects[name].matrix_world) for name in items]
    left = over(duet.take)
    bpy.context.scene.frame_set(110)
    bpy.context.view_layer.update()
    places = [np.array(bpy.data.objects[name].matrix_world) for name in items]
    np.testing.assert_allclose(places[:2], before[:2], atol=1e-5)
    target = bpy.data.objects["follower"].constraints[0].target
    deforms = bpy.data.objects["skin"].modifiers[0].object
    if over.removes:
        assert (left, target, deforms) == (None, None, None)
    else:
        np.testing.assert_allclose(places[2], before[2], atol=1e-5)
        assert (target.name, target[naming.MARKER]) == ("bob:LKNE", "bob:LKNE")
        assert deforms == item_of(left, "armature")
        assert bpy.data.objects["on bone"].parent == deforms


def test_what_is_linked_into_an_own_collection_stays_in_it(duet, over):
    own = bpy.data.collections.new("knees")
    bpy.context.scene.collection.children.link(own)
    own.objects.link(item_of(duet.collection, "marker"))
    over(duet.take)
    [item] = bpy.data.collections["knees"].objects
    assert item.name == "bob:LKNE"
    assert ownership.curves_of(item)


def test_what_was_called_otherwise_among_collections_stays(duet, over):
    bob = duet.collection.children["bob"]
    duet.collection.name, bob.name = "my walk", "my bob"
    duet.collection["note"] = "best take"
    left = over(duet.take)
    assert left.name == "my walk"
    assert left["note"] == "best take"
    assert "my bob" in left.children
    assert in_scene("bob:LKNE") is not over.removes


def test_an_action_or_a_material_that_was_renamed_stays(duet, over, tmp_path):
    action = item_of(duet.collection, "marker").animation_data.action
    action.name = "best"
    slots = len(action.slots)
    performers.body_material(duet.collection.children["bob"]).name = "skin"
    left = over(duet.take)
    assert len(bpy.data.actions["best"].slots) == slots
    assert bpy.data.actions["best"].users > 0
    assert bpy.data.materials["skin"].users > 0
    assert (left is None) is over.removes


def test_nothing_that_nobody_changed_is_left(empty, made, over):
    """Not even after it was played, looked at, hidden, edited and shown again by the add-on itself."""
    take = made.pair()
    before = counts()
    collection = takes.show_take(empty, take)
    shown = counts()
    stored = Opened().take(collection, empty.scene)
    takes.keep_edits(collection, stored.edits.added(Swap(("bob:LKNE", "bob:RKNE"), frames=(103, 110))))
    takes.show_edits(collection, stored, Opened().take(collection, empty.scene))
    performers.set_colour(collection, "bob", (0.1, 0.2, 0.3))
    for item in list(collection.all_objects):
        item.select_set(True)
        item.show_name = True
        item.hide_viewport = True
    bpy.context.view_layer.objects.active = armature = item_of(collection, "armature")
    armature.hide_viewport = False
    for mode in ("EDIT", "POSE", "OBJECT"):
        bpy.ops.object.mode_set(mode=mode)
    for frame in (104, 118):
        empty.scene.frame_set(frame)
    left = over(take)
    # Materials and nodes that all takes of a file share stay.
    now = counts()
    if over.removes:
        assert left is None
        assert {kind: now[kind] for kind in KINDS[:-1]} == {kind: before[kind] for kind in KINDS[:-1]}
    else:
        assert now == shown
        assert [child.name for child in left.children] == ["ann", "bob"]


def test_who_moves_by_the_takes_action_goes_on_moving(duet, over):
    """An own object in the slot of a marker, and one in a slot of its own in the take's action."""
    marker = item_of(duet.collection, "marker")
    action = marker.animation_data.action
    for name in ("in the slot", "in an own slot"):
        data = new_mesh(name).animation_data_create()
        data.action = action
    bpy.data.objects["in the slot"].animation_data.action_slot = marker.animation_data.action_slot
    own = bpy.data.objects["in an own slot"].animation_data
    own.action_slot = action.slots.new(id_type="OBJECT", name="own")
    bpy.data.objects["in an own slot"].keyframe_insert("location", frame=103)
    over(duet.take)
    assert len(ownership.curves_of(bpy.data.objects["in the slot"])) == 3
    assert len(ownership.curves_of(bpy.data.objects["in an own slot"])) == 3
    action = bpy.data.objects["in the slot"].animation_data.action
    assert sorted(slot.name_display for slot in action.slots) == ["bob:LKNE", "own"]


def test_another_take_in_the_collection_is_left_alone(duet, made, over):
    """One that was dragged into it, and one of whose things somebody linked there."""
    inside, beside = (takes.show_take(bpy.context, made.take(name=name)) for name in ("inside", "beside"))
    bpy.context.scene.collection.children.unlink(inside)
    duet.collection.children.link(inside)
    guests = [item.name for item in inside.all_objects] + [item.name for item in beside.all_objects]
    for item in list(beside.all_objects):
        duet.collection.objects.link(item)
    names = inside.name, beside.name
    over(duet.take)
    for name in guests:
        assert ownership.is_untouched(bpy.data.objects[name])
    assert [len(bpy.data.collections[name].all_objects) for name in names] == [34, 34]
    assert {one.name for one in takes.takes_of(bpy.context.scene)} >= set(names)


@pytest.mark.parametrize("link", [False, True], ids=["appended", "linked"])
@pytest.mark.parametrize("again", [False, True], ids=["removed", "labelled again"])
def test_a_take_out_of_another_file_goes(duet, tmp_path, link, again):
    collection = out_of_another_file(tmp_path / "other.blend", "Mocap: duet", link)
    bpy.context.scene.collection.children.link(collection)
    if again:
        show_again(bpy.context, duet.take, whole=True)
    else:
        assert takes.remove_take(collection, bpy.context.scene) is None
    shown = bpy.context.scene.objects
    assert len(shown) == again * (2 * (1 + 13 + 18) + 3)
    assert all(item.library is None for item in shown)


@pytest.mark.parametrize("again", [False, True], ids=["removed", "labelled again"])
def test_what_overrides_a_linked_take_is_left_out_with_all_that_hangs_on_it(duet, tmp_path, again):
    collection, scene = out_of_another_file(tmp_path / "other.blend", "Mocap: duet"), bpy.context.scene
    collection = collection.override_hierarchy_create(scene, bpy.context.view_layer)
    bpy.data.scenes.new("Two").collection.children.link(collection)
    armature, marker = item_of(collection, "armature"), item_of(collection, "marker")
    armature.animation_data.action = bpy.data.actions.new("mine")
    new_mesh("hanging").parent = marker
    if again:
        assert show_again(bpy.context, duet.take, whole=True) != collection
    else:
        assert takes.remove_take(collection, scene) is None
    assert sum(item.type == "ARMATURE" for item in bpy.context.view_layer.objects) == again * 2
    reopen(tmp_path / "own.blend")
    [armature] = bpy.data.user_map(subset=[bpy.data.actions["mine"]])[bpy.data.actions["mine"]]
    assert armature.name in bpy.data.scenes["Two"].objects
    assert bpy.data.objects["hanging"].parent.name in bpy.data.scenes["Two"].objects


def test_twice_again_keeps_what_was_kept_once(duet):
    item_of(duet.collection, "marker").name = "mine"
    first = show_again(bpy.context, duet.take, whole=True)
    once = counts()
    item_of(first, "capsule")["note"] = "look here"
    second = show_again(bpy.context, duet.take, whole=True)
    assert second == first
    assert len(counts()["objects"]) == len(once["objects"]) + 1
    left = takes.remove_take(second, bpy.context.scene)
    assert sorted(ownership.persons_in(left).split(", ")) == sorted(["mine", "pelvis capsule.001"])


def test_points_that_were_renamed_stay_when_others_are_imported(extension, empty, made, tmp_path):
    settings, written = empty.scene.mocap_autolabel, write_walk_and_ghost(tmp_path, 12)
    for name in ("one", "two", "three"):
        shutil.copy(written.take, tmp_path / f"{name}.c3d")
    press("import_points", filepath=tmp_path / "one.c3d")
    [item] = empty.scene.objects
    item.name = "reference"
    child = new_mesh("stage")
    child.parent = item
    press("import_points", filepath=tmp_path / "two.c3d")
    assert sorted(one.name for one in empty.scene.objects) == ["Mocap: two points", "reference", "stage"]
    assert len(bpy.data.objects["reference"].data.vertices)
    press("import_points", filepath=tmp_path / "three.c3d")
    assert sorted(one.name for one in empty.scene.objects) == ["Mocap: three points", "reference", "stage"]
    assert settings.source.preview.name == "Mocap: three points"
    assert "Mocap: two points" not in bpy.data.meshes


@pytest.mark.parametrize("button", ["label", "clear"])
def test_the_buttons_say_what_stays_and_undo_takes_them_back(labelled, extension, capfd, button):
    own_mesh("stage", labelled.scene.mocap_autolabel.take)
    shown()["LKNE"].name = "my knee"
    before = counts()
    stored_take()
    bpy.ops.ed.undo_push(message="Before")
    capfd.readouterr()
    press(button)
    said = capfd.readouterr().out
    assert "my knee" in said and "stage" in said
    assert ("Mocap: walk" if button == "label" else "Kept from walk") in said
    assert in_scene("my knee") and in_scene("stage")
    bpy.ops.ed.undo_push(message="After")
    bpy.ops.ed.undo()
    assert counts() == before
    stored = stored_take()
    assert np.isfinite(stored.motion.markers[:, stored.names.index("LKNE")]).any()
    assert bpy.data.objects["my knee"][naming.MARKER] == "LKNE"


def test_after_labelling_again_and_its_undo_the_take_at_hand_is_the_one_that_is_there(labelled, extension, name_as):
    count = len(stored_take().labels.marker)
    bpy.ops.ed.undo_push(message="Before")
    name_as(np.r_[1, 0, 2:18, NO_MARKER])
    press("label")
    again = stored_take().labels.marker[:2]
    bpy.ops.ed.undo_push(message="Again")
    bpy.ops.ed.undo()
    undone = stored_take().labels.marker
    assert len(undone) == count
    assert again.tolist() == undone[:2].tolist()[::-1]


def test_another_take_is_the_active_one_after_one_was_removed(extension, empty, made):
    scene, settings = empty.scene, empty.scene.mocap_autolabel
    three = [takes.show_take(empty, made.take(name=name)) for name in ("other markers", "first", "second")]
    three[0].hide_viewport, names = True, [one.name for one in three]
    settings.take = three.pop()
    for name in reversed(names[:2]):
        press("clear")
        assert settings.take.name == name and not settings.take.hide_viewport
        assert settings.display.stage == "REVIEW" and len(session().markers) == 18
    press("clear")
    assert settings.take is None and takes.takes_of(scene) == []


@pytest.mark.parametrize("how", ["switched", "labelled", "removed"])
def test_in_a_full_copy_of_a_scene_a_take_has_one_body_and_the_original_stays(labelled, how):
    first, settings = labelled.scene, labelled.scene.mocap_autolabel
    own = settings.take
    before = {item.name: (item.get(ownership.MADE), curves_in(item)) for item in own.all_objects}
    shown()["C7"].scale = 3, 3, 3  # somebody's, in the copy as well
    rig = mixamo()
    kept = retargeted(rig)
    bpy.ops.scene.new(type="FULL_COPY")
    scene = labelled.window.scene
    if how == "switched":
        ours("ui").after_switch()
        copy = next(item for item in takes.takes_of(scene)[0].all_objects if item.type == "ARMATURE").copy()
        scene.collection.objects.link(copy)  # the copy of a copy, which is somebody's
    press("clear" if how == "removed" else "label")
    bodies = [item for item in scene.objects if item.type == "ARMATURE" and item.name != "rig.001"]
    assert len(bodies) == {"switched": 2, "labelled": 1, "removed": 0}[how]
    assert len([item for item in scene.objects if tuple(item.scale) == (3, 3, 3)]) == 1
    assert len([item for item in scene.objects if "capsule" in item.name]) == (0 if how == "removed" else 15)
    assert {item.name: (item.get(ownership.MADE), curves_in(item)) for item in own.all_objects} == before
    assert rig.animation_data.action == kept and ours("scene.rig_preview").preview_on(rig, own) == kept
    labelled.window.scene = first
    press("clear")
    assert not [item for item in first.objects if "capsule" in item.name]


def curves_in(item) -> int:
    return len(ownership.curves_of(item))
