# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of long takes that play from a file."""

import bpy

from ..scene.playing import PLAYED, played_takes, suspects_of, what_is_wrong
from .parts import Step, draw_text, frames_in_short

NO_KEYS = (
    "It plays from a file beside this one and has no keys. To correct it, label a part of it: "
    "choose its source and Frames in the Label panel."
)


class MOCAP_AUTOLABEL_PT_playing(Step, bpy.types.Panel):
    """Takes that are too long for keys."""

    bl_label = "Long Take"
    bl_parent_id = "MOCAP_AUTOLABEL_PT_review"

    @classmethod
    def poll(cls, context):
        return bool(played_takes(context.scene))

    def draw(self, context):
        for take in played_takes(context.scene):
            box = self.layout.box()
            box.label(text=str(take[PLAYED]), icon="PLAY")
            wrong = what_is_wrong(take)
            if wrong:
                draw_text(context, box, wrong, "ERROR")
                box.operator("mocap_autolabel.find_motion", icon="FILE_FOLDER").take = take.name
            draw_text(context, box, NO_KEYS, "INFO")
            self._draw_suspects(context, box, take)

    def _draw_suspects(self, context, box: bpy.types.UILayout, take: bpy.types.Collection):
        rows = suspects_of(take)
        if not rows:
            box.label(text="Nothing to look at", icon="CHECKMARK")
            return
        row = box.row(align=True)
        for words, icon, back in (("Previous", "TRIA_LEFT", True), ("Next", "TRIA_RIGHT", False)):
            button = row.operator("mocap_autolabel.next_suspect", text=words, icon=icon)
            button.back, button.take = back, take.name
        now = context.scene.frame_current
        for first, last, reason in [row for row in rows if row[0] <= now <= row[1]][:4]:
            draw_text(context, box, f"{frames_in_short(first, last)}: {reason}", "DOT")


CLASSES = (MOCAP_AUTOLABEL_PT_playing,)
