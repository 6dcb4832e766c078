# SPDX-License-Identifier: GPL-3.0-or-later
"""The edits of a take: those that the job names, or that lie beside the take, and what its report says of them."""

import hashlib
from collections.abc import Iterable

from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from ..core.data.takes import EditOutcome
from ..core.edits.applying import names_of, refuse_unknown, summary_of
from ..core.edits.kinds import NO_EDITS, Edits
from ..core.edits.rows import document_of
from ..io.edits import read_edits
from ..io.report import compact
from ..io.source import digest
from .job import LabelJob


def open_edits(job: LabelJob, markerset: MarkerSet, **known) -> Edits:
    """The edits that the job applies; none where there are none.

    `known` is what else is known of the take, as `applying.refuse_unknown` takes it.
    Raises InputError with the file and the number of the edit where one cannot be of this take.
    """
    path = job.edits_file
    edits = job.edits if isinstance(job.edits, Edits) else NO_EDITS if path is None else read_edits(path)
    try:
        refuse_unknown(edits, names_of(markerset), **known)
    except InputError as error:
        raise InputError(error.message, path or job.source) from None
    return edits


def digest_of_edits(job: LabelJob) -> str | None:
    """What tells the edits of a job from others; None where there are none."""
    if isinstance(job.edits, Edits):
        return hashlib.sha256(compact(document_of(job.edits)).encode()).hexdigest() if job.edits else None
    return None if job.edits_file is None else digest([job.edits_file])


def facts_of_edits(job: LabelJob | None, outcomes: Iterable[EditOutcome]) -> dict:
    """What the report says of edits, where there are some; without a job they are of no file."""
    outcomes = tuple(outcomes)
    if not outcomes:
        return {}
    file = None if job is None else job.edits_file
    return {"edits": {"file": None if file is None else file.name, **summary_of(outcomes)}}
