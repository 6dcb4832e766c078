# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of three discs that move, drawn here and written by Blender, for tests."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from addon.core.data.takes import Blobs
from addon.core.geometry.cameras import Cameras
from addon.io.cameras import write_cameras
from scripts.movies import encode, save_picture

NAMES = ("left", "right")  # of the cameras
SIZE = (160, 120)  # width and height, px
RADIUS = 3.0


def two_cameras() -> Cameras:
    matrix = [[300.0, 0, SIZE[0] / 2], [0, 300.0, SIZE[1] / 2], [0, 0, 1]]
    turns = [np.diag([1.0, -1, -1]), np.array([[0.0, 0, 1], [0, -1, 0], [1, 0, 0]])]
    return Cameras(NAMES, [SIZE] * 2, [matrix] * 2, np.zeros((2, 5)), turns, np.full((2, 3), 2.0))


def places(frame: int, camera: int) -> np.ndarray:
    """(3, 2) px where the discs are; the middle of the first pixel is (0, 0)."""
    first, step = np.array([[[20.3, 30.4], [60.7, 80.2], [110.1, 50.8]], [[1.25, 0.5], [0.75, -0.5], [0.5, 1.25]]])
    return first + camera * np.array([3.0, 2.0]) + frame * step


def picture(frame: int, camera: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """(H, W) the discs, as bright as each pixel is covered."""
    fine = (np.arange(6) + 0.5) / 6 - 0.5
    x, y = ((np.arange(side)[:, None] + fine).ravel() for side in size)
    lit = np.zeros((y.size, x.size), bool)
    for cx, cy in places(frame, camera):
        lit |= (x - cx) ** 2 + (y[:, None] - cy) ** 2 < RADIUS**2
    return lit.reshape(size[1], 6, size[0], 6).mean(axis=(1, 3))


def save_pictures(folder: Path, frames: Sequence[int], camera: int, size: tuple[int, int] = SIZE):
    folder.mkdir(parents=True, exist_ok=True)
    for frame in frames:
        save_picture(folder / f"{frame:04}.png", picture(frame, camera, size))


def write_studio(folder: Path, frames: Sequence[int]) -> Cameras:
    """Writes room.toml, a folder of pictures for each camera, and movies of them; gives the cameras."""
    cameras = two_cameras()
    write_cameras(folder / "room.toml", cameras)
    (folder / "movies").mkdir()
    for number, name in enumerate(NAMES):
        save_pictures(folder / name, frames, number)
        encode(folder / name, frames, folder / "movies" / f"{name}.mp4", SIZE)
    return cameras


def assert_at(blobs: Blobs, frame: int, camera: int, drawn: np.ndarray, within: float = 0.1):
    """Asserts that the blobs of a camera in a frame are where discs were drawn."""
    own = blobs.xy[(blobs.frames[blobs.frame] == frame) & (blobs.camera == camera)]
    np.testing.assert_allclose(own[np.argsort(own[:, 0])], drawn[np.argsort(drawn[:, 0])], rtol=0, atol=within)
