# SPDX-License-Identifier: GPL-3.0-or-later
"""One take from file to files. The command line and Blender's operators step these generators of progress alike."""

from collections.abc import Generator

from ..core.data.progress import Progress
from ..io.points import holds_points
from .job import LabelJob, Labelled


def label_file(job: LabelJob) -> Generator[Progress, None, Labelled]:
    """Labels a take and writes its files, which appear together or not at all.

    Raises UserError with the file where it can be told.
    """
    points = holds_points(job.source, job.use)
    from .labelling import PointTake, label_take

    if points:
        return label_take(job, PointTake)
    from .blobs import BlobTake  # which takes long to load, and takes of points need none of it

    return label_take(job, BlobTake)


__all__ = ["LabelJob", "Labelled", "label_file"]
