# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawn over the 3D view: through a camera its blobs, the body's markers and the links between them; names anywhere."""

from collections.abc import Iterable, Sequence
from typing import Self

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ..core.data.takes import BY_EDIT, CONFLICT, EXCLUSIVE, NO_MARKER, NO_STEP, REMAINING, Blobs, PointRows
from ..core.data.wording import count_of
from ..ops.importing import cameras_at_hand
from ..ops.reposing import words_behind
from ..scene.blob_dots import FrameRays, blob_dots
from ..scene.cameras import camera_name, camera_through, room_pose
from ..scene.markerset_edit import edited_collection, marker_items
from ..scene.opened import opened
from ..scene.performers import colours_in, marker_colours
from ..scene.picking import to_region
from ..scene.preview import holds_points
from ..scene.roots import placed
from ..scene.take import Stored, is_hidden, is_take
from ..scene.units import enlarged, metre_of
from . import marks
from .boxes import Discs
from .lettering import Letters, Word
from .marks import BLUE, GREY, ORANGE, RED, STEP_COLOURS, WHITE

BLOB_RADIUS, RING_RADIUS, LINK_WIDTH, TEXT_SIZE = 3.5, 5.5, 2.2, 11.0
RAY, LOOSE_RAY = (1.0, 1.0, 1.0, 0.1), (1.0, 0.15, 0.2, 0.35)
RING_COLOUR = (1.0, 1.0, 1.0, 0.45)
CORNERS = 16
LEGEND_LEFT, LEGEND_BOTTOM, LINE = 60, 20, 18
LEGEND = (
    ("nothing else near", EXCLUSIVE),
    ("chosen among several", CONFLICT),
    ("left over, and fits", REMAINING),
    ("no name", NO_STEP),
)
BY_HAND = ("named by hand", BY_EDIT)
letters, discs = Letters(), Discs()
legend_ends: dict[int, float] = {}  # px, where the next legend begins in a region that was drawn on
COVERING = ("TOOLS", "UI", "HEADER", "TOOL_HEADER", "ASSET_SHELF", "ASSET_SHELF_HEADER", "HUD")


def draw():
    """Draws the current frame over the current 3D view; Blender calls this at every redraw."""
    context = bpy.context
    settings, space = context.scene.mocap_autolabel, context.space_data
    if not settings.display.show_overlay or not space.overlay.show_overlays:
        return
    with Canvas(context) as canvas:
        laid_out = edited_collection(context.scene) if settings.display.show_names else None
        if laid_out is not None:
            items = {name: item for name, item in marker_items(laid_out).items() if item.visible_get()}
            places = np.array([item.matrix_world.translation for item in items.values()], dtype=float).reshape(-1, 3)
            canvas.names(list(items), canvas.place(places))
        if words := words_behind(context):
            canvas.text(words, LEGEND_LEFT * canvas.scale, canvas.foot, RED)
            canvas.foot += LINE * canvas.scale
        draw_frame(canvas, context)
        legend_ends[canvas.region] = canvas.foot


def draw_frame(canvas: "Canvas", context: bpy.types.Context):
    """What there is of the take in the current frame."""
    settings, stored = context.scene.mocap_autolabel, shown(context.scene)
    collection = settings.take if is_take(settings.take) else None
    index = stored.index_of(context.scene.frame_float) if stored else -1
    if index < 0 or (collection is not None and is_hidden(collection, context.view_layer)):
        return
    camera = camera_through(context.space_data, context.scene)
    if camera is not None and camera_name(camera) in stored.cameras.names:
        canvas.perspective = canvas.perspective @ enlarged(metre_of(camera))
        draw_camera(canvas, stored, index, camera, settings)
        return
    canvas.perspective = canvas.perspective @ placed(collection or settings.source.preview)
    if isinstance(stored.rows, Blobs):
        rays = settings.display.show_rays
        # Until there are markers to see, but not while it plays: this takes longer than a frame lasts.
        if rays or not (stored.names or context.screen.is_animation_playing):
            draw_rays(canvas, stored, index, rays)
    draw_markers(canvas, stored, index, settings, collection)


def shown(scene: bpy.types.Scene) -> Stored | None:
    """The take to draw: the active one, or the blobs or points that wait to be labelled."""
    settings = scene.mocap_autolabel
    if is_take(settings.take):
        return opened.take(settings.take, scene)
    if settings.source.preview is not None and (holds_points(settings.source.preview) or cameras_at_hand(scene)):
        return opened.preview(settings.source.preview, settings.source.cameras, scene)
    return None


class Canvas:
    """The region that is drawn on: points of the world become its pixels; onto what is covered no words go.

    It is entered to be drawn on, and what was asked for is drawn when it is left: each call of the GPU costs more than
    what it draws.
    """

    covered, foot = marks.NOTHING_COVERED, float(LEGEND_BOTTOM)

    def __init__(self, context: bpy.types.Context):
        region = context.region
        self.region, self.size = region.as_pointer(), (region.width, region.height)
        self.perspective = np.array(context.space_data.region_3d.perspective_matrix, dtype=float)
        self.scale = context.preferences.system.ui_scale
        self.covered = covered(context.area, region)
        # Blender's panel of the last operator comes up where the legend is.
        panels = covered(context.area, region, ("HUD",))
        self.foot = LEGEND_BOTTOM * self.scale + float(panels[:, 3].max(initial=0))

    def __enter__(self) -> Self:
        self._waiting: list[tuple[float | None, list[tuple[np.ndarray, ...]]]] = []
        self._words: list[Word] = []
        gpu.state.blend_set("ALPHA")
        return self

    def __exit__(self, *_):
        self.done()
        gpu.state.blend_set("NONE")

    def place(self, points: np.ndarray) -> np.ndarray:
        """(..., 2) px of points (..., 3) m; NaN behind the viewer."""
        return to_region(points, self.perspective, self.size)

    def lines(self, ends: np.ndarray, colours: np.ndarray, width: float):
        """Lines between ends (L, 2, 2) px in colours (L, 2, 4) that run into each other; drawn by `done`."""
        there = np.isfinite(ends).all(axis=(1, 2))
        if there.any():
            self._add(width, ends[there].reshape(-1, 2), colours[there].reshape(-1, 4))

    def discs(self, centres: np.ndarray, colours: np.ndarray, radius: float, rim: float = 0.0):
        """Filled circles around centres (N, 2) px in colours (N, 4), with a black rim so wide; drawn by `done`."""
        there = np.isfinite(centres).all(axis=1)
        if there.any():
            radii = np.broadcast_to(np.array([radius, rim]) * self.scale, (int(there.sum()), 2))
            self._add(None, centres[there], colours[there], radii)

    def rings(self, centres: np.ndarray, colour: tuple[float, ...], radius: float):
        """Open circles around centres (N, 2) px."""
        turn = np.arange(CORNERS) * 2 * np.pi / CORNERS
        rim = np.column_stack([np.cos(turn), np.sin(turn)]) * radius * self.scale
        arcs = centres[:, None, None] + np.stack([rim, np.roll(rim, -1, axis=0)], axis=1)[None]
        arcs = arcs.reshape(-1, 2, 2)
        self.lines(arcs, np.broadcast_to(np.array(colour), (*arcs.shape[:2], 4)), 1.2)

    def _add(self, width: float | None, *columns: np.ndarray):
        """Puts lines of a width, or discs, behind what waits to be drawn: what is alike goes to the GPU together."""
        if not self._waiting or self._waiting[-1][0] != width:
            self._waiting.append((width, []))
        self._waiting[-1][1].append(columns)

    def done(self):
        for width, parts in self._waiting:
            columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
            if width is None:
                discs.draw(*columns)
                continue
            shader, (places, colours) = gpu.shader.from_builtin("POLYLINE_SMOOTH_COLOR"), columns
            shader.bind()
            shader.uniform_float("viewportSize", self.size)
            shader.uniform_float("lineWidth", width * self.scale)
            flat = np.column_stack([places, np.zeros(len(places))]).astype(np.float32)
            content = {"pos": flat, "color": np.ascontiguousarray(colours, np.float32)}
            batch_for_shader(shader, "LINES", content).draw(shader)
        self._waiting.clear()
        letters.draw(self._words, TEXT_SIZE * self.scale, shadow=True)
        self._words.clear()

    def names(self, words: list[str], places: np.ndarray):
        """Words beside places (N, 2) px, as many as there is room for."""
        height = TEXT_SIZE * self.scale
        widths = np.array([letters.width(word, height) for word in words])
        gap, mark = (RING_RADIUS + 2) * self.scale, BLOB_RADIUS * self.scale
        starts = marks.room_for_words(places, widths, height, gap, mark, self.covered)
        there = np.flatnonzero(np.isfinite(starts[:, 0]))
        self.texts(zip((words[at] for at in there.tolist()), starts[there].tolist(), strict=True))

    def text(self, words: str, x: float, y: float, colour: tuple[float, ...] = WHITE):
        """Words that no name goes onto."""
        height = TEXT_SIZE * self.scale
        box = [x, y - height / 3, x + letters.width(words, height), y + height]
        self.covered = np.vstack([self.covered, box])
        self.texts([(words, (x, y))], colour)

    def texts(self, words: Iterable[tuple[str, tuple[float, float]]], colour: tuple[float, ...] = WHITE):
        """Words, each where it begins, px, with a shadow to be read on anything; drawn by `done`, over all else."""
        self._words += [(word, x, y, colour) for word, (x, y) in words]


def covered(area: bpy.types.Area, region: bpy.types.Region, by: Sequence[str] = COVERING) -> np.ndarray:
    """(K, 4) the boxes of a region, px, that the toolbar, the sidebar, headers and the like lie over."""
    over = [one for one in area.regions if one.type in by and one.width > 1 and one.height > 1]
    boxes = [[one.x, one.y, one.x + one.width, one.y + one.height] for one in over]
    return np.array(boxes, dtype=float).reshape(-1, 4) - np.tile([region.x, region.y], 2)


def draw_camera(canvas: Canvas, stored: Stored, index: int, camera: bpy.types.Object, settings):
    """The view through one camera, as in the paper's figures 1, 4, 5 and 6."""
    number = stored.cameras.names.index(camera_name(camera))
    seen = blob_dots(stored, index, number, room_pose(camera))
    step, named = stored.labels.step[seen.trajectory], np.flatnonzero(seen.marker != NO_MARKER)
    canvas.rings(canvas.place(stored.motion.expected[index]), RING_COLOUR, RING_RADIUS)
    if settings.display.show_links:
        ends, colours = marks.links(stored, index, seen)
        canvas.lines(canvas.place(ends), colours, LINK_WIDTH)
    places = canvas.place(seen.xyz)
    canvas.discs(places, STEP_COLOURS[step, 0], BLOB_RADIUS, 1.2)
    if stored.names:
        legend = (*LEGEND, BY_HAND) if (step == BY_EDIT).any() else LEGEND
        title = f"{camera_name(camera)}: {len(named)} of {len(places)} blobs named"
        draw_colours(canvas, title, [(words, STEP_COLOURS[one]) for words, one in legend])
    else:
        canvas.text(f"{camera_name(camera)}: {count_of(len(places), 'blob')}", LEGEND_LEFT * canvas.scale, canvas.foot)
    if settings.display.show_names:
        canvas.names([stored.names[marker] for marker in seen.marker[named]], places[named])


def draw_rays(canvas: Canvas, stored: Stored, index: int, rays: bool = True):
    """The rays of all blobs and the points in which they meet, or these alone, whether they have names or not."""
    before, (known, meeting) = opened.looked_at.get("meeting", (None, (-1, None)))
    if before is not stored or known != index:
        meeting = FrameRays.of(stored, index)
        opened.looked_at["meeting"] = stored, (index, meeting)
    for ends, colour in ((meeting.ends, RAY), (meeting.loose, LOOSE_RAY)) if rays else ():
        canvas.lines(canvas.place(ends), np.broadcast_to(np.array(colour), (len(ends), 2, 4)), 1.0)
    canvas.discs(canvas.place(meeting.points), np.tile(np.array(WHITE), (len(meeting.points), 1)), BLOB_RADIUS - 1, 1.0)
    words = f"{count_of(len(meeting.points), 'point')}, {count_of(len(meeting.loose), 'blob')} in none of them"
    canvas.text(words, LEGEND_LEFT * canvas.scale, canvas.foot)
    canvas.foot += LINE * canvas.scale


def draw_markers(canvas: Canvas, stored: Stored, index: int, settings, collection: bpy.types.Collection | None = None):
    """The markers that were found and their names, and the points that have none; doubtful ones stand out.

    Those of several performers, which the take in `collection` has, are in the colours of these.
    """
    seen = marks.point_marks(stored, index)
    places, others = canvas.place(seen.named), canvas.place(seen.unnamed)
    asked = list(seen.asked)
    fills = np.full((len(others), 4), GREY)
    own = marker_colours(collection, stored.performers, len(stored.names))
    named_as = ORANGE if own is None else np.column_stack([own, np.ones(len(own))])
    found_as = np.where(seen.filled[:, None], BLUE, np.where(seen.doubtful[:, None], RED, named_as))
    fills[asked] = RED
    canvas.discs(others, fills, BLOB_RADIUS - 1.5, 1.0)
    canvas.discs(places, found_as, BLOB_RADIUS - 1, 1.0)
    if stored.names or isinstance(stored.rows, PointRows):
        _draw_counts(canvas, stored, seen, collection)
    if settings.display.show_names:
        words = [*stored.names, *seen.asked.values()]
        canvas.names(words, np.concatenate([places, others[asked]]))


def _draw_counts(canvas: Canvas, stored: Stored, seen: marks.PointMarks, collection: bpy.types.Collection | None):
    """How many points have names, or of blobs how many markers are there, and what their colours mean."""
    if not stored.names:
        canvas.text(count_of(len(seen.unnamed), "point"), LEGEND_LEFT * canvas.scale, canvas.foot)
        canvas.foot += LINE * canvas.scale
        return
    found = int((np.isfinite(seen.named).all(axis=1) & ~seen.filled).sum())
    people = {} if collection is None else colours_in(collection)
    names = [(name, (*colour, 1.0)) for name, colour in people.items()] or [("named", ORANGE)]
    points = isinstance(stored.rows, PointRows)
    rows = (*names, ("doubtful", RED)) + (("unnamed", GREY),) * points + (("filled", BLUE),) * bool(stored.fills)
    of_all = f"{found + len(seen.unnamed)} points named" if points else f"{count_of(len(seen.named), 'marker')} found"
    draw_colours(canvas, f"{found} of {of_all}", rows)


def draw_colours(canvas: Canvas, title: str, rows):
    """A title and below it colours, each one or from one to another, with the words for them.

    Not where that would be more than the lower half of a view: Blender's own words are in the upper one.
    """
    left, bottom, line = LEGEND_LEFT * canvas.scale, canvas.foot, LINE * canvas.scale
    if bottom + line * (len(rows) + 1) > canvas.size[1] / 2:
        return
    lower = bottom + line * np.arange(len(rows))[::-1]
    y = lower + line * 0.25
    ends = np.stack([np.column_stack([0 * y + left, y]), np.column_stack([0 * y + left + 22 * canvas.scale, y])], 1)
    colours = np.array([np.broadcast_to(colour, (2, 4)) for _, colour in rows])
    canvas.lines(ends, colours, LINK_WIDTH * 1.5)
    canvas.text(title, left, bottom + line * len(rows))
    canvas.foot += line * (len(rows) + 2)  # a line is left free
    for (words, _), y in zip(rows, lower.tolist(), strict=True):
        canvas.text(words, left + 30 * canvas.scale, y)
