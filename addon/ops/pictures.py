# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs out of pictures: bright spots in movies of calibrated cameras, and tracks of Blender's own movie clips."""

from functools import partial
from pathlib import Path

import bpy
from bpy.props import CollectionProperty, EnumProperty, FloatProperty, StringProperty

from ..core.data.errors import InputError, UserError
from ..core.data.wording import count_of
from ..core.pictures.spots import SpotOptions
from ..io.blobs import write_blobs
from ..io.whole import free_path, whole_file
from ..jobs.pictures import (
    CENTRE,
    CORNER,
    FIRST_PIXEL,
    PicturesJob,
    blobs_of_pictures,
    camera_in,
    check_size,
    pictures_by_camera,
)
from ..scene import cameras as scene_cameras
from ..scene.pictures import blobs_of_clips, clip_of, lens_of
from .base import Ours, once, unless
from .importing import AT_1, NEEDS_CAMERA, cameras_at_hand, lacks_cameras, look_who_is_there, take_blobs
from .long_work import LongWork, nothing_goes_on

BLOBS_ENDING = ".blobs.csv"
FIRST_PIXEL_ITEMS = [
    ("AUTO", "As the Cameras Have It", "A corner for cameras of this scene's own, the centre for a calibration's"),
    (CENTRE, "Centre of the First Pixel", "As OpenCV calibrates"),
    (CORNER, "Corner of the First Pixel", "As Blender renders"),
]


class CountsPixels:
    """What is asked of whoever turns pictures into blobs: where the calibration's pixels begin, and where blobs go."""

    first_pixel: once(EnumProperty, "(0, 0) Is", "Where the pixels of the calibration begin", items=FIRST_PIXEL_ITEMS)
    out: once(
        StringProperty,
        "Blobs",
        "The file of blobs to write; beside the pictures where none is given",
        subtype="FILE_PATH",
    )

    def first_of(self, own: bool) -> str:
        """Where pixels begin, in a calibration's cameras or in the scene's own."""
        if self.first_pixel != FIRST_PIXEL_ITEMS[0][0]:
            return self.first_pixel
        return CORNER if own else CENTRE

    def target(self, beside: Path) -> Path:
        return Path(bpy.path.abspath(self.out)) if self.out else free_path(beside.with_suffix(""), BLOBS_ENDING)


class MOCAP_AUTOLABEL_OT_find_blobs(CountsPixels, LongWork, bpy.types.Operator):
    """Find bright round spots in movies or image sequences of the calibrated cameras, a file or folder for each."""

    bl_label = "Blobs from Pictures"

    doing = "Finding blobs"

    directory: StringProperty(subtype="DIR_PATH", options={"SKIP_SAVE", "HIDDEN"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"SKIP_SAVE", "HIDDEN"})
    at_1: AT_1
    filter_movie: bpy.props.BoolProperty(default=True, options={"HIDDEN"})
    filter_image: bpy.props.BoolProperty(default=True, options={"HIDDEN"})
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})
    threshold: FloatProperty(
        name="Threshold", description="Spots are brighter; 0 where the pictures tell", min=0.0, max=1.0
    )
    min_area: FloatProperty(
        name="Least Area", description="Smaller spots are left out, px²", default=SpotOptions.min_area, min=0.0
    )
    max_area: FloatProperty(
        name="Greatest Area", description="Larger spots are left out, px²", default=SpotOptions.max_area, min=1.0
    )

    needs = (lacks_cameras, nothing_goes_on)

    def invoke(self, context, event):
        return super().invoke(context, event) if self.directory else self.ask_for_file(context)

    def asked(self, context) -> partial:
        scene, settings = context.scene, context.scene.mocap_autolabel
        cameras = scene_cameras.cameras_of(settings.source.cameras, scene)
        pictures = pictures_by_camera([(None, path) for path in self._chosen(cameras.names)], cameras.names)
        job = PicturesJob(
            pictures=pictures,
            cameras=cameras,
            out=self.target(next(iter(pictures.values()))),
            first_pixel=self.first_of(scene_cameras.is_adopted(settings.source.cameras)),
            overwrite=bool(self.out),
            spots=SpotOptions(threshold=self.threshold or None, min_area=self.min_area, max_area=self.max_area),
        )
        return partial(blobs_of_pictures, job)

    def _chosen(self, names: tuple[str, ...]) -> list[Path]:
        """The files that were chosen, or all in the folder that have a camera's name."""
        folder = Path(bpy.path.abspath(self.directory))
        chosen = [folder / item.name for item in self.files if item.name]
        if chosen:
            return chosen
        inside = sorted(folder.iterdir()) if folder.is_dir() else ()
        some = [path for path in inside if path.is_dir() or path.suffix.lower() in bpy.path.extensions_movie]
        there = [path for path in some if _is_of_camera(path, names)]
        if not there:
            words = "holds no movie and no folder of pictures that has a camera's name"
            raise InputError(f"{words}; expected one for each camera", folder)
        return there

    def _show(self, context, made: dict):
        _use(context, Path(made["out"]), made["rate"], self.at_1)
        for words in made["notes"]:
            self.report({"WARNING"}, words)
        self.report(
            {"INFO"},
            f"{count_of(made['blobs'], 'blob')} in {count_of(made['frames'], 'frame')}, in {Path(made['out']).name}",
        )
        look_who_is_there(context)


class MOCAP_AUTOLABEL_OT_import_clip_tracks(CountsPixels, Ours, bpy.types.Operator):
    """Take the tracks of the movie clips of the scene's cameras as blobs."""

    bl_label = "Blobs from Clip Tracks"

    needs = (NEEDS_CAMERA, unless(lambda _: len(bpy.data.movieclips), "Open the movie clips and track them first"))

    def work(self, context):
        scene, settings = context.scene, context.scene.mocap_autolabel
        there = cameras_at_hand(scene)
        own = not there or scene_cameras.is_adopted(settings.source.cameras)
        items = scene_cameras.originals(settings.source.cameras.all_objects if there else scene.objects)
        clips, cameras = _clips_of(items, scene), scene_cameras.calibrations(items, scene)
        used = {cameras.names.index(name): clip for name, clip in clips.items()}
        for index, clip in used.items():
            check_size(tuple(clip.size), cameras, index, bpy.path.abspath(clip.filepath))
        untold = [index for index in used if own and not cameras.distortion[index].any()]
        lenses = {index: lens_of(used[index]) for index in untold}
        blobs = blobs_of_clips(used, cameras.size, FIRST_PIXEL[CORNER] - FIRST_PIXEL[self.first_of(own)])
        first = next(iter(used.values()))
        path = self.target(Path(bpy.path.abspath(first.filepath)))
        with whole_file(path, bool(self.out)) as temporary:
            write_blobs(temporary, blobs, cameras)
        for index, lens in lenses.items():
            items[index].data[scene_cameras.DISTORTION] = lens
        if not there:
            settings.source.cameras = scene_cameras.adopt_cameras(scene)
        _use(context, path, first.fps)
        self.report({"INFO"}, f"{count_of(len(blobs), 'blob')} of {count_of(len(used), 'clip')}, in {path.name}")


def _clips_of(cameras: list[bpy.types.Object], scene: bpy.types.Scene) -> dict[str, bpy.types.MovieClip]:
    """The clip of each camera by its name: the one it is solved by or shows, else the one named like it.

    Raises InputError where two cameras share one, or none has any.
    """
    named = {scene_cameras.camera_name(camera): clip_of(camera, scene) for camera in cameras}
    found = {name: clip for name, clip in named.items() if clip is not None}
    in_use = {clip.name for clip in found.values()}
    for clip in bpy.data.movieclips:
        path = Path(bpy.path.abspath(clip.filepath))
        left = [name for name in named if name not in found]
        if clip.name not in in_use and left and _is_of_camera(path, left):
            found[camera_in(path, left)] = clip
    if len({clip.name for clip in found.values()}) < len(found):
        raise InputError("two cameras have the same clip; expected a clip for each camera")
    if not found:
        words = "no camera is solved by a movie clip, shows one, or has its name in that of one"
        raise InputError(f"{words}; expected a clip for each camera")
    return found


def _is_of_camera(path: Path, names: tuple[str, ...] | list[str]) -> bool:
    try:
        return bool(camera_in(path, names))
    except UserError:
        return False


def _use(context: bpy.types.Context, path: Path, rate: float | None, at_1: bool = False):
    """Makes a file of blobs the scene's take, at the rate of its pictures; it may begin at the scene's frame 1."""
    settings = context.scene.mocap_autolabel
    settings.source.rate = rate or settings.source.rate
    take_blobs(context, path, at_1)
