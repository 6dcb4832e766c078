# SPDX-License-Identifier: GPL-3.0-or-later
"""Armature and body follow what a person says of the labels, and whoever looks at them before that is told."""

import importlib
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
    """What lets the body follow."""
    return ours("ops.reposing")


@pytest.fixture
def later(extension, monkeypatch):
    """Lets nothing follow an edit by itself, as in a window until it has time."""
    for name in ("ops.correcting", "ops.labelling", "ui"):
        monkeypatch.setattr(importlib.import_module(f"{extension}.addon.{name}"), "follow_soon", lambda **_: None)


def rests() -> np.ndarray:
    [armature] = only(bpy.context.scene.mocap_autolabel.take, "ARMATURE")
    return np.array([[*bone.head_local, *bone.tail_local] for bone in armature.data.bones])


def capsules() -> np.ndarray:
    """(K, 5) where the capsules are, and their lengths and radii."""
    items = [item for item in bpy.context.scene.mocap_autolabel.take.all_objects if "mocap_capsule" in item]
    return np.array([[*item.matrix_world.translation, item["mocap_end"][2], item["mocap_radius"]] for item in items])


def swap(one=WRIST, other=KNEE, scope="WHOLE"):
    choose(one, other)
    press("swap_markers", scope=scope)


def numbers_of(path) -> np.ndarray:
    """All numbers of a BVH file, its bones' lengths and what moves them."""
    return np.array([float(word) for word in re.findall(r"-?\d+\.\d+", path.read_text())])


def bvh(files, name: str) -> np.ndarray:
    path = files.folder / name
    press("export_bvh", filepath=path)
    return numbers_of(path)


def test_a_correction_that_is_taken_back_after_labelling_again_leaves_the_body_as_it_was(labelled, files):
    before = bones(), rests(), capsules()
    swap()
    reopen(str(files.folder / "walk.blend"))
    press("label")
    assert np.abs(bones() - before[0]).max() > 0.1, "the arm goes to the knee"
    press("remove_correction", index=0)
    for now, was in zip((bones(), rests(), capsules()), before, strict=True):
        np.testing.assert_allclose(now, was, atol=NEAR)


def anew(collection) -> np.ndarray:
    """(F, J, 3) m the joints of a body that is fitted to the markers of a take of one as they are, as its bones go."""
    stored = Opened().take(collection, bpy.context.scene)
    points = Labels.none(len(stored.motion.frames), len(stored.names))  # whose confidence alone is asked for
    own = stored.unfilled
    markerset = finer(open_markerset("body26"))
    [armature] = only(collection, "ARMATURE")
    order = [markerset.skeleton.segments.index(bone.name) for bone in armature.pose.bones]
    return motion_of(own.markers, own.residual, points, markerset, own.frames).joints[:, order]


def test_the_body_is_what_is_fitted_to_the_markers_after_each_correction(labelled):
    take = labelled.scene.mocap_autolabel.take
    for scope, markers in (("ON", ("LWRA", "LKNE")), ("BACK", ("RASI", "C7")), ("FRAME", ("LWRA", "LKNE"))):
        swap(*markers, scope)
        fitted = anew(take)
        there = np.isfinite(fitted[:, 0, 0])
        np.testing.assert_allclose(bones()[there][..., :3, 3], fitted[there], atol=NEAR)


def test_what_is_exported_after_a_correction_is_what_labelling_again_gives(labelled, files, reposing, later):
    """Whether or not there was time for the body to follow."""
    before = bvh(files, "before.bvh")
    swap()
    now = bvh(files, "now.bvh")
    press("label")
    assert not reposing.is_behind(bpy.context)
    np.testing.assert_allclose(now, bvh(files, "anew.bvh"), atol=0.02)  # cm and degrees
    assert np.abs(now - before).max() > 5


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


def test_a_character_that_is_added_after_a_correction_is_of_the_body_as_it_is(labelled, reposing, later):
    swap()
    assert reposing.is_behind(bpy.context)
    press("add_character")
    assert not reposing.is_behind(bpy.context)


def test_undo_and_redo_leave_no_body_of_other_labels(labelled, reposing):
    """Also where the body followed after the step of undo was made, as it does beside a window."""
    bpy.ops.ed.undo_push(message="Labelled")
    before = bones()
    swap()
    bpy.ops.ed.undo_push(message="Swapped")
    for step, wanted in ((bpy.ops.ed.undo, before), (bpy.ops.ed.redo, bones())) * 2:
        assert step() == {"FINISHED"}
        np.testing.assert_allclose(bones(), wanted, atol=NEAR)


def test_undo_does_so_where_nothing_followed_in_time(labelled, reposing, later, monkeypatch):
    """The step of undo has keys and tables of different bodies in every order, and says so."""
    bpy.ops.ed.undo_push(message="Labelled")
    swap()
    bpy.ops.ed.undo_push(message="Swapped")
    reposing.follow_now(bpy.context)
    after = bones()
    bpy.ops.ed.undo()
    bpy.ops.ed.redo()
    assert reposing.is_behind(bpy.context) or np.abs(bones() - after).max() < NEAR
    reposing.follow_now(bpy.context)
    np.testing.assert_allclose(bones(), after, atol=NEAR)


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


def test_what_was_begun_of_other_labels_is_left(labelled, reposing, later, monkeypatch):
    """Taken back before it ended, the frame that was shown at once is as it was."""
    right = bones()
    monkeypatch.setattr(reposing, "BUDGET", 0.0)
    swap()
    reposing._follow()
    press("remove_correction", index=0)
    assert reposing.is_behind(bpy.context), "one frame is still of the other labels"
    while reposing._follow() is not None:
        pass
    np.testing.assert_allclose(bones(), right, atol=NEAR)


def test_what_is_half_done_is_begun_anew_after_undo(labelled, reposing, later, monkeypatch):
    """Blender's own references, which it works on, are none any more then."""
    monkeypatch.setattr(reposing, "BUDGET", 0.0)
    swap()
    assert reposing._follow() is not None
    assert reposing._going_on
    ours("ui").before_undo()
    assert not reposing._going_on


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
    assert said() == []


def test_without_its_marker_set_the_body_says_what_it_needs_and_is_not_written(labelled, files, reposing, made):
    """The labels are corrected all the same."""
    take = bpy.context.scene.mocap_autolabel.take
    take[takes.PERFORMERS] = take[takes.PERFORMERS].replace("body26", "mine")
    ours("scene.opened").opened.forget()
    write_model(files.folder / "small.markerset.json", Model(made.markerset()))
    press("open_markerset", filepath=files.folder / "small.markerset.json")
    swap()
    assert len(session().corrections) == 1
    assert "choose marker set mine" in reposing.words_behind(bpy.context)
    refused(
        "older than the last correction; expected you to choose marker set mine",
        "export_bvh",
        filepath=files.folder / "walk.bvh",
    )
    assert not (files.folder / "walk.bvh").exists()
    bpy.context.scene.mocap_autolabel.subjects.markerset = "body26"
    bvh(files, "walk.bvh")
    assert not reposing.is_behind(bpy.context)


def test_an_armature_that_a_person_gave_other_keys_keeps_them(labelled, reposing):
    [armature] = only(bpy.context.scene.mocap_autolabel.take, "ARMATURE")
    own = bpy.data.actions.new("mine")
    armature.animation_data.action = own
    swap()
    assert armature.animation_data.action == own and not len(own.layers)
    assert not reposing.is_behind(bpy.context)


def test_keys_that_a_person_set_on_the_armature_stay(labelled, reposing):
    [armature] = only(bpy.context.scene.mocap_autolabel.take, "ARMATURE")
    bag = armature.animation_data.action.layers[0].strips[0].channelbag(armature.animation_data.action_slot)
    curve = bag.fcurves[0]
    curve.keyframe_points[7].co.y += 0.5
    before = [tuple(point.co) for one in bag.fcurves for point in one.keyframe_points]
    swap()
    assert [tuple(point.co) for one in bag.fcurves for point in one.keyframe_points] == before
    assert curve.keyframe_points[7].co.y == before[7][1]


def test_frames_around_those_that_are_labelled_again_stay_marked(labelled, reposing, later):
    swap()
    settings = bpy.context.scene.mocap_autolabel
    settings.labelling.use_range, settings.labelling.range_first, settings.labelling.range_last = True, 110, 115
    press("label")
    assert reposing.is_behind(bpy.context)
    reposing.follow_now(bpy.context)
    fitted = anew(settings.take)
    there = np.isfinite(fitted[:, 0, 0])
    np.testing.assert_allclose(bones()[there][..., :3, 3], fitted[there], atol=NEAR)


def test_of_two_performers_both_are_right(empty, settings, made, files, reposing):
    write_model(files.folder / "small.markerset.json", Model(made.markerset()))
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
