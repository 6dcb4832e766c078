# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes hide what capsules hide, and a user's own meshes count whatever way they hang on the bones."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.papers.virtual_occlusions.occlusion import OCCLUDING, CapsuleOcclusion, hidden_by_any
from addon.core.posing.finer import finer
from addon.io.markersets import open_markerset
from addon.scene.armature import add_armature, mean_build
from addon.scene.body import add_body
from addon.scene.occlusion import capsule_meshes, occlusion_of


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


@pytest.mark.parametrize("shrink", [1.0, OCCLUDING.fitted_shrink])
def test_meshes_agree_with_the_closed_form_on_capsules(empty, made, body, shrink):
    markerset, armature, meshes = body
    motion = made.motion(markerset, 60)
    scattered = motion.expected + np.random.default_rng(1).normal(0, 0.1, motion.expected.shape)
    occlusion, unmade = occlusion_of(empty, armature, meshes, markerset, shrink), capsule_meshes(markerset, shrink)
    for markers, least in ((motion.expected, 0.999), (scattered, 0.995)):
        given = arguments(motion, made.cameras().centres, markers)
        wide, narrow = (CapsuleOcclusion(markerset, shrink * part).hidden(*given) for part in (1.0, 0.985))
        clear = wide == narrow  # a mesh of 24 sides is up to 1 % thinner than its capsule
        for found in (occlusion.hidden(*given), unmade.hidden(*given)):
            assert found.shape == wide.shape
            assert 0.1 < found.mean() < 0.9
            assert (found == wide)[clear].mean() > least


def test_meshes_of_several_agree_with_the_closed_form(made):
    markerset = made.markerset()
    one = made.motion(markerset, 12)
    shift = np.array([0.4, 0.3, 0.0])
    other = replace(one, joints=one.joints + shift, expected=one.expected + shift)
    each, markers = [one, other], np.concatenate([one.expected, other.expected], axis=1)
    centres = made.cameras().centres
    meshes, capsules = ((kind(markerset, 1.0),) * 2 for kind in (capsule_meshes, CapsuleOcclusion))
    wide = hidden_by_any(capsules, each, markers, centres)
    assert (wide & ~hidden_by_any(capsules[:1], each[:1], markers, centres)).any()
    narrow = hidden_by_any((CapsuleOcclusion(markerset, 0.985),) * 2, each, markers, centres)
    clear = wide == narrow  # a mesh of 24 sides is up to 1 % thinner than its capsule
    assert (hidden_by_any(meshes, each, markers, centres) == wide)[clear].mean() > 0.99


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
    skin = bpy.data.objects.new("Skin", bpy.data.meshes.new("Skin"))
    skin.data.from_pydata(vertices, [], faces)
    empty.scene.collection.objects.link(skin)
    for bone in markerset.skeleton.segments:
        skin.vertex_groups.new(name=bone).add([i for i, owner in enumerate(owners) if owner == bone], 1.0, "REPLACE")
    skin.modifiers.new("Skin", "ARMATURE").object = armature
    armature.pose.bones["l_thigh"].rotation_quaternion = (0.9, 0.4, 0, 0)
    given = arguments(made.motion(markerset, 20), made.cameras().centres)
    assert (occlusion_of(empty, armature, [skin], markerset).hidden(*given) == capsules.hidden(*given)).mean() > 0.998
    assert armature.data.pose_position == "POSE"


def test_the_finer_bones_of_a_take_of_points_are_refused(empty, made):
    markerset = open_markerset("body39")
    build = mean_build(finer(markerset))
    armature = add_armature(empty, empty.scene.collection, "finer", finer(markerset), build)
    with pytest.raises(InputError, match="has the finer bones of a take of points"):
        occlusion_of(
            empty, armature, add_body(empty.scene.collection, armature, finer(markerset), build.scale), markerset
        )


def test_a_mesh_on_no_bone_is_refused(empty, body):
    markerset, armature, _ = body
    loose = bpy.data.objects.new("Loose", bpy.data.meshes.new("Loose"))
    empty.scene.collection.objects.link(loose)
    with pytest.raises(InputError, match="Loose hangs on no bone"):
        occlusion_of(empty, armature, [loose], markerset)
