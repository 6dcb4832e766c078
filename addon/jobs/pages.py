# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages that people pass on: of a take, of one that a Blender file keeps, and over a batch, with its table."""

import time
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path

from ..core.data.errors import UserError
from ..core.data.takes import Blobs, LabelledChunk, PointRows
from ..core.filling.kept import KeptFill
from ..core.review.odd_cameras import CameraCheck
from ..core.review.overview import TakeOverview
from ..core.review.summary import SampleOrigins, TakeSummary
from ..core.review.take_trouble import TakeTrouble
from ..io.batch import AT_WORK, FAILING, LABELLED, TABLE, WAITING, TakeRow, is_table, row_of, worst_first, write_table
from ..io.filled import kept_rows
from ..io.html.markup import is_page
from ..io.html.pages import write_folder_page, write_take_page
from ..io.report import facts_of_cameras, facts_of_edits, facts_of_trouble, take_report
from ..io.whole import check_targets, whole_files
from ..version import version
from .job import PAGE


def write_kept_page(
    path: Path,
    name: str,
    source: str,
    model: str,
    overview: TakeOverview,
    rows: Blobs | PointRows,
    chunk: LabelledChunk,
    fills: Iterable[KeptFill],
    smoothed: Iterable[int] | None = None,
):
    """Writes the page of a take that was labelled before, as a Blender file keeps it, and that `overview` is to show.

    `source` is its file, empty where there is none, `model` the marker set's name; rows and chunk are all of it, and
    the `fills` are not in the chunk. How many samples of each marker are `smoothed` is None where nothing is.
    """
    cameras, markers = overview.cameras, overview.subject.markers
    overview.add(rows, chunk)
    origins = SampleOrigins(markers, overview.edits, overview.subject.words)
    origins.add(rows, chunk)
    summary = TakeSummary(markers)
    summary.add(chunk)
    report = take_report(summary, name, model, overview.rate, version(), {})
    report |= facts_of_edits(None, chunk.outcomes)
    trouble = TakeTrouble(markers, overview.rate, overview.edits, cameras, overview.subject.words)
    trouble.add(rows, chunk.labels, chunk.motion)
    for fill in fills:
        overview.fill(fill.marker, fill.first, fill.last)
        trouble.fill(fill.marker, fill.first, fill.last)
    report |= facts_of_trouble(trouble, chunk.suspects)
    if filled := kept_rows(fills):
        report |= {"filled": filled, "left": []}
    report["provenance"] = {"markers": origins.of_markers(filled, smoothed)}
    if isinstance(rows, Blobs):
        check = CameraCheck(cameras)
        check.add(rows, chunk.labels.marker, chunk.motion.expected)
        report |= facts_of_cameras(check, trouble, check.suspects())
    else:
        report["points"] = report.pop("blobs")
    write_take_page(path, report, overview, Path(source).name, today())


def today() -> str:
    """The day, by the world's clock, as pages have it."""
    return datetime.now(UTC).date().isoformat()


# How often a summary is written while its batch goes on; assumed.
EVERY_S = 1.0  # s at least between two writings: as soon as a person looks again
TIMES_SPENT = 10.0  # as long as the last writing took, at least, between two: one over thousands of takes costs a tenth


SUMMARY_TABLE, SUMMARY_PAGE = f"summary{TABLE}", f"summary{PAGE}"


class BatchSummary:
    """The takes of a batch and what became of each, by the files that they come from.

    `table` and `page` are its files in a folder, None for one that is not wanted; they are written together.
    """

    def __init__(self, folder: Path, table: bool, page: bool):
        self.table, self.page = folder / SUMMARY_TABLE if table else None, folder / SUMMARY_PAGE if page else None
        self.rows: dict[Path, TakeRow] = {}
        self._next, self._changed = 0.0, True

    @property
    def written(self) -> list[Path]:
        """The files that are written."""
        return [path for path in (self.table, self.page) if path is not None]

    def check(self, overwrite: bool, resume: bool):
        """Raises InputError where its files may not be written; who resumes may replace those of an earlier run."""
        for path in self.written:
            ours = is_table(path) if path == self.table else is_page(path)
            check_targets([path], overwrite or (resume and ours))

    def wait_for(self, source: Path):
        """Notes a take that is to be worked on."""
        self._put(source, TakeRow(source.stem, source.name, WAITING))

    def begin(self, source: Path):
        """Notes a take that is being worked on."""
        self._put(source, TakeRow(source.stem, source.name, AT_WORK))

    def drop(self, source: Path):
        """Forgets a take, which is gone before it was begun."""
        self._changed |= self.rows.pop(source, None) is not None

    def finish(self, source: Path, answer: Mapping | UserError, out: Path, state: str = LABELLED):
        """Notes a take's report, or why it has none; its page is in the folder `out`, where it has one."""
        if isinstance(answer, UserError):
            # Whoever gets the summary has no use for where the takes lie.
            reason = " ".join(str(answer).replace(str(source), source.name).split()).removeprefix(f"{source.name}: ")
            self._put(source, TakeRow(source.stem, source.name, FAILING, reason=reason))
            return
        page = source.stem + PAGE
        self._put(source, row_of(answer, source.name, state, page if (out / page).is_file() else ""))

    def _put(self, source: Path, row: TakeRow):
        self._changed |= self.rows.get(source) != row
        self.rows[source] = row

    def count(self, *states: str) -> int:
        """How many takes are in one of these states."""
        return sum(row.state in states for row in self.rows.values())

    def write(self, at_once: bool = False):
        """Writes its files, both or none, where something is new; now and then, or `at_once`."""
        if not self.written or not self._changed or (not at_once and time.monotonic() < self._next):
            return
        begin, rows = time.monotonic(), worst_first(self.rows.values())
        with whole_files(self.written, overwrite=True) as parts:
            for path, part in zip(self.written, parts, strict=True):
                write_table(part, rows) if path == self.table else write_folder_page(part, rows, today())
        self._changed = False
        now = time.monotonic()
        self._next = now + max(EVERY_S, TIMES_SPENT * (now - begin))

    def lines(self) -> list[str]:
        """The table for people, a line a take."""
        return lines_of(worst_first(self.rows.values()))


def lines_of(rows: Iterable[TakeRow]) -> list[str]:
    """Rows of a batch as lines of equal columns: what is at stake and to be looked at, or why a take failed."""
    lines = [("take", "to look at", "at stake", "named", "on body", "found", "time", "")]
    for row in rows:
        figures = ("", "", "", "", "", "")
        if row.measured:
            named = "–" if row.named is None else f"{row.named:.1%}"
            figures = (str(row.trouble), f"{row.at_stake:.0f}", named, str(row.on_body), f"{row.found:.1%}")
            figures += (f"{row.seconds:.1f} s",)
        words = row.reason if row.state == LABELLED else f"{row.state}: {row.reason}" if row.reason else row.state
        lines.append((row.take, *figures, words))
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]) - 1)]
    sides = (str.ljust, *[str.rjust] * (len(widths) - 1))
    return [
        "  ".join(
            [*(side(cell, width) for side, cell, width in zip(sides, line, widths, strict=False)), line[-1]]
        ).rstrip()
        for line in lines
    ]
