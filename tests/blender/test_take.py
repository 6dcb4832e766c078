# SPDX-License-Identifier: GPL-3.0-or-later
"""A take in a scene: bones and empties reproduce the motion, gaps stay unkeyed, and the file keeps it all."""

import json
from dataclasses import fields, replace

import bpy
import numpy as np
import pytest

from addon.core.data.takes import STEPS, Blobs, LabelledChunk, Labels, Motion, Suspect
from addon.scene import animation, naming
from addon.scene import take as takes
from addon.scene.armature import bone_tails, build_of
from addon.scene.opened import Opened

from .hands import only


def test_bones_and_body_reproduce_the_motion(empty, made):
    take = made.take()
    collection = takes.show_take(empty, take)
    armature = only(collection, "ARMATURE")[0]
    build = build_of(take.markerset, take.motion)
    reach = bone_tails(take.markerset, build) - build.joints
    for index, frame in enumerate(take.motion.frames):
        if not np.isfinite(take.motion.joints[index]).all():
            continue
        empty.scene.frame_set(int(frame))
        for segment, name in enumerate(take.markerset.skeleton.segments):
            bone, turn, joint = (
                armature.pose.bones[name],
                take.motion.rotations[index, segment],
                take.motion.joints[index, segment],
            )
            np.testing.assert_allclose(bone.head, joint, atol=1e-5)
            np.testing.assert_allclose(bone.tail, joint + turn @ reach[segment], atol=1e-5)
        for item in only(collection, "MESH"):
            segment = take.markerset.skeleton.segments.index(item[naming.CAPSULE])
            turn, joint = take.motion.rotations[index, segment], take.motion.joints[index, segment]
            capsule = int(np.flatnonzero(take.markerset.capsules.segment == segment)[0])
            for end, where in (
                ("mocap_start", take.markerset.capsules.start),
                ("mocap_end", take.markerset.capsules.end),
            ):
                world = np.array(item.matrix_world) @ [*item[end], 1]
                np.testing.assert_allclose(world[:3], joint + turn @ (where[capsule] * 1.6), atol=1e-5)


def test_only_the_root_moves_against_its_parent(empty, made):
    collection = takes.show_take(empty, made.take())
    action = only(collection, "ARMATURE")[0].animation_data.action
    bag = action.layers[0].strips[0].channelbag(only(collection, "ARMATURE")[0].animation_data.action_slot)
    moved = {curve.data_path for curve in bag.fcurves if curve.data_path.endswith("location")}
    assert moved == {'pose.bones["pelvis"].location'}


def test_markers_are_keyed_where_they_were_seen_and_nowhere_else(empty, made):
    take = made.take()
    collection = takes.show_take(empty, take)
    empties = only(collection, "EMPTY")
    assert [item[naming.MARKER] for item in empties] == list(take.markerset.markers)
    actions = {item.animation_data.action for item in empties} | {only(collection, "ARMATURE")[0].animation_data.action}
    assert len(actions) == 1
    assert len({item.animation_data.action_slot.handle for item in empties}) == len(empties)
    strip = actions.pop().layers[0].strips[0]
    for index, item in enumerate(empties):
        for axis, curve in enumerate(strip.channelbag(item.animation_data.action_slot).fcurves):
            keyed = np.array([key.co for key in curve.keyframe_points])
            seen = np.isfinite(take.motion.markers[:, index]).all(axis=1)
            np.testing.assert_array_equal(keyed[:, 0], take.motion.frames[seen])
            np.testing.assert_allclose(keyed[:, 1], take.motion.markers[seen, index, axis], atol=1e-6)
            assert {key.interpolation for key in curve.keyframe_points} == {"LINEAR"}
    gap = take.motion.frames[np.isnan(take.motion.markers[:, 2, 0])]
    assert len(gap) > 2


def test_the_scene_plays_the_take(empty, made):
    takes.show_take(empty, made.take())
    scene = empty.scene
    assert (scene.frame_start, scene.frame_end) == (101, 120)
    assert scene.render.fps / scene.render.fps_base == pytest.approx(59.94)
    assert scene.camera[naming.CAMERA] == "cam 0"


def test_a_take_of_many_keys_has_several_actions(empty, made, tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "KEYING", animation.KeyOptions(most_keys=600))
    take = made.take()
    collection = takes.show_take(empty, take)
    empties = only(collection, "EMPTY")
    kinds = [{item.animation_data.action.name for item in only(collection, kind)} for kind in ("ARMATURE", "EMPTY")]
    assert kinds[0] == {"Mocap: walk"} and len(kinds[1]) > 1
    assert {action.name for action in bpy.data.actions} == kinds[0] | kinds[1]
    last = int(take.motion.frames[-1])
    empty.scene.frame_set(last)
    for index, item in enumerate(empties):
        if np.isfinite(take.motion.markers[-1, index]).all():
            np.testing.assert_allclose(item.location, take.motion.markers[-1, index], atol=1e-5)
    takes.remove_take(collection)
    assert not len(bpy.data.actions)


def test_a_marker_never_seen_stands_where_it_is_expected_and_nobody_found_is_the_mean_body_at_rest(empty, made):
    take = made.take()
    take.motion.markers[:, 4] = np.nan
    item = only(takes.show_take(empty, take), "EMPTY")[4]
    np.testing.assert_allclose(item.location, take.motion.expected[0, 4], atol=1e-6)
    assert item.animation_data.action_slot is not None
    take = made.take()
    for field in ("markers", "expected", "joints", "rotations", "scale"):
        getattr(take.motion, field)[:] = np.nan
    collection = takes.show_take(empty, take)
    bones = only(collection, "ARMATURE")[0].pose.bones
    np.testing.assert_allclose(bones["pelvis"].head, [0, 0, 0.53 * 1.7], atol=1e-5)
    assert len(only(collection, "EMPTY")) == len(take.markerset)


def test_the_file_keeps_the_take(empty, made, tmp_path):
    take = made.take(lens=-0.1)
    takes.show_take(empty, take)
    path = str(tmp_path / "take.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=path)
    found = takes.takes_of(bpy.context.scene)
    assert [collection.name for collection in found] == ["Mocap: walk"]
    stored = Opened().take(found[0], bpy.context.scene)
    assert (stored.name, stored.names, stored.suspects) == ("walk", take.markerset.markers, take.suspects)
    assert stored.cameras.names == take.cameras.names
    for kind, tolerance in ((Blobs, 1e-4), (Labels, 1e-6), (Motion, 1e-6)):
        part = {Blobs: "rows", Labels: "labels", Motion: "motion"}[kind]
        for field in fields(kind):
            if getattr(getattr(take, part), field.name) is None:
                continue
            left, right = getattr(getattr(stored, part), field.name), getattr(getattr(take, part), field.name)
            np.testing.assert_allclose(left, right, rtol=1e-6, atol=tolerance, err_msg=f"{part}.{field.name}")


def test_two_takes_share_their_cameras_and_keep_their_markers_names(empty, made):
    first, second = (takes.show_take(empty, made.take(name=name)) for name in ("one", "two"))
    assert first[naming.CAMERAS] == second[naming.CAMERAS]
    names = [item[naming.MARKER] for item in only(second, "EMPTY")]
    assert names == list(made.markerset().markers)
    assert only(second, "EMPTY")[0].name == "SACR.001"


def test_frames_beyond_blenders_last_are_shifted_to_one(empty, made):
    take = made.take(frames=8)
    far = take.motion.frames + 5_000_000
    take = replace(take, motion=replace(take.motion, frames=far), rows=replace(take.rows, frames=far))
    collection = takes.show_take(empty, take)
    assert (empty.scene.frame_start, empty.scene.frame_end) == (1, 8)
    stored = Opened().take(collection, empty.scene)
    np.testing.assert_array_equal(stored.rows.frames, far)
    assert stored.rows.frames[0] + stored.shift == 1


def test_chunks_join_to_the_take_they_came_from(made):
    take = made.take()
    cut = int(np.searchsorted(take.rows.frame, 9))
    parts = []
    for rows, first, last in ((slice(0, cut), 0, 9), (slice(cut, None), 9, 20)):
        blobs = Blobs(
            take.rows.frames[first:last],
            take.rows.frame[rows] - first,
            *(getattr(take.rows, name)[rows] for name in ("camera", "xy", "area")),
        )
        labels = take.labels[rows]
        motion = Motion(*(getattr(take.motion, f.name)[first:last] for f in fields(Motion)))
        reason = (Suspect(108, 109, "lost"),) if first == 0 else (Suspect(110, 111, "lost"), Suspect(115, 116, "lost"))
        parts.append((blobs, LabelledChunk(labels, motion, reason)))
    whole = takes.Take.of(take.name, take.rate, take.cameras, take.markerset, parts, take.source)
    np.testing.assert_array_equal(whole.labels.marker, take.labels.marker)
    np.testing.assert_array_equal(whole.motion.markers, take.motion.markers)
    for field in fields(Blobs):
        np.testing.assert_array_equal(getattr(whole.rows, field.name), getattr(take.rows, field.name))
    assert whole.suspects == (Suspect(108, 111, "lost"), Suspect(115, 116, "lost"))


def test_a_file_whose_steps_were_counted_otherwise_is_read_by_their_names(empty, made):
    take = made.take()
    collection = takes.show_take(empty, take)
    others = [STEPS[step] for step in (0, 3, 2, 1)]
    collection["mocap_steps"] = json.dumps(others)
    stored = Opened().take(collection, empty.scene)
    assert [STEPS[step] for step in stored.labels.step] == [others[step] for step in take.labels.step]
