# SPDX-License-Identifier: GPL-3.0-or-later
"""A long take that plays from a file: what is to be looked at, a part of it with keys, and its motion if it moved."""

from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty

from ..core.data.errors import InputError
from ..core.data.wording import words_of_frames
from ..core.review.changes import summary_of_changes
from ..io.poses import check_cache
from ..io.qtm.capture import USE_POINTS
from ..jobs import LabelJob, label_to_show
from ..jobs.job import part_job
from ..props import refresh_review
from ..scene import cameras as scene_cameras
from ..scene.clock import refresh_frame
from ..scene.playing import (
    MOTION_MARK,
    PLAYED,
    clock_of,
    find_motion,
    for_a_part,
    motion_path,
    part_here,
    played_takes,
    suspects_of,
)
from ..scene.relabelled import keep_changes
from ..scene.roots import put_where
from .base import Ours, once, operator, unless
from .importing import forget_take
from .labelling import LabelsTake, choose_job, edits_so_far


class OfPlayed(Ours):
    """Operators on a take that plays from a file."""

    take: once(StringProperty, "Take", "Its collection; empty for the first")

    needs = (unless(lambda context: played_takes(context.scene), "No take here plays from a file"),)

    def meant(self, context: bpy.types.Context) -> bpy.types.Collection | None:
        """The take that is meant; None where there is none of that name."""
        return next((one for one in played_takes(context.scene) if self.take in ("", one.name)), None)

    def played(self, context: bpy.types.Context) -> bpy.types.Collection:
        """The same; InputError where there is none."""
        found = self.meant(context)
        if found is None:
            raise InputError(f"no take {self.take} plays from a file; expected one that does")
        return found


@operator(of=OfPlayed, label="Next to Look at", back=once(BoolProperty, "Back", "To those before"))
def next_suspect(self, context):
    """Go to the next frames of the take that its report says to look at."""
    now = context.scene.frame_current
    rows = suspects_of(self.played(context))
    later = [row for row in rows if (row[0] < now if self.back else row[0] > now)]
    if not later:
        self.report({"INFO"}, f"Nothing is left to look at {'before' if self.back else 'after'} here")
        return {"CANCELLED"}
    first, _, _ = (max if self.back else min)(later)
    context.scene.frame_set(first)
    self.report({"INFO"}, "; ".join(reason for begin, _, reason in later if begin == first))
    return {"FINISHED"}


class MOCAP_AUTOLABEL_OT_open_part(OfPlayed, LabelsTake, bpy.types.Operator):
    """Label a part of the take again, with keys, to correct it: the preview range, or ten seconds about here."""

    first: once(IntProperty, "From", "First frame, where both are said")
    last: once(IntProperty, "To", "Last frame, where both are said")
    filepath: once(StringProperty, "Take", "The file of the take, where it was moved", subtype="FILE_PATH")

    needs = (*OfPlayed.needs, *LabelsTake.needs)

    def invoke(self, context, event):
        take = self.meant(context)
        source = "" if take is None else for_a_part(take)["source"]
        if self.filepath or bpy.app.background or not source or Path(source).exists():
            return super().invoke(context, event)
        self.filepath = source
        return self.ask_for_file(context)

    def asked(self, context) -> partial:
        take = self.played(context)
        self._job, self._ends = self._asked(context, take)
        self._name, self._clock = str(take[PLAYED]), clock_of(take)
        whole = motion_path(take).with_name(Path(for_a_part(take)["source"]).stem + ".labels.csv")
        return partial(label_to_show, self._job, whole)

    def _asked(self, context: bpy.types.Context, take: bpy.types.Collection) -> tuple[LabelJob, tuple[int, int]]:
        """What labels the part, and the first and last frame of all of the take."""
        kept, scene = for_a_part(take), context.scene
        ends, clock = tuple(kept["ends"]), clock_of(take)
        chosen = self.properties.is_property_set("first") and self.properties.is_property_set("last")
        first, last = (self.first, self.last) if chosen else part_here(take, scene)
        meant = clock.inside(first, last)
        frames = max(meant[0], ends[0]), min(meant[1], ends[1])
        if frames[0] > frames[1]:
            words = f"take {take[PLAYED]} has none of {words_of_frames(first, last)}"
            raise InputError(f"{words}; expected some of {clock.whole(ends[0])} to {clock.whole(ends[1])}")
        cameras = None if kept["use"] == USE_POINTS else scene_cameras.cameras_of_scene(scene)
        source = bpy.path.abspath(self.filepath) if self.filepath else kept["source"]
        job = part_job({**kept, "source": source}, cameras, frames)
        return replace(job, edits=edits_so_far(scene, job.source), keep=True, shown=True), ends

    def _show(self, context, found):
        _, changed = found
        settings, played = context.scene.mocap_autolabel, self.played(context)
        forget_take(context)
        if self._job.cameras is not None:
            settings.source.cameras = scene_cameras.find_or_add_cameras(context.scene, self._job.cameras)
        choose_job(settings, self._job, self._ends)
        super()._show(context, found)
        put_where(settings.take, played)
        played.hide_viewport = True  # the part moves in the same place
        if changed is not None:
            keep_changes(settings.take, changed)
            refresh_review(context.window_manager, context.scene)
            summary = summary_of_changes(changed) or "Nothing is otherwise"
            self.report({"INFO"}, f"{summary} than where all of the take was labelled")


class MOCAP_AUTOLABEL_OT_find_motion(OfPlayed, bpy.types.Operator):
    """Find the file that the take plays from again: beside the Blender file, else where you say."""

    filepath: StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: StringProperty(default="*.pc2", options={"HIDDEN"})

    def invoke(self, context, _event):
        beside = self._beside(context)
        if beside is not None:
            self.filepath = str(beside)
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def work(self, context):
        path = Path(bpy.path.abspath(self.filepath)) if self.filepath else self._beside(context)
        if path is None:
            raise InputError("the motion is not beside the Blender file; expected it there, or its file")
        find_motion(self.played(context), path)
        refresh_frame(context.scene)

    def _beside(self, context: bpy.types.Context) -> Path | None:
        """The file of this take in the Blender file's folder, None where it is not there."""
        with suppress(InputError):
            take = self.played(context)
            path = Path(bpy.data.filepath).parent / motion_path(take).name
            check_cache(path, str(take[MOTION_MARK]))
            return path if bpy.data.filepath else None
        return None
