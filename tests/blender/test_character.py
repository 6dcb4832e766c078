# SPDX-License-Identifier: GPL-3.0-or-later
"""The take's character: usual bones, exported, read again, copied onto a rig of one's own; and its keys in bulk."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import addon_utils
import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector

from addon.core.data.errors import InputError, JobError
from addon.core.posing.character import BONE_NAMES
from addon.scene import animation, naming
from addon.scene import character as characters
from addon.scene import take as takes
from addon.scene.opened import Opened
from tests.inputs.rigs import RigBone, add_rig

from .hands import ours, press, refused, stored_take

# What a retargeted joint or marker may be off: the root alone moves, and floats of single precision are in between.
MOST_OFF_M = 0.0001
LIMBS = {"Arm": "upper_arm", "ForeArm": "forearm", "Hand": "hand", "UpLeg": "thigh", "Leg": "shank", "Foot": "foot"}
JOINTS = {"Hips": "pelvis", "Spine": "thorax", "Neck": "head"}
for side, word in (("L", "Left"), ("R", "Right")):
    JOINTS |= {f"{word}{bone}": f"{segment}.{side}" for bone, segment in LIMBS.items()}


def found(take):
    return np.flatnonzero(np.isfinite(take.motion.joints).all(axis=(1, 2)))


def marker_errors(take, armature, first):
    """m, how far markers stray in the axes of the bones that stand for what carries them, the worst of each."""
    bone_of = {segment: bone for bone, segment in JOINTS.items()}
    names = [bone_of[take.markerset.skeleton.segments[one]] for one in take.markerset.attachment]
    places = np.full((len(found(take)), len(names), 3), np.nan)
    for row, index in enumerate(found(take)):
        bpy.context.scene.frame_set(first + int(index))
        for marker, bone in enumerate(names):
            axes = np.array(armature.matrix_world @ armature.pose.bones[bone].matrix)
            places[row, marker] = (take.motion.markers[index, marker] - axes[:3, 3]) @ axes[:3, :3]
    return np.linalg.norm(places - np.nanmean(places, axis=0), axis=2)


def joint_errors(take, armature, words, first):
    """m, how far each bone begins from the joint it stands for, the worst of the frames in which somebody was found."""
    worst = dict.fromkeys(words, 0.0)
    segments = take.markerset.skeleton.segments
    for index in found(take):
        bpy.context.scene.frame_set(first + int(index))
        place = np.array(armature.matrix_world)
        for bone, segment in words.items():
            head = place[:3, :3] @ np.array(armature.pose.bones[bone].head) + place[:3, 3]
            off = np.linalg.norm(head - take.motion.joints[index, segments.index(segment)])
            worst[bone] = max(worst[bone], float(off))
    return worst


@pytest.mark.parametrize("names", BONE_NAMES)
def test_bones_begin_at_the_joints_in_every_frame(shown, names):
    bpy.context.scene.mocap_autolabel.bone_names = names
    press("add_character")
    armature = next(item for item in bpy.data.objects if characters.CHARACTER_OF in item)
    key = {called: bone for bone, called in BONE_NAMES["HUMANIK"].items()}
    words = {BONE_NAMES[names][key[bone]]: segment for bone, segment in JOINTS.items()}
    errors = joint_errors(shown, armature, words, int(shown.motion.frames[0]))
    assert max(errors.values()) < MOST_OFF_M, errors


def test_the_rest_is_a_t_pose_that_looks_along_minus_y(shown):
    press("add_character")
    bones = next(item for item in bpy.data.objects if characters.CHARACTER_OF in item).data.bones
    for name, direction in (
        ("LeftArm", (1, 0, 0)),
        ("RightForeArm", (-1, 0, 0)),
        ("LeftHand", (1, 0, 0)),
        ("Spine1", (0, 0, 1)),
        ("Head", (0, 0, 1)),
        ("RightLeg", (0, 0, -1)),
        ("LeftToeBase", (0, -1, 0)),
    ):
        bone = bones[name]
        ahead = np.array(bone.tail_local - bone.head_local) / bone.length
        np.testing.assert_allclose(ahead, direction, atol=1e-4, err_msg=name)
    for name in ("Spine", "LeftArm", "RightForeArm", "LeftUpLeg", "RightLeg"):
        np.testing.assert_allclose(np.array(bones[name].matrix_local)[:3, 2], (0, -1, 0), atol=1e-3, err_msg=name)
    assert len([bone for bone in bones if bone.parent is None]) == 1
    assert bones["LeftArm"].parent.name == "LeftShoulder"
    assert min(bone.head_local.z for bone in bones) > 0


def plain_rig(source):
    """A rig with the joints and names of `source` at rest, but bones that point and roll as nobody's do."""
    bones, world = [], source.matrix_world
    for number, bone in enumerate(source.data.bones):
        head, tail = world @ bone.head_local, world @ bone.tail_local
        end = head + (tail - head).normalized() * 0.07
        bones.append(RigBone(bone.name, bone.parent and bone.parent.name, head, end, 0.4 * number))
    rig = add_rig(bones, {bone.part: bone.part for bone in bones})
    for bone in rig.pose.bones:
        copied = bone.constraints.new("COPY_ROTATION")
        copied.target, copied.subtarget = source, bone.name
        copied.target_space, copied.owner_space = "LOCAL_OWNER_ORIENT", "LOCAL"
    root = rig.pose.bones["Hips"].constraints.new("COPY_LOCATION")
    root.target, root.subtarget = source, "Hips"
    return rig


def read_bvh(path, metres=False):
    bpy.ops.import_anim.bvh(filepath=path, global_scale=1.0 if metres else 0.01, frame_start=1)


def read_fbx(path):
    if not hasattr(bpy.types, "IMPORT_SCENE_OT_fbx"):
        pytest.skip("this Blender reads no FBX")
    bpy.ops.import_scene.fbx(filepath=path, anim_offset=0.0)


def test_files_stand_where_the_root_has_the_take_or_in_the_room_by_choice(shown, tmp_path):
    take, segments = bpy.context.scene.mocap_autolabel.take, shown.markerset.skeleton.segments
    root, room = ours("scene.roots").root_of(take), shown.motion.joints[20, segments.index("hand.L")]
    root.matrix_world = Matrix.LocRotScale((3, -1, 0.5), Matrix.Rotation(1.0, 3, (1, 0, 2)), Vector((2, 2, 2)))
    bpy.context.view_layer.update()
    for kind, read in (("bvh", read_bvh), ("fbx", read_fbx)):
        for options, place in (({}, root.matrix_world @ Vector(room)), ({"room": True}, Vector(room))):
            before, path = set(bpy.data.objects), str(tmp_path / f"{kind}{len(options)}.{kind}")
            getattr(bpy.ops.mocap_autolabel, f"export_{kind}")(filepath=path, **options)
            read(path)
            [rig] = [item for item in bpy.data.objects if item not in before and item.type == "ARMATURE"]
            bpy.context.scene.frame_set((1 if kind == "bvh" else 101) + 20)
            assert (rig.matrix_world @ rig.pose.bones["LeftHand"].head - place).length < MOST_OFF_M * 5
    root.scale.x = 1
    bpy.context.view_layer.update()
    refused("root is mirrored or scaled unevenly", "export_bvh", filepath=tmp_path / "no.bvh")


@pytest.mark.parametrize(
    ("kind", "read", "first", "options"),
    [
        ("bvh", read_bvh, 1, {}),
        ("bvh", partial(read_bvh, metres=True), 1, {"unit": "METRES"}),
        ("fbx", read_fbx, 101, {}),
    ],
)
def test_a_rig_that_copies_the_file_by_bone_names_moves_as_the_body(shown, tmp_path, kind, read, first, options):
    scene, path = bpy.context.scene, tmp_path / f"walk.{kind}"
    played = scene.frame_start, scene.frame_end, scene.frame_current
    before = set(bpy.data.objects)
    press(f"export_{kind}", filepath=path, **options)
    assert set(bpy.data.objects) == before
    assert (scene.frame_start, scene.frame_end, scene.frame_current) == played
    assert kind == "fbx" or b"Frame Time: 0.0166666666667\n" in path.read_bytes()
    read(str(path))
    rig = plain_rig(next(item for item in bpy.data.objects if item not in before and item.type == "ARMATURE"))
    errors = joint_errors(shown, rig, JOINTS, first)
    assert max(errors.values()) < MOST_OFF_M, errors
    assert np.nanmax(marker_errors(shown, rig, first)) < MOST_OFF_M


def exporter(name: str, path: Path, **own):
    """An operator that exports to a path, without Blender's own part of it."""
    kind = getattr(ours("ops.exporting"), f"MOCAP_AUTOLABEL_OT_export_{name}")
    methods = ("asked", "given", "place", "files", "parts", "path_of", "beside", "write")
    operator = type("Exports", (), {one: getattr(kind, one) for one in methods if hasattr(kind, one)})()
    vars(operator).update(room=True, filepath=str(path), of_body=kind.of_body, filename_ext=kind.filename_ext)
    vars(operator).update(own)
    return operator


@pytest.mark.parametrize("name", ["labels", "c3d", "trc", "report", "bvh"])
def test_what_is_written_in_a_process_of_its_own_is_what_a_script_writes(labelled, tmp_path, name):
    long_work, paths = ours("ops.long_work"), [tmp_path / f"{one}.{name}" for one in ("here", "there")]
    press(f"export_{name}", filepath=paths[0])
    operator = exporter(name, paths[1], unit="CENTIMETRES", performer=ours("ops.exporting").TOGETHER[0])
    try:
        worker, found = long_work.hand_over(operator.asked(bpy.context)), None
        while found is None:
            found = worker.look()
    finally:
        long_work.end_process()
    assert found in (([paths[1]], []), [paths[1]])
    here, there = (path.read_bytes().replace(b"there", b"here") for path in paths)
    assert there == here


def test_an_export_tells_how_far_it_is_and_what_is_not_whole_yet_lies_elsewhere(shown, tmp_path):
    here, there = tmp_path / "here.bvh", tmp_path / "there.BVH"
    press("export_bvh", filepath=here)
    operator = exporter("bvh", there, unit="CENTIMETRES", performer=ours("ops.exporting").APART[0])
    shares, beside = [], set()

    def hear(share):
        shares.append(share)
        beside.update(tmp_path.iterdir())

    assert ours("core.data.progress").finished(operator.asked(bpy.context)(), hear) == [there]
    assert beside == {here}  # it may be killed
    assert 0.9 < max(shares) <= 1
    assert len(shares) > len(shown.motion.frames)
    assert there.read_bytes() == here.read_bytes()


@pytest.mark.parametrize(
    ("kind", "ends", "says"),
    [
        ("bvh", None, "No such file"),
        ("fbx", None, "No such file"),
        ("bvh", "FINISHED", "No such file"),  # and gone before it was read again
        ("bvh", "CANCELLED", "that it wrote nothing"),
        ("fbx", "CANCELLED", "that it wrote nothing"),
    ],
)
def test_what_blender_s_exporter_cannot_write_is_one_sentence_and_leaves_all_as_it_was(
    shown, tmp_path, monkeypatch, kind, ends, says
):
    if ends:
        exporter = {"bvh": "EXPORT_ANIM_OT_bvh", "fbx": "EXPORT_SCENE_OT_fbx"}[kind]
        monkeypatch.setattr(getattr(bpy.types, exporter), "execute", lambda *_: {ends})
    body = characters.moving_in(bpy.context.scene.mocap_autolabel.take, stored_take())
    before = {name: len(getattr(bpy.data, name)) for name in ("scenes", "objects", "armatures", "actions")}
    with pytest.raises(JobError, match=rf"Blender's exporter says .*{says}.*; expected a place that can be written"):
        characters.export_character(tmp_path / "gone" / f"a.{kind}", body, "HUMANIK", 1.0, list)
    assert {name: len(getattr(bpy.data, name)) for name in before} == before


def test_an_exporter_that_is_switched_off_is_told_and_a_collection_that_is_excluded_has_its_character(shown, tmp_path):
    addon_utils.disable("io_anim_bvh")
    words = "own BVH exporter is switched off; expected it enabled in the preferences"
    refused(words, "export_bvh", filepath=tmp_path / "b.bvh")
    addon_utils.enable("io_anim_bvh")
    take = bpy.context.scene.mocap_autolabel.take
    bpy.context.view_layer.layer_collection.children[take.name].exclude = True
    press("add_character")
    [character] = [item for item in take.all_objects if item.name == "walk character"]
    assert character.users_collection == (take,) and len(character.data.bones) > 0


def test_blender_s_own_usd_has_markers_and_armature_in_motion(shown, tmp_path):
    scene, path = bpy.context.scene, str(tmp_path / "walk.usdc")
    own = list(scene.mocap_autolabel.take.all_objects)
    [armature] = [item for item in own if item.type == "ARMATURE"]
    markers = {item.name: item for item in own if naming.MARKER in item}
    bpy.ops.wm.usd_export(filepath=path, export_animation=True, only_deform_bones=False)
    bpy.ops.wm.usd_import(filepath=path, set_frame_range=False)
    read = [item for item in bpy.data.objects if item not in own]
    [copy] = [item for item in read if item.type == "ARMATURE"]
    points = {item.name.removesuffix(".001"): item for item in read if item.type == "EMPTY"}
    for frame in shown.motion.frames[[0, 13, 20]].tolist():
        scene.frame_set(frame)
        for bone in armature.pose.bones:
            head = copy.matrix_world @ copy.pose.bones[bone.name.replace(".", "_")].head
            assert (head - armature.matrix_world @ bone.head).length < MOST_OFF_M
        for name, item in markers.items():
            assert (points[name].matrix_world.translation - item.matrix_world.translation).length < MOST_OFF_M


def test_who_is_no_person_has_no_character(empty, made, extension):
    known = made.markerset()
    creature = replace(known.skeleton, segments=tuple(f"part {at}" for at in range(len(known.skeleton))))
    collection = takes.show_take(empty, made.take(markerset=replace(known, skeleton=creature)))
    stored = Opened().take(collection, empty.scene)
    with pytest.raises(InputError, match="no person's skeleton"):
        characters.add_character(empty, collection, characters.moving_in(collection, stored), "HUMANIK")


KEYED = np.arange(11, 71)


@pytest.fixture
def bag(empty):
    item = bpy.data.objects.new("LKNE", None)
    empty.scene.collection.objects.link(item)
    return animation.bind(item, bpy.data.actions.new("walk"))


def keys_of(bag) -> list[list[tuple]]:
    return [[(*key.co, key.interpolation, key.type) for key in curve.keyframe_points] for curve in bag.fcurves]


def path(rng) -> np.ndarray:
    xyz = rng.normal(size=(len(KEYED), 3)).astype(np.float32)
    for start in rng.integers(0, len(KEYED), rng.integers(0, 3)):
        xyz[start : start + 4] = np.nan
    return xyz


@pytest.mark.parametrize("most_single", [300, 1])
@pytest.mark.parametrize("seed", range(24))
def test_moved_keys_are_those_that_keying_anew_makes(bag, seed, most_single, monkeypatch):
    monkeypatch.setattr(animation, "MOST_SINGLE", most_single)
    monkeypatch.setattr(animation, "MOST_REMOVED", most_single)
    rng = np.random.default_rng(seed)
    before, other = path(rng), path(rng)
    first, last = np.sort(rng.integers(0, len(KEYED), 2))
    after = np.concatenate([before[:first], other[first:last], before[last:]])
    was, made = (
        None if rng.random() < 0.5 else (start <= KEYED) & (start + 9 > KEYED) for start in (22, rng.choice(50))
    )
    animation.key(bag, "location", KEYED, before, "LKNE", was)
    moved = animation.move(bag, "location", KEYED, (before, was), (after, made))
    assert moved == ((np.isfinite(before[:, 0]).sum() - np.isfinite(after[:, 0]).sum()) <= most_single)
    if not moved:
        return
    found = keys_of(bag)
    animation.clear(bag, "location")
    animation.key(bag, "location", KEYED, after, "LKNE", made)
    assert found == keys_of(bag)
    values = [[curve.evaluate(frame) for frame in KEYED] for curve in bag.fcurves]
    there = np.isfinite(after[:, 0])
    np.testing.assert_allclose(np.array(values).T[there], after[there], atol=1e-6)


def test_keys_that_a_hand_took_away_or_that_all_go_are_not_moved(bag):
    before, after = (path(np.random.default_rng(seed)) for seed in (1, 2))
    animation.key(bag, "location", KEYED, before, "LKNE")
    assert not animation.move(bag, "location", KEYED, (before, None), (before * np.nan, None))
    points = bag.fcurves[1].keyframe_points
    points.remove(points[3])
    keys = keys_of(bag)
    assert not animation.move(bag, "location", KEYED, (before, None), (after, None))
    assert keys_of(bag) == keys
