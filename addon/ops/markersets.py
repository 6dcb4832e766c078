# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set of one's own: laid out in the view, moved and re-attached there, saved as a file."""

from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..core.data.errors import InputError
from ..core.points.models import Model
from ..io.markersets import SUFFIX, open_markerset
from ..io.models import open_model, write_model
from ..io.whole import whole_file
from ..prefs import markerset_folder
from ..props import OWN_FILE, chosen_markerset
from ..scene import naming
from ..scene.markerset_edit import edited_collection, is_unmoved, read_markerset, reattach, show_markerset, skeleton_of
from .base import Ours, ToldWhere, keeps_items, lacks_object_mode


@keeps_items
def _segment_items(_self, context) -> list[tuple[str, str, str]]:
    collection = edited_collection(context.scene)
    bones = skeleton_of(collection).data.bones if collection else ()
    return [(bone.name, bone.name, f"Attach to {bone.name}") for bone in bones]


class Laid(Ours):
    """Needs a marker set that is laid out."""

    @classmethod
    def lacks(cls, context):
        return "Show a marker set first" if edited_collection(context.scene) is None else ""


class MOCAP_AUTOLABEL_OT_open_markerset(Ours, ImportHelper, bpy.types.Operator):
    """Choose a marker set file of your own."""

    bl_label = "Open Marker Set"

    filter_glob: StringProperty(default=f"*{SUFFIX}", options={"HIDDEN"})

    def work(self, context):
        settings = context.scene.mocap_autolabel
        markerset = open_markerset(self.filepath)
        settings.subjects.markerset, settings.subjects.markerset_path = OWN_FILE, self.filepath
        self.report({"INFO"}, f"{markerset.name}: {len(markerset)} markers")


class MOCAP_AUTOLABEL_OT_edit_markerset(Ours, bpy.types.Operator):
    """Lay the marker set out in the rest pose, to move its markers and capsules and attach them to other bones."""

    bl_label = "Show and Edit"

    @classmethod
    def lacks(cls, context):
        return lacks_object_mode(context)

    def work(self, context):
        settings = context.scene.mocap_autolabel
        markerset = chosen_markerset(settings.subjects)
        source = (
            settings.subjects.markerset_path if settings.subjects.markerset == OWN_FILE else settings.subjects.markerset
        )
        show_markerset(context, markerset, source)


class MOCAP_AUTOLABEL_OT_reattach(Laid, bpy.types.Operator):
    """Attach the selected markers and capsules to another segment, where they stand."""

    bl_label = "Attach to Segment"
    bl_property = "segment"

    segment: EnumProperty(name="Segment", description="The segment that carries them", items=_segment_items)

    @classmethod
    def lacks(cls, context):
        chosen = any(naming.MARKER in item or naming.CAPSULE in item for item in context.selected_objects)
        return super().lacks(context) or ("" if chosen else "Select markers or capsules first")

    def invoke(self, context, event):
        context.window_manager.invoke_search_popup(self)
        return {"RUNNING_MODAL"}

    def work(self, context):
        collection = edited_collection(context.scene)
        armature, ours = skeleton_of(collection), set(collection.all_objects)
        chosen = [item for item in context.selected_objects if item in ours and item != armature]
        for item in chosen:
            reattach(item, armature, self.segment)
        self.report({"INFO"}, f"{len(chosen)} attached to {self.segment}")


class MOCAP_AUTOLABEL_OT_save_markerset(ToldWhere, Laid, bpy.types.Operator):
    """Save the marker set that is laid out as one of your own, and choose it."""

    bl_label = "Save Marker Set"
    bl_options = {"REGISTER"}

    filename_ext = SUFFIX
    filter_glob: StringProperty(default=f"*{SUFFIX}", options={"HIDDEN"})

    def proposed(self, context) -> Path:
        """In the folder of own marker sets, called after the one that it was made from."""
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
