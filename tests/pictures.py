# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of three discs that move, drawn here and written by Blender, for tests."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from addon.core.geometry.cameras import Cameras

NAMES = ("left", "right")  # of the cameras
SIZE = (160, 120)  # width and height, px
RADIUS = 3.0


def two_cameras() -> Cameras:
    """Those that the pictures are of."""
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
    """Writes numbered pictures."""
    import bpy

    folder.mkdir(parents=True, exist_ok=True)
    for frame in frames:
        pixels = np.ones((size[1], size[0], 4), np.float32)
        pixels[..., :3] = picture(frame, camera, size)[::-1, :, None]
        image = bpy.data.images.new("drawn", *size)
        image.pixels.foreach_set(pixels.ravel())
        image.filepath_raw, image.file_format = str(folder / f"{frame:04}.png"), "PNG"
        image.save()
        bpy.data.images.remove(image)


def encode(folder: Path, frames: Sequence[int], movie: Path, size: tuple[int, int] = SIZE, rate: int = 30):
    """Makes an H.264 movie of numbered pictures, in a scene of its own that goes again."""
    import bpy

    scene = bpy.data.scenes.new("encoding")
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    strip = strips.new_image("pictures", str(folder / f"{frames[0]:04}.png"), 1, 1)
    for frame in frames[1:]:
        strip.elements.append(f"{frame:04}.png")
    scene.frame_start, scene.frame_end = 1, len(frames)
    render, settings = scene.render, scene.render.image_settings
    render.resolution_x, render.resolution_y, render.fps, render.resolution_percentage = *size, rate, 100
    scene.view_settings.view_transform = "Standard"
    if hasattr(settings, "media_type"):
        settings.media_type = "VIDEO"
    settings.file_format = "FFMPEG"
    render.ffmpeg.format, render.ffmpeg.codec = "MPEG4", "H264"
    render.ffmpeg.constant_rate_factor, render.ffmpeg.gopsize = "HIGH", 5
    render.filepath, render.use_file_extension = str(movie), False
    bpy.ops.render.render(animation=True, scene=scene.name)
    bpy.data.scenes.remove(scene)
