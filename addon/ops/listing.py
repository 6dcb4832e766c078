# SPDX-License-Identifier: GPL-3.0-or-later
"""The lists of Review go along with what is picked, wherever it was: in the view, the timeline or another list."""

from collections.abc import Collection, Sequence

import bpy

from ..core.data.errors import InputError
from ..props import refresh_review
from ..scene.stored import Stored
from ..scene.trouble import known_trouble
from .base import Ours

OF_GAPS = ("fills", "proposed_fills", "left_gaps")


def list_here(context: bpy.types.Context) -> bool:
    """Has the lists be those of the scene's take; False where they were another scene's, as of another window."""
    manager = context.window_manager
    here = manager.mocap_autolabel.of_scene == context.scene.session_uid
    if not here:
        refresh_review(manager, context.scene)
    return here


def refuse_other_lists(context: bpy.types.Context):
    """Raises InputError where what another scene's list says would be taken for this one's."""
    if not list_here(context):
        raise InputError("the list was another scene's; expected a choice in this one's, which is listed now")


class MOCAP_AUTOLABEL_OT_list_here(Ours, bpy.types.Operator):
    """Have the lists be those of the take in this window."""

    bl_label = "List This Scene's"
    bl_options = {"INTERNAL"}

    def work(self, context):
        list_here(context)


def lists_follow(context: bpy.types.Context, stored: Stored, names: Collection[str], points: Collection[int]):
    """Chooses in every list the row of what is picked, at the current frame where there is one, else the first.

    names are those of markers, points the numbers of trajectories. A row that is meant already stays chosen.
    """
    scene, state = context.scene, context.window_manager.mocap_autolabel
    if not names and not points:
        return
    clock, markers, trajectories = stored.clock, set(names), set(points)
    now = clock.at(scene.frame_float)
    _choose(state, "markers", [row.name in markers for row in state.markers])
    for listed in OF_GAPS:
        rows = getattr(state, listed)
        mine = [row.name in markers for row in rows]
        here = [own and clock.at(row.first) <= now <= clock.at(row.last) for own, row in zip(mine, rows, strict=True)]
        _choose(state, listed, here, mine)
    found = known_trouble(scene.mocap_autolabel.take, scene) or ()
    if len(found) != len(state.troubles):
        return  # the list comes a moment after a correction
    mine = [
        is_listed(state, row) and not (markers.isdisjoint(one.markers) and trajectories.isdisjoint(one.trajectories))
        for one, row in zip(found, state.troubles, strict=True)
    ]
    there = [any(first <= now <= last for first, last in one.spans) for one in found]
    before = state.trouble_index
    _choose(state, "troubles", [own and here for own, here in zip(mine, there, strict=True)], mine)
    if state.trouble_index != before:
        if state.trouble_followed != before:
            state.trouble_left = before
        state.trouble_followed = state.trouble_index


def _choose(state: bpy.types.PropertyGroup, listed: str, *meant: Sequence[bool]):
    """Chooses a row that is meant: by the first of several ways to mean one in which any is."""
    index = f"{listed.removesuffix('s')}_index"
    flags = next((flags for flags in meant if any(flags)), ())
    if flags and not flags[getattr(state, index)]:
        setattr(state, index, flags.index(True))


def is_listed(state: bpy.types.PropertyGroup, row: bpy.types.PropertyGroup) -> bool:
    """Whether the choice above the list of trouble lets a line of it be seen."""
    return state.trouble_done == "ALL" or row.answered == (state.trouble_done == "DONE")
