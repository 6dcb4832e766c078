# SPDX-License-Identifier: GPL-3.0-or-later
"""`label INPUT…`: names the markers of one or more takes."""

import argparse
import json
import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from pathlib import Path

from .. import jobs
from ..blendfile import has_blender, open_cameras
from ..core.data.errors import InputError, UserError
from ..io.blobs import check_header
from ..io.edits import edits_beside, open_edits
from ..io.models import open_model
from ..io.points import holds_points
from ..io.scratch import naming_scratch
from ..io.whole import finish_renaming, keep_apart
from ..jobs.pages import check_folder_page, folder_page_path, write_takes_page
from ..jobs.resuming import results_of
from .arguments import add_frames, add_overwrite, add_up, number, whole
from .console import ProgressLine, complain, print_results
from .failures import of_take
from .workers import end_with_parent, side_by_side

DESCRIPTION = """Names the markers of one or more takes. INPUT: camera blobs, a CSV file with the header
frame,camera,x,y and optionally area, which needs --cameras; or 3D points, a .c3d, .trc or Motive .csv, whose own names
are not looked at. For INPUT walk.csv, DIR gets walk.labels.csv, walk.c3d and walk.report.json."""


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("label", help="name the markers of takes", description=DESCRIPTION)
    parser.add_argument("inputs", metavar="INPUT", nargs="+", type=Path, help="a take: camera blobs or 3D points")
    parser.add_argument("--model", required=True, help="a built-in model (see models) or a *.markerset.json file")
    parser.add_argument("--cameras", type=Path, metavar="CAMERAS", help="the calibration; blobs need it")
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="the folder for the results")
    add_frames(parser)
    add_up(parser)
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
    parser.add_argument("--result", type=Path, help=argparse.SUPPRESS)
    parser.set_defaults(run=run)


def _add_naming(parser: argparse.ArgumentParser):
    """How names are found, and what may be known of the take."""
    parser.add_argument(
        "--method",
        choices=jobs.METHODS,
        default="auto",
        help="fit: a body fitted frame after frame; likelihood (also called evidence), and ensemble: partial solvers, "
        "each frame on its own, blobs by way of the points that they make; both: blobs by fit, checked by their "
        "points; auto (default): the best for the input, fit for blobs and likelihood for points",
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


def run(arguments) -> int:
    """Labels every take; one that fails does not stop the others."""
    # Once for all takes and processes: the first may bring Blender in.
    arguments.occlusion = jobs.occlusion_here(arguments.occlusion)
    check(arguments)
    if arguments.result:
        end_with_parent()
    else:  # whoever started this process side by side with others has said it already
        for words in (*unused(arguments), *_edited_beside(arguments)):
            complain(words)
    reports, failures, passed = [], [], set()
    progress = ProgressLine(arguments.progress)
    for path, answer in _answers(arguments, progress, passed):
        if isinstance(answer, UserError):
            failures.append((path, answer))
            progress.tell(f"{path.name}: failed", at_once=len(arguments.inputs) > 1)
        else:
            reports.append(answer)
    progress.clear()
    reports.sort(key=lambda report: [path.stem for path in arguments.inputs].index(report["take"]))
    failed = [{"take": path.stem, "status": error.exit_status, "reason": str(error)} for path, error in failures]
    folder = None
    try:
        folder = _write_folder_page(arguments, reports, failures)
    except UserError as error:  # the takes are there all the same
        failures.append((arguments.out, error))
    if arguments.result and not failures:
        with naming_scratch(arguments.result.parent):
            arguments.result.write_text(json.dumps(reports[0]), encoding="utf-8")
    if reports or arguments.json:
        lines = [line for report in reports for line in (_line_of(report, passed), *_doubts(report))]
        result = {"takes": reports, "failed": failed} | ({"passed_over": sorted(passed)} if arguments.resume else {})
        if folder is not None:
            lines.append(f"over all takes: {folder}")
            result["summary"] = str(folder)
        print_results(lines, result, arguments.json)
    for _, error in failures:
        complain(error)
    return max((error.exit_status for _, error in failures), default=0)


def _folder_page(arguments) -> Path | None:
    """The page over all takes; None where none is wanted, or there is one take only."""
    if not arguments.html or len(arguments.inputs) < 2:
        return None
    return folder_page_path(arguments.out, [path.stem for path in arguments.inputs])


def _write_folder_page(arguments, reports: list[dict], failures: list[tuple[Path, UserError]]) -> Path | None:
    """Writes the page over all takes, where one is wanted and there is a take to link to, and gives where it is."""
    page = _folder_page(arguments)
    if page is None or not reports:
        return None
    # Whoever gets the page has no use for where the takes lie.
    write_takes_page(page, reports, [(path.stem, str(error).replace(str(path), path.name)) for path, error in failures])
    return page


def check(arguments):
    """Everything that can be known to be wrong before any work; raises InputError."""
    _check_inputs(arguments)
    blobs = [path for path in arguments.inputs if not holds_points(path)]
    if arguments.cameras is None and blobs:
        check_header(blobs[0])  # what holds no blobs needs no cameras
        raise InputError(
            "holds blobs, and the argument --cameras is missing; expected the calibration of their cameras", blobs[0]
        )
    if arguments.blend and not has_blender():
        raise InputError("--blend needs Blender or the bpy package, and neither is here; expected one of them")
    if arguments.out.exists() and not arguments.out.is_dir():
        raise InputError("is no folder; expected a folder for the results", arguments.out)
    if arguments.edits is not None and len(arguments.inputs) > 1:
        words = f"--edits is of one take, and there are {len(arguments.inputs)}"
        raise InputError(f"{words}; expected one take, or files such as walk.edits.json beside the takes")
    takes = [as_job(arguments, path) for path in arguments.inputs]
    page = _folder_page(arguments)
    pages = [] if page is None else [page]
    written = [path for take in takes for path in take.written]
    keep_apart({path for take in takes for path in take.read}, written + pages)
    if page is not None:
        check_folder_page(page, arguments.overwrite, arguments.resume)
    model = open_model(arguments.model)
    cameras = open_cameras(arguments.cameras, arguments.up) if blobs else None
    if len(takes) == 1:  # of many each is told on its own, and the others are labelled
        [take] = takes
        open_edits(take.edits_applied, take.source, model.markerset, cameras=cameras and cameras.names)


def _edited_beside(arguments) -> list[str]:
    """Which takes are labelled with edits that nobody named, a sentence each."""
    if arguments.edits is not None:
        return []
    found = [(path, edits_beside(path)) for path in arguments.inputs]
    return [f"{path}: the edits of {edits.name} beside it are applied" for path, edits in found if edits is not None]


def unused(arguments) -> list[str]:
    """What is given and makes no difference to some of the takes, a sentence each; they are labelled all the same."""
    kinds = {holds_points(path) for path in arguments.inputs}
    said = []
    if arguments.rate is not None and True in kinds:
        said.append("--rate is not looked at for 3D points whose files say their own rate")
    hints = [f"--{name}" for name in ("height", "facing") if getattr(arguments, name) is not None]
    if hints:
        deaf = [kind for kind in sorted(kinds) if not _fits(arguments, kind)]
        what = " and ".join("3D points" if kind else "blobs" for kind in deaf)
        verb = "is" if len(hints) == 1 else "are"
        if deaf:
            said.append(f"{' and '.join(hints)} {verb} not looked at for {what}: that needs --method fit here")
    return said


def _fits(arguments, points: bool) -> bool:
    """Whether takes of 3D points, or of blobs, are named by a body that is fitted to them, which takes hints."""
    if arguments.method != "auto" or not points:
        return arguments.method in ("auto", "fit", "both")
    from ..core.points.naming import chosen_method

    return chosen_method(open_model(arguments.model), "auto") == "fit"


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


def as_job(arguments, path: Path) -> jobs.LabelJob:
    """The job of labelling one of the inputs."""
    return jobs.LabelJob(
        source=path,
        cameras=arguments.cameras,
        model=arguments.model,
        out=arguments.out,
        method=arguments.method,
        target=arguments.target,
        frames=arguments.frames,
        up=arguments.up,
        rate=arguments.rate,
        height=arguments.height,
        occlusion=arguments.occlusion,
        facing=None if arguments.facing is None else math.radians(arguments.facing),
        edits=arguments.edits,
        trc=arguments.trc,
        fill=arguments.fill,
        blend=arguments.blend,
        html=arguments.html,
        overwrite=arguments.overwrite,
        resume=arguments.resume,
    )


def _doubts(report: dict) -> list[str]:
    """What is odd about the cameras of a take, and which edits found nothing, a line each."""
    missed = [
        f"edit {one['edit']} ({one['kind']}) found nothing: {one['reason']}"
        for one in report.get("edits", {}).get("found_nothing", [])
    ]
    return [f"{report['take']}: {words}" for words in (*report.get("camera_doubts", []), *missed)]


def as_line(report: dict) -> str:
    """One take's result as a line for people."""
    things = "points" if "points" in report else "blobs"
    count, named = report[things], report[things] - report["unlabelled"]
    speed = report["timing"]["frames_per_second"]
    pace = "" if speed is None else f", {speed:.0f} frames/s"
    if "edits" in report:
        pace += f", {sum(report['edits']['applied'].values())} edits applied"
    if "agreement" in report:
        pace += f", {report['agreement']['different']} otherwise by their points"
    unit = f", no unit in the file, taken for {report['unit_assumed']}" if "unit_assumed" in report else ""
    if "filled" in report:
        pace += f", {len(report['filled'])} of {len(report['filled']) + len(report['left'])} gaps filled"
    first = ", frames in the .c3d from 0" if "c3d_first_frame" in report else ""
    frames = f"{report['frames']} frame" + ("" if report["frames"] == 1 else "s")
    more = "".join(f"; {words}" for words in (*report.get("calibration", []), *report.get("notes", [])))
    if report.get("changed_in_all"):
        pace += f", {report['changed_in_all']} than before"
    look = f"; {report['to_look_at']}" if report.get("to_look_at") else ""
    return f"{report['take']}: {frames}, {named} of {count} {things} named{pace}{unit}{first}{more}{look}"


def _answers(arguments, progress: ProgressLine, passed: set[str]) -> Iterator[tuple[Path, dict | UserError]]:
    """Each take's report, or why there is none, as they come; `passed` gets those that an earlier run has done."""
    left = list(arguments.inputs)
    if arguments.resume:
        finish_renaming(arguments.out)
        for path, answer in _each(left, lambda path: results_of(as_job(arguments, path)), arguments.traceback):
            if answer is None:
                continue
            left.remove(path)
            if not isinstance(answer, UserError):
                passed.add(path.stem)
            yield path, answer
    if min(arguments.jobs, len(left)) > 1:
        yield from _side_by_side(left, arguments, progress)
        return

    def label(path: Path) -> dict:
        return progress.drain(jobs.label_file(as_job(arguments, path)), path.stem).report

    yield from _each(left, label, arguments.traceback)


def _line_of(report: dict, passed: set[str]) -> str:
    return as_line(report) + (", done before" if report["take"] in passed else "")


def _each(paths: Iterable[Path], work: Callable[[Path], dict | None], trace: bool):
    """What comes of each path, or why nothing does: whatever happens to one, the others have their turn."""
    for path in tuple(paths):
        try:
            answer = work(path)
        except Exception as error:  # noqa: BLE001 - every take is its own
            answer = of_take(error, path, trace)
        yield path, answer


def _side_by_side(paths: list[Path], arguments, progress: ProgressLine) -> Iterator[tuple[Path, dict | UserError]]:
    done = 0
    commands = [_command(arguments, path) for path in paths]
    with closing(side_by_side(commands, arguments.jobs)) as answers:
        for number_, answer in answers:
            done += 1
            progress.tell(f"{done} of {len(commands)} takes", at_once=True)
            yield paths[number_], answer


def _command(arguments, path: Path) -> list[str]:
    """The command line that labels one of the inputs alone."""
    command = ["label", f"--model={arguments.model}", f"--out={arguments.out}"]
    known = {
        name: getattr(arguments, name)
        for name in ("cameras", "rate", "height", "facing", "method", "occlusion", "target", "up", "edits")
    }
    command += [f"--{name}={value}" for name, value in known.items() if value is not None]
    if arguments.frames:
        command.append("--frames=" + ":".join("" if end is None else str(end) for end in arguments.frames))
    command += [
        f"--{name}" for name in ("trc", "fill", "blend", "html", "overwrite", "resume") if getattr(arguments, name)
    ]
    return [*command, "--", str(path)]
