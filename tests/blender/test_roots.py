# SPDX-License-Identifier: GPL-3.0-or-later
"""The root of a take: what is shown follows it, what is kept does not, exports do by choice."""

from dataclasses import replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector

from .hands import follows, only, ours, refused, shown, stored_take

PLACE = Matrix.LocRotScale((3, -1, 0.5), Matrix.Rotation(1.0, 3, "Z").to_quaternion(), Vector((2, 2, 2)))


@pytest.fixture
def moved(labelled):
    """The root of a take that somebody moved, turned and scaled."""
    root = ours("scene.roots").root_of(labelled.scene.mocap_autolabel.take)
    root.matrix_world = PLACE
    labelled.view_layer.update()
    return root


def at_root(places):
    """Where the root has places (N, 3)."""
    matrix = np.array(PLACE)
    return places @ matrix[:3, :3].T + matrix[:3, 3]


def test_all_that_is_shown_follows_the_root(moved):
    take, stored = bpy.context.scene.mocap_autolabel.take, stored_take()
    index = stored.index_of(bpy.context.scene.frame_current)
    for name, item in shown().items():
        seen = stored.motion.markers[index, stored.words[name]]
        if np.isfinite(seen).all():
            np.testing.assert_allclose(item.matrix_world.translation, at_root(seen), atol=1e-4)
    [armature] = only(take, "ARMATURE")
    [between] = moved.children
    assert all(item.matrix_world == PLACE for item in (armature, *only(take, "MESH")) if item.parent == between)
    assert not [item for item in take.all_objects if item.parent is None and item != moved]
    # Blender draws a dashed line from what is seen to a parent that is.
    assert not between.visible_get() and all(item.parent == between for item in shown().values())


def test_dots_are_drawn_and_picked_where_they_are_shown(moved):
    picking, context, stored = ours("ops.picking"), bpy.context, stored_take()
    view = SimpleNamespace(view_perspective="PERSP", perspective_matrix=np.eye(4))
    regions = [SimpleNamespace(type="WINDOW", width=100, height=100)]
    area = SimpleNamespace(spaces=SimpleNamespace(active=SimpleNamespace(region_3d=view)), regions=regions)
    dots, places = picking.dots_in_view(context, stored, area)
    np.testing.assert_allclose(places, (at_root(dots.xyz)[:, :2] + 1) / 2 * 100, atol=1e-3)


def test_what_is_kept_and_exported_is_the_room_s(moved, files, tmp_path):
    follows(files, "LASI", 1)
    assert bpy.ops.mocap_autolabel.export_c3d(filepath=str(tmp_path / "out.c3d")) == {"FINISHED"}
    points = ours("io.points").read_points(tmp_path / "out.c3d")
    np.testing.assert_allclose(points.xyz[:, 1], files.xyz[:, 1], atol=1e-5)


def test_the_character_and_the_scene_s_own_things_hang_on_it(moved):
    hung = bpy.data.objects.new("hat", None)
    bpy.context.scene.collection.objects.link(hung)
    hung.parent = moved
    bpy.ops.mocap_autolabel.clear()
    assert moved.name in bpy.data.objects and hung.parent == moved


def test_labelled_again_a_take_stays_where_its_root_is(moved, files):
    take = bpy.context.scene.mocap_autolabel.take
    assert bpy.ops.mocap_autolabel.label() == {"FINISHED"}
    assert ours("scene.roots").root_of(take) == moved and moved.matrix_world == PLACE
    assert only(take, "ARMATURE")[0].parent.parent == moved
    assert "kept" not in take.name


def test_a_root_that_was_deleted_is_made_again(moved, files):
    bpy.data.objects.remove(moved)
    take = bpy.context.scene.mocap_autolabel.take
    assert bpy.ops.mocap_autolabel.label() == {"FINISHED"}
    follows(files, "LASI", 1)
    assert len(only(take, "ARMATURE")) == 1 and len(shown()) == len(stored_take().names)
    assert only(take, "ARMATURE")[0].parent.parent == ours("scene.roots").root_of(take)


def test_a_moved_root_goes_with_its_take(moved):
    bpy.ops.mocap_autolabel.clear()
    assert not [item for item in bpy.data.objects if item.name.endswith(("root", "room"))]
    assert not [item for item in bpy.data.collections if "Kept" in item.name]


def test_exports_stand_where_the_root_has_the_take_by_choice(moved, tmp_path, capfd):
    for name in ("c3d", "trc"):
        path = tmp_path / f"out.{name}"
        assert getattr(bpy.ops.mocap_autolabel, f"export_{name}")(filepath=str(path), room=False) == {"FINISHED"}
        points, markers = ours("io.points").read_points(path, up="+z"), stored_take().motion.markers
        seen = np.isfinite(points.xyz[:, : markers.shape[1]]).all(axis=2)
        assert seen.sum() > 300
        np.testing.assert_allclose(points.xyz[:, : markers.shape[1]][seen], at_root(markers[seen]), atol=1e-4)
        assert "so they were saved alone" in capfd.readouterr().out
        if name == "c3d":
            was = np.array(stored_take().motion.residual)
            np.testing.assert_allclose(points.residual[:, : markers.shape[1]][seen], 2 * was[seen], atol=1e-4)
    export = SimpleNamespace(place=lambda _: np.array(PLACE), _more_is_left=False)
    ours("ops.exporting").ExportsPoints.given(export, bpy.context, replace(stored_take(), source="/walk.TSV"))
    assert export._more_is_left, "its head"


def mirror(root):
    root.scale.x *= -1


def drive_by_a_cart(root):
    root.parent = bpy.data.objects.new("cart", None)
    bpy.context.scene.collection.objects.link(root.parent)
    root.parent.keyframe_insert("location", frame=101)


def hold_by_bones(root):
    rig = bpy.data.objects.new("rig", bpy.data.armatures.new("rig"))
    bpy.context.scene.collection.objects.link(rig)
    rig.keyframe_insert("location", frame=101)
    root.constraints.new("ARMATURE").targets.new().target = rig


@pytest.mark.parametrize(
    ("change", "words"),
    [(mirror, "mirrored or scaled"), (drive_by_a_cart, "is animated"), (hold_by_bones, "is animated")],
)
def test_what_no_file_can_have_is_refused_outside_the_room(moved, tmp_path, change, words):
    change(moved)
    for name in ("bvh", "trc"):
        path = str(tmp_path / f"out.{name}")
        refused(words, f"export_{name}", filepath=path, room=False)
    assert bpy.ops.mocap_autolabel.export_trc(filepath=path) == {"FINISHED"}
