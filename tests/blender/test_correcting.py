# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels of 3D points corrected by buttons and the tool Label: all follows, and what was said is kept."""

import json
from contextlib import ExitStack
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.data.takes import NO_MARKER, NO_STEP, Labels, PointRows
from addon.core.edits.kinds import AssignPoint, Delete, Edits, Place, Right, Swap, UnlabelPoint
from addon.core.geometry.cameras import NO_CAMERAS
from addon.io.edits import read_edits, write_edits
from addon.io.markersets import open_markerset
from addon.io.points import read_points
from addon.scene import picking
from addon.scene.picking import NEAREST, likely_markers, on_ray, predicted, ranked
from addon.scene.stored import Stored

from .conftest import label_walk, labelled_by_job, rows_of_export
from .hands import (
    FRAMES,
    GHOST,
    choose,
    follows,
    keys_of,
    ours,
    out_of_another_file,
    picked,
    press,
    refused,
    session,
    shown,
    stored_take,
    suspects,
)


def test_two_names_are_swapped_everywhere(labelled, files):
    choose("LKNE", "RKNE")
    press("swap_markers", scope="ON")
    one, other = files.names.index("LKNE"), files.names.index("RKNE")
    for name, before, after in (("LKNE", one, other), ("RKNE", other, one)):
        follows(files, name, before, slice(0, 19))
        follows(files, name, after, slice(19, None))
    np.testing.assert_allclose(shown()["LKNE"].matrix_world.translation, files.xyz[19, other], atol=1e-5)
    press("export_trc", filepath=files.folder / "ours.trc")
    take = read_points(files.folder / "ours.trc")
    for frame, point in ((25, other), (5, one)):
        np.testing.assert_allclose(take.xyz[frame, take.names.index("LKNE")], files.xyz[frame, point], atol=1e-5)
    named = {(row[0], row[1]): row for row in rows_of_export(files.folder / "ours.labels.csv")}
    for frame, point in (("125", other), ("115", one)):
        assert "LKNE" in named[frame, str(point)]
        assert ("edit" in named[frame, str(point)]) == (frame == "125")
    [row] = session().corrections
    assert row.name == "LKNE and RKNE swapped, frames 120–130"


@pytest.mark.parametrize("over", [False, True], ids=["linked", "overridden"])
def test_a_take_of_another_file_is_not_changed_here_where_that_would_be_lost(labelled, files, tmp_path, over):
    take, scene = out_of_another_file(tmp_path / "other.blend", "Mocap: walk"), bpy.context.scene
    scene.collection.children.link(take)
    if over:
        take.override_hierarchy_create(scene, bpy.context.view_layer)
        take = next(one for one in scene.collection.children_recursive if one.override_library and "mocap_take" in one)
    scene.mocap_autolabel.take = take
    scene.frame_set(120)
    names = "swap_markers", "fill_gaps", "smooth", "accept_trouble", "mend_trouble", "add_character", "place_marker"
    for name in names:
        refused("linked from another file: change it there, or label it again here", name)
    press("export_c3d", filepath=tmp_path / "own.c3d")
    assert bpy.ops.mocap_autolabel.export_bvh.poll()
    for name in ("timeline_pick", "pick", "pick_none", "save_corrections"):
        assert getattr(bpy.ops.mocap_autolabel, name).poll(), name
    label_walk(files.folder)
    assert scene.mocap_autolabel.take.library is scene.mocap_autolabel.take.override_library is None
    choose("LKNE", "RKNE")
    press("swap_markers")


@pytest.mark.parametrize("scope", ["FRAME", "RANGE", "WHOLE"])
def test_markers_in_actions_of_their_own_follow_too(extension, monkeypatch, request, files, scope):
    animation = ours("scene.animation")
    monkeypatch.setattr(animation, "KEYS_AN_ACTION", 100)
    monkeypatch.setattr(animation, "MOST_SINGLE", 4)
    labelled = request.getfixturevalue("labelled")
    names = {item.animation_data.action.name for item in shown().values()}
    assert len(names) == GHOST and "Mocap: walk" not in names, "the armature has that"
    assert names | {"Mocap: walk"} == {action.name for action in bpy.data.actions}
    scene = labelled.scene
    scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end = True, 110, 115
    scene.frame_set(112)
    frames = {"FRAME": slice(11, 12), "RANGE": slice(9, 15), "WHOLE": slice(None)}[scope]
    one, other = files.names.index("LKNE"), files.names.index("RKNE")
    choose("LKNE", "RKNE")
    press("swap_markers", scope=scope)
    follows(files, "LKNE", other, frames)
    follows(files, "RKNE", one, frames)
    choose("LKNE")
    press("unlabel", scope=scope)
    assert not np.isin(keys_of("LKNE")[:, 0], 101 + np.arange(FRAMES)[frames]).any()
    press("clear_corrections")
    follows(files, "LKNE", one)
    follows(files, "RKNE", other)
    press("clear")
    assert not len(bpy.data.actions)


def test_a_name_is_taken_away_and_given_to_what_was_picked(labelled, files):
    knee = files.names.index("LKNE")
    choose("LKNE")
    press("unlabel", scope="WHOLE")
    assert len(keys_of("LKNE")) == 0
    assert shown()["LKNE"].hide_viewport
    cloud = next(item for item in labelled.scene.mocap_autolabel.take.objects if item.modifiers)
    assert len(cloud.data.vertices) == FRAMES + int(np.isfinite(files.xyz[:, knee, 0]).sum())
    press("pick", point=GHOST)
    assert (picked(), bpy.context.selected_objects) == ([GHOST], [])
    press("name_point", marker="LKNE", scope="BACK")
    follows(files, "LKNE", GHOST, slice(0, 20))
    assert keys_of("LKNE")[-1, 0] == 120
    assert not shown()["LKNE"].hide_viewport
    assert sum("LKNE" in row and "edit" in row for row in rows_of_export(files.folder / "ours.labels.csv")) == 20


@pytest.mark.parametrize(
    ("scope", "frames"),
    [("FRAME", (120, 120)), ("ON", (120, 130)), ("BACK", (101, 120)), ("WHOLE", None), ("RANGE", (118, 123))],
)
def test_a_scope_is_a_range_of_frames(labelled, files, scope, frames):
    scene = labelled.scene
    scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end = True, 118, 123
    choose("LWRA")
    press("name_point", marker="RWRA", scope=scope)
    press("save_corrections")
    assert read_edits(files.edits).items == (AssignPoint(files.names.index("LWRA"), "RWRA", frames=frames),)


def test_what_is_right_is_no_longer_asked(extension, labelled):
    take = labelled.scene.mocap_autolabel.take
    take["mocap_suspects"] = json.dumps(
        [[110, 115, "LKNE jumps", None, ["LKNE"]], [112, 113, "may be LKNE", GHOST, []], [120, 121, "of old", None, []]]
    )
    ours("scene.opened").opened.forget()
    choose("LKNE")
    labelled.scene.frame_set(112)
    press("is_right", scope="ON")
    state = session()
    assert suspects() == [(110, 111, "LKNE jumps"), (112, 113, f"trajectory {GHOST} may be LKNE"), (120, 121, "of old")]
    press("pick", point=GHOST)
    press("name_point", marker="LKNE", scope="WHOLE")
    assert not any("may be LKNE" in reason for *_, reason in suspects())
    press("clear_corrections")
    assert (len(suspects()), len(state.corrections)) == (3, 0)


def test_each_is_one_undo_step_and_can_be_removed(labelled, files):
    knee, wrist = files.names.index("LKNE"), files.names.index("LWRA")
    bpy.ops.ed.undo_push(message="Before")
    choose("LKNE")
    press("unlabel", scope="WHOLE")
    bpy.ops.ed.undo_push(message="Unlabel")
    choose("LWRA", "RWRA")
    press("swap_markers", scope="WHOLE")
    bpy.ops.ed.undo_push(message="Swap")
    words = [f"Trajectory {knee} has no name, all frames", "LWRA and RWRA swapped, all frames"]
    assert [row.name for row in session().corrections] == words
    bpy.ops.ed.undo()
    follows(files, "LWRA", wrist)
    assert len(session().corrections) == 1
    assert not any("LKNE" in row for row in rows_of_export(files.folder / "undone.labels.csv"))
    bpy.ops.ed.redo()
    follows(files, "LWRA", files.names.index("RWRA"))
    press("remove_correction", index=0)
    follows(files, "LKNE", knee)
    follows(files, "LWRA", files.names.index("RWRA"))
    assert len(session().corrections) == 1


def test_labelling_again_keeps_them_and_is_what_the_command_line_makes(labelled, files, extension, tmp_path):
    choose("LKNE", "RKNE")
    press("swap_markers", scope="WHOLE")
    press("pick", point=GHOST)
    press("name_point", marker="LANK", scope="FRAME")
    press("save_corrections")
    press("label")
    assert len(session().corrections) == 2
    out = labelled_by_job(files, tmp_path / "out")
    rows_of_export(tmp_path / "ours.labels.csv")
    assert (tmp_path / "ours.labels.csv").read_text() == (out / "walk.labels.csv").read_text()
    press("export_c3d", filepath=tmp_path / "ours.c3d")
    theirs, ours = read_points(out / "walk.c3d"), read_points(tmp_path / "ours.c3d")
    assert ours.names == theirs.names
    np.testing.assert_allclose(ours.xyz, theirs.xyz, atol=1e-6)
    press("clear_corrections")
    follows(files, "LKNE", files.names.index("LKNE"))
    press("label")
    assert len(session().corrections) == 0, "the file beside was taken back here"


def test_what_lies_beside_the_take_is_taken_up(labelled, files):
    edits = Edits((Swap(("LKNE", "RKNE")), UnlabelPoint(GHOST), Right("C7", frames=(103, 104))))
    write_edits(files.edits, edits)
    press("import_points", filepath=files.take)
    press("label")
    follows(files, "LKNE", files.names.index("RKNE"))
    rows = session().corrections
    assert [bool(row.idle) for row in rows] == [False, True, False]
    press("remove_correction", index=0)
    follows(files, "LKNE", files.names.index("LKNE"))
    press("save_corrections")
    assert read_edits(files.edits) == edits.without(0)


def test_what_cannot_be_done_is_one_sentence_and_changes_nothing(labelled, files):
    scene, collection = labelled.scene, labelled.scene.mocap_autolabel.take
    choose()
    refused("nothing is selected; expected", "unlabel")
    refused("the selection has 0 markers; expected", "swap_markers")
    refused("no marker is selected; expected", "is_right")
    refused("trajectory 99 has no point in frame 120; expected", "pick", point=99)
    refused("Nothing was corrected", "clear_corrections")
    choose("LKNE")
    refused("the selection has 1 marker; expected the two", "swap_markers")
    refused("no range is selected; expected", "unlabel", scope="RANGE")
    gap = int(np.flatnonzero(np.isnan(files.xyz[:, 2, 0]))[-1])
    choose(files.names[2])
    scene.frame_set(101 + gap)
    refused("RASI is not named in frame", "unlabel")
    scene.frame_set(500)
    refused("the current frame is 500; expected one of the take, 101 to 130", "unlabel")
    scene.frame_set(120)
    press("pick", point=GHOST)
    refused(f"trajectory {GHOST} has no name in the take; expected", "unlabel")
    assert "mocap_edits" not in collection
    for name in ("c3d", "trc", "labels", "bvh"):
        refused("no file was named; expected the one to write", f"export_{name}")
    scene.mocap_autolabel.take = None
    refused("Label a take first", "unlabel")


def test_what_was_listed_or_picked_in_another_scene_is_not_changed_in_this_one(labelled, files):
    """As in two windows that show a scene each: the lists and what is picked are of the one that was used last."""
    assert bpy.context.scene.name == "Scene"
    choose("LKNE", "RKNE")
    press("swap_markers")
    bpy.ops.scene.new(type="NEW")
    label_walk(files.folder)
    state = session()
    refused("Nothing was corrected", "remove_correction")
    bpy.context.window.scene = bpy.data.scenes["Scene"]
    assert bpy.ops.mocap_autolabel.remove_correction.poll() and not len(state.corrections)
    bpy.context.window.scene = bpy.data.scenes["Scene.001"]
    choose("LANK", "RANK")
    press("swap_markers")
    state.left_gaps.add()
    bpy.context.scene.frame_set(120)
    press("pick", point=GHOST)
    bpy.context.window.scene = bpy.data.scenes["Scene"]
    choose()
    refused("nothing is selected", "name_point", marker="LKNE")
    asking, clear = MagicMock(), ours("ops.correcting").MOCAP_AUTOLABEL_OT_clear_corrections
    assert clear.invoke(asking, bpy.context, None) == {"CANCELLED"}
    assert "another scene's" in asking.report.call_args.args[1]
    for name, which in (("clear_corrections", {}), ("remove_correction", {"index": 0})):
        state.of_scene = 0
        refused("another scene's; expected a choice in this one's", name, **which)
    assert len(stored_take().edits) == 1 and not len(state.left_gaps)
    press("remove_correction", index=0)
    assert not len(stored_take().edits)


@pytest.fixture
def stored(made):
    """A take of points, a trajectory a marker; that of the third has no name."""
    markerset, motion = made.markerset(), made.motion(made.markerset(), 30)
    frame, trajectory = np.nonzero(np.isfinite(motion.markers[..., 0]))
    rows = PointRows(motion.frames, frame, trajectory, motion.markers[frame, trajectory], None)
    marker = np.where(trajectory == 2, NO_MARKER, trajectory)
    labels = Labels(marker, np.full(len(frame), NO_STEP), np.ones(len(frame)))
    motion.markers[:, 2] = np.nan
    return Stored("walk", 60.0, NO_CAMERAS, markerset.markers, rows, labels, motion, (), "", 0)


def test_the_nearest_dot_within_reach_is_meant_what_is_behind_is_nowhere_and_a_ray_ends_where_dots_are():
    places = np.array([[10.0, 10.0], [14.0, 10.0], [np.nan, np.nan]])
    assert picking.nearest(places, (13, 10), 5) == 1
    assert picking.nearest(places, (30, 10), 5) is None
    assert picking.nearest(np.empty((0, 2)), (1, 1), 5) is None
    perspective = np.diag([1.0, 1.0, 1.0, 0.0])
    perspective[3, 2] = 1
    places = picking.to_region(np.array([[0, 0, 2.0], [0, 0, -2.0]]), perspective, (200, 100))
    assert places[0].tolist() == [100, 50]
    assert np.isnan(places[1]).all()
    for ahead, there in ((3.0, [0, 3, 0]), (-3.0, [0, 0, 0])):
        np.testing.assert_allclose(on_ray(np.zeros(3), np.array([0, 2.0, 0]), np.array([1, ahead, 0])), there)
    for mode, after in (("SET", [3, 1]), ("ADD", [1, 2, 3]), ("TOGGLE", [2, 3])):
        assert picking.combined([1, 2], [3, 1], mode) == after, "Shift adds and takes away"


@given(st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=1, max_size=30))
def test_a_lasso_around_a_box_holds_what_the_box_does(points):
    places = np.array(points)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
    edge = (np.abs(np.abs(places) - 1) < 1e-9).any(axis=1)
    found = picking.inside_lasso(places, corners)
    np.testing.assert_array_equal(found[~edge], picking.inside_box(places, (1, -1), (-1, 1))[~edge])
    np.testing.assert_array_equal(found[~edge], picking.inside_lasso(places, corners[::-1])[~edge])


def test_a_path_breaks_where_the_trajectory_does(stored):
    rows = np.flatnonzero(stored.rows.trajectory == 2)
    ends, named = picking.path_of(stored, rows, 15, 100, 1000)
    frames = stored.rows.frame[rows]
    assert len(ends) == (np.diff(frames) == 1).sum() < len(rows) - 1
    assert not named.any()
    ends, _ = picking.path_of(stored, rows, 15, 100, 5)
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    assert len(ends) <= 6
    assert np.isfinite(lengths).all()
    assert len(picking.path_of(stored, rows, 15, 2, 1000)[0]) <= 4


def test_a_missing_marker_is_expected_where_the_body_has_it_or_it_was_filled(stored):
    stored.motion.markers[:, 4] += 0.03  # worn elsewhere than the marker set has it
    stored.motion.markers[12:18, 4] = np.nan
    np.testing.assert_allclose(predicted(stored, 14)[4], stored.motion.expected[14, 4] + 0.03, atol=1e-9)
    np.testing.assert_allclose(predicted(stored, 14)[2], stored.motion.expected[14, 2], atol=1e-9)
    filled = replace(stored.motion, markers=stored.motion.markers.copy())
    filled.markers[:, 2] = [0.1, 0.2, 1.0]
    after = replace(stored, measured=stored.motion, motion=filled)
    assert np.flatnonzero(picking.missing(after, 14)).tolist() == [2, 4], "though the one is filled"
    np.testing.assert_allclose(predicted(after, 14)[2], [0.1, 0.2, 1.0])
    stored.motion.expected[:] = np.nan
    between = predicted(stored, 14)
    along = stored.motion.markers[11, 4] + 3 / 7 * (stored.motion.markers[18, 4] - stored.motion.markers[11, 4])
    np.testing.assert_allclose(between[4], along, atol=1e-9)
    assert np.isnan(between[2]).all()


def test_the_missing_marker_that_is_nearest_is_the_likeliest(stored):
    rows = np.flatnonzero(stored.rows.trajectory == 2)
    xyz = stored.motion.expected[20, 2]
    assert likely_markers(stored, 20, rows, xyz)[0] == 2
    nearest = np.linalg.norm(stored.motion.expected[20] - xyz, axis=1).argsort()
    mate = next(int(one) for one in nearest[1:] if stored.names[one][0] != "L")  # not on the other side
    near = likely_markers(stored, 20, rows, stored.motion.expected[20, mate])
    assert near[:2] == [2, mate], "a dot that has a name comes behind what is missing"
    assert sorted(near) == list(range(len(stored.names)))


def test_a_right_hand_is_offered_what_is_around_it_and_missing_first_and_no_left_thigh():
    markerset = open_markerset("body39")
    names, at = markerset.markers, markerset.rest_markers
    off = np.linalg.norm(at - at[markerset.by_name["RFIN"]], axis=1)
    free, nowhere = np.isin(names, ["LTHI", "RWRB"]), np.full(len(names), -1)
    offered = [names[marker] for marker in ranked(off, free, np.array([NO_MARKER]), names, nowhere)]
    assert offered[:2] == ["RWRB", "RFIN"]
    assert not [name for name in offered[: NEAREST + 2] if name.startswith("L")]
    assert sorted(offered) == sorted(names)
    known = np.array([NO_MARKER, names.index("LTHI")])
    before = [names[marker] for marker in ranked(off, free, known, names, nowhere)]
    assert before[0] == "LTHI", "the same trajectory is that in other frames"


def test_what_is_missing_on_the_limb_is_offered_though_much_is_nearer(shown):
    stored = stored_take()
    own = dict(zip(stored.names, picking.limbs(stored, 5).tolist(), strict=True))
    legs = [{own[side + name] for name in ("KNE", "ANK", "HEE", "TOE")} for side in "LR"]
    arms = [{own[side + name] for name in ("ELB", "WRA", "WRB", "FIN")} for side in "LR"]
    assert all(len(limb) == 1 for limb in (*legs, *arms))
    assert len(set.union(*legs, *arms)) == 4, "each is a limb of its own"
    names, at = stored.names, stored.motion.expected[5]
    off = np.linalg.norm(at - at[names.index("RELB")], axis=1)
    free = np.isin(names, ["RFIN", "RTOE"])
    off[names.index("RFIN")] = 1.0  # m: a body that has the hand elsewhere
    assert names.index("RFIN") not in np.argsort(off)[:NEAREST]
    offered = [names[one] for one in ranked(off, free, np.array([NO_MARKER]), names, picking.limbs(stored, 5))]
    assert offered[0] == "RFIN"
    assert "RTOE" not in offered[:NEAREST], "it is missing elsewhere"


def test_pieces_are_added_and_joined_but_not_two_of_one_frame(labelled, files):
    knee, ankle = files.names.index("LKNE"), files.names.index("LANK")
    press("pick", point=knee)
    press("pick", point=ankle, mode="TOGGLE")
    assert picked() == [knee, ankle]
    assert {item.name for item in bpy.context.selected_objects} == {"LKNE", "LANK"}
    several = "2 points are picked, several of them in frame 101; expected one, or pieces"
    refused(several, "name_point", marker="LKNE")
    press("pick", point=knee, mode="TOGGLE")
    assert picked() == [ankle]
    press("pick_none")
    assert (picked(), bpy.context.selected_objects) == ([], [])
    press("pick", point=GHOST)
    choose("LKNE")
    press("unlabel")
    assert len(keys_of("LKNE")) == 0, "what was selected since counts more than what was picked"
    [row] = session().corrections
    assert row.name == f"Trajectory {knee} has no name, all frames"


def test_a_dot_stays_picked_by_whatever_it_is_called_and_no_marker_gets_no_name(labelled, files):
    ankle = files.names.index("LANK")
    press("pick", point=ankle)
    bpy.ops.ed.undo_push(message="Before")
    press("name_point", marker="RANK", scope="WHOLE")
    assert [item.name for item in bpy.context.selected_objects] == ["RANK"]
    bpy.ops.ed.undo_push(message="Name")
    bpy.ops.ed.undo()
    assert [item.name for item in bpy.context.selected_objects] == ["LANK"]
    assert picked() == [ankle]
    follows(files, "LANK", ankle)
    press("no_marker", scope="ON")
    follows(files, "LANK", ankle, slice(0, 19))
    assert keys_of("LANK")[-1, 0] == 119
    press("save_corrections")
    assert read_edits(files.edits).items == (Delete(ankle, frames=(120, 130)),)


def test_a_marker_that_is_placed_is_there_and_can_be_taken_back(labelled, files):
    gap = int(np.flatnonzero(np.isnan(files.xyz[:, 2, 0]))[-1])
    labelled.scene.frame_set(101 + gap)
    press("place_marker", marker="RASI", location=(0.1, 0.2, 0.5))
    assert [item.name for item in bpy.context.selected_objects] == ["RASI"]
    [key] = [key for key in keys_of("RASI") if key[0] == 101 + gap]
    np.testing.assert_allclose(key[1:], (0.1, 0.2, 0.5), atol=1e-6)
    press("save_corrections")
    [edit] = read_edits(files.edits).items
    assert (type(edit), edit.marker, edit.frame) == (Place, "RASI", 101 + gap)
    press("remove_correction", index=0)
    assert 101 + gap not in keys_of("RASI")[:, 0]


def test_every_key_of_the_tool_does_something_of_ours_and_is_free_in_blender_but_the_one_that_deletes(extension):
    tool = ours("ui.label_tool")
    for operator, _, more in tool.KEYMAP:
        module, name = operator.split(".")
        known = getattr(getattr(bpy.ops, module), name).get_rna_type().properties
        given = dict((more or {}).get("properties", ()))
        assert set(given) <= set(known.keys())
        assert module == "mocap_autolabel" or hasattr(bpy.types, given["name"])
    alone = [event["type"] for _, event, _ in tool.KEYMAP if set(event) == {"type", "value"}]
    assert not ({key for key in alone if len(key) == 1} - {"X"}) & set("ABCDGHIKMNOQRSTWZ"), "object mode has these"
    icons = bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys()
    assert {"MOUSE_LMB", *ours("ops.label_tool").WIDER} <= set(icons)


def test_the_status_bar_says_the_keys_that_a_person_has_given_the_tool(labelled):
    tool = ours("ui.label_tool")
    items = [
        SimpleNamespace(
            active=event["type"] != "P", idname=name, id=-at, type=event["type"],
            properties=SimpleNamespace(**dict((more or {}).get("properties", ()))),
        )
        for at, (name, event, more) in enumerate(tool.KEYMAP[::-1])
    ]  # fmt: skip
    next(item for item in items if item.type == "U").type = "K"
    keymaps = {tool.OF_TOOL: SimpleNamespace(keymap_items=items)}
    context = MagicMock(scene=labelled.scene)
    context.window_manager.keyconfigs.user.keymaps = keymaps
    context.workspace.tools.from_space_view3d_mode.return_value.idname = tool.TOOL
    header = MagicMock()
    tool.draw_keys(header, context)
    said = header.layout.row.return_value.template_event_from_keymap_item.call_args_list
    keys = {call.kwargs["text"]: call.args[0].type for call in said}
    assert list(keys) == [words for _, _, words in tool.SHOWN_KEYS if words != "It Is Here"], "that has no key now"
    assert (keys["Unlabel"], keys["No Marker"]) == ("K", "X")
    context.workspace.tools.from_space_view3d_mode.return_value.idname = "builtin.select"
    tool.draw_keys(other := MagicMock(), context)
    assert not other.layout.mock_calls


def test_the_keys_come_back_after_a_text_that_was_in_the_status_bar_when_they_were_added(extension):
    tool, header, workspace = ours("ui.label_tool"), bpy.types.STATUSBAR_HT_header, bpy.context.workspace
    with ExitStack() as stack:
        tool.status_bar().remove(tool.draw_keys)
        workspace.status_text_set(lambda *_: None)
        tool.add_keys(stack)
        workspace.status_text_set(lambda *_: None)
        workspace.status_text_set(None)
        assert tool.draw_keys in header.draw._draw_funcs
        workspace.status_text_set(lambda *_: None)
    workspace.status_text_set(None)
    assert tool.draw_keys not in header.draw._draw_funcs
    header.prepend(tool.draw_keys)
