# SPDX-License-Identifier: GPL-3.0-or-later
"""A long take that plays from a file: through what is to be looked at, and to its motion where that was moved."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from ..core.data.errors import InputError
from ..io.motion_cache import check_cache
from ..scene.playing import MOTION_MARK, find_motion, motion_path, played_takes, suspects_of
from .polling import TellsWhyNot
from .reporting import reports_trouble


class OfPlayed(TellsWhyNot):
    """Operators on a take that plays from a file."""

    take: StringProperty(name="Take", description="Its collection; empty for the first", options={"SKIP_SAVE"})

    @classmethod
    def lacks(cls, context):
        return "" if played_takes(context.scene) else "No take here plays from a file"

    def played(self, context: bpy.types.Context) -> bpy.types.Collection:
        """The take that is meant; InputError where there is none of that name."""
        found = [one for one in played_takes(context.scene) if self.take in ("", one.name)]
        if not found:
            raise InputError(f"no take {self.take} plays from a file; expected one that does")
        return found[0]


class MOCAP_AUTOLABEL_OT_next_suspect(OfPlayed, bpy.types.Operator):
    """Go to the next frames of the take that its report says to look at."""

    bl_idname = "mocap_autolabel.next_suspect"
    bl_label = "Next to Look at"

    back: BoolProperty(name="Back", description="To those before", options={"SKIP_SAVE"})

    @reports_trouble
    def execute(self, context):
        scene = context.scene
        now = scene.frame_current
        rows = suspects_of(self.played(context))
        later = [row for row in rows if (row[0] < now if self.back else row[0] > now)]
        if not later:
            self.report(
                {"INFO"}, "Nothing is left to look at before here" if self.back else "Nothing is left after here"
            )
            return {"CANCELLED"}
        first, _, _ = (max if self.back else min)(later)
        scene.frame_set(first)
        self.report({"INFO"}, "; ".join(reason for begin, _, reason in later if begin == first))
        return {"FINISHED"}


class MOCAP_AUTOLABEL_OT_find_motion(OfPlayed, bpy.types.Operator):
    """Find the file that the take plays from again: beside the Blender file, else where you say."""

    bl_idname = "mocap_autolabel.find_motion"
    bl_label = "Find Motion"
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: StringProperty(default="*.pc2", options={"HIDDEN"})

    def invoke(self, context, _event):
        """Looks beside the Blender file first."""
        beside = self._beside(context)
        if beside is not None:
            self.filepath = str(beside)
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    @reports_trouble
    def execute(self, context):
        path = Path(bpy.path.abspath(self.filepath)) if self.filepath else self._beside(context)
        if path is None:
            raise InputError("the motion is not beside the Blender file; expected it there, or its file")
        find_motion(self.played(context), path)
        context.scene.frame_set(context.scene.frame_current)
        return {"FINISHED"}

    def _beside(self, context: bpy.types.Context) -> Path | None:
        """The file of this take in the Blender file's folder, None where it is not there."""
        try:
            take = self.played(context)
            name = motion_path(take).name
            if not bpy.data.filepath:
                return None
            path = Path(bpy.data.filepath).parent / name
            check_cache(path, str(take[MOTION_MARK]))
        except InputError:
            return None
        return path


CLASSES = (MOCAP_AUTOLABEL_OT_next_suspect, MOCAP_AUTOLABEL_OT_find_motion)
