# SPDX-License-Identifier: GPL-3.0-or-later
"""`reconstruct BLOBS`: unnamed 3D points from unnamed blobs."""

from pathlib import Path

from ..jobs.captures import blob_rate, calibration_for
from ..jobs.rebuild import RebuildJob, rebuild_file
from .arguments import add_blob_rate, add_frames, add_overwrite, add_own_cameras, add_up
from .console import ProgressLine, print_results

DESCRIPTION = """Finds the points in space that the unnamed blobs of several cameras show, and joins them into unnamed
trajectories *1, *2, … with gaps: what `label` takes when only 3D points are known. Residuals are in the file."""


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("reconstruct", help="3D points from blobs", description=DESCRIPTION)
    parser.add_argument("blobs", metavar="BLOBS", type=Path, help="a file of blobs, .csv or .qtm")
    add_own_cameras(parser)
    parser.add_argument("--out", required=True, type=Path, metavar="FILE", help="the .c3d (or .trc) to write")
    add_blob_rate(parser)
    add_frames(parser)
    add_up(parser)
    add_overwrite(parser)
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Reconstructs one take."""
    job = RebuildJob(
        arguments.blobs,
        calibration_for(arguments.blobs, arguments.cameras),
        arguments.out,
        arguments.frames,
        blob_rate(arguments.blobs, arguments.rate),
        arguments.overwrite,
        arguments.up,
    )
    result = ProgressLine(arguments.progress).drain(rebuild_file(job), arguments.blobs.stem)
    frames = max(result["frames"], 1)
    many = f"{result['points'] / frames:.1f} points a frame in {result['trajectories']} trajectories"
    explained = f"{result['blobs_explained']} of {result['blobs']} blobs explained"
    well = f"residual {result['residual_mm']:.2f} mm, noise {result['noise_px']:.2f} px"
    pace = f"{result['frames'] / max(result['seconds'], 1e-9):.0f} frames/s"
    lines = [f"{result['out']}: {result['frames']} frames, {many}", f"{explained}, {well}, {pace}"]
    if "c3d_first_frame" in result:
        lines.append("the first frame is negative, which a .c3d cannot say: its frames are numbered from 0")
    lines += [*result.get("calibration", []), *result.get("capture", [])]
    print_results(lines, result, arguments.json)
    return 0
