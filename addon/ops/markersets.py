# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set of one's own: laid out in the view, moved and re-attached there, judged, and saved as a file."""

from functools import partial
from pathlib import Path

import bpy
from bpy.props import EnumProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..core.data.errors import InputError
from ..core.data.wording import count_of
from ..core.points.models import Model
from ..io.markersets import SUFFIX, open_markerset
from ..io.models import open_model, write_model
from ..io.text import json_text
from ..io.whole import whole_file
from ..jobs.quality import judge_placement
from ..prefs import markerset_folder
from ..props import OWN_FILE, chosen_markerset, chosen_model, keeps_items
from ..scene import naming
from ..scene.armature import armature_of
from ..scene.markerset_edit import (
    edited_collection,
    is_unmoved,
    keep_report,
    marker_items,
    read_markerset,
    reattach,
    show_markerset,
    take_advice,
)
from .base import Ours, ToldWhere, lacks_object_mode, operator, unless
from .long_work import LongWork


@keeps_items
def _segment_items(_self, context) -> list[tuple[str, str, str]]:
    collection = edited_collection(context.scene)
    bones = armature_of(collection).data.bones if collection else ()
    return [(bone.name, bone.name, f"Attach to {bone.name}") for bone in bones]


class Laid(Ours):
    """Needs a marker set that is laid out."""

    needs = (unless(lambda context: edited_collection(context.scene) is not None, "Show a marker set first"),)


class MOCAP_AUTOLABEL_OT_open_markerset(Ours, ImportHelper, bpy.types.Operator):
    """Choose a marker set file of your own."""

    bl_label = "Open Marker Set"

    filter_glob: StringProperty(default=f"*{SUFFIX}", options={"HIDDEN"})

    def work(self, context):
        settings = context.scene.mocap_autolabel
        markerset = open_markerset(self.filepath)
        settings.subjects.markerset, settings.subjects.markerset_path = OWN_FILE, self.filepath
        self.report({"INFO"}, f"{markerset.name}: {len(markerset)} markers")


@operator(lacks_object_mode, label="Show and Edit")
def edit_markerset(_self, context):
    """Lay the marker set out in the rest pose, to move its markers and capsules and attach them to other bones."""
    subjects = context.scene.mocap_autolabel.subjects
    source = subjects.markerset_path if subjects.markerset == OWN_FILE else chosen_model(subjects)
    show_markerset(context, chosen_markerset(subjects), source)


class MOCAP_AUTOLABEL_OT_reattach(Laid, bpy.types.Operator):
    """Attach the selected markers and capsules to another segment, where they stand."""

    bl_label = "Attach to Segment"
    bl_property = "segment"

    segment: EnumProperty(name="Segment", description="The segment that carries them", items=_segment_items)

    needs = (
        *Laid.needs,
        unless(
            lambda context: any(naming.MARKER in one or naming.CAPSULE in one for one in context.selected_objects),
            "Select markers or capsules first",
        ),
    )

    def invoke(self, context, event):
        context.window_manager.invoke_search_popup(self)
        return {"RUNNING_MODAL"}

    def work(self, context):
        collection = edited_collection(context.scene)
        armature, ours = armature_of(collection), set(collection.all_objects)
        chosen = [item for item in context.selected_objects if item in ours and item != armature]
        for item in chosen:
            reattach(item, armature, self.segment)
        self.report({"INFO"}, f"{len(chosen)} attached to {self.segment}")


class MOCAP_AUTOLABEL_OT_save_markerset(ToldWhere, Laid, bpy.types.Operator):
    """Save the marker set that is laid out as one of your own, and choose it."""

    bl_label = "Save Marker Set"
    bl_options = {"REGISTER"}

    filename_ext = SUFFIX

    def proposed(self, context) -> Path:
        base = Path(edited_collection(context.scene)[naming.EDITED]).name.removesuffix(SUFFIX)
        return markerset_folder(create=True) / f"my_{base.removeprefix('my_')}{SUFFIX}"

    def check(self, context):
        return False

    def work(self, context):
        collection, path = edited_collection(context.scene), Path(self.filepath)
        if not path.name.endswith(SUFFIX):
            path = path.with_name(path.name.removesuffix(".json") + SUFFIX)
        name = path.name.removesuffix(SUFFIX)
        if not name:
            raise InputError(f"the marker set has no name; expected a file such as mine{SUFFIX}")
        base = open_model(bpy.path.abspath(collection[naming.EDITED]))
        markerset = read_markerset(collection, base.markerset, name)
        learned = base.likelihood if is_unmoved(markerset, base.markerset) else None
        with whole_file(path, overwrite=True) as temporary:
            write_model(temporary, Model(markerset, learned))
        settings = context.scene.mocap_autolabel
        settings.subjects.markerset, settings.subjects.markerset_path = OWN_FILE, str(path)
        self.report({"INFO"}, f"Saved {path}")


class MOCAP_AUTOLABEL_OT_judge_markers(Laid, LongWork, bpy.types.Operator):
    """Find out which markers are easily taken for each other, and what to move; a locked location stays as it is."""

    bl_label = "Judge Placement"

    doing = "Judging the markers"

    def asked(self, context):
        collection = edited_collection(context.scene)
        model = open_model(bpy.path.abspath(collection[naming.EDITED]))
        # Those whose location is locked stay where they are.
        keep = [name for name, item in marker_items(collection).items() if all(item.lock_location)]
        markerset = read_markerset(collection, model.markerset, model.markerset.name)
        return partial(judge_placement, markerset, model.markerset, model.likelihood, keep=keep)

    def _show(self, context, result: dict) -> set[str]:
        collection = edited_collection(context.scene)
        if collection is None:
            self.report({"WARNING"}, "The marker set was put away meanwhile")
            return {"CANCELLED"}
        keep_report(collection, json_text(result) + "\n")
        poor = sum(pair["separation"] < result["goal"] for pair in result["pairs"])
        self.report(
            {"INFO"}, f"{count_of(poor, 'ambiguous pair')}, {count_of(len(result['advice']), 'change')} advised"
        )
        return {"FINISHED"}


class MOCAP_AUTOLABEL_OT_take_advice(Laid, bpy.types.Operator):
    """Put the marker where it is advised to be."""

    bl_label = "Put It There"

    number: IntProperty(name="Number", description="Which advice of the list", default=1, min=1)

    def work(self, context):
        take_advice(edited_collection(context.scene), self.number)
