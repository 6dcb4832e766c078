# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's cameras look through the real lens, and calibrations come back out of them."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
from bpy.app.handlers import persistent
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from addon.core.data.errors import InputError
from addon.scene import cameras as scene_cameras

FIELDS = ("size", "matrix", "distortion", "rotation", "translation", "inverse")


def test_blender_sees_points_where_the_calibration_puts_them(empty, made):
    cameras, scene = made.cameras(), empty.scene
    collection = scene_cameras.add_cameras(scene, cameras)
    points = np.random.default_rng(1).uniform([-1, -1, 0], [1, 1, 2], (50, 3))
    expected = cameras.project(points)
    for index, camera in enumerate(collection.objects):
        scene_cameras.look_through(scene, camera)
        empty.view_layer.update()
        view = np.array([world_to_camera_view(scene, camera, Vector(point)) for point in points])
        width, height = cameras.size[index]
        assert np.abs(np.column_stack([view[:, 0] * width, (1 - view[:, 1]) * height]) - expected[index]).max() < 0.01


def test_calibrations_survive_blender(empty, made):
    cameras = made.cameras(lens=-0.2)
    back = scene_cameras.cameras_of(scene_cameras.add_cameras(empty.scene, cameras), empty.scene)
    assert back.names == cameras.names
    for field in FIELDS:
        np.testing.assert_allclose(getattr(back, field), getattr(cameras, field), rtol=1e-6, atol=1e-5)
    points = np.random.default_rng(2).uniform([-1, -1, 0], [1, 1, 2], (50, 3))
    assert np.abs(back.project(points) - cameras.project(points)).max() < 0.005


def test_a_lens_of_vicons_kind_survives_blender(empty, made, tmp_path):
    lenses = np.array([[0.4, 0.2, 0.0], [0.0, 0.0, 0.0], [-0.1, 0.3, 0.05], [0.65, 0.8, 0.0]])
    cameras = replace(made.cameras(), inverse=lenses)
    collection = scene_cameras.add_cameras(empty.scene, cameras)
    assert scene_cameras.find_or_add_cameras(empty.scene, cameras) == collection
    assert scene_cameras.find_or_add_cameras(empty.scene, made.cameras()) != collection
    bpy.data.collections.remove(empty.scene.collection.children[-1])
    path = str(tmp_path / "room.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    points = np.random.default_rng(2).uniform([-1, -1, 0], [1, 1, 2], (50, 3))
    for back in (scene_cameras.cameras_of(collection, empty.scene), scene_cameras.cameras_of_blend(path)):
        found = back.select([back.names.index(name) for name in cameras.names])
        np.testing.assert_array_equal(found.inverse[:4], lenses)
        assert np.abs(found.project(points) - cameras.project(points)).max() < 0.005
    assert np.abs(cameras.project(points) - made.cameras().project(points)).max() > 1


def test_moving_a_camera_moves_its_calibration(empty, made):
    collection = scene_cameras.add_cameras(empty.scene, made.cameras())
    collection.objects[1].location.z += 0.5
    empty.view_layer.update()
    moved = scene_cameras.cameras_of(collection, empty.scene).centres - made.cameras().centres
    np.testing.assert_allclose(moved, [[0, 0, 0], [0, 0, 0.5], [0, 0, 0], [0, 0, 0]], atol=1e-5)


@pytest.mark.parametrize("switched_off", [False, True])
def test_cameras_are_where_they_are_as_soon_as_a_file_is_open(empty, made, tmp_path, switched_off):
    """Blender works out later where objects are, and not at all in a collection that is switched off."""
    cameras, found = made.cameras(), []
    collection = scene_cameras.add_cameras(empty.scene, cameras)
    rig = bpy.data.objects.new("Rig", None)
    empty.scene.collection.objects.link(rig)
    rig.location, rig.rotation_euler = (1, 2, 0), (0, 0, 0.5)
    collection.objects[1].parent = rig
    empty.view_layer.update()
    before = scene_cameras.cameras_of(collection, empty.scene)
    assert np.abs(before.centres[1] - cameras.centres[1]).max() > 0.3
    empty.view_layer.layer_collection.children[collection.name].exclude = switched_off
    path = str(tmp_path / "room.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)

    @persistent
    def read(*_):
        found.append(scene_cameras.cameras_of(bpy.data.collections[name], bpy.context.scene))

    name = collection.name
    bpy.app.handlers.load_post.append(read)
    try:
        bpy.ops.wm.open_mainfile(filepath=path)
    finally:
        bpy.app.handlers.load_post.remove(read)
    np.testing.assert_allclose(found[0].centres, before.centres, atol=1e-5)
    np.testing.assert_allclose(found[0].rotation, before.rotation, atol=1e-6)


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("size", [(640, 480), (480, 640)])
def test_a_users_own_cameras_are_read_as_blender_draws_them(empty, fit, size):
    scene = empty.scene
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.pixel_aspect_x = 1.25
    camera = bpy.data.objects.new("Mine", bpy.data.cameras.new("Mine"))
    scene.collection.objects.link(camera)
    camera.data.sensor_fit, camera.data.shift_x, camera.data.shift_y = fit, 0.05, -0.1
    camera.location, camera.rotation_euler = (3, -2, 1.5), (1.3, 0.1, 0.8)
    empty.view_layer.update()
    points = np.random.default_rng(3).uniform(-1, 1, (20, 3))
    found = scene_cameras.cameras_of_scene(scene).project(points)[0]
    view = np.array([world_to_camera_view(scene, camera, Vector(point)) for point in points])
    assert np.abs(found - np.column_stack([view[:, 0] * size[0], (1 - view[:, 1]) * size[1]])).max() < 0.01


def test_cameras_of_a_blend_file_leave_nothing_behind_and_what_is_none_is_one_sentence(empty, made, tmp_path):
    path = str(tmp_path / "room.blend")
    scene_cameras.add_cameras(empty.scene, made.cameras(lens=0.1))
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    bpy.ops.wm.read_homefile(use_empty=True)
    before = {len(getattr(bpy.data, kind)) for kind in ("objects", "cameras", "scenes", "libraries", "collections")}
    back = scene_cameras.cameras_of_blend(path)
    for field in FIELDS:
        np.testing.assert_allclose(getattr(back, field), getattr(made.cameras(lens=0.1), field), rtol=1e-6, atol=1e-5)
    after = {len(getattr(bpy.data, kind)) for kind in ("objects", "cameras", "scenes", "libraries", "collections")}
    assert after == before
    path = tmp_path / "room.blend"
    path.write_text("this is not a Blender file")
    with pytest.raises(InputError, match="not a Blender file"):
        scene_cameras.cameras_of_blend(str(path))
