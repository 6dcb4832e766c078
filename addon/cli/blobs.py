# SPDX-License-Identifier: GPL-3.0-or-later
"""`blobs PICTURES…`: the blobs that movies or image sequences of calibrated cameras show."""

import os
from pathlib import Path

from ..blendfile import open_cameras, silenced
from ..core.data.errors import InputError
from ..core.data.wording import count_of, words_of_frames
from ..core.pictures.spots import SpotOptions
from ..io.cameras import calibration_files
from ..io.whole import check_targets
from ..jobs.pictures import FIRST_PIXEL, PicturesJob, blobs_of_pictures, first_pixel_of, pictures_by_camera
from .arguments import add_options, job_of, number
from .console import ProgressLine, print_results

DESCRIPTION = """Finds bright round spots, as of markers that are lit, in movies or image sequences of calibrated
cameras that ran together, and writes them as a file of blobs. Blender reads the pictures. Which camera took them is
said as CAMERA=PICTURES, or by its name in that of the file or folder. A movie's first frame is 1; pictures of a
sequence have the numbers in their names."""
DEFAULT_SPOTS = SpotOptions()


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("blobs", help="blobs from movies and image sequences", description=DESCRIPTION)
    parser.add_argument(
        "pictures",
        metavar="[CAMERA=]PICTURES",
        nargs="+",
        help="a camera's movie, its folder of numbered pictures, or one of these",
    )
    parser.add_argument("--out", required=True, type=Path, metavar="BLOBS", help="the blob file to write")
    add_options(parser, "--cameras", "--frames", "--up", "--overwrite")
    parser.add_argument(
        "--first-pixel",
        choices=list(FIRST_PIXEL),
        help="where (0, 0) of the calibration's pixels is: the centre of the first pixel, as in OpenCV (default), or "
        "its upper left corner, as in Blender (default for the cameras of a .blend)",
    )
    _add_spots(parser)
    parser.set_defaults(run=run)


def _add_spots(parser):
    """What is a spot."""
    group = parser.add_argument_group("what is a spot")
    share, area = number(0, 1, "share"), number(0, 1e6, "area")
    group.add_argument(
        "--threshold", type=share, metavar="B", help="brighter than this, 0 to 1 (default: the pictures tell)"
    )
    rows = (
        ("--min-area", "min_area", area, "PX2", "smaller spots are left out"),
        ("--max-area", "max_area", area, "PX2", "larger ones are left out"),
        ("--min-roundness", "min_roundness", share, "R", "shortest over longest diameter; longer ones are left out"),
    )
    for flag, name, kind, unit, text in rows:
        default = getattr(DEFAULT_SPOTS, name)
        group.add_argument(flag, type=kind, default=default, metavar=unit, help=f"{text} (default {default:g})")


def run(arguments) -> int:
    """Finds the blobs of one take."""
    check_targets([arguments.out], arguments.overwrite, calibration_files(arguments.cameras))
    cameras = open_cameras(arguments.cameras, arguments.up)
    job = job_of(
        PicturesJob,
        arguments,
        pictures=pictures_by_camera([_of_camera(text, cameras.names) for text in arguments.pictures], cameras.names),
        cameras=cameras,
        first_pixel=arguments.first_pixel or first_pixel_of(arguments.cameras),
        spots=job_of(SpotOptions, arguments),
        up=None,  # the cameras are read
    )
    with silenced():
        result = ProgressLine(arguments.progress).drain(blobs_of_pictures(job), job.out.stem)
    print_results(_lines(result), result, arguments.json)
    return 0


def _of_camera(text: str, names: tuple[str, ...]) -> tuple[str | None, Path]:
    """Camera and path of an argument; a path that is there may have an = in it."""
    camera, equals, path = text.partition("=")
    alone = not equals or (camera not in names and os.path.lexists(text))
    if not (text if alone else path):
        raise InputError(f"{text!r} names no pictures; expected a movie or a folder of numbered pictures")
    return (None, Path(text)) if alone else (camera, Path(path))


def _lines(result: dict) -> list[str]:
    """What is said to people."""
    width = max(map(len, result["cameras"]))
    rows = [
        f"{name:{width}}  {count_of(row['blobs'], 'blob')} in {row['pictures']}, brighter than {row['threshold']:.2f}"
        for name, row in result["cameras"].items()
    ]
    rate = "" if result["rate"] is None else f", {result['rate']:g} frames a second (label with --rate)"
    frames = words_of_frames(result["first_frame"], result["first_frame"] + result["frames"] - 1)
    done = f"{count_of(result['blobs'], 'blob')} in {frames}{rate}; {result['seconds']:.1f} s"
    return [*rows, *result["notes"], *result.get("calibration", []), f"{result['out']}: {done}"]
