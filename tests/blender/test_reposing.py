# SPDX-License-Identifier: GPL-3.0-or-later
"""Armature and body follow what a person says of the labels, and whoever looks at them before that is told."""

import re
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest

from addon.core.data.takes import Labels
from addon.core.filling.smoothing import smoothed
from addon.core.points.models import Model
from addon.core.points.motion import motion_of
from addon.core.posing.finer import finer
from addon.io.markersets import open_markerset
from addon.io.models import write_model
from addon.scene import take as takes
from addon.scene.opened import Opened
from addon.scene.ownership import curves_of

from .conftest import write_walk
from .hands import bones, choose, list_performers, only, ours, press, refused, reopen, session

FRAMES, FIRST = 30, 101
WRIST, KNEE = "LWRA", "LKNE"
NEAR = 1e-4  # m and of a turn: floats of single precision are in between


@pytest.fixture
def files(tmp_path, made):
    """A take of points of a person who wears `body26`, a trajectory a marker."""
    markerset = open_markerset("body26")
    return write_walk(tmp_path, made.motion(markerset, FRAMES).markers, markerset, rate=30.0)


@pytest.fixture
def labelled(extension, empty, files, name_as):
    """The take in a scene, named as it is."""
    name_as(np.arange(len(files.names)))
    press("import_points", filepath=files.take)
    empty.scene.mocap_autolabel.subjects.markerset = "body26"
    press("label")
    empty.scene.frame_set(120)
    return empty


@pytest.fixture
def reposing(extension):
    return ours("ops.reposing")


@pytest.fixture
def later(extension, monkeypatch):
    """Lets nothing follow an edit by itself, as in a window until it has time."""
    for name in ("ops.correcting", "ops.labelling", "ui"):
        monkeypatch.setattr(ours(name), "follow_soon", lambda **_: None)


def body() -> tuple[np.ndarray, ...]:
    """Where bones are, now and at rest, and where capsules are (K, 5), with their lengths and radii."""
    take = bpy.context.scene.mocap_autolabel.take
    [armature] = only(take, "ARMATURE")
    rests = np.array([[*bone.head_local, *bone.tail_local] for bone in armature.data.bones])
    items = [item for item in take.all_objects if "mocap_capsule" in item]
    places = [[*item.matrix_world.translation, item["mocap_end"][2], item["mocap_radius"]] for item in items]
    return bones(), rests, np.array(places)


def swap(one=WRIST, other=KNEE, scope="WHOLE"):
    choose(one, other)
    press("swap_markers", scope=scope)


def bvh(files, name: str) -> np.ndarray:
    """All numbers of a BVH file that is exported, its bones' lengths and what moves them."""
    path = files.folder / name
    press("export_bvh", filepath=path)
    return np.array([float(word) for word in re.findall(r"-?\d+\.\d+", path.read_text())])


def test_a_correction_that_is_taken_back_after_labelling_again_leaves_the_body_as_it_was(labelled, files):
    before = body()
    swap()
    reopen(str(files.folder / "walk.blend"))
    press("label")
    assert np.abs(bones() - before[0]).max() > 0.1, "the arm goes to the knee"
    press("remove_correction", index=0)
    for now, was in zip(body(), before, strict=True):
        np.testing.assert_allclose(now, was, atol=NEAR)


def is_fitted():
    """Asserts that bones are where a body has them that is fitted to the markers of the take as they are."""
    collection = bpy.context.scene.mocap_autolabel.take
    stored = Opened().take(collection, bpy.context.scene)
    points = Labels.none(len(stored.motion.frames), len(stored.names))  # whose confidence alone is asked for
    own, markerset, [armature] = stored.unfilled, finer(open_markerset("body26")), only(collection, "ARMATURE")
    order = [markerset.skeleton.segments.index(bone.name) for bone in armature.pose.bones]
    fitted = motion_of(own.markers, own.residual, points, markerset, own.frames).joints[:, order]
    there = np.isfinite(fitted[:, 0, 0])
    np.testing.assert_allclose(bones()[there][..., :3, 3], fitted[there], atol=NEAR)


def test_the_body_is_what_is_fitted_to_the_markers_after_each_correction(labelled):
    for scope, markers in (("ON", ("LWRA", "LKNE")), ("BACK", ("RASI", "C7")), ("FRAME", ("LWRA", "LKNE"))):
        swap(*markers, scope)
        is_fitted()


def test_what_is_exported_or_added_after_a_correction_is_what_labelling_again_gives(labelled, files, reposing, later):
    """Whether or not there was time for the body to follow."""
    before = bvh(files, "before.bvh")
    swap()
    now = bvh(files, "now.bvh")
    press("label")
    assert not reposing.is_behind(bpy.context)
    np.testing.assert_allclose(now, bvh(files, "anew.bvh"), atol=0.02)  # cm and degrees
    assert np.abs(now - before).max() > 5
    swap()
    assert reposing.is_behind(bpy.context)
    press("add_character")
    assert not reposing.is_behind(bpy.context)


def test_smoothing_reaches_the_armature_and_what_is_exported(labelled, files, reposing):
    before, was = bones(), bvh(files, "before.bvh")
    labelled.scene.mocap_autolabel.filling.cutoff = 2.0
    press("smooth")
    assert not reposing.is_behind(bpy.context)
    stored = Opened().take(labelled.scene.mocap_autolabel.take, bpy.context.scene)
    root = smoothed(stored.motion.joints[:, :1], 30.0, 2.0)[:, 0]
    assert np.nanmax(np.abs(root - stored.motion.joints[:, 0])) > 10 * NEAR
    there = np.isfinite(root[:, 0])
    np.testing.assert_allclose(bones()[there, 0, :3, 3], root[there], atol=NEAR)
    assert np.abs(bvh(files, "calm.bvh") - was).max() > 0.1
    reopen(str(files.folder / "walk.blend"))
    assert not reposing.is_behind(bpy.context)
    press("take_back_smoothing")
    np.testing.assert_allclose(bones(), before, atol=NEAR)
    np.testing.assert_allclose(bvh(files, "again.bvh"), was, atol=0.02)  # cm and degrees


@pytest.mark.parametrize("in_time", [True, False])
def test_undo_and_redo_leave_no_body_of_other_labels_or_say_so(labelled, reposing, request, in_time):
    """Also where the body followed after the step of undo was made, as it does beside a window."""
    if not in_time:  # the step has keys and tables of different bodies
        request.getfixturevalue("later")
    bpy.ops.ed.undo_push(message="Labelled")
    before = bones()
    swap()
    bpy.ops.ed.undo_push(message="Swapped")
    reposing.follow_now(bpy.context)
    for step, wanted in ((bpy.ops.ed.undo, before), (bpy.ops.ed.redo, bones())) * 2:
        assert step() == {"FINISHED"}
        is_right = np.abs(bones() - wanted).max() < NEAR
        assert is_right or (reposing.is_behind(bpy.context) and not in_time)
        reposing.follow_now(bpy.context)
        np.testing.assert_allclose(bones(), wanted, atol=NEAR)


def test_undo_and_redo_around_a_body_that_followed_between_steps_leave_no_table_that_is_gone(labelled, reposing, later):
    swap()
    for message in ("Swapped", "Selected", "Selected again"):
        bpy.ops.ed.undo_push(message=message)
    for step in (bpy.ops.ed.undo, bpy.ops.ed.redo) * 2:
        reposing.follow_now(bpy.context)
        step()
        take, there = bpy.context.scene.mocap_autolabel.take, {mesh.session_uid for mesh in bpy.data.meshes}
        assert {take[key].session_uid for key in ("mocap_expected", "mocap_pose", "mocap_frames")} <= there
        reposing.follow_now(bpy.context)
        is_fitted()


def test_a_copy_of_a_take_keeps_its_body(labelled):
    take, read_table = labelled.scene.mocap_autolabel.take, ours("scene.storage").read_table
    copy, before = take.copy(), read_table(take["mocap_pose"])["joints"]
    swap()
    np.testing.assert_array_equal(read_table(copy["mocap_pose"])["joints"], before)
    assert np.nanmax(np.abs(read_table(take["mocap_pose"])["joints"] - before)) > 0.1


def test_what_is_seen_follows_at_once_and_the_rest_in_small_steps(labelled, reposing, later, monkeypatch):
    right = bones()
    swap()
    reposing.follow_now(bpy.context)
    bent = bones()
    press("remove_correction", index=0)
    monkeypatch.setattr(reposing, "BUDGET", 0.0)
    assert reposing._follow() is not None
    here, seen = 120 - FIRST, bones()
    assert np.abs(bent[here] - right[here]).max() > 0.1
    off = np.linalg.norm(seen[here, :, :3, 3] - right[here, :, :3, 3], axis=1)
    assert off.max() < 0.2 * np.linalg.norm(bent[here, :, :3, 3] - right[here, :, :3, 3], axis=1).max()
    np.testing.assert_allclose(seen[:here], bent[:here], atol=NEAR)
    assert reposing.is_behind(bpy.context)
    steps = 1
    while reposing._follow() is not None:
        steps += 1
    assert steps > 20
    np.testing.assert_allclose(bones(), right, atol=NEAR)
    assert not reposing.is_behind(bpy.context)


def test_what_was_begun_of_other_labels_or_before_undo_is_left(labelled, reposing, later, monkeypatch):
    """Taken back before it ended, the frame that was shown at once is as it was."""
    right = bones()
    monkeypatch.setattr(reposing, "BUDGET", 0.0)
    swap()
    assert reposing._follow() is not None
    press("remove_correction", index=0)
    assert reposing.is_behind(bpy.context), "one frame is still of the other labels"
    while reposing._follow() is not None:
        pass
    np.testing.assert_allclose(bones(), right, atol=NEAR)
    swap()
    assert reposing._follow() is not None
    assert reposing._going_on
    ours("ui").before_undo()
    assert not reposing._going_on, "Blender's own references, which it works on, are none any more after undo"


def test_until_then_viewport_panel_and_export_dialog_say_that_the_body_is_out_of_date(
    labelled, files, extension, reposing, later, monkeypatch
):
    overlay, exporting = ours("ui.overlay"), ours("ops.exporting")
    panels = {name: ours(f"ui.{name}") for name in ("review", "panels")}

    def said() -> list[str]:
        canvas, layout = MagicMock(foot=20.0, scale=1.0), MagicMock()
        canvas.__enter__.return_value = canvas
        monkeypatch.setattr(overlay, "Canvas", lambda _: canvas)
        monkeypatch.setattr(overlay, "draw_frame", lambda *_: None)
        space = SimpleNamespace(overlay=SimpleNamespace(show_overlays=True))
        own = {name: getattr(bpy.context, name) for name in ("scene", "mode", "view_layer")}
        monkeypatch.setattr(overlay, "bpy", SimpleNamespace(context=SimpleNamespace(**own, space_data=space)))
        overlay.draw()
        exporting.ExportsTake.draw(SimpleNamespace(of_body=True, layout=layout), bpy.context)
        words = [call.args[0] for call in canvas.text.mock_calls] + [
            one["text"] for _, _, one in layout.label.mock_calls
        ]
        for module, name in (("review", "review"), ("panels", "use_it")):
            monkeypatch.setattr(panels[module], "draw_text", lambda _, __, text, icon="": words.append(text))
            getattr(panels[module], name).draw(MagicMock(), bpy.context)
        return [one for one in words if "body is out of date" in one]

    assert said() == []
    swap()
    words = said()
    assert len(words) == 4
    reposing.follow_now(bpy.context)
    monkeypatch.setattr(ours("scene.ownership"), "is_keyed_by_us", None)  # no redraw has time to look at all keys
    assert said() == []


def test_without_its_marker_set_the_body_says_what_it_needs_and_is_not_written(labelled, files, reposing, made):
    """The labels are corrected all the same."""
    take = bpy.context.scene.mocap_autolabel.take
    take[takes.PERFORMERS] = take[takes.PERFORMERS].replace("body26", "mine")
    ours("scene.opened").opened.forget()
    write_model(files.folder / "toy.markerset.json", Model(made.markerset()))
    press("open_markerset", filepath=files.folder / "toy.markerset.json")
    swap()
    assert len(session().corrections) == 1
    assert "choose marker set mine" in reposing.words_behind(bpy.context)
    words = "older than the last correction; expected you to choose marker set mine"
    refused(words, "export_bvh", filepath=files.folder / "walk.bvh")
    assert not (files.folder / "walk.bvh").exists()
    bpy.context.scene.mocap_autolabel.subjects.markerset = "body26"
    bvh(files, "walk.bvh")
    assert not reposing.is_behind(bpy.context)


def test_keys_that_a_person_set_on_the_armature_or_gave_it_stay(labelled, reposing):
    [armature] = only(bpy.context.scene.mocap_autolabel.take, "ARMATURE")
    curves = curves_of(armature)
    curves[0].keyframe_points[7].co.y += 0.5
    before = [tuple(point.co) for one in curves for point in one.keyframe_points]
    swap()
    assert [tuple(point.co) for one in curves for point in one.keyframe_points] == before
    armature.animation_data.action = own = bpy.data.actions.new("mine")
    swap()
    assert armature.animation_data.action == own and not len(own.layers)
    assert not reposing.is_behind(bpy.context)


def test_frames_around_those_that_are_labelled_again_stay_marked(labelled, reposing, later):
    swap()
    settings = bpy.context.scene.mocap_autolabel
    settings.labelling.use_range, settings.labelling.range_first, settings.labelling.range_last = True, 110, 115
    press("label")
    assert reposing.is_behind(bpy.context)
    reposing.follow_now(bpy.context)
    is_fitted()


def test_of_two_performers_both_are_right(empty, settings, made, files, reposing):
    write_model(files.folder / "toy.markerset.json", Model(made.markerset()))
    collection = takes.show_take(empty, replace(made.pair(), source=""))
    settings.take = collection
    list_performers(files.folder, "ann", "bob")
    empty.scene.frame_set(115)
    found = []
    for _ in range(2):
        swap("bob:LWRA", "bob:LKNE")
        found.append([bones(range(101, 121), home) for home in collection.children[:2]])
        press("remove_correction", index=0)
        found.append([bones(range(101, 121), home) for home in collection.children[:2]])
    bent, right, *again = found
    assert np.abs(bent[1] - right[1]).max() > 0.1
    np.testing.assert_allclose(bent[0], right[0], atol=NEAR)
    np.testing.assert_allclose(again, [bent, right], atol=NEAR)
