# SPDX-License-Identifier: GPL-3.0-or-later
"""One take from file to files. The command line and Blender's operators step these generators of progress alike."""

from collections.abc import Generator
from typing import TYPE_CHECKING

from ..core.data.progress import Progress
from ..io.points import holds_points
from .job import LabelJob, Labelled

if TYPE_CHECKING:
    from .labelling import OpenTake


def label_file(job: LabelJob) -> Generator[Progress, None, Labelled]:
    """Labels a take and writes its files, which appear together or not at all.

    Raises UserError with the file where it can be told.
    """
    from .labelling import label_take

    return label_take(job, _kind_of)


def _kind_of(job: LabelJob) -> "type[OpenTake]":
    """What opens the take; of blobs it takes long to load, and takes of points need none of it."""
    if holds_points(job.source, job.use):
        from .labelling import PointTake

        return PointTake
    from .blobs import BlobTake

    return BlobTake


__all__ = ["LabelJob", "Labelled", "label_file"]
