# SPDX-License-Identifier: GPL-3.0-or-later
"""The labelled take as files for other programs: the same that the command line writes."""

from pathlib import Path

import bpy
import numpy as np
from bpy.props import StringProperty
from bpy_extras.io_utils import ExportHelper

from ..core.data.errors import InputError, JobError
from ..core.data.takes import PointRows, Points
from ..io.blobs import read_blobs
from ..io.filled import kept_rows, write_filled
from ..io.labels import LabelWriter, write_point_labels
from ..io.points import write_c3d, write_trc
from ..io.whole import whole_files
from ..scene.opened import opened
from ..scene.take import Stored
from .polling import WithTake
from .reporting import reports_trouble


class ExportsTake(WithTake, ExportHelper):
    """What the exports share: they need a labelled take, and name the file after it.

    They differ in `write`, which writes a take to a path and to those of the files `beside` it; UserError if it cannot.
    """

    bl_options = {"REGISTER"}

    def invoke(self, context, event):
        if not self.filepath:
            stored = opened.take(context.scene.mocap_autolabel.take, context.scene)
            folder = Path(bpy.path.abspath(stored.source)).parent if stored.source else Path()
            self.filepath = str(folder / (stored.name + self.filename_ext))
        return ExportHelper.invoke(self, context, event)

    def beside(self, path: Path) -> list[Path]:
        """The files that may appear beside `path`."""
        return []

    @reports_trouble
    def execute(self, context):
        stored = opened.take(context.scene.mocap_autolabel.take, context.scene)
        path = Path(self.filepath)
        # Blender's own file browser has asked already whether to overwrite.
        with whole_files([path, *self.beside(path)], overwrite=True, read=read_by(context, stored)) as temporaries:
            self.write(temporaries, stored)
        self.report({"INFO"}, f"Saved {path}")
        return {"FINISHED"}


def read_by(context: bpy.types.Context, stored: Stored) -> list[Path]:
    """The files that the take and the scene come from, which no export may replace."""
    settings = context.scene.mocap_autolabel
    named = [stored.source, settings.blobs_path, settings.points_path, settings.markerset_path, bpy.data.filepath]
    return [Path(bpy.path.abspath(name)) for name in named if name]


class MOCAP_AUTOLABEL_OT_export_labels(ExportsTake, bpy.types.Operator):
    """Write the name of every blob or point, row for row with the file they are from."""

    bl_idname = "mocap_autolabel.export_labels"
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


class ExportsPoints(ExportsTake):
    """The exports of the points of the take; they differ in `write_points`, which writes those to a path."""

    def beside(self, path: Path) -> list[Path]:
        """The list of what is filled."""
        return [path.with_suffix(".filled.csv")]

    def write(self, paths: list[Path], stored: Stored):
        """Writes the points of the take, and where something is filled, what, by which method and how far off."""
        self.write_points(paths[0], points_of(stored))
        # An older list beside the file would speak of fills that are none any more.
        if stored.fitting or self.beside(Path(self.filepath))[0].exists():
            write_filled(paths[1], kept_rows(stored.fitting))


class MOCAP_AUTOLABEL_OT_export_c3d(ExportsPoints, bpy.types.Operator):
    """Write the named markers in space as C3D: gaps empty, and what was filled with the residual 0."""

    bl_idname = "mocap_autolabel.export_c3d"
    bl_label = "Export C3D"
    filename_ext, write_points = ".c3d", staticmethod(write_c3d)
    filter_glob: StringProperty(default="*.c3d", options={"HIDDEN"})


class MOCAP_AUTOLABEL_OT_export_trc(ExportsPoints, bpy.types.Operator):
    """Write the named markers in space as TRC, for OpenSim."""

    bl_idname = "mocap_autolabel.export_trc"
    bl_label = "Export TRC"
    filename_ext, write_points = ".trc", staticmethod(write_trc)
    filter_glob: StringProperty(default="*.trc", options={"HIDDEN"})


def points_of(stored: Stored) -> Points:
    """The take as points: a trajectory a marker, then those that stay unnamed where it came as points."""
    motion = stored.motion
    xyz, residual, names = motion.markers, motion.residual, stored.names
    if isinstance(stored.rows, PointRows):
        rest, off = unnamed_trajectories(stored)
        xyz, residual = np.concatenate([xyz, rest], axis=1), np.concatenate([residual, off], axis=1)
        names = (*names, *[""] * rest.shape[1])
    return Points(names, xyz, residual, stored.rate, int(motion.frames[0]))


def unnamed_trajectories(stored: Stored) -> tuple[np.ndarray, np.ndarray]:
    """(F, U, 3) m the points without a name, a trajectory of the file a column, and (F, U) m their residuals.

    NaN where there is none; residuals are NaN too where the take was labelled before they were kept.
    """
    rows, kept = stored.rows, np.flatnonzero(~stored.labels.named)
    columns, column = np.unique(rows.trajectory[kept], return_inverse=True)
    shape = (len(stored.motion.frames), len(columns))
    xyz, residual = np.full((*shape, 3), np.nan), np.full(shape, np.nan)
    xyz[rows.frame[kept], column] = rows.xyz[kept]
    if rows.residual is not None:
        residual[rows.frame[kept], column] = rows.residual[kept]
    return xyz, residual


def write_labels(path: Path, stored: Stored):
    """Writes the labels of a take of blobs; JobError when the file of its blobs has changed since."""
    if not stored.source:
        raise InputError(f"take {stored.name} names no file of blobs; expected the file that it was labelled from")
    source, frames = Path(bpy.path.abspath(stored.source)), stored.motion.frames
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


CLASSES = (MOCAP_AUTOLABEL_OT_export_labels, MOCAP_AUTOLABEL_OT_export_c3d, MOCAP_AUTOLABEL_OT_export_trc)
