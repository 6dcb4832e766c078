# SPDX-License-Identifier: GPL-3.0-or-later
"""`simulate TAKE`: what cameras would see of a labelled take with a body in the way."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from .. import capturing
from ..blendfile import open_cameras
from ..core.data.errors import of_file
from ..core.data.markersets import MarkerSet
from ..core.data.takes import Points
from ..core.data.wording import count_of
from ..core.geometry.camera_up import AXIS_NAMES
from ..core.simulation.simulate import CaptureOptions
from ..io.cameras import calibration_files
from ..io.markersets import builtin_markersets, markerset_file, open_markerset
from ..io.points import read_points
from ..io.whole import keep_apart
from .arguments import add_options, job_of, number, whole
from .console import ProgressLine, print_results

DESCRIPTION = """A virtual capture of a labelled take (.c3d, .trc or .tsv): what the cameras would see, with a body in
the way, noise, merged blobs, dropouts and ghosts. Of several subjects, whose markers are NAME:LASI …, all are captured,
with all bodies in the way. Writes the blobs to BLOBS and their true names to BLOBS.truth.csv (the whole name with
.truth.csv behind it). Frames keep the take's numbers."""
DEFAULTS = CaptureOptions()


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("simulate", help="make blobs from a labelled take", description=DESCRIPTION)
    parser.add_argument("take", metavar="TAKE", type=Path, help="a labelled take: .c3d, .trc or .tsv")
    parser.add_argument("--out", required=True, type=Path, metavar="BLOBS", help="the blob file to write")
    add_options(parser, "--model", help="whose body is in the way; default: the built-in model whose markers are there")
    add_options(parser, "--cameras", "--frames", "--up", "--rate", "--overwrite")
    parser.add_argument("--cameras-up", choices=AXIS_NAMES, help="the same as --up of the calibration")
    parser.add_argument("--centre", action="store_true", help="move the take's path to the middle of the room")
    _add_trouble(parser)
    parser.set_defaults(run=run)


def _add_trouble(parser):
    """What goes wrong in the capture."""
    group = parser.add_argument_group("what goes wrong")
    amount = number(0, 1000, "amount")
    share = number(0, 1, "share")
    rows = (
        ("--noise", "noise", amount, "PX", "standard deviation of a blob's place"),
        ("--dropout", "dropout", share, "P", "probability that a visible marker gives no blob"),
        ("--ghosts", "reflections", whole(0, 10_000, "number of ghosts"), "N", "fixed reflections in each camera"),
        ("--flicker", "flicker", amount, "N", "mean number of ghosts at random places, a camera and frame"),
        ("--merge-gap", "merge_gap", number(-100, 100, "distance"), "PX", "blobs nearer than this become one"),
        ("--calibration-mm", "calibration_mm", amount, "MM", "cameras stand this far from where they are said to"),
        ("--calibration-mrad", "calibration_mrad", amount, "MRAD", "and are turned by this"),
        ("--seed", "seed", whole(0, 2**31 - 1, "seed"), "N", "the same seed gives the same blobs"),
    )
    for flag, field, kind, unit, text in rows:
        default = getattr(DEFAULTS, field)
        group.add_argument(
            flag, dest=field, type=kind, default=default, metavar=unit, help=f"{text} (default {default:g})"
        )
    sits, radius = "markers sit up to this far off (default 0)", number(0.1, 100, "radius")
    group.add_argument("--marker-offset", type=amount, default=0.0, metavar="MM", help=sits)
    group.add_argument("--marker-radius", type=radius, default=7.0, metavar="MM", help="of its ball (default 7)")


def run(arguments) -> int:
    """Captures the take and writes both files."""
    models = [markerset_file(arguments.model)] if arguments.model else []
    read = [arguments.take, *calibration_files(arguments.cameras), *models]
    keep_apart(read, [arguments.out, capturing.truth_path(arguments.out)])
    cameras = open_cameras(arguments.cameras, arguments.cameras_up)
    known = [open_markerset(name) for name in ([arguments.model] if arguments.model else builtin_markersets())]
    progress = ProgressLine(arguments.progress)
    with of_file(arguments.take):
        points = read_points(arguments.take, frames=arguments.frames, up=arguments.up, rate=arguments.rate)
        take = capturing.labelled_markers(points)
        take = capturing.centred(take, cameras) if arguments.centre else take
        sets, markers, body = _who_is_captured(take, known, arguments.model is not None)
        work = capturing.write_capture(
            markers, cameras, _options(arguments), body, arguments.out, arguments.overwrite, read
        )
        captured = progress.drain(work, arguments.take.stem)
    result = {
        "take": arguments.take.stem,
        "model": ", ".join(dict.fromkeys(sets)),
        "markers": list(markers.names),
        "cameras": list(cameras.names),
        "first_frame": markers.first_frame,
        **asdict(captured),
        "up_axis": points.up,
        "notes": list(points.notes),
        "out": [str(arguments.out), str(capturing.truth_path(arguments.out))],
    }
    if cameras.remarks:
        result["calibration"] = list(cameras.remarks)
    way = f", {f'{len(sets)} bodies' if len(sets) > 1 else 'the body'} of {result['model']} in the way"
    what = f"{count_of(captured.blobs, 'blob')} of {count_of(len(markers.names), 'marker')}"
    where = f"{count_of(captured.frames, 'frame')}, {count_of(len(cameras), 'camera')}"
    spoilt = f"{count_of(captured.ghosts, 'ghost')}, {count_of(captured.merged, 'merged blob')}"
    lines = [
        f"{arguments.out}: {what} in {where}{way}",
        f"{capturing.truth_path(arguments.out)}: {spoilt}",
        *cameras.remarks,
        *(f"{arguments.take.name}: {note}" for note in points.notes),
    ]
    print_results(lines, result, arguments.json)
    return 0


def _who_is_captured(take: Points, sets: Sequence[MarkerSet], given: bool):
    """Names of the marker sets, the take with only their markers, and all bodies in the way."""
    own = [(name, capturing.of_subject(take, name)) for name in capturing.subjects_in(take)]
    own = [(name, one) for name, one in own if any(capturing.wears(one, markerset) for markerset in sets)]
    parts, worn = [], []
    for name, one in own if len(own) > 1 else [("", take)]:
        worn.append(sets[0] if given else capturing.fitting_markerset(one, sets))
        parts.append((name, *capturing.worn_in(one, worn[-1])))
    markers, body = capturing.together(parts) if len(parts) > 1 else parts[0][1:]
    return [one.name for one in worn], markers, body


def _options(arguments) -> CaptureOptions:
    lengths = {name: getattr(arguments, name) / 1000 for name in ("marker_offset", "marker_radius")}  # mm
    return job_of(CaptureOptions, arguments, **lengths)
