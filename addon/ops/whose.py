# SPDX-License-Identifier: GPL-3.0-or-later
"""Who is in a take: the list of those who are asked for, and what a person says of whose a marker is."""

from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
from bpy.props import EnumProperty

from ..core.data.errors import InputError
from ..core.data.takes import NO_MARKER
from ..core.edits.kinds import AssignPoint, Edit, Swap
from ..core.points.several.wearers import MAX_SUBJECTS, as_compared, is_subject_name
from ..io.markersets import AUTO_MODEL, SUFFIX
from ..props import OWN_FILE, USUAL_MARKERSET, choose_model, found_here, keeps_items
from ..scene.opened import opened
from ..scene.performers import homes, usual_colour
from ..scene.stored import Stored
from .base import once, operator, remove_chosen, unless
from .correcting import Corrects, within
from .picking import picked_points, selected_markers


@operator(
    unless(
        lambda context: len(context.scene.mocap_autolabel.subjects.performers) < MAX_SUBJECTS,
        f"Up to {MAX_SUBJECTS} performers can be asked for",
    )
)
def add_performer(_self, context):
    """Add a performer to the list, in the chosen marker set."""
    subjects = context.scene.mocap_autolabel.subjects
    # As the marker set is called, where that is a person's own.
    path = {OWN_FILE: subjects.markerset_path, AUTO_MODEL: found_here(subjects) or USUAL_MARKERSET}.get(
        subjects.markerset, subjects.markerset
    )
    own = Path(bpy.path.abspath(path)).name.removesuffix(SUFFIX) if path.endswith(SUFFIX) else ""
    in_use, number = {as_compared(row.name) for row in subjects.performers}, len(subjects.performers)
    names = (own, *(f"performer{number}" for number in range(1, MAX_SUBJECTS + 2)))
    name = next(name for name in names if is_subject_name(name) and as_compared(name) not in in_use)
    row = subjects.performers.add()
    row.name, row.colour = name, usual_colour(number)
    if subjects.markerset == AUTO_MODEL:
        choose_model(row, path)
    else:
        row.markerset, row.markerset_path = subjects.markerset, subjects.markerset_path
    subjects.performer_index = number


@operator(unless(lambda context: len(context.scene.mocap_autolabel.subjects.performers), "Nobody is in the list"))
def remove_performer(_self, context):
    """Take the chosen performer out of the list."""
    remove_chosen(context.scene.mocap_autolabel.subjects, "performers")


@keeps_items
def people_items(_self, context) -> list[tuple[str, str, str]]:
    """The performers of the active take, for an enumeration."""
    take = context.scene.mocap_autolabel.take
    return [] if take is None else [(name, name, "") for name in homes(take)]


def counterpart(stored: Stored, marker: int, name: str) -> int:
    """The same marker of another performer, of the other one where no name is said; InputError where there is none."""
    own = next(one for one in stored.performers if one.marker_rows.start <= marker < one.marker_rows.stop)
    called = name or next(one.name for one in stored.performers if one.name != own.name)
    if called == own.name:
        raise InputError(f"{stored.names[marker]} is {called}'s already; expected another performer")
    other = next(one for one in stored.performers if one.name == called)
    found = other.called(own.own_name(stored.names[marker]))
    if found not in stored.names:
        raise InputError(f"{called} wears no {own.own_name(stored.names[marker])}; expected a marker that both wear")
    return stored.names.index(found)


class ToldApart(Corrects):
    """Corrections of who is who."""

    needs = (
        *Corrects.needs,
        unless(lambda context: len(homes(context.scene.mocap_autolabel.take)) > 1, "The take is of one performer"),
    )


class MOCAP_AUTOLABEL_OT_other_performer(ToldApart, bpy.types.Operator):
    """Say that what is picked or selected is the other performer's, and what had that name there has this one."""

    bl_label = "It Is the Other One's"
    bl_property = "performer"

    performer: once(EnumProperty, "Performer", "Whose it is", items=people_items)

    def invoke(self, context, event):
        self.scope_of_tool(context)
        if len(homes(context.scene.mocap_autolabel.take)) == 2 or self.properties.is_property_set("performer"):
            return self.execute(context)
        context.window_manager.invoke_search_popup(self)
        return {"RUNNING_MODAL"}

    def edits(self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
        """The trajectories are the same markers of the other one; of selected markers the two are exchanged."""
        named = self.properties.is_property_set("performer") or len(stored.performers) > 2
        name = self.performer if named else ""
        if points := picked_points(context):
            return [edit for point in points for edit in given_over(context, stored, point, name, frames)]
        markers = [stored.names.index(marker) for marker in selected_markers(context)]
        if not markers:
            raise InputError("nothing is selected; expected markers or points, picked with the tool Label")
        pairs = {tuple(sorted((marker, counterpart(stored, marker, name)))) for marker in markers}
        return [Swap((stored.names[one], stored.names[other]), frames=frames) for one, other in sorted(pairs)]


def given_over(
    context: bpy.types.Context, stored: Stored, point: int, name: str, frames: tuple[int, int] | None
) -> list[Edit]:
    """A trajectory is the same marker of another performer in some frames, and what was that one is its marker there.

    It is taken for what it is in the current frame, or mostly. InputError where it has no name.
    """
    rows = within(stored, opened.rows_of(stored, point), frames)
    named = rows[stored.labels.marker[rows] != NO_MARKER]
    if not len(named):
        raise InputError(f"trajectory {point} has no name; expected one that has, or the marker said by its name")
    number, marker = stored.rows.frames[stored.rows.frame[named]], stored.labels.marker[named]
    here = marker[number == stored.clock.at(context.scene.frame_float)]
    own = int(here[0]) if len(here) else int(np.bincount(marker).argmax())
    other = counterpart(stored, own, name)
    there = stored.rows.frames[stored.rows.frame[rows]]
    span = int(there[0]), int(there[-1])
    theirs = within(stored, np.flatnonzero(stored.labels.marker == other), span)
    others = np.unique(stored.rows.trajectory[theirs])
    gives = [AssignPoint(int(one), stored.names[own], frames=span) for one in others if one != point]
    return [AssignPoint(point, stored.names[other], frames=frames), *gives]


class MOCAP_AUTOLABEL_OT_exchange_performers(ToldApart, bpy.types.Operator):
    """Say that two performers have each other's names: all markers that both wear are exchanged."""

    one: once(EnumProperty, "One", "Who has the other's names", items=people_items)
    other: once(EnumProperty, "Other", "Who has the one's names", items=people_items)

    def invoke(self, context, event):
        self.scope_of_tool(context)
        names = list(homes(context.scene.mocap_autolabel.take))
        if not self.properties.is_property_set("other"):
            self.other = names[1]
        if len(names) == 2:
            return self.execute(context)
        return context.window_manager.invoke_props_dialog(self)

    def edits(self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
        chosen = [next(who for who in stored.performers if who.name == name) for name in (self.one, self.other)]
        if chosen[0] is chosen[1]:
            raise InputError(f"{self.one} cannot be exchanged with {self.other}; expected two performers")
        named = within(stored, np.flatnonzero(stored.labels.named), frames)
        there = {stored.names[marker] for marker in np.unique(stored.labels.marker[named])}
        own = [chosen[0].own_name(name) for name in stored.names[chosen[0].marker_rows]]
        pairs = [(chosen[0].called(name), chosen[1].called(name)) for name in own]
        swaps = [Swap(pair, frames=frames) for pair in pairs if pair[1] in stored.names and there & set(pair)]
        if not swaps:
            raise InputError("neither has a marker in these frames that both wear; expected frames in which one has")
        return swaps
