# SPDX-License-Identifier: GPL-3.0-or-later
"""Several subjects in a take: who is asked for, and what their report says of them."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..blendfile import mesh_occlusion
from ..core.data.errors import InputError
from ..core.data.progress import Progress
from ..core.data.takes import Blobs, Points
from ..core.edits.kinds import Edits
from ..core.geometry.cameras import Cameras
from ..core.points.models import Model
from ..core.points.naming import chosen_method
from ..core.points.several.wearers import SetsWorn, SeveralOptions, Wearer, kinds
from ..core.points.whole_take.pipeline import PointOptions
from ..io.blobs import read_blobs
from ..io.poses import refuse_keys
from ..io.tables import FileTableOptions, Room
from .job import LabelJob
from .models import model_for

if TYPE_CHECKING:  # most takes are of one subject
    from ..core.pipelines.several_through_points import SubjectsInImages
    from ..core.points.several.motion import LabelledSubjects

NOT_HELD = FileTableOptions(0)  # every table: those of chunks are small, and there are many in a long take


def several_asked(job: LabelJob, model: Model) -> Generator[Progress, None, SeveralOptions]:
    """Who is asked for; `model` is what those without names wear.

    Raises InputError where a body is given, which is one subject's.
    """
    if job.body is not None:
        raise InputError("a body of your own is one subject's; expected the bodies of the models", job.source)
    if not job.wearers:
        return SeveralOptions(model, job.subjects)
    subjects = []
    for name, worn in job.wearers:
        subjects.append(Wearer(name, (yield from model_for(worn, job.method))))
    return SeveralOptions(subjects=tuple(subjects))


def label_subjects(
    job: LabelJob, take: Points, asked: SeveralOptions, options: PointOptions
) -> "Generator[Progress, None, LabelledSubjects]":
    """What `core.points.several.pipeline.label_several` gives, which is loaded where it is needed.

    Raises InputError with the file of edits that are of somebody who is not there.
    """
    from ..core.points.several.pipeline import label_several

    with _edits_named(job):
        return (yield from label_several(take, asked, options))


def subjects_in_blobs(
    job: LabelJob, cameras: Cameras, asked: SeveralOptions, edits: Edits, room: Room
) -> "Generator[Progress, None, SubjectsInImages]":
    """Who is in a take of blobs, by the points that they make; InputError where edits are of somebody who is not."""
    from ..core.pipelines.several_through_points import label_several_blobs

    def read() -> Iterator[tuple[Blobs, float]]:
        first = None
        for rows in read_blobs(job.source, cameras, job.frames):
            first = int(rows.blobs.frames[0]) if first is None else first
            if job.shown:
                frames = int(rows.blobs.frames[-1]) - first + 1
                refuse_keys(frames, asked.at_least, 0.0 if job.frames else rows.fraction)
            yield rows.blobs, rows.fraction

    options = PointOptions(chosen_method(asked.models[0], job.method), job.target, room=room, force=job.force)
    body_of = mesh_occlusion if job.casts == "bvh" else None
    with _edits_named(job):
        return (yield from label_several_blobs(read, cameras, asked, options, job.frame_rate, body_of, edits))


@contextmanager
def _edits_named(job: LabelJob) -> Iterator[None]:
    """Names the file of edits in an InputError that names none."""
    try:
        yield
    except InputError as error:
        raise error if error.file else InputError(error.message, job.edits_file or job.source) from None


def facts_of_subjects(job: LabelJob, worn: SetsWorn, notes: list[str]) -> dict:
    """What a report says of who is in the take; `notes` it has."""
    return {
        "notes": [*notes, *(_alike(worn) if job.wearers else ())],
        "subjects": [
            {
                "name": one.name,
                "model": one.model.markerset.name,
                "model_version": one.model.history.version,
                "model_fingerprint": one.model.fingerprint,
            }
            for one in worn.subjects
        ],
    }


def _alike(worn: SetsWorn) -> list[str]:
    """Who cannot be told from whom by their models, a sentence for each model."""
    said, first_of = [], kinds(worn.subjects)
    for first in dict.fromkeys(first_of):
        names = [one.name for one, kind in zip(worn.subjects, first_of, strict=True) if kind is first]
        if len(names) > 1:
            words = f"{' and '.join(names)} wear the same model, which does not tell them apart"
            said.append(f"{words}: {names[0]} is who is first in the file")
    return said
