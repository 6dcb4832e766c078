# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes hide what capsules hide, however they hang on bones; marker sets come back as they were laid out by hand."""

import bpy
import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.papers.virtual_occlusions.occlusion import OCCLUDING, CapsuleOcclusion
from addon.core.posing.finer import finer
from addon.io.markersets import builtin_markersets, open_markerset
from addon.scene import markerset_edit, naming
from addon.scene.armature import add_armature, armature_of, mean_build
from addon.scene.body import add_body
from addon.scene.occlusion import capsule_meshes, occlusion_of

from .hands import add_object


@pytest.fixture
def body(empty, made):
    """Marker set, armature and capsule meshes of the mean person at rest."""
    markerset = made.markerset()
    build = mean_build(markerset)
    armature = add_armature(empty, empty.scene.collection, "Body", markerset, build)
    return markerset, armature, add_body(empty.scene.collection, armature, markerset, build.scale)


def arguments(motion, centres, markers=None):
    there = np.isfinite(motion.joints).all(axis=(1, 2))
    markers = motion.expected if markers is None else markers
    return motion.rotations[there], motion.joints[there], motion.scale[there], markers[there], centres


def test_meshes_agree_with_the_closed_form_on_capsules(empty, made, body):
    (markerset, armature, meshes), shrink = body, OCCLUDING.fitted_shrink
    motion = made.motion(markerset, 60)
    scattered = motion.expected + np.random.default_rng(1).normal(0, 0.1, motion.expected.shape)
    occlusion, unmade = occlusion_of(empty, armature, meshes, markerset), capsule_meshes(markerset)
    for markers, least in ((motion.expected, 0.997), (scattered, 0.995)):
        given = arguments(motion, made.cameras().centres, markers)
        wide, narrow = (CapsuleOcclusion(markerset, shrink * part).hidden(*given) for part in (1.0, 0.985))
        clear = wide == narrow  # a mesh of 24 sides is up to 1 % thinner than its capsule
        for found in (occlusion.hidden(*given), unmade.hidden(*given)):
            assert found.shape == wide.shape
            assert 0.1 < found.mean() < 0.9
            assert (found == wide)[clear].mean() > least


def test_a_marker_on_its_skin_is_seen_from_its_side_and_a_missing_one_or_a_lost_body_hides_nothing(empty, made, body):
    markerset, armature, meshes = body
    rest = np.tile(np.eye(3), (1, len(markerset.skeleton), 1, 1))
    joints = markerset.skeleton.rest_joints[None] * 1.7
    markers = markerset.rest_markers[None] * 1.7
    eyes = np.array([[-4.0, 0, 1.2], [4.0, 0, 1.2]])
    found = occlusion_of(empty, armature, meshes, markerset).hidden(rest, joints, np.full((1, 3), 1.7), markers, eyes)
    sacr, clav = markerset.index("SACR"), markerset.index("CLAV")
    assert found[0][:, sacr].tolist() == [False, True]
    assert found[0][:, clav].tolist() == [True, False]
    motion = made.motion(markerset, 8)
    motion.expected[0, 0] = np.nan
    found = occlusion_of(empty, armature, meshes, markerset).hidden(
        motion.rotations, motion.joints, motion.scale, motion.expected, made.cameras().centres
    )
    assert not found[0, :, 0].any()
    assert not found[3].any()
    assert found[1].any()


def test_a_skinned_mesh_is_cut_at_its_bones(empty, made, body):
    markerset, armature, meshes = body
    capsules = occlusion_of(empty, armature, meshes, markerset)
    vertices, faces, owners = [], [], []
    for item in meshes:
        before = len(vertices)
        vertices += [tuple(item.matrix_world @ vertex.co) for vertex in item.data.vertices]
        faces += [tuple(before + index for index in face.vertices) for face in item.data.polygons]
        owners += [item.parent_bone] * len(item.data.vertices)
    skin = add_object("Skin", bpy.data.meshes.new("Skin"))
    skin.data.from_pydata(vertices, [], faces)
    for bone in markerset.skeleton.segments:
        skin.vertex_groups.new(name=bone).add([i for i, owner in enumerate(owners) if owner == bone], 1.0, "REPLACE")
    skin.modifiers.new("Skin", "ARMATURE").object = armature
    armature.pose.bones["thigh.L"].rotation_quaternion = (0.9, 0.4, 0, 0)
    given = arguments(made.motion(markerset, 20), made.cameras().centres)
    assert (occlusion_of(empty, armature, [skin], markerset).hidden(*given) == capsules.hidden(*given)).mean() > 0.998
    assert armature.data.pose_position == "POSE"


def test_a_mesh_on_no_bone_and_the_finer_bones_of_a_take_of_points_are_refused(empty, body):
    _, armature, _ = body
    loose = bpy.data.objects.new("Loose", bpy.data.meshes.new("Loose"))
    with pytest.raises(InputError, match="Loose hangs on no bone"):
        occlusion_of(empty, armature, [loose], body[0])
    markerset, place = open_markerset("body39"), empty.scene.collection
    more = finer(markerset)
    build = mean_build(more)
    armature = add_armature(empty, place, "finer", more, build)
    with pytest.raises(InputError, match="has the finer bones of a take of points"):
        occlusion_of(empty, armature, add_body(place, armature, more, build.scale), markerset)


@pytest.fixture
def laid_out(empty, made):
    """The toy marker set and the collection that shows it."""
    markerset = made.markerset()
    return markerset, markerset_edit.show_markerset(empty, markerset, "toy")


def marker(collection, name):
    return next(item for item in collection.all_objects if item.get(naming.MARKER) == name)


def capsule(collection, segment):
    return next(item for item in collection.all_objects if naming.CAPSULE in item and item.parent_bone == segment)


def assert_same(found, expected):
    assert found.markers == expected.markers
    assert found.skeleton.segments == expected.skeleton.segments
    np.testing.assert_array_equal(found.attachment, expected.attachment)
    np.testing.assert_allclose(found.skeleton.offsets, expected.skeleton.offsets, atol=1e-6)
    np.testing.assert_allclose(found.offsets, expected.offsets, atol=1e-6)
    order = np.argsort(expected.capsules.segment, kind="stable")
    # A capsule is the same from either end; ours keep theirs.
    for name, own in vars(found.capsules).items():
        np.testing.assert_allclose(own, getattr(expected.capsules, name)[order], atol=1e-6, err_msg=name)


@pytest.mark.parametrize("name", sorted(builtin_markersets()))
def test_the_built_in_marker_sets_survive_being_shown(empty, name):
    markerset = open_markerset(name)
    collection = markerset_edit.show_markerset(empty, markerset, name)
    empty.view_layer.update()
    for index, marker_name in enumerate(markerset.markers):
        expected = markerset.rest_markers[index] * markerset.spread.height
        np.testing.assert_allclose(marker(collection, marker_name).matrix_world.translation, expected, atol=1e-5)
    found = markerset_edit.read_markerset(collection, markerset, "mine")
    assert found.name == "mine"
    assert markerset_edit.is_unmoved(found, markerset)
    assert_same(found, markerset)
    np.testing.assert_array_equal(found.spread.modes, markerset.spread.modes)


def test_a_marker_moved_by_hand(empty, laid_out):
    markerset, collection = laid_out
    item = marker(collection, "LKNE")
    empty.view_layer.update()
    item.matrix_world.translation += type(item.location)((0.017, 0, 0.034))
    empty.view_layer.update()
    found = markerset_edit.read_markerset(collection, markerset, "mine")
    assert not markerset_edit.is_unmoved(found, markerset), "what was learned of markers is no more"
    moved = found.offsets - markerset.offsets
    np.testing.assert_allclose(moved[markerset.index("LKNE")], [0.01, 0, 0.02], atol=1e-6)
    assert np.abs(np.delete(moved, markerset.index("LKNE"), axis=0)).max() < 1e-6


def parented(item, armature, segment):
    """Hangs a marker on a bone with Blender's own operator."""
    armature.data.bones.active = armature.data.bones[segment]
    item.select_set(True)
    armature.select_set(True)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.parent_set(type="BONE", keep_transform=True)


@pytest.mark.parametrize(
    ("attach", "name", "segment"), [(markerset_edit.reattach, "LKNE", "shank.L"), (parented, "LANK", "thigh.L")]
)
def test_a_marker_attached_to_another_segment_stays_where_it_stands(empty, laid_out, attach, name, segment):
    markerset, collection = laid_out
    item = marker(collection, name)
    empty.view_layer.update()
    before = item.matrix_world.translation.copy()
    attach(item, armature_of(collection), segment)
    empty.view_layer.update()
    np.testing.assert_allclose(item.matrix_world.translation, before, atol=1e-6)
    found = markerset_edit.read_markerset(collection, markerset, "mine")
    assert found.skeleton.segments[found.attachment[markerset.index(name)]] == segment
    np.testing.assert_allclose(found.rest_markers, markerset.rest_markers, atol=1e-6)


def test_a_capsule_scaled_and_moved(empty, laid_out):
    markerset, collection = laid_out
    item = capsule(collection, "head")
    item.scale = (1.5, 1.5, 1.0)
    item.location.y += 0.017  # along the bone
    found = markerset_edit.read_markerset(collection, markerset, "mine")
    index = markerset.skeleton.segments.index("head")
    assert found.capsules.radius[index] == pytest.approx(markerset.capsules.radius[index] * 1.5, rel=1e-5)
    start, end = (
        getattr(found.capsules, one)[index] - getattr(markerset.capsules, one)[index] for one in ("start", "end")
    )
    np.testing.assert_allclose(start, end, atol=1e-6)
    assert np.linalg.norm(start) == pytest.approx(0.01, rel=1e-4)


def test_markers_added_renamed_and_removed(empty, laid_out):
    markerset, collection = laid_out
    extra = marker(collection, "C7").copy()
    extra[naming.MARKER] = "T10"
    extra.location.x += 0.01
    collection.objects.link(extra)
    bpy.data.objects.remove(marker(collection, "RBHD"))
    found = markerset_edit.read_markerset(collection, markerset, "mine")
    assert set(found.markers) == set(markerset.markers) - {"RBHD"} | {"T10"}
    assert found.markers[-1] == "T10"
    assert not markerset_edit.is_unmoved(found, markerset)
    assert found.spread.modes.shape[1] == len(found.skeleton) + len(found)
    assert found.spread.marker_sd.shape == (len(found),)


def test_what_is_no_marker_set_any_more_is_refused(empty, laid_out):
    def refused(words: str):
        with pytest.raises(InputError, match=words):
            markerset_edit.read_markerset(collection, markerset, "mine")

    markerset, collection = laid_out
    extra, armature = marker(collection, "C7").copy(), armature_of(collection)
    collection.objects.link(extra)
    refused("two markers are called C7")
    extra[naming.MARKER] = "T10"
    extra.parent = None
    refused("T10 hangs on no bone")
    armature.data.bones["head"].name = "kopf"
    refused("no bone head")
    bpy.data.objects.remove(armature)
    refused("lost its armature")
