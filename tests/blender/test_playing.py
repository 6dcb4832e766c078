# SPDX-License-Identifier: GPL-3.0-or-later
"""A take that plays from a file moves as with keys, keeps its size whatever its length, and tells of its file."""

import shutil
from dataclasses import fields, replace
from types import SimpleNamespace

import addon_utils
import bpy
import numpy as np
import pytest
from mathutils import Matrix

from addon.cli import main as command
from addon.core.body.bodies import BodyModel
from addon.core.data.takes import Motion, Suspect
from addon.io import poses as pose_files
from addon.io.edits import read_edits
from addon.io.markersets import open_markerset
from addon.io.points import read_points
from addon.io.poses import PoseFile
from addon.scene import playing, roots
from addon.scene import take as takes
from addon.scene.clock import plays_at, set_moment
from addon.scene.opened import Opened
from addon.scene.timing import follow_rate
from tests.inputs.walkers import FIRST, FRAMES, WORN, write_seen

from .hands import MODULE, add_object, choose, only, press, refused, session, shown


def places(collection, frames):
    """Where markers, by name, and bones are in frames that Blender counts: (F, M, 3) and (F, J, 4, 4)."""
    empties, armatures = [item for _, item in sorted(shown(collection).items())], only(collection, "ARMATURE")
    markers, bones = [], []
    for frame in frames:
        set_moment(bpy.context.scene, float(frame))
        graph = bpy.context.evaluated_depsgraph_get()
        markers.append([one.evaluated_get(graph).matrix_world.translation[:] for one in empties])
        bones.append([np.array(bone.matrix) for one in armatures for bone in one.evaluated_get(graph).pose.bones])
    return np.array(markers), np.array(bones)


def saved(context, take, folder, size=3):
    """The take saved as one that plays from a file beside it."""
    motion, folder = take.motion, folder / "out"
    folder.mkdir(parents=True)
    with PoseFile(folder.parent) as poses:
        for start in range(0, len(motion.frames), size):
            part = slice(start, start + size)
            poses.append(Motion(*(getattr(motion, field.name)[part] for field in fields(Motion))))
        markers, file = (lambda part: motion.markers[part]), {"source": "walk.csv"}
        of_take = take.rate, take.markerset, markers, poses, take.suspects
        asked = playing.Playing("walk", *of_take, file["source"], file)
        playing.show_playing(context, asked, folder / "walk.motion.pc2")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "walk.blend"))
    return folder / "walk.blend"


def opened(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))
    [collection] = playing.played_takes(bpy.context.scene)
    return collection


@pytest.fixture
def both(empty, made, tmp_path):
    """Where all is with keys, and the saved file of the same take that plays."""
    take = made.take()
    take.motion.markers[2:4, 1] = np.nan
    frames = take.motion.frames
    keyed = places(takes.show_take(empty, take), frames)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return SimpleNamespace(path=saved(bpy.context, take, tmp_path), frames=frames, keyed=keyed, take=take)


@pytest.fixture
def without_extension():
    """Disables what another test may have enabled."""
    enabled = addon_utils.check(MODULE)[1]
    addon_utils.disable(MODULE)
    yield
    if enabled:
        addon_utils.enable(MODULE, default_set=True)


def test_it_moves_as_with_keys_without_the_extension(both, without_extension):
    assert not hasattr(bpy.types.Scene, "mocap_autolabel")
    collection = opened(both.path)
    markers, bones = places(collection, both.frames)
    np.testing.assert_allclose(markers, both.keyed[0], atol=1e-6)
    np.testing.assert_allclose(bones, both.keyed[1], atol=2e-6)
    assert np.ptp(markers, axis=0).max() > 0.01  # or nothing was tried
    scene = bpy.context.scene
    assert (scene.frame_start, scene.frame_end) == (both.frames[0], both.frames[-1])
    assert not bpy.data.actions
    assert not takes.is_take(collection)


def test_at_another_rate_it_plays_at_its_own_speed(both):
    collection, scene = opened(both.path), bpy.context.scene
    for fps in (24, 120):
        scene.render.fps, scene.render.fps_base = fps, 1
        assert follow_rate(scene) == []
        clock = playing.clock_of(collection)
        assert clock.step == pytest.approx(fps / both.take.rate)
        assert [scene.frame_start, scene.frame_end] == [clock.whole(both.frames[end]) for end in (0, -1)]
        markers, bones = places(collection, clock.shown(both.frames))
        np.testing.assert_allclose(markers, both.keyed[0], atol=1e-4)
        np.testing.assert_allclose(bones, both.keyed[1], atol=1e-4)
    takes.show_take(bpy.context, replace(both.take, name="next", rate=50.0))
    assert plays_at(scene, 50.0), "nobody else's is in it"


def test_one_that_begins_later_than_blender_counts_in_its_own_frames_plays_all_the_same(empty, made, tmp_path):
    take, scene = made.take(), empty.scene
    rows = replace(take.rows, frames=take.rows.frames + 300_000)
    take = replace(take, rate=100.0, rows=rows, motion=replace(take.motion, frames=take.motion.frames + 300_000))
    add_object("rig", bpy.data.armatures.new("rig"))
    scene.render.fps = 24
    collection = opened(saved(empty, take, tmp_path))
    clock, modifier = playing.clock_of(collection), playing.modifier_of(collection)
    assert (clock.start, clock.step) == (1, pytest.approx(0.24))
    assert modifier.frame_start == pytest.approx(clock.start / clock.step)


def test_it_follows_its_root_and_so_does_a_part_of_it(both):
    collection, place = opened(both.path), Matrix.LocRotScale((3, -1, 0.5), Matrix.Rotation(1.0, 3, "Z"), (2, 2, 2))
    root = roots.root_of(collection)
    root.matrix_world = place
    markers, bones = places(collection, both.frames)
    expected = np.array(place)
    np.testing.assert_allclose(markers, both.keyed[0] @ expected[:3, :3].T + expected[:3, 3], atol=1e-5)
    np.testing.assert_allclose(bones, both.keyed[1], atol=2e-6)  # in the armature
    [armature] = only(collection, "ARMATURE")
    np.testing.assert_allclose(np.array(armature.matrix_world), expected, atol=1e-6)
    part = takes.show_take(bpy.context, both.take)
    roots.put_where(part, collection)
    assert roots.root_of(part).matrix_world == root.matrix_world


def test_its_feet_are_on_the_ground_as_with_keys_across_the_parts_of_the_file(empty, made, tmp_path, monkeypatch):
    monkeypatch.setattr(playing, "SETTLED_FRAMES", 1)
    markerset = open_markerset("body26")
    take = made.take(60, markerset=markerset)
    frames = take.motion.frames
    model, sway = BodyModel(markerset), np.sin(np.arange(len(frames)) / 9)
    bodies = model.rest(len(frames), 1.7)
    bodies.translation[:] = np.column_stack([0.004 * sway, 0.006 * sway, np.full(len(frames), -0.035)])
    posed = model.pose(bodies)
    parts = {"joints": posed.joints, "rotations": posed.rotations, "expected": posed.markers, "scale": bodies.scale}
    motion = replace(take.motion, markers=posed.markers, confidence=np.ones(len(frames)), **parts)
    take = replace(take, motion=motion, suspects=())
    collection = takes.show_take(empty, take)
    [armature] = only(collection, "ARMATURE")
    feet = [armature.pose.bones.find(f"foot.{side}") for side in "LR"]
    tails = np.array([armature.data.bones[at].length for at in feet])
    assert all(armature.data.bones[at].tail_local.z < 0.025 for at in feet), "below the floor as they are posed"
    keyed = places(collection, frames)[1]
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    _, bones = places(opened(saved(bpy.context, take, tmp_path)), frames)
    np.testing.assert_allclose(bones, keyed, atol=1e-4)
    # A bone goes along its own y axis.
    now = bones[:, feet][..., :3, 3] + tails[:, None] * bones[:, feet][..., :3, 1]
    assert np.ptp(now, axis=0).max() < 1e-4 < np.ptp(posed.joints[:, 0], axis=0).max()
    assert now[..., 2].min() > -1e-4


def test_the_file_is_there_when_saved_elsewhere_told_of_when_not_and_found_again(both, tmp_path):
    opened(both.path)
    (tmp_path / "other").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "other" / "again.blend"))
    collection = opened(tmp_path / "other" / "again.blend")
    markers, _ = places(collection, both.frames)
    np.testing.assert_allclose(markers, both.keyed[0], atol=1e-6)
    assert playing.what_is_wrong(collection) == ""
    motion = playing.motion_path(collection)
    elsewhere = tmp_path / "elsewhere.pc2"
    shutil.move(motion, elsewhere)
    assert "is not there" in playing.what_is_wrong(collection)
    playing.find_motion(collection, elsewhere)
    assert playing.what_is_wrong(collection) == ""
    markers, _ = places(collection, both.frames)
    np.testing.assert_allclose(markers, both.keyed[0], atol=1e-6)
    with elsewhere.open("r+b") as file:
        file.truncate(100)
    assert "is shorter" in playing.what_is_wrong(collection)


def test_the_sidebars_operators_step_through_so_many_that_are_kept_and_find(extension, both, tmp_path, monkeypatch):
    monkeypatch.setattr(playing, "MOST_SUSPECTS", 2)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    suspects, folder = (Suspect(4, 9, "long"), Suspect(5, 5, "short"), Suspect(2, 3, "middling")), tmp_path / "more"
    collection = opened(saved(bpy.context, replace(both.take, suspects=suspects), folder))
    assert [tuple(row) for row in playing.suspects_of(collection)] == [(2, 3, "middling"), (4, 9, "long")]
    scene = bpy.context.scene
    scene.frame_set(1)
    press("next_suspect")
    assert scene.frame_current == 2
    press("next_suspect")
    assert scene.frame_current == 4
    assert bpy.ops.mocap_autolabel.next_suspect() == {"CANCELLED"}
    press("next_suspect", back=True)
    assert scene.frame_current == 2
    playing.modifier_of(collection).filepath = "//gone/walk.motion.pc2"
    assert "is not there" in playing.what_is_wrong(collection)
    press("find_motion")
    assert playing.what_is_wrong(collection) == ""
    shutil.move(folder / "out" / "walk.motion.pc2", folder / "hidden.pc2")
    refused("not beside the Blender file", "find_motion")
    refused("plays from a file and has no keys", "fill_gaps")


@pytest.fixture
def long(extension, tmp_path, monkeypatch):
    """Saves a take of two people as one too long for keys, and opens it: `long("points")` or `long("blobs")`."""
    write_seen(tmp_path)

    def opened_take(kind, *words):
        who = () if "--subject" in words else ("--model", WORN)
        monkeypatch.setattr(pose_files, "MOST_KEYS", 100)
        source = ["pair.c3d"] if kind == "points" else ["seen.csv", "--cameras", "room.toml"]
        monkeypatch.chdir(tmp_path)  # where the names of files begin
        assert command(["label", *source, *who, "--blend", "--out", "out", *words]) == 0
        monkeypatch.chdir(tmp_path.parent)
        return opened(tmp_path / "out" / f"{'pair' if kind == 'points' else 'seen'}.blend")

    return opened_take


@pytest.mark.parametrize("kind", ["points", "blobs"])
def test_a_part_is_opened_with_keys_and_corrected(long, kind, tmp_path):
    """What was said of it is saved beside the take, whose next labelling follows it."""
    collection = long(kind, "--subjects", "2")
    scene = bpy.context.scene
    first, last = FIRST + 10, FIRST + 19
    written = read_points(next((tmp_path / "out").glob("*.c3d")))
    known = written.xyz[10, [written.names.index(name) for name in sorted(shown(collection))]]
    seen = places(collection, [first])[0][0]
    np.testing.assert_allclose(np.where(np.isnan(known), known, seen), known, atol=1e-5)
    scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end = True, first, last
    played = scene.frame_start, scene.frame_end
    press("open_part", first=first, last=last)
    settings = scene.mocap_autolabel
    stored = Opened().take(settings.take, scene)
    assert stored.motion.frames.tolist() == list(range(first, last + 1))
    assert [one.name for one in stored.performers] == ["1", "2"]
    assert stored.labels.named.mean() > 0.9
    assert (scene.frame_start, scene.frame_end) == played
    assert collection.hide_viewport
    assert not settings.take.hide_viewport
    # Label, from here on, labels the same frames in the same way.
    asked, worn = settings.labelling, settings.subjects
    assert (asked.use_range, asked.range_first, asked.range_last) == (True, first, last)
    assert (settings.source.first_frame, settings.source.last_frame) == (FIRST, FIRST + FRAMES - 1)
    assert (worn.performing, worn.performer_count, worn.markerset) == ("SO_MANY", 2, WORN)
    before = stored.labels.marker.copy()
    press("label")
    assert (Opened().take(settings.take, scene).labels.marker == before).all()
    scene.frame_set(first + 3)
    choose("1:LKNE", "1:LANK")
    press("swap_markers", scope="RANGE")
    press("save_corrections")
    assert [edit.frames for edit in read_edits(next(tmp_path.glob("*.edits.json")))] == [(first, last)]
    # Another part comes beside it, and knows of them.
    press("open_part", first=first + 5, last=last + 10)
    assert Opened().take(settings.take, scene).motion.frames.tolist() == list(range(first, last + 11))
    assert len(session().corrections) == 1


def test_who_was_asked_for_by_name_is_so_in_a_part(long):
    long("points", "--subject", f"ann={WORN}", "--subject", f"bob={WORN}", "--target", "0.99")
    scene = bpy.context.scene
    scene.frame_set(FIRST + 20)
    bpy.ops.ed.undo_push(message="Opened")
    press("open_part", "EXEC_DEFAULT", True)
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert (scene.mocap_autolabel.take, scene.mocap_autolabel.source.points_path) == (None, "")
    bpy.ops.ed.redo()
    scene = bpy.context.scene
    settings = scene.mocap_autolabel
    assert [(row.name, row.markerset) for row in settings.subjects.performers] == [("ann", WORN), ("bob", WORN)]
    assert settings.labelling.target == pytest.approx(0.99)
    stored = Opened().take(settings.take, scene)
    assert len(stored.motion.frames) == FRAMES  # five seconds to either side are more than there is
    assert {name.partition(":")[0] for name in stored.names} == {"ann", "bob"}


def test_what_a_part_on_its_own_says_otherwise_is_listed(long, tmp_path):
    """Against the labels of the whole take beside the file; where these are gone nothing is listed."""
    long("points", "--subjects", "2")
    labels = tmp_path / "out" / "pair.labels.csv"
    lines = labels.read_text().splitlines()
    for at, line in enumerate(lines):
        if line.split(",")[2] == "1:LKNE" and FIRST + 5 <= int(line.split(",")[0]) < FIRST + 9:
            lines[at] = line.replace("1:LKNE", "")
    labels.write_text("\n".join(lines) + "\n")
    press("open_part", first=FIRST + 2, last=FIRST + 30)
    rows = session().changes
    assert [(row.name, row.first) for row in rows] == [("1:LKNE", FIRST + 5)]
    assert "is named now" in rows[0].words
    labels.unlink()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out" / "pair.blend"))
    press("open_part", first=FIRST + 2, last=FIRST + 30)
    assert not session().changes


def test_the_part_here_is_what_is_to_be_looked_at_or_the_preview_range(both, monkeypatch):
    collection, scene = opened(both.path), bpy.context.scene
    scene.render.fps, scene.render.fps_base = 50, 1.0
    monkeypatch.setattr(playing, "OPENED_AROUND", 0.1)
    scene.frame_set(104)
    assert [row[:2] for row in playing.suspects_of(collection)] == [(104, 105), (110, 112)]
    assert playing.part_here(collection, scene) == (99, 110)
    scene.frame_set(107)
    assert playing.part_here(collection, scene) == (102, 112)
    scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end = True, 103, 118
    assert playing.part_here(collection, scene) == (103, 118)
    scene.frame_preview_end = 105
    assert playing.part_here(collection, scene) == (99, 109)


def test_what_cannot_be_opened_is_told_and_nothing_changes(long, tmp_path):
    collection = long("points", "--subjects", "2")
    scene = bpy.context.scene
    refused(r"take pair has none of frames 900–950; expected some of 7 to 46", "open_part", first=900, last=950)
    (tmp_path / "pair.c3d").rename(tmp_path / "elsewhere.c3d")
    refused(r"pair\.c3d: there is no such file", "open_part")
    assert not scene.mocap_autolabel.source.points_path
    assert not collection.hide_viewport
    # `pair.c3d` beside the Blender file is what was made of the take, and not the take.
    assert (tmp_path / "out" / "pair.c3d").exists()
    found = str(tmp_path / "elsewhere.c3d")
    press("open_part", first=FIRST, last=FIRST + 9, filepath=found)
    assert scene.mocap_autolabel.source.points_path == found
    assert scene.mocap_autolabel.source.up_found == "As the File Says"
