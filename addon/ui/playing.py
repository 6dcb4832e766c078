# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of long takes that play from a file."""

import bpy

from ..scene.playing import PLAYED, for_a_part, part_here, played_takes, suspects_of, what_is_wrong
from .parts import Step, draw_text, frames_in_short

NO_KEYS = "It plays from a file beside this one and has no keys."
# Of a file that an earlier version saved.
LABEL_A_PART = "To correct it, label a part of it: choose its source and Frames in the Label panel."
SAVE_THEM = "Save Corrections keeps them for the whole take, when it is labelled again from the command line."


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
            row = box.row(align=True)
            row.label(text=str(take[PLAYED]), icon="PLAY")
            row.prop(take, "hide_viewport", text="", emboss=False)
            wrong = what_is_wrong(take)
            if wrong:
                draw_text(context, box, wrong, "ERROR")
                box.operator("mocap_autolabel.find_motion", icon="FILE_FOLDER").take = take.name
            self._draw_suspects(context, box, take)
            self._draw_part(context, box, take)

    def _draw_part(self, context, box: bpy.types.UILayout, take: bpy.types.Collection):
        if for_a_part(take) is None:
            draw_text(context, box, f"{NO_KEYS} {LABEL_A_PART}", "INFO")
            return
        box.operator("mocap_autolabel.open_part", icon="ZOOM_SELECTED").take = take.name
        first, last = part_here(take, context.scene)
        words = f"{NO_KEYS} Open Part labels frames {first} to {last} again with keys, to correct them. {SAVE_THEM}"
        draw_text(context, box, words, "INFO")

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
