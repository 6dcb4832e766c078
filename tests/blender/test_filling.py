# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaps filled and markers smoothed in the scene: marked, exported, told, taken back, kept through all that happens."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core.filling.smoothing import smoothed
from addon.io.points import read_points
from addon.scene.take import show_take
from tests.io.pages import read

from .hands import (
    FRAMES,
    GHOST,
    choose,
    follows,
    keys_of,
    labelled_by_job,
    ours,
    press,
    refused,
    reopen,
    session,
    shown,
    stored_take,
)

GAP = slice(FRAMES // 3, FRAMES // 2)  # of RASI, and all are lost in two frames before
HERE = 101 + GAP.start + 2


def kinds_of(name: str) -> dict[int, str]:
    """The type of the keys of a marker, by frame."""
    data = shown()[name].animation_data
    bag = data.action.layers[0].strips[0].channelbag(data.action_slot)
    return {int(key.co[0]): key.type for key in bag.fcurves.find("location", index=1).keyframe_points}


def rows() -> list[tuple]:
    """The list of fills in the sidebar."""
    return [(row.name, row.first, row.last, row.reason) for row in session().fills]


@pytest.fixture
def filled(labelled):
    """The take with the gap of RASI filled."""
    labelled.scene.mocap_autolabel.filling.method = "rigid"
    choose("RASI")
    labelled.scene.frame_set(HERE)
    press("fill_gaps", extent="GAP")
    return labelled


def test_a_gap_is_filled_and_its_keys_are_marked(filled, files):
    assert rows() == [("RASI", 101 + GAP.start, 100 + GAP.stop, "")]
    kinds = kinds_of("RASI")
    assert {frame for frame, kind in kinds.items() if kind == "GENERATED"} == {101 + f for f in range(30)[GAP]}
    assert set(kinds.values()) == {"GENERATED", "KEYFRAME"}
    keys = keys_of("RASI")
    assert np.linalg.norm(np.diff(keys[:, 1:], axis=0), axis=1).max() < 0.2, "it goes where the markers beside it go"
    row = next(row for row in session().markers if row.name == "RASI")
    assert row.labelled == pytest.approx(np.isfinite(files.xyz[:, 2, 0]).mean()), "what is filled was not found"


def test_a_fill_is_looked_at_before_it_is_kept(labelled, files):
    state, number = session(), files.names.index("RASI")
    labelled.scene.mocap_autolabel.filling.method = "spline"
    refused("No fill is previewed", "keep_fills")
    before = keys_of("RASI")
    press("fill_gaps", extent="TAKE", propose=True)
    asked = [(row.name, row.first, row.last) for row in state.proposed_fills]
    assert ("RASI", 101 + GAP.start, 100 + GAP.stop) in asked
    assert (rows(), len(keys_of("RASI"))) == ([], len(before)), "nothing is filled yet"
    gaps = ours("ui.graph").gaps_of(stored_take(), "RASI")
    assert sum(last - first + 1 for first, last in gaps) == np.isnan(files.xyz[:, number, 0]).sum()
    assert [101 + GAP.start, 100 + GAP.stop] in gaps.tolist()
    at = asked.index(("RASI", 101 + GAP.start, 100 + GAP.stop))
    press("keep_fills", index=at)
    assert [row[:3] for row in rows()] == [asked[at]]
    assert [(row.name, row.first, row.last) for row in state.proposed_fills] == [*asked[:at], *asked[at + 1 :]]
    press("discard_fills")
    assert (len(state.proposed_fills), len(rows())) == (0, 1)


def test_a_preview_is_there_again_once_keeping_it_is_undone_and_beside_another_take(labelled, files):
    def listed() -> list[int]:
        state = session()
        return [len(state.proposed_fills), len(state.fills)]

    press("fill_gaps", extent="TAKE", propose=True)
    bpy.ops.ed.undo_push(message="Previewed")
    count, _ = listed()
    press("keep_fills")
    bpy.ops.ed.undo_push(message="Kept")
    assert listed() == [0, count]
    bpy.ops.ed.undo()
    assert listed() == [count, 0]
    take = bpy.context.scene.mocap_autolabel.take
    press("import_points", filepath=files.folder / "walk.c3d")
    press("import_points", filepath=files.folder / "walk.c3d")
    bpy.context.scene.mocap_autolabel.take = take
    bpy.context.scene.frame_set(HERE)
    ours("props").refresh_review(bpy.context.window_manager, bpy.context.scene)
    assert listed() == [count, 0]
    press("keep_fills")
    press("take_back_fills", extent="TAKE")
    assert listed() == [0, 0]


def test_what_is_filled_is_not_previewed_any_more(labelled):
    state = session()
    choose("RASI")
    for propose, extent in ((True, "TAKE"), (False, "MARKER")):
        before = len(state.proposed_fills)
        press("fill_gaps", extent=extent, propose=propose)
    assert len(state.proposed_fills) == before - len(rows()) > 0
    assert "RASI" not in {row.name for row in state.proposed_fills}


def test_a_dashed_line_lies_on_the_line_and_ends_where_it_does(extension):
    line = np.array([[0.0, 0.0], [10.0, 20.0], [25.0, 20.0]])
    found = ours("ui.graph").dashed(line, 6.0, 4.0, 30.0)
    np.testing.assert_allclose(found[:, :, 0], [[0, 6], [10, 16], [20, 25]])
    np.testing.assert_allclose(found[:, :, 1], [[0, 12], [20, 20], [20, 20]])
    np.testing.assert_allclose(ours("ui.graph").dashed(line - [11, 0], 6.0, 4.0, 8.0), found[1:2] - [11, 0])
    band = ours("ui.graph").around(np.stack([line[:-1], line[1:]], axis=1), 3.0)
    assert band[0].tolist() == [[0, -3], [10, 17], [10, 23], [0, 3]]


@pytest.mark.parametrize(("left", "scale", "step"), [(105, 5.0, 1), (101, 0.4, 2)])
def test_curves_are_of_what_is_seen(labelled, files, monkeypatch, left, scale, step):
    graph, drawn, stored = ours("ui.graph"), [], stored_take()
    monkeypatch.setattr(graph, "lines", lambda pixels, ends, *_: drawn.append(ends))
    ours("ops.picking").show_picked(bpy.context, stored, [GHOST], [stored.names.index("LASI")])
    places = graph.GraphPlaces(np.array([-left * scale, 0.0]), np.full(2, scale))
    graph.draw_curves(bpy.context, SimpleNamespace(size=(12, 10)), places, stored)
    assert len(drawn) == 6
    for ends, name in ((drawn[0], "LASI"), (drawn[3], "")):
        assert len(ends) and (np.diff(ends[:, :, 0], axis=1) == pytest.approx(step * scale))
        at = np.round(ends[..., 0] / scale).astype(int) + left - 101
        column = stored.motion.markers[:, stored.names.index(name), 0] if name else files.xyz[:, GHOST, 0]
        np.testing.assert_allclose(ends[..., 1] / scale, column[at], atol=1e-5)


def test_exports_tell_what_is_filled_and_what_was_measured(filled, files):
    column = files.names.index("RASI")
    press("export_c3d", filepath=files.folder / "ours.c3d")
    take = read_points(files.folder / "ours.c3d")
    residual = take.residual[:, take.names.index("RASI")]
    measured = np.isfinite(files.xyz[:, column, 0])
    assert (residual[GAP] == 0).all()
    assert (residual[measured] > 0).all()
    lost = ~measured
    lost[GAP] = False
    assert np.isnan(residual[lost]).all()
    told = (files.folder / "ours.filled.csv").read_text().splitlines()
    assert told[0] == "marker,first,last,method,expected_mm"
    assert told[1].startswith(f"RASI,{101 + GAP.start},{100 + GAP.stop},rigid,")
    press("export_trc", filepath=files.folder / "trc.trc")
    assert (files.folder / "trc.filled.csv").read_text().splitlines() == told
    press("take_back_fills", extent="TAKE")
    press("export_c3d", filepath=files.folder / "ours.c3d")
    assert (files.folder / "ours.filled.csv").read_text().splitlines() == told[:1], "the old list would lie"


@pytest.mark.parametrize("extent", ["GAP", "MARKER", "TAKE"])
def test_fills_are_taken_back(filled, extent):
    before = keys_of("RASI")
    filled.scene.mocap_autolabel.filling.method = "spline"
    press("fill_gaps", extent="TAKE")
    assert len(rows()) > 10, "all markers were lost in two frames"
    press("take_back_fills", extent=extent)
    left = [row for row in rows() if row[0] == "RASI"]
    assert len(left) == (1 if extent == "GAP" else 0)
    assert (len(rows()) == 0) == (extent == "TAKE")
    assert len(keys_of("RASI")) == len(before) - len(range(30)[GAP]) + (2 if left else 0)


def test_undo_and_files_keep_them(filled, files):
    bpy.ops.ed.undo_push(message="Filled")
    press("take_back_fills", index=0)
    assert rows() == []
    bpy.ops.ed.undo_push(message="Taken back")
    bpy.ops.ed.undo()
    assert len(rows()) == 1
    assert "GENERATED" in kinds_of("RASI").values()
    keys = keys_of("RASI")
    reopen(files.folder / "walk.blend")
    assert len(rows()) == 1
    choose("LKNE", "RKNE")
    press("swap_markers", scope="WHOLE")
    assert rows()[0][3] == ""
    np.testing.assert_array_equal(keys_of("RASI"), keys)
    press("export_c3d", filepath=files.folder / "again.c3d")
    assert (read_points(files.folder / "again.c3d").residual == 0).sum() == len(range(30)[GAP])


def test_labelling_again_keeps_them(filled):
    keys = keys_of("RASI")
    press("label")
    assert [row[3] for row in rows()] == [""]
    np.testing.assert_array_equal(keys_of("RASI"), keys)
    assert "GENERATED" in kinds_of("RASI").values()


def test_labelling_a_part_again_leaves_fills_and_smoothing_beside_what_was_measured(filled, files, extension):
    settings = filled.scene.mocap_autolabel
    settings.filling.cutoff = 5.0
    press("smooth")
    keys = keys_of("RASI")
    settings.labelling.use_range, settings.labelling.range_first, settings.labelling.range_last = True, 121, 125
    press("label")
    assert rows() == [("RASI", 101 + GAP.start, 100 + GAP.stop, "")]
    np.testing.assert_allclose(keys_of("RASI"), keys, atol=1e-5)
    measured = stored_take().unfilled.markers[:, files.names.index("RASI")]
    np.testing.assert_allclose(measured, files.xyz[:, files.names.index("RASI")], atol=1e-5)


def test_a_fill_that_a_correction_contradicts_is_left_out_with_a_word_and_comes_back(filled):
    keys = keys_of("RASI")
    choose()
    press("pick", point=GHOST)
    press("name_point", marker="RASI", scope="FRAME")
    assert "named in some of its frames now" in rows()[0][3]
    assert "GENERATED" not in kinds_of("RASI").values()
    assert len(keys_of("RASI")) == len(keys) - len(range(30)[GAP]) + 1
    press("clear_corrections")
    np.testing.assert_array_equal(keys_of("RASI"), keys)
    assert rows()[0][3] == ""


def test_filled_ones_stand_out_in_the_overlay_and_are_no_labels(filled, files, extension):
    marks = ours("ui.marks")
    stored = stored_take()
    seen = marks.point_marks(stored, GAP.start)
    assert [stored.names[index] for index in np.flatnonzero(seen.filled)] == ["RASI"]
    assert np.isfinite(seen.named[seen.filled]).all()
    table = files.folder / "ours.labels.csv"
    press("export_labels", filepath=table)
    assert sum("RASI" in line for line in table.read_text().splitlines()) == np.isfinite(files.xyz[:, 2, 0]).sum()


def test_what_was_filled_goes_into_no_other_take(labelled, made, monkeypatch, extension):
    filling = ours("ops.filling").MOCAP_AUTOLABEL_OT_fill_gaps
    settings = labelled.scene.mocap_autolabel
    after = show_take(labelled, made.take(40))

    def changed_meanwhile(self, context, filled):
        settings.take = after
        return show(self, context, filled)

    show = filling._show
    monkeypatch.setattr(filling, "_show", changed_meanwhile)
    settings.filling.method = "rigid"
    refused("another take is shown than the one whose gaps were filled; expected", "fill_gaps", extent="TAKE")
    assert rows() == []


def test_a_take_of_blobs_is_filled_too(extension, empty, made):
    empty.scene.mocap_autolabel.take = show_take(empty, made.take(40))
    empty.scene.mocap_autolabel.filling.method = "rigid"
    choose("RASI")
    press("fill_gaps", extent="MARKER")
    assert {row[0] for row in rows()} == {"RASI"}
    assert "GENERATED" in kinds_of("RASI").values()


def test_what_cannot_be_filled_is_one_sentence(labelled):
    settings = labelled.scene.mocap_autolabel
    choose()
    refused("no marker is selected; expected", "fill_gaps", extent="MARKER")
    refused("there is no gap to fill; expected", "fill_gaps", extent="GAP")
    refused("Nothing was filled", "take_back_fills")
    settings.filling.use_longest, settings.filling.longest = True, 1
    assert bpy.ops.mocap_autolabel.fill_gaps(extent="TAKE") == {"CANCELLED"}
    assert {row.reason for row in session().left_gaps} == {"is longer than 1 frames"}
    settings.filling.use_longest, settings.filling.method = False, "body"
    settings.subjects.markerset, settings.subjects.markerset_path = "FILE", ""
    refused("is not the take's; expected", "fill_gaps", extent="TAKE")
    labelled.scene.frame_set(110)
    choose("LKNE")
    settings.filling.method = "spline"
    press("fill_gaps", extent="TAKE")
    choose("LKNE")
    refused("nothing that was filled is there; expected", "take_back_fills", extent="GAP")


def test_the_command_lines_fills_are_marked_in_its_blender_file(labelled, files, extension, tmp_path):
    out = labelled_by_job(files, tmp_path / "out", blend=True, fill=True)
    bpy.ops.wm.open_mainfile(filepath=str(out / "walk.blend"))
    assert "RASI" in {row[0] for row in rows()}
    assert all(row[3] == "" for row in rows())
    frames = [frame for frame, kind in kinds_of("RASI").items() if kind == "GENERATED"]
    assert set(range(101 + GAP.start, 101 + GAP.stop)) <= set(frames)
    press("export_c3d", filepath=out / "ours.c3d")
    ours, theirs = (read_points(out / name) for name in ("ours.c3d", "walk.c3d"))
    np.testing.assert_allclose(ours.xyz, theirs.xyz, atol=1e-5)
    np.testing.assert_array_equal(ours.residual == 0, theirs.residual == 0)


def test_a_corrected_take_is_the_one_that_is_read_again(filled):
    opened = ours("scene.opened").opened
    opened.forget()
    before = stored_take()
    choose("RASI", "LASI")
    press("swap_markers", scope="FRAME")
    after = stored_take()
    assert after is not before
    opened.forget()
    again = stored_take()
    np.testing.assert_array_equal(after.motion.markers, again.motion.markers)
    np.testing.assert_array_equal(after.motion.residual, again.motion.residual)
    np.testing.assert_array_equal(after.labels.marker, again.labels.marker)
    assert after.unfit == again.unfit


RATE, CUTOFF = 60.0, 5.0


def is_smooth(files, name: str):
    """Asserts that a marker is keyed where its trajectory is when it is smoothed."""
    calm = smoothed(files.xyz, RATE, CUTOFF)[:, files.names.index(name)]
    there = np.isfinite(calm[:, 0])
    keys = keys_of(name)
    assert keys[:, 0].tolist() == (101 + np.flatnonzero(there)).tolist()
    np.testing.assert_allclose(keys[:, 1:], calm[there], atol=1e-5)


@pytest.fixture
def calm(labelled):
    """The take smoothed."""
    labelled.scene.mocap_autolabel.filling.cutoff = CUTOFF
    press("smooth")
    return labelled


def test_keys_and_exports_are_smooth_and_labels_stay(calm, files):
    is_smooth(files, "LWRA")
    press("export_c3d", filepath=files.folder / "ours.c3d")
    take = read_points(files.folder / "ours.c3d")
    wanted = smoothed(files.xyz, RATE, CUTOFF)[:, files.names.index("LWRA")]
    np.testing.assert_allclose(take.xyz[:, take.names.index("LWRA")], wanted, atol=1e-5)
    assert not (take.residual == 0).any(), "smoothed is measured still"
    page = files.folder / "walk.report.html"
    press("export_report", filepath=page, open_after=False)
    said = read(page).words
    raw = files.xyz[:, files.names.index("LWRA")]
    there, changed = (int(flags.all(axis=1).sum()) for flags in (np.isfinite(raw), np.abs(wanted - raw) > 0))
    assert f"LWRA {there} 0 {len(raw) - there} {changed} 0 " in said.partition("Where every sample is from")[2]
    press("take_back_smoothing")
    follows(files, "LWRA", files.names.index("LWRA"))
    refused("Nothing is smoothed", "take_back_smoothing")


def test_it_is_kept_through_files_corrections_and_labelling_again(calm, files):
    reopen(str(files.folder / "walk.blend"))
    choose("LKNE", "RKNE")
    press("swap_markers", scope="WHOLE")
    press("clear_corrections")
    is_smooth(files, "LKNE")
    press("label")
    is_smooth(files, "LKNE")


def test_fills_are_made_of_what_was_measured(calm, files):
    calm.scene.mocap_autolabel.filling.method = "rigid"
    choose("RASI")
    calm.scene.frame_set(112)
    press("fill_gaps", extent="GAP")
    [row] = session().fills
    assert row.reason == ""
    press("take_back_smoothing")
    assert [row.reason for row in session().fills] == [""]


def test_a_cut_off_that_cannot_be_is_one_sentence(labelled):
    labelled.scene.mocap_autolabel.filling.cutoff = 45.0
    refused("45 Hz at 60 frames a second; expected one above 0 and below 30 Hz", "smooth")
    assert "mocap_smoothing" not in labelled.scene.mocap_autolabel.take
