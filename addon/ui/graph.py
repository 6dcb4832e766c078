# SPDX-License-Identifier: GPL-3.0-or-later
"""Over Blender's Graph Editor, whose curves are the keys of the selected markers: what these cannot tell.

Blender draws a straight line across a gap, and its keys hide the colours of the axes. Here what was seen has these, a
gap is marked, in it lies the fill with the error to expect, dashed until it is kept, and a trajectory without a name,
which has no keys, has its curves as well.
"""

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ..core.data.takes import NO_MARKER, PointRows
from ..core.filling.gaps import find_gaps
from ..core.filling.kept import KeptFill
from ..ops.filling import proposed
from ..ops.picking import picked_points, selected_markers
from ..scene.clock import TakeClock
from ..scene.later import redraw
from ..scene.opened import opened
from ..scene.stored import Stored
from ..scene.take import is_take
from ..scene.trajectories import GAP
from .lettering import Letters
from .marks import BLUE, ORANGE
from .timeline import LETTERS, STATE_COLOURS, Pixels

GAP_OPACITY, BAND_OPACITY = 0.14, 0.3
DASH, SPACE = 6.0, 4.0  # px of the interface that a line is drawn and left out
FILL_WIDTH, SEEN_WIDTH = 2.0, 2.5  # px of the interface
WORDS_FOOT, WORDS_LINE = 46.0, 16.0  # px of the interface; below it Blender names the timeline's markers
_letters = Letters()


@dataclass(frozen=True)
class GraphPlaces:
    """Where frames and values are in a region, px from its lower left corner: `origin + scale * (frame, value)`."""

    origin: np.ndarray  # (2,)
    scale: np.ndarray  # (2,)

    @classmethod
    def of(cls, region: bpy.types.Region) -> "GraphPlaces":
        corners = [region.view2d.region_to_view(*place) for place in ((0, 0), (region.width, region.height))]
        lower, upper = np.array(corners)
        scale = np.array([region.width, region.height]) / np.maximum(upper - lower, 1e-9)
        return cls(-lower * scale, scale)

    def at(self, frames: np.ndarray, values: np.ndarray) -> np.ndarray:
        """(K, 2) px of frames and values (K,)."""
        return self.origin + self.scale * np.column_stack([frames, values])


def graph_shown(context: bpy.types.Context) -> bool:
    """Whether the editor of the context shows curves in their own units, of a scene with a take."""
    space = context.space_data
    return space.mode == "FCURVES" and not space.use_normalization and is_take(context.scene.mocap_autolabel.take)


def draw():
    """Draws over the editor's curves; Blender calls this at every redraw."""
    context = bpy.context
    if not graph_shown(context):
        return
    stored = opened.take(context.scene.mocap_autolabel.take, context.scene)
    places, names, said = GraphPlaces.of(context.region), selected_markers(context), []
    scale = context.preferences.system.ui_scale
    clock = stored.clock
    first, last = (clock.at(context.region.view2d.region_to_view(x, 0)[0]) for x in (0, context.region.width))
    with Pixels(context.region) as pixels:
        if names:  # of one, the active one: the gaps of many would cover everything
            draw_gaps(pixels, places, gaps_of(stored, names[0]), clock)
        draw_curves(context, pixels, places, stored)
        looked_at = proposed(context)
        again = {(fill.marker, fill.first) for fill in looked_at}
        kept = [fill for fill in stored.fitting if (fill.marker, fill.first) not in again]
        for fills, colour, dash in ((kept, BLUE, 0.0), (looked_at, ORANGE, DASH * scale)):
            seen = [one for one in fills if one.marker in names and one.first <= last and first <= one.last]
            draw_fills(pixels, places, seen, clock, colour, dash)
            for fill in seen:
                x = places.origin[0] + places.scale[0] * clock.shown(fill.first)
                said.append((words_of(fill), x + 2 * SPACE * scale, colour))  # beside the line of the current frame
        widths = [_letters.width(words + "  ", LETTERS * scale) for words, *_ in said]
        rows = rows_of([x for _, x, _ in said], widths)
        lines_of_words = [scale * (WORDS_FOOT + WORDS_LINE * row) for row in rows]
        beside = [(words, x, y, colour) for (words, x, colour), y in zip(said, lines_of_words, strict=True)]
        _letters.draw(beside, LETTERS * scale, shadow=True)


def draw_gaps(pixels: Pixels, places: GraphPlaces, gaps: np.ndarray, clock: TakeClock):
    """Shades frames (N, 2) of the source from the first to the last, both included."""
    x = places.origin[0] + places.scale[0] * clock.shown(gaps + np.array([-0.5, 0.5]))
    boxes = np.column_stack([x[:, 0], 0 * x[:, 0], x[:, 1], 0 * x[:, 1] + pixels.size[1]])
    pixels.boxes(boxes, (*STATE_COLOURS[GAP], GAP_OPACITY))


def words_of(fill: KeptFill) -> str:
    """What is said of a fill below it."""
    off = f"± {1000 * fill.expected:.1f} mm" if fill.expected == fill.expected else "error not known"
    return f"{fill.marker} {off}"


def rows_of(starts: Sequence[float], widths: Sequence[float]) -> list[int]:
    """Of words that begin at `starts`, px, and are so wide, the lowest rows in which none lies on another."""
    rows, ends = [0] * len(starts), []
    for one in sorted(range(len(starts)), key=starts.__getitem__):
        row = next((row for row, end in enumerate(ends) if end <= starts[one]), len(ends))
        ends[row : row + 1] = [starts[one] + widths[one]]
        rows[one] = row
    return rows


def gaps_of(stored: Stored, name: str) -> np.ndarray:
    """(N, 2) first and last frame, of the source's numbers, of each gap of a marker, filled or not."""
    gaps = find_gaps(np.isfinite(stored.unfilled.markers[:, [stored.names.index(name)], 0]))
    return stored.motion.frames[np.array([(gap.start, gap.stop - 1) for gap in gaps], int).reshape(-1, 2)]


def draw_curves(context: bpy.types.Context, pixels: Pixels, places: GraphPlaces, stored: Stored):
    """x, y and z, in the colours of the axes, of what was seen of the selected markers.

    And of the picked trajectories, where these have no name.
    """
    first, clock = int(stored.motion.frames[0]), stored.clock
    left, right = (clock.at((x - places.origin[0]) / places.scale[0]) - first for x in (0, pixels.size[0]))
    begin, end = max(left - 1, 0), min(max(right + 2, 0), len(stored.motion.frames))
    step = max(1, (end - begin) // pixels.size[0])  # more than one to a pixel is not seen
    here = slice(begin, end, step)
    seen, shown = stored.unfilled.markers[here], stored.motion.markers[here]
    markers = [stored.names.index(name) for name in selected_markers(context)]
    curves = [np.where(np.isfinite(seen[:, one]), shown[:, one], np.nan) for one in markers]
    for point in picked_points(context) if isinstance(stored.rows, PointRows) else ():
        rows = opened.rows_of(stored, point)
        after = stored.rows.frame[rows] - begin
        there = (after >= 0) & (after < end - begin) & (after % step == 0)
        there &= stored.labels.marker[rows] == NO_MARKER
        curves.append(np.full((len(seen), 3), np.nan))
        curves[-1][after[there] // step] = stored.rows.xyz[rows[there]]
    theme = context.preferences.themes[0].user_interface
    frames = clock.shown(first + begin + step * np.arange(len(seen)))
    for xyz in curves:
        for values, colour in zip(xyz.T, (theme.axis_x, theme.axis_y, theme.axis_z), strict=True):
            line = places.at(frames, values)
            ends = np.stack([line[:-1], line[1:]], axis=1)
            lines(pixels, ends[np.isfinite(ends).all(axis=(1, 2))], (*colour, 1.0), SEEN_WIDTH)


def draw_fills(
    pixels: Pixels,
    places: GraphPlaces,
    fills: Iterable[KeptFill],
    clock: TakeClock,
    colour: tuple[float, ...],
    dash: float,
):
    """Fills, each with a band as wide as the error to expect to either side; with a `dash`, px, their lines have such.

    That is the mean error in space, which is that of no axis alone, but of none more.
    """
    ends, bands = [np.zeros((0, 2, 2))], [np.zeros((0, 4, 2))]
    for fill in fills:
        frames = clock.shown(np.arange(fill.first - 1, fill.last + 2))
        known = np.isfinite(fill.path).all(axis=1)
        for values in fill.path[known].T:
            line = places.at(frames[known], values)
            steps = np.stack([line[:-1], line[1:]], axis=1)
            ends.append(dashed(line, dash, dash * SPACE / DASH, pixels.size[0]) if dash else steps)
            if fill.expected == fill.expected:
                bands.append(around(steps, fill.expected * places.scale[1]))
    pixels.quads(np.concatenate(bands), (*colour[:3], BAND_OPACITY))
    lines(pixels, np.concatenate(ends), colour, FILL_WIDTH)


def around(steps: np.ndarray, half: float) -> np.ndarray:
    """(K, 4, 2) the corners of all within `half` px above and below lines (K, 2, 2) px."""
    up = np.array([0.0, half])
    return np.stack([steps[:, 0] - up, steps[:, 1] - up, steps[:, 1] + up, steps[:, 0] + up], axis=1)


def dashed(line: np.ndarray, dash: float, space: float, wide: float) -> np.ndarray:
    """(N, 2, 2) the dashes of a line (K, 2) px that goes from left to right, so long and so far apart along x.

    Those alone that are seen between 0 and `wide` px.
    """
    left = line[0, 0] + max(0.0, -line[0, 0]) // (dash + space) * (dash + space)
    starts = np.arange(left, min(line[-1, 0], wide), dash + space)
    x = np.column_stack([starts, np.minimum(starts + dash, line[-1, 0])])
    return np.stack([x, np.interp(x, line[:, 0], line[:, 1])], axis=-1)


def lines(pixels: Pixels, ends: np.ndarray, colour: tuple[float, ...], width: float):
    """Lines between ends (N, 2, 2) px."""
    if not len(ends):
        return
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    shader.bind()
    shader.uniform_float("viewportSize", pixels.size)
    shader.uniform_float("lineWidth", width * bpy.context.preferences.system.ui_scale)
    shader.uniform_float("color", colour)
    flat = np.zeros((2 * len(ends), 3), np.float32)
    flat[:, :2] = ends.reshape(-1, 2)
    batch_for_shader(shader, "LINES", {"pos": flat}).draw(shader)


def add_graph(stack: ExitStack):
    """Adds what is drawn over Graph Editors; brings its way back to `stack`."""
    drawing = bpy.types.SpaceGraphEditor.draw_handler_add(draw, (), "WINDOW", "POST_VIEW")
    stack.callback(bpy.types.SpaceGraphEditor.draw_handler_remove, drawing, "WINDOW")
    stack.callback(_letters.forget)
    stack.callback(redraw, "GRAPH_EDITOR")
