# SPDX-License-Identifier: GPL-3.0-or-later
"""One take from file to files: generators of progress, which the command line steps, for itself or for a window."""

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path

from ..core.data.errors import UserError
from ..core.data.progress import Progress
from ..core.review.changes import Change
from ..io.labels import changes_of_part
from ..io.scratch import scratch_folder
from ..io.whole import finish_renaming
from .job import LabelJob, Labelled, results_of


def label_file(job: LabelJob) -> Generator[Progress, None, Labelled]:
    """Labels a take and writes its files, which appear together or not at all.

    Raises UserError with the file where it can be told.
    """
    from .labelling import label_take

    return label_take(job)


def label_for_report(job: LabelJob) -> Generator[Progress, None, dict]:
    """The same for the report alone: of a job that is gone on with the earlier one's, where all is there."""
    if job.resume:
        finish_renaming(job.out)
    return (results_of(job) if job.resume else None) or (yield from label_file(job)).report


def label_to_show(
    job: LabelJob, whole: Path | None = None
) -> Generator[Progress, None, tuple[Labelled, tuple[Change, ...] | None]]:
    """The same for a window, with the files in a folder that goes.

    Of a part of a take it gives how its names are otherwise than in the label file of the `whole`, None where nobody
    can tell.
    """
    with scratch_folder() as folder:
        job = replace(job, out=folder)
        labelled, changed = (yield from label_file(job)), None
        if whole is not None:
            changed = changes_of_part(whole, job.path(".labels.csv"), labelled.worn.markers, job.frames)
    return labelled, changed


def worn_to_show(job: LabelJob) -> Generator[Progress, None, tuple[list[str], bool, bool, UserError | None]]:
    """What the sidebar tells of a take before it is labelled, as `find_worn`; or why it can tell nothing."""
    from .labelling import find_worn

    try:
        return *(yield from find_worn(job)), None
    except UserError as error:
        return [], False, False, error


__all__ = ["LabelJob", "Labelled", "label_file", "label_for_report", "label_to_show", "worn_to_show"]
