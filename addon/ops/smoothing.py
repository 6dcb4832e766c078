# SPDX-License-Identifier: GPL-3.0-or-later
"""The markers of a take smoothed, in the scene and in what is exported, and as they were again."""

from functools import partial

import bpy

from ..core.filling.smoothing import smoothed
from ..scene.opened import opened
from ..scene.smoothing import keep_cutoff, kept_cutoff
from .filling import keep_and_show
from .polling import OfTake
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
    def lacks(cls, context):
        if words := super().lacks(context):
            return words
        return "Nothing is smoothed" if kept_cutoff(context.scene.mocap_autolabel.take) is None else ""

    @reports_trouble
    def execute(self, context):
        keep_and_show(context, partial(keep_cutoff, cutoff=None))
        return {"FINISHED"}


CLASSES = (MOCAP_AUTOLABEL_OT_smooth, MOCAP_AUTOLABEL_OT_take_back_smoothing)
