# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages that people pass on: of a take that is being labelled, and of one that a Blender file keeps."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from ..core.data.takes import Blobs, LabelledChunk, PointRows
from ..core.edits.kinds import NO_EDITS, Edits
from ..core.filling.kept import KeptFill
from ..core.geometry.cameras import Cameras
from ..core.review.odd_cameras import CameraCheck
from ..core.review.overview import OverviewSubject, TakeOverview
from ..core.review.summary import TakeSummary
from ..core.review.take_trouble import TakeTrouble
from ..io.filled import kept_rows
from ..io.html import write_take_page
from ..io.report import facts_of_edits, facts_of_trouble, take_report
from ..version import version


@dataclass(frozen=True, eq=False)
class KeptTake:
    """A labelled take as a Blender file keeps it, for its page.

    name, source  of the take and of its file, the latter empty where there is none
    model         the marker set's name
    rows, chunk   all of it
    edits         those that the labels follow
    fills         the gaps that were filled, which are not in the chunk
    """

    name: str
    source: str
    model: str
    rate: float
    subject: OverviewSubject
    cameras: Cameras
    rows: Blobs | PointRows
    chunk: LabelledChunk
    edits: Edits = NO_EDITS
    fills: tuple[KeptFill, ...] = ()


def write_kept_page(path: Path, take: KeptTake):
    """Writes the page of a take that was labelled before."""
    overview = TakeOverview(take.subject, take.rate, take.cameras, take.edits)
    overview.add(take.rows, take.chunk)
    summary = TakeSummary(take.subject.markers)
    summary.add(take.chunk)
    report = take_report(summary, take.name, take.model, take.rate, version(), {})
    report |= facts_of_edits(None, take.chunk.outcomes)
    trouble = TakeTrouble(take.subject.markers, take.rate, take.edits, take.cameras, take.subject.words)
    trouble.add(take.rows, take.chunk.labels, take.chunk.motion)
    for fill in take.fills:
        overview.fill(fill.marker, fill.first, fill.last)
        trouble.fill(fill.marker, fill.first, fill.last)
    report |= facts_of_trouble(trouble, take.chunk.suspects)
    if take.fills:
        report |= {"filled": kept_rows(take.fills), "left": []}
    if isinstance(take.rows, Blobs):
        check = CameraCheck(take.cameras)
        check.add(take.rows, take.chunk)
        report |= {"cameras": check.of_cameras(), "camera_doubts": [doubt.reason for doubt in check.suspects()]}
    else:
        report["points"] = report.pop("blobs")
    write_take_page(path, report, overview, Path(take.source).name, today())


def today() -> str:
    """The day, by the world's clock, as pages have it."""
    return datetime.now(UTC).date().isoformat()
