# SPDX-License-Identifier: GPL-3.0-or-later
"""What a take needs before it can be labelled: a calibration and the blobs, from files or dropped into the view."""

from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ..io.blobs import read_blobs
from ..io.cameras import read_cameras
from ..props import refresh_review
from ..scene import cameras as scene_cameras
from ..scene.preview import store_preview
from ..scene.take import frame_shift, join_blobs, set_time
from .reporting import reports_trouble

CALIBRATIONS = ".toml;.xcp;.txt;.xml;.qca;.mcal;.yml;.yaml;.cal;.rad;.blend"


class ImportsFile(ImportHelper):
    """What the imports share: a file that was dropped, or named by a script, is read at once; else one is asked for."""

    filepath: StringProperty(name="File", description="The file to read", subtype="FILE_PATH", options={"SKIP_SAVE"})

    def invoke(self, context, event):
        if self.properties.is_property_set("filepath"):
            return self.execute(context)
        return ImportHelper.invoke(self, context, event)


class MOCAP_AUTOLABEL_OT_import_cameras(bpy.types.Operator, ImportsFile):
    """Read a camera calibration and add its cameras to the scene."""

    bl_idname = "mocap_autolabel.import_cameras"
    bl_label = "Import Calibration"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(
        default=";".join(f"*{suffix}" for suffix in CALIBRATIONS.split(";")), options={"HIDDEN"}, maxlen=255
    )

    @reports_trouble
    def execute(self, context):
        cameras = read_cameras(Path(self.filepath), read_blend=scene_cameras.cameras_of_blend)
        collection = scene_cameras.find_or_add_cameras(context.scene, cameras)
        context.scene.mocap_autolabel.cameras = collection
        self.report({"INFO"}, f"{len(cameras)} cameras: {', '.join(cameras.names)}")
        return {"FINISHED"}


class MOCAP_AUTOLABEL_OT_use_cameras(bpy.types.Operator):
    """Take the cameras of this scene as they stand for the ones that recorded the take."""

    bl_idname = "mocap_autolabel.use_cameras"
    bl_label = "Use the Scene's Cameras"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        if any(item.type == "CAMERA" for item in context.scene.objects):
            return True
        cls.poll_message_set("This scene has no cameras")
        return False

    @reports_trouble
    def execute(self, context):
        collection = scene_cameras.adopt_cameras(context.scene)
        context.scene.mocap_autolabel.cameras = collection
        self.report({"INFO"}, f"{len(collection.objects)} cameras")
        return {"FINISHED"}


class MOCAP_AUTOLABEL_OT_import_blobs(bpy.types.Operator, ImportsFile):
    """Choose the file of the blobs to label, and look at them through the cameras."""

    bl_idname = "mocap_autolabel.import_blobs"
    bl_label = "Import Blobs"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default="*.csv", options={"HIDDEN"})

    @classmethod
    def poll(cls, context):
        if cameras_at_hand(context.scene):
            return True
        cls.poll_message_set("Import the calibration of the cameras first")
        return False

    @reports_trouble
    def execute(self, context):
        settings, path = context.scene.mocap_autolabel, Path(self.filepath)
        cameras = scene_cameras.cameras_of(settings.cameras, context.scene)
        blobs = join_blobs(part.blobs for part in read_blobs(path, cameras))
        if settings.preview is not None:
            bpy.data.meshes.remove(settings.preview)
        settings.preview = store_preview(path.stem, blobs, cameras)
        settings.blobs_path, settings.blob_count = str(path), len(blobs)
        settings.first_frame, settings.last_frame = int(blobs.frames[0]), int(blobs.frames[-1])
        settings.range_first, settings.range_last = settings.first_frame, settings.last_frame
        settings.take = None
        refresh_review(context.window_manager, context.scene)
        set_time(context.scene, settings.rate, blobs.frames + frame_shift(blobs.frames))
        self.report({"INFO"}, f"{len(blobs)} blobs in {len(blobs.frames)} frames")
        return {"FINISHED"}


class MOCAP_AUTOLABEL_FH_cameras(bpy.types.FileHandler):
    """Drop a calibration into the 3D view."""

    bl_idname = "MOCAP_AUTOLABEL_FH_cameras"
    bl_label = "Mocap: camera calibration"
    bl_import_operator = "mocap_autolabel.import_cameras"
    bl_file_extensions = ".toml;.xcp;.txt;.xml;.qca;.mcal;.yml;.yaml;.cal;.rad"

    @classmethod
    def poll_drop(cls, context):
        return in_view(context)


class MOCAP_AUTOLABEL_FH_blobs(bpy.types.FileHandler):
    """Drop a file of blobs into the 3D view."""

    bl_idname = "MOCAP_AUTOLABEL_FH_blobs"
    bl_label = "Mocap: camera blobs"
    bl_import_operator = "mocap_autolabel.import_blobs"
    bl_file_extensions = ".csv"

    @classmethod
    def poll_drop(cls, context):
        return in_view(context)


def cameras_at_hand(scene: bpy.types.Scene) -> bool:
    """True when the scene's settings name cameras that are still there."""
    collection = scene.mocap_autolabel.cameras
    return collection is not None and any(item.type == "CAMERA" for item in collection.all_objects)


def in_view(context: bpy.types.Context) -> bool:
    """True over a 3D view, where our files may be dropped."""
    return context.area is not None and context.area.type == "VIEW_3D"


CLASSES = (
    MOCAP_AUTOLABEL_OT_import_cameras,
    MOCAP_AUTOLABEL_OT_use_cameras,
    MOCAP_AUTOLABEL_OT_import_blobs,
    MOCAP_AUTOLABEL_FH_cameras,
    MOCAP_AUTOLABEL_FH_blobs,
)
