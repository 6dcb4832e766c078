# SPDX-License-Identifier: GPL-3.0-or-later
"""The tool Label: which dots a hand means, what they are called most likely, and what its keys say of them."""

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
from addon.core.edits.kinds import Delete, Place
from addon.core.geometry.cameras import NO_CAMERAS
from addon.io.edits import read_edits
from addon.io.markersets import open_markerset
from addon.scene import picking
from addon.scene.picking import NEAREST, likely_markers, on_ray, predicted, ranked
from addon.scene.stored import Stored

from .hands import GHOST, choose, follows, keys_of, ours, picked, press, refused, session, stored_take


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


def test_the_nearest_dot_within_reach_is_meant_and_what_is_behind_the_viewer_is_nowhere():
    places = np.array([[10.0, 10.0], [14.0, 10.0], [np.nan, np.nan]])
    assert picking.nearest(places, (13, 10), 5) == 1
    assert picking.nearest(places, (30, 10), 5) is None
    assert picking.nearest(np.empty((0, 2)), (1, 1), 5) is None
    perspective = np.diag([1.0, 1.0, 1.0, 0.0])
    perspective[3, 2] = 1
    places = picking.to_region(np.array([[0, 0, 2.0], [0, 0, -2.0]]), perspective, (200, 100))
    assert places[0].tolist() == [100, 50]
    assert np.isnan(places[1]).all()


@given(st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=1, max_size=30))
def test_a_lasso_around_a_box_holds_what_the_box_does(points):
    places = np.array(points)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
    edge = (np.abs(np.abs(places) - 1) < 1e-9).any(axis=1)
    found = picking.inside_lasso(places, corners)
    np.testing.assert_array_equal(found[~edge], picking.inside_box(places, (1, -1), (-1, 1))[~edge])
    np.testing.assert_array_equal(found[~edge], picking.inside_lasso(places, corners[::-1])[~edge])


@pytest.mark.parametrize(("mode", "after"), [("SET", [3, 1]), ("ADD", [1, 2, 3]), ("TOGGLE", [2, 3])])
def test_shift_adds_and_takes_away(mode, after):
    assert picking.combined([1, 2], [3, 1], mode) == after


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


def test_a_missing_marker_is_expected_where_the_body_has_it(stored):
    stored.motion.markers[:, 4] += 0.03  # worn elsewhere than the marker set has it
    stored.motion.markers[12:18, 4] = np.nan
    np.testing.assert_allclose(predicted(stored, 14)[4], stored.motion.expected[14, 4] + 0.03, atol=1e-9)
    np.testing.assert_allclose(predicted(stored, 14)[2], stored.motion.expected[14, 2], atol=1e-9)
    stored.motion.expected[:] = np.nan
    between = predicted(stored, 14)
    along = stored.motion.markers[11, 4] + 3 / 7 * (stored.motion.markers[18, 4] - stored.motion.markers[11, 4])
    np.testing.assert_allclose(between[4], along, atol=1e-9)
    assert np.isnan(between[2]).all()


def test_the_missing_marker_that_is_nearest_is_the_likeliest(stored):
    rows = np.flatnonzero(stored.rows.trajectory == 2)
    xyz = stored.motion.expected[20, 2]
    assert likely_markers(stored, 20, rows, xyz)[0] == 2
    mate = int(np.linalg.norm(stored.motion.expected[20] - xyz, axis=1).argsort()[1])
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


def test_a_marker_that_was_filled_is_missing_still_and_expected_where_it_was_filled(stored):
    filled = replace(stored.motion, markers=stored.motion.markers.copy())
    filled.markers[:, 2] = [0.1, 0.2, 1.0]
    after = replace(stored, measured=stored.motion, motion=filled)
    assert np.flatnonzero(picking.missing(after, 15)).tolist() == [2]
    np.testing.assert_allclose(predicted(after, 15)[2], [0.1, 0.2, 1.0])


def test_a_place_on_a_ray_is_as_deep_as_what_is_near():
    np.testing.assert_allclose(on_ray(np.zeros(3), np.array([0, 2.0, 0]), np.array([1, 3.0, 0])), [0, 3, 0])
    np.testing.assert_allclose(on_ray(np.zeros(3), np.array([0, 2.0, 0]), np.array([1, -3.0, 0])), [0, 0, 0])


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


def test_what_was_selected_since_counts_more_than_what_was_picked(labelled, files):
    press("pick", point=GHOST)
    choose("LKNE")
    press("unlabel")
    assert len(keys_of("LKNE")) == 0
    [row] = session().corrections
    assert row.name == f"Trajectory {files.names.index('LKNE')} has no name, all frames"


def test_a_dot_stays_picked_by_whatever_it_is_called(labelled, files):
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


def test_what_is_no_marker_gets_no_name(labelled, files):
    ankle = files.names.index("LANK")
    press("pick", point=ankle)
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


def test_this_blender_has_the_icons_of_the_keys_that_are_asked_for(extension):
    icons = bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys()
    assert {"MOUSE_LMB", *ours("ops.label_tool").WIDER} <= set(icons)


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
