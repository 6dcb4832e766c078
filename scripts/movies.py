# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures and movies that are drawn, and written by Blender, for window tests and screenshots."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from addon.core.geometry.cameras import Cameras
from addon.io.blobs import read_blobs

RADIUS = 3  # px, of what is drawn for a blob


def write_virtual_movies(folder: Path, cameras: Cameras, frames: int) -> None:
    """Write NAME.mp4 of each camera to `folder`: discs on black where the blobs of take.csv beside it are."""
    folder.mkdir()
    blobs = next(iter(read_blobs(folder.parent / "take.csv", cameras))).blobs
    for index, (name, size) in enumerate(zip(cameras.names, cameras.size, strict=True)):
        pictures = folder / name
        pictures.mkdir()
        for frame in range(frames):
            own = blobs.xy[(blobs.camera == index) & (blobs.frame == frame)]
            save_picture(pictures / f"{frame + 1:04}.png", _discs(own, tuple(map(int, size))))
        encode(pictures, range(1, frames + 1), folder / f"{name}.mp4", tuple(map(int, size)))
        shutil.rmtree(pictures)  # a folder of pictures would be the camera's as well


def _discs(places: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(H, W) white discs, softened by a pixel."""
    shown = np.zeros(size[::-1])
    for x, y in places:
        left, top = max(int(x) - 2 * RADIUS, 0), max(int(y) - 2 * RADIUS, 0)
        part = shown[top : int(y) + 2 * RADIUS, left : int(x) + 2 * RADIUS]
        rows, columns = np.indices(part.shape)
        away = np.hypot(columns + left - x, rows + top - y)
        np.maximum(part, np.clip(RADIUS + 0.5 - away, 0, 1), out=part)
    return shown


def save_picture(path: Path, grey: np.ndarray) -> None:
    """Write (H, W) brightness, row 0 at the top, as a PNG."""
    import bpy

    height, width = grey.shape
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = grey[::-1, :, None]
    image = bpy.data.images.new("drawn", width, height)
    image.pixels.foreach_set(pixels.ravel())
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.data.images.remove(image)


def encode(
    folder: Path, frames: Sequence[int], movie: Path, size: tuple[int, int], rate: int = 30, keyed_every: int = 5
) -> None:
    """Make an H.264 movie of numbered pictures, in a scene of its own that goes again."""
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
    render.ffmpeg.constant_rate_factor, render.ffmpeg.gopsize = "HIGH", keyed_every
    render.filepath, render.use_file_extension = str(movie), False
    bpy.ops.render.render(animation=True, scene=scene.name)
    bpy.data.scenes.remove(scene)
