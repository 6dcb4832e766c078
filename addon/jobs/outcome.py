# SPDX-License-Identifier: GPL-3.0-or-later
"""What the labelling made of a take, and its files."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..blendfile import Chunks, save_blend, save_played
from ..core.data.markersets import MarkerSet, Worn
from ..core.data.takes import EditOutcome, Points
from ..core.edits.kinds import NO_EDITS, Edits
from ..core.geometry.cameras import NO_CAMERAS, Cameras
from ..core.points.models import Model
from ..core.review.summary import TakeSummary
from ..io.c3d import first_number, names_in_c3d
from ..io.changed import facts_of_changes
from ..io.json_text import write_json
from ..io.points import write_c3d, write_trc
from ..io.poses import PoseFile
from ..io.report import REPORT, facts_of_edits, take_report
from ..io.source import digest
from ..version import version
from .job import MOTION_FILE, PAGE, LabelJob, timed
from .resuming import leftovers

if TYPE_CHECKING:  # only jobs that fill gaps or write a page need them
    from ..core.filling.kept import KeptFill
    from ..core.review.overview import TakeOverview


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the labelling made of a take, to be written.

    worn     whose markers these are
    points   the markers in space, then what stays unnamed of points
    chunks   rows and what is said of them, where the job keeps them
    cameras  that saw it; none for points
    summary  for the report, and `facts` that only some reports say
    made_of  what the results come from
    edits    those that the labels follow
    outcomes what became of each edit
    overview what the take's page is drawn from; None where the job writes none
    fills    the gaps that were filled, which a Blender file keeps apart from what was measured
    poses    those of a take that is too long for keys; None of others
    """

    worn: Worn
    points: Points
    chunks: Chunks
    cameras: Cameras
    summary: TakeSummary
    facts: dict
    made_of: dict
    edits: Edits = NO_EDITS
    outcomes: tuple[EditOutcome, ...] = ()
    overview: "TakeOverview | None" = None
    fills: "tuple[KeptFill, ...]" = ()
    poses: PoseFile | None = None


def overview_of(
    job: LabelJob, markerset: MarkerSet, rate: float, edits: Edits, cameras: Cameras = NO_CAMERAS
) -> "TakeOverview | None":
    """What the take's page is drawn from; None where the job writes none."""
    if not job.html:
        return None
    from ..core.review.overview import OverviewSubject, TakeOverview

    return TakeOverview(OverviewSubject.of(markerset), rate, cameras, edits)


def write_take(job: LabelJob, files: dict[str, Path], model: Model, made: Outcome, clock: dict) -> dict:
    """Writes all files of a take but its labels, which are written part by part; gives the report."""
    rate, worn = made.points.rate, made.worn
    with timed(clock, "write"):
        if job.blend and made.poses is not None:
            said = made.summary.suspects, made.cameras, job.for_a_part(not len(made.cameras))
            save_played(files[".blend"], files[MOTION_FILE], job.source, worn, made.points, made.poses, *said)
        elif job.blend:
            said = made.edits, made.fills
            save_blend(files[".blend"], job.source, rate, worn, made.chunks, made.cameras, *said)
        changed = facts_of_changes(job.path(".labels.csv"), files[".labels.csv"], worn.markers)
        write_c3d(files[".c3d"], made.points)
        if job.trc:
            write_trc(files[".trc"], made.points)
        results = {
            ending: digest([path]) for ending, path in files.items() if ending not in (PAGE, REPORT) and path.exists()
        }
    report = take_report(made.summary, job.source.stem, worn.name, rate, version(), clock)
    report |= (
        {"model_version": model.history.version, "model_fingerprint": model.fingerprint}
        | renumbered(made.points)
        | facts_of_edits(job.edits_file, made.outcomes)
        | made.facts
        | changed
        | {"made_of": {**made.made_of, "results": results}}
    )
    if "points" in report:
        del report["blobs"]
    if left := [path.name for path in leftovers(job)[1]]:
        words = [f"{name} is not of this run, and stays as it is" for name in left]
        report["notes"] = [*report.get("notes", []), *words]
    if made.overview is not None:
        from ..io.html import write_take_page
        from .pages import today

        made.overview.outcomes = made.outcomes
        write_take_page(files[PAGE], report, made.overview, job.source.name, today())
        results[PAGE] = digest([files[PAGE]])
    write_json(files[REPORT], report)
    return report


def renumbered(points: Points) -> dict:
    """What a report says where a C3D file cannot say what the take does: of frame numbers, and of long names."""
    said = {}
    first = first_number(points.first_frame, points.xyz.shape[0])
    if first != points.first_frame:
        said["c3d_first_frame"] = first
    names = zip(points.names, names_in_c3d(points.names), strict=True)
    if other := {name: fitted for name, fitted in names if name != fitted}:
        said["c3d_names"] = other
    return said
