# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether markers are well placed: the marker set that is laid out is judged, and advice is taken."""

from collections.abc import Generator

import bpy
from bpy.props import IntProperty

from ..io.models import open_model
from ..io.text import json_text
from ..jobs.quality import judge_placement
from ..scene import naming
from ..scene.markerset_edit import edited_collection, read_markerset
from ..scene.quality import keep_report, locked_markers, take_advice
from .markersets import Laid
from .stepping import WorksInSteps, beside


class MOCAP_AUTOLABEL_OT_judge_markers(Laid, WorksInSteps, bpy.types.Operator):
    """Find out which markers are easily taken for each other, and what to move; a locked location stays as it is."""

    bl_label = "Judge Placement"

    doing = "Judging the markers"

    def steps(self, context):
        """The judging, and the search for better places."""
        return judge_steps(context.scene)

    def _show(self, context, result: dict) -> set[str]:
        collection = edited_collection(context.scene)
        if collection is None:
            self.report({"WARNING"}, "The marker set was put away meanwhile")
            return {"CANCELLED"}
        keep_report(collection, json_text(result) + "\n")
        poor = sum(pair["separation"] < result["goal"] for pair in result["pairs"])
        self.report({"INFO"}, f"{poor} ambiguous pairs, {len(result['advice'])} changes advised")
        return {"FINISHED"}


def judge_steps(scene: bpy.types.Scene) -> Generator[float, None, dict]:
    """Judges the marker set that is laid out, yielding how much is done (0 to 1); returns the report."""
    collection = edited_collection(scene)
    model = open_model(bpy.path.abspath(collection[naming.EDITED]))
    base, keep = model.markerset, locked_markers(collection)
    markerset = read_markerset(collection, base, base.name)
    return beside(judge_placement(markerset, base, model.likelihood, keep=keep))


class MOCAP_AUTOLABEL_OT_take_advice(Laid, bpy.types.Operator):
    """Put the marker where it is advised to be."""

    bl_label = "Put It There"

    number: IntProperty(name="Number", description="Which advice of the list", default=1, min=1)

    def work(self, context):
        take_advice(edited_collection(context.scene), self.number)
