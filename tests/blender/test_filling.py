# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaps filled and markers smoothed in the scene: marked, exported, told, taken back, kept through all that happens."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core.edits.kinds import Edits, Swap
from addon.core.filling.smoothing import smoothed
from addon.io.edits import write_edits
from addon.io.points import read_points
from addon.scene.ownership import curves_of
from addon.scene.take import show_take
from tests.io.pages import read

from .conftest import labelled_by_job, rows_of_export
from .hands import FRAMES, GHOST, choose, follows, keys_of, ours, press, refused, reopen, session, shown, stored_take

GAP = slice(FRAMES // 3, FRAMES // 2)  # of RASI, and all are lost in two frames before
HERE = 101 + GAP.start + 2


def kinds_of(name: str) -> dict[int, str]:
    return {int(key.co[0]): key.type for key in curves_of(shown()[name])[1].keyframe_points}


def rows() -> list[tuple]:
    return [(row.name, row.first, row.last, row.reason) for row in session().fills]


@pytest.fixture
def filled(labelled):
    labelled.scene.mocap_autolabel.filling.method = "rigid"
    choose("RASI")
    labelled.scene.frame_set(HERE)
    press("fill_gaps", extent="GAP")
    return labelled


def test_a_gap_is_filled_and_told_from_labels_in_keys_lists_tables_and_the_overlay(filled, files):
    assert rows() == [("RASI", 101 + GAP.start, 100 + GAP.stop, "")]
    kinds = kinds_of("RASI")
    assert {frame for frame, kind in kinds.items() if kind == "GENERATED"} == {101 + f for f in range(30)[GAP]}
    assert set(kinds.values()) == {"GENERATED", "KEYFRAME"}
    keys = keys_of("RASI")
    assert np.linalg.norm(np.diff(keys[:, 1:], axis=0), axis=1).max() < 0.2, "it goes where the markers beside it go"
    row, measured = session().markers["RASI"], np.isfinite(files.xyz[:, 2, 0])
    assert row.labelled == pytest.approx(measured.mean()), "what is filled was not found"
    assert sum("RASI" in line for line in rows_of_export(files.folder / "ours.labels.csv")) == measured.sum()
    stored = stored_take()
    seen = ours("ui.marks").point_marks(stored, GAP.start)
    assert [stored.names[index] for index in np.flatnonzero(seen.filled)] == ["RASI"]
    assert np.isfinite(seen.named[seen.filled]).all()


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
    press("fill_gaps", extent="TAKE", propose=True)
    choose("RASI")
    press("fill_gaps", extent="MARKER")
    assert [row.name for row in state.proposed_fills] == [row[0] for row in asked if row[0] != "RASI"], "it is filled"


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


def test_a_dashed_line_lies_on_the_line_and_ends_where_it_does(extension):
    line = np.array([[0.0, 0.0], [10.0, 20.0], [25.0, 20.0]])
    found = ours("ui.graph").dashed(line, 6.0, 4.0, 30.0)
    np.testing.assert_allclose(found[:, :, 0], [[0, 6], [10, 16], [20, 25]])
    np.testing.assert_allclose(found[:, :, 1], [[0, 12], [20, 20], [20, 20]])
    np.testing.assert_allclose(ours("ui.graph").dashed(line - [11, 0], 6.0, 4.0, 8.0), found[1:2] - [11, 0])
    band = ours("ui.graph").around(np.stack([line[:-1], line[1:]], axis=1), 3.0)
    assert band[0].tolist() == [[0, -3], [10, 17], [10, 23], [0, 3]]


def test_words_of_fills_that_are_close_stand_above_each_other(extension):
    assert ours("ui.graph").rows_of([50.0, 0.0, 30.0, 120.0], [40.0, 40.0, 90.0, 10.0]) == [0, 0, 1, 0]
    assert ours("ui.graph").rows_of([], []) == []


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


def test_undo_files_corrections_and_labelling_again_keep_them(filled, files):
    bpy.ops.ed.undo_push(message="Filled")
    press("take_back_fills", index=0)
    assert rows() == []
    bpy.ops.ed.undo_push(message="Taken back")
    bpy.ops.ed.undo()
    assert len(rows()) == 1
    assert "GENERATED" in kinds_of("RASI").values()
    keys = keys_of("RASI")
    reopen(files.folder / "walk.blend")
    choose("LKNE", "RKNE")
    for operator, given in (("swap_markers", {"scope": "WHOLE"}), ("label", {})):
        press(operator, **given)
        assert [row[3] for row in rows()] == [""]
        np.testing.assert_array_equal(keys_of("RASI"), keys)
        assert "GENERATED" in kinds_of("RASI").values()
    press("export_c3d", filepath=files.folder / "again.c3d")
    assert (read_points(files.folder / "again.c3d").residual == 0).sum() == len(range(30)[GAP])


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


def test_a_fill_that_a_correction_contradicts_is_left_out_also_where_the_take_is_read_again(filled):
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
    choose("RASI", "LASI")
    press("swap_markers", scope="FRAME")
    after = stored_take()
    ours("scene.opened").opened.forget()
    again = stored_take()
    assert after is not again and after.unfit == again.unfit
    for part in ("markers", "residual"):
        np.testing.assert_array_equal(getattr(after.motion, part), getattr(again.motion, part))
    np.testing.assert_array_equal(after.labels.marker, again.labels.marker)


def test_what_was_filled_goes_into_no_other_take(labelled, made, monkeypatch, extension):
    filling, settings = ours("ops.filling").MOCAP_AUTOLABEL_OT_fill_gaps, labelled.scene.mocap_autolabel
    after, show = show_take(labelled, made.take(40)), filling._show
    monkeypatch.setattr(filling, "_show", lambda *given: setattr(settings, "take", after) or show(*given))
    settings.filling.method = "rigid"
    refused("another take is shown than the one whose gaps were filled; expected", "fill_gaps", extent="TAKE")
    assert rows() == []


def test_what_cannot_be_filled_or_smoothed_is_one_sentence(labelled):
    settings = labelled.scene.mocap_autolabel
    choose()
    refused("no marker is selected; expected", "fill_gaps", extent="MARKER")
    refused("there is no gap to fill; expected", "fill_gaps", extent="GAP")
    refused("Nothing was filled", "take_back_fills")
    settings.filling.use_longest, settings.filling.longest = True, 1
    assert bpy.ops.mocap_autolabel.fill_gaps(extent="TAKE") == {"CANCELLED"}
    assert {row.reason for row in session().left_gaps} == {"is longer than 1 frame"}
    settings.filling.use_longest, settings.filling.method = False, "body"
    settings.subjects.markerset, settings.subjects.markerset_path = "FILE", ""
    refused("is not the take's; expected", "fill_gaps", extent="TAKE")
    labelled.scene.frame_set(110)
    choose("LKNE")
    settings.filling.method = "spline"
    press("fill_gaps", extent="TAKE")
    choose("LKNE")
    refused("nothing that was filled is there; expected", "take_back_fills", extent="GAP")
    settings.filling.cutoff = 45.0
    refused("45 Hz at 60 frames a second; expected one above 0 and below 30 Hz", "smooth")
    assert "mocap_smoothing" not in settings.take


def test_a_file_of_the_command_line_has_its_fills_marked_and_can_be_corrected_on(labelled, files, extension, tmp_path):
    write_edits(files.edits, Edits((Swap(("LKNE", "RKNE")),)))
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
    swapped = stored_take().labels.marker
    press("remove_correction", index=0)
    knees = [files.names.index(name) for name in ("LKNE", "RKNE")]
    assert (stored_take().labels.marker[swapped == knees[0]] == knees[1]).all()


RATE, CUTOFF = 60.0, 5.0


def is_smooth(files, name: str):
    calm = smoothed(files.xyz, RATE, CUTOFF)[:, files.names.index(name)]
    there = np.isfinite(calm[:, 0])
    keys = keys_of(name)
    assert keys[:, 0].tolist() == (101 + np.flatnonzero(there)).tolist()
    np.testing.assert_allclose(keys[:, 1:], calm[there], atol=1e-5)


@pytest.fixture
def calm(labelled):
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


def test_it_is_kept_through_all_that_happens_and_fills_are_made_of_what_was_measured(calm, files):
    reopen(str(files.folder / "walk.blend"))
    choose("LKNE", "RKNE")
    press("swap_markers", scope="WHOLE")
    press("clear_corrections")
    is_smooth(files, "LKNE")
    press("label")
    is_smooth(files, "LKNE")
    bpy.context.scene.mocap_autolabel.filling.method = "rigid"
    choose("RASI")
    bpy.context.scene.frame_set(HERE)
    press("fill_gaps", extent="GAP")
    assert [row[3] for row in rows()] == [""]
    press("take_back_smoothing")
    assert [row[3] for row in rows()] == [""]
