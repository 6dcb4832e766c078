# SPDX-License-Identifier: GPL-3.0-or-later
"""`refine BLOBS`: a calibration refined by the blobs of a take."""

from pathlib import Path

from ..core.data.wording import count_of
from ..jobs.job import told_by_capture
from ..jobs.refine import RefineJob, refine_file
from .arguments import OWN_CAMERAS, add_options, job_of
from .console import ProgressLine, print_results

DESCRIPTION = """Moves and turns the cameras so that the take's own labelled blobs meet, as when a camera was bumped
after the calibration. Lenses and focal lengths stay; so do scale, floor and axes of the room, which the cameras hold
that did not move. Prints each camera's reprojection error before and after, in px, of blobs that nothing was fitted
to."""


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("refine", help="refine a calibration by a take", description=DESCRIPTION)
    parser.add_argument("source", metavar="BLOBS", type=Path, help="a file of blobs, .csv or .qtm")
    parser.add_argument("--out", required=True, type=Path, metavar="FILE.toml", help="the calibration to write")
    add_options(parser, "--cameras", **OWN_CAMERAS)
    add_options(parser, "--model", required=True)
    add_options(parser, "--rate", "--frames", "--up", "--overwrite")
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Refines one calibration."""
    job = job_of(RefineJob, arguments, **told_by_capture(arguments.source, arguments.cameras, arguments.rate))
    report, _ = ProgressLine(arguments.progress).drain(refine_file(job), job.source.stem)
    print_results(_lines(report), report, arguments.json)
    return 0


def _lines(report: dict) -> list[str]:
    """What is said to people."""
    width = max(map(len, report["cameras"]))
    lines = [f"{name:{width}}  {_of_camera(row)}" for name, row in report["cameras"].items()]
    done = f"{count_of(report['rounds'], 'round')} of {count_of(report['frames_labelled'], 'frame')}"
    last = "refined" if report["refined"] else "nothing to refine, the cameras are written as they were"
    return [
        *lines,
        *report["camera_doubts"],
        *report.get("calibration", []),
        *report.get("capture", []),
        f"{report['out']}: {last}; {done}, {report['seconds']:.1f} s",
    ]


def _of_camera(row: dict) -> str:
    if row["before_px"] is None or row["after_px"] is None:
        return "no blobs to tell its error by"
    words = f"{row['before_px']:.2f} px before, {row['after_px']:.2f} px after"
    if row["shifted_mm"] or row["turned_deg"]:
        words += f", moved {row['shifted_mm']:.1f} mm and turned {row['turned_deg']:.2f}°"
    return words
