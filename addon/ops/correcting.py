# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person says of the labels of a take, of points or blobs: each time one edit more, and the scene follows."""

from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
from bpy.props import EnumProperty, IntProperty

from ..core.data.errors import InputError
from ..core.data.takes import NO_MARKER, NO_POINT, PointRows
from ..core.data.wording import count_of
from ..core.edits.kinds import (
    NO_EDITS,
    AssignBlob,
    AssignPoint,
    BlobEdit,
    Delete,
    DeleteBlob,
    Edit,
    Edits,
    Right,
    Swap,
    UnlabelBlob,
    UnlabelMarker,
    UnlabelPoint,
)
from ..core.edits.wording import counted_on
from ..io.edits import EDITS_ENDING, write_edits
from ..props import SCOPES, refresh_review
from ..scene.blob_dots import blob_edit, likely_of_blob, rows_of_markers
from ..scene.corrections import keep_edits
from ..scene.likely import likely_markers
from ..scene.opened import opened
from ..scene.picking import dots_of
from ..scene.redrawing import redraw
from ..scene.stored import Stored
from ..scene.take import is_take, show_edits
from .base import OfTake, keeps_items, taken
from .picking import picked_points, selected_markers, show_picked
from .reposing import follow_soon

REVIEW_DELAY = 0.05  # s from an edit to the tables that follow it

# What the likeliest names were asked of last (take, frame, trajectory), and they: a menu asks for each of its rows.
_likely: list = []


@keeps_items
def marker_items(_self, context) -> list[tuple[str, str, str, str, int]]:
    """The markers for an enumeration, the likeliest for what is picked first; a number stays one marker's."""
    if context.scene is None or not is_take(context.scene.mocap_autolabel.take):
        return []
    stored = taken(context)
    return [(stored.names[marker], stored.names[marker], "", "NONE", marker) for marker in likely_here(context, stored)]


def likely_here(context: bpy.types.Context, stored: Stored) -> list[int]:
    """All markers, the likeliest for the dot that was picked last first; in their own order where there is none."""
    frame = context.scene.frame_current - stored.shift
    points = picked_points(context)
    if not points or not stored.motion.frames[0] <= frame <= stored.motion.frames[-1]:
        return list(range(len(stored.names)))
    asked = (stored, frame, points[-1])
    if _likely[:3] != list(asked):
        _likely[:] = [*asked, _likely_of(context, stored, frame - int(stored.motion.frames[0]), points[-1])]
    return _likely[3]


def _likely_of(context: bpy.types.Context, stored: Stored, index: int, point: int) -> list[int]:
    """All markers, the likeliest for a blob, or a trajectory in frame `index`, first.

    In their own order where that has no point.
    """
    if not isinstance(stored.rows, PointRows):
        return likely_of_blob(stored, opened.tracks(context.scene.mocap_autolabel.take, context.scene), point)
    dots = dots_of(stored, index)
    found = np.flatnonzero(dots.trajectory == point)
    if not len(found):
        return list(range(len(stored.names)))
    return likely_markers(stored, index, opened.rows_of(stored, point), dots.xyz[found[0]])


def correct(context: bpy.types.Context, edits: Edits) -> Stored:
    """Gives the active take other edits, shows what follows and returns it; InputError where new ones find nothing."""
    scene, collection = context.scene, context.scene.mocap_autolabel.take
    before = opened.take(collection, scene)
    after = opened.take_with(collection, scene, edits)
    for outcome in after.outcomes[len(before.edits) :]:
        if not outcome.labels:
            reason = counted_on(outcome.reason, before.shift)
            raise InputError(f"{reason}; expected frames in which there is something to correct")
    keep_edits(collection, edits)
    show_edits(collection, before, after)
    scene.frame_set(scene.frame_current)
    follow_soon(seen=True)
    review_soon()
    return taken(context)


def review_soon():
    """Fills the tables of the review once the view was drawn: a hand that names dots does not wait for them."""
    if bpy.app.background:
        review_now()
    elif not bpy.app.timers.is_registered(review_now):
        bpy.app.timers.register(review_now, first_interval=REVIEW_DELAY)


def review_now():
    """Fills the tables of the review."""
    refresh_review(bpy.context.window_manager, bpy.context.scene)
    redraw("VIEW_3D")


def frames_in_scope(scope: str, stored: Stored, scene: bpy.types.Scene) -> tuple[int, int] | None:
    """First and last frame of a scope, in the source's numbers, None for all; InputError where there are none."""
    first, last = int(stored.motion.frames[0]), int(stored.motion.frames[-1])
    if scope == "WHOLE":
        return None
    if scope == "RANGE":
        if not scene.use_preview_range:
            raise InputError("no range is selected; expected a preview range, which P in a timeline draws")
        begin = max(scene.frame_preview_start - stored.shift, first)
        end = min(scene.frame_preview_end - stored.shift, last)
        if begin > end:
            words = f"frames {scene.frame_preview_start} to {scene.frame_preview_end} are selected"
            raise InputError(f"{words}; expected some of the take, {first + stored.shift} to {last + stored.shift}")
        return begin, end
    frame = stored.source_frame(scene.frame_current)
    return {"FRAME": (frame, frame), "ON": (frame, last), "BACK": (first, frame)}[scope]


def trajectory_of(stored: Stored, marker: str, frame: int) -> int:
    """The trajectory that is a marker in a frame; InputError where none is."""
    dots = dots_of(stored, frame - int(stored.motion.frames[0]))
    found = dots.trajectory[(dots.marker == stored.names.index(marker)) & (dots.trajectory != NO_POINT)]
    if not len(found):
        raise InputError(f"{marker} is not named in frame {frame + stored.shift}; expected one in which it is")
    return int(found[0])


class Corrects(OfTake):
    """What the edits share: their frames. They differ in `edits`, which makes them; UserError if it cannot."""

    scope: EnumProperty(name="Frames", description="The frames that are corrected", items=SCOPES, default="WHOLE")

    def invoke(self, context, event):
        self.scope_of_tool(context)
        return self.execute(context)

    def scope_of_tool(self, context: bpy.types.Context):
        """Takes the frames that the tool is set to, where none are asked for."""
        if not self.properties.is_property_set("scope"):
            self.scope = context.scene.mocap_autolabel.scope

    def work(self, context):
        stored = taken(context)
        frames = frames_in_scope(self.scope, stored, context.scene)
        picked = picked_points(context)
        after = correct(context, stored.edits.added(*self.edits(context, stored, frames)))
        if picked:
            show_picked(context, after, picked)


def chosen_trajectories(context: bpy.types.Context, stored: Stored) -> list[int]:
    """The trajectories that are picked, else those of the selected markers in the current frame; of blobs the rows."""
    if picked := picked_points(context):
        return picked
    frame = stored.source_frame(context.scene.frame_current)
    names = selected_markers(context)
    if names and isinstance(stored.rows, PointRows):
        return [trajectory_of(stored, name, frame) for name in names]
    markers = [stored.names.index(name) for name in names]
    if rows := rows_of_markers(stored, frame - int(stored.motion.frames[0]), markers) if names else []:
        return rows
    if names:
        raise InputError(f"no camera has a blob of {' '.join(names)} in this frame; expected one that has")
    raise InputError("nothing is selected; expected a marker, or a picked point or blob")


def edit_of(
    kinds: tuple[type[Edit], type[BlobEdit]],
    stored: Stored,
    number: int,
    frames: tuple[int, int] | None,
    *marker: str,
) -> Edit:
    """An edit, of one of two kinds, of a trajectory or of a blob's track, in some frames, None for all."""
    if isinstance(stored.rows, PointRows):
        return kinds[0](number, *marker, frames=frames)
    return blob_edit(kinds[1], stored, number, frames, *marker)


def refuse_beside_each_other(stored: Stored, points: Sequence[int], frames: tuple[int, int] | None):
    """Raises InputError where several trajectories have points in one of some frames: they cannot be one marker.

    Of blobs where several are of one camera.
    """
    if not isinstance(stored.rows, PointRows):
        _refuse_one_image(stored, points)
        return
    rows = np.isin(stored.rows.trajectory, points)
    number = stored.rows.frames[stored.rows.frame[rows]]
    if frames is not None:
        number = number[(number >= frames[0]) & (number <= frames[1])]
    many = np.flatnonzero(np.bincount(number - stored.rows.frames[0]) > 1)
    if len(many):
        words = (
            f"{len(points)} points are picked, several of them in frame {stored.rows.frames[many[0]] + stored.shift}"
        )
        raise InputError(f"{words}; expected one, or pieces of a marker that follow each other")


def _refuse_one_image(stored: Stored, rows: Sequence[int]):
    """Raises InputError where several of some blobs are of one camera."""
    camera = stored.rows.camera[list(rows)]
    many = np.flatnonzero(np.bincount(camera) > 1)
    if len(many):
        name = stored.cameras.names[int(many[0])]
        words = f"{int((camera == many[0]).sum())} blobs of {name} are picked"
        raise InputError(f"{words}; expected one of each camera, as a marker has")


class MOCAP_AUTOLABEL_OT_name_point(Corrects, bpy.types.Operator):
    """Say which marker the selected marker, or the picked point, really is."""

    bl_label = "Name"
    bl_property = "marker"

    marker: EnumProperty(name="Marker", description="What the trajectory is", items=marker_items)

    def invoke(self, context, event):
        self.scope_of_tool(context)
        context.window_manager.invoke_search_popup(self)
        return {"RUNNING_MODAL"}

    def edits(self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
        """The trajectory is the marker, and so are others that go on where it ends."""
        chosen = chosen_trajectories(context, stored)
        refuse_beside_each_other(stored, chosen, frames)
        return [edit_of((AssignPoint, AssignBlob), stored, one, frames, self.marker) for one in chosen]


class MOCAP_AUTOLABEL_OT_unlabel(Corrects, bpy.types.Operator):
    """Take the names of the selected markers away from the points that have them in this frame."""

    bl_label = "Unlabel"

    def edits(self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
        """The trajectories, or blobs, have no name; where markers of blobs alone are selected, nothing is these."""
        names = selected_markers(context)
        if names and not isinstance(stored.rows, PointRows) and not picked_points(context):
            return [UnlabelMarker(name, frames=frames) for name in names]
        chosen = chosen_trajectories(context, stored)
        return [edit_of((UnlabelPoint, UnlabelBlob), stored, one, frames) for one in chosen]


class MOCAP_AUTOLABEL_OT_no_marker(Corrects, bpy.types.Operator):
    """Say that the picked points are no markers: another person's, a thing's, or nothing; they get no name any more."""

    bl_label = "No Marker"

    def edits(self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
        """The trajectories are no markers."""
        chosen = chosen_trajectories(context, stored)
        return [edit_of((Delete, DeleteBlob), stored, one, frames) for one in chosen]


def _are_of_one_image(stored: Stored, rows: Sequence[int]) -> bool:
    """Whether blobs are of one camera and all have a name."""
    camera, marker = stored.rows.camera[list(rows)], stored.labels.marker[list(rows)]
    return bool((camera == camera[0]).all() and (marker != NO_MARKER).all())


class MOCAP_AUTOLABEL_OT_swap_markers(Corrects, bpy.types.Operator):
    """Give two selected markers each other's names."""

    bl_label = "Swap"

    def edits(self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
        """The two markers exchanged; where two blobs of one camera are picked, in that camera."""
        picked = picked_points(context)
        if not isinstance(stored.rows, PointRows) and len(picked) == 2 and _are_of_one_image(stored, picked):
            names = [stored.names[stored.labels.marker[row]] for row in picked]
            both = zip(picked, names[::-1], strict=True)
            return [blob_edit(AssignBlob, stored, row, frames, name) for row, name in both]
        names = sorted(selected_markers(context))
        if len(names) != 2:
            raise InputError(
                f"the selection has {count_of(len(names), 'marker')}; expected the two that have each other's names"
            )
        return [Swap((names[0], names[1]), frames=frames)]


class MOCAP_AUTOLABEL_OT_is_right(Corrects, bpy.types.Operator):
    """Say that the selected markers were looked at and are right: what is doubted of them is no longer asked."""

    bl_label = "It Is Right"

    def edits(self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
        """The markers are right."""
        names = selected_markers(context)
        if not names:
            raise InputError("no marker is selected; expected those that are right")
        return [Right(name, frames=frames) for name in names]


class HasEdits(OfTake):
    """Operators on the edits that there are."""

    @classmethod
    def lacks(cls, context):
        corrected = len(context.window_manager.mocap_autolabel.corrections)
        return super().lacks(context) or ("" if corrected else "Nothing was corrected")


class MOCAP_AUTOLABEL_OT_remove_correction(HasEdits, bpy.types.Operator):
    """Take a correction back: the labels are as if it had never been made."""

    bl_label = "Remove Correction"

    index: IntProperty(name="Index", description="Which of the list, from 0", min=0, options={"SKIP_SAVE"})

    def work(self, context):
        edits = taken(context).edits
        if self.index >= len(edits):
            raise InputError(f"there is no correction {self.index + 1}; expected one of the {len(edits)} in the list")
        correct(context, edits.without(self.index))


class MOCAP_AUTOLABEL_OT_clear_corrections(HasEdits, bpy.types.Operator):
    """Take all corrections back."""

    bl_label = "Clear All Corrections"

    def invoke(self, context, event):
        return context.window_manager.invoke_confirm(self, event)

    def work(self, context):
        correct(context, NO_EDITS)


class MOCAP_AUTOLABEL_OT_save_corrections(OfTake, bpy.types.Operator):
    """Write the corrections beside the take, where the command line and other scenes take them up."""

    bl_label = "Save Corrections"
    bl_options = {"REGISTER"}

    def invoke(self, context, event):
        source = taken(context).source
        asks = bool(source) and _file_beside(source).exists()
        return context.window_manager.invoke_confirm(self, event) if asks else self.execute(context)

    def work(self, context):
        stored = taken(context)
        if not stored.source:
            raise InputError(f"take {stored.name} names no file; expected the file that it was labelled from")
        path = _file_beside(stored.source)
        write_edits(path, stored.edits)
        self.report({"INFO"}, f"Saved {path}")


def _file_beside(source: str) -> Path:
    """The file of the edits of a take beside its own, `source`."""
    path = Path(bpy.path.abspath(source))
    return path.with_name(path.stem + EDITS_ENDING)
