# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person waits for who corrects a long take in Blender: 20,000 frames of 62 markers, in pieces, among ghosts.

What Blender itself does for a window (drawing, a step of undo) is not in these: the background has neither.
"""

import tempfile
from collections.abc import Iterator
from functools import partial
from itertools import cycle
from pathlib import Path

import numpy as np

from addon.blendfile import start_blender
from addon.io.markersets import write_markerset

from .cases import Row, milliseconds
from .long_take import FRAMES, MARKERS, long_take, many_markers

EDITS = 100
PERSPECTIVE = np.array([[1.2, 0, 0, 0], [0, 0, 2.0, -1.8], [0, 1, 0, 0], [0, 1, 0, 4]])
SIZE = (1600, 1000)


class Session:
    """Blender with the long take in its scene, through the extension as a person has it."""

    def __init__(self):
        start_blender()
        import addon_utils
        import bpy

        from addon.scene.take import show_take

        bpy.ops.wm.read_homefile(use_empty=True)
        folder = Path(tempfile.mkdtemp(prefix="mocap-benchmark-"))
        (folder / "mocap_autolabel").symlink_to(Path(__file__).resolve().parents[2], target_is_directory=True)
        repositories = bpy.context.preferences.extensions.repos
        repositories.new(name="benchmark", module="mocap_tests", custom_directory=str(folder), source="USER")
        addon_utils.enable("bl_ext.mocap_tests.mocap_autolabel", default_set=True)
        from bl_ext.mocap_tests.mocap_autolabel.addon.ops import correcting, picking
        from bl_ext.mocap_tests.mocap_autolabel.addon.scene import likely, opened
        from bl_ext.mocap_tests.mocap_autolabel.addon.scene import picking as dots
        from bl_ext.mocap_tests.mocap_autolabel.addon.ui import marks

        self.bpy, self.correcting, self.picking = bpy, correcting, picking
        self.likely, self.opened, self.dots, self.marks = likely, opened.opened, dots, marks
        scene = bpy.context.scene
        scene.mocap_autolabel.take = show_take(bpy.context, long_take())
        scene.frame_set(FRAMES // 2)
        self.numbers = cycle(range(len(self.stored.names) - 1))
        self.file = folder / "long.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(self.file))

    @property
    def stored(self):
        """The take as it is now."""
        scene = self.bpy.context.scene
        return self.opened.take(scene.mocap_autolabel.take, scene)

    def pick(self):
        """From a place in the view to the dot that is picked and selected."""
        dots = self.picking.dots_here(self.stored, self.bpy.context.scene)
        places = self.dots.to_region(dots.xyz, PERSPECTIVE, SIZE)
        found = self.dots.nearest(places, tuple(places[7]), 20.0)
        self.picking.show_picked(self.bpy.context, self.stored, [int(dots.trajectory[found])])

    def likely_names(self):
        """The likeliest names of the first dot of a frame that was not asked of before."""
        index = next(self.numbers)
        dots = self.dots.dots_of(self.stored, index)
        rows = self.opened.rows_of(self.stored, int(dots.trajectory[0]))
        self.likely.likely_markers(self.stored, index, rows, dots.xyz[0])

    def swap(self, scope: str):
        """Two markers exchanged, others at every call."""
        one = next(self.numbers)
        items = {item.get("mocap_marker"): item for item in self.bpy.context.scene.mocap_autolabel.take.all_objects}
        for item in self.bpy.context.selected_objects:
            item.select_set(False)
        for name in self.stored.names[one : one + 2]:
            items[name].select_set(True)
        self.bpy.ops.mocap_autolabel.swap_markers(scope=scope)

    def name(self):
        """A piece gets the name that it has, as in a quick labelling."""
        dots = self.picking.dots_here(self.stored, self.bpy.context.scene)
        at = next(self.numbers)
        self.picking.show_picked(self.bpy.context, self.stored, [int(dots.trajectory[at])])
        self.bpy.ops.mocap_autolabel.name_point(marker=self.stored.names[dots.marker[at]], scope="WHOLE")

    def correct_much(self):
        """Leaves the take with many corrections."""
        for _ in range(EDITS):
            self.name()

    def fill(self):
        """Fills every gap that has two ends, by straight lines."""
        from bl_ext.mocap_tests.mocap_autolabel.addon.core.filling.kept import KeptFill
        from bl_ext.mocap_tests.mocap_autolabel.addon.scene.fills import keep_fills
        from bl_ext.mocap_tests.mocap_autolabel.addon.scene.take import show_edits

        before, fills = self.stored, []
        for marker, name in enumerate(before.names):
            there = np.flatnonzero(np.isfinite(before.motion.markers[:, marker, 0]))
            for first, last in zip(there[:-1][np.diff(there) > 1], there[1:][np.diff(there) > 1], strict=True):
                path = np.linspace(*before.motion.markers[[first, last], marker], last - first + 1)
                frames = before.motion.frames[[first + 1, last - 1]].tolist()
                fills.append(KeptFill(name, *frames, "spline", 0.001, path))
        collection = self.bpy.context.scene.mocap_autolabel.take
        keep_fills(collection, fills)
        show_edits(collection, before, self.stored, True)

    def choose_set(self):
        """Lets the body follow from then on: the marker set is that of the take."""
        path = self.file.with_name("long.markerset.json")
        write_markerset(path, many_markers())
        self.bpy.ops.mocap_autolabel.open_markerset(filepath=str(path))

    def frame_to_draw(self):
        """What the overlay works out for a frame before it draws."""
        stored, index = self.stored, FRAMES // 2
        seen = self.marks.point_marks(stored, index)
        places = self.dots.to_region(np.concatenate([seen.named, seen.unnamed]), PERSPECTIVE, SIZE)
        widths = np.full(len(stored.names), 30.0)
        self.marks.room_for_words(places[: len(stored.names)], widths, 11.0, 8.0, 4.0)

    def open(self):
        """Opens the file, to the take at hand."""
        self.bpy.ops.wm.open_mainfile(filepath=str(self.file))
        len(self.stored.labels.marker)


def editing(repeats: int) -> Iterator[Row]:
    """What a correction costs, after few others and after many."""
    session, some, floor = Session(), max(repeats // 3, 3), ("100 ms", "", "")
    size = f"{FRAMES} frames × {MARKERS} markers"
    row = partial(Row, show=milliseconds)
    yield row(f"a pick, {size}", session.pick, ("16 ms", "", ""), repeats)
    yield row("the likeliest names of a dot", session.likely_names, ("", "", ""), repeats)
    yield row("what the overlay draws of a frame, worked out", session.frame_to_draw, ("6 ms", "", ""), repeats)
    for scope in ("FRAME", "WHOLE"):
        title = f"two markers swapped, {'in one frame' if scope == 'FRAME' else 'in the whole take'}"
        yield row(title, partial(session.swap, scope), floor, some)
    yield row("a piece named", session.name, floor, some)
    session.correct_much()
    yield row(f"a piece named, behind {EDITS} other corrections", session.name, floor, some)
    session.fill()
    yield row("two markers swapped, in the whole take, its gaps filled", partial(session.swap, "WHOLE"), floor, some)
    yield row("a piece named, the gaps filled", session.name, floor, some)
    yield row("opening the file", session.open, ("10 s", "", ""), 2)
    session.choose_set()
    title = "two markers swapped in one frame, and the body of all frames behind them"
    yield row(title, partial(session.swap, "FRAME"), ("", "", ""), 2)
