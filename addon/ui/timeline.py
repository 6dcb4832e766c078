# SPDX-License-Identifier: GPL-3.0-or-later
"""The trajectory timeline, drawn over the Dope Sheet: what every marker is in every frame, in one buffer of the GPU."""

import weakref
from contextlib import ExitStack
from dataclasses import dataclass

import bpy
import gpu
import numpy as np

from ..core.data.takes import NO_MARKER
from ..ops.picking import picked_points, selected_markers
from ..ops.timeline import KEYS, RowPlaces, shown_runs, timeline_shown
from ..scene.later import redraw
from ..scene.take import is_take
from ..scene.trajectories import CORRECTED, DOUBTFUL, FILLED, GAP, NAMED, STATES, UNNAMED, Runs
from .boxes import BOX_CORNERS, box_batch, made_shader
from .lettering import Letters, pixel_matrix

# Okabe and Ito's colours, which are told apart whatever one's eyes, and for each a form of its own as well.
STATE_COLOURS = {
    NAMED: (0.0, 0.62, 0.451),
    UNNAMED: (0.62, 0.62, 0.62),
    GAP: (0.902, 0.624, 0.0),
    FILLED: (0.337, 0.706, 0.914),
    CORRECTED: (0.941, 0.894, 0.259),
    DOUBTFUL: (0.835, 0.369, 0.0),
}
# Lower and upper end of what is drawn, in heights of a row.
STATE_HEIGHTS = {
    NAMED: (0.18, 0.82),
    UNNAMED: (0.32, 0.68),
    GAP: (0.44, 0.56),
    FILLED: (0.14, 0.5),
    CORRECTED: (0.18, 0.82),
    DOUBTFUL: (0.05, 0.95),
}
MIN_WIDTH = 2.0  # px of the interface of what is no name: a gap of one frame in 20,000 is seen as well
PREVIEW_EDGE, BEYOND_RANGE = (0.95, 0.5, 0.1, 1.0), (0.0, 0.0, 0.0, 0.5)
BEHIND_NAMES = 0.75  # opacity of the ground under names that lie on the rows
# How far from the theme's ground to its text: of every second row, and of words that are less than names; and to what
# it selects rows of a list by, of chosen rows.
STRIPE, FAINT, CHOSEN = 0.05, 0.6, 0.35
LETTERS = 11.0  # px of the interface
NAME_MARGIN = 8  # px of the interface beside names

VERTEX = """
void main()
{
  float left = (run.x - view.x) * view.y;
  float right = (run.y - view.x) * view.y;
  if (run.w > 0.5) {
    float middle = 0.5 * (left + right);
    float half_width = max(0.5 * (right - left), 0.5 * view.w);
    left = middle - half_width;
    right = middle + half_width;
  }
  vec2 place = vec2(mix(left, right, corner.x), -(run.z + 1.0 - corner.y) * view.z);
  state = run.w;
  across = corner.y;
  gl_Position = ModelViewProjectionMatrix * vec4(place, 0.0, 1.0);
}
"""
# A branch for each state: `ground` lies between what is drawn and the row's ends.
_BRANCHES = "".join(
    f"if (is_state == {state}) {{ fill = vec3{STATE_COLOURS[state]}; ends = vec2{STATE_HEIGHTS[state]}; }}\n"
    for state in STATE_COLOURS
)
FRAGMENT = f"""
void main()
{{
  int is_state = int(state + 0.5);
  vec3 fill = vec3(0.0);
  vec2 ends = vec2(0.0);
  {_BRANCHES}
  bool inside = across > ends.x && across < ends.y;
  if (!inside && is_state == {NAMED}) {{ discard; }}
  if (is_state == {DOUBTFUL} && mod(gl_FragCoord.x + gl_FragCoord.y, 8.0) < 3.0) {{ fill *= 0.35; }}
  if (is_state == {CORRECTED} && abs(across - 0.5) < 0.1) {{ fill *= 0.25; }}
  colour = vec4(inside ? fill : ground, 1.0);
}}
"""


@dataclass
class DrawnRuns:
    """The buffer of the rows that were drawn last, and the shader; made when they are needed first."""

    of: weakref.ref | None = None
    batch: gpu.types.GPUBatch | None = None
    shader: gpu.types.GPUShader | None = None
    legend: list[gpu.types.GPUBatch] | None = None

    def ready(self, runs: Runs):
        if self.shader is None:
            corners, between = "VEC4 run, VEC2 corner", "@FLOAT state, FLOAT across"
            self.shader = made_shader("run", VERTEX, FRAGMENT, corners, between, "VEC4 view, VEC3 ground")
            self.legend = [buffer_of(self.shader, np.array([[0, 1, 0, state]])) for state in range(len(STATES))]
        if self.of is None or self.of() is not runs:
            # Left and right end in frames after the take's first, row and state, in the order of drawing.
            row, begin, end, state = runs.runs[np.argsort(runs.runs[:, 3], kind="stable")].T
            table = np.column_stack([begin - runs.span[0] - 0.5, end - runs.span[0] + 0.5, row, state])
            self.of, self.batch = weakref.ref(runs), buffer_of(self.shader, table)

    def forget(self):
        self.of = self.batch = self.shader = self.legend = None


_drawn, _letters = DrawnRuns(), Letters()


@dataclass(frozen=True)
class Colours:
    """What the rows are drawn in beside their states, as the theme has the Dope Sheet, or its channels for names."""

    ground: np.ndarray  # (3,), and all of them
    stripe: np.ndarray
    chosen: np.ndarray
    words: np.ndarray
    faint: np.ndarray

    @classmethod
    def of(cls, theme: bpy.types.Theme, names: bool) -> "Colours":
        editor = theme.dopesheet_editor
        back, text = editor.space.back, editor.space.text
        if names and hasattr(theme, "regions"):  # in Blender 5
            back, text = theme.regions.channels.back, theme.regions.channels.text
        elif names:
            back, text = editor.space_list.list, editor.space_list.list_text
        selecting = np.array(theme.user_interface.wcol_list_item.inner_sel)[:3]
        ground, words = np.array(back), np.array(text)
        between = lambda other, share: ground + share * (other - ground)  # noqa: E731
        return cls(ground, between(words, STRIPE), between(selecting, CHOSEN), words, between(words, FAINT))


def solid(colour: np.ndarray, opacity: float = 1.0) -> tuple[float, ...]:
    """A colour (3,) with its opacity."""
    return (*colour.tolist(), opacity)


def buffer_of(shader: gpu.types.GPUShader, runs: np.ndarray) -> gpu.types.GPUBatch:
    """Runs (N, 4) as two triangles each."""
    corner = np.broadcast_to(BOX_CORNERS, (len(runs), *BOX_CORNERS.shape))
    return box_batch(shader, run=np.repeat(runs[:, None], 4, axis=1), corner=corner)


def draw_rows(beside: bool = False):
    """Draws the rows over the editor's main region, or their names over its channels; Blender calls this at redraws."""
    context = bpy.context
    if not timeline_shown(context):
        return
    runs, region = shown_runs(context), context.region
    places = RowPlaces.of(context, region, len(runs))
    colours, of_names = (Colours.of(context.preferences.themes[0], names) for names in (beside, True))
    _drawn.ready(runs)
    with Pixels(region) as pixels:
        draw_ground(context, pixels, runs, places, colours)
        if not beside:
            draw_runs(context, pixels, runs, places, colours)
            draw_state_legend(pixels, places, of_names)
        if beside or not context.space_data.show_region_channels:
            draw_names(context, pixels, runs, places, of_names)
        if beside:
            pixels.box(0, 0, region.width, places.bottom, solid(colours.ground))


def draw_names_beside():
    """Draws the names of the rows over the editor's channels; Blender calls this at every redraw."""
    draw_rows(beside=True)


def draw_runs(context: bpy.types.Context, pixels: "Pixels", runs: Runs, places: RowPlaces, colours: Colours):
    """The stretches of the rows, and the frames that are played."""
    left, right = (context.region.view2d.region_to_view(x, 0)[0] for x in (0, context.region.width))
    wide, clock = context.region.width / max(right - left, 1e-6), runs.clock
    _drawn.shader.bind()
    _drawn.shader.uniform_float("ground", colours.ground.tolist())
    # What lies under the frame numbers, Blender draws over afterwards; under the legend, we do.
    with gpu.matrix.push_pop():
        gpu.matrix.translate((0.0, places.upper(0)))
        _drawn.shader.uniform_float(
            "view",
            ((left - clock.shown(runs.span[0])) / clock.step, wide * clock.step, places.row, MIN_WIDTH * places.scale),
        )
        _drawn.batch.draw(_drawn.shader)
    draw_preview_range(context.scene, pixels, places, (left, wide))


class Pixels:
    """A region to draw on in its own pixels, from its lower left corner."""

    def __init__(self, region: bpy.types.Region):
        self.size = region.width, region.height
        self._flat = gpu.shader.from_builtin("UNIFORM_COLOR")

    def __enter__(self):
        wide, high = self.size
        gpu.matrix.push()
        gpu.matrix.push_projection()
        gpu.matrix.load_identity()
        gpu.matrix.load_projection_matrix(pixel_matrix(wide, high))
        gpu.state.blend_set("ALPHA")
        return self

    def __exit__(self, *_):
        gpu.state.blend_set("NONE")
        gpu.matrix.pop_projection()
        gpu.matrix.pop()

    def box(self, left: float, lower: float, right: float, upper: float, colour: tuple[float, ...]):
        self.boxes(np.array([[left, lower, right, upper]]), colour)

    def boxes(self, ends: np.ndarray, colour: tuple[float, ...]):
        """Filled boxes (N, 4): left, lower, right, upper end."""
        self.quads(ends[:, [[0, 1], [2, 1], [2, 3], [0, 3]]], colour)

    def quads(self, corners: np.ndarray, colour: tuple[float, ...]):
        """Filled figures of four corners (N, 4, 2), one after the other around each."""
        if not len(corners):
            return
        self._flat.bind()
        self._flat.uniform_float("color", colour)
        box_batch(self._flat, pos=corners).draw(self._flat)


def draw_ground(context: bpy.types.Context, pixels: Pixels, runs: Runs, places: RowPlaces, colours: Colours):
    """The ground of the rows, every second one lighter and the chosen ones blue; it covers Blender's channels."""
    wide = pixels.size[0]
    pixels.box(0, 0, wide, places.top, solid(colours.ground))
    seen = rows_seen(runs, places)
    for rows, colour in ((seen[seen % 2 == 1], colours.stripe), (chosen_rows(context, runs, seen), colours.chosen)):
        upper = places.upper(rows)
        ends = np.column_stack([0 * upper, np.maximum(upper - places.row, 0), 0 * upper + wide, upper])
        pixels.boxes(np.minimum(ends, [wide, wide + places.top, wide, places.top]), solid(colour))


def rows_seen(runs: Runs, places: RowPlaces) -> np.ndarray:
    """The rows of which at least a part is in the region."""
    first = int(places.scroll)
    return np.arange(first, min(len(runs), first + int(places.height / places.row) + 2))


def chosen_rows(context: bpy.types.Context, runs: Runs, seen: np.ndarray) -> np.ndarray:
    """Those of the rows whose markers are selected, or whose trajectory is picked."""
    names, picked = set(selected_markers(context)), set(picked_points(context))
    named = np.array([runs.names[row] in names for row in seen], bool)
    return seen[np.where(runs.marker[seen] != NO_MARKER, named, np.isin(runs.trajectory[seen], list(picked)))]


def draw_preview_range(scene: bpy.types.Scene, pixels: Pixels, places: RowPlaces, view: tuple[float, float]):
    """Darkens what is outside the preview range, or the scene's range where there is none, as Blender does."""
    left, wide = view
    first, last, preview = scene.frame_start, scene.frame_end, scene.use_preview_range
    if preview:
        first, last = scene.frame_preview_start, scene.frame_preview_end
    begin, end = (first - 0.5 - left) * wide, (last + 0.5 - left) * wide
    pixels.box(0, places.bottom, max(begin, 0), places.top, BEYOND_RANGE)
    pixels.box(min(end, pixels.size[0]), places.bottom, pixels.size[0], places.top, BEYOND_RANGE)
    if preview:
        thin = places.scale
        for x in (begin, end):
            pixels.box(x - thin, places.bottom, x + thin, places.top, PREVIEW_EDGE)


def draw_state_legend(pixels: Pixels, places: RowPlaces, colours: Colours):
    """What colours and forms mean, at the bottom, where there is room."""
    scale, high = places.scale, places.bottom
    if not high:
        return
    pixels.box(0, 0, pixels.size[0], high, solid(colours.ground))
    pixels.box(0, high - scale, pixels.size[0], high, solid(colours.faint))
    x, words = NAME_MARGIN * scale, []
    _drawn.shader.bind()
    for state, swatch in zip(range(len(STATES)), _drawn.legend, strict=True):
        with gpu.matrix.push_pop():
            gpu.matrix.translate((x, high - 3 * scale))
            _drawn.shader.uniform_float("view", (0.0, 26 * scale, high - 6 * scale, 0.0))
            swatch.draw(_drawn.shader)
        x += 32 * scale
        words.append((STATES[state], x, high / 2 - 3 * scale, solid(colours.words)))
        x += _letters.width(STATES[state], LETTERS * scale) + 18 * scale
    _letters.draw(words, LETTERS * scale)


def draw_names(context: bpy.types.Context, pixels: Pixels, runs: Runs, places: RowPlaces, colours: Colours):
    """The names of the rows that are seen whole, and how much of the take each has, over the channels or the rows."""
    wide, beside = pixels.size[0], context.region.type == "CHANNELS"
    scale, frames = places.scale, max(runs.span[1] - runs.span[0] + 1, 1)
    size, margin = LETTERS * scale, NAME_MARGIN * scale
    seen = rows_seen(runs, places)
    base = places.upper(seen) - 0.5 * places.row - 0.35 * size
    seen = seen[(base + size <= places.top) & (base >= places.bottom)]
    words = []
    for row in seen.tolist():
        y = places.upper(row) - 0.5 * places.row - 0.35 * size
        words.append((runs.names[row], margin, y, solid(colours.words)))
        share = f"{runs.found[row] / frames:.1%}"
        x = wide - _letters.width(share, size) - margin
        if beside and x > _letters.width(runs.names[row], size) + 3 * margin:
            words.append((share, x, y, solid(colours.faint)))
    if not beside and words:
        longest = max(_letters.width(text, size) for text, *_ in words)
        pixels.box(0, places.bottom, longest + 2 * margin, places.top, solid(colours.ground, BEHIND_NAMES))
    _letters.draw(words, size)


def draw_switches(self, context):
    """What the editor's header and its menu have of the timeline."""
    if context.space_data.mode == "DOPESHEET" and is_take(context.scene.mocap_autolabel.take):
        in_menu, display = isinstance(self, bpy.types.Menu), context.scene.mocap_autolabel.display
        self.layout.prop(display, "show_timeline", toggle=not in_menu, icon="NONE" if in_menu else "NLA")
        if in_menu:
            self.layout.prop(context.window_manager.mocap_autolabel, "timeline_unfolded")


def add_timeline(stack: ExitStack):
    """Adds what draws the timeline, its switches and its keys; each brings its way back to `stack`."""
    for draw, kind, when in ((draw_rows, "WINDOW", "POST_VIEW"), (draw_names_beside, "CHANNELS", "POST_PIXEL")):
        drawing = bpy.types.SpaceDopeSheetEditor.draw_handler_add(draw, (), kind, when)
        stack.callback(bpy.types.SpaceDopeSheetEditor.draw_handler_remove, drawing, kind)
    stack.callback(_drawn.forget)
    stack.callback(_letters.forget)
    for menu in (bpy.types.DOPESHEET_HT_header, bpy.types.DOPESHEET_MT_view):
        menu.append(draw_switches)
        stack.callback(menu.remove, draw_switches)
    keys = bpy.context.window_manager.keyconfigs.addon
    if keys is None:  # a Blender without windows has none
        return
    for (name, space), items in KEYS.items():
        keymap = keys.keymaps.new(name=name, space_type=space, region_type="WINDOW")
        for event, modifiers, operator, properties in items:
            value = "ANY" if event == "TRACKPADPAN" else "PRESS"
            item = keymap.keymap_items.new(f"mocap_autolabel.{operator}", event, value, **modifiers)
            for key, wanted in properties.items():
                setattr(item.properties, key, wanted)
            stack.callback(keymap.keymap_items.remove, item)
    stack.callback(redraw, "DOPESHEET_EDITOR")
