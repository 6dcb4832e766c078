# SPDX-License-Identifier: GPL-3.0-or-later
"""The labelled take as files for other programs, as the command line writes them; its body as a character as well."""

from functools import partial
from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty

from ..blendfile import save_characters
from ..core.data.columns import Columns
from ..core.data.errors import InputError, JobError
from ..core.data.takes import LabelledChunk, PointRows, Points
from ..core.filling.smoothing import count_smoothed
from ..core.geometry.camera_up import AXIS_NAMES
from ..core.review.overview import OverviewSubject, TakeOverview
from ..io.blobs import read_blobs
from ..io.c3d.reading import TrialFile
from ..io.filled import kept_rows, write_filled
from ..io.labels import LabelWriter, write_point_labels
from ..io.points import read_points, write_c3d, write_trc
from ..io.samples import TextHead
from ..io.whole import whole_files
from ..jobs.pages import write_kept_page
from ..props import keeps_items
from ..scene.character import add_character, moving_in
from ..scene.opened import opened
from ..scene.performers import homes
from ..scene.roots import parent_of
from ..scene.stored import Stored, alone
from ..scene.take import is_take
from .base import OfTake, ToldWhere, WithTake, taken
from .long_work import LongWork
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
        stored = taken(context)
        folder = Path(bpy.path.abspath(stored.source)).parent if stored.source else Path()
        return folder / (stored.name + self.filename_ext)

    def draw(self, context):
        """Says where what is written is out of date, which it is not any more once it is written."""
        if self.of_body and (words := words_behind(context)):
            self.layout.label(text=words, icon="ERROR")

    def beside(self, path: Path) -> list[Path]:
        return []

    def work(self, context):
        files, read = self.files(context)
        for path, overwrite, name, part in files:
            self.performer_name, self.path = name, path
            with whole_files([path, *self.beside(path)], overwrite, read) as temporaries:
                self.write(temporaries, part)
        return self._show(context, [path for path, *_ in files])

    def files(self, context) -> tuple[list[tuple[Path, bool, str, Stored]], list[Path]]:
        """The files to write: whether each may be replaced, whose it is, and the take in it; and what is read."""
        if self.of_body:
            follow_now(context)
        stored, settings = taken(context), context.scene.mocap_autolabel
        # No export may replace what take and scene come from.
        named = stored.source, settings.source.blobs_path, settings.source.points_path, bpy.data.filepath
        read = [Path(bpy.path.abspath(name)) for name in (*named, settings.subjects.markerset_path) if name]
        paths = [(self.path_of(name), name, part) for name, part in self.parts(stored)]
        # Blender's own file browser has asked already whether to overwrite, of the file that it was told.
        return [(path, path == Path(self.filepath), *whose) for path, *whose in paths], read

    def _show(self, _context, paths: list[Path]) -> set[str]:
        self.report({"INFO"}, f"Saved {', '.join(map(str, paths))}")
        return {"FINISHED"}

    def parts(self, stored: Stored) -> list[tuple[str, Stored]]:
        """What goes into a file of its own: a performer's name, empty for all of them, and the take of theirs."""
        return [("", stored)]

    def path_of(self, name: str) -> Path:
        """The file of a performer where each gets one, called after them."""
        return Path(self.filepath)


class MOCAP_AUTOLABEL_OT_export_labels(ExportsTake, bpy.types.Operator):
    """Write the name of every blob or point, row for row with the file they are from."""

    filename_ext = ".labels.csv"

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
        super().draw(context)
        if homes(context.scene.mocap_autolabel.take):
            self.layout.prop(self, "performer")

    def parts(self, stored: Stored) -> list[tuple[str, Stored]]:
        if self.performer == TOGETHER[0] or not stored.performers[0].name:
            return [("", stored)]
        chosen = [one for one in stored.performers if self.performer in (one.name, APART[0])]
        return [(one.name, alone(stored, one)) for one in chosen]

    def path_of(self, name: str) -> Path:
        path = Path(self.filepath)
        if not name or self.performer != APART[0]:
            return path
        called = "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in name)
        return path.with_name(f"{path.name.removesuffix(self.filename_ext)} {called}{self.filename_ext}")


class ExportsPoints(ExportsPerformers):
    """The exports of the points of the take; they differ in `write_points`, which writes those to a path."""

    def beside(self, path: Path) -> list[Path]:
        return [path.with_suffix(".filled.csv")]

    def write(self, paths: list[Path], stored: Stored):
        self.write_points(paths[0], points_of(stored))
        # An older list beside the file would speak of fills that are none any more.
        if stored.fitting or self.beside(self.path)[0].exists():
            write_filled(paths[1], kept_rows(stored.fitting))


class MOCAP_AUTOLABEL_OT_export_c3d(ExportsPoints, bpy.types.Operator):
    """Write the named markers in space as C3D: gaps empty, filled samples with residual 0, all else as it came."""

    filename_ext = ".c3d"

    def write_points(self, path: Path, points: Points):
        """Writes them with all else of the C3D file that the take came from, or says that it is not as it was."""
        stored = taken(bpy.context)
        trial, source = trial_of(stored), source_of(stored)
        if trial is None and source is not None and source.suffix.lower() == ".c3d":
            words = "is gone, or its points are not as they were labelled, so those were saved alone"
            self.report({"WARNING"}, f"{source}: {words}")
        together = [one.name for one in stored.performers if one.name and not self.performer_name]
        write_c3d(path, points, trial, together)


def source_of(stored: Stored) -> Path | None:
    """The file that a take came from, where it was or beside the Blender file; None where none is known."""
    if not stored.source:
        return None
    source = Path(bpy.path.abspath(stored.source))
    if bpy.data.filepath and not source.exists():  # as after a move of the whole folder
        beside = Path(bpy.data.filepath).with_name(source.name)
        source = beside if beside.is_file() else source
    return source


def trial_of(stored: Stored) -> TrialFile | TextHead | None:
    """What else the file of a take holds; None where that is nothing, or its points are not as they were labelled."""
    source, frames = source_of(stored), stored.motion.frames
    if source is None or not isinstance(stored.rows, PointRows):
        return None
    for up in (None, *AXIS_NAMES):  # nobody kept what was said of that
        try:
            take = read_points(source, frames=(int(frames[0]), int(frames[-1])), up=up, rate=stored.rate)
        except InputError:
            return None
        rows = PointRows.of(take)
        same = [np.array_equal(getattr(rows, name), getattr(stored.rows, name)) for name in ("frame", "trajectory")]
        if all(same) and np.allclose(rows.xyz, stored.rows.xyz, atol=1e-5):
            return take.trial
    return None


class MOCAP_AUTOLABEL_OT_export_trc(ExportsPoints, bpy.types.Operator):
    """Write the named markers in space as TRC, for OpenSim."""

    bl_label = "Export TRC"
    filename_ext = ".trc"

    def write_points(self, path: Path, points: Points):
        """Writes them with the head of the TRC or Motive `.csv` that the take came from."""
        write_trc(path, points, trial_of(taken(bpy.context)))


def points_of(stored: Stored) -> Points:
    """The take as points: a trajectory a marker, then those that stay unnamed where it came as points."""
    motion, first = stored.motion, int(stored.motion.frames[0])
    if not isinstance(stored.rows, PointRows):
        return Points(stored.names, motion.markers, motion.residual, stored.rate, first)
    # A trajectory of the file is a column, with the points in which it has no name; residuals are NaN where the take
    # was labelled before they were kept.
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

    names = (*stored.names, *[""] * len(numbers))
    return Points(names, of(motion.markers, rows.xyz), of(motion.residual, rows.residual), stored.rate, first)


def write_labels(path: Path, stored: Stored):
    """Writes the labels of a take of blobs; JobError when the file of its blobs has changed since."""
    source, frames, first = source_of(stored), stored.motion.frames, 0
    if source is None:
        raise InputError(f"take {stored.name} names no file of blobs; expected the file that it was labelled from")
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


class MOCAP_AUTOLABEL_OT_export_report(ExportsTake, bpy.types.Operator):
    """Save a page that shows how the take was labelled: one file that opens in any browser, to be passed on."""

    bl_label = "Save Report"
    filename_ext, of_body = ".report.html", True
    open_after: BoolProperty(name="Open It", description="Show the page in the browser once it is saved", default=True)

    def execute(self, context):
        done = super().execute(context)
        if done == {"FINISHED"} and self.open_after and not bpy.app.background:
            bpy.ops.wm.path_open(filepath=self.filepath)
        return done

    def write(self, paths: list[Path], stored: Stored):
        source = bpy.path.abspath(stored.source) if stored.source else ""
        subject = OverviewSubject(stored.names, stored.words, stored.parents)
        overview = TakeOverview(subject, stored.rate, stored.cameras, stored.edits)
        labelled = LabelledChunk(stored.labels, stored.unfilled, stored.suspects, outcomes=stored.outcomes)
        of_take = stored.name, source, stored.model
        smoothed = None if stored.cutoff is None else count_smoothed(stored.motion.markers)
        write_kept_page(paths[0], *of_take, overview, stored.rows, labelled, stored.fitting, smoothed)


# BVH has no unit: of each that is offered, how many are a metre.
BVH_UNITS = {"CENTIMETRES": 100.0, "METRES": 1.0}


class MOCAP_AUTOLABEL_OT_add_character(OfTake, bpy.types.Operator):
    """Add an armature that moves as the take's body does, with the chosen bone names and a T-pose as its rest."""

    def work(self, context):
        settings = context.scene.mocap_autolabel
        follow_now(context)
        stored, added = opened.take(settings.take, context.scene), []
        for one in stored.performers:
            home = homes(settings.take).get(one.name, settings.take)
            body = moving_in(home, alone(stored, one))
            character = add_character(context, home, body, settings.bone_names)
            character.parent = parent_of(settings.take)
            added.append(character.name)
        self.report({"INFO"}, f"Added {', '.join(added)}")


class ExportsCharacter(OfTake, LongWork, ExportsPerformers):
    """The exports of performers' characters by Blender's own exporters, which take a minute for a long take."""

    of_body, unit = True, ""
    performer: performer_property(together=False)

    def invoke(self, context, event):
        self._asked_for_it = True
        return ExportsPerformers.invoke(self, context, event)

    def asked(self, context) -> partial:
        settings, (files, read) = context.scene.mocap_autolabel, self.files(context)
        at = homes(settings.take)
        bodies = [
            (path, overwrite, moving_in(at.get(name, settings.take), part)) for path, overwrite, name, part in files
        ]
        scale = BVH_UNITS.get(self.unit, 1.0)
        return partial(save_characters, self.filename_ext[1:], bodies, read, settings.bone_names, scale)


class MOCAP_AUTOLABEL_OT_export_bvh(ExportsCharacter, bpy.types.Operator):
    """Write the take's body as BVH: usual bone names, a T-pose as its rest, y up."""

    bl_label = "Export BVH"
    filename_ext, doing = ".bvh", "Exporting BVH"
    unit: EnumProperty(
        name="Unit",
        items=(
            ("CENTIMETRES", "Centimetres", "What most programs take a BVH file for"),
            ("METRES", "Metres", "What Blender's importer takes it for, without a scale"),
        ),
    )

    def draw(self, context):
        super().draw(context)
        self.layout.prop(self, "unit")


class MOCAP_AUTOLABEL_OT_export_fbx(ExportsCharacter, bpy.types.Operator):
    """Write the take's body as FBX: usual bone names, and a T-pose as its rest."""

    bl_label = "Export FBX"
    filename_ext, doing = ".fbx", "Exporting FBX"
