# SPDX-License-Identifier: GPL-3.0-or-later
"""What is asked for, as a job or a command line for each take, and as a summary of all."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

from ... import jobs
from ...core.data.wording import words_of_range
from ...io.points import holds_points
from ...jobs.captures import told_by_capture
from ..arguments import job_of
from .subjects import subject_words

if TYPE_CHECKING:  # with the pages, which a take alone does not need
    from ...jobs.batches import BatchSummary


def as_job(arguments, path: Path) -> jobs.LabelJob:
    """The job of labelling one of the inputs."""
    facing = None if arguments.facing is None else math.radians(arguments.facing)
    known = {"source": path, "wearers": tuple(arguments.subject), "facing": facing}
    if not holds_points(path, arguments.use):
        known |= told_by_capture(path, arguments.cameras, arguments.rate)
    return job_of(jobs.LabelJob, arguments, **known)


def command_for(arguments, path: Path) -> list[str]:
    """The command line that labels one of the inputs alone."""
    who = subject_words(arguments.model, arguments.subjects, arguments.subject)
    command = ["label", f"--out={arguments.out}", *who]
    known = {
        name: getattr(arguments, name)
        for name in ("cameras", "rate", "height", "facing", "method", "occlusion", "target", "up", "use", "edits")
    }
    command += [f"--{name}={value}" for name, value in known.items() if value is not None]
    if arguments.frames:
        command.append(f"--frames={words_of_range(arguments.frames)}")
    switches = "mirror", "trc", "fill", "blend", "html", "overwrite", "resume", "force"
    command += [f"--{name}" for name in switches if getattr(arguments, name)]
    return [*command, "--", str(path)]


def summary_of(arguments) -> "BatchSummary | None":
    """The summary of all takes; None where none is wanted, as of one take only."""
    page = arguments.summary or (arguments.html and (arguments.watch or len(arguments.inputs) > 1))
    if not page and not arguments.watch:
        return None
    from ...jobs.batches import BatchSummary, summary_paths

    stems = [] if arguments.watch else [path.stem for path in arguments.inputs]
    summary = BatchSummary(*summary_paths(arguments.out, stems, arguments.summary, page))
    if not arguments.watch:
        for path in arguments.inputs:
            summary.wait_for(path)
    return summary
