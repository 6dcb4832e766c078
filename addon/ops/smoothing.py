# SPDX-License-Identifier: GPL-3.0-or-later
"""The markers of a take smoothed, in the scene and in what is exported, and as they were again."""

from functools import partial

import bpy

from ..core.filling.smoothing import smoothed
from ..scene.opened import opened
from ..scene.smoothing import keep_cutoff, kept_cutoff
from .filling import OfTake, keep_and_show
from .reporting import reports_trouble


class MOCAP_AUTOLABEL_OT_smooth(OfTake, bpy.types.Operator):
    """Smooth the markers by a Butterworth filter without lag, each stretch between gaps for itself; labels stay."""

    bl_idname = "mocap_autolabel.smooth"
    bl_label = "Smooth"
    bl_options = {"REGISTER", "UNDO"}

    @reports_trouble
    def execute(self, context):
        settings = context.scene.mocap_autolabel
        stored = opened.take(settings.take, context.scene)
        smoothed(stored.motion.markers[:0], stored.rate, settings.cutoff)  # before anything is kept that cannot be
        keep_and_show(context, partial(keep_cutoff, cutoff=settings.cutoff))
        return {"FINISHED"}


class MOCAP_AUTOLABEL_OT_take_back_smoothing(OfTake, bpy.types.Operator):
    """Show and export the markers as they were measured again."""

    bl_idname = "mocap_autolabel.take_back_smoothing"
    bl_label = "Take Back Smoothing"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        if not super().poll(context):
            return False
        if kept_cutoff(context.scene.mocap_autolabel.take) is not None:
            return True
        cls.poll_message_set("Nothing is smoothed")
        return False

    @reports_trouble
    def execute(self, context):
        keep_and_show(context, partial(keep_cutoff, cutoff=None))
        return {"FINISHED"}


CLASSES = (MOCAP_AUTOLABEL_OT_smooth, MOCAP_AUTOLABEL_OT_take_back_smoothing)
