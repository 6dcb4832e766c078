# SPDX-License-Identifier: GPL-3.0-or-later
"""`reconstruct BLOBS`: unnamed 3D points from unnamed blobs."""

from pathlib import Path

from ..core.data.wording import count_of
from ..jobs.job import told_by_capture
from ..jobs.rebuild import RebuildJob, rebuild_file
from .arguments import OWN_CAMERAS, add_options, job_of
from .console import not_in_c3d, report_work

DESCRIPTION = """Finds the points in space that the unnamed blobs of several cameras show, and joins them into unnamed
trajectories *1, *2, … with gaps: what `label` takes when only 3D points are known. Residuals are in the file."""


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("reconstruct", help="3D points from blobs", description=DESCRIPTION)
    parser.add_argument("source", metavar="BLOBS", type=Path, help="a file of blobs, .csv or .qtm")
    parser.add_argument("--out", required=True, type=Path, metavar="FILE", help="the .c3d (or .trc) to write")
    add_options(parser, "--cameras", **OWN_CAMERAS)
    add_options(parser, "--rate", "--frames", "--up", "--overwrite")
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Reconstructs one take."""
    job = job_of(RebuildJob, arguments, **told_by_capture(arguments.source, arguments.cameras, arguments.rate))
    return report_work(arguments, rebuild_file(job), job.source.stem, _lines)


def _lines(result: dict) -> list[str]:
    """What is said to people."""
    frames = max(result["frames"], 1)
    many = f"{result['points'] / frames:.1f} points a frame in {count_of(result['trajectories'], 'trajectory')}"
    explained = f"{result['blobs_explained']:,} of {count_of(result['blobs'], 'blob')} explained"
    well = f"residual {result['residual_mm']:.2f} mm, noise {result['noise_px']:.2f} px"
    pace = f"{result['frames'] / max(result['seconds'], 1e-9):.0f} frames/s"
    lines = [f"{result['out']}: {count_of(result['frames'], 'frame')}, {many}", f"{explained}, {well}, {pace}"]
    return [*lines, *not_in_c3d(result), *result.get("calibration", []), *result.get("capture", [])]
