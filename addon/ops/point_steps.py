# SPDX-License-Identifier: GPL-3.0-or-later
"""The labelling of 3D points, a little at a time: the command line's own job, with its files in a folder that goes."""

from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ..core.data.errors import UserError
from ..io.markersets import open_markerset
from ..io.names import written
from ..io.points import read_points
from ..io.scratch import scratch_folder
from ..jobs import LabelJob, Labelled, label_file
from ..jobs.background import drained, in_background
from ..props import SceneSettings, chosen_model, frames_wanted
from ..scene.cameras import NO_CAMERAS
from ..scene.take import Take


def point_job_of(settings: SceneSettings) -> LabelJob:
    """What the scene's settings ask for; InputError when something is missing."""
    return LabelJob(
        source=Path(bpy.path.abspath(settings.points_path)),
        cameras=None,
        model=chosen_model(settings),
        out=Path(),
        frames=frames_wanted(settings),
        up=settings.points_up or None,
        rate=settings.rate,
        method=settings.method,
        target=settings.target,
        height=settings.height if settings.use_height else None,
        facing=settings.facing if settings.use_facing else None,
        keep=True,
    )


def label_point_steps(job: LabelJob, name: str) -> Generator[float, None, Take]:
    """Labels the points, yielding how much is done (0 to 1), and returns the take. Touches nothing of Blender.

    The job takes long steps, so it goes on beside the window. Raises UserError with the file where it can be told.
    """
    return in_background(lambda tell: _label(job, name, tell))


def _label(job: LabelJob, name: str, tell: Callable[[float], None]) -> Take:
    try:
        with scratch_folder() as folder:
            labelled = drained(label_file(replace(job, out=folder)), tell)
        return _take_of(labelled, job, name)
    except UserError as error:
        raise error if error.file else type(error)(error.message, job.source) from error


def _take_of(labelled: Labelled, job: LabelJob, name: str) -> Take:
    """The take as the scene shows it; points and residuals come from the file, for the labelling hands none on."""
    [(rows, chunk)] = labelled.chunks
    file = read_points(job.source, up=job.up, rate=job.rate)
    at = rows.frames[rows.frame] - file.first_frame, rows.camera
    return Take(
        name,
        file.rate,
        NO_CAMERAS,
        open_markerset(job.model),
        replace(rows, camera=np.asarray(file.columns)[rows.camera]),
        chunk.labels,
        chunk.motion,
        chunk.suspects,
        written(str(job.source)),
        file.xyz[at],
        file.residual[at],
    )
