# SPDX-License-Identifier: GPL-3.0-or-later
"""What jobs ask of Blender, where there is one: cameras of a `.blend`, rays cast at meshes, a take saved."""

import ctypes
import importlib.util
import os
import shutil
import signal
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .core.data.errors import InputError, JobError
from .core.data.lanes import blocks
from .core.data.markersets import MarkerSet, Worn
from .core.data.takes import Blobs, LabelledChunk, PointRows, Points, Suspect
from .core.edits.kinds import NO_EDITS, Edits
from .core.geometry.cameras import Cameras
from .core.geometry.force_plates import NO_LAB, LabRecords
from .io.cameras import read_cameras
from .io.scratch import lasting_scratch, scratch_folder
from .io.text import written
from .io.whole import check_targets, whole_file

if TYPE_CHECKING:  # only some jobs need them
    from .core.filling.kept import KeptFill
    from .core.papers.virtual_occlusions.occlusion import Occlusion
    from .core.retarget.moving import Moving
    from .io.poses import PoseFile
    from .scene.pictures import Movie
    from .scene.pictures import Sequence as PictureSequence

# The rows that were labelled, and what is said of them.
Chunks = list[tuple[Blobs | PointRows, LabelledChunk]]


def has_blender() -> bool:
    """Whether bpy can be imported."""
    return "bpy" in sys.modules or importlib.util.find_spec("bpy") is not None


def inside_blender() -> bool:
    """Whether this is Blender, or a Python that has started it."""
    return "bpy" in sys.modules


def open_cameras(path: Path, up: str | None = None) -> Cameras:
    """A calibration of any kind, the cameras of a `.blend` included where Blender is here; InputError otherwise.

    `up` is the axis that points up in its world, where that is known better than from the file.
    """
    return read_cameras(path, _read_blend if has_blender() else None, up)


def _read_blend(path: Path) -> Cameras:
    start_blender()
    from .scene.cameras import cameras_of_blend

    with silenced():
        return cameras_of_blend(path)


def start_blender():
    """Imports bpy, which takes a second in which whatever stops the process is noted, and raised behind it."""
    if "bpy" in sys.modules:
        return
    with unbroken(), _own_temporary_files():
        import bpy  # noqa: F401


@contextmanager
def _own_temporary_files() -> Iterator[None]:
    """Blender, loaded in the block, keeps its temporary files where the next run takes them away if this is killed.

    It does so until preferences are read: it looks for a place again then.
    """
    try:
        folder = str(lasting_scratch())
    except JobError:  # it then looks for a place by itself, and needs it seldom
        yield
        return
    before = {name: os.environ.get(name) for name in ("TMPDIR", "TEMP", "TMP")}
    os.environ.update(dict.fromkeys(before, folder))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def unbroken() -> Iterator[None]:
    """Notes what asks this process to stop while the block runs, and lets it be raised behind the block.

    Raised while Blender is at work it is lost, as in a handler of an add-on, or leaves a Blender that crashes.
    """
    # Windows has no SIGHUP. What Python does not handle, such as what nohup ignores, stays as it is.
    kinds = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {kind: handler for kind in kinds if callable(handler := signal.getsignal(kind))}
    noted: list[int] = []
    try:
        for kind in before:
            signal.signal(kind, lambda number, _: noted.append(number))
        yield
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)
        for kind in noted[:1]:
            before[kind](kind, None)


def mesh_occlusion(markerset: MarkerSet) -> "Occlusion":
    """Rays cast at the meshes of a marker set's capsules; InputError where there is no Blender."""
    if not has_blender():
        raise InputError("--occlusion bvh needs Blender or the bpy package, and neither is here; expected one of them")
    start_blender()
    from .scene.occlusion import capsule_meshes

    return capsule_meshes(markerset)


@contextmanager
def opened_pictures(paths: Iterable[Path]) -> "Iterator[list[Movie | PictureSequence]]":
    """Movies and image sequences, as Blender reads them; InputError for one that it cannot, or without a Blender."""
    if not has_blender():
        words = "pictures are read by Blender, and neither Blender nor the bpy package is here"
        raise InputError(f"{words}; expected one of them")
    start_blender()
    from .scene.pictures import open_pictures, small_cache

    with ExitStack() as stack:
        stack.enter_context(small_cache())
        yield [stack.enter_context(closing(open_pictures(path))) for path in paths]


def save_blend(
    path: Path,
    source: Path,
    rate: float,
    worn: Worn,
    chunks: Chunks,
    cameras: Cameras,
    edits: Edits = NO_EDITS,
    fills: "tuple[KeptFill, ...]" = (),
    lab: LabRecords = NO_LAB,
):
    """Saves a Blender file with nothing in it but the take. What was open in this Blender is gone.

    Of points those without a name are there as one object. The edits that the labels follow can be gone on with.
    Filled gaps are marked, and can be taken back.
    """
    start_blender()
    import bpy

    from .scene import take as scenes

    # Blender's texts are UTF-8, and the name of a file may be any bytes.
    name, file = written(source.stem), written(str(source))
    take = scenes.Take.of(name, rate, cameras, worn, chunks, file, edits=edits or None, fills=fills, lab=lab)
    with _new_file(path):
        scenes.show_take(bpy.context, take)


def save_played(
    path: Path,
    cache: Path,
    source: Path,
    worn: Worn,
    points: Points,
    poses: "PoseFile",
    suspects: Sequence[Suspect],
    cameras: Cameras,
    for_a_part: dict,
):
    """Saves a Blender file that plays a long take from the file `cache` beside it, both of any length.

    `points` begin with the markers, measured or filled. `for_a_part` labels a part of it in the same way. What was
    open in this Blender is gone.
    """
    start_blender()
    import bpy

    from .scene.cameras import find_or_add_cameras
    from .scene.playing import Playing, show_playing

    def markers(part: slice) -> np.ndarray:
        found = np.empty((part.stop - part.start, len(worn.markers), 3))
        for block in blocks(len(found), points.xyz.shape[1]):
            some = slice(part.start + block.start, part.start + block.stop)
            found[block] = points.xyz[some][:, : len(worn.markers)]
        return found

    name, file = written(source.stem), written(str(source))
    take = Playing(name, points.rate, worn, markers, poses, tuple(suspects), file, for_a_part)
    with _new_file(path):
        if len(cameras):
            find_or_add_cameras(bpy.context.scene, cameras)
        show_playing(bpy.context, take, cache)


def save_characters(
    kind: str, files: Sequence[tuple[Path, bool, "Moving"]], read: Sequence[Path], names: str, scale: float
) -> Generator[float, Callable[[float], None] | None, list[Path]]:
    """Saves bodies as `export_character` does, each in its file, which may be replaced or not; gives the files.

    `kind` is "bvh" or "fbx", whatever they are called. What is `read` is not written over. What is open in this Blender
    stays as it is.
    """
    for path, overwrite, _ in files:
        check_targets([path], overwrite, read)
    start_blender()
    from .scene.character import export_character

    tell = yield 0.0
    for number, (path, overwrite, body) in enumerate(files):

        def hear(share: float, before: int = number):
            if tell is not None:
                tell((before + share) / len(files))

        # What is to end the work is lost in a handler of Blender's, so it may be killed: nothing is beside `path`.
        with scratch_folder() as folder:
            made = folder / f"body.{kind}"
            export_character(made, body, names, scale, hear)
            with whole_file(path, overwrite, read) as temporary:
                shutil.copyfile(made, temporary)
    return [path for path, _, _ in files]


@contextmanager
def _new_file(path: Path) -> Iterator[None]:
    """What the block shows is saved as a Blender file with nothing else in it; JobError where that cannot be."""
    import bpy

    with silenced():
        with unbroken():
            bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        yield
        whole = os.fsencode(path.absolute())  # Blender 4.5 goes from the folder in which the process began
        try:
            with unbroken():
                bpy.ops.wm.save_as_mainfile(filepath=whole, compress=True, copy=True, relative_remap=False)
        except RuntimeError as error:  # Blender's way of saying that a disk is full or a folder gone
            reason = str(error).removeprefix("Error: ").strip().rstrip(".")
            raise JobError(f"the Blender file cannot be written: {reason}; expected a place with room", path) from error


def refuse_long(first: int, last: int):
    """Raises JobError where a take has more frames, `first` to `last`, than a Blender file can show."""
    start_blender()
    from .scene.clock import TakeClock

    TakeClock.of(np.array([first, last]))


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
        with Path(os.devnull).open("w", encoding="utf-8", newline="\n") as nothing, redirect_stdout(nothing):
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
