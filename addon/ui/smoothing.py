# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of smoothing."""

import bpy

from ..scene.smoothing import kept_cutoff
from .parts import Reviewing


class MOCAP_AUTOLABEL_PT_smoothing(Reviewing, bpy.types.Panel):
    """What is too fast to be the person taken from the markers."""

    bl_label = "Smoothing"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, settings = self.layout, context.scene.mocap_autolabel
        layout.prop(settings, "cutoff", text="Cut-Off (Hz)")
        row = layout.row(align=True)
        row.operator("mocap_autolabel.smooth", icon="MOD_SMOOTH")
        row.operator("mocap_autolabel.take_back_smoothing", text="", icon="X")
        cutoff = kept_cutoff(settings.take)
        if cutoff is not None:
            layout.label(text=f"Smoothed at {cutoff:g} Hz, exports too", icon="INFO")


CLASSES = (MOCAP_AUTOLABEL_PT_smoothing,)
