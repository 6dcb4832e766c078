# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set laid out in the view comes back as it is, and as it was changed by hand."""

import bpy
import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.io.markersets import builtin_markersets, open_markerset
from addon.scene import markerset_edit, naming
from addon.scene.armature import armature_of


@pytest.fixture
def laid_out(empty, made):
    """The small marker set and the collection that shows it."""
    markerset = made.markerset()
    return markerset, markerset_edit.show_markerset(empty, markerset, "small")


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
    np.testing.assert_array_equal(found.capsules.segment, expected.capsules.segment[order])
    np.testing.assert_allclose(found.capsules.radius, expected.capsules.radius[order], atol=1e-6)
    # A capsule is the same from either end; ours keep theirs.
    np.testing.assert_allclose(found.capsules.start, expected.capsules.start[order], atol=1e-6)
    np.testing.assert_allclose(found.capsules.end, expected.capsules.end[order], atol=1e-6)


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
    assert_same(found, markerset)
    np.testing.assert_array_equal(found.spread.modes, markerset.spread.modes)


def test_a_marker_moved_by_hand(empty, laid_out):
    markerset, collection = laid_out
    item = marker(collection, "LKNE")
    empty.view_layer.update()
    item.matrix_world.translation += type(item.location)((0.017, 0, 0.034))
    empty.view_layer.update()
    moved = markerset_edit.read_markerset(collection, markerset, "mine").offsets - markerset.offsets
    np.testing.assert_allclose(moved[markerset.index("LKNE")], [0.01, 0, 0.02], atol=1e-6)
    assert np.abs(np.delete(moved, markerset.index("LKNE"), axis=0)).max() < 1e-6


def test_what_was_learned_of_markers_is_kept_only_while_they_are_where_they_were(empty):
    markerset = open_markerset("gait15")
    collection = markerset_edit.show_markerset(empty, markerset, "gait15")
    empty.view_layer.update()
    assert markerset_edit.is_unmoved(markerset_edit.read_markerset(collection, markerset, "mine"), markerset)
    item = marker(collection, "LKNE")
    item.matrix_world.translation += type(item.location)((0.017, 0, 0.034))
    empty.view_layer.update()
    assert not markerset_edit.is_unmoved(markerset_edit.read_markerset(collection, markerset, "moved"), markerset)
    bpy.data.objects.remove(item)
    assert not markerset_edit.is_unmoved(markerset_edit.read_markerset(collection, markerset, "fewer"), markerset)


def parented(item, armature, segment):
    """Hangs a marker on a bone with Blender's own operator."""
    armature.data.bones.active = armature.data.bones[segment]
    item.select_set(True)
    armature.select_set(True)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.parent_set(type="BONE", keep_transform=True)


@pytest.mark.parametrize(
    ("attach", "name", "segment"), [(markerset_edit.reattach, "LKNE", "l_shank"), (parented, "LANK", "l_thigh")]
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
    np.testing.assert_allclose(
        found.capsules.end[index] - markerset.capsules.end[index],
        found.capsules.start[index] - markerset.capsules.start[index],
        atol=1e-6,
    )
    assert np.linalg.norm(found.capsules.start[index] - markerset.capsules.start[index]) == pytest.approx(
        0.01, rel=1e-4
    )


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
    assert found.spread.modes.shape[1] == len(found.skeleton) + len(found)
    assert found.spread.marker_sd.shape == (len(found),)


def test_two_markers_of_one_name_and_one_on_no_bone_are_refused(empty, laid_out):
    markerset, collection = laid_out
    extra = marker(collection, "C7").copy()
    collection.objects.link(extra)
    with pytest.raises(InputError, match="two markers are called C7"):
        markerset_edit.read_markerset(collection, markerset, "mine")
    extra[naming.MARKER] = "T10"
    extra.parent = None
    with pytest.raises(InputError, match="T10 hangs on no bone"):
        markerset_edit.read_markerset(collection, markerset, "mine")


def test_a_skeleton_that_lost_a_bone_or_is_gone_is_refused(empty, laid_out):
    markerset, collection = laid_out
    armature = armature_of(collection)
    armature.data.bones["head"].name = "kopf"
    with pytest.raises(InputError, match="no bone head"):
        markerset_edit.read_markerset(collection, markerset, "mine")
    bpy.data.objects.remove(armature)
    with pytest.raises(InputError, match="lost its armature"):
        markerset_edit.read_markerset(collection, markerset, "mine")
