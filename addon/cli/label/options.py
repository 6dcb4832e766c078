# SPDX-License-Identifier: GPL-3.0-or-later
"""What `label` can be told, and who is in the takes."""

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

from ... import jobs
from ...core.data.errors import InputError
from ...core.points.several.wearers import (
    AUTO,
    MAX_SUBJECTS,
    NAME_RULE,
    as_compared,
    is_subject_name,
)
from ...io.models import open_model
from ...io.qtm.capture import USES
from ..arguments import OWN_CAMERAS, add_options, number, whole


def add_subjects(parser: argparse.ArgumentParser):
    """`--subjects N|auto` and `--subject NAME=MODEL`."""
    parser.add_argument(
        "--subjects",
        type=_count,
        metavar="N|auto",
        help="how many wear the model, auto for as many as there are (default 1); markers are then "
        "called 1:LASI, 2:LASI",
    )
    parser.add_argument(
        "--subject",
        type=_wearer,
        action="append",
        metavar="NAME=MODEL",
        help="who wears what, once for each subject and instead of --model; markers are then called NAME:LASI",
    )


def _count(text: str) -> int:
    if text == "auto":
        return AUTO
    if not re.fullmatch(r"[1-9]", text, re.ASCII) or int(text) > MAX_SUBJECTS:
        words = f"{text[:60]!r} is no number of subjects"
        raise argparse.ArgumentTypeError(f"{words}; expected a whole number from 1 to {MAX_SUBJECTS}, or auto")
    return int(text)


def _wearer(text: str) -> tuple[str, str]:
    name, equals, model = text.partition("=")
    if not equals or not name or not model:
        words = f"{text[:60]!r} says not who wears what"
        raise argparse.ArgumentTypeError(f"{words}; expected NAME=MODEL, such as ann=body26")
    if not is_subject_name(name):
        raise argparse.ArgumentTypeError(f"{name[:60]!r} is no name of a subject; {NAME_RULE}")
    return name, model


def settle_subjects(arguments):
    """Settles what the arguments leave open; InputError where they contradict each other."""
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
        raise InputError("nothing says what is worn; expected --model MODEL, or --subject NAME=MODEL for each subject")
    arguments.model = arguments.model or arguments.subject[0][1]
    arguments.subjects = 1 if arguments.subjects is None else arguments.subjects


def check_models(arguments):
    """Raises InputError where a model is not there, or is none for several subjects."""
    from ...core.points.naming import chosen_method, plain_method

    open_model(arguments.model)
    if arguments.subjects == 1 and not arguments.subject:
        return
    for name in dict.fromkeys([arguments.model, *(worn for _, worn in arguments.subject)]):
        if plain_method(arguments.method) == "fit" or chosen_method(open_model(name), arguments.method) != "likelihood":
            words = f"several subjects need a model that names by likelihood, and {name} is not asked to"
            way = "--method auto, which names blobs by their points"
            raise InputError(f"{words}; expected {way}, and a model made by train")


def subject_words(model: str, subjects: int, wearers: Sequence[tuple[str, str]]) -> list[str]:
    """Who is asked for, said as in a job, as words of a command line."""
    if wearers:
        return [f"--subject={name}={worn}" for name, worn in wearers]
    words = [f"--model={model}"]
    if subjects != 1:
        words.append(f"--subjects={'auto' if subjects == AUTO else subjects}")
    return words


DESCRIPTION = """Names the markers of one or more takes. INPUT: camera blobs, a CSV file with the header
frame,camera,x,y and optionally area, which needs --cameras; 3D points, a .c3d, .trc or Motive .csv, whose own names are
not looked at; or a Qualisys .qtm, which holds blobs with their calibration, 3D points, or both. For INPUT walk.csv, DIR
gets walk.labels.csv, walk.c3d and walk.report.json."""
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
    add("inputs", metavar="INPUT", nargs="+", type=Path, help="a take: blobs or 3D points; with --watch a folder")
    add("--out", required=True, type=Path, metavar="DIR", help="the folder for the results")
    add_options(parser, "--model", "--rate", "--frames", "--up", "--overwrite")
    add_options(parser, "--cameras", **OWN_CAMERAS)
    add_subjects(parser)
    add("--use", choices=USES, help="what to label of a .qtm that holds both (default: blobs whose cameras are known)")
    add("--method", choices=jobs.METHODS, default="auto", help=METHODS_HELP)
    add("--occlusion", choices=jobs.OCCLUSIONS, default="auto", help=OCCLUSION_HELP)
    share = number(0.5, 0.999999, "share")
    right = f"of points, the share of labels that must be right; what is less sure is left out ({jobs.USUAL_TARGET:g})"
    add("--target", type=share, default=jobs.USUAL_TARGET, metavar="P", help=right)
    add("--height", type=number(0.3, 3, "height"), metavar="M", help="the subject's height, a hint for the fitted body")
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
    add("--result", type=Path, help=argparse.SUPPRESS)
    return parser
