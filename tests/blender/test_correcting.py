# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels of 3D points corrected in Blender: all that is shown and written follows, and what was said is kept."""

import json
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest

from addon.core.edits.kinds import AssignPoint, Edits, Right, Swap, UnlabelPoint
from addon.io.edits import read_edits, write_edits
from addon.io.points import read_points
from tests.io.pages import read as read_page

from .conftest import label_walk
from .hands import (
    FRAMES,
    GHOST,
    choose,
    follows,
    keys_of,
    labelled_by_job,
    ours,
    out_of_another_file,
    picked,
    press,
    refused,
    rows_of_export,
    session,
    shown,
    stored_take,
)


def test_two_names_are_swapped_everywhere(labelled, files):
    choose("LKNE", "RKNE")
    press("swap_markers", scope="ON")
    one, other = files.names.index("LKNE"), files.names.index("RKNE")
    for name, before, after in (("LKNE", one, other), ("RKNE", other, one)):
        follows(files, name, before, slice(0, 19))
        follows(files, name, after, slice(19, None))
    np.testing.assert_allclose(shown()["LKNE"].matrix_world.translation, files.xyz[19, other], atol=1e-5)
    for ending, export in ((".c3d", bpy.ops.mocap_autolabel.export_c3d), (".trc", bpy.ops.mocap_autolabel.export_trc)):
        export(filepath=str(files.folder / f"ours{ending}"))
        take = read_points(files.folder / f"ours{ending}")
        np.testing.assert_allclose(take.xyz[25, take.names.index("LKNE")], files.xyz[25, other], atol=1e-5)
        np.testing.assert_allclose(take.xyz[5, take.names.index("LKNE")], files.xyz[5, one], atol=1e-5)
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
    assert len({item.animation_data.action for item in shown().values()}) == GHOST
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


def test_what_is_right_is_no_longer_asked(extension, labelled, suspects):
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
    assert [row.name for row in session().corrections] == [
        f"Trajectory {knee} has no name, all frames",
        "LWRA and RWRA swapped, all frames",
    ]
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


def test_a_file_of_the_command_line_can_be_corrected_on(labelled, files, extension, tmp_path):
    write_edits(files.edits, Edits((Swap(("LKNE", "RKNE")),)))
    out = labelled_by_job(files, tmp_path / "out", blend=True)
    bpy.ops.wm.open_mainfile(filepath=str(out / "walk.blend"))
    follows(files, "LKNE", files.names.index("RKNE"))
    assert rows_of_export(tmp_path / "ours.labels.csv") == [
        line.split(",") for line in (out / "walk.labels.csv").read_text().splitlines()[1:]
    ]
    press("remove_correction", index=0)
    follows(files, "LKNE", files.names.index("LKNE"))


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
    scene.mocap_autolabel.take = None
    refused("Label a take first", "unlabel")


def test_an_export_without_the_name_of_a_file_is_one_sentence(labelled):
    for name in ("c3d", "trc", "labels", "bvh"):
        refused("no file was named; expected the one to write", f"export_{name}")


def test_the_page_of_a_take_says_what_was_said_of_it(labelled, files, tmp_path):
    choose("LKNE", "RKNE")
    press("swap_markers", scope="ON")
    path = tmp_path / "walk.report.html"
    press("export_report", filepath=path, open_after=False)
    page = read_page(path)
    for words in ("LKNE and RKNE swapped, frames 120–130", "points named", f"{len(files.names)} markers", "by hand"):
        assert words in page.words, words
    strips = [each.get("aria-label", "") for tag, each in page.found if tag == "svg"]
    assert any(label.startswith("LKNE: ") and "edited " in label for label in strips)


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
    for name, given in (("clear_corrections", {}), ("remove_correction", {"index": 0})):
        state.of_scene = 0
        refused("another scene's; expected a choice in this one's", name, **given)
    assert len(stored_take().edits) == 1 and not len(state.left_gaps)
    press("remove_correction", index=0)
    assert not len(stored_take().edits)
