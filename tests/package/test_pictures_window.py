# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs from Pictures in a real Blender's window; `tours/pictures.py` walks it, this file judges it."""

import pytest

from addon.io.blobs import read_blobs
from addon.io.cameras import write_cameras
from scripts.movies import encode
from tests.inputs.pictures import NAMES, SIZE, save_pictures, two_cameras

pytestmark = [pytest.mark.real_blender, pytest.mark.window, pytest.mark.slow]
FRAMES = [*range(1, 21), *range(20, 0, -1)]  # no disc leaves the picture
MOVIES = [f"{name}.mp4" for name in NAMES]


@pytest.fixture(scope="module")
def tour(watch, tmp_path_factory):
    pytest.importorskip("bpy", reason="movies are written by Blender")
    folder, drawn = tmp_path_factory.mktemp("tour"), tmp_path_factory.mktemp("drawn")
    write_cameras(folder / "room.toml", two_cameras())
    (folder / "movies").mkdir()
    for number, name in enumerate(NAMES):
        save_pictures(drawn / name, sorted(set(FRAMES)), number)
        encode(drawn / name, FRAMES, folder / "movies" / f"{name}.mp4", SIZE)
    return watch("pictures", folder, cameras=str(folder / "room.toml"), movies=str(folder / "movies"))


def test_escape_ends_it_and_leaves_nothing(tour):
    assert tour["doing"]
    assert tour["cancelled"] == ["", MOVIES]


def test_the_blobs_become_the_take(tour):
    assert tour["found"] == ["left.blobs.csv", 30.0, 1, len(FRAMES)]
    assert tour["files"] == sorted([*MOVIES, "left.blobs.csv"])
    [part] = read_blobs(tour["folder"] / "movies" / "left.blobs.csv", two_cameras())
    assert len(part.blobs.xy) == 3 * len(NAMES) * len(FRAMES)


def test_it_is_taken_back_by_undo(tour):
    assert tour["taken back"] == ""
