# SPDX-License-Identifier: GPL-3.0-or-later
"""Through the trouble of a take, the worst first: go there, see what is meant, do what helps or say it is right."""

import bpy
import numpy as np
from bpy.props import BoolProperty, IntProperty

from ..core.data.errors import InputError
from ..core.data.takes import NO_POINT, PointRows, rows_in_frame
from ..core.edits.kinds import AssignPoint, Edit, UnlabelMarker
from ..core.review.trouble import DELETE, FILL, LABEL, NAME_IT, REFINE, RIGHT, UNLABEL, Trouble
from ..props import list_trouble
from ..scene.cameras import camera_name, originals
from ..scene.roots import in_world
from ..scene.stored import Stored
from ..scene.trouble import trouble_of
from .base import WithTake, lacks_own_take, once, operator, taken
from .correcting import correct
from .listing import is_listed, list_here, refuse_other_lists
from .picking import dots_here, show_picked
from .viewing import bring_into_view, fit_graphs, marker_places

# The operators for what no edit mends, and the words of their buttons.
BUTTONS = {
    FILL: ("fill_gaps", "Fill {}"),
    REFINE: ("refine_calibration", "Refine Calibration"),
    LABEL: ("label", "Refit"),
}


def mending(trouble: Trouble) -> list[Edit]:
    """The edits that do what is advised, where edits can."""
    if trouble.action == NAME_IT and trouble.markers and trouble.trajectories:
        where = trouble.named_in or trouble.spans
        return [AssignPoint(trouble.trajectories[0], trouble.markers[0], frames=span) for span in where]
    if trouble.action == UNLABEL:
        return [UnlabelMarker(trouble.markers[0], frames=span) for span in trouble.spans]
    if trouble.action == DELETE:
        return trouble.answers()
    return []


def words_for(trouble: Trouble) -> str:
    """What the button says that does what is advised; empty where none can."""
    if trouble.action in (DELETE, RIGHT) or not (mending(trouble) or trouble.action in BUTTONS):
        return ""
    if trouble.action == NAME_IT:
        return f"Name {trouble.trajectories[0]} {trouble.markers[0]}"
    if trouble.action == UNLABEL:
        return f"Unlabel {trouble.markers[0]}"
    return BUTTONS[trouble.action][1].format(" ".join(trouble.markers))


def places_of(trouble: Trouble, stored: Stored, frame: int) -> np.ndarray:
    """(K, 3) m where what is meant is in a frame: markers, or where the body has them, and points of trajectories."""
    index = int(np.searchsorted(stored.motion.frames, frame))
    markers = [stored.words[name] for name in trouble.markers if name in stored.words]
    places = [marker_places(stored, index, markers)]
    if isinstance(stored.rows, PointRows) and trouble.trajectories:
        rows = rows_in_frame(stored.rows, index)
        places.append(stored.rows.xyz[rows][np.isin(stored.rows.trajectory[rows], trouble.trajectories)])
    every = np.concatenate(places)
    return every[np.isfinite(every).all(axis=1)]


def go_to(state: bpy.types.PropertyGroup, index: int):
    """Chooses a line of the list, which is where the way through it is then."""
    state.trouble_index, state.trouble_followed = index, -1


def show(context: bpy.types.Context, trouble: Trouble):
    """Goes to the first frame of a trouble, selects what it is about and brings that into every 3D view."""
    scene = context.scene
    stored = taken(context)
    context.window_manager.mocap_autolabel.trouble_shown = trouble.reason
    frame = trouble.first
    if not len(places_of(trouble, stored, frame)) and trouble.last > frame:
        frame = (trouble.first + trouble.last) // 2
    stored.clock.go_to(scene, frame)
    _select(context, trouble, stored)
    places = places_of(trouble, stored, frame)
    bring_into_view(context, in_world(scene.mocap_autolabel.take, places))
    around = round(stored.rate)
    fit_graphs(context, trouble.first - around, trouble.last + around)


def _select(context: bpy.types.Context, trouble: Trouble, stored: Stored):
    """Picks the markers and trajectories of a trouble, and selects its cameras."""
    if context.mode != "OBJECT":
        return
    cameras, points = context.scene.mocap_autolabel.source.cameras, []
    markers = [stored.words[name] for name in trouble.markers if name in stored.words]
    if isinstance(stored.rows, PointRows):
        dots = dots_here(stored, context.scene)
        meant = np.isin(dots.marker, markers) | dots.of(trouble.trajectories)
        points = dots.trajectory[meant & (dots.trajectory != NO_POINT)].tolist()
    show_picked(context, stored, points, markers)
    for item in originals(cameras.all_objects) if cameras is not None and trouble.cameras else ():
        if camera_name(item) in trouble.cameras and item.name in context.view_layer.objects:
            item.select_set(True)
            context.view_layer.objects.active = item


class OfTrouble(WithTake):
    """Operators on one line of the list of what is the matter with the active take."""

    index: once(IntProperty, "Index", "Which of the list, from 0", min=0)

    def trouble(self, context: bpy.types.Context) -> Trouble:
        """The line that is meant; InputError where there is none, or where another scene's were listed."""
        refuse_other_lists(context)
        found = trouble_of(context.scene.mocap_autolabel.take, context.scene)
        if self.index >= len(found):
            raise InputError(f"there is no trouble {self.index + 1}; expected one of the {len(found)} in the list")
        return found[self.index]


@operator(of=OfTrouble, label="Show")
def show_trouble(self, context):
    """Go to the frame, select what is meant, light it up and bring it into view."""
    trouble = self.trouble(context)
    go_to(context.window_manager.mocap_autolabel, self.index)
    show(context, trouble)


@operator(of=OfTrouble, back=once(BoolProperty, "Back", "To the one before"))
def next_trouble(self, context):
    """Go to the next trouble that is listed and open."""
    list_here(context)
    list_trouble()  # after a correction it comes a moment later, and its lines would not be those of the take
    state = context.window_manager.mocap_autolabel
    listed = [number for number, row in enumerate(state.troubles) if is_listed(state, row) and not row.answered]
    if not listed:
        self.report({"INFO"}, "Nothing is left to look at")
        return {"CANCELLED"}
    # The list may have gone along with what was picked since; the way through it goes on from where it was.
    at = state.trouble_left if state.trouble_index == state.trouble_followed else state.trouble_index
    at = min(at, len(state.troubles) - 1)
    # What was answered or mended left its place to another one, and at first none was shown: that one is next.
    here = not self.back and state.troubles[at].reason != state.trouble_shown
    later = [number for number in listed if (number < at if self.back else number > at or (here and number == at))]
    self.index = (later or listed)[-1 if self.back else 0]
    go_to(state, self.index)
    show(context, self.trouble(context))
    return {"FINISHED"}


@operator(lacks_own_take, of=OfTrouble, label="It Is Right")
def accept_trouble(self, context):
    """Say that it was looked at and is right as it is: it is not asked again, whatever is labelled again."""
    correct(context, taken(context).edits.added(*self.trouble(context).answers()))


@operator(lacks_own_take, of=OfTrouble, label="Do That")
def mend_trouble(self, context):
    """Do what is advised."""
    trouble = self.trouble(context)
    if edits := mending(trouble):
        correct(context, taken(context).edits.added(*edits))
        return {"FINISHED"}
    if trouble.action not in BUTTONS:
        raise InputError("nothing does that by itself; expected a person to look")
    show(context, trouble)
    # By their names, as those that are hidden cannot be selected.
    given = {"extent": "MARKER", "markers": "\n".join(trouble.markers)} if trouble.action == FILL else {}
    return getattr(bpy.ops.mocap_autolabel, BUTTONS[trouble.action][0])("INVOKE_DEFAULT", **given)
