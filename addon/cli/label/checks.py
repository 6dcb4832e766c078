# SPDX-License-Identifier: GPL-3.0-or-later
"""What is asked for, as a job or a command line for each take, and what can be known to be wrong before any work."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

from ... import jobs
from ...blendfile import has_blender, open_cameras
from ...core.data.errors import InputError
from ...core.data.wording import words_of_range
from ...io.edits import edits_beside
from ...io.points import holds_points
from ...io.qtm.capture import is_qtm
from ...io.whole import keep_apart
from ...jobs.job import calibration_for, told_by_capture
from ..arguments import job_of
from .options import check_models, subject_words

if TYPE_CHECKING:
    from ...jobs.pages import BatchSummary


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
    from ...jobs.pages import BatchSummary

    summary = BatchSummary(arguments.out, arguments.summary, page)
    if not arguments.watch:
        for path in arguments.inputs:
            summary.wait_for(path)
    return summary


def check(arguments):
    """Everything that can be known to be wrong before any work; raises InputError."""
    if arguments.scheduler is not None or arguments.engine != "local":
        from .farm import check_farm

        check_farm(arguments.engine)
    _check_inputs(arguments)
    blobs = [path for path in arguments.inputs if not holds_points(path, arguments.use)]
    for path in blobs:
        if arguments.cameras is None and not is_qtm(path):
            from ...io.blobs import check_header

            check_header(path)  # what holds no blobs needs no cameras
        calibration_for(path, arguments.cameras)
    check_rest(arguments)
    if arguments.edits is not None and len(arguments.inputs) > 1:
        words = f"--edits is of one take, and there are {len(arguments.inputs)}"
        raise InputError(f"{words}; expected one take, or files such as walk.edits.json beside the takes")
    takes = [as_job(arguments, path) for path in arguments.inputs]
    summary = summary_of(arguments)
    pages = [] if summary is None else summary.written
    written = [path for take in takes for path in take.written]
    keep_apart({path for take in takes for path in take.read}, written + pages)
    if summary is not None:
        summary.check(arguments.overwrite, arguments.resume)
    check_models(arguments)
    if blobs and arguments.cameras:  # once, and not for each of the takes
        open_cameras(arguments.cameras, arguments.up)


def check_rest(arguments):
    """What can be known to be wrong of takes that are not looked at; raises InputError."""
    if arguments.blend and not has_blender():
        raise InputError("--blend needs Blender or the bpy package, and neither is here; expected one of them")
    if arguments.out.exists() and not arguments.out.is_dir():
        raise InputError("is no folder; expected a folder for the results", arguments.out)


def edited_beside(arguments) -> list[str]:
    """Which takes are labelled with edits that nobody named, a sentence each."""
    if arguments.edits is not None:
        return []
    found = [(path, edits_beside(path)) for path in arguments.inputs]
    return [f"{path}: the edits of {edits.name} beside it are applied" for path, edits in found if edits is not None]


def unused(arguments) -> list[str]:
    """What is given and makes no difference to some of the takes, a sentence each; they are labelled all the same."""
    kinds = {holds_points(path, arguments.use) for path in arguments.inputs}
    said = []
    if arguments.scheduler is not None and arguments.jobs > 1:
        said.append("--jobs is not looked at with --scheduler: its workers take as many takes as they have threads")
    if arguments.rate is not None and True in kinds:
        said.append("--rate is not looked at for 3D points whose files say their own rate")
    if arguments.mirror and False in kinds:
        said.append("--mirror is not looked at for blobs: what is mirrored of them is their images or calibration")
    hints = [f"--{name}" for name in ("height", "facing") if getattr(arguments, name) is not None]
    if hints:
        from ...core.points.naming import plain_method

        several = arguments.subjects != 1 or bool(arguments.subject)
        fitted = not several and plain_method(arguments.method) in ("auto", "fit")
        deaf = [kind for kind in sorted(kinds) if kind or not fitted]
        what = " and ".join("3D points" if kind else "blobs" for kind in deaf)
        verb = "is" if len(hints) == 1 else "are"
        if deaf:
            why = "of several subjects" if several else "that is for blobs and --method fit"
            said.append(f"{' and '.join(hints)} {verb} not looked at for {what}: {why}")
    return said


def _check_inputs(arguments):
    """Raises InputError where inputs are no files, or results would take each other's or an input's place."""
    stems: dict[str, Path] = {}
    for path in arguments.inputs:
        if path.is_dir():
            raise InputError("is a folder; expected takes, such as folder/*.c3d", path)
        # Windows and macOS keep walk.csv and Walk.csv in one place.
        other = stems.setdefault(path.stem.casefold(), path)
        if other is not path:
            raise InputError(f"would have the same results as {other}; expected inputs with different names", path)
