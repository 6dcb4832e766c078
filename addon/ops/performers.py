# SPDX-License-Identifier: GPL-3.0-or-later
"""The list of those who are asked for in a take of several performers."""

from pathlib import Path

import bpy

from ..core.points.several.wearers import MAX_SUBJECTS, as_compared, is_subject_name
from ..io.markersets import SUFFIX
from ..props import OWN_FILE, SubjectSettings
from ..scene.performers import usual_colour
from .base import Ours, remove_chosen


class MOCAP_AUTOLABEL_OT_add_performer(Ours, bpy.types.Operator):
    """Add a performer to the list, in the chosen marker set."""

    bl_label = "Add Performer"

    @classmethod
    def lacks(cls, context):
        full = len(context.scene.mocap_autolabel.subjects.performers) >= MAX_SUBJECTS
        return f"Up to {MAX_SUBJECTS} performers can be asked for" if full else ""

    def work(self, context):
        subjects = context.scene.mocap_autolabel.subjects
        name, number = free_name(subjects), len(subjects.performers)
        row = subjects.performers.add()
        row.name, row.colour = name, usual_colour(number)
        row.markerset, row.markerset_path = subjects.markerset, subjects.markerset_path
        subjects.performer_index = number


class MOCAP_AUTOLABEL_OT_remove_performer(Ours, bpy.types.Operator):
    """Take the chosen performer out of the list."""

    bl_label = "Remove Performer"

    @classmethod
    def lacks(cls, context):
        return "" if len(context.scene.mocap_autolabel.subjects.performers) else "Nobody is in the list"

    def work(self, context):
        remove_chosen(context.scene.mocap_autolabel.subjects, "performers")


def free_name(subjects: SubjectSettings) -> str:
    """What to call one more performer: as the marker set is called, where that is a person's own."""
    path = subjects.markerset_path if subjects.markerset == OWN_FILE else subjects.markerset
    own = Path(bpy.path.abspath(path)).name.removesuffix(SUFFIX) if path.endswith(SUFFIX) else ""
    in_use = {as_compared(row.name) for row in subjects.performers}
    numbered = (f"performer{number}" for number in range(1, MAX_SUBJECTS + 2))
    return next(name for name in (own, *numbered) if is_subject_name(name) and as_compared(name) not in in_use)
