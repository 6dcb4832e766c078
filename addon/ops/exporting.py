# SPDX-License-Identifier: GPL-3.0-or-later
"""The labelled take as files for other programs, as the command line writes them; its body as a character as well."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
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
from ..io.c3d.file import TrialFile
from ..io.filled import kept_rows, write_filled
from ..io.labels import POINT_KEYS, LabelWriter, point_keys
from ..io.points import read_points, write_c3d, write_trc
from ..io.samples import TextHead
from ..io.whole import whole_files
from ..jobs.pages import write_kept_page
from ..props import keeps_items
from ..scene.animation import note_time
from ..scene.character import add_character, moving_in
from ..scene.clock import fps_of
from ..scene.opened import opened
from ..scene.performers import homes
from ..scene.roots import is_animated, is_even, moved_by, parent_of, root_of
from ..scene.stored import Stored, alone
from ..scene.take import is_take
from .base import OfTake, ToldWhere, WithTake, lacks_object_mode, lacks_take, once, taken
from .long_work import LongWork
from .reposing import follow_now, words_behind

# No performer is called so.
TOGETHER = (":TOGETHER", "Together", "All performers in one file, markers called NAME:MARKER")
APART = (":APART", "A File Each", "A file for each performer, called after them")


# Writes a part of a take, its own or all of it, to paths; gives what a person should know of that, or nothing.
Writer = Callable[[Sequence[Path], Stored, Stored], str]


class ExportsTake(LongWork, ToldWhere, WithTake):
    """What the exports share: they need a labelled take, and name the file after it.

    They differ in what `write` is, which goes to other processes, and in what is written `beside` a file. What is
    `of_body` waits for that to follow the labels.
    """

    of_body = of_scene = False
    write: Writer

    def invoke(self, context, event):
        self._asked_for_it = True
        return ToldWhere.invoke(self, context, event)

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

    def asked(self, context) -> partial:
        files, read = self.files(context)
        source = str(source_of(taken(context)) or "")
        takes = taken(context), *(part for *_, part in files)
        whole, *parts = (self.given(context, replace(one, source=source)) for one in takes)
        given = [([path, *self.beside(path)], overwrite) for path, overwrite, *_ in files]
        return partial(export_files, type(self).write, whole, parts, given, read)

    def given(self, context, stored: Stored) -> Stored:
        """A take, or a part of it, as it is written."""
        return stored

    def files(self, context) -> tuple[list[tuple[Path, bool, str, Stored]], list[Path]]:
        """The files to write: whether each may be replaced, whose it is, and the take in it; and what is read."""
        if not self.filepath:
            raise InputError("no file was named; expected the one to write")
        if self.of_body:
            follow_now(context)
        stored, settings = taken(context), context.scene.mocap_autolabel
        # No export may replace what take and scene come from.
        named = stored.source, settings.source.blobs_path, settings.source.points_path, bpy.data.filepath
        read = [Path(bpy.path.abspath(name)) for name in (*named, settings.subjects.markerset_path) if name]
        paths = [(self.path_of(name), name, part) for name, part in self.parts(stored)]
        # Blender's own file browser has asked already whether to overwrite, of the file that it was told.
        return [(path, path == Path(self.filepath), *whose) for path, *whose in paths], read

    def _show(self, _context, found: tuple[list[Path], list[str]]):
        paths, warnings = found
        for words in warnings:
            self.report({"WARNING"}, words)
        self.report({"INFO"}, f"Saved {', '.join(map(str, paths))}")

    def parts(self, stored: Stored) -> list[tuple[str, Stored]]:
        """What goes into a file of its own: a performer's name, empty for all of them, and the take of theirs."""
        return [("", stored)]

    def path_of(self, name: str) -> Path:
        """The file of a performer where each gets one, called after them."""
        return Path(self.filepath)


def export_files(
    write: Writer,
    whole: Stored,
    parts: Sequence[Stored],
    files: Sequence[tuple[Sequence[Path], bool]],
    read: Sequence[Path],
) -> Generator[float, None, tuple[list[Path], list[str]]]:
    """Writes each part of a take to its files, which may be replaced or not; gives the first of each, and warnings.

    What is `read` is not written over.
    """
    warnings = []
    for number, (part, (paths, overwrite)) in enumerate(zip(parts, files, strict=True)):
        yield number / len(files)
        with whole_files(paths, overwrite, read) as temporaries:
            warnings.append(write(temporaries, whole, part))
    return [paths[0] for paths, _ in files], [words for words in warnings if words]


def write_labels(paths: Sequence[Path], _whole: Stored, stored: Stored) -> str:
    """Writes the labels; beside those of blobs is each row's own text, which only the file of the blobs has."""
    [path] = paths
    if isinstance(stored.rows, PointRows):
        with LabelWriter(path, stored.names, POINT_KEYS) as writer:
            writer.write(point_keys(stored.rows), stored.labels)
    else:
        write_blob_labels(path, stored)
    return ""


class MOCAP_AUTOLABEL_OT_export_labels(ExportsTake, bpy.types.Operator):
    """Write the name of every blob or point, row for row with the file they are from."""

    filename_ext, doing = ".labels.csv", "Exporting labels"
    write = write_labels


def performer_property(together: bool):
    """The property that says whose motion is written: of all in one file, where that can be, of each, or of one."""
    ways = [TOGETHER, APART] if together else [APART]

    @keeps_items
    def items(_self, context) -> list[tuple[str, str, str]]:
        take = None if context.scene is None else context.scene.mocap_autolabel.take
        names = list(homes(take)) if is_take(take) else []
        return [*ways, *((name, name, f"{name} alone, under the names of the set") for name in names)]

    return EnumProperty(name="Performers", description="Whose motion is written", items=items)


def room_property(default: bool):
    """The property that says whether what is written stands where it was captured."""
    words = "Where it was captured; off, where the take's root empty has it in the scene"
    return once(BoolProperty, "Room Coordinates", words, default=default)


class ExportsPerformers(ExportsTake):
    """Exports of which each performer can have a file of their own, in the room or as it stands in the scene."""

    performer: performer_property(together=True)
    room: room_property(True)

    def draw(self, context):
        super().draw(context)
        take = context.scene.mocap_autolabel.take
        if homes(take):
            self.layout.prop(self, "performer")
        if is_animated(root_of(take)) or not np.array_equal(moved_by(take), np.eye(4)):
            self.layout.prop(self, "room")

    def place(self, context) -> np.ndarray:
        """(4, 4) from the room to where what is written is to stand; InputError where no file can have that."""
        take = context.scene.mocap_autolabel.take
        if self.room:
            return np.eye(4)
        if is_animated(root_of(take)):
            words = "the take's root, or what it hangs on, is animated"
            raise InputError(f"{words}; expected it to stay in one place, or Room Coordinates on")
        place = moved_by(take)
        if not is_even(place):
            words = "the take's root is mirrored or scaled unevenly"
            raise InputError(f"{words}; expected its scale alike on all axes, or Room Coordinates on")
        return place

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
    """The exports of the points of the take; elsewhere than in the room without what else its file holds."""

    _more_is_left = False

    def given(self, context, stored: Stored) -> Stored:
        place = self.place(context)
        if np.array_equal(place, np.eye(4)):
            return stored
        kept = isinstance(stored.rows, PointRows) and Path(stored.source).suffix.lower()
        self._more_is_left = kept in (".c3d", ".trc", ".tsv", ".csv")
        return replace(moved(stored, place), source="")

    def _show(self, context, found):
        paths, warnings = found
        if self._more_is_left:
            warnings = [*warnings, "The points stand as the scene has them, so they were saved alone"]
        super()._show(context, (paths, warnings))

    def beside(self, path: Path) -> list[Path]:
        # An older list beside the file would speak of fills that are none any more.
        fills = path.with_suffix(".filled.csv")
        return [fills] if taken(bpy.context).fitting or fills.exists() else []


def moved(stored: Stored, place: np.ndarray) -> Stored:
    """A take whose points are elsewhere, and errors as much larger, by a matrix (4, 4) that scales evenly."""
    turn, way, scale = place[:3, :3].T, place[:3, 3], float(np.linalg.norm(place[:3, 0]))
    rows, motion = stored.rows, stored.motion
    if isinstance(rows, PointRows):
        residual = None if rows.residual is None else rows.residual * scale
        rows = replace(rows, xyz=rows.xyz @ turn + way, residual=residual)
    motion = replace(motion, markers=motion.markers @ turn + way, residual=motion.residual * scale)
    fills = tuple(replace(fill, expected=fill.expected * scale) for fill in stored.fills)
    return replace(stored, rows=rows, motion=motion, fills=fills)


def write_points(paths: Sequence[Path], whole: Stored, stored: Stored) -> str:
    """Writes the markers of a take or of a part of it, with all else of the file that the take came from.

    Says of a C3D that it is not as it was, and of what a C3D has no room for.
    """
    path, *beside = paths
    for fills in beside:
        write_filled(fills, kept_rows(stored.fitting))
    trial = trial_of(whole)
    if path.suffix == ".trc":
        write_trc(path, points_of(stored), trial)
        return ""
    notes = write_c3d(path, points_of(stored), trial, [one.name for one in stored.performers if one.name])
    if trial is not None or not whole.source.lower().endswith(".c3d"):
        return "; ".join(f"{whole.source}: {note}" for note in notes)
    return f"{whole.source}: is gone, or its points are not as they were labelled, so those were saved alone"


class MOCAP_AUTOLABEL_OT_export_c3d(ExportsPoints, bpy.types.Operator):
    """Write the named markers in space as C3D: gaps empty, filled samples with residual 0, all else as it came."""

    filename_ext, doing = ".c3d", "Exporting C3D"
    write = write_points


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
    source, frames = Path(stored.source), stored.motion.frames
    if not stored.source or not isinstance(stored.rows, PointRows):
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
    filename_ext, doing = ".trc", "Exporting TRC"
    write = write_points


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


def write_blob_labels(path: Path, stored: Stored):
    """Writes the labels of a take of blobs; JobError when the file of its blobs has changed since."""
    source, frames, first = Path(stored.source), stored.motion.frames, 0
    if not stored.source:
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


def write_report(paths: Sequence[Path], _whole: Stored, stored: Stored) -> str:
    """Writes the page of a take."""
    subject = OverviewSubject(stored.names, stored.words, stored.parents)
    overview = TakeOverview(subject, stored.rate, stored.cameras, stored.edits)
    labelled = LabelledChunk(stored.labels, stored.unfilled, stored.suspects, outcomes=stored.outcomes)
    of_take = stored.name, stored.source, stored.model
    smoothed = None if stored.cutoff is None else count_smoothed(stored.motion.markers)
    write_kept_page(paths[0], *of_take, overview, stored.rows, labelled, stored.fitting, smoothed)
    return ""


class MOCAP_AUTOLABEL_OT_export_report(ExportsTake, bpy.types.Operator):
    """Save a page that shows how the take was labelled: one file that opens in any browser, to be passed on."""

    bl_label = "Save Report"
    filename_ext, of_body, doing = ".report.html", True, "Saving the report"
    write = write_report
    open_after: BoolProperty(name="Open It", description="Show the page in the browser once it is saved", default=True)

    def _show(self, context, found):
        super()._show(context, found)
        if self.open_after and not bpy.app.background:
            bpy.ops.wm.path_open(filepath=self.filepath)


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
            clock = stored.clock.at_rate(fps_of(context.scene), stored.rate)
            body = replace(body, frames=clock.shown(stored.motion.frames))
            character = add_character(context, home, body, settings.bone_names)
            character.parent = parent_of(settings.take)
            note_time(character.animation_data.action, fps_of(context.scene), clock.start)
            added.append(character.name)
        self.report({"INFO"}, f"Added {', '.join(added)}")


class ExportsCharacter(ExportsPerformers):
    """The exports of performers' characters by Blender's own exporters, which take a minute for a long take."""

    needs = (lacks_take, lacks_object_mode)
    of_body, unit = True, ""
    performer: performer_property(together=False)
    room: room_property(False)

    def asked(self, context) -> partial:
        settings, place, (files, read) = context.scene.mocap_autolabel, self.place(context), self.files(context)
        at = homes(settings.take)
        bodies = [
            (path, overwrite, replace(moving_in(at.get(name, settings.take), part), place=place))
            for path, overwrite, name, part in files
        ]
        scale = BVH_UNITS.get(self.unit, 1.0)
        return partial(save_characters, self.filename_ext[1:], bodies, read, settings.bone_names, scale)

    def _show(self, context, found: list[Path]):
        super()._show(context, (found, []))


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
