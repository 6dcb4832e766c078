# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawn over the 3D view: a stick figure in the colours of its sides, trails of what is selected, and what is meant.

A trail is broken where its marker was not seen. Where a marker is missing in this frame, and the list asks about that,
a thin ring is drawn in the place that the body has for it.
"""

import json
from collections.abc import Sequence

import bpy
import numpy as np

from ..core.body.sides import side_in
from ..core.review.trouble import MISSING, Trouble
from ..ops.picking import selected_markers, take_to_view
from ..ops.reviewing import places_of
from ..scene.armature import KEPT_SIDES, SIDE_COLOURS
from ..scene.opened import opened
from ..scene.performers import Colour, armatures_of, colours_in, marker_colours
from ..scene.stored import Stored
from ..scene.take import is_hidden, is_take
from ..scene.trouble import known_trouble
from .overlay import Canvas

FIGURE_WIDTH, TRAIL_WIDTH = 3.0, 1.8
SIDE_TINT = 0.3  # of the colour of a side in that of a performer among several
FAR_BONE = 0.62  # of a colour's brightness that every other segment along a limb has, so that one sees where it ends
MISSING_COLOUR = (0.75, 0.75, 0.75, 0.55)
MEANT_COLOUR = (1.0, 1.0, 1.0, 1.0)
MISSING_RADIUS, MEANT_RADIUS = 5.0, 11.0
JOINED = 0.005  # m; a bone that begins nearer than this to an end of the one above hangs on it
# By the session's own number of an armature: what the bones that were drawn last are called by, and their colours with
# the bones above them.
_colours_of_bones: dict[int, tuple] = {}


def draw():
    """Draws over the current 3D view; Blender calls this at every redraw."""
    context = bpy.context
    settings, space = context.scene.mocap_autolabel, context.space_data
    if not settings.display.show_overlay or not space.overlay.show_overlays or not is_take(settings.take):
        return
    stored = opened.take(settings.take, context.scene)
    index = stored.index_of(context.scene.frame_float)
    if index < 0 or is_hidden(settings.take, context.view_layer):
        return
    with Canvas(context) as canvas:
        if settings.display.show_figure:
            colours, shown = colours_in(settings.take), armatures_of(settings.take)
            for name, armature in shown:
                if armature.visible_get():
                    draw_bones(canvas, armature, colours.get(name))
            if len(_colours_of_bones) > len(shown):  # those of other takes
                _colours_of_bones.clear()
        canvas.perspective = canvas.perspective @ take_to_view(context, stored, context.area)
        draw_places(canvas, context, stored, index)


def draw_places(canvas: Canvas, context: bpy.types.Context, stored: Stored, index: int):
    """What is drawn where the take has it: what is missing in a frame, trails of what is selected, what is meant."""
    settings = context.scene.mocap_autolabel
    if settings.display.show_figure:
        found = known_trouble(settings.take, context.scene) or ()
        canvas.rings(canvas.place(missing(stored, index, found)), MISSING_COLOUR, MISSING_RADIUS)
    if settings.display.show_trails:
        names = [name for name in selected_markers(context) if name in stored.words]
        draw_trails(canvas, stored, index, [stored.words[name] for name in names], settings.take)
    if (trouble := meant(context, settings.take, stored)) is not None:
        places = canvas.place(places_of(trouble, stored, stored.clock.at(context.scene.frame_float)))
        for radius in (MEANT_RADIUS, MEANT_RADIUS + 1.5):
            canvas.rings(places, MEANT_COLOUR, radius)


def draw_bones(canvas: Canvas, armature: bpy.types.Object, own: Colour | None):
    """A line for every bone, in the colour of its side; along a limb every other one is darker.

    Of several performers each is drawn in their own colour, which the sides tinge.
    """
    bones = armature.pose.bones
    ends = np.empty((2, len(bones), 3), dtype=np.float32)
    for end, name in zip(ends, ("head", "tail"), strict=True):
        bones.foreach_get(name, flat := np.empty(end.size, dtype=np.float32))
        end[:] = flat.reshape(-1, 3)
    in_world, canvas.perspective = canvas.perspective, canvas.perspective @ np.array(armature.matrix_world)
    draw_lines(canvas, ends.swapaxes(0, 1).astype(float), *_bone_colours(armature, own))
    canvas.perspective = in_world


def draw_lines(canvas: Canvas, ends: np.ndarray, colours: np.ndarray, above: np.ndarray):
    """A line for every bone (J, 2, 3) m in its colours (J, 2, 4), and what hangs it on the one above (J,)."""
    apart, joining = links(ends, above)
    canvas.lines(canvas.place(np.concatenate([ends, joining])), np.concatenate([colours, colours[apart]]), FIGURE_WIDTH)


def links(ends: np.ndarray, above: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lines that hang bones on those above them: collar bones, hips. Which bones (L,), and the lines (L, 2, 3).

    ends (J, 2, 3) m of the bones, above (J,) the one that each hangs on, -1 for none.
    """
    reach = np.linalg.norm(ends[above] - ends[:, :1], axis=2)
    apart = np.flatnonzero((above >= 0) & (reach.min(axis=1) > JOINED))
    nearest = ends[above[apart], reach[apart].argmin(axis=1)]
    return apart, np.stack([nearest, ends[apart, 0]], axis=1)


def _bone_colours(armature: bpy.types.Object, own: Colour | None) -> tuple[np.ndarray, np.ndarray]:
    """(J, 2, 4) the colours of the ends of the bones, and (J,) the bone above each; worked out once for an armature."""
    names = tuple(bone.name for bone in armature.data.bones)
    key, kept = (own, names, armature.get(KEPT_SIDES, "")), _colours_of_bones.get(armature.session_uid)
    if kept is None or kept[0] != key:
        sides = json.loads(armature.get(KEPT_SIDES, "{}"))
        above = np.array([-1 if bone.parent is None else names.index(bone.parent.name) for bone in armature.data.bones])
        kept = key, (bone_colours([sides.get(name, "") for name in names], above, own), above)
        _colours_of_bones[armature.session_uid] = kept
    return kept[1]


def bone_colours(sides: list[str], above: Sequence[int], own: Colour | None = None) -> np.ndarray:
    """(J, 2, 4) the colours of the ends of bones by their sides; above (J,) is the bone before that each hangs on."""
    far = np.zeros(len(sides), bool)
    for bone, parent in enumerate(above):
        far[bone] = parent >= 0 and not far[parent]
    colours = np.array([SIDE_COLOURS[side] for side in sides]).reshape(-1, 3)
    if own is not None:
        colours = SIDE_TINT * colours + (1 - SIDE_TINT) * np.array(own)
    whole = np.concatenate([colours * np.where(far, FAR_BONE, 1.0)[:, None], np.ones((len(sides), 1))], axis=1)
    return np.repeat(whole[:, None], 2, axis=1)


def missing(stored: Stored, index: int, found: Sequence[Trouble]) -> np.ndarray:
    """(K, 3) m where the body has the markers that nothing is in a frame, and whose gap is among the trouble found."""
    frame, there = stored.motion.frames[index], np.isfinite(stored.motion.markers[index]).all(axis=1)
    gaps = [one for one in found if one.kind == MISSING and not one.answered]
    lost = {stored.words[name] for one in gaps if any(a <= frame <= b for a, b in one.ranges) for name in one.markers}
    return stored.motion.expected[index, [marker for marker in sorted(lost) if not there[marker]]]


def draw_trails(canvas: Canvas, stored: Stored, index: int, markers: list[int], collection: bpy.types.Collection):
    """Where markers were and will be, a second either way, fading."""
    colours = marker_colours(collection, stored.performers, len(stored.names))
    if colours is None:  # by their sides
        known = set(stored.names)
        colours = {one: SIDE_COLOURS[side_in(stored.names[one], known)] for one in markers}
    for marker in markers:
        ends, faded = trail(stored.motion.markers[:, marker], index, max(round(stored.rate), 2))
        tints = np.concatenate([np.tile(colours[marker], (*faded.shape, 1)), faded[..., None]], axis=2)
        canvas.lines(canvas.place(ends), tints, TRAIL_WIDTH)


def trail(path: np.ndarray, index: int, reach: int) -> tuple[np.ndarray, np.ndarray]:
    """The trail of a marker (F, 3) about frame `index`, `reach` frames either way.

    Lines (L, 2, 3) between frames that follow each other, and how opaque their ends are (L, 2).
    """
    first = max(index - reach, 0)
    part = path[first : index + reach + 1]
    there = np.isfinite(part).all(axis=1)
    begin = np.flatnonzero(there[:-1] & there[1:])
    far = np.abs(np.stack([begin, begin + 1], axis=1) + first - index) / reach
    return np.stack([part[begin], part[begin + 1]], axis=1), 1 - 0.85 * far


def meant(context: bpy.types.Context, collection: bpy.types.Collection, stored: Stored) -> Trouble | None:
    """The trouble that was shown, while it is the chosen one of the list and the current frame is one of it."""
    state = context.window_manager.mocap_autolabel
    found = known_trouble(collection, context.scene) or ()
    if not state.trouble_index < len(found) == len(state.troubles):
        return None
    trouble, frame = found[state.trouble_index], stored.clock.at(context.scene.frame_float)
    asked = trouble.reason == state.trouble_shown and not trouble.answered
    return trouble if asked and trouble.first <= frame <= trouble.last else None
