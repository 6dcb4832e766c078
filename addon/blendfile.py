# SPDX-License-Identifier: GPL-3.0-or-later
"""What the command line asks of Blender, where there is one: cameras out of a `.blend`, a take saved as one."""

import ctypes
import importlib.util
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path

import numpy as np

from .core.data.errors import JobError
from .core.data.markersets import MarkerSet
from .core.data.takes import Blobs, LabelledChunk
from .core.geometry.cameras import Cameras
from .io.cameras import read_cameras
from .io.names import written

Chunks = list[tuple[Blobs, LabelledChunk]]


def has_blender() -> bool:
    """Whether bpy can be imported."""
    return "bpy" in sys.modules or importlib.util.find_spec("bpy") is not None


def open_cameras(path: Path, up: str | None = None) -> Cameras:
    """A calibration of any kind, the cameras of a `.blend` included where Blender is here; InputError otherwise.

    `up` is the axis that points up in its world, where that is known better than from the file.
    """
    return read_cameras(path, _read_blend if has_blender() else None, up)


def _read_blend(path: Path) -> Cameras:
    from .scene.cameras import cameras_of_blend

    with silenced():
        return cameras_of_blend(path)


def save_blend(
    path: Path,
    name: str,
    source: Path,
    rate: float,
    cameras: Cameras,
    markerset: MarkerSet,
    chunks: Chunks,
    points: np.ndarray | None = None,
    residual: np.ndarray | None = None,
):
    """Saves a Blender file with nothing in it but the take. What was open in this Blender is gone.

    points (N, 3) m with their residual (N,) m are given where the rows of `chunks` are points; those without a name are
    there as one object.
    """
    import bpy

    from .scene import take as scenes

    labels, motion, suspects = scenes.join_labelled([chunk for _, chunk in chunks])
    blobs = scenes.join_blobs(blobs for blobs, _ in chunks)
    # Blender's texts are UTF-8, and the name of a file may be any bytes.
    name, source = written(name), written(str(source))
    take = scenes.Take(name, rate, cameras, markerset, blobs, labels, motion, suspects, source, points, residual)
    with silenced():
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        scenes.show_take(bpy.context, take, unnamed=points is not None)
        try:
            bpy.ops.wm.save_as_mainfile(filepath=os.fsencode(path), compress=True, copy=True, relative_remap=False)
        except RuntimeError as error:  # Blender's way of saying that a disk is full or a folder gone
            reason = str(error).removeprefix("Error: ").strip().rstrip(".")
            raise JobError(f"the Blender file cannot be written: {reason}; expected a place with room", path) from error


def refuse_long(first: int, last: int):
    """Raises JobError where a take has more frames, `first` to `last`, than a Blender file can show."""
    from .scene.take import frame_shift

    frame_shift(np.array([first, last]))


@contextmanager
def silenced() -> Iterator[None]:
    """Keeps what Blender itself prints off standard output, where only results belong."""
    sys.stdout.flush()
    try:
        kept = os.dup(1)
    except OSError:  # a program without a console has no output to keep
        yield
        return
    try:
        with Path(os.devnull).open("w") as nothing, redirect_stdout(nothing):
            os.dup2(nothing.fileno(), 1)
            yield
    finally:
        _flush_c_output()
        os.dup2(kept, 1)
        os.close(kept)


def drop_banner():
    """Throws away the greeting that Blender has printed and not yet sent, so that results stand alone."""
    if "bpy" in sys.modules and sys.modules["bpy"].app.binary_path:
        with silenced():
            pass


def _flush_c_output():
    """Sends what C code has printed: its buffer is not Python's."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL("ucrtbase" if os.name == "nt" else None).fflush(None)
