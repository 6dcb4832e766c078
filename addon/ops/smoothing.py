# SPDX-License-Identifier: GPL-3.0-or-later
"""The markers of a take smoothed, in the scene and in what is exported, and as they were again."""

from functools import partial

import bpy

from ..core.filling.smoothing import smoothed
from ..scene.opened import opened
from ..scene.smoothing import keep_cutoff, kept_cutoff
from .base import OfTake
from .filling import keep_and_show


class MOCAP_AUTOLABEL_OT_smooth(OfTake, bpy.types.Operator):
    """Smooth the markers by a Butterworth filter without lag, each stretch between gaps for itself; labels stay."""

    bl_label = "Smooth"

    def work(self, context):
        settings = context.scene.mocap_autolabel
        stored = opened.take(settings.take, context.scene)
        smoothed(
            stored.motion.markers[:0], stored.rate, settings.filling.cutoff
        )  # before anything is kept that cannot be
        keep_and_show(context, partial(keep_cutoff, cutoff=settings.filling.cutoff))


class MOCAP_AUTOLABEL_OT_take_back_smoothing(OfTake, bpy.types.Operator):
    """Show and export the markers as they were measured again."""

    bl_label = "Take Back Smoothing"

    @classmethod
    def lacks(cls, context):
        if words := super().lacks(context):
            return words
        return "Nothing is smoothed" if kept_cutoff(context.scene.mocap_autolabel.take) is None else ""

    def work(self, context):
        keep_and_show(context, partial(keep_cutoff, cutoff=None))
