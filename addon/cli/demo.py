# SPDX-License-Identifier: GPL-3.0-or-later
"""`demo`: the whole job on a take that the project makes by itself, with figures, a `.blend` and a picture."""

from pathlib import Path

from .. import capturing, jobs
from ..blendfile import has_blender
from ..core.evaluation.figures import Figures
from ..demo import take as demo_take
from ..demo.picture import best_shot, draw
from ..io.cameras import write_cameras
from ..io.markersets import open_markerset
from ..io.whole import check_targets, whole_file
from ..jobs.job import PAGE
from .arguments import add_options
from .console import ProgressLine, print_results
from .evaluate import as_lines, as_result, compare, percent

DESCRIPTION = """Labels a take that the project makes by itself: a virtual person in a virtual room of eight cameras,
with noise, occlusion, merged blobs and ghosts. Prints how right the labels are, and writes everything to DIR: the
room, the blobs and their truth, the labels, the labelled take, its report, a Blender file and a picture."""
NAME = "walk"
NO_BLENDER = "Blender is not here, so there is no .blend; the bpy package or Blender itself makes it."


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("demo", help="label the project's own take", description=DESCRIPTION)
    parser.add_argument(
        "--out", type=Path, default=Path("mocap-autolabel-demo"), metavar="DIR", help="default: mocap-autolabel-demo"
    )
    add_options(parser, "--overwrite")
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Makes, labels, scores and shows the take."""
    out, progress = arguments.out, ProgressLine(arguments.progress)
    blobs, room, picture = out / f"{NAME}.csv", out / "room.toml", out / f"{NAME}.svg"
    job = jobs.LabelJob(
        blobs,
        room,
        demo_take.MODEL,
        out,
        rate=demo_take.STAGE_RATE,
        trc=True,
        blend=has_blender(),
        html=True,
        overwrite=arguments.overwrite,
        keep=True,
    )
    targets = [room, blobs, capturing.truth_path(blobs), *job.written, picture]
    check_targets(targets, arguments.overwrite)
    markerset = open_markerset(demo_take.MODEL)
    performance = demo_take.make_performance(markerset)
    with whole_file(room, arguments.overwrite) as temporary:
        write_cameras(temporary, performance.cameras)
    work = capturing.write_capture(
        performance.take, performance.cameras, demo_take.TROUBLE, performance.body, blobs, arguments.overwrite
    )
    captured = progress.drain(work, "capture")
    labelled = progress.drain(jobs.label_file(job), "label")
    figures = Figures(markerset.markers, markerset.aliases)
    agreement = compare(job.path(".labels.csv"), capturing.truth_path(blobs), figures)
    result = {"figures": as_result(agreement), "report": labelled.report, "out": str(out)}
    seen = f"{captured.frames} frames of a virtual person, seen by {len(performance.cameras)} cameras"
    lines = [
        f"{seen}: {captured.blobs} blobs, {captured.ghosts} of them ghosts, {captured.merged} merged",
        *as_lines(agreement),
        f"speed               {labelled.report['timing']['frames_per_second']:9.0f}   frames a second",
        f"report              {job.path(PAGE)}",
    ]
    _draw(picture, performance, labelled.worn, labelled, agreement, arguments.overwrite)
    result["picture"] = str(picture)
    lines.append(f"picture             {picture}")
    if has_blender():
        result["blend"] = str(job.path(".blend"))
        lines.append(f"Blender file        {job.path('.blend')}")
    else:
        result["note"] = NO_BLENDER
        lines.append(NO_BLENDER)
    print_results(lines, result, arguments.json)
    return 0


def _draw(path: Path, performance, markerset, labelled: jobs.Labelled, agreement, overwrite: bool):
    """The picture of the take's widest step."""
    frame, shot = best_shot(performance.cameras, markerset, labelled.chunks)
    figures = agreement.figures.as_dict()
    title = "Mocap Autolabel"
    subtitle = (
        f"{markerset.name}, {len(performance.cameras)} cameras, frame {frame} of {figures['frames']}.   "
        f"In all frames: precision {percent(figures['precision']).strip()}, recall {percent(figures['recall']).strip()}"
    )
    with whole_file(path, overwrite) as temporary:
        draw(shot, title, subtitle, temporary)
