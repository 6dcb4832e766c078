# SPDX-License-Identifier: GPL-3.0-or-later
"""Looking around in a take: through its cameras, at its doubtful frames; and putting it away."""

import bpy
from bpy.props import IntProperty, StringProperty

from ..core.data.errors import InputError
from ..props import refresh_review
from ..scene import naming
from ..scene.cameras import is_mocap_camera, look_through
from ..scene.opened import opened
from ..scene.ownership import persons_in
from ..scene.take import is_take, remove_take
from .base import Ours, lacks_object_mode


class MOCAP_AUTOLABEL_OT_look_through(Ours, bpy.types.Operator):
    """Look through this camera, with its own picture size and pixels."""

    bl_label = "Look Through"

    camera: StringProperty(name="Camera", description="Name of the camera object", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context):
        return context.scene is not None

    def work(self, context):
        camera = context.scene.objects.get(self.camera)
        if not is_mocap_camera(camera):
            words = f"{self.camera or 'nothing'} is not a calibrated camera of this scene"
            raise InputError(f"{words}; expected one of those")
        look_through(context.scene, camera)
        if context.space_data is not None and context.space_data.type == "VIEW_3D":
            context.space_data.region_3d.view_perspective = "CAMERA"


class MOCAP_AUTOLABEL_OT_jump(Ours, bpy.types.Operator):
    """Go to this frame, and select the marker if there is one to select."""

    bl_label = "Jump to Frame"

    frame: IntProperty(name="Frame", description="Frame to go to")
    marker: StringProperty(name="Marker", description="Marker to select", options={"SKIP_SAVE"})

    def work(self, context):
        context.scene.frame_set(self.frame)
        collection = context.scene.mocap_autolabel.take
        if self.marker and is_take(collection) and context.mode == "OBJECT":
            for item in context.selected_objects:
                item.select_set(False)
            for item in collection.all_objects:
                if item.get(naming.MARKER) == self.marker:
                    item.select_set(True)
                    context.view_layer.objects.active = item


class MOCAP_AUTOLABEL_OT_clear(Ours, bpy.types.Operator):
    """Remove the labelled take from the scene; its cameras and blobs stay, and so does all that you made or changed."""

    bl_label = "Remove Take"

    @classmethod
    def lacks(cls, context):
        if not is_take(context.scene.mocap_autolabel.take):
            return "There is no labelled take in this scene"
        return lacks_object_mode(context)

    def work(self, context):
        settings = context.scene.mocap_autolabel
        collection, settings.take = settings.take, None
        left = remove_take(collection)
        opened.forget()
        refresh_review(context.window_manager, context.scene)
        if left is not None:
            self.report({"INFO"}, f"What is yours is kept in {left.name}: {persons_in(left) or 'collections'}")
