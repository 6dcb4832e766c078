# SPDX-License-Identifier: GPL-3.0-or-later
"""Refine Calibration in Blender: the new file is chosen, errors are told; and blobs from pictures and movie clips."""

import json
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core.geometry.cameras import Cameras
from addon.io.blobs import read_blobs
from addon.io.cameras import read_cameras, write_cameras
from addon.scene import cameras as scene_cameras
from addon.scene.cameras import kept_health, kept_refinement
from tests.blender.conftest import open_room, write_room
from tests.core.calibration.test_adjusting import image_error, moved
from tests.inputs.pictures import NAMES, SIZE, assert_at, places, write_studio

from .hands import ours, refused

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
    before = settings.source.cameras
    assert bpy.ops.mocap_autolabel.refine_calibration() == {"FINISHED"}
    path = files.folder / "walk.refined.toml"
    written, chosen = read_cameras(path), scene_cameras.cameras_of(settings.source.cameras, made)
    assert settings.source.cameras != before
    assert before.hide_viewport
    assert image_error(written, true).max() < 0.2
    assert image_error(chosen, written).max() < 0.01
    assert scene_cameras.camera_name(made.camera) == true.names[MOVED]
    assert made.camera.name in settings.source.cameras.objects
    report = kept_refinement(settings.source.cameras)
    assert Path(report["out"]) == path
    moved_row = report["cameras"][true.names[MOVED]]
    assert moved_row["after_px"] < 0.2 < moved_row["before_px"]
    # With the cameras as they are now there is nothing left to do, and nothing is written.
    assert bpy.ops.mocap_autolabel.refine_calibration() == {"FINISHED"}
    assert sorted(each.name for each in files.folder.glob("*.refined.toml")) == ["walk.refined.toml"]
    assert kept_refinement(settings.source.cameras) == report
    path.unlink()


def test_cameras_that_were_changed_meanwhile_stay(extension, scene, files, monkeypatch):
    made = scene("moved.toml")
    settings = made.mocap_autolabel
    operator = ours("ops.calibration").MOCAP_AUTOLABEL_OT_refine_calibration
    show, other = operator._show, scene_cameras.add_cameras(made, files.room)

    def changed_meanwhile(self, context, refined):
        settings.source.cameras = other
        return show(self, context, refined)

    monkeypatch.setattr(operator, "_show", changed_meanwhile)
    refused(r"which are in \S+\.toml; expected them to stay", "refine_calibration")
    assert settings.source.cameras == other
    assert not other.hide_viewport
    (files.folder / "walk.refined.toml").unlink()


def test_the_panel_tells_errors_and_offers_to_label_again(extension, scene, files):
    made = scene("room.toml")
    settings = made.mocap_autolabel
    row = {"before_px": 2.19, "after_px": 0.41}
    settings.source.cameras["mocap_refined"] = json.dumps({"cameras": {"cam 0": row, "cam 1": dict.fromkeys(row)}})
    said, buttons = [], []

    class Layout:
        def __getattr__(self, name):
            return lambda *given, **more: self

        def label(self, text="", icon="NONE"):
            said.append(text)

        def operator(self, name, text="", icon="NONE"):
            buttons.append((name, text))

    ours("ui.advanced").draw_health(Layout(), bpy.context)
    assert buttons == [("mocap_autolabel.refine_calibration", ""), ("mocap_autolabel.label", "Label Again")]
    assert said[-6:] == ["cam 0", "2.19 px", "0.41 px", "cam 1", "–", "–"]


def test_what_is_odd_about_cameras_stays_with_the_take(scene, files):
    made = scene("moved.toml")
    assert bpy.ops.mocap_autolabel.label() == {"FINISHED"}
    [words] = kept_health(made.mocap_autolabel.take)
    assert words.startswith(f"camera {files.room.names[MOVED]} seems to have moved since the calibration")


def test_without_cameras_or_blobs_the_button_says_why(extension, empty, files):
    operator, said = ours("ops.calibration").MOCAP_AUTOLABEL_OT_refine_calibration, []
    cls = SimpleNamespace(poll_message_set=said.append, lacks=operator.lacks)
    assert not operator.poll.__func__(cls, empty)
    assert bpy.ops.mocap_autolabel.import_cameras(filepath=str(files.folder / "room.toml")) == {"FINISHED"}
    assert not operator.poll.__func__(cls, empty)
    empty.scene.mocap_autolabel.source.points_path = "walk.c3d"
    assert not operator.poll.__func__(cls, empty)
    assert [words.split(":")[0] for words in said] == [
        "Open the calibration of the cameras first",
        "Open the blobs first",
        "3D points need no cameras",
    ]


FRAMES = range(1, 9)


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """Pictures, movies and the calibration of two cameras."""
    folder = tmp_path_factory.mktemp("studio")
    return folder, write_studio(folder, FRAMES)


def blobs_in(path: str, cameras: Cameras):
    return next(iter(read_blobs(Path(path), cameras))).blobs


def test_a_folder_of_movies_becomes_the_take(extension, empty, studio, tmp_path):
    folder, cameras = studio
    bpy.ops.mocap_autolabel.import_cameras(filepath=str(folder / "room.toml"))
    out = str(tmp_path / "found.csv")
    assert bpy.ops.mocap_autolabel.find_blobs(directory=str(folder / "movies"), out=out) == {"FINISHED"}
    settings = empty.scene.mocap_autolabel
    assert (settings.source.blobs_path, settings.source.rate) == (out, 30.0)
    assert (settings.source.first_frame, settings.source.last_frame, settings.source.blob_count) == (1, 8, 48)
    blobs = blobs_in(out, cameras)
    for frame in FRAMES:
        assert_at(blobs, frame, 1, places(frame, 1))
    assert not len(bpy.data.textures)


def test_chosen_movies_are_written_beside_them(extension, empty, studio):
    folder, _ = studio
    bpy.ops.mocap_autolabel.import_cameras(filepath=str(folder / "room.toml"))
    chosen = [{"name": "left.mp4"}, {"name": "right.mp4"}]
    given = {"directory": str(folder / "movies"), "files": chosen, "at_1": True}
    assert bpy.ops.mocap_autolabel.import_take(**given) == {"FINISHED"}
    source = empty.scene.mocap_autolabel.source
    assert Path(source.blobs_path) == folder / "movies" / "left.blobs.csv" and source.at_1


def test_what_was_undone_meanwhile_is_opened_again(empty, studio):
    from addon.scene.pictures import open_pictures

    with closing(open_pictures(studio[0] / "movies" / "left.mp4")) as movie:
        before = movie.grey(3)
        bpy.data.textures.remove(movie._texture)
        assert np.array_equal(movie.grey(3), before)
        bpy.data.images.remove(movie._image)
        assert not np.array_equal(movie.grey(5), before)
    assert not len(bpy.data.images)


def test_trouble_with_pictures_is_one_sentence(extension, empty, studio, tmp_path):
    assert not bpy.ops.mocap_autolabel.find_blobs.poll()
    bpy.ops.mocap_autolabel.import_cameras(filepath=str(studio[0] / "room.toml"))
    refused("holds no movie", "find_blobs", directory=str(tmp_path))
    assert not empty.scene.mocap_autolabel.source.blobs_path


def tracked(folder, scene):
    """Two cameras of the scene's own, each with a clip in its background that is tracked by hand where discs are."""
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    for number, name in enumerate(NAMES):
        camera = bpy.data.objects.new(name, bpy.data.cameras.new(name))
        camera.location.x = number
        scene.collection.objects.link(camera)
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


def test_tracks_of_the_scenes_cameras_become_the_take(extension, empty, studio, tmp_path):
    cameras_and_clips = list(tracked(studio[0], empty.scene))
    cameras_and_clips[1][1].tracking.camera.k1 = -0.1
    out = str(tmp_path / "tracks.csv")
    assert bpy.ops.mocap_autolabel.import_clip_tracks(out=out) == {"FINISHED"}
    settings = empty.scene.mocap_autolabel
    assert (settings.source.first_frame, settings.source.last_frame) == (11, 18)
    cameras = scene_cameras.cameras_of(settings.source.cameras, empty.scene)
    assert cameras.names == NAMES
    assert cameras.distortion == pytest.approx(np.array([[0] * 5, [-0.1, 0, 0, 0, 0]]))
    blobs = blobs_in(out, cameras)
    for number in range(2):
        for frame in FRAMES:
            assert_at(blobs, frame + 10, number, places(frame, number)[: 3 if frame <= 4 else 2] + 0.5, 1e-2)


def test_of_a_calibration_pixels_begin_at_a_centre_and_its_lens_stays(extension, empty, studio, tmp_path):
    folder, cameras = studio
    cameras = Cameras(NAMES, cameras.size, cameras.matrix, np.full((2, 5), 0.01), cameras.rotation, cameras.translation)
    write_cameras(tmp_path / "lens.toml", cameras)
    bpy.ops.mocap_autolabel.import_cameras(filepath=str(tmp_path / "lens.toml"))
    for name in NAMES:  # found by their names
        clip = bpy.data.movieclips.load(str(folder / "movies" / f"{name}.mp4"))
        clip.tracking.camera.k1 = -0.3
        clip.tracking.tracks.new(name="disc", frame=2).markers.insert_frame(2, co=(0.5, 0.25))
    out = str(tmp_path / "tracks.csv")
    assert bpy.ops.mocap_autolabel.import_clip_tracks(out=out) == {"FINISHED"}
    found = scene_cameras.cameras_of(empty.scene.mocap_autolabel.source.cameras, empty.scene)
    assert found.distortion == pytest.approx(cameras.distortion)
    blobs = blobs_in(out, cameras)
    assert blobs.xy[blobs.frames[blobs.frame] == 2] == pytest.approx(np.array([[79.5, 89.5]] * 2), abs=1e-3)


def test_clips_that_cannot_be_used_are_one_sentence(extension, empty, studio, tmp_path):
    pairs = list(tracked(studio[0], empty.scene))
    call, out = bpy.ops.mocap_autolabel.import_clip_tracks, str(tmp_path / "tracks.csv")
    lens = pairs[0][1].tracking.camera
    lens.distortion_model, lens.division_k1 = "DIVISION", 0.1
    with pytest.raises(RuntimeError, match="expected Polynomial"):
        call(out=out)
    lens.division_k1 = 0.0
    pairs[0][0].data.background_images[0].clip = pairs[1][1]
    with pytest.raises(RuntimeError, match="the same clip"):
        call(out=out)
    pairs[0][0].data.background_images[0].clip = pairs[0][1]
    empty.scene.render.resolution_x = SIZE[0] + 20
    with pytest.raises(RuntimeError, match="expected pictures as large"):
        call(out=out)
    assert not Path(out).exists()
    assert not empty.scene.mocap_autolabel.source.blobs_path
