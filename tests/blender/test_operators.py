# SPDX-License-Identifier: GPL-3.0-or-later
"""From files to named markers with the extension's own operators, what goes wrong, and all of it taken out again."""

import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import addon_utils
import bpy
import numpy as np
import pytest

from addon.core.points.models import Model
from addon.io.markersets import open_markerset
from addon.io.models import write_model
from addon.scene import naming
from addon.scene.cameras import cameras_of, show_refined
from tests.faults.stage import SECONDS

from .conftest import open_room, rows_of_export, write_room
from .hands import add_object, only, ours, press, refused, session, stored_take, suspects

KINDS = ["objects", "meshes", "armatures", "actions", "collections", "cameras", "materials", "texts", "libraries"]


def counts() -> dict[str, int]:
    return {kind: len(getattr(bpy.data, kind)) for kind in KINDS}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return write_room(tmp_path_factory.mktemp("files"), 30)


@pytest.fixture
def ready(empty, settings, files):
    """A scene in which only the one button is left to press."""
    open_room(files)
    settings.labelling.use_height, settings.labelling.height = True, 1.6
    return empty


@pytest.fixture
def labelling(extension, monkeypatch, made, tmp_path_factory):
    """The module of the label operator, with a labelling that is quick and known: names by row number.

    The job's files go into `folder`. In the window the process of this session is played by this one.
    """
    module = ours("ops.labelling")
    pipeline = ours("core.pipelines.blobs")
    takes = ours("core.data.takes")
    given, folder = [], tmp_path_factory.mktemp("files-of-the-job")

    def label_take(chunks, cameras, markerset, rate, options, occlusion=None, edits=()):
        for blobs in chunks:
            given.append(SimpleNamespace(cameras=cameras, rate=rate, options=options, occlusion=occlusion, blobs=blobs))
            motion = takes.Motion(**vars(made.motion(made.markerset(), len(blobs.frames))))
            labels = takes.Labels(np.arange(len(blobs)) % 3, np.arange(len(blobs)) % 4, np.full(len(blobs), 0.8))
            yield takes.LabelledChunk(labels, motion, (takes.Suspect(104, 105, "nobody found"),))

    monkeypatch.setattr(pipeline, "label_take", label_take)
    # Names by row number meet in no room and move as nobody can, which real labelling would be refused for.
    monkeypatch.setattr(ours("core.review.odd_cameras").CameraCheck, "names_apart", "")
    monkeypatch.setattr(ours("jobs.blobs"), "refuse_impossible", lambda *_: None)
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    long_work, at_work = ours("ops.long_work"), []

    def hand_over(work):
        at_work[:] = [Here(work, ours("core.data.errors").UserError)]
        return at_work[0]

    def end_process():
        at_work[0].steps.close()

    monkeypatch.setattr(long_work, "hand_over", hand_over)
    monkeypatch.setattr(long_work, "end_process", end_process)
    return SimpleNamespace(module=module, pipeline=pipeline, given=given, folder=folder, long_work=long_work)


class Here:
    """Work that is done by this process, a step at each look."""

    def __init__(self, work, trouble):
        self.steps, self.trouble, self.share = work(), trouble, 0.0

    def look(self):
        try:
            self.share = next(self.steps).fraction
        except StopIteration as done:
            return done.value
        except self.trouble as error:
            return error


@pytest.fixture
def in_fives(extension, labelling, monkeypatch):
    job = ours("jobs.blobs")
    monkeypatch.setattr(job, "read_blobs", partial(job.read_blobs, chunk_frames=5))


def test_the_real_labelling_names_markers_and_casts_rays_unless_the_closed_form_is_chosen(ready, files, monkeypatch):
    """And names the same blobs alike, but for one in a hundred."""
    occlusion = ours("scene.occlusion")
    asked, hidden = [], occlusion.MeshOcclusion.hidden
    monkeypatch.setattr(occlusion.MeshOcclusion, "hidden", lambda self, *of: asked.append(self) or hidden(self, *of))
    settings, named, rays = ready.scene.mocap_autolabel, {}, {}
    settings.labelling.use_range, settings.labelling.range_first, settings.labelling.range_last = True, 105, 110
    for way in ("bvh", "capsules"):
        settings.labelling.occlusion = way
        press("label")
        named[way] = stored_take().labels.marker
        rays[way] = len(asked)
        asked.clear()
    assert rays["bvh"] > 0
    assert rays["capsules"] == 0
    assert (named["bvh"] >= 0).mean() > 0.75
    assert (named["bvh"] == named["capsules"]).mean() > 0.99
    assert settings.take.name == bpy.data.collections["Mocap: walk"].name == bpy.data.actions["Mocap: walk"].name
    names = [item[naming.MARKER] for item in only(settings.take, "EMPTY")]
    assert names == list(open_markerset(files.markerset).markers)
    rows = session().markers
    assert {row.name for row in rows} == set(names)
    assert [row.labelled for row in rows] == sorted(row.labelled for row in rows), "the one found least is first"


def test_the_operator_hands_on_what_was_chosen(ready, files, labelling):
    settings = ready.scene.mocap_autolabel
    settings.labelling.use_facing, settings.labelling.facing = True, 1.5
    settings.labelling.use_range, settings.labelling.range_first, settings.labelling.range_last = True, 105, 110
    press("label")
    given = labelling.given[0]
    assert given.rate == 60.0
    assert given.options.height == pytest.approx(1.6)
    assert given.options.facing == pytest.approx(1.5)
    assert given.blobs.frames.tolist() == [105, 106, 107, 108, 109, 110]
    capsules = open_markerset(files.markerset).capsules
    assert [volume.segment for volume in given.occlusion.volumes] == capsules.segment.tolist()
    assert given.cameras.names == ("cam 0", "cam 1", "cam 2", "cam 3")


def test_a_body_of_ones_own_is_in_the_way(ready, labelling):
    press("edit_markerset")
    armature = next(item for item in ready.scene.objects if item.type == "ARMATURE")
    own = [item for item in armature.children if item.type == "MESH"]
    bpy.data.objects.remove(own.pop())  # else it has as many as the capsules that stand in for it
    ready.scene.mocap_autolabel.labelling.body = armature
    press("label")
    assert len(labelling.given[0].occlusion.volumes) == len(own) == 12


def test_importing_shows_what_there_is_and_bad_files_are_one_sentence_and_leave_it(ready, files, tmp_path):
    source, bad, late = ready.scene.mocap_autolabel.source, tmp_path / "bad.csv", tmp_path / "late.csv"
    assert (source.first_frame, source.last_frame) == (101, 130)
    assert source.blob_count == len(source.preview.vertices) == len(files.truth.marker)
    assert ready.scene.camera[naming.CAMERA] == "cam 0"
    assert len(source.cameras.objects) == 4
    before = counts()
    press("import_cameras", filepath=files.cameras)
    press("import_blobs", filepath=files.blobs)
    assert counts() == before
    before = counts(), source.cameras, source.blobs_path, source.preview.name
    refused("there is no such file", "import_cameras", filepath=tmp_path / "none.toml")
    bad.write_text("frame,camera,x,y\n1,cam 0,3,4\n2,cam 9,3,4\n")
    refused(r"bad\.csv:3: camera 'cam 9' is not in the calibration", "import_blobs", filepath=bad)
    refused("marker set", "open_markerset", filepath=bad)
    late.write_text(f"frame,camera,x,y\n{2**31},cam 0,3,4\n")
    refused(r"late\.csv: goes on to frame 2147483648; expected", "import_blobs", filepath=late)
    assert (counts(), source.cameras, source.blobs_path, source.preview.name) == before


def test_the_import_turns_a_calibration_as_it_is_told(extension, empty, files):
    press("import_cameras", filepath=files.cameras)
    upright = empty.scene.mocap_autolabel.source.cameras
    press("import_cameras", filepath=files.cameras, up="-y")
    lying = empty.scene.mocap_autolabel.source.cameras
    assert lying != upright
    for one, other in zip(upright.objects, lying.objects, strict=True):
        x, y, z = one.matrix_world.translation
        assert tuple(other.matrix_world.translation) == pytest.approx((x, z, -y), abs=1e-5)
    press("import_cameras", "INVOKE_DEFAULT", filepath=files.cameras)
    assert empty.scene.mocap_autolabel.source.cameras == upright


def test_a_scenes_own_cameras_can_be_used_and_what_is_missing_is_said_before(extension, empty, files):
    for reason, *names in (
        ("no cameras", "use_cameras"), ("calibration", "label"), ("no labelled take", "clear"),
        ("Show a marker set first", "reattach", "save_markerset", "judge_markers"),
    ):  # fmt: skip
        for name in names:
            refused(reason, name)
    for name in ("left", "right"):
        camera = add_object(name, bpy.data.cameras.new(name))
        camera.data.shift_x = 0.1
    empty.scene.render.resolution_x, empty.scene.render.resolution_y = 800, 600
    press("use_cameras")
    empty.scene.render.resolution_x = 1234
    own = empty.scene.mocap_autolabel.source.cameras
    cameras = cameras_of(own, empty.scene)
    assert cameras.names == ("left", "right")
    np.testing.assert_array_equal(cameras.size, [[800, 600]] * 2)
    np.testing.assert_allclose(cameras.matrix[0, :2, 2], [400 - 80, 300], rtol=1e-6)
    show_refined(empty.scene, own, replace(cameras, translation=cameras.translation + 1), {})
    press("import_cameras", filepath=files.cameras)
    empty.scene.render.resolution_x = 1234
    press("use_cameras")
    assert empty.scene.mocap_autolabel.source.cameras == own and not own.hide_viewport
    cameras = cameras_of(own, empty.scene)
    assert cameras.names[:2] == ("left", "right") and len(set(cameras.names)) == len(cameras.names) > 2
    np.testing.assert_array_equal(cameras.size[:, 0], [1234] * 2 + [656] * (len(cameras) - 2))
    camera.data.type = "ORTHO"
    refused("right is not a perspective camera", "use_cameras")


class Modal:
    """The label operator as Blender's window drives it, without a window."""

    bl_idname, doing, of_scene, waits = "mocap_autolabel.label", "Labelling", True, True

    def __init__(self, module):
        self.kind, self.reports = module.MOCAP_AUTOLABEL_OT_label, []
        self.everybody, self.force, self.markerset = False, False, ""

    def as_keywords(self):
        return {"markerset": self.markerset, "files": []}

    def __getattr__(self, name):
        own = getattr(self.kind, name)
        return own.__get__(self) if callable(own) else own

    def report(self, kind, words):
        self.reports.append((*kind, words))

    def tick(self, context) -> set[str]:
        return self.modal(context, SimpleNamespace(type="TIMER"))

    def run(self, context, going_on=lambda: True) -> set[str]:
        """Ticks until the work ends, or no longer goes on as it should; the last answer."""
        answer = {"RUNNING_MODAL"}
        for _ in range(1000):
            if answer == {"RUNNING_MODAL"} and going_on():
                answer = self.tick(context)
        return answer


def taken(manager: MagicMock) -> tuple[int, int]:
    """How many timers and progress bars of a window manager were not given back."""
    timers = manager.event_timer_add.call_count - manager.event_timer_remove.call_count
    return timers, manager.progress_begin.call_count - manager.progress_end.call_count


def screen(playing: bool = False) -> SimpleNamespace:
    """A window's screen with a 3D view on the left, 800 px wide, and a timeline beside it."""
    areas = [SimpleNamespace(type=kind, x=x, y=0, width=800, height=600) for kind, x in KINDS_AT]
    return SimpleNamespace(areas=areas, is_animation_playing=playing)


KINDS_AT = (("VIEW_3D", 0), ("DOPESHEET_EDITOR", 800))


def escape(x: int = 400, value: str = "PRESS", is_repeat: bool = False) -> SimpleNamespace:
    return SimpleNamespace(type="ESC", value=value, is_repeat=is_repeat, mouse_x=x, mouse_y=300)


@pytest.fixture
def window(ready, monkeypatch):
    """A context with a window manager that counts, and the operator in it."""
    manager = MagicMock(mocap_autolabel=session(), windows=[])
    manager.invoke_confirm.return_value = {"RUNNING_MODAL"}
    status = []
    monkeypatch.setattr(bpy.types.WorkSpace, "status_text_set", lambda _, words: status.append(words))
    workspace = SimpleNamespace(status_text_set=status.append)
    window = SimpleNamespace(screen=screen(), scene="another")
    manager.windows.append(window)
    context = SimpleNamespace(
        scene=ready.scene, view_layer=ready.view_layer, window_manager=manager,
        window=window, screen=None, workspace=workspace, mode="OBJECT",
    )  # fmt: skip
    return SimpleNamespace(context=context, manager=manager, status=status, operator=Modal(ours("ops.labelling")))


def test_escape_ends_only_what_it_is_meant_for_and_leaves_nothing_behind(ready, labelling, in_fives, window):
    before, chosen = counts(), ready.scene.mocap_autolabel.subjects.markerset
    operator, context = window.operator, window.context
    operator.markerset = "body39"
    assert operator._begin(context) == {"RUNNING_MODAL"}
    assert operator.modal(context, escape()) == {"CANCELLED"}
    assert ready.scene.mocap_autolabel.subjects.markerset == chosen != "body39"
    operator.markerset = ""
    assert operator._begin(context) == {"RUNNING_MODAL"}
    assert operator.run(context, lambda: not labelling.given) == {"RUNNING_MODAL"}
    assert list(labelling.folder.iterdir()), "the job writes its files"
    others = SimpleNamespace(type="MOUSEMOVE"), escape(value="RELEASE"), escape(x=1000), escape(is_repeat=True)
    for other in others:
        assert operator.modal(context, other) == {"PASS_THROUGH"}, other
    context.window.screen = screen(playing=True)
    assert operator.modal(context, escape()) == {"PASS_THROUGH"}
    context.window.screen = screen()
    assert taken(window.manager) == (1, 1)
    assert operator.modal(context, escape()) == {"CANCELLED"}
    assert (*taken(window.manager), window.status[-1]) == (0, 0, None)
    assert counts() == before
    assert ready.scene.mocap_autolabel.take is None
    assert not list(labelling.folder.iterdir())
    assert len(labelling.given) <= 2, "it stopped before its end"


def test_the_status_bar_of_a_workspace_that_was_left_meanwhile_says_no_more_of_it(labelling, window, monkeypatch):
    said = {}
    monkeypatch.setattr(
        bpy.types.WorkSpace, "status_text_set", lambda _, words: said.update({bpy.context.workspace.name: words})
    )
    assert window.operator._begin(window.context) == {"RUNNING_MODAL"}
    window.operator._end(window.context)
    assert said == dict.fromkeys(bpy.data.workspaces.keys())


def test_disabled_while_it_works_the_extension_leaves_nothing_of_it(extension, labelling, in_fives, window):
    operator, manager = window.operator, bpy.context.window_manager
    assert operator._begin(window.context) == {"RUNNING_MODAL"}
    operator._timer = manager.event_timer_add(0.1)
    for _ in range(2):
        addon_utils.disable(extension, default_set=False)
        addon_utils.enable(extension, default_set=True)
        assert (manager.mocap_autolabel.doing, operator._timer, window.status[-1]) == ("", None, None)


def test_the_panel_says_how_long_it_takes_and_its_button_cancels_but_not_much_work_unasked(
    ready, labelling, in_fives, window
):
    operator, context, state = window.operator, window.context, window.manager.mocap_autolabel
    long_work, other = labelling.long_work, Modal(labelling.module)
    told = [long_work.time_left(10, 0.5), long_work.time_left(1, 0.5), long_work.time_left(60, 0.1)]
    assert told == ["10 s", "", "9 min"]
    assert operator._begin(context) == {"RUNNING_MODAL"}
    assert state.doing.startswith("Labelling: 0%")
    refused("going on already", "label")
    assert other._begin(context) == {"CANCELLED"}
    assert "labelling goes on; expected" in other.reports[0][1]
    cancel = long_work.MOCAP_AUTOLABEL_OT_cancel
    asked = SimpleNamespace(
        execute=lambda context: cancel.execute(asked, context), work=lambda _: cancel.work(asked, _)
    )
    state.spent = 80.0
    assert cancel.invoke(asked, context, escape()) == {"RUNNING_MODAL"}
    assert not state.cancelled
    assert window.manager.invoke_confirm.call_args.kwargs["title"] == "Throw away 80 s of work?"
    state.spent = 9.0
    assert cancel.invoke(asked, context, escape()) == {"FINISHED"}
    assert state.cancelled
    state.cancelled = False
    press("cancel")
    assert operator.tick(context) == {"CANCELLED"}
    assert state.doing == ""


def test_ticks_come_to_an_end_with_the_take_shown(ready, labelling, in_fives, window):
    operator, context = window.operator, window.context
    assert operator._begin(context) == {"RUNNING_MODAL"}
    before, ticks = counts(), []
    window.manager.mocap_autolabel.unfolded, ready.scene.mocap_autolabel.source.blobs_path = False, "another.csv"

    def untouched() -> bool:
        ticks.append(counts() == before)
        return ticks[-1]

    assert operator.run(context, untouched) == {"FINISHED"}, "Blender's data is written once, at the end"
    assert len(labelling.given) == 30 / 5
    assert len(ticks) >= 30 / 5 + 1
    assert not list(labelling.folder.iterdir()), "the job's files are gone"
    assert ready.scene.mocap_autolabel.take.name == "Mocap: walk"
    assert window.manager.mocap_autolabel.unfolded, "what was opened meanwhile is seen"
    assert (*taken(window.manager), window.status[-1]) == (0, 0, None)
    shares = [call.args[0] for call in window.manager.progress_update.call_args_list]
    assert shares == sorted(shares)


@pytest.mark.parametrize("beside", [False, True], ids=["here", "in another window"])
def test_what_was_asked_for_in_a_scene_is_shown_there_once_that_is_seen(ready, labelling, in_fives, window, beside):
    operator, context, state = window.operator, window.context, window.manager.mocap_autolabel

    def going_on() -> bool:
        operator._shown = 0.0
        return "%" in state.doing

    asked, other = ready.scene, bpy.data.scenes.new("Other")
    assert operator._begin(context) == {"RUNNING_MODAL"}
    context.scene = other
    assert operator.run(context, going_on) == {"RUNNING_MODAL"}
    assert state.doing == "Labelling: done, to be shown in Scene"
    assert asked.mocap_autolabel.take is other.mocap_autolabel.take is None
    spent, operator._began = state.spent, operator._began - 3600
    assert operator.tick(context) == {"RUNNING_MODAL"}
    assert state.spent == spent, "it is not worked on"
    if beside:
        window.manager.windows.append(bpy.context.window)
    else:
        context.scene = asked
    operator._shown = 0.0
    assert operator.run(context) == {"FINISHED"}
    assert asked.mocap_autolabel.take.name == "Mocap: walk"
    assert not len(other.objects)


def test_what_was_asked_for_in_a_scene_that_is_gone_is_one_sentence(ready, labelling, in_fives, window):
    operator, context = window.operator, window.context
    assert operator._begin(context) == {"RUNNING_MODAL"}
    context.scene = bpy.data.scenes.new("Other")
    bpy.data.scenes.remove(ready.scene)
    assert operator.run(context) == {"CANCELLED"}
    assert operator.reports[-1][1] == "labelling is done, but its scene is gone; expected that to stay"


NEW, CLOSES = "a new file", "no file: a window is closed"


@pytest.fixture
def opens(labelling, window, monkeypatch):
    """Opens a file, a new one, or closes a window; gives the operator that takes the work up, and what is told."""
    taken_up, told, there = [], [], MagicMock(wraps=bpy)
    there.context, there.data, there.app.background = bpy.context, bpy.data, False
    there.ops.mocap_autolabel.label = lambda _: taken_up[-1].execute(window.context)
    monkeypatch.setattr(labelling.long_work, "bpy", there)
    monkeypatch.setattr(labelling.long_work, "soon", lambda *_, **__: None)
    monkeypatch.setattr(labelling.long_work, "_pop_up", told.append)

    def opens(path, going_on=None):
        if going_on is not None:
            going_on.cancel(window.context)
        if path == NEW:
            bpy.ops.wm.read_homefile(use_empty=True)
        elif path != CLOSES:
            bpy.ops.wm.open_mainfile(filepath=str(path))
        window.context.scene, window.context.view_layer = bpy.context.scene, bpy.context.view_layer
        window.manager.mocap_autolabel = session()
        taken_up.append(Modal(labelling.module))
        labelling.long_work.take_up()
        return taken_up[-1], told

    return opens


@pytest.fixture
def done_for(labelling, in_fives, window, opens, tmp_path):
    """A file that work was done for while another was open, and who did it."""
    path, context = tmp_path / "walk.blend", window.context
    assert window.operator._begin(context) == {"RUNNING_MODAL"}
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    elsewhere, _ = opens(NEW, going_on=window.operator)
    assert elsewhere.run(context) == {"CANCELLED"}
    return path, elsewhere


def test_work_goes_on_as_another_file_is_opened_and_is_shown_in_its_own(labelling, window, opens, done_for):
    (path, elsewhere), context, long_work = done_for, window.context, labelling.long_work
    assert elsewhere.reports == [("INFO", "Labelling is done, to be shown once walk.blend is open")]
    assert list(long_work.done_elsewhere()) == [("Labelling", str(path))]
    assert bpy.context.scene.mocap_autolabel.take is None
    assert taken(window.manager) == (0, 0)
    again, told = opens(path)
    assert again.run(context) == {"FINISHED"}
    assert bpy.context.scene.mocap_autolabel.take.name == "Mocap: walk"
    assert not told and not long_work._left


def test_what_is_done_for_a_file_that_was_moved_can_be_given_up(labelling, done_for):
    (path, _), long_work = done_for, labelling.long_work
    going_on = Modal, {"_found": None, "_file": str(path)}
    long_work._left.append(going_on)
    press("give_up_done", file="/nowhere.blend")
    assert list(long_work.done_elsewhere()) == [("Labelling", str(path))]
    press("give_up_done", file=str(path))
    assert long_work._left == [going_on], "what goes on can be cancelled"
    long_work._left.clear()


def test_work_whose_scene_was_deleted_before_another_file_was_opened_says_so(
    ready, labelling, in_fives, window, opens, tmp_path
):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "walk.blend"))
    assert window.operator._begin(window.context) == {"RUNNING_MODAL"}
    bpy.data.scenes.new("Other")
    bpy.data.scenes.remove(ready.scene)
    _, told = opens(NEW, going_on=window.operator)
    assert told == ["Labelling was given up, as its scene is gone"]


def test_a_file_dialog_that_is_closed_was_no_work(labelling, window):
    window.operator.cancel(window.context)
    assert not labelling.long_work._left
    assert taken(window.manager) == (0, 0)


def test_a_result_that_is_thrown_away_ends_no_process_which_may_be_at_other_work(
    labelling, in_fives, window, monkeypatch
):
    operator, context, ended = window.operator, window.context, []
    monkeypatch.setattr(labelling.long_work, "end_process", lambda: ended.append(True))
    assert operator._begin(context) == {"RUNNING_MODAL"}
    context.scene = bpy.data.scenes.new("Other")
    assert operator.run(context, lambda: operator._found is None) == {"RUNNING_MODAL"}
    press("cancel")
    assert operator.tick(context) == {"CANCELLED"}
    assert not ended


def test_work_whose_window_is_closed_goes_on_in_another_before_any_is_begun(labelling, in_fives, window, opens):
    assert window.operator._begin(window.context) == {"RUNNING_MODAL"}
    window.operator.cancel(window.context)
    other = Modal(labelling.module)
    assert other._begin(window.context) == {"CANCELLED"}
    assert "labelling goes on; expected" in other.reports[0][1]
    elsewhere, told = opens(CLOSES)
    assert elsewhere.run(window.context) == {"FINISHED"}
    assert not told


@pytest.mark.parametrize("kind", ["exporting.ExportsTake", "labelling.LabelsTake"])
def test_only_what_is_in_no_file_is_given_up_with_a_file_that_was_never_saved(
    labelling, window, opens, kind, monkeypatch
):
    module, kind = kind.split(".")
    of_scene = getattr(ours(f"ops.{module}"), kind).of_scene
    monkeypatch.setattr(Modal, "of_scene", of_scene)
    assert window.operator._begin(window.context) == {"RUNNING_MODAL"}
    elsewhere, told = opens(NEW, going_on=window.operator)
    assert told == ["Labelling was given up, as its file was never saved and another was opened"] * of_scene
    assert of_scene or elsewhere.run(window.context) == {"FINISHED"}
    assert hasattr(elsewhere, "_worker") != of_scene


@pytest.mark.parametrize("gone", [False, True])
@pytest.mark.parametrize(
    "name", ["exporting.ExportsTake", "training.Trains", "labelling.MOCAP_AUTOLABEL_OT_find_markerset"]
)
def test_what_is_in_a_file_needs_no_scene_and_nobody_waits_for_a_look(ready, labelling, in_fives, window, name, gone):
    module, kind = name.split(".")
    kind, operator, context = getattr(ours(f"ops.{module}"), kind), window.operator, window.context
    operator.of_scene, operator.waits, shown = kind.of_scene, kind.waits, []
    operator._show = lambda context, _: shown.append(context.scene)
    assert operator._begin(context) == {"RUNNING_MODAL"}
    context.scene, written = bpy.data.scenes.new("Other"), module != "labelling"
    if gone:
        bpy.data.scenes.remove(ready.scene)
    assert operator.run(context) == ({"FINISHED"} if written else {"CANCELLED"})
    assert shown == [bpy.data.scenes["Other" if gone else "Scene"]] * written
    assert not operator.reports


def test_work_is_done_by_one_process_and_shown_here_and_its_death_is_one_sentence(ready, window):
    context = window.context
    press("label")
    here, long_work = stored_take().labels, ours("ops.long_work")
    shares, processes = [], set()
    for killed in (False, False, True):
        operator = Modal(ours("ops.labelling"))
        answer = operator._begin(context)
        processes.add(operator._worker.process.pid)
        until = time.monotonic() + SECONDS
        while answer == {"RUNNING_MODAL"} and time.monotonic() < until:
            if killed:
                operator._worker.process.kill()
            answer = operator.tick(context)
            shares.append(operator._worker.share)
            time.sleep(0.01)
        assert answer == ({"CANCELLED"} if killed else {"FINISHED"}), operator.reports
    assert len(processes) == 1
    assert max(shares) > 0
    assert "its process was killed" in operator.reports[0][1]
    for name in ("marker", "step", "confidence"):
        np.testing.assert_array_equal(getattr(stored_take().labels, name), getattr(here, name))
    assert operator._begin(context) == {"RUNNING_MODAL"}
    assert operator._worker.process.pid not in processes, "another one was started"
    press("cancel")
    assert operator.tick(context) == {"CANCELLED"}
    assert long_work._workers == []


def test_the_review_names_gaps_and_suspects_and_its_buttons_lead_there(ready, labelling):
    press("label")
    rows = {row.name: row for row in session().markers}
    # The fifth frames of `made.motion` are lost, and its third marker is not seen for a sixth of the take.
    assert (rows["SACR"].gaps, rows["SACR"].longest_gap, rows["SACR"].first_gap) == (1, 2, 104)
    assert (rows["RASI"].gaps, rows["RASI"].longest_gap) == (2, 5)
    assert rows["SACR"].labelled == pytest.approx(28 / 30)
    assert rows["SACR"].residual == pytest.approx(1.0)
    # The names are made up, which is no camera's fault, and told as one's.
    assert [one for one in suspects() if not one[2].startswith("camera ")] == [(104, 105, "nobody found")]
    press("jump", frame=107, marker="CLAV")
    assert ready.scene.frame_current == 107
    assert [item[naming.MARKER] for item in ready.selected_objects] == ["CLAV"]
    camera = ready.scene.mocap_autolabel.source.cameras.objects[2]
    press("look_through", camera=camera.name)
    assert ready.scene.camera == camera
    assert (ready.scene.render.resolution_x, ready.scene.render.resolution_y) == (656, 491)
    refused("not a calibrated camera", "look_through", camera="nobody")


def test_labelling_is_one_undo_step_and_clearing_removes_the_take_and_nothing_else(ready, labelling):
    def is_as_before() -> bool:
        nothing = (bpy.context.scene.mocap_autolabel.take, len(session().markers)) == (None, 0)
        return nothing and {**counts(), "materials": 0} == {**before, "materials": 0}

    bpy.ops.ed.undo_push(message="Before")
    before = counts()
    press("label", "EXEC_DEFAULT", True)
    assert bpy.context.scene.mocap_autolabel.take is not None
    bpy.ops.ed.undo()
    assert is_as_before()
    bpy.ops.ed.redo()
    assert bpy.context.scene.mocap_autolabel.take.name == "Mocap: walk"
    assert len(session().markers) == 18
    press("clear")
    assert is_as_before()


def test_a_marker_set_of_ones_own(ready, files, tmp_path):
    press("edit_markerset")
    item = next(item for item in ready.scene.objects if item.get(naming.MARKER) == "LKNE")
    item.select_set(True)
    ready.view_layer.objects.active = item
    press("reattach", segment="shank.L")
    path = tmp_path / "mine.markerset.json"
    press("save_markerset", filepath=path)
    saved = open_markerset(str(path))
    assert saved.name == "mine"
    assert saved.skeleton.segments[saved.attachment[saved.index("LKNE")]] == "shank.L"
    assert ready.scene.mocap_autolabel.subjects.markerset_path == str(path)


@pytest.mark.parametrize("there", [True, False])
def test_the_preferences_say_where_the_compiled_library_is_missing(extension, monkeypatch, there):
    monkeypatch.setattr(ours("core.kernels"), "in_use", lambda: there)
    said = []
    layout = SimpleNamespace(prop=lambda *_: None, label=lambda text, icon: said.append(text))
    ours("prefs").MocapPreferences.draw(SimpleNamespace(layout=layout), None)
    assert said == ([] if there else ["Without the compiled library NumPy does the same work, more slowly"])


def test_own_marker_sets_are_found_in_the_extensions_folder(extension, settings, made):
    prefs = ours("prefs")
    props = ours("props")
    folder = prefs.markerset_folder(create=True)
    assert folder == type(folder)(bpy.utils.extension_path_user(extension, path="markersets"))
    write_model(folder / "house.markerset.json", Model(made.markerset()))
    assert settings.subjects.markerset == "auto"
    settings.subjects.markerset = str(folder / "house.markerset.json")
    assert props.chosen_markerset(settings.subjects).name == "toy"
    write_model(folder / "annex.markerset.json", Model(made.markerset()))  # before it in the list
    assert settings.subjects.markerset == str(folder / "house.markerset.json")
    (folder / "annex.markerset.json").unlink()
    (folder / "house.markerset.json").unlink()
    with pytest.raises(ours("core.data.errors").InputError, match="is gone"):
        props.chosen_markerset(settings.subjects)


def test_labels_are_written_beside_what_they_are_of_which_nothing_replaces_and_which_may_not_change(
    ready, labelling, files, tmp_path
):
    copy, link, out = (tmp_path / f"{name}.csv" for name in ("walk", "link", "out"))
    shutil.copy(files.blobs, copy)
    link.hardlink_to(copy)
    press("import_blobs", filepath=copy)
    press("label")
    before = {path: path.read_bytes() for path in (copy, Path(files.markerset))}
    for export in ("labels", "c3d", "trc", "report"):
        for path in (*before, link):
            refused("would be written over", f"export_{export}", filepath=path)
    assert {path: path.read_bytes() for path in before} == before
    rows, source = rows_of_export(out), copy.read_text().splitlines()
    assert out.read_text().splitlines()[0] == "frame,camera,x,y,marker,step,confidence"
    assert [row[:4] for row in rows] == [row.split(",")[:4] for row in source[1:]]
    steps = ["SACR", "", "0.8"], ["LASI", "exclusive", "0.8"], ["RASI", "conflict", "0.8"]
    assert tuple(row[4:] for row in rows[:3]) == steps
    out.unlink()
    copy.write_text("\n".join(source[:-1]) + "\n")
    refused("other blobs than those that were labelled", "export_labels", filepath=out)
    assert {path.name for path in tmp_path.iterdir()} == {"walk.csv", "link.csv"}


ADDED = (
    bpy.types.Operator, bpy.types.Panel, bpy.types.UIList,
    bpy.types.PropertyGroup, bpy.types.FileHandler, bpy.types.AddonPreferences,
)  # fmt: skip


def everything():
    """What an extension can add to Blender: classes, properties, handlers, timers and commands."""
    classes = {str(cls) for kind in ADDED for cls in kind.__subclasses__() if cls.is_registered}
    properties = [kind.bl_rna.properties.keys() for kind in (bpy.types.Scene, bpy.types.WindowManager)]
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    handlers = {name: [one.__module__ for one in found] for name, found in lists.items() if isinstance(found, list)}
    return classes, properties, handlers


def test_a_register_that_fails_leaves_nothing(extension, monkeypatch):
    waiting = ours("ops.importing").look_when_free
    bpy.app.timers.register(waiting, first_interval=60)
    addon_utils.disable(extension, default_set=False)
    assert not bpy.app.timers.is_registered(waiting)
    before = everything()
    registration = sys.modules[f"{extension}.addon.registration"]

    def fail(stack):
        raise RuntimeError("no handlers today")

    monkeypatch.setattr(registration.ui, "add_handlers", fail)
    with pytest.raises(RuntimeError, match="no handlers today"):
        registration.register()
    assert everything() == before
    monkeypatch.undo()
    addon_utils.enable(extension, default_set=True)


def test_what_is_asked_for_soon_is_done_once_however_often_and_without_a_window_at_once(extension, monkeypatch):
    later, calls, there = ours("scene.later"), [], MagicMock()

    def done():
        calls.append(True)

    later.soon(done, 60)
    assert calls == [True]
    there.app.background, there.app.timers = False, bpy.app.timers
    monkeypatch.setattr(later, "bpy", there)
    for _ in range(2):
        later.soon(done, 60)
    assert calls == [True]
    assert bpy.app.timers.is_registered(done)
    for _ in range(2):
        later.never(done)
    assert not bpy.app.timers.is_registered(done)


def test_enabling_imports_neither_scipy_nor_the_command_line(extension):
    code = (
        "import sys, bpy; sys.path.insert(0, sys.argv[1]); from addon import registration; registration.register(); "
        "print([m for m in sys.modules if m.startswith(('scipy', 'ezc3d', 'c3d', 'addon.cli'))]); "
        "registration.unregister()"
    )
    root = str(sys.modules[extension].__path__[0])
    done = subprocess.run([sys.executable, "-c", code, root], capture_output=True, text=True, check=True)
    assert done.stdout.strip().splitlines()[-1] == "[]"
