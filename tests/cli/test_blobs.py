# SPDX-License-Identifier: GPL-3.0-or-later
"""`blobs`: movies and image sequences that are drawn here, read by Blender, and what cannot be done with them."""

import pytest

from addon.io.blobs import read_blobs
from tests.inputs.pictures import NAMES, SIZE, assert_at, places, save_pictures, write_studio

bpy = pytest.importorskip("bpy", reason="pictures are read by Blender")
FRAMES = range(7, 19)


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """A calibration of two cameras, a folder of pictures for each, and a movie of each."""
    folder = tmp_path_factory.mktemp("studio")
    return folder, write_studio(folder, FRAMES)


@pytest.fixture
def find(run, studio, tmp_path):
    def call(*words, out="blobs.csv"):
        return run("blobs", *words, "--cameras", studio[0] / "room.toml", "--out", tmp_path / out)

    return call


def assert_places(path, cameras, frames, shift=0.0, offset=0):
    """Every blob of the file where it was drawn, frame by frame, in each camera."""
    blobs = next(iter(read_blobs(path, cameras))).blobs
    assert blobs.frames.tolist() == list(frames)
    for frame in frames:
        for number in range(2):
            assert_at(blobs, frame, number, places(frame + offset, number) + shift)


def test_pictures_of_two_cameras_become_blobs(find, studio, tmp_path):
    folder, cameras = studio
    answer = find(folder / "left", f"right={folder / 'right' / '0009.png'}", "--json").quiet()
    assert_places(tmp_path / "blobs.csv", cameras, FRAMES)
    said = answer.json
    assert said["blobs"] == 3 * 2 * len(FRAMES)
    assert (said["first_frame"], said["frames"], said["rate"], said["first_pixel"]) == (7, 12, None, "centre")


def test_movies_are_read_frame_by_frame(find, studio, tmp_path):
    folder, cameras = studio
    movies = [folder / "movies" / f"{name}.mp4" for name in NAMES]
    assert "30 frames a second" in find(*movies, "--frames", "3:10", "--first-pixel", "corner").done().out
    # The first frame of a movie is 1; the pictures it is made of begin at 7.
    assert_places(tmp_path / "blobs.csv", cameras, range(3, 11), shift=0.5, offset=6)


def test_missing_pictures_are_told_and_nothing_of_blender_stays_behind(find, studio, tmp_path):
    folder, _ = studio

    def held():
        counts = [len(kind) for kind in (bpy.data.images, bpy.data.textures, bpy.data.movieclips)]
        return *counts, bpy.context.preferences.system.memory_cache_limit

    before = held()
    save_pictures(tmp_path / "right", range(7, 15), 1)
    assert "right has pictures of frames 7–14 only" in find(folder / "left", tmp_path / "right").done().out
    assert "no pictures of right" in find(folder / "movies" / "left.mp4", out="one.csv").done().out
    assert held() == before


def test_what_cannot_be_done(find, studio, tmp_path, monkeypatch):
    left, broken = studio[0] / "left", tmp_path / "left.mp4"
    broken.write_bytes(b"no movie" * 50)
    for name in ("empty", "wide", "two"):
        (tmp_path / name / "left").mkdir(parents=True)
    save_pictures(tmp_path / "wide" / "left", range(1, 3), 0, size=(SIZE[0] + 10, SIZE[1]))
    save_pictures(tmp_path / "two" / "left", [1, 300_000], 0)
    for words, *given in (
        ("no camera's name in its own", studio[0]),
        ("the calibration has no camera top", f"top={left}"),
        ("each camera once", left, f"left={studio[0] / 'movies' / 'left.mp4'}"),
        ("no such file", f"left={studio[0] / 'nothing.mp4'}"),
        ("neither a movie nor a picture", f"left={studio[0] / 'room.toml'}"),
        ("expected --frames among these", left, "--frames", "50:60"),
        ("cannot be read by Blender", broken),
        ("holds no numbered pictures", tmp_path / "empty" / "left"),
        (f"is {SIZE[0] + 10} × {SIZE[1]} px, and camera left {SIZE[0]} × {SIZE[1]}", tmp_path / "wide" / "left"),
        ("numbered by their frames", tmp_path / "two" / "left"),
    ):
        assert words in find(*given).refusal(2)
    assert "no picture shows a bright round spot" in find(left, "--threshold", "1").refusal(1)
    assert not (tmp_path / "blobs.csv").exists()
    assert find(left).status == 0
    assert "exists already" in find(left).reason
    monkeypatch.setattr("addon.blendfile.has_blender", lambda: False)
    assert "pictures are read by Blender" in find(left, out="none.csv").refusal(2)
