# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's cameras look through the real lens, and calibrations come back out of them, are refined and give blobs."""

import json
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest
from bpy.app.handlers import persistent
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from addon.core.data.errors import InputError
from addon.core.geometry.cameras import Cameras
from addon.io.blobs import read_blobs
from addon.io.cameras import read_cameras, write_cameras
from addon.scene import cameras as scene_cameras
from addon.scene.cameras import kept_health, kept_refinement
from addon.scene.pictures import open_pictures
from tests.blender.conftest import open_room, write_room
from tests.core.calibration.test_adjusting import image_error, moved
from tests.inputs.pictures import NAMES, SIZE, assert_at, places, write_studio

from .hands import add_object, ours, press, refused


@pytest.mark.parametrize("vicon", [False, True])
def test_calibrations_survive_blender_and_its_files_and_leave_nothing_behind(empty, made, tmp_path, vicon):
    lenses = np.array([[0.4, 0.2, 0.0], [0.0, 0.0, 0.0], [-0.1, 0.3, 0.05], [0.65, 0.8, 0.0]])
    cameras = replace(made.cameras(), inverse=lenses) if vicon else made.cameras(lens=-0.2)
    path = tmp_path / "room.blend"
    collection = scene_cameras.add_cameras(empty.scene, cameras)
    assert scene_cameras.find_or_add_cameras(empty.scene, cameras) == collection
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    here = scene_cameras.cameras_of(collection, empty.scene)
    assert scene_cameras.find_or_add_cameras(empty.scene, made.cameras()) != collection
    bpy.ops.wm.read_homefile(use_empty=True)
    kinds = "objects", "cameras", "scenes", "libraries", "collections"
    before = [len(getattr(bpy.data, kind)) for kind in kinds]
    points = np.random.default_rng(2).uniform([-1, -1, 0], [1, 1, 2], (50, 3))
    for back in (here, scene_cameras.cameras_of_blend(str(path))):
        assert back.names == cameras.names
        for field in ("size", "matrix", "distortion", "rotation", "translation", "inverse"):
            np.testing.assert_allclose(getattr(back, field), getattr(cameras, field), rtol=1e-6, atol=1e-5)
        assert np.abs(back.project(points) - cameras.project(points)).max() < 0.005
    assert [len(getattr(bpy.data, kind)) for kind in kinds] == before
    assert np.abs(cameras.project(points) - made.cameras().project(points)).max() > 1
    path.write_text("this is not a Blender file")
    with pytest.raises(InputError, match="not a Blender file"):
        scene_cameras.cameras_of_blend(str(path))


@pytest.mark.parametrize("switched_off", [False, True])
def test_cameras_are_where_they_are_as_soon_as_a_file_is_open(empty, made, tmp_path, switched_off):
    """Blender works out later where objects are, and not at all in a collection that is switched off."""
    cameras, found = made.cameras(), []
    collection = scene_cameras.add_cameras(empty.scene, cameras)
    rig = add_object("Rig")
    rig.location, rig.rotation_euler = (1, 2, 0), (0, 0, 0.5)
    collection.objects[1].parent = rig
    collection.objects.link(collection.objects[0].copy())  # as a person makes one to render through
    empty.view_layer.update()
    before = scene_cameras.cameras_of(collection, empty.scene)
    moved = rig.matrix_world @ Vector(cameras.centres[1])
    np.testing.assert_allclose(before.centres, [cameras.centres[0], moved, *cameras.centres[2:]], atol=1e-5)
    empty.view_layer.layer_collection.children[collection.name].exclude = switched_off
    path = str(tmp_path / "room.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)

    @persistent
    def read(*_):
        found.append(scene_cameras.cameras_of(bpy.data.collections[name], bpy.context.scene))

    name = collection.name
    bpy.app.handlers.load_post.append(read)
    try:
        bpy.ops.wm.open_mainfile(filepath=path)
    finally:
        bpy.app.handlers.load_post.remove(read)
    np.testing.assert_allclose(found[0].centres, before.centres, atol=1e-5)
    np.testing.assert_allclose(found[0].rotation, before.rotation, atol=1e-6)


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("size", [(640, 480), (480, 640)])
def test_a_users_own_cameras_are_read_as_blender_draws_them(empty, fit, size):
    scene = empty.scene
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.pixel_aspect_x = 1.25
    camera = add_object("Mine", bpy.data.cameras.new("Mine"))
    camera.data.sensor_fit, camera.data.shift_x, camera.data.shift_y = fit, 0.05, -0.1
    camera.location, camera.rotation_euler = (3, -2, 1.5), (1.3, 0.1, 0.8)
    empty.view_layer.update()
    points = np.random.default_rng(3).uniform(-1, 1, (20, 3))
    found = scene_cameras.cameras_of_scene(scene).project(points)[0]
    view = np.array([world_to_camera_view(scene, camera, Vector(point)) for point in points])
    assert np.abs(found - np.column_stack([view[:, 0] * size[0], (1 - view[:, 1]) * size[1]])).max() < 0.01


MOVED = 2


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The true room, one in which a camera was moved since, and a second of blobs."""
    files = write_room(tmp_path_factory.mktemp("files"), 60)
    write_cameras(files.folder / "moved.toml", moved(files.room, [MOVED], 0.3, 10, seed=3))
    return files


@pytest.fixture
def scene(extension, empty, files):
    """A function that makes a scene in which only *Refine Calibration* is left to press, of a room."""

    def make(room: str):
        open_room(SimpleNamespace(**vars(files) | {"cameras": str(files.folder / room)}))
        return empty.scene

    return make


def test_a_moved_camera_is_refined_and_the_new_file_chosen(scene, files):
    made = scene("moved.toml")
    settings, true = made.mocap_autolabel, files.room
    scene_cameras.look_through(made, settings.source.cameras.objects[MOVED])
    before, settings.source.rate = settings.source.cameras, 59.94
    press("refine_calibration")
    path = files.folder / "walk.refined.toml"
    written, chosen = read_cameras(path), scene_cameras.cameras_of(settings.source.cameras, made)
    assert settings.source.cameras != before
    assert before.hide_viewport
    assert image_error(written, true).max() < 0.2
    assert image_error(chosen, written).max() < 0.01
    assert scene_cameras.camera_name(made.camera) == true.names[MOVED]
    assert made.camera.name in settings.source.cameras.objects
    report = kept_refinement(settings.source.cameras)
    assert (Path(report["out"]), report["rate"]) == (path, 59.94)
    moved_row = report["cameras"][true.names[MOVED]]
    assert moved_row["after_px"] < 0.2 < moved_row["before_px"]
    # With the cameras as they are now there is nothing left to do, and nothing is written.
    press("refine_calibration")
    assert sorted(each.name for each in files.folder.glob("*.refined.toml")) == ["walk.refined.toml"]
    assert kept_refinement(settings.source.cameras) == report
    path.unlink()


def test_cameras_that_were_changed_meanwhile_stay(extension, scene, files, monkeypatch):
    made, operator = scene("moved.toml"), ours("ops.calibration").MOCAP_AUTOLABEL_OT_refine_calibration
    source, show, other = made.mocap_autolabel.source, operator._show, scene_cameras.add_cameras(made, files.room)
    monkeypatch.setattr(operator, "_show", lambda *given: setattr(source, "cameras", other) or show(*given))
    refused(r"which are in \S+\.toml; expected them to stay", "refine_calibration")
    assert source.cameras == other
    assert not other.hide_viewport
    (files.folder / "walk.refined.toml").unlink()


def test_the_panel_tells_errors_and_offers_to_label_again(extension, scene):
    cameras, layout = scene("room.toml").mocap_autolabel.source.cameras, MagicMock()
    row = {"before_px": 2.19, "after_px": 0.41}
    cameras["mocap_refined"] = json.dumps({"cameras": {"cam 0": row, "cam 1": dict.fromkeys(row)}})
    ours("ui.advanced").draw_health(layout, bpy.context)
    buttons = [call.args[0] for call in layout.mock_calls if call[0].endswith("operator")]
    assert buttons == ["mocap_autolabel.refine_calibration", "mocap_autolabel.label"]
    said = [call.kwargs["text"] for call in layout.mock_calls if call[0].endswith("label")]
    assert said[-6:] == ["cam 0", "2.19 px", "0.41 px", "cam 1", "–", "–"]


def test_what_is_odd_about_cameras_stays_with_the_take(scene, files):
    made = scene("moved.toml")
    press("label")
    [words] = kept_health(made.mocap_autolabel.take)
    assert words.startswith(f"camera {files.room.names[MOVED]} seems to have moved since the calibration")


def test_without_cameras_or_blobs_the_button_says_why(extension, empty, files):
    refused("Open the calibration of the cameras first", "refine_calibration")
    press("import_cameras", filepath=files.folder / "room.toml")
    refused("Open the blobs first", "refine_calibration")
    empty.scene.mocap_autolabel.source.points_path = "walk.c3d"
    refused("3D points need no cameras", "refine_calibration")


FRAMES = range(1, 9)


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """Pictures, movies and the calibration of two cameras."""
    folder = tmp_path_factory.mktemp("studio")
    return folder, write_studio(folder, FRAMES)


def blobs_in(path: str, cameras: Cameras):
    return next(iter(read_blobs(Path(path), cameras))).blobs


def test_a_folder_of_movies_or_some_that_are_chosen_become_the_take(settings, studio, tmp_path):
    folder, cameras = studio
    assert not bpy.ops.mocap_autolabel.find_blobs.poll()
    press("import_cameras", filepath=folder / "room.toml")
    refused("holds no movie", "find_blobs", directory=tmp_path)
    source, out = settings.source, str(tmp_path / "found.csv")
    assert not source.blobs_path
    press("find_blobs", directory=folder / "movies", out=out)
    assert (source.blobs_path, source.rate, source.blob_count) == (out, 30.0, 48)
    assert (source.first_frame, source.last_frame) == (1, 8)
    blobs = blobs_in(out, cameras)
    for frame in FRAMES:
        assert_at(blobs, frame, 1, places(frame, 1))
    assert not len(bpy.data.textures)
    chosen = [{"name": "left.mp4"}, {"name": "right.mp4"}]
    press("import_take", directory=folder / "movies", files=chosen, at_1=True)
    assert Path(source.blobs_path) == folder / "movies" / "left.blobs.csv" and source.at_1


def test_what_was_undone_meanwhile_is_opened_again(empty, studio):
    with closing(open_pictures(studio[0] / "movies" / "left.mp4")) as movie:
        before = movie.grey(3)
        bpy.data.textures.remove(movie._texture)
        assert np.array_equal(movie.grey(3), before)
        bpy.data.images.remove(movie._image)
        assert not np.array_equal(movie.grey(5), before)
    assert not len(bpy.data.images)


def tracked(folder, scene):
    """Two cameras of the scene's own, each with a clip in its background that is tracked by hand where discs are."""
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    for number, name in enumerate(NAMES):
        camera = add_object(name, bpy.data.cameras.new(name))
        camera.location.x = number
        clip = bpy.data.movieclips.load(str(folder / "movies" / f"{name}.mp4"))
        clip.frame_start = 11
        camera.data.background_images.new().source = "MOVIE_CLIP"
        camera.data.background_images[0].clip = clip
        for disc in range(3):
            track = clip.tracking.tracks.new(name=f"disc{disc}", frame=1)
            for frame in FRAMES:
                # The middle of the first pixel is half a pixel from the picture's corner.
                x, y = (places(frame, number)[disc] + 0.5) / SIZE
                marker = track.markers.insert_frame(frame, co=(x, 1 - y))
                marker.mute = disc == 2 and frame > 4
        yield camera, clip


def test_tracks_of_the_scenes_cameras_become_the_take(empty, settings, studio, tmp_path):
    cameras_and_clips = list(tracked(studio[0], empty.scene))
    cameras_and_clips[1][1].tracking.camera.k1 = -0.1
    out = str(tmp_path / "tracks.csv")
    press("import_clip_tracks", out=out)
    assert (settings.source.first_frame, settings.source.last_frame) == (11, 18)
    cameras = scene_cameras.cameras_of(settings.source.cameras, empty.scene)
    assert cameras.names == NAMES
    assert cameras.distortion == pytest.approx(np.array([[0] * 5, [-0.1, 0, 0, 0, 0]]))
    blobs = blobs_in(out, cameras)
    for number in range(2):
        for frame in FRAMES:
            assert_at(blobs, frame + 10, number, places(frame, number)[: 3 if frame <= 4 else 2] + 0.5, 1e-2)


def test_clips_that_cannot_be_used_are_one_sentence(extension, empty, studio, tmp_path):
    pairs = list(tracked(studio[0], empty.scene))
    out = tmp_path / "tracks.csv"
    lens = pairs[0][1].tracking.camera
    lens.distortion_model, lens.division_k1 = "DIVISION", 0.1
    refused("expected Polynomial", "import_clip_tracks", out=out)
    lens.division_k1 = 0.0
    pairs[0][0].data.background_images[0].clip = pairs[1][1]
    refused("the same clip", "import_clip_tracks", out=out)
    pairs[0][0].data.background_images[0].clip = pairs[0][1]
    empty.scene.render.resolution_x = SIZE[0] + 20
    refused("expected pictures as large", "import_clip_tracks", out=out)
    assert not out.exists()
    assert not empty.scene.mocap_autolabel.source.blobs_path
    assert not any(key in camera.data for camera, _ in pairs for key in ("mocap_size", "mocap_distortion"))
    empty.scene.render.resolution_x = SIZE[0]
    press("import_clip_tracks", out=out)


def test_of_a_calibration_pixels_begin_at_a_centre_and_its_lens_stays(extension, empty, studio, tmp_path):
    folder, cameras = studio
    cameras = Cameras(NAMES, cameras.size, cameras.matrix, np.full((2, 5), 0.01), cameras.rotation, cameras.translation)
    write_cameras(tmp_path / "lens.toml", cameras)
    press("import_cameras", filepath=tmp_path / "lens.toml")
    for name in NAMES:  # found by their names
        clip = bpy.data.movieclips.load(str(folder / "movies" / f"{name}.mp4"))
        clip.tracking.camera.k1 = -0.3
        clip.tracking.tracks.new(name="disc", frame=2).markers.insert_frame(2, co=(0.5, 0.25))
    out = str(tmp_path / "tracks.csv")
    press("import_clip_tracks", out=out)
    found = scene_cameras.cameras_of(empty.scene.mocap_autolabel.source.cameras, empty.scene)
    assert found.distortion == pytest.approx(cameras.distortion)
    blobs = blobs_in(out, cameras)
    assert blobs.xy[blobs.frames[blobs.frame] == 2] == pytest.approx(np.array([[79.5, 89.5]] * 2), abs=1e-3)
