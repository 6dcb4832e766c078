# SPDX-License-Identifier: GPL-3.0-or-later
"""The list of those who are asked for in a take of several performers."""

from pathlib import Path

import bpy

from ..core.points.several.wearers import MAX_SUBJECTS, as_compared, is_subject_name
from ..io.markersets import SUFFIX
from ..props import OWN_FILE, SceneSettings
from ..scene.performers import usual_colour
from .polling import TellsWhyNot


class MOCAP_AUTOLABEL_OT_add_performer(TellsWhyNot, bpy.types.Operator):
    """Add a performer to the list, in the chosen marker set."""

    bl_idname = "mocap_autolabel.add_performer"
    bl_label = "Add Performer"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def lacks(cls, context):
        full = len(context.scene.mocap_autolabel.performers) >= MAX_SUBJECTS
        return f"Up to {MAX_SUBJECTS} performers can be asked for" if full else ""

    def execute(self, context):
        settings = context.scene.mocap_autolabel
        name, number = free_name(settings), len(settings.performers)
        row = settings.performers.add()
        row.name, row.colour = name, usual_colour(number)
        row.markerset, row.markerset_path = settings.markerset, settings.markerset_path
        settings.performer_index = number
        return {"FINISHED"}


class MOCAP_AUTOLABEL_OT_remove_performer(TellsWhyNot, bpy.types.Operator):
    """Take the chosen performer out of the list."""

    bl_idname = "mocap_autolabel.remove_performer"
    bl_label = "Remove Performer"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def lacks(cls, context):
        return "" if len(context.scene.mocap_autolabel.performers) else "Nobody is in the list"

    def execute(self, context):
        settings = context.scene.mocap_autolabel
        last = len(settings.performers) - 1
        settings.performers.remove(min(settings.performer_index, last))
        settings.performer_index = max(min(settings.performer_index, last - 1), 0)
        return {"FINISHED"}


def free_name(settings: SceneSettings) -> str:
    """What to call one more performer: as the marker set is called, where that is a person's own."""
    path = settings.markerset_path if settings.markerset == OWN_FILE else settings.markerset
    own = Path(bpy.path.abspath(path)).name.removesuffix(SUFFIX) if path.endswith(SUFFIX) else ""
    taken = {as_compared(row.name) for row in settings.performers}
    numbered = (f"performer{number}" for number in range(1, MAX_SUBJECTS + 2))
    return next(name for name in (own, *numbered) if is_subject_name(name) and as_compared(name) not in taken)


CLASSES = (MOCAP_AUTOLABEL_OT_add_performer, MOCAP_AUTOLABEL_OT_remove_performer)
