# SPDX-License-Identifier: GPL-3.0-or-later
"""The labelled take as files for other programs: the same that the command line writes."""

from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ..core.data.columns import Columns
from ..core.data.errors import InputError, JobError
from ..core.data.takes import LabelledChunk, PointRows, Points
from ..core.review.overview import OverviewSubject
from ..io.blobs import read_blobs
from ..io.filled import kept_rows, write_filled
from ..io.labels import LabelWriter, write_point_labels
from ..io.points import write_c3d, write_trc
from ..io.whole import whole_files
from ..jobs.pages import KeptTake, write_kept_page
from ..scene.performers import homes
from ..scene.stored import Stored, alone
from ..scene.take import is_take
from .base import ToldWhere, WithTake, keeps_items, taken
from .reposing import follow_now, words_behind

# No performer is called so.
TOGETHER = (":TOGETHER", "Together", "All performers in one file, markers called NAME:MARKER")
APART = (":APART", "A File Each", "A file for each performer, called after them")


class ExportsTake(ToldWhere, WithTake):
    """What the exports share: they need a labelled take, and name the file after it.

    They differ in `write`, which writes a take to a path and to those of the files `beside` it; UserError if it cannot.
    What is `of_body` waits for that to follow the labels.
    """

    of_body = False

    def proposed(self, context) -> Path:
        """Beside the take, and called as it is."""
        stored = taken(context)
        folder = Path(bpy.path.abspath(stored.source)).parent if stored.source else Path()
        return folder / (stored.name + self.filename_ext)

    def draw(self, context):
        """Says where what is written is out of date, which it is not any more once it is written."""
        if self.of_body and (words := words_behind(context)):
            self.layout.label(text=words, icon="ERROR")

    def beside(self, path: Path) -> list[Path]:
        """The files that may appear beside `path`."""
        return []

    def work(self, context):
        if self.of_body:
            follow_now(context)
        stored = taken(context)
        parts, read = self.parts(stored), read_by(context, stored)
        paths = [self.path_of(name) for name, _ in parts]
        for path, (name, part) in zip(paths, parts, strict=True):
            # Blender's own file browser has asked already whether to overwrite, of the file that it was told.
            asked = path == Path(self.filepath)
            self.performer_name, self.path = name, path
            with whole_files([path, *self.beside(path)], overwrite=asked, read=read) as temporaries:
                self.write(temporaries, part)
        self.report({"INFO"}, f"Saved {', '.join(map(str, paths))}")

    def parts(self, stored: Stored) -> list[tuple[str, Stored]]:
        """What goes into a file of its own: a performer's name, empty for all of them, and the take of theirs."""
        return [("", stored)]

    def path_of(self, name: str) -> Path:
        """The file of a performer where each gets one, called after them."""
        return Path(self.filepath)


def read_by(context: bpy.types.Context, stored: Stored) -> list[Path]:
    """The files that the take and the scene come from, which no export may replace."""
    settings = context.scene.mocap_autolabel
    named = [
        stored.source,
        settings.source.blobs_path,
        settings.source.points_path,
        settings.subjects.markerset_path,
        bpy.data.filepath,
    ]
    return [Path(bpy.path.abspath(name)) for name in named if name]


class MOCAP_AUTOLABEL_OT_export_labels(ExportsTake, bpy.types.Operator):
    """Write the name of every blob or point, row for row with the file they are from."""

    bl_label = "Export Labels"
    filename_ext = ".labels.csv"
    filter_glob: StringProperty(default="*.labels.csv", options={"HIDDEN"})

    def write(self, paths: list[Path], stored: Stored):
        """Writes the labels; beside those of blobs is each row's own text, which only the file of the blobs has."""
        [path] = paths
        if isinstance(stored.rows, PointRows):
            write_point_labels(path, stored.rows, stored.labels, stored.names)
        else:
            write_labels(path, stored)


def performer_property(together: bool):
    """The property that says whose motion is written: of all in one file, where that can be, of each, or of one."""
    ways = [TOGETHER, APART] if together else [APART]

    @keeps_items
    def items(_self, context) -> list[tuple[str, str, str]]:
        take = None if context.scene is None else context.scene.mocap_autolabel.take
        names = list(homes(take)) if is_take(take) else []
        return [*ways, *((name, name, f"{name} alone, under the names of the set") for name in names)]

    return EnumProperty(name="Performers", description="Whose motion is written", items=items)


class ExportsPerformers(ExportsTake):
    """Exports of which each performer can have a file of their own."""

    performer: performer_property(together=True)

    def draw(self, context):
        """Asks whose motion is written where the take is of several."""
        super().draw(context)
        if homes(context.scene.mocap_autolabel.take):
            self.layout.prop(self, "performer")

    def parts(self, stored: Stored) -> list[tuple[str, Stored]]:
        """All in one file, each in a file of their own, or one alone."""
        if self.performer == TOGETHER[0] or not stored.performers[0].name:
            return [("", stored)]
        chosen = [one for one in stored.performers if self.performer in (one.name, APART[0])]
        return [(one.name, alone(stored, one)) for one in chosen]

    def path_of(self, name: str) -> Path:
        """`walk ann.c3d` beside `walk.c3d`."""
        path = Path(self.filepath)
        if not name or self.performer != APART[0]:
            return path
        called = "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in name)
        return path.with_name(f"{path.name.removesuffix(self.filename_ext)} {called}{self.filename_ext}")


class ExportsPoints(ExportsPerformers):
    """The exports of the points of the take; they differ in `write_points`, which writes those to a path."""

    def beside(self, path: Path) -> list[Path]:
        """The list of what is filled."""
        return [path.with_suffix(".filled.csv")]

    def write(self, paths: list[Path], stored: Stored):
        """Writes the points of the take, and where something is filled, what, by which method and how far off."""
        self.write_points(paths[0], points_of(stored))
        # An older list beside the file would speak of fills that are none any more.
        if stored.fitting or self.beside(self.path)[0].exists():
            write_filled(paths[1], kept_rows(stored.fitting))


class MOCAP_AUTOLABEL_OT_export_c3d(ExportsPoints, bpy.types.Operator):
    """Write the named markers in space as C3D: gaps empty, and what was filled with the residual 0."""

    bl_label = "Export C3D"
    filename_ext, write_points = ".c3d", staticmethod(write_c3d)
    filter_glob: StringProperty(default="*.c3d", options={"HIDDEN"})


class MOCAP_AUTOLABEL_OT_export_trc(ExportsPoints, bpy.types.Operator):
    """Write the named markers in space as TRC, for OpenSim."""

    bl_label = "Export TRC"
    filename_ext, write_points = ".trc", staticmethod(write_trc)
    filter_glob: StringProperty(default="*.trc", options={"HIDDEN"})


def points_of(stored: Stored) -> Points:
    """The take as points: a trajectory a marker, then those that stay unnamed where it came as points."""
    motion = stored.motion
    xyz, residual, names = motion.markers, motion.residual, stored.names
    if isinstance(stored.rows, PointRows):
        width, xyz, residual = unnamed_trajectories(stored)
        names = (*names, *[""] * (width - len(names)))
    return Points(names, xyz, residual, stored.rate, int(motion.frames[0]))


def unnamed_trajectories(stored: Stored) -> tuple[int, Columns, Columns]:
    """How many columns the markers and the trajectories without a name make, their places, m, and residuals, m.

    A trajectory of the file is a column, with the points in which it has no name; residuals are NaN where the take was
    labelled before they were kept.
    """
    rows, kept, markers = stored.rows, np.flatnonzero(~stored.labels.named), len(stored.names)
    kept = kept[np.argsort(rows.frame[kept], kind="stable")]
    numbers, column = np.unique(rows.trajectory[kept], return_inverse=True)
    frame, width = rows.frame[kept], markers + len(numbers)

    def of(own: np.ndarray, values: np.ndarray | None) -> Columns:
        def beside(part: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            some = slice(*np.searchsorted(frame, [part.start, part.stop]).tolist())
            found = np.full(some.stop - some.start, np.nan) if values is None else values[kept[some]]
            return frame[some] - part.start, markers + column[some], found

        return Columns(own, np.arange(markers), width, beside)

    return width, of(stored.motion.markers, rows.xyz), of(stored.motion.residual, rows.residual)


def write_labels(path: Path, stored: Stored):
    """Writes the labels of a take of blobs; JobError when the file of its blobs has changed since."""
    if not stored.source:
        raise InputError(f"take {stored.name} names no file of blobs; expected the file that it was labelled from")
    source, frames = found_again(Path(bpy.path.abspath(stored.source))), stored.motion.frames
    first = 0
    with LabelWriter(path, stored.names) as writer:
        for part in read_blobs(source, stored.cameras, (int(frames[0]), int(frames[-1]))):
            last = first + len(part.keys)
            rows = slice(first, last)
            if last > len(stored.rows) or not np.allclose(part.blobs.xy, stored.rows.xy[rows], rtol=1e-5, atol=1e-2):
                break
            writer.write(part.keys, stored.labels[rows])
            first = last
    if first != len(stored.rows):
        raise JobError("holds other blobs than those that were labelled; expected the file as it was", str(source))


def found_again(source: Path) -> Path:
    """Where a take's file is: where it was or, as after a move of the whole folder, beside the Blender file."""
    beside = Path(bpy.data.filepath).with_name(source.name) if bpy.data.filepath else source
    return beside if beside.is_file() and not source.exists() else source


class MOCAP_AUTOLABEL_OT_export_report(ExportsTake, bpy.types.Operator):
    """Save a page that shows how the take was labelled: one file that opens in any browser, to be passed on."""

    bl_label = "Save Report"
    filename_ext, of_body = ".report.html", True
    filter_glob: StringProperty(default="*.report.html", options={"HIDDEN"})
    open_after: BoolProperty(name="Open It", description="Show the page in the browser once it is saved", default=True)

    def execute(self, context):
        """Saves the page, and opens it where that is wanted and there is a window."""
        done = super().execute(context)
        if done == {"FINISHED"} and self.open_after and not bpy.app.background:
            bpy.ops.wm.path_open(filepath=self.filepath)
        return done

    def write(self, paths: list[Path], stored: Stored):
        """Writes the page."""
        [path] = paths
        write_kept_page(path, kept_take(stored))


def kept_take(stored: Stored) -> KeptTake:
    """A take as its page takes it."""
    return KeptTake(
        stored.name,
        bpy.path.abspath(stored.source) if stored.source else "",
        stored.model,
        stored.rate,
        OverviewSubject(stored.names, stored.words, stored.parents),
        stored.cameras,
        stored.rows,
        LabelledChunk(stored.labels, stored.unfilled, stored.suspects, outcomes=stored.outcomes),
        stored.edits,
        stored.fitting,
    )
