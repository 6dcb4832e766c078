# SPDX-License-Identifier: GPL-3.0-or-later
"""A take in a scene of another rate: mapped to it, moved to nobody's harm from one to the other, and never off by one.

What is said in a moment of the scene is said of the frame of the take that is nearest, and what is written has the
take's own frames.
"""

from dataclasses import astuple, replace
from itertools import pairwise
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core.data.takes import NO_MARKER
from addon.core.geometry.force_plates import ForcePlate, LabRecords
from addon.io.edits import read_edits
from addon.io.markersets import open_markerset
from addon.io.points import read_points
from addon.scene import lab, storage
from addon.scene.clock import TakeClock, plays_at, set_moment
from addon.scene.opened import Opened
from addon.scene.ownership import curves_of
from addon.scene.stored import Stored
from addon.scene.take import show_take, takes_of
from addon.scene.timing import follow_rate
from scripts.keep_version import EARLIER
from tests.inputs.rigs import mixamo

from .conftest import label_walk, open_room, write_room, write_walk_and_ghost
from .hands import FRAMES, GHOST, add_object, choose, keys_of, ours, press, reopen, session, shown, stored_take
from .test_points import visible_points
from .test_retarget import retargeted

FPS = 24
RATES = (100.0, 120.0, 12.5)


@pytest.mark.parametrize("rate", [24.0, 25.0, 59.94, 100.0, 240.0, 10.0])
def test_every_frame_is_found_again_in_the_moment_in_which_it_is_shown(rate):
    frames = np.arange(-3, 20_000)
    clock = TakeClock.of(frames + 500, start=1).at_rate(FPS, rate)
    moments = clock.shown(frames + 497).astype(np.float32)  # as keys and properties keep them
    assert [clock.at(float(one)) for one in moments[::37]] == (frames + 497)[::37].tolist()
    assert clock.shown(clock.first) == 1
    # Each frame is in one of Blender's frames, which it is nearest to.
    spans = [clock.inside(one, one) for one in range(-5, 900)]
    assert all(before[1] + 1 == after[0] for before, after in pairwise(spans))
    for whole, (first, last) in zip(range(-5, 900), spans, strict=True):
        assert {clock.whole(frame) for frame in range(first, last + 1)} <= {whole}


@pytest.fixture(params=RATES)
def mapped(request, tmp_path, name_as, extension, empty) -> SimpleNamespace:
    """The take of points labelled in a scene that plays FPS frames a second, in which a rig waits."""
    files, scene = write_walk_and_ghost(tmp_path, rate=request.param), empty.scene
    add_object("rig", bpy.data.armatures.new("rig"))
    scene.render.fps, scene.frame_start, scene.frame_end = FPS, 5, 80
    name_as(np.where(np.arange(GHOST + 1) == GHOST, NO_MARKER, np.arange(GHOST + 1)))
    label_walk(tmp_path)
    return SimpleNamespace(rate=request.param, scene=scene, **vars(files))


def is_where_it_was(mapped):
    """Asserts that all of the take is seen in every moment of it as it was recorded."""
    stored = stored_take()
    for index, frame in enumerate(stored.motion.frames):
        stored.clock.go_to(bpy.context.scene, int(frame))
        assert stored.index_of(bpy.context.scene.frame_float) == index
        assert visible_points() == 1, "the ghost"
        for marker, name in enumerate(stored.names):
            if np.isfinite(mapped.xyz[index, marker, 0]):
                place = shown()[name].matrix_world.translation
                np.testing.assert_allclose(place, mapped.xyz[index, marker], atol=2e-4)


def test_a_scene_of_a_persons_keeps_its_time_and_the_take_its_speed(mapped):
    scene, clock = mapped.scene, stored_take().clock
    assert (scene.render.fps, scene.frame_start, scene.frame_end) == (FPS, 5, 80)
    assert astuple(clock) == (101, 101, FPS / mapped.rate)
    assert keys_of("C7")[:, 0].max() <= 101 + (FRAMES - 1) * FPS / mapped.rate + 1e-3
    is_where_it_was(mapped)
    reopen(mapped.folder / "mapped.blend")
    is_where_it_was(mapped)


def test_what_is_said_in_a_moment_is_said_of_the_frame_that_is_nearest(mapped):
    scene, clock = mapped.scene, stored_take().clock
    set_moment(scene, 103)
    frame = clock.at(103)
    assert abs(clock.shown(frame) - 103) <= clock.step / 2
    choose("C7")
    press("unlabel", scope="FRAME")
    scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end = True, 105, 106
    choose("SACR")
    press("unlabel", scope="RANGE")
    spans = [edit.span for edit in stored_take().edits]
    assert spans == [(frame, frame), clock.inside(105, 106)]
    assert scene.frame_float == 103, "no edit moves the time"
    keyed = keys_of("SACR")[:, 0]
    assert not ((keyed > 104.5) & (keyed < 106.5)).any()
    assert np.abs(keys_of("C7")[:, 0] - clock.shown(frame)).min() > 0.9 * clock.step
    press("save_corrections")
    assert [edit.span for edit in read_edits(mapped.edits)] == spans
    press("label")
    assert [edit.span for edit in stored_take().edits] == spans
    assert stored_take().clock == clock


def test_a_range_that_was_picked_has_its_own_frames_and_no_others(mapped):
    scene, clock = mapped.scene, stored_take().clock
    press("timeline_pick", marker="C7", first=113, last=116)
    choose("C7")
    press("unlabel", scope="RANGE")
    clock.go_to(scene, 115)
    press("play_as_take")
    assert (scene.frame_float, scene.frame_preview_start, scene.frame_preview_end) == (115, 113, 116)
    scene.render.fps, scene.render.fps_base = FPS, 1
    press("follow_rate")
    assert stored_take().source_frame(scene.frame_float) == 115
    choose("SACR")
    press("unlabel", scope="RANGE")
    scene.frame_preview_start = scene.frame_preview_end = 104  # where a slow take has none, the nearest is meant
    first, last = clock.inside(104, 104)
    choose("LASI")
    press("unlabel", scope="RANGE")
    here = (first, last) if first <= last else (clock.at(104), clock.at(104))
    assert [edit.span for edit in stored_take().edits] == [(113, 116), (113, 116), here]


def test_what_a_person_chose_by_following_stays_when_it_is_labelled_again(labelled):
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = FPS, 1
    press("follow_rate")
    clock = stored_take().clock
    clock.go_to(scene, 115)
    before = clock, scene.render.fps, scene.frame_start, scene.frame_end, scene.frame_float
    assert clock.step < 1
    press("label")
    assert (stored_take().clock, scene.render.fps, scene.frame_start, scene.frame_end, scene.frame_float) == before


def test_a_take_that_blender_cannot_map_is_left_as_it_is_and_named(empty, made):
    assert not TakeClock.of(np.arange(900_000)).at_rate(60, 50).fits(899_999), "beyond the last frame"
    assert not TakeClock.of(np.arange(900_000, 900_100)).at_rate(24, 1000).fits(900_099), "nearer than is told apart"
    scene, take = empty.scene, replace(made.take(), rate=240.0)
    shown = show_take(empty, take)
    before = keyed(shown)
    scene.render.fps, scene.render.fps_base = 2, 1
    assert shown.name in follow_rate(scene)
    assert (read(shown).clock.step, keyed(shown)) == (1, before)
    add_object("rig", bpy.data.armatures.new("rig"))
    other = show_take(empty, replace(take, name="other"))
    assert (read(other).clock.step, keyed(other)) == (1, before)


def keyed(collection) -> list[float]:
    item = next(iter(shown(collection).values()))
    return [key.co[0] for key in curves_of(item)[0].keyframe_points]


def test_keys_are_moved_once_wherever_takes_lie(empty, made):
    scene = empty.scene
    slow, fast = (show_take(empty, replace(made.take(name=f"{rate}"), rate=rate)) for rate in (50.0, 120.0))
    scene.collection.children.unlink(fast)
    slow.children.link(fast)
    scene.collection.children.link(fast.copy())
    scene.render.fps, scene.render.fps_base = FPS, 1
    assert follow_rate(scene) == []
    first, last = keyed(fast)[0], keyed(fast)[-1]
    assert last - first == pytest.approx((len(keyed(fast)) - 1) * FPS / 120, abs=0.5)


@pytest.mark.parametrize(("rate", "moments"), [(90.0, range(1, 54)), (24.0, np.arange(1, 20, 0.3).tolist())])
def test_the_points_are_those_of_the_frame_that_is_picked(empty, rate, moments):
    scene, frames = empty.scene, np.arange(1, 200)
    scene.render.fps = FPS
    clock = TakeClock.of(frames).at_rate(FPS, rate)
    item = storage.add_cloud(scene.collection, storage.cloud_table("x", frames, np.outer(frames, [1, 0, 0])), clock)
    for moment in moments:
        set_moment(scene, moment)
        shown = item.evaluated_get(empty.evaluated_depsgraph_get()).evaluated_geometry()
        places = shown.pointcloud.attributes["position"].data
        assert [round(one.vector.x) for one in places] == [clock.at(scene.frame_float)]


def test_the_lists_lead_to_the_very_frame(mapped):
    state, stored = session(), stored_take()
    row = next(row for row in state.markers if row.gaps)
    index = stored.names.index(row.name)
    press("jump", frame=row.first_gap, marker=row.name)
    at = stored.index_of(bpy.context.scene.frame_float)
    assert at == np.flatnonzero(~np.isfinite(stored.motion.markers[:, index, 0]))[0]
    press("timeline_pick", marker=row.name, first=113, last=113)
    assert stored.source_frame(bpy.context.scene.frame_float) == 113
    press("next_trouble")
    trouble = ours("scene.trouble").trouble_of(bpy.context.scene.mocap_autolabel.take, bpy.context.scene)
    now = stored.source_frame(bpy.context.scene.frame_float)
    assert any(first <= now <= last for one in trouble for first, last in one.spans)


def test_what_is_written_has_the_takes_own_rate_and_frames(mapped, tmp_path):
    press("fill_gaps", extent="TAKE")
    written = [tmp_path / "mapped.c3d", tmp_path / "frame by frame.c3d"]
    for path in written:
        press("export_c3d", filepath=path)
        press("play_as_take")
    take = read_points(written[0])
    assert (take.rate, take.first_frame, len(take.xyz)) == (mapped.rate, 101, FRAMES)
    assert written[0].read_bytes() == written[1].read_bytes()


def test_there_and_back_again_nothing_is_another(mapped):
    scene, before = mapped.scene, keys_of("C7")
    set_moment(scene, 103)
    kinds, correct = ours("core.edits.kinds"), ours("ops.correcting").correct
    place = kinds.Place("C7", stored_take().source_frame(103), (0.5, 0.25, 1.25))
    correct(bpy.context, stored_take().edits.added(place, kinds.UnlabelMarker("LASI", frames=(110, 112))))
    press("fill_gaps", extent="TAKE")
    edited = keys_of("C7")
    bpy.ops.ed.undo_push(message="Before")
    press("play_as_take")
    assert astuple(stored_take().clock) == (101, 101, 1.0)
    assert (scene.frame_start, scene.frame_end) == (101, 130)
    assert (keys_of("C7")[:, 0] % 1 == 0).all(), "frame by frame they are whole"
    fills = session().fills
    assert [(row.first, row.last) for row in fills] == [(one.first, one.last) for one in stored_take().fills] != []
    spans = [edit.span for edit in stored_take().edits]
    scene.render.fps, scene.render.fps_base = FPS, 1
    timing, take = ours("scene.timing"), scene.mocap_autolabel.take
    assert timing.is_timed_otherwise(scene, take)
    press("follow_rate")
    assert not timing.is_timed_otherwise(scene, take)
    assert (scene.frame_start, scene.frame_end) == (101, stored_take().clock.whole(130)), "what it played"
    np.testing.assert_array_equal(keys_of("C7"), edited)
    assert [edit.span for edit in stored_take().edits] == spans
    assert ours("scene.ownership").is_keyed_by_us(shown()["C7"]), "whose keys they are is known as before"
    bpy.ops.ed.undo_push(message="There and back")
    scene.render.fps = 30
    press("follow_rate")
    bpy.ops.ed.undo_push(message="Other")
    bpy.ops.ed.undo()
    assert stored_take().clock.step == pytest.approx(FPS / mapped.rate)
    np.testing.assert_array_equal(keys_of("C7"), edited)
    correct(bpy.context, kinds.NO_EDITS)
    press("take_back_fills", extent="TAKE")
    np.testing.assert_allclose(keys_of("C7"), before, atol=1e-6)


def read(collection) -> Stored:
    return Opened().take(collection, bpy.context.scene)


def test_two_takes_of_two_rates_play_each_at_its_own_speed(empty, made):
    scene, fast = empty.scene, replace(made.take(name="fast"), rate=120.0)
    for take in (replace(made.take(name="slow"), rate=50.0), fast):
        show_take(empty, take)
        assert plays_at(scene, take.rate), "nobody's time is kept: the scene plays what was opened last"
    slow, fast = takes_of(scene)
    assert [read(one).clock.step for one in (slow, fast)] == [pytest.approx(2.4), 1.0]
    for seconds in (0, 5 / 50, 10 / 50):
        set_moment(scene, 101 + seconds * 120)
        for one, rate in ((slow, 50), (fast, 120)):
            stored, marker = read(one), shown(one)["C7"]
            index = stored.index_of(scene.frame_float)
            assert index == (-1 if seconds * rate > 19 else round(seconds * rate))
            if index >= 0:
                place = marker.matrix_world.translation
                np.testing.assert_allclose(place, stored.motion.markers[index, stored.words["C7"]], atol=1e-4)


@pytest.mark.parametrize("waits", [False, True])
def test_events_are_and_forces_push_as_they_did_whatever_the_scene_played_between(empty, made, waits):
    scene, take = empty.scene, replace(made.take(), rate=100.0)
    frames = take.motion.frames
    force = np.stack([40 * np.sin(frames), 30 * np.cos(frames), 700 + 10.0 * (frames - 101)], axis=1)
    place = np.stack([0.01 * (frames - 101), np.full(len(frames), 0.2), np.zeros(len(frames))], axis=1)
    place[8:12] = np.nan  # nobody stands there
    plate = ForcePlate(np.array([[0.5, 0, 0], [0.5, 0.4, 0], [0, 0.4, 0], [0, 0, 0]]), force, place)
    if waits:  # somebody's, whose scene keeps its time: the take is mapped to that
        add_object("rig", bpy.data.armatures.new("rig"))
    events = ("Foot Strike", 107.0), ("Foot Off", 111.0)
    show_take(empty, replace(take, lab=LabRecords(events=events, plates=(plate,), first=101)))
    [collection] = takes_of(scene)
    [arrow] = [one for one in collection.all_objects if (one.empty_display_type, one.type) == ("SINGLE_ARROW", "EMPTY")]
    scene.timeline_markers["Foot Off"].frame += 1
    off = scene.timeline_markers["Foot Off"].frame
    for fps in (None, 25, 59.94, 100):
        if fps is not None:
            scene.render.fps, scene.render.fps_base = round(fps), round(fps) / fps
            follow_rate(scene)
        stored, step = read(collection), scene.render.fps / scene.render.fps_base / 100
        found = {one.name: one.frame for one in scene.timeline_markers}
        assert found == {"Foot Strike": 101 + round(6 * step), "Foot Off": off}, "one is a person's by now"
        for index, frame in enumerate(frames):
            set_moment(scene, stored.clock.shown(int(frame)))
            turned = np.array(arrow.matrix_world)
            push = 1000 * turned[:3, 2]
            nobody = np.isnan(place[index, 0])
            np.testing.assert_allclose(push, 0 if nobody else force[index], rtol=1e-3, atol=0.5)
            np.testing.assert_allclose(turned[:3, 3], plate.corners.mean(axis=0) if nobody else place[index], atol=1e-4)
    lab.forget_events(collection)
    assert [one.name for one in scene.timeline_markers] == ["Foot Off"]


@pytest.mark.parametrize("version", sorted(path.name for path in EARLIER.iterdir() if (path / "takes.blend").is_file()))
def test_what_earlier_versions_saved_is_frame_by_frame_and_can_follow(empty, version):
    bpy.ops.wm.open_mainfile(filepath=str(EARLIER / version / "takes.blend"))
    bpy.context.window.scene = scene = bpy.data.scenes["points"]
    bpy.context.view_layer.update()
    [take] = takes_of(scene)
    before = read(take)
    assert before.clock.step == 1
    seen = {}
    for fps in (before.rate, 24.0, before.rate):
        scene.render.fps, scene.render.fps_base = round(fps), round(fps) / fps
        assert follow_rate(scene) == []
        stored = read(take)
        assert stored.clock.shown(stored.motion.frames[0]) == before.clock.shown(before.motion.frames[0])
        for frame in stored.motion.frames[::4].tolist():
            stored.clock.go_to(scene, frame)
            here = [visible_points(), *[item.matrix_world.translation[:] for item in shown(take).values()]]
            assert stored.source_frame(scene.frame_float) == frame
            points, *places = seen.setdefault(frame, here)
            assert here[0] == points
            np.testing.assert_allclose(here[1:], places, atol=2e-4)


def test_blobs_are_mapped_by_the_rate_that_a_person_says(extension, empty, tmp_path):
    files, scene = write_room(tmp_path, 10), empty.scene
    add_object("rig", bpy.data.armatures.new("rig"))
    scene.render.fps = FPS
    open_room(files)  # whose rate is said afterwards
    source, shown_now = scene.mocap_autolabel.source, ours("ui.overlay").shown
    for rate in (60.0, 120.0):
        source.rate = rate
        stored = shown_now(scene)
        assert stored.clock.step == pytest.approx(FPS / rate)
        stored.clock.go_to(scene, 105)
        assert stored.index_of(scene.frame_float) == 105 - stored.motion.frames[0]
    press("play_as_take")
    assert (shown_now(scene).clock.step, scene.render.fps) == (1.0, 120)


def test_what_waits_to_be_labelled_takes_the_range_along_and_keeps_the_rate_it_followed(extension, empty, tmp_path):
    scene, said = empty.scene, []
    open_room(write_room(tmp_path, 10))
    scene.render.fps, scene.render.fps_base = FPS, 1
    press("follow_rate")
    stored = ours("ui.overlay").shown(scene)
    assert [scene.frame_start, scene.frame_end] == [stored.clock.whole(end) for end in stored.motion.frames[[0, -1]]]
    scene.mocap_autolabel.source.rate = 120.0
    assert (scene.render.fps, ours("ui.overlay").shown(scene).clock.step) == (FPS, pytest.approx(FPS / 120))
    preview = scene.mocap_autolabel.source.preview
    row = SimpleNamespace(label=lambda text, icon: said.append(text), operator=lambda name, **_: said.append(name))
    for key in ("mocap_step", "mocap_rate"):
        del preview[key]
    ours("ui.panels")._draw_rates(SimpleNamespace(row=lambda align: row), scene, preview, 60.0)
    assert said == [f"The scene plays {FPS} Hz", "mocap_autolabel.play_as_take"], "a file older than mapping has none"


def test_a_shot_keeps_its_frames_and_rate_and_what_begins_with_it_is_right(extension, empty, files, name_as, capfd):
    scene, played = empty.scene, (FPS, 1001, 1100)
    scene.render.fps, scene.frame_start, scene.frame_end = played
    name_as(np.where(np.arange(GHOST + 1) == GHOST, NO_MARKER, np.arange(GHOST + 1)))
    label_walk(files.folder)
    assert "it is at frames 101–113, and the scene keeps its own, from 1001 on" in capfd.readouterr().out
    assert (scene.render.fps, scene.frame_start, scene.frame_end, scene.frame_current) == (*played, 101)
    press("export_c3d", filepath=files.folder / "at 101.c3d")
    press("clear")
    press("import_points", filepath=files.take, at_1=True)
    press("label")
    clock = stored_take().clock
    assert (clock.first, clock.start, scene.frame_current, keys_of("C7")[0, 0]) == (101, 1001, 1001, 1001)
    press("export_c3d", filepath=files.folder / "at 1001.c3d")
    written = [(files.folder / f"at {start}.c3d").read_bytes() for start in (101, 1001)]
    assert written[0] == written[1]
    clock.go_to(scene, 115)
    choose("C7")
    press("unlabel", scope="FRAME")
    press("label")
    assert [edit.span for edit in stored_take().edits] == [(115, 115)]
    assert (scene.render.fps, scene.frame_start, scene.frame_end) == played
    press("play_as_take")
    assert (scene.frame_start, scene.frame_end, stored_take().clock.step) == (1001, 1030, 1.0)
    press("clear")
    press("import_points", filepath=files.take)
    assert (scene.frame_start, scene.frame_end) == (101, 130), "what the button gave it is no person's any more"


def test_in_a_shot_events_and_rigs_go_with_the_take(empty, made, extension):
    scene = empty.scene
    scene.frame_start, scene.frame_end = 1001, 1100
    take = replace(made.take(24, markerset=open_markerset("body26")), rate=float(FPS), clock=TakeClock(101, 1001))
    scene.mocap_autolabel.take = show_take(
        empty, replace(take, lab=LabRecords(events=(("Foot Strike", 107.0),), first=101))
    )
    assert [one.frame for one in scene.timeline_markers] == [1007]
    rig = mixamo()
    action = retargeted(rig)
    assert tuple(action.frame_range) == (1001, 1024)
    assert (scene.frame_start, scene.frame_end) == (1001, 1100)
