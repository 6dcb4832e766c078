# SPDX-License-Identifier: GPL-3.0-or-later
"""One take from file to files. The command line and Blender's operators step these generators of progress alike."""

from collections.abc import Generator

from ..core.data.errors import InputError
from ..io.points import holds_points
from ..progress import Progress
from .job import METHODS, USUAL_RATE, USUAL_TARGET, LabelJob, Labelled


def label_file(job: LabelJob) -> Generator[Progress, None, Labelled]:
    """Labels a take and writes its files, which appear together or not at all.

    Raises UserError with the file where it can be told.
    """
    if holds_points(job.source):
        if job.method == "both":
            raise InputError("holds points, and the method both is for blobs; expected another method", job.source)
        from .points import label_points

        return label_points(job)
    from .blobs import label_blobs

    return label_blobs(job)


__all__ = ["METHODS", "USUAL_RATE", "USUAL_TARGET", "LabelJob", "Labelled", "label_file"]
