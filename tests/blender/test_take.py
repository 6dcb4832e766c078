# SPDX-License-Identifier: GPL-3.0-or-later
"""A take in a scene: bones and empties reproduce the motion, gaps stay, the file keeps all; and its timeline's rows."""

import json
from dataclasses import astuple, fields, replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector

from addon.core.data.takes import BY_EDIT, NO_MARKER, STEPS, Blobs, LabelledChunk, Motion, Suspect
from addon.io.points import read_points
from addon.scene import naming
from addon.scene import take as takes
from addon.scene.armature import bone_tails, build_of
from addon.scene.opened import Opened
from addon.scene.ownership import curves_of
from tests.inputs.rigs import add_rig

from .hands import GHOST, choose, follows, only, ours, picked, press, refused, reopen, session, shown, stored_take


def test_bones_and_body_reproduce_the_motion(empty, made):
    take = made.take()
    segments, capsules = take.markerset.skeleton.segments, take.markerset.capsules
    collection = takes.show_take(empty, take)
    [armature] = only(collection, "ARMATURE")
    moved = {curve.data_path for curve in curves_of(armature) if curve.data_path.endswith("location")}
    assert moved == {'pose.bones["pelvis"].location'}, "only the root moves against its parent"
    build = build_of(take.markerset, take.motion)
    reach = bone_tails(take.markerset, build) - build.joints
    for index in np.flatnonzero(np.isfinite(take.motion.joints).all(axis=(1, 2))):
        empty.scene.frame_set(int(take.motion.frames[index]))
        turns, joints = take.motion.rotations[index], take.motion.joints[index]
        bones = [armature.pose.bones[name] for name in segments]
        np.testing.assert_allclose([bone.head for bone in bones], joints, atol=1e-5)
        np.testing.assert_allclose(
            [bone.tail for bone in bones], joints + np.einsum("sij,sj->si", turns, reach), atol=1e-5
        )
        for item in only(collection, "MESH"):
            at = segments.index(item[naming.CAPSULE])
            [capsule] = np.flatnonzero(capsules.segment == at)
            for end, where in (("mocap_start", capsules.start), ("mocap_end", capsules.end)):
                world = np.array(item.matrix_world) @ [*item[end], 1]
                np.testing.assert_allclose(world[:3], joints[at] + turns[at] @ (where[capsule] * 1.6), atol=1e-5)


def test_markers_are_keyed_where_they_were_seen_and_nowhere_else_and_the_scene_plays_that(empty, made):
    take, scene = made.take(), empty.scene
    collection = takes.show_take(empty, take)
    assert (scene.frame_start, scene.frame_end) == (101, 120)
    assert scene.render.fps / scene.render.fps_base == pytest.approx(59.94)
    assert scene.camera[naming.CAMERA] == "cam 0"
    empties = only(collection, "EMPTY")
    assert [item[naming.MARKER] for item in empties] == list(take.markerset.markers)
    actions = {item.animation_data.action for item in empties} | {only(collection, "ARMATURE")[0].animation_data.action}
    assert len(actions) == 1
    assert len({item.animation_data.action_slot.handle for item in empties}) == len(empties)
    for index, item in enumerate(empties):
        for axis, curve in enumerate(curves_of(item)):
            keyed = np.array([key.co for key in curve.keyframe_points])
            seen = np.isfinite(take.motion.markers[:, index]).all(axis=1)
            np.testing.assert_array_equal(keyed[:, 0], take.motion.frames[seen])
            np.testing.assert_allclose(keyed[:, 1], take.motion.markers[seen, index, axis], atol=1e-6)
            assert {key.interpolation for key in curve.keyframe_points} == {"LINEAR"}
    assert len(take.motion.frames[np.isnan(take.motion.markers[:, 2, 0])]) > 2


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


def test_the_file_keeps_the_take_and_one_that_was_shown_without_the_extension_is_reviewed_with_it(
    extension, empty, made, tmp_path
):
    take = made.take(lens=-0.1)
    takes.show_take(empty, take)
    assert empty.scene.mocap_autolabel.take is None
    reopen(tmp_path / "take.blend")
    [found] = takes.takes_of(bpy.context.scene)
    settings, stored = bpy.context.scene.mocap_autolabel, stored_take()
    assert (found.name, settings.take) == ("Mocap: walk", found)
    assert (len(settings.source.cameras.objects), settings.source.rate) == (4, pytest.approx(59.94))
    assert len(session().markers) == len(take.markerset)
    assert (stored.name, stored.names, stored.cameras.names) == ("walk", take.markerset.markers, take.cameras.names)
    assert [astuple(one) for one in stored.suspects] == [astuple(one) for one in take.suspects]
    for part, tolerance in (("rows", 1e-4), ("labels", 1e-6), ("motion", 1e-6)):
        for name, kept in vars(getattr(take, part)).items():
            if kept is not None:
                own = getattr(getattr(stored, part), name)
                np.testing.assert_allclose(own, kept, rtol=1e-6, atol=tolerance, err_msg=f"{part}.{name}")


def test_two_takes_share_their_cameras_and_keep_their_markers_names(empty, made):
    first, second = (takes.show_take(empty, made.take(name=name)) for name in ("one", "two"))
    assert first[naming.CAMERAS] == second[naming.CAMERAS]
    assert [item[naming.MARKER] for item in only(second, "EMPTY")] == list(made.markerset().markers)
    assert only(second, "EMPTY")[0].name == "SACR.001"


def test_frames_beyond_blenders_last_are_shifted_to_one(empty, made):
    take = made.take(frames=8)
    far = take.motion.frames + 5_000_000
    take = replace(take, motion=replace(take.motion, frames=far), rows=replace(take.rows, frames=far))
    collection = takes.show_take(empty, take)
    assert (empty.scene.frame_start, empty.scene.frame_end) == (1, 8)
    stored = Opened().take(collection, empty.scene)
    np.testing.assert_array_equal(stored.rows.frames, far)
    assert stored.clock.shown(stored.rows.frames[0]) == 1


def test_chunks_join_to_the_take_they_came_from(made):
    take = made.take()
    cut = int(np.searchsorted(take.rows.frame, 9))
    parts = []
    for rows, first, last in ((slice(0, cut), 0, 9), (slice(cut, None), 9, 20)):
        of_rows = {name: getattr(take.rows, name)[rows] for name in ("camera", "xy", "area")}
        blobs = Blobs(take.rows.frames[first:last], take.rows.frame[rows] - first, **of_rows)
        motion = Motion(*(getattr(take.motion, f.name)[first:last] for f in fields(Motion)))
        reason = (Suspect(108, 109, "lost"),) if first == 0 else (Suspect(110, 111, "lost"), Suspect(115, 116, "lost"))
        parts.append((blobs, LabelledChunk(take.labels[rows], motion, reason)))
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


@pytest.fixture
def rows(extension, labelled):
    """The module of the rows, and what gives those of the active take."""
    module = ours("scene.trajectories")
    module.now = lambda unfolded=False: module.KeptRows().runs(stored_take(), unfolded)
    return module


def stretches(module, runs, name: str) -> list[tuple[int, int, str]]:
    """First frame, last frame and state of the stretches of a row."""
    mine = runs.runs[runs.runs[:, 0] == runs.names.index(name)]
    return [(first, last, module.STATES[state]) for _, first, last, state in mine.tolist()]


def test_rows_are_markers_and_what_has_no_name(rows, files):
    runs = rows.now()
    assert runs.names == (*files.names, f"1 {rows.FOLDED}"), "30 frames are half a second, which is short"
    assert rows.now(unfolded=True).names[-1] == f"trajectory {GHOST}"
    assert runs.span == (101, 130)
    for index, name in enumerate(files.names):
        named = np.concatenate([np.arange(a, b + 1) for a, b, state in stretches(rows, runs, name) if state == "named"])
        assert named.tolist() == (101 + np.flatnonzero(np.isfinite(files.xyz[:, index, 0]))).tolist()
        assert runs.found[index] == len(named)
        covered = np.concatenate([np.arange(a, b + 1) for a, b, _ in stretches(rows, runs, name)])
        assert covered.tolist() == list(range(101, 131)), "every frame of a marker is something"
    assert stretches(rows, runs, runs.names[-1]) == [(101, 130, "unnamed")]


def test_doubts_corrections_and_fills_are_told_apart(rows, labelled, files):
    choose("RASI")
    labelled.scene.mocap_autolabel.filling.method = "rigid"
    labelled.scene.frame_set(112)
    press("fill_gaps", extent="GAP")
    assert (111, 115, "filled") in stretches(rows, rows.now(), "RASI")
    assert rows.now().found[files.names.index("RASI")] == np.isfinite(files.xyz[:, 2, 0]).sum(), "what is measured"
    choose("LKNE", "RKNE")
    labelled.scene.frame_set(120)
    press("swap_markers", scope="ON")
    assert (120, 130, "edited") in stretches(rows, rows.now(), "LKNE")
    take = labelled.scene.mocap_autolabel.take
    take["mocap_suspects"] = '[[110, 115, "LANK jumps", null, ["LANK"]], [121, 122, "odd: LWRA, RWRA", null, []]]'
    ours("scene.opened").opened.forget()
    assert (110, 115, "doubtful") in stretches(rows, rows.now(), "LANK")
    assert all((121, 122, "doubtful") in stretches(rows, rows.now(), name) for name in ("LWRA", "RWRA"))


def test_rows_that_follow_edits_are_those_made_anew(rows, labelled):
    kept, scene = rows.KeptRows(), labelled.scene
    scene.frame_set(120)
    choose("LKNE")
    for operator in ("unlabel", "no_marker", "is_right", "clear_corrections"):
        before = kept.runs(stored_take(), False)
        if operator != "clear_corrections":
            press(operator, scope="ON" if operator == "is_right" else "FRAME")
            scene.frame_set(scene.frame_current + 3)
        else:
            press("clear_corrections")
        stored = stored_take()
        after, anew = kept.runs(stored, False), rows.KeptRows().runs(stored, False)
        assert after is not before and kept.runs(stored, False) is after
        assert (after.names, after.span) == (anew.names, anew.span)
        for one, other in ((after.runs, anew.runs), (after.found, anew.found), (after.trajectory, anew.trajectory)):
            np.testing.assert_array_equal(one, other)


def test_long_trajectories_come_first_and_short_ones_share_a_row(rows, extension, labelled):
    takes, stored = ours("core.data.takes"), stored_take()
    lengths = {50: 80, 51: 5, 52: 100, 53: 30}  # trajectory and its frames, at 60 a second
    frame = np.concatenate([np.arange(length) for length in lengths.values()])
    number = np.repeat(list(lengths), list(lengths.values()))
    order = np.lexsort((number, frame))
    points = takes.PointRows(np.arange(200), frame[order], number[order], np.zeros((len(frame), 3)), None)
    motion = replace(stored.motion, frames=np.arange(200), markers=np.full((200, 18, 3), np.nan))
    take = replace(stored, rows=points, labels=takes.Labels.none(len(frame)), motion=motion, suspects=())
    runs = rows.KeptRows().runs(take, False)
    assert runs.names[18:] == ("trajectory 52", "trajectory 50", f"2 {rows.FOLDED}")
    assert stretches(rows, runs, runs.names[20]) == [(0, 29, "unnamed")]
    assert (runs.marker[18:] == NO_MARKER).all()
    assert rows.KeptRows().runs(take, True).names[20:] == ("trajectory 53", "trajectory 51")
    assert (runs.nearest_frame(18, 150), runs.nearest_frame(18, 7), runs.nearest_frame(0, 150)) == (99, 7, 150)


def test_a_place_is_the_row_that_is_seen_there(extension, empty):
    timeline = ours("ops.timeline")
    places = timeline.RowPlaces(600.0, 1.5, 7.25)
    for row in (8, 12, 20):
        assert places.at(places.upper(row) - 1) == places.at(places.upper(row + 1) + 1) == row
    assert places.at(places.top + 1) == places.at(places.bottom - 1) == -1
    end = timeline.RowPlaces(600.0, 1.5, places.most_scroll(100))
    assert end.upper(100) == pytest.approx(end.bottom)
    assert places.most_scroll(3) == 0
    assert timeline.RowPlaces(90.0, 1.0, 0.0).bottom == 0, "a low editor has room for rows, not for a legend"
    refused("Label a take first", "show_timeline")
    for operator in ("timeline_click", "timeline_scroll", "timeline_pan", "timeline_keys"):
        assert not getattr(bpy.ops.mocap_autolabel, operator).poll(), "without a take keys are Blender's own"


def test_a_click_goes_there_and_picks(labelled):
    scene = labelled.scene
    pick = bpy.ops.mocap_autolabel.timeline_pick
    assert pick(marker="LKNE", first=108, last=108) == {"FINISHED"}
    assert (scene.frame_current, scene.use_preview_range) == (108, False)
    assert labelled.selected_objects == [shown()["LKNE"]] == [labelled.object]
    pick(marker="RKNE", first=110, last=110, extend=True)
    assert set(labelled.selected_objects) == {shown()["LKNE"], shown()["RKNE"]}
    pick(trajectory=GHOST, first=112, last=112)
    assert (labelled.selected_objects, picked()) == ([], [GHOST])
    press("name_point", marker="LKNE", scope="FRAME")


def test_a_drag_selects_the_range_that_corrections_take(labelled, files):
    scene = labelled.scene
    scene.frame_set(101)
    press("timeline_pick", marker="LKNE", first=118, last=123)
    assert (scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end) == (True, 118, 123)
    assert scene.frame_current == 118, "where the marker that is meant is"
    press("timeline_pick", marker="LKNE", first=116, last=125)
    assert scene.frame_current == 118, "it is in the range"
    press("unlabel", scope="RANGE")
    [row] = session().corrections
    assert row.name.endswith("frames 116–125")
    stored = stored_take()
    assert (stored.labels.step != BY_EDIT).all(), "a point without a name has no step"
    assert np.isnan(stored.motion.markers[15:25, files.names.index("LKNE")]).all()
    assert len(stored.motion.frames) == 30


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


def test_all_that_is_shown_or_picked_follows_the_root(moved):
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
    view = SimpleNamespace(view_perspective="PERSP", perspective_matrix=np.eye(4))
    regions = [SimpleNamespace(type="WINDOW", width=100, height=100)]
    area = SimpleNamespace(spaces=SimpleNamespace(active=SimpleNamespace(region_3d=view)), regions=regions)
    dots, places = ours("ops.picking").dots_in_view(bpy.context, stored, area)
    np.testing.assert_allclose(places, (at_root(dots.xyz)[:, :2] + 1) / 2 * 100, atol=1e-3)


@pytest.mark.parametrize("hung", [False, True])
def test_a_root_goes_with_its_take_where_nothing_of_a_person_s_hangs_on_it(moved, hung):
    name, hat = moved.name, add_rig([], {})
    hat.parent = moved if hung else None
    press("clear")
    assert [item.name for item in bpy.data.objects if item.name.endswith(("root", "room"))] == [name] * hung
    assert (hat.parent is not None) is hung
    assert any("Kept" in item.name for item in bpy.data.collections) is hung


def test_labelled_again_a_take_stays_where_its_root_is_and_one_that_was_deleted_is_made_again(moved, files):
    take, root_of = bpy.context.scene.mocap_autolabel.take, ours("scene.roots").root_of
    press("label")
    assert root_of(take) == moved and moved.matrix_world == PLACE
    assert only(take, "ARMATURE")[0].parent.parent == moved
    bpy.data.objects.remove(moved)
    press("label")
    follows(files, "LASI", 1)
    assert len(only(take, "ARMATURE")) == 1 and len(shown()) == len(stored_take().names)
    assert only(take, "ARMATURE")[0].parent.parent == root_of(take)
    assert "kept" not in take.name


def test_keys_are_the_room_s_and_exports_stand_there_or_where_the_root_has_the_take(moved, files, tmp_path, capfd):
    follows(files, "LASI", 1)
    stored = stored_take()
    markers, of = stored.motion.markers, slice(len(stored.names))
    for name, room in (("c3d", True), ("trc", True), ("c3d", False), ("trc", False)):
        path = tmp_path / f"{room}.{name}"
        press(f"export_{name}", filepath=path, room=room)
        points = read_points(path, up="+z")
        seen = np.isfinite(points.xyz[:, of]).all(axis=2)
        assert seen.sum() > 300
        where = markers[seen] if room else at_root(markers[seen])
        np.testing.assert_allclose(points.xyz[:, of][seen], where, atol=1e-4)
        assert ("so they were saved alone" in capfd.readouterr().out) is not room
        if name == "c3d":
            size = 1 if room else 2
            np.testing.assert_allclose(points.residual[:, of][seen], size * stored.motion.residual[seen], atol=1e-4)
    export = SimpleNamespace(place=lambda _: np.array(PLACE), _more_is_left=False)
    ours("ops.exporting").ExportsPoints.given(export, bpy.context, replace(stored, source="/walk.TSV"))
    assert export._more_is_left, "its head"


def mirror(root):
    root.scale.x *= -1


def drive_by_a_cart(root):
    root.parent = add_rig([], {})
    root.parent.keyframe_insert("location", frame=101)


def hold_by_bones(root):
    rig = add_rig([], {})
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
    press("export_trc", filepath=path)
