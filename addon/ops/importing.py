# SPDX-License-Identifier: GPL-3.0-or-later
"""What a take needs before it can be labelled: blobs and a calibration, or 3D points, from files or dropped."""

from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..core.data.errors import InputError
from ..core.data.takes import Blobs, evenly_spread
from ..core.data.wording import count_of
from ..core.geometry.camera_up import AXIS_NAMES
from ..core.geometry.cameras import Cameras
from ..io.blobs import read_blobs
from ..io.cameras import read_cameras
from ..io.edits import edits_beside
from ..io.points import holds_points, read_points
from ..io.qtm.capture import USE_BLOBS, held_in, is_qtm
from ..jobs.job import blob_rate, capture_notes
from ..props import refresh_review
from ..scene import cameras as scene_cameras
from ..scene.opened import opened
from ..scene.preview import remove_preview, show_points, store_preview
from ..scene.take import fps_of, frame_shift, give_time, set_time
from .base import Ours, once, unless
from .viewing import MAX_PLACES, fit_timelines, show_take_whole

BLOBS, POINTS = "*.csv;*.qtm", "*.c3d;*.trc;*.csv;*.qtm"
UP_ITEMS = [("AUTO", "As the File Says", "Or, where it does not say, as what is in it tells")] + [
    (axis, axis.upper(), f"{axis.upper()} points up in the file") for axis in AXIS_NAMES
]
CALIBRATIONS = ".toml;.xcp;.txt;.xml;.qca;.qtm;.mcal;.yml;.yaml;.cal;.rad;.blend"
USE_ITEMS = [
    ("AUTO", "Blobs if They Can Be Used", "The blobs where their cameras are calibrated, else the 3D points"),
    ("blobs", "Blobs", "What the cameras saw"),
    ("points", "3D Points", "What the capture program made of it; its names are not looked at"),
]


NEEDS_CAMERA = unless(
    lambda context: any(item.type == "CAMERA" for item in context.scene.objects), "This scene has no cameras"
)


class ImportsFile(Ours, ImportHelper):
    """What the imports share: a file that was dropped, or named by a script, is read at once; else one is asked for.

    They differ in `take_in`, which makes a file part of the scene and says what is in it; UserError if it cannot.
    """

    filepath: once(StringProperty, "File", "The file to read", subtype="FILE_PATH")

    def invoke(self, context, event):
        if self.properties.is_property_set("filepath"):
            return self.execute(context)
        return ImportHelper.invoke(self, context, event)

    def work(self, context):
        self.report({"INFO"}, self.take_in(context, Path(self.filepath)))


class MOCAP_AUTOLABEL_OT_import_cameras(ImportsFile, bpy.types.Operator):
    """Read a camera calibration and add its cameras to the scene."""

    bl_label = "Import Calibration"
    filter_glob: StringProperty(default=CALIBRATIONS.replace(".", "*."), options={"HIDDEN"}, maxlen=255)
    up: once(EnumProperty, "Up", "The axis that points up in the calibration", items=UP_ITEMS)

    def take_in(self, context, path: Path) -> str:
        up = None if self.up == "AUTO" else self.up
        cameras = read_cameras(path, read_blend=scene_cameras.cameras_of_blend, up=up)
        collection = scene_cameras.find_or_add_cameras(context.scene, cameras)
        context.scene.mocap_autolabel.source.cameras = collection
        return "; ".join([f"{count_of(len(cameras), 'camera')}: {', '.join(cameras.names)}", *cameras.remarks])


class MOCAP_AUTOLABEL_OT_use_cameras(Ours, bpy.types.Operator):
    """Take the cameras of this scene as they stand for the ones that recorded the take."""

    bl_label = "Use the Scene's Cameras"

    needs = (NEEDS_CAMERA,)

    def work(self, context):
        collection = scene_cameras.adopt_cameras(context.scene)
        context.scene.mocap_autolabel.source.cameras = collection
        self.report({"INFO"}, count_of(len(collection.objects), "camera"))


class MOCAP_AUTOLABEL_OT_import_blobs(ImportsFile, bpy.types.Operator):
    """Choose the file of the blobs to label, and look at them through the cameras, which a .qtm brings itself."""

    filter_glob: StringProperty(default=BLOBS, options={"HIDDEN"})

    def take_in(self, context, path: Path) -> str:
        if holds_points(path, USE_BLOBS if is_qtm(path) else None):
            raise InputError("holds 3D points; expected blobs, or Import 3D Points", path)
        return take_blobs(context, path)


class ReadsPoints:
    """What is asked of whoever reads 3D points: what is known of them better than from their file."""

    up: once(EnumProperty, "Up", "The axis that points up in the 3D points", items=UP_ITEMS)
    rate: once(
        FloatProperty,
        "Rate",
        "Frames a second of 3D points whose file says none; 0 where it does",
        min=0.0,
        max=100_000.0,
    )

    mirror: once(
        BoolProperty,
        "Mirror",
        "Reverse an axis of 3D points whose axes are left-handed: left and right are exchanged in them",
    )

    @property
    def known_up(self) -> str | None:
        """The axis that was chosen, None for what the file says or tells."""
        return None if self.up == UP_ITEMS[0][0] else self.up


class MOCAP_AUTOLABEL_OT_import_points(ReadsPoints, ImportsFile, bpy.types.Operator):
    """Choose a take of 3D points to label, C3D, TRC, Motive CSV or Qualisys QTM, and see them. Needs no cameras."""

    bl_label = "Import 3D Points"
    filter_glob: StringProperty(default=POINTS, options={"HIDDEN"})

    def take_in(self, context, path: Path) -> str:
        return take_points(context, path, self.known_up, self.rate, self.mirror)


class MOCAP_AUTOLABEL_OT_import_take(ReadsPoints, ImportsFile, bpy.types.Operator):
    """Read a take to label, whether it holds blobs, 3D points, or, as a Qualisys QTM may, both."""

    filter_glob: StringProperty(default=POINTS, options={"HIDDEN"})
    use: once(EnumProperty, "Use", "What to label of a .qtm that holds both", items=USE_ITEMS)

    def take_in(self, context, path: Path) -> str:
        if holds_points(path, self.use if is_qtm(path) and self.use != USE_ITEMS[0][0] else None):
            return take_points(context, path, self.known_up, self.rate, self.mirror)
        return take_blobs(context, path)


def take_blobs(context: bpy.types.Context, path: Path) -> str:
    """Makes a file of blobs the scene's take and says what is in it; InputError where it cannot be used."""
    scene, source = context.scene, context.scene.mocap_autolabel.source
    cameras, own = _cameras_for(scene, path)
    blobs = Blobs.join(part.blobs for part in read_blobs(path, cameras))
    forget_take(context)
    if own:
        source.cameras = scene_cameras.find_or_add_cameras(scene, cameras)
    source.preview = store_preview(path.stem, blobs, cameras)
    source.blobs_path, source.blob_count = str(path), len(blobs)
    source.rate = blob_rate(path, None) or source.rate
    kept = _set_frames(context, blobs.frames)
    fit_timelines(context)
    summary = f"{count_of(len(blobs), 'blob')} in {count_of(len(blobs.frames), 'frame')}"
    return "; ".join([summary, *kept, *(cameras.remarks if own else ()), *capture_notes(path, False, cameras)])


def _cameras_for(scene: bpy.types.Scene, path: Path) -> tuple[Cameras, bool]:
    """The cameras that a file of blobs is looked at through, and whether they are its own; InputError for none.

    Those of the scene count where they are the file's: somebody may have refined them.
    """
    chosen = scene_cameras.cameras_of(scene.mocap_autolabel.source.cameras, scene) if cameras_at_hand(scene) else None
    if is_qtm(path):
        own = held_in(path).calibrated
        if chosen is None or (own and not set(own) <= set(chosen.names)):
            return read_cameras(path), True
    if chosen is None:
        raise InputError("holds blobs, which need the calibration of their cameras; expected that to be imported", path)
    return chosen, False


def take_points(
    context: bpy.types.Context, path: Path, up: str | None = None, rate: float = 0.0, mirror: bool = False
) -> str:
    """Makes a file of 3D points the scene's take and says what is in it; InputError where it cannot be used.

    `up` is the axis that points up in it where the user knows, `rate` is used where the file says none;
    `mirror` reverses an axis of one whose axes are left-handed.
    """
    source, take = context.scene.mocap_autolabel.source, read_points(path, up=up, rate=rate or None, mirror=mirror)
    forget_take(context)
    source.preview = show_points(context.scene, path.stem, take)
    source.points_path, source.blob_count = str(path), len(source.preview.vertices)
    source.up, source.mirror = up or "", mirror
    source.trajectories, source.rate = len(take.names), take.rate
    kept = _set_frames(context, take.first_frame + np.arange(len(take.xyz)))
    show_take_whole(context, take.xyz[evenly_spread(len(take.xyz), MAX_PLACES)].reshape(-1, 3))
    edits = edits_beside(path)
    more = [] if edits is None else [f"{edits.name} beside it will be applied"]
    summary = f"{count_of(source.trajectories, 'trajectory')} in {count_of(len(take.xyz), 'frame')}"
    return "; ".join([summary, *kept, *take.notes, *more, *capture_notes(path, True)])


def forget_take(context: bpy.types.Context):
    """Makes room for another take; one that is labelled stays in the scene."""
    settings = context.scene.mocap_autolabel
    settings.take = None
    if settings.source.preview is not None:
        preview, settings.source.preview = settings.source.preview, None
        remove_preview(preview)
        opened.forget()
    settings.source.blobs_path = settings.source.points_path = context.window_manager.mocap_autolabel.refused = ""
    settings.source.forced = False
    refresh_review(context.window_manager, context.scene)


def _set_frames(context: bpy.types.Context, frames: np.ndarray) -> list[str]:
    """Notes the frames of the take and has the scene play them; what there is to say where it does not."""
    source, labelling = context.scene.mocap_autolabel.source, context.scene.mocap_autolabel.labelling
    source.first_frame, source.last_frame = int(frames[0]), int(frames[-1])
    labelling.range_first, labelling.range_last = source.first_frame, source.last_frame
    if give_time(context.scene, source.rate, frames + frame_shift(frames)):
        return []
    return [f"the scene keeps its {fps_of(context.scene):g} frames a second, because something in it is animated"]


class MOCAP_AUTOLABEL_OT_play_as_take(Ours, bpy.types.Operator):
    """Give the scene the frame rate and the frames of the take; what else is animated in it keeps its frames."""

    bl_label = "Play as the Take"

    def work(self, context):
        source = context.scene.mocap_autolabel.source
        frames = np.array([source.first_frame, source.last_frame])
        set_time(context.scene, source.rate, frames + frame_shift(frames))


class DropsIntoView:
    """What is dropped goes into a 3D view."""

    @classmethod
    def poll_drop(cls, context):
        return context.area is not None and context.area.type == "VIEW_3D"


class MOCAP_AUTOLABEL_FH_cameras(DropsIntoView, bpy.types.FileHandler):
    """Drop a calibration into the 3D view."""

    bl_label = "Mocap: camera calibration"
    bl_import_operator = "mocap_autolabel.import_cameras"
    bl_file_extensions = ".toml;.xcp;.txt;.xml;.qca;.mcal;.yml;.yaml;.cal;.rad"


class MOCAP_AUTOLABEL_FH_take(DropsIntoView, bpy.types.FileHandler):
    """Drop blobs or 3D points into the 3D view; what a `.csv` holds is told from its first line."""

    bl_label = "Mocap: take to label"
    bl_import_operator = "mocap_autolabel.import_take"
    bl_file_extensions = ".csv;.c3d;.trc;.qtm"


def cameras_at_hand(scene: bpy.types.Scene) -> bool:
    """True when the scene's settings name cameras that are still there."""
    collection = scene.mocap_autolabel.source.cameras
    return collection is not None and any(item.type == "CAMERA" for item in collection.all_objects)


lacks_cameras = unless(lambda context: cameras_at_hand(context.scene), "Import the calibration of the cameras first")
