# SPDX-License-Identifier: GPL-3.0-or-later
"""What the results of a take are made of, which its report keeps, so that a batch can go on where it was stopped."""

import hashlib
import json
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path

from ..core.data.errors import InputError
from ..core.points.naming import plain_method
from ..io.cameras import calibration_files
from ..io.markersets import markerset_file
from ..io.report import REPORT, digests_then, earlier_run
from ..io.source import digest
from ..io.whole import is_read, whole_files
from ..version import version
from .job import MOTION_FILE, PAGE, LabelJob

# Fields of a job that make no difference to what its files hold, or are told by their content.
OUTSIDE = ("source", "cameras", "model", "out", "body", "edits", "overwrite", "resume", "keep", "shown")

# Files that one run writes beside its report and another does not.
OPTIONAL = (".trc", ".blend", PAGE, MOTION_FILE)


def made_of(job: LabelJob) -> dict:
    """What the results come from: version, content of the files that are read, options. To be asked before they are.

    Raises InputError where one of them cannot be read.
    """
    options = {field.name: getattr(job, field.name) for field in fields(job) if field.name not in OUTSIDE}
    # Names for one thing are one.
    options |= {
        "occlusion": job.casts,
        "method": plain_method(job.method),
        "wearers": [name for name, _ in job.wearers],
    }
    worn = [model for _, model in job.wearers] or [job.model]
    made = {
        "version": version(),
        "input": digest([job.source]),
        "cameras": digest(calibration_files(job.cameras)) if isinstance(job.cameras, Path) else None,
        "model": digest([markerset_file(model) for model in worn]),
        "options": options,
    }
    edits = job.edits_applied
    if isinstance(edits, Path):
        made["edits"] = digest([edits])
    elif edits:
        made["edits"] = hashlib.sha256(repr(edits).encode()).hexdigest()
    return json.loads(json.dumps(made, default=str))  # as it is read back


def results_of(job: LabelJob) -> dict | None:
    """The report of an earlier run of the same job, where all that it made is there as it made it; else None.

    Raises InputError where what is there was made otherwise, or changed since, and the job may not replace it.
    """
    try:
        report, missing = earlier_run(job.path(REPORT), made_of(job))
    except InputError:
        if job.overwrite:
            return None
        raise
    return None if missing else report


def open_files(job: LabelJob, stack: ExitStack) -> tuple[dict, dict[str, Path]]:
    """What the results are made of, and temporaries of all files that the job writes, by ending.

    They take their places when `stack` ends well: those of files that are there only where the job was told to replace
    them, or goes on with what a run of it left.
    """
    made = made_of(job)
    replace = job.overwrite or (job.resume and earlier_run(job.path(REPORT), made)[0] is not None)
    parts = stack.enter_context(whole_files(job.written, replace, job.read, lambda: leftovers(job)[0]))
    return made, dict(zip(job.endings, parts, strict=True))


def leftovers(job: LabelJob) -> tuple[list[Path], list[Path]]:
    """Files that look like results of this job and are of an earlier one, where it may replace those.

    First those that are as the report that is there says they were written, which go; then those that stay: what
    somebody changed, what no report knows, and motion, as Blender files saved under other names may play from it.
    """
    if not job.overwrite:
        return [], []
    then = digests_then(job.path(REPORT))
    going: list[Path] = []
    staying: list[Path] = []
    for ending in OPTIONAL:
        path = job.path(ending)
        if ending in job.endings or not path.is_file() or is_read(path, job.read):
            continue
        goes = ending != MOTION_FILE and not path.is_symlink() and _is_as_written(path, then.get(ending))
        (going if goes else staying).append(path)
    return going, staying


def _is_as_written(path: Path, then: str | None) -> bool:
    try:
        return then is not None and digest([path]) == then
    except InputError:  # not to be read
        return False
