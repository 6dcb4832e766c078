# SPDX-License-Identifier: GPL-3.0-or-later
"""The trajectory timeline: what its rows are, where they lie, what a click or drag does; drawn in windows only."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon.core.data.takes import BY_EDIT, NO_MARKER

from .hands import FRAMES, GHOST, choose, ours, picked, refused, shown, stored_take


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
    bpy.ops.mocap_autolabel.fill_gaps(extent="GAP")
    assert (111, 115, "filled") in stretches(rows, rows.now(), "RASI")
    assert rows.now().found[files.names.index("RASI")] == np.isfinite(files.xyz[:, 2, 0]).sum(), "what is measured"
    choose("LKNE", "RKNE")
    labelled.scene.frame_set(120)
    bpy.ops.mocap_autolabel.swap_markers(scope="ON")
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
            getattr(bpy.ops.mocap_autolabel, operator)(scope="ON" if operator == "is_right" else "FRAME")
            scene.frame_set(scene.frame_current + 3)
        else:
            bpy.ops.mocap_autolabel.clear_corrections()
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
    motion = replace(stored.motion, frames=np.arange(200), markers=np.full((200, 13, 3), np.nan))
    take = replace(stored, rows=points, labels=takes.Labels.none(len(frame)), motion=motion, suspects=(), shift=0)
    runs = rows.KeptRows().runs(take, False)
    assert runs.names[13:] == ("trajectory 52", "trajectory 50", f"2 {rows.FOLDED}")
    assert stretches(rows, runs, runs.names[15]) == [(0, 29, "unnamed")]
    assert (runs.marker[13:] == NO_MARKER).all()
    assert rows.KeptRows().runs(take, True).names[15:] == ("trajectory 53", "trajectory 51")
    assert (runs.nearest_frame(13, 150), runs.nearest_frame(13, 7), runs.nearest_frame(0, 150)) == (99, 7, 150)


def test_a_place_is_the_row_that_is_seen_there(extension, empty):
    timeline = ours("ops.timeline")
    places = timeline.RowPlaces(600.0, 1.5, 7.25)
    for row in (8, 12, 20):
        assert places.at(places.upper(row) - 1) == places.at(places.upper(row + 1) + 1) == row
    assert places.at(places.top + 1) == places.at(places.bottom - 1) == -1
    most = places.most_scroll(100)
    end = timeline.RowPlaces(600.0, 1.5, most)
    assert end.upper(100) == pytest.approx(end.bottom)
    assert places.most_scroll(3) == 0
    assert timeline.RowPlaces(90.0, 1.0, 0.0).bottom == 0, "a low editor has room for rows, not for a legend"


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
    assert bpy.ops.mocap_autolabel.name_point(marker="LKNE", scope="FRAME") == {"FINISHED"}


def test_a_drag_selects_the_range_that_corrections_take(labelled, files):
    scene = labelled.scene
    scene.frame_set(101)
    bpy.ops.mocap_autolabel.timeline_pick(marker="LKNE", first=118, last=123)
    assert (scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end) == (True, 118, 123)
    assert scene.frame_current == 118, "where the marker that is meant is"
    bpy.ops.mocap_autolabel.timeline_pick(marker="LKNE", first=116, last=125)
    assert scene.frame_current == 118, "it is in the range"
    assert bpy.ops.mocap_autolabel.unlabel(scope="RANGE") == {"FINISHED"}
    [row] = labelled.window_manager.mocap_autolabel.corrections
    assert row.name.endswith("frames 116–125")
    stored = stored_take()
    assert (stored.labels.step != BY_EDIT).all(), "a point without a name has no step"
    assert np.isnan(stored.motion.markers[15:25, files.names.index("LKNE")]).all()
    assert len(stored.motion.frames) == FRAMES


def test_it_is_offered_with_a_take_only(extension, empty):
    refused("Label a take first", "show_timeline")
    for operator in ("timeline_click", "timeline_scroll", "timeline_pan", "timeline_keys"):
        assert not getattr(bpy.ops.mocap_autolabel, operator).poll(), "elsewhere keys are Blender's own"
