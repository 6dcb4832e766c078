# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person waits for who corrects a long take in Blender: 20,000 frames of 62 markers, in pieces, among ghosts.

What Blender itself does for a window (drawing, a step of undo) is not in these: the background has neither.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import cycle
from pathlib import Path

import numpy as np

from addon.blendfile import start_blender
from addon.core.body.bodies import BodyModel
from addon.core.data.markersets import MarkerSet
from addon.core.data.takes import BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels, Motion, PointRows, Suspect
from addon.core.geometry import rotations
from addon.core.geometry.cameras import NO_CAMERAS
from addon.io.markersets import open_markerset

from .cases import Row, milliseconds

FRAMES, MARKERS, RATE = 20_000, 62, 120.0
GAPS, GHOSTS, SUSPECTS, EDITS = 600, 2, 150, 100
PERSPECTIVE = np.array([[1.2, 0, 0, 0], [0, 0, 2.0, -1.8], [0, 1, 0, 0], [0, 1, 0, 4]])
SIZE = (1600, 1000)


def many_markers() -> MarkerSet:
    """The markers of `actor53`, and some of them once more a little farther out."""
    known = open_markerset("actor53")
    more = MARKERS - len(known)
    of = np.concatenate([np.arange(len(known)), np.arange(more)])
    offsets = known.offsets[of].copy()
    offsets[len(known) :] *= 1.1
    modes = np.zeros((0, len(known.skeleton) + MARKERS, 3))
    return replace(
        known,
        markers=(*known.markers, *(f"X{number}" for number in range(more))),
        aliases={},
        attachment=known.attachment[of],
        offsets=offsets,
        spread=replace(known.spread, modes=modes, marker_sd=np.full(MARKERS, 0.01)),
    )


def long_motion(markerset: MarkerSet, rng: np.random.Generator) -> Motion:
    """Somebody who goes in circles and bends, with gaps of every marker."""
    model, time = BodyModel(markerset), np.arange(FRAMES) / RATE
    bends = 0.3 * np.sin(time[:, None, None] * 3 + np.arange(len(markerset.skeleton))[None, :, None] + np.arange(3))
    bends[:, 0] = 0
    bodies = replace(
        model.rest(FRAMES, 1.75),
        translation=np.column_stack([np.cos(0.3 * time), np.sin(0.3 * time), 0 * time]),
        quaternion=rotations.about_z(0.5 * time),
        bends=bends,
    )
    posed = model.pose(bodies)
    markers = posed.markers.copy()
    for marker, first, length in zip(
        rng.integers(MARKERS, size=GAPS), rng.integers(FRAMES, size=GAPS), rng.integers(5, 200, GAPS), strict=True
    ):
        markers[first : first + length, marker] = np.nan
    seen = np.isfinite(markers[..., 0])
    return Motion(
        np.arange(1, FRAMES + 1),
        markers,
        residual=np.where(seen, 0.0005, np.nan),
        residual_px=np.full(seen.shape, np.nan),
        conflicts=np.zeros(seen.shape, dtype=int),
        expected=posed.markers,
        joints=posed.joints,
        rotations=posed.rotations,
        scale=bodies.scale,
        confidence=np.ones(FRAMES),
    )


def long_take():
    """A labelled take of points: each marker another trajectory behind each of its gaps."""
    from addon.scene.take import Take

    rng = np.random.default_rng(0)
    markerset = many_markers()
    motion = long_motion(markerset, rng)
    seen = np.isfinite(motion.markers[..., 0])
    begins = seen & ~np.vstack([np.zeros((1, MARKERS), dtype=bool), seen[:-1]])
    number = np.cumsum(begins.T.ravel()).reshape(MARKERS, FRAMES).T - 1
    frame, marker = np.nonzero(seen)
    ghosts = np.repeat(np.arange(FRAMES), GHOSTS)
    frame = np.concatenate([frame, ghosts])
    trajectory = np.concatenate([number[seen], number.max() + 1 + np.tile(np.arange(GHOSTS), FRAMES)])
    xyz = np.concatenate([motion.markers[seen], rng.random((len(ghosts), 3))])
    marker = np.concatenate([marker, np.full(len(ghosts), NO_MARKER)])
    order = np.lexsort((trajectory, frame))
    marker, named = marker[order], marker[order] != NO_MARKER
    rows = PointRows(motion.frames, frame[order], trajectory[order], xyz[order], np.full(len(order), 0.0005))
    labels = Labels(marker, np.where(named, BY_TRAJECTORY, NO_STEP), named * 1.0)
    suspects = tuple(
        Suspect(100 * index + 1, 100 * index + 50, f"{name} jumps", None, (name,))
        for index, name in zip(range(SUSPECTS), cycle(markerset.markers), strict=False)
    )
    return Take("long", RATE, NO_CAMERAS, markerset, rows, labels, motion, suspects, "long.c3d")


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
        scene.mocap_autolabel.take = show_take(bpy.context, long_take(), unnamed=True)
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
    session, some = Session(), max(repeats // 3, 3)
    size = f"{FRAMES} frames × {MARKERS} markers"
    row = partial(Row, show=milliseconds)
    yield row(f"a pick, {size}", session.pick, ("16 ms", "", ""), repeats)
    yield row("the likeliest names of a dot", session.likely_names, ("", "", ""), repeats)
    yield row("what the overlay draws of a frame, worked out", session.frame_to_draw, ("6 ms", "", ""), repeats)
    for scope in ("FRAME", "WHOLE"):
        title = f"two markers swapped, {'in one frame' if scope == 'FRAME' else 'in the whole take'}"
        yield row(title, partial(session.swap, scope), ("100 ms", "", ""), some)
    yield row("a piece named", session.name, ("100 ms", "", ""), some)
    session.correct_much()
    yield row(f"a piece named, behind {EDITS} other corrections", session.name, ("100 ms", "", ""), some)
    yield row("opening the file", session.open, ("10 s", "", ""), 2)
