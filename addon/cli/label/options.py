# SPDX-License-Identifier: GPL-3.0-or-later
"""What `label` can be told."""

import argparse
from pathlib import Path

from ... import jobs
from ...io.qtm import USES
from ..arguments import a_model, add_frames, add_overwrite, add_own_cameras, add_up, number, whole
from .subjects import add_subjects

DESCRIPTION = """Names the markers of one or more takes. INPUT: camera blobs, a CSV file with the header
frame,camera,x,y and optionally area, which needs --cameras; 3D points, a .c3d, .trc or Motive .csv, whose own names are
not looked at; or a Qualisys .qtm, which holds blobs with their calibration, 3D points, or both. For INPUT walk.csv, DIR
gets walk.labels.csv, walk.c3d and walk.report.json."""
ENGINES = ("local", "dask")


def add_options(verbs) -> argparse.ArgumentParser:
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("label", help="name the markers of takes", description=DESCRIPTION)
    parser.add_argument(
        "inputs", metavar="INPUT", nargs="+", type=Path, help="a take: camera blobs or 3D points; with --watch a folder"
    )
    parser.add_argument("--model", type=a_model, help="a built-in model (see models) or a *.markerset.json file")
    add_subjects(parser)
    add_own_cameras(parser)
    parser.add_argument(
        "--use",
        choices=USES,
        help="what to label of a .qtm that holds both (default: blobs where their cameras are calibrated, else points)",
    )
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="the folder for the results")
    add_frames(parser)
    add_up(parser)
    parser.add_argument(
        "--mirror",
        action="store_true",
        help="reverse an axis of 3D points whose axes are left-handed, so that left and right are exchanged in them",
    )
    _add_naming(parser)
    parser.add_argument("--blend", action="store_true", help="also save DIR/walk.blend: armature, body, keyed markers")
    parser.add_argument(
        "--html",
        action="store_true",
        help="also write DIR/walk.report.html, a page that shows how the take was labelled, and, of several takes, "
        "DIR/summary.report.html over all of them",
    )
    parser.add_argument("--trc", action="store_true", help="also write DIR/walk.trc")
    parser.add_argument(
        "--fill",
        action="store_true",
        help="also fill the markers' gaps in DIR/walk.c3d (residual 0 there); labels stay what was seen",
    )
    parser.add_argument(
        "--jobs", type=whole(1, 256, "number of jobs"), default=1, metavar="N", help="takes side by side"
    )
    parser.add_argument(
        "--engine",
        choices=ENGINES,
        default="local",
        help="where takes are worked on: local (default) is this machine, dask the workers of --scheduler, or --jobs "
        "workers of dask's own on this machine",
    )
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="of --engine dask: where it is, such as tcp://farm:8786; see farm.md"
    )
    parser.add_argument(
        "--edits",
        type=Path,
        metavar="FILE",
        help="corrections of one take, applied in their order; without it those of walk.edits.json beside walk.csv, "
        "where that is there",
    )
    add_overwrite(parser)
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on with a batch that was stopped: takes whose results are there, whole and made of the same files "
        "and options, are passed over",
    )
    parser.add_argument(
        "--force",
        action="store_true",
        help="name markers although something of the take cannot be as it is, such as its room or its handedness",
    )
    _add_batch(parser)
    parser.add_argument("--result", type=Path, help=argparse.SUPPRESS)
    return parser


def _add_batch(parser: argparse.ArgumentParser):
    """What is for many takes."""
    parser.add_argument(
        "--summary",
        action="store_true",
        help="also write DIR/summary.csv, a table of the takes, the worst first, and the same as a page, "
        "DIR/summary.report.html; both while the batch goes on",
    )
    parser.add_argument(
        "--watch",
        action="store_true",
        help="label the takes in the folders INPUT, and those that still arrive there, each once it is whole; Ctrl-C "
        "ends it",
    )
    parser.add_argument(
        "--idle",
        type=number(0, 1e9, "time"),
        metavar="SECONDS",
        help="with --watch, end when nothing has arrived for so long; 0 ends when all that is there is done",
    )


def _add_naming(parser: argparse.ArgumentParser):
    """How names are found, and what may be known of the take."""
    parser.add_argument(
        "--method",
        choices=jobs.METHODS,
        default="auto",
        help="fit: a body fitted frame after frame; likelihood (also called evidence), and ensemble: partial solvers, "
        "each frame on its own, blobs by way of the points that they make; auto (default): the best for "
        "the input, fit for blobs and likelihood for points",
    )
    parser.add_argument(
        "--occlusion",
        choices=jobs.OCCLUSIONS,
        default="auto",
        help="of blobs, what asks whether the body hides a marker: bvh casts rays at its meshes, which takes Blender "
        "or the bpy package; capsules is the closed form; auto (default) is bvh inside Blender",
    )
    parser.add_argument(
        "--target",
        type=number(0.5, 0.999999, "share"),
        default=jobs.USUAL_TARGET,
        metavar="P",
        help="of points: the share of labels that must be right; less sure ones are left out "
        f"(default {jobs.USUAL_TARGET:g})",
    )
    parser.add_argument(
        "--rate",
        type=number(0.1, 100_000, "rate"),
        metavar="HZ",
        help=f"frames a second, which a blob file does not say (default {jobs.USUAL_RATE:g}, and the report says so); "
        "files of 3D points do, or else it is used for them too",
    )
    parser.add_argument(
        "--height",
        type=number(0.3, 3, "height"),
        metavar="M",
        help="the subject's height, if known; like --facing a hint for the fitted body",
    )
    parser.add_argument(
        "--facing",
        type=number(-360, 360, "angle"),
        metavar="DEG",
        help="where the subject faces at first, if known: counter-clockwise from world +x, seen from above",
    )
