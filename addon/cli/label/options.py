# SPDX-License-Identifier: GPL-3.0-or-later
"""What `label` can be told: a job or command line for each take, and what can be known to be wrong before any work."""

import argparse
import math
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from ...blendfile import has_blender, open_cameras
from ...core.data.errors import InputError
from ...core.data.physical import HEIGHTS_M
from ...core.points.models import METHODS, USUAL_TARGET, chosen_method, plain_method
from ...core.points.several.wearers import AUTO, MAX_SUBJECTS, NAME_RULE, as_compared, is_subject_name
from ...io.edits import edits_beside
from ...io.markersets import AUTO_MODEL
from ...io.models import known_models, open_model
from ...io.points import holds_points
from ...io.qtm.capture import USES
from ...io.whole import keep_apart
from ...jobs import LabelJob
from ...jobs.job import OCCLUSIONS, told_by_capture
from ..arguments import OWN_CAMERAS, Takes, add_options, job_of, number, whole

if TYPE_CHECKING:
    from ...jobs.pages import BatchSummary


_told = whole(1, MAX_SUBJECTS, "number of subjects")


def _count(text: str) -> int:
    try:
        return AUTO if text == "auto" else _told(text)
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(f"{error}, or auto") from None


def _wearer(text: str) -> tuple[str, str]:
    name, equals, model = text.partition("=")
    if not equals or not name or model in ("", AUTO_MODEL):
        words = f"{text[:60]!r} says not who wears what"
        raise argparse.ArgumentTypeError(f"{words}; expected NAME=MODEL, such as ann=body26")
    if not is_subject_name(name):
        raise argparse.ArgumentTypeError(f"{name[:60]!r} is no name of a subject; {NAME_RULE}")
    return name, model


def add_subjects(parser: argparse.ArgumentParser, auto: bool = True):
    """Adds what says who is there beside --model; how many there are may be `auto`."""
    kind, sign, words = (_count, "N|auto", ", auto for as many as there are") if auto else (_told, "N", "")
    many = f"how many wear the model{words} (default 1); markers are then called 1:LASI, 2:LASI"
    parser.add_argument("--subjects", type=kind, metavar=sign, help=many)
    who = "who wears what, once for each subject and instead of --model; markers are then called NAME:LASI"
    parser.add_argument("--subject", type=_wearer, action="append", metavar="NAME=MODEL", help=who)


def settle_subjects(arguments, choice: str = f"--model MODEL or {AUTO_MODEL}"):
    """Settles what the arguments leave open; InputError where they contradict each other, or `choice` is missing."""
    arguments.subject = list(arguments.subject or [])
    names = [as_compared(name) for name, _ in arguments.subject]
    if arguments.subject and (arguments.model or arguments.subjects is not None):
        other = "--model" if arguments.model else "--subjects"
        raise InputError(f"--subject and {other} both say who is there; expected one of them")
    if len(set(names)) < len(names):
        raise InputError("--subject names somebody twice; expected a name for each subject")
    if len(names) > MAX_SUBJECTS:
        raise InputError(f"--subject names {len(names)} subjects; expected up to {MAX_SUBJECTS}")
    if not arguments.model and not arguments.subject:
        raise InputError(f"nothing says what is worn; expected {choice}, or --subject NAME=MODEL for each subject")
    if arguments.own is not None and arguments.model != AUTO_MODEL:
        raise InputError(f"--models is of --model {AUTO_MODEL}; expected both of them or neither")
    if arguments.model == AUTO_MODEL and arguments.subjects not in (None, 1):
        raise InputError("--model auto finds what one subject wears; expected --model MODEL beside --subjects")
    if arguments.model == AUTO_MODEL and arguments.own is None and __name__.startswith("bl_ext."):
        from ...prefs import markerset_folder

        own = markerset_folder()
        arguments.own = own if own.is_dir() else None
    arguments.model = arguments.model or arguments.subject[0][1]
    arguments.subjects = 1 if arguments.subjects is None else arguments.subjects


def check_models(arguments):
    """Raises InputError where a model is not there, or is none for several subjects."""
    if arguments.model == AUTO_MODEL:
        known_models(arguments.own)
        return
    open_model(arguments.model)
    if arguments.subjects == 1 and not arguments.subject:
        return
    for name in dict.fromkeys([arguments.model, *(worn for _, worn in arguments.subject)]):
        if plain_method(arguments.method) == "fit" or chosen_method(open_model(name), arguments.method) != "likelihood":
            words = f"several subjects need a model that names by likelihood, and {name} is not asked to"
            way = "--method auto, which names blobs by their points"
            raise InputError(f"{words}; expected {way}, and a model made by train")


DESCRIPTION = """Names the markers of one or more takes. INPUT: camera blobs, a CSV file with the header
frame,camera,x,y and optionally area, which needs --cameras; 3D points, a .c3d, .trc, .tsv, Motive or Vicon .csv, whose
own names are not looked at; or a Qualisys .qtm, which holds blobs with their calibration, 3D points, or both. For INPUT
walk.csv, DIR gets walk.labels.csv, walk.c3d and walk.report.json."""
ENGINES = ("local", "dask")
METHODS_HELP = """fit: a body fitted to blobs, frame after frame; likelihood (also called evidence), and ensemble:
partial solvers, each frame on its own, blobs by way of the points that they make;
auto (default): the best for the input, fit for blobs and likelihood for points"""
OCCLUSION_HELP = """what asks whether the body hides a blob's marker: bvh casts rays at its meshes, which takes Blender;
capsules is the closed form; auto (default) is bvh inside Blender"""
LABEL_SWITCHES = {
    "mirror": "reverse an axis of 3D points whose axes are left-handed, so that left and right are exchanged in them",
    "blend": "also save DIR/walk.blend: armature, body, keyed markers",
    "html": "also write pages that show how it went, DIR/walk.report.html and, of several, DIR/summary.report.html",
    "trc": "also write DIR/walk.trc",
    "fill": "also fill the markers' gaps in DIR/walk.c3d (residual 0 there); labels stay what was seen",
    "resume": "pass over takes whose results are there, whole and made of the same files and options",
    "force": "name markers although something cannot be as it is, such as the take's room or its handedness",
    "summary": "also write DIR/summary.csv and DIR/summary.report.html, the worst take first, while the batch goes on",
    "watch": "label the takes in the folders INPUT, and those that arrive there, each once it is whole; Ctrl-C ends it",
}


def add_label_options(verbs) -> argparse.ArgumentParser:
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("label", help="name the markers of takes", description=DESCRIPTION)
    add = parser.add_argument
    add(
        "inputs",
        metavar="INPUT",
        nargs="+",
        type=Path,
        action=Takes,
        help="a take: blobs or 3D points; with --watch a folder",
    )
    add("--out", required=True, type=Path, metavar="DIR", help="the folder for the results")
    worn = "a built-in model (see models), a *.markerset.json file, or auto: the known one that the take shows"
    add_options(parser, "--model", help=worn)
    add_options(parser, "--rate", "--frames", "--up", "--plain", "--overwrite")
    folder = "of --model auto: the folder of your own marker sets (default: in Blender that of the preferences)"
    add("--models", dest="own", type=Path, metavar="FOLDER", help=folder)
    add_options(parser, "--cameras", **OWN_CAMERAS)
    add_subjects(parser)
    add("--use", choices=USES, help="what to label of a .qtm that holds both (default: blobs whose cameras are known)")
    add("--method", choices=METHODS, default="auto", help=METHODS_HELP)
    add("--occlusion", choices=OCCLUSIONS, default="auto", help=OCCLUSION_HELP)
    share = number(0.5, 0.999999, "share")
    right = f"the share of names that must be right; what is less sure in space is left out ({USUAL_TARGET:g})"
    add("--target", type=share, default=USUAL_TARGET, metavar="P", help=right)
    tall = number(*HEIGHTS_M, "height")
    add("--height", type=tall, metavar="M", help="the subject's height, a hint for the fitted body")
    faces = "where the subject faces at first, a hint: counter-clockwise from world +x, seen from above"
    add("--facing", type=number(-360, 360, "angle"), metavar="DEG", help=faces)
    corrected = "corrections of one take, in their order (default: walk.edits.json beside walk.csv, if it is there)"
    add("--edits", type=Path, metavar="FILE", help=corrected)
    add("--jobs", type=whole(1, 256, "number of jobs"), default=1, metavar="N", help="takes side by side")
    engines = "who works: this machine (local), or dask: the workers of --scheduler, or --jobs workers of its own here"
    add("--engine", choices=ENGINES, default="local", help=engines)
    add("--scheduler", metavar="ADDRESS", help="of --engine dask: where it is, such as tcp://farm:8786; see farm.md")
    idle = "with --watch, end when nothing has arrived for so long; 0 ends when all that is there is done"
    add("--idle", type=number(0, 1e9, "time"), metavar="SECONDS", help=idle)
    for name, words in LABEL_SWITCHES.items():
        add(f"--{name}", action="store_true", help=words)
    return parser


def as_job(arguments, path: Path) -> LabelJob:
    """The job of labelling one of the inputs."""
    facing = None if arguments.facing is None else math.radians(arguments.facing)
    known = {"source": path, "wearers": tuple(arguments.subject), "facing": facing}
    points = _of_points(arguments, path)
    known |= {"cameras": None} if points else told_by_capture(path, arguments.cameras, arguments.rate)
    return job_of(LabelJob, arguments, **known)


def _of_points(arguments, path: Path) -> bool:
    """Whether a take is one of points and not of blobs; InputError where it is neither."""
    points = holds_points(path, arguments.use)
    if not points:
        from ...io.blobs import check_header

        check_header(path)
    return points


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


def check(arguments) -> set[bool]:
    """Everything that can be known to be wrong before any work; raises InputError. Gives whether takes are of points.

    A take that is neither of points nor of blobs says so when it is its turn, and the others are labelled.
    """
    _check_inputs(arguments)
    kinds: dict[Path, bool] = {}
    for path in arguments.inputs:
        with suppress(InputError):
            kinds[path] = _of_points(arguments, path)
    check_rest(arguments)
    if arguments.edits is not None and len(arguments.inputs) > 1:
        words = f"--edits is of one take, and there are {len(arguments.inputs)}"
        raise InputError(f"{words}; expected one take, or files such as walk.edits.json beside the takes")
    takes = [as_job(arguments, path) for path in kinds]
    summary = summary_of(arguments)
    pages = [] if summary is None else summary.written
    written = [path for take in takes for path in take.written]
    keep_apart({*arguments.inputs, *(path for take in takes for path in take.read)}, written + pages)
    if summary is not None:
        summary.check(arguments.overwrite, arguments.resume)
    check_models(arguments)
    if arguments.cameras and False in kinds.values():  # once, and not for each of the takes
        open_cameras(arguments.cameras, arguments.up)
    return set(kinds.values())


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


def unused(arguments, kinds: set[bool], occlusion: str) -> list[str]:
    """What is given and makes no difference to some of the takes, a sentence each; they are labelled all the same.

    `kinds` is whether they are of points, `occlusion` what was given of that.
    """
    notes = []
    if arguments.scheduler is not None and arguments.jobs > 1:
        notes.append("--jobs is not looked at with --scheduler: its workers take as many takes as they have threads")
    if arguments.rate is not None and True in kinds:
        notes.append("--rate is not looked at for 3D points whose files say their own rate")
    if arguments.cameras is not None and True in kinds:
        notes.append("--cameras is not looked at for 3D points, which need no calibration")
    if occlusion != OCCLUSIONS[0] and True in kinds:
        notes.append("--occlusion is not looked at for 3D points: it is of what cameras see")
    if arguments.mirror and False in kinds:
        notes.append("--mirror is not looked at for blobs: what is mirrored of them is their images or calibration")
    hints = [f"--{name}" for name in ("height", "facing") if getattr(arguments, name) is not None]
    if hints:
        several = arguments.subjects != 1 or bool(arguments.subject)
        fitted = not several and plain_method(arguments.method) in ("auto", "fit")
        deaf = [kind for kind in sorted(kinds) if kind or not fitted]
        what = " and ".join("3D points" if kind else "blobs" for kind in deaf)
        verb = "is" if len(hints) == 1 else "are"
        if deaf:
            why = "of several subjects" if several else "that is for blobs and --method fit"
            notes.append(f"{' and '.join(hints)} {verb} not looked at for {what}: {why}")
    return notes


def _check_inputs(arguments):
    """Raises InputError where inputs are no files, or results would take each other's or an input's place."""
    stems: dict[str, Path] = {}
    for path in arguments.inputs:
        if path.is_dir():
            raise InputError("is a folder; expected takes, such as folder/*.c3d", path)
        # Windows and macOS keep walk.csv and Walk.csv in one place.
        other = stems.setdefault(path.stem.casefold(), path)
        if other is not path:
            words = f"would have the same results as {other}"
            raise InputError(f"{words}; expected different names, or a run with an --out for each folder", path)
