# SPDX-License-Identifier: GPL-3.0-or-later
"""What the results of a take were made of, which its report keeps, so that a batch can go on where it was stopped."""

import json
from dataclasses import fields
from pathlib import Path

from ..core.data.errors import InputError
from ..core.points.naming import plain_method
from ..io.cameras import calibration_files
from ..io.markersets import markerset_file
from ..io.source import digest
from ..version import version
from .edits import digest_of_edits
from .job import REPORT, LabelJob

# Fields of a job that make no difference to what its files hold, or are told by their content.
OUTSIDE = ("source", "cameras", "model", "out", "body", "edits", "overwrite", "resume", "keep")
INSTEAD = "--overwrite to make it anew, or another folder for --out"


def made_of(job: LabelJob) -> dict:
    """What the results come from: version, content of the files that are read, options. To be asked before they are.

    Raises InputError where one of them cannot be read.
    """
    options = {field.name: getattr(job, field.name) for field in fields(job) if field.name not in OUTSIDE}
    # Names for one thing are one.
    options |= {"occlusion": job.casts, "method": plain_method(job.method)}
    made = {
        "version": version(),
        "input": digest([job.source]),
        "cameras": digest(calibration_files(job.cameras)) if isinstance(job.cameras, Path) else None,
        "model": digest([markerset_file(job.model)]),
        "options": options,
    }
    if (edits := digest_of_edits(job)) is not None:
        made["edits"] = edits
    return json.loads(json.dumps(made, default=str))  # as it is read back


def results_of(job: LabelJob) -> dict | None:
    """The report of an earlier run of the same job, where all that it made is there as it made it; else None.

    Raises InputError where what is there was made otherwise, or changed since, and the job may not replace it.
    """
    try:
        report, missing = _earlier(job, made_of(job))
    except InputError:
        if job.overwrite:
            return None
        raise
    return None if missing else report


def may_replace(job: LabelJob, now: dict) -> bool:
    """Whether a job made of this may replace what is there: it was told to, or goes on with what a run of it left."""
    return job.overwrite or (job.resume and _earlier(job, now)[0] is not None)


def _earlier(job: LabelJob, now: dict) -> tuple[dict | None, bool]:
    """The report of an earlier run of the same job, None where there is none, and whether any of its files is gone.

    The report gets its name last. Raises InputError where something is there that the same job did not make.
    """
    path = job.path(REPORT)
    if not path.exists():
        return None, True
    report, missing = _read(path), False
    made = report["made_of"]
    then, now = _flat(made), _flat(now)
    other = [name for name in now | then if now.get(name) != then.get(name)]
    if other:
        what = f"is of a run that differs in {', '.join(other)}"
        raise InputError(f"{what}; expected the same as then, {INSTEAD}", path)
    for ending, was in made["results"].items():
        file = job.path(ending)
        if not file.exists():
            missing = True
        elif digest([file]) != was:
            raise InputError(f"was changed since it was made; expected it as it was, {INSTEAD}", file)
    return report, missing


def _flat(made: dict) -> dict:
    """What results were made of, the options beside the files."""
    files = {name: value for name, value in made.items() if name not in ("options", "results")}
    return files | {f"--{name}": value for name, value in made["options"].items()}


def _read(path: Path) -> dict:
    """A report that says what it was made of."""
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
        if all(isinstance(report["made_of"][part], dict) for part in ("options", "results")):
            return report
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        pass
    raise InputError(f"does not say what it was made of; expected the report of an earlier run, {INSTEAD}", path)
