# SPDX-License-Identifier: GPL-3.0-or-later
"""From anonymous 3D points to named markers with the extension's own operators: seen, labelled, reviewed, written."""

from dataclasses import replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core.data.takes import NO_MARKER
from addon.core.points.models import USUAL_TARGET
from addon.io.c3d.file import C3dFile
from addon.io.c3d.lab import read_lab
from addon.io.markersets import open_markerset
from addon.io.points import read_points, write_trc
from addon.scene import naming
from addon.scene.cameras import camera_name
from addon.scene.ownership import curves_of
from tests.io.c3d_layouts import DEC, Layout
from tests.io.kept import otherwise
from tests.io.qtm_file import Recording, Trajectory, write_qtm
from tests.io.samples import tsv

from .conftest import rows_of_export, write_room, write_walk
from .hands import add_object, keys_of, only, ours, press, refused, session, shown, stored_take

GHOSTS = 2
MOTIVE = """Format Version,1.23,Take Name,walk,Export Frame Rate,100.000000,Length Units,Meters
,Type,Marker,Marker,Marker
,Name,Unlabeled 1,Unlabeled 1,Unlabeled 1
,ID,1,1,1
,,Position,Position,Position
Frame,Time (Seconds),X,Y,Z
7,0.07,0.1,1.2,0.3
8,0.08,0.1,1.25,0.3
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory, made):
    """A take of a person whose markers have no names, shuffled, with ghosts; as C3D, TRC and among other kinds."""
    markerset, folder, rng = made.markerset(), tmp_path_factory.mktemp("points"), np.random.default_rng(3)
    markers = made.motion(markerset, 30).markers
    xyz = np.concatenate([markers, np.tile(rng.uniform(-2, 2, (GHOSTS, 3)), (30, 1, 1))], axis=1)
    order = rng.permutation(xyz.shape[1])
    write_room(folder, 6)
    files = write_walk(folder, xyz[:, order], markerset, 59.94)
    write_trc(folder / "walk.trc", read_points(files.take))
    (folder / "motive.csv").write_text(MOTIVE)
    files.truth = np.where(order < len(markerset), order, NO_MARKER)
    return files


@pytest.fixture
def imported(extension, empty, files):
    press("import_points", filepath=files.folder / "walk.c3d")
    press("open_markerset", filepath=files.markerset)
    return empty


@pytest.fixture
def naming_known(name_as, files):
    name_as(files.truth)


def visible_points() -> int:
    """How many points all clouds of the scene show in the current frame."""
    shown = bpy.context.evaluated_depsgraph_get()
    clouds = [item for item in bpy.context.scene.objects if item.modifiers and not item.hide_viewport]
    sets = [item.evaluated_get(shown).evaluated_geometry() for item in clouds]
    return sum(len(made.pointcloud.points) for made in sets if made.pointcloud is not None)


@pytest.mark.parametrize("strip", [False, True])
def test_a_scene_that_a_person_animates_keeps_its_time_until_the_button_is_pressed(extension, empty, files, strip):
    scene = empty.scene
    if strip:
        scene.sequence_editor_create().strips.new_scene("mine", bpy.data.scenes.new("other"), 1, 1)
    else:
        add_object("mine").keyframe_insert("location", frame=1)
    scene.render.fps, scene.frame_start, scene.frame_end = 24, 5, 80
    words = ours("ops.importing").take_points(empty, files.folder / "walk.c3d")
    assert "the scene keeps its 24 frames a second, and the take is mapped to them" in words
    assert (scene.render.fps, scene.frame_start, scene.frame_end) == (24, 5, 80)
    assert scene.frame_current == 101
    press("play_as_take")
    assert scene.render.fps / scene.render.fps_base == pytest.approx(59.94)
    assert (scene.frame_start, scene.frame_end) == (101, 130)


def test_a_take_begins_at_frame_1_by_choice_and_its_files_keep_their_numbers(naming_known, extension, empty, files):
    scene, source = empty.scene, empty.scene.mocap_autolabel.source
    press("import_take", filepath=files.folder / "walk.c3d", at_1=True)
    press("open_markerset", filepath=files.markerset)
    assert (scene.frame_start, scene.frame_end, source.first_frame, source.last_frame) == (1, 30, 101, 130)
    scene.frame_set(4)
    assert visible_points() == int(np.isfinite(files.xyz[3, :, 0]).sum())
    labelling = scene.mocap_autolabel.labelling
    labelling.use_range, labelling.range_first, labelling.range_last = True, 111, 120
    press("label")
    stored = stored_take()
    assert (stored.clock.shift, stored.motion.frames[0], stored.index_of(11)) == (-100, 111, 0)
    assert keys_of("C7")[:, 0].tolist() == list(range(11, 21))
    assert {row[0] for row in rows_of_export(files.folder / "out.labels.csv")} == {str(one) for one in range(111, 121)}


def test_points_are_seen_before_they_are_labelled_and_take_the_place_of_what_was_there_but_no_bad_ones(
    imported, files, tmp_path
):
    settings = imported.scene.mocap_autolabel
    assert (settings.source.first_frame, settings.source.last_frame, settings.source.trajectories) == (101, 130, 20)
    assert settings.source.rate == pytest.approx(59.94)
    assert (imported.scene.frame_start, imported.scene.frame_end) == (101, 130)
    for frame in (101, 104, 113):
        imported.scene.frame_set(frame)
        expected = int(np.isfinite(files.xyz[frame - 101, :, 0]).sum())
        assert visible_points() == expected
        stored = ours("ui.overlay").shown(imported.scene)
        assert len(ours("ui.marks").point_marks(stored, stored.index_of(frame)).unnamed) == expected
    before = len(bpy.data.objects), len(bpy.data.meshes)
    press("import_points", filepath=files.folder / "walk.trc")
    assert (len(bpy.data.objects), len(bpy.data.meshes)) == before
    source = settings.source
    assert source.points_path.endswith("walk.trc")
    before = source.points_path, source.preview.name, source.rate, source.first_frame
    for first, words in ((2**31, "goes on to frame 2147483677"), (-(2**31) - 1, "begins at frame -2147483649")):
        write_trc(tmp_path / "far.trc", replace(read_points(files.take), first_frame=first, rate=50))
        refused(rf"far\.trc: {words}; expected frame numbers", "import_take", filepath=tmp_path / "far.trc")
    assert (source.points_path, source.preview.name, source.rate, source.first_frame) == before


def test_a_drop_tells_blobs_from_points(empty, settings, files):
    press("import_take", "INVOKE_DEFAULT", filepath=files.folder / "motive.csv")
    assert (settings.source.points_path, settings.source.blobs_path) == (str(files.folder / "motive.csv"), "")
    assert (settings.source.first_frame, settings.source.trajectories, settings.source.rate) == (7, 1, 100.0)
    (files.folder / "qualisys.tsv").write_text(tsv())
    press("import_take", "INVOKE_DEFAULT", filepath=files.folder / "qualisys.tsv")
    assert (settings.source.trajectories, settings.source.rate) == (3, 120.0)
    refused("need the calibration", "import_take", "INVOKE_DEFAULT", filepath=files.folder / "walk.csv")
    press("import_cameras", filepath=files.folder / "room.toml")
    press("import_take", "INVOKE_DEFAULT", filepath=files.folder / "walk.csv")
    assert (settings.source.points_path, settings.source.blobs_path) == ("", str(files.folder / "walk.csv"))
    assert not any(item.modifiers for item in empty.scene.objects), "the points have gone"
    refused("holds 3D points", "import_blobs", "INVOKE_DEFAULT", filepath=files.folder / "motive.csv")
    handler = ours("ops.importing").MOCAP_AUTOLABEL_FH_take
    assert handler.is_registered and handler.bl_import_operator == "mocap_autolabel.import_take"
    areas = [SimpleNamespace(area=SimpleNamespace(type=kind)) for kind in ("VIEW_3D", "IMAGE_EDITOR")]
    assert [bool(handler.poll_drop(area)) for area in areas] == [True, False]
    suffixes = set(handler.bl_file_extensions.split(";"))
    assert {".toml", ".xcp", ".mcal", ".yml", ".txt", ".cal", ".csv", ".c3d", ".trc", ".tsv", ".qtm"} <= suffixes
    assert ".blend" not in suffixes, "which Blender opens"


@pytest.fixture
def qtm(tmp_path, made):
    """A capture as the capture program saves it, with blobs, three of its four cameras calibrated, and 3D points."""
    cameras = made.cameras()
    names = tuple(str(11 + index) for index in range(len(cameras)))
    blobs = made.blobs(made.markerset(), cameras, made.motion(made.markerset(), 5))[0]
    tracks = [Trajectory("", [(1, 3)], [(10.0 * at, 20.0, 1000.0 + at, 0.5, 1) for at in range(3)]) for _ in range(4)]
    recording = Recording(replace(cameras, names=names), blobs, tracks, rate=250.0, uncalibrated=names[-1:])
    return write_qtm(tmp_path / "walk.qtm", recording), names


def test_a_capture_brings_its_cameras_and_its_rate(settings, qtm):
    path, names = qtm
    press("import_take", "INVOKE_DEFAULT", filepath=path)
    assert (settings.source.blobs_path, settings.source.points_path, settings.source.rate) == (str(path), "", 250.0)
    assert {camera_name(item) for item in settings.source.cameras.objects} == set(names[:-1])
    chosen = settings.source.cameras
    press("import_blobs", filepath=path)
    assert settings.source.cameras == chosen, "the scene's own are the file's"
    labelling = ours("ops.labelling")
    assert labelling.job_of(bpy.context).use == "blobs"
    assert labelling.job_of(bpy.context).target == USUAL_TARGET, "and not what 32 bits make of it"
    press("import_points", filepath=path)
    assert (settings.source.points_path, settings.source.trajectories) == (str(path), 4)
    assert labelling.job_of(bpy.context).use == "points"
    press("import_take", filepath=path, use="points")
    press("import_cameras", filepath=path)
    importing = ours("ops.importing")
    assert all("*.qtm" in glob.split(";") for glob in (importing.BLOBS, importing.POINTS))


def test_anonymous_points_become_named_markers(imported, files, naming_known):
    press("label")
    collection = imported.scene.mocap_autolabel.take
    assert naming.CAMERAS not in collection
    assert not [item for item in bpy.data.collections if item.name.startswith("Mocap: cameras")]
    empties, [armature] = shown(), only(collection, "ARMATURE")
    names = list(empties)
    assert set(session().markers.keys()) == set(names)
    assert len(armature.pose.bones) == 15
    imported.scene.frame_set(120)
    for point, marker in enumerate(files.truth):
        if marker != NO_MARKER:
            place = empties[names[marker]].matrix_world.translation
            np.testing.assert_allclose(place, files.xyz[19, point], atol=1e-5)
    assert curves_of(armature), "it moves"
    assert visible_points() == GHOSTS, "the unlabelled take is out of sight, its ghosts are not"
    press("clear")
    assert [item.hide_viewport for item in imported.scene.objects if item.modifiers] == [False]


def test_events_of_a_qualisys_export_are_timeline_markers(imported, files, naming_known, tmp_path):
    xyz, count = np.nan_to_num(1000 * files.xyz), files.xyz.shape[1]
    head = f"NO_OF_MARKERS\t{count}\nFREQUENCY\t60\nDATA_INCLUDED\t3D\nEVENT\tFoot Off\t9\t0.13\nMARKER_NAMES\t\n"
    rows = ["\t".join(map(str, row)) for row in xyz.reshape(len(xyz), -1)]
    (tmp_path / "walk.tsv").write_text(head + "\n".join(rows) + "\n")
    press("import_points", filepath=tmp_path / "walk.tsv", up="z")
    press("label")
    assert [(one.name, one.frame) for one in imported.scene.timeline_markers] == [("Foot Off", 9)]


def lab_is_seen(context, source):
    """Events are timeline markers and plates have arrows that push, as the file says; a person's marker stays."""
    scene, take = context.scene, context.scene.mocap_autolabel.take
    scene.timeline_markers.new("mine", frame=76)
    events = [(one.name, one.frame) for one in scene.timeline_markers]
    assert events == [("Right Foot Off", 76), ("mine", 76)], "the other is before the take"
    plates = read_lab(read_points(source, up="z").trial, 59.94).plates
    items = {item.name: item for item in take.children["lab force plates"].objects}
    assert len(items) == 2 * len(plates) == 4
    for number, plate in enumerate(plates, 1):
        outline, arrow = items[f"lab force plate {number}"], items[f"lab force {number}"]
        assert (len(outline.data.edges), len(outline.data.polygons), outline.hide_render) == (4, 0, True)
        np.testing.assert_allclose([one.co for one in outline.data.vertices], plate.corners, atol=1e-6)
        scene.frame_set(87)
        push = np.array(arrow.matrix_world)[:3, 2] * 1000 * arrow.empty_display_size
        np.testing.assert_allclose(push, 0 if np.isnan(plate.place[16, 0]) else plate.force[16], rtol=1e-4, atol=0.01)
    press("label")
    assert sorted((one.name, one.frame) for one in scene.timeline_markers) == sorted(events), "none is there twice"
    assert set(take.children["lab force plates"].objects.keys()) == set(items)
    scene.timeline_markers["Right Foot Off"].frame = 80


def test_the_lab_s_file_is_exported_with_names_in_it(imported, files, naming_known, tmp_path):
    xyz = 1000 * np.concatenate([files.xyz, files.xyz[:, :1]], axis=1)
    of_lab = {"channels": 12, "samples": 3, "first": 71, "rate": 59.94, "lab": True, "up": "+Y", "processor": DEC}
    source, out = tmp_path / "lab.c3d", tmp_path / "named.c3d"
    layout = Layout(frames=30, points=xyz.shape[1], **of_lab)
    source.write_bytes(layout.content(xyz))
    press("import_points", filepath=source, up="z")
    press("label")
    for room in (True, False):  # in a scene in which nothing was moved
        press("export_c3d", filepath=out, room=room)
        assert otherwise(source, out) == []
    lab_is_seen(imported, source)
    column = next(index for index in range(1, 15) if files.truth[index] != NO_MARKER)
    named = read_points(out, up="z")
    own = named.names.index(open_markerset(files.markerset).markers[files.truth[column]])
    there = np.isfinite(xyz[:, column, 0])
    np.testing.assert_allclose(named.xyz[there, own] * 1000, xyz[there, column], atol=1e-3)
    source.write_bytes(layout.content(xyz + 1))
    for _ in range(2):
        press("export_c3d", filepath=out)
        np.testing.assert_allclose(read_points(out).xyz[:, own], named.xyz[:, own], atol=1e-6)
        assert C3dFile(out.read_bytes(), out).whole("ANALOG:USED") == 0
        source.unlink(missing_ok=True)
    items = len(bpy.data.objects)
    assert bpy.ops.mocap_autolabel.label.poll()
    press("clear")
    assert [one.name for one in imported.scene.timeline_markers] == ["mine", "Right Foot Off"], "it was moved"
    assert not [one.name for one in bpy.data.objects if "force" in one.name], "nobody changed it"
    assert len(bpy.data.objects) < items


def test_doubtful_points_are_told_from_sure_ones(extension):
    marks = ours("ui.marks")
    takes = ours("core.data.takes")
    motion = SimpleNamespace(frames=np.array([5, 6, 7]), markers=np.zeros((3, 3, 3)))
    stored = SimpleNamespace(
        names=("A", "B", "C"),
        motion=motion,
        suspects=(
            takes.Suspect(6, 9, "B jumps"),
            takes.Suspect(1, 5, "trajectory 41 may be C2 or D and stays unnamed"),
            takes.Suspect(1, 9, "the rigid bodies sit elsewhere: 4 of 13 were recognised by how they move"),
            takes.Suspect(7, 9, "trajectories 4 41: as trajectory 4 goes over from A to B"),
            takes.Suspect(7, 9, "A B: jumps"),
        ),
        rows=takes.PointRows(
            motion.frames,
            np.array([0, 0, 0, 1, 2, 2]),
            np.array([3, 4, 41, 4, 4, 41]),
            np.arange(18.0).reshape(6, 3),
            None,
        ),
        labels=takes.Labels(np.array([0, 2, -1, -1, -1, -1]), np.zeros(6, int), np.array([1.0, 0.9, 0, 0, 0, 0])),
        held=None,
        edits=(),
        filled_markers={},
    )
    first, second, third = (marks.point_marks(stored, index) for index in range(3))
    assert first.doubtful.tolist() == [False, False, True]
    assert second.doubtful.tolist() == [False, True, False]
    assert first.asked == {0: "trajectory 41"}
    assert (len(first.unnamed), len(second.unnamed), second.asked) == (1, 1, {})
    assert third.doubtful.tolist() == [True, True, False]
    assert third.asked == {0: "trajectory 4", 1: "trajectory 41"}


@pytest.fixture
def upside_down(files, tmp_path):
    """The same take, which now says that -X is up and that it has no rate."""
    content = (files.folder / "walk.c3d").read_bytes()
    path = tmp_path / "down.c3d"
    path.write_bytes(content.replace(b"+Z", b"-X").replace(np.float32(59.94).tobytes(), bytes(4)))
    return path


def test_an_up_axis_and_a_rate_that_are_given_are_taken(empty, settings, files, upside_down, naming_known):
    refused("has a rate of 0 frames a second; expected", "import_points", filepath=upside_down)
    for importer in ("import_points", "import_take"):
        press(importer, filepath=upside_down, up="z", rate=60.0)
        assert (settings.source.up, settings.source.rate) == ("z", 60.0)
        heights = [vertex.co.z for vertex in settings.source.preview.vertices]
        there = files.xyz[..., 2]
        assert max(heights) == pytest.approx(np.nanmax(there), abs=1e-4)
    press("open_markerset", filepath=files.markerset)
    press("label")
    assert settings.take is not None
    press("import_points", filepath=files.folder / "walk.c3d")
    assert empty.scene.mocap_autolabel.source.up == ""


def test_what_is_refused_can_be_labelled_regardless(extension, imported, files, naming_known, monkeypatch):
    possible = ours("core.points.possible")

    def refuse(check):
        raise possible.mirrored_error("A would be on the other side of the body")

    monkeypatch.setattr(possible.Handedness, "refuse", refuse)
    settings, state = imported.scene.mocap_autolabel, session()
    refused("is left-handed: one axis is mirrored, as A would be", "label")
    assert settings.take is None
    assert state.refused.startswith("is left-handed")
    assert "--force" not in state.refused
    panels, path = ours("ui.panels"), settings.source.points_path
    assert panels.told_here(state, settings)
    settings.source.points_path = str(files.folder / "other.c3d")  # as by undo
    assert not panels.told_here(state, settings)
    settings.source.points_path = path
    press("label", force=True)
    assert settings.take is not None
    assert not state.refused
    assert bpy.ops.mocap_autolabel.label() == {"FINISHED"}, "for as long as it is this take"

    path = str(files.folder / "walk.c3d")
    press("import_points", filepath=path)
    assert not settings.source.forced
    plain = [tuple(vertex.co) for vertex in settings.source.preview.vertices]
    for importer in ("import_points", "import_take"):
        press(importer, filepath=path, mirror=True)
        assert [tuple(vertex.co) for vertex in settings.source.preview.vertices] == [(x, -y, z) for x, y, z in plain]
    assert ours("ops.labelling").job_of(bpy.context).mirror
