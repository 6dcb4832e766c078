# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person says of the labels of a take, of points or blobs: each time one edit more, and the scene follows."""

from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
from bpy.props import EnumProperty, IntProperty

from ..core.data.errors import InputError
from ..core.data.takes import NO_MARKER, PointRows, rows_in_frame
from ..core.data.wording import count_of, words_of_frames
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
    counted_on,
)
from ..io.edits import edits_path, write_edits
from ..props import SCOPES, keeps_items, refresh_review, scene_of_lists
from ..scene.blob_dots import blob_edit, likely_of_blob
from ..scene.clock import refresh_frame
from ..scene.corrections import keep_edits
from ..scene.later import redraw, soon
from ..scene.opened import opened
from ..scene.picking import dots_of, likely_markers
from ..scene.stored import Stored
from ..scene.take import is_take, show_edits
from ..scene.timing import picked_range
from .base import OfTake, WithTake, once, operator, reports_trouble, taken, unless
from .listing import list_here, refuse_other_lists
from .picking import picked_points, selected_markers, show_picked
from .reposing import follow_soon

REVIEW_DELAY = 0.05  # s from an edit to the tables that follow it


@keeps_items
def marker_items(_self, context) -> list[tuple[str, str, str, str, int]]:
    """The markers for an enumeration, the likeliest for what is picked first; a number stays one marker's."""
    if context.scene is None or not is_take(context.scene.mocap_autolabel.take):
        return []
    stored = taken(context)
    return [(stored.names[marker], stored.names[marker], "", "NONE", marker) for marker in likely_here(context, stored)]


def likely_here(context: bpy.types.Context, stored: Stored) -> list[int]:
    """All markers, the likeliest for the dot that was picked last first; in their own order where there is none."""
    index, points = stored.index_of(context.scene.frame_float), picked_points(context)
    if not points or index < 0:
        return list(range(len(stored.names)))
    # A menu asks for each of its rows.
    asked, (before, likely) = (index, points[-1]), opened.looked_at.get("likely", (None, None))
    if before is not stored or likely[0] != asked:
        if isinstance(stored.rows, PointRows):
            dots = dots_of(stored, index)
            places = dots.xyz[dots.trajectory == points[-1]]
            rows = opened.rows_of(stored, points[-1])
            markers = likely_markers(stored, index, rows, places[0]) if len(places) else list(range(len(stored.names)))
        else:
            tracks = opened.tracks(context.scene.mocap_autolabel.take, context.scene)
            markers = likely_of_blob(stored, tracks, points[-1])
        likely = asked, markers
        opened.looked_at["likely"] = stored, likely
    return likely[1]


def correct(context: bpy.types.Context, edits: Edits) -> Stored:
    """Gives the active take other edits, shows what follows and returns it; InputError where new ones find nothing."""
    scene, collection = context.scene, context.scene.mocap_autolabel.take
    before = opened.take(collection, scene)
    after = opened.take(collection, scene, edits)
    for outcome in after.outcomes[len(before.edits) :]:
        if not outcome.labels:
            reason = counted_on(outcome.reason, before.clock.whole)
            raise InputError(f"{reason}; expected frames in which there is something to correct")
    keep_edits(collection, edits)
    show_edits(collection, before, after)
    refresh_frame(scene)
    follow_soon(seen=True)
    list_here(context)  # what comes a moment later is of the scene that the lists are of
    soon(review_now, REVIEW_DELAY)  # a hand that names dots does not wait for the tables
    return taken(context)


def review_now():
    """Fills the tables of the review."""
    refresh_review(bpy.context.window_manager, scene_of_lists())
    redraw("VIEW_3D")


def frames_in_scope(scope: str, stored: Stored, scene: bpy.types.Scene) -> tuple[int, int] | None:
    """First and last frame of a scope, in the source's numbers, None for all; InputError where there are none."""
    first, last = int(stored.motion.frames[0]), int(stored.motion.frames[-1])
    if scope == "WHOLE":
        return None
    if scope == "RANGE":
        if not scene.use_preview_range:
            raise InputError("no range is selected; expected a preview range, which P in a timeline draws")
        begin, end = picked_range(scene, stored.clock)
        if max(begin, first) > min(end, last):
            words = f"the preview range is {words_of_frames(scene.frame_preview_start, scene.frame_preview_end)}"
            own = f"{stored.clock.whole(first)} to {stored.clock.whole(last)}"
            raise InputError(f"{words}; expected some of the take, {own}")
        return max(begin, first), min(end, last)
    frame = stored.source_frame(scene.frame_float)
    return {"FRAME": (frame, frame), "ON": (frame, last), "BACK": (first, frame)}[scope]


class Corrects(OfTake):
    """What the edits share: their frames. They differ in `edits`, which makes them; UserError if it cannot."""

    differs_in = "edits"

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
            show_picked(context, after, picked, follow=False)


def chosen_trajectories(context: bpy.types.Context, stored: Stored) -> list[int]:
    """The trajectories that are picked, else those of the selected markers in the current frame; of blobs the rows."""
    if picked := picked_points(context):
        return picked
    frame, names = context.scene.frame_float, selected_markers(context)
    here = rows_in_frame(stored.rows, stored.index_here(frame))
    if not names:
        raise InputError("nothing is selected; expected markers, points or blobs, picked with the tool Label")
    rows = {one: here.start + np.flatnonzero(stored.labels.marker[here] == stored.words[one]) for one in names}
    if not isinstance(stored.rows, PointRows):
        if not any(map(len, rows.values())):
            raise InputError(f"no camera has a blob of {' '.join(names)} in this frame; expected one that has")
        return sorted(np.concatenate(list(rows.values())).tolist())
    for name, found in rows.items():
        if not len(found):
            raise InputError(f"{name} is not named in frame {frame:g}; expected one in which it is")
    return [int(stored.rows.trajectory[found[0]]) for found in rows.values()]


def edit_of(
    kinds: tuple[type[Edit], type[BlobEdit]], stored: Stored, number: int, frames: tuple[int, int] | None, *marker: str
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
        camera, count = np.unique(stored.rows.camera[list(points)], return_counts=True)
        for one in np.flatnonzero(count > 1)[:1]:
            words = f"{count[one]} blobs of {stored.cameras.names[camera[one]]} are picked"
            raise InputError(f"{words}; expected one of each camera, as a marker has")
        return
    rows = within(stored, np.flatnonzero(np.isin(stored.rows.trajectory, points)), frames)
    many = np.flatnonzero(np.bincount(stored.rows.frame[rows]) > 1)
    if len(many):
        several = f"several of them in frame {stored.clock.whole(stored.rows.frames[many[0]])}"
        words = f"{len(points)} points are picked, {several}"
        raise InputError(f"{words}; expected one, or pieces of a marker that follow each other")


def within(stored: Stored, rows: np.ndarray, frames: tuple[int, int] | None) -> np.ndarray:
    """Those of some rows that are in frames of the source's numbers, all for None."""
    if frames is None:
        return rows
    number = stored.rows.frames[stored.rows.frame[rows]]
    return rows[(number >= frames[0]) & (number <= frames[1])]


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
        chosen = chosen_trajectories(context, stored)
        refuse_beside_each_other(stored, chosen, frames)
        return [edit_of((AssignPoint, AssignBlob), stored, one, frames, self.marker) for one in chosen]


@operator(of=Corrects)
def unlabel(_self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
    """Take the names of the selected markers away from the points that have them in this frame."""
    # The trajectories, or blobs, have no name; where markers of blobs alone are selected, nothing is these.
    names = selected_markers(context)
    if names and not isinstance(stored.rows, PointRows) and not picked_points(context):
        return [UnlabelMarker(name, frames=frames) for name in names]
    chosen = chosen_trajectories(context, stored)
    return [edit_of((UnlabelPoint, UnlabelBlob), stored, one, frames) for one in chosen]


@operator(of=Corrects)
def no_marker(_self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
    """Say that the picked points are no markers: another person's, a thing's, or nothing; they get no name any more."""
    chosen = chosen_trajectories(context, stored)
    return [edit_of((Delete, DeleteBlob), stored, one, frames) for one in chosen]


@operator(of=Corrects, label="Swap")
def swap_markers(_self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
    """Give two selected markers each other's names."""
    # The two markers exchanged; where two blobs of one camera are picked, in that camera.
    picked = picked_points(context)
    if not isinstance(stored.rows, PointRows) and len(picked) == 2:
        (one, other), marker = stored.rows.camera[picked], stored.labels.marker[picked]
        if one == other and (marker != NO_MARKER).all():
            names = [stored.names[index] for index in marker[::-1]]
            both = zip(picked, names, strict=True)
            return [blob_edit(AssignBlob, stored, row, frames, name) for row, name in both]
    names = sorted(selected_markers(context))
    if len(names) != 2:
        words = f"the selection has {count_of(len(names), 'marker')}"
        raise InputError(f"{words}; expected the two that have each other's names, picked with the tool Label")
    return [Swap((names[0], names[1]), frames=frames)]


@operator(of=Corrects, label="It Is Right")
def is_right(_self, context, _stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
    """Say that the selected markers were looked at and are right: what is doubted of them is no longer asked."""
    names = selected_markers(context)
    if not names:
        raise InputError("no marker is selected; expected those that are right, picked with the tool Label")
    return [Right(name, frames=frames) for name in names]


class HasEdits(OfTake):
    """Operators on the edits that there are."""

    needs = (*OfTake.needs, unless(lambda context: taken(context).edits, "Nothing was corrected"))


@operator(of=HasEdits, index=once(IntProperty, "Index", "Which of the list, from 0", min=0))
def remove_correction(self, context):
    """Take a correction back: the labels are as if it had never been made."""
    refuse_other_lists(context)
    edits = taken(context).edits
    if self.index >= len(edits):
        raise InputError(f"there is no correction {self.index + 1}; expected one of the {len(edits)} in the list")
    correct(context, edits.without(self.index))


class MOCAP_AUTOLABEL_OT_clear_corrections(HasEdits, bpy.types.Operator):
    """Take all corrections back."""

    bl_label = "Clear All Corrections"

    @reports_trouble
    def invoke(self, context, event):
        refuse_other_lists(context)
        return context.window_manager.invoke_confirm(self, event)

    def work(self, context):
        refuse_other_lists(context)  # another scene may be seen since it was asked
        correct(context, NO_EDITS)


class MOCAP_AUTOLABEL_OT_save_corrections(WithTake, bpy.types.Operator):
    """Write the corrections beside the take, where the command line and other scenes take them up."""

    bl_options = {"REGISTER"}

    def invoke(self, context, event):
        source = taken(context).source
        asks = bool(source) and edits_path(Path(bpy.path.abspath(source))).exists()
        return context.window_manager.invoke_confirm(self, event) if asks else self.execute(context)

    def work(self, context):
        stored = taken(context)
        if not stored.source:
            raise InputError(f"take {stored.name} names no file; expected the file that it was labelled from")
        path = edits_path(Path(bpy.path.abspath(stored.source)))
        write_edits(path, stored.edits)
        self.report({"INFO"}, f"Saved {path}")
