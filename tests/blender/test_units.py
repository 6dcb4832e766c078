# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes in scenes of another unit than metres, as those made for Unreal and Unity are: all is as long as it is."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Vector

from addon.core.posing.character import character_of
from addon.core.retarget.matching import match_bones
from addon.io.points import read_points
from addon.scene import cameras as scene_cameras
from addon.scene.armature import bone_tails, build_of
from addon.scene.live_rig import MovedRig
from addon.scene.markerset_edit import marker_items, read_markerset, show_markerset
from addon.scene.retargeting import rest_bones
from addon.scene.roots import moved_by, root_of
from addon.scene.units import metre_in
from tests.inputs.rigs import mixamo

from . import hands
from .conftest import label_walk, open_room, write_room
from .hands import only, ours, press, stored_take
from .test_character import read_bvh, read_fbx
from .test_retarget import retargeted

CENTIMETRE = 0.01


@pytest.fixture
def centimetres(empty):
    empty.scene.unit_settings.scale_length = CENTIMETRE
    return empty


def view_of(perspective, camera=None) -> SimpleNamespace:
    """A 3D view, which looks through a camera or not."""
    through = {"view_perspective": "PERSP" if camera is None else "CAMERA"}
    view = SimpleNamespace(perspective_matrix=perspective, **through)
    active = SimpleNamespace(region_3d=view, use_local_camera=True, camera=camera)
    regions = [SimpleNamespace(type="WINDOW", width=100, height=100)]
    return SimpleNamespace(spaces=SimpleNamespace(active=active), regions=regions)


def joint(take, name: str, index: int) -> np.ndarray:
    return take.motion.joints[index, take.markerset.skeleton.segments.index(name)]


def test_points_are_shown_as_large_as_they_are_and_exported_as_they_came(
    centimetres, extension, files, name_as, tmp_path
):
    scene = centimetres.scene
    name_as(np.where(np.arange(19) == 18, -1, np.arange(19)))
    press("import_points", filepath=files.take)
    preview = scene.mocap_autolabel.source.preview
    [waiting] = [item for item in scene.objects if item.data == preview]
    assert tuple(waiting.scale) == (100, 100, 100) and ours("scene.roots").placed(preview)[0, 0] == 100
    label_walk(files.folder)
    scene.frame_set(120)
    stored = stored_take()
    for name, item in hands.shown().items():
        seen = stored.motion.markers[stored.index_of(120), stored.words[name]]
        if np.isfinite(seen).all():
            np.testing.assert_allclose(item.matrix_world.translation, 100 * seen, atol=1e-2)
    dots, places = ours("ops.picking").dots_in_view(centimetres, stored, view_of(np.eye(4)))
    np.testing.assert_allclose(places, (100 * dots.xyz[:, :2] + 1) * 50, atol=1e-2)
    press("export_c3d", filepath=tmp_path / "out.c3d", room=False)
    before, after = (read_points(path).xyz[:, :18] for path in (files.take, tmp_path / "out.c3d"))
    np.testing.assert_allclose(before, after, atol=1e-6)
    scene.unit_settings.scale_length = 1  # another unit afterwards is no other size of who was recorded
    assert (ours("scene.roots").moved_by(scene.mocap_autolabel.take) == np.eye(4)).all()
    press("clear")
    assert not [item for item in scene.objects if item.name.endswith(("root", "room"))]


@pytest.mark.parametrize(("kind", "read", "first"), [("fbx", read_fbx, 101), ("bvh", read_bvh, 1)])
def test_a_character_s_file_is_as_large_as_who_was_recorded(centimetres, shown, tmp_path, kind, read, first):
    scene, path = centimetres.scene, str(tmp_path / f"walk.{kind}")
    root = root_of(scene.mocap_autolabel.take)
    assert tuple(root.scale) == (100, 100, 100)
    root.location = 300, 0, 0
    centimetres.view_layer.update()
    press(f"export_{kind}", filepath=path)
    for metre in (1, 100):
        scene.unit_settings.scale_length = 1 / metre
        before = set(bpy.data.objects)
        if kind == "bvh" and metre != 1:
            continue  # it has no unit, and Blender reads its numbers as they are
        read(path)
        [rig] = [item for item in bpy.data.objects if item not in before and item.type == "ARMATURE"]
        scene.frame_set(first + 20)
        hand = rig.matrix_world @ rig.pose.bones["LeftHand"].head / metre
        assert (hand - Vector(joint(shown, "hand.L", 20)) - Vector((3, 0, 0))).length < 5e-3


def test_a_take_of_an_earlier_version_is_exported_as_it_was(centimetres, shown):
    take = centimetres.scene.mocap_autolabel.take
    root = root_of(take)
    del root["mocap_metre"]
    root.scale = 1, 1, 1
    assert (moved_by(take) == np.eye(4)).all()


def test_a_rig_of_the_scene_s_size_stands_where_the_take_does(centimetres, shown):
    rig = mixamo()
    rig.scale *= 100
    centimetres.view_layer.update()
    retargeted(rig)
    centimetres.scene.frame_set(121)
    hips = rig.matrix_world @ rig.pose.bones[match_bones(rest_bones(rig))["hips"]].head
    [armature] = only(centimetres.scene.mocap_autolabel.take, "ARMATURE")
    own = armature.matrix_world @ armature.pose.bones[0].head
    assert (hips - own).length < 40  # of centimetres, of which a stranger's hips are some higher or lower
    before = rig.pose.bones[0].matrix.copy()
    segments, own = shown.markerset.skeleton.segments, build_of(shown.markerset, shown.motion)
    character = character_of(segments, own.joints, bone_tails(shown.markerset, own))
    live = MovedRig(centimetres.scene, rig, character)
    rig.animation_data_clear()
    live.move(rig, character, shown.motion.joints[20], shown.motion.rotations[20])
    centimetres.view_layer.update()
    np.testing.assert_allclose(rig.pose.bones[0].matrix, before, atol=0.05)


def test_cameras_stand_in_the_room_and_are_read_back(centimetres, extension, tmp_path):
    room = write_room(tmp_path, 12)
    open_room(room)
    scene = centimetres.scene
    collection = scene.mocap_autolabel.source.cameras
    first = collection.objects[0]
    np.testing.assert_allclose(first.matrix_basis.translation, 100 * room.room.centres[0], rtol=1e-5)
    found = scene_cameras.cameras_of(collection, scene)
    np.testing.assert_allclose(found.centres, room.room.centres, atol=1e-5)
    press("label")
    stored, camera = stored_take(), collection.objects[0]
    scene.frame_set(int(stored.motion.frames[6]))
    centimetres.view_layer.update()
    # A view through the camera has a blob where its image is.
    inverse = np.linalg.inv(np.array(camera.matrix_world.normalized()))
    matrix = np.array([[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, -1, 0], [0, 0, -1, 0]]) @ inverse
    dots, places = ours("ops.picking").dots_in_view(centimetres, stored, view_of(matrix, camera))
    image = stored.cameras.undistort(stored.rows.xy[dots.trajectory], stored.rows.camera[dots.trajectory])
    np.testing.assert_allclose(places, (2 * image * [1, -1] + 1) * 50, atol=0.01)
    path = str(tmp_path / "room.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    np.testing.assert_allclose(scene_cameras.cameras_of_blend(path).centres, room.room.centres, atol=1e-5)
    # The scene's own are in its unit, too, and those of earlier versions in metres.
    scene_cameras.adopt_cameras(scene)
    np.testing.assert_allclose(scene_cameras.cameras_of_scene(scene).centres, room.room.centres, atol=1e-5)
    for item in collection.objects:
        del item["mocap_metre"]
    np.testing.assert_allclose(scene_cameras.cameras_of(collection, scene).centres, 100 * room.room.centres, rtol=1e-5)


def test_a_marker_set_is_laid_out_as_tall_as_its_person_and_read_back(centimetres, made):
    markerset = made.markerset()
    collection = show_markerset(centimetres, markerset, "toy")
    centimetres.view_layer.update()
    tallest = max(item.matrix_world.translation.z for item in marker_items(collection).values())
    assert 100 < tallest < 220
    np.testing.assert_allclose(read_markerset(collection, markerset, "same").offsets, markerset.offsets, atol=1e-5)


def test_a_scene_without_units_is_in_metres(centimetres):
    assert metre_in(centimetres.scene) == 100
    centimetres.scene.unit_settings.system = "NONE"
    assert metre_in(centimetres.scene) == 1
