# SPDX-License-Identifier: GPL-3.0-or-later
"""`summary.csv`: the takes of a batch, a row each, the worst first, and what the page over them says of each."""

import csv
import io
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from ..core.data.errors import InputError
from ..core.review.trouble import LEFT_OVER
from .provenance import REPORT, read_report
from .source import open_binary, read_bytes
from .text import cell_of, in_cell

# What becomes of a take, in the order of the table.
FAILING, LABELLED, DONE_BEFORE, AT_WORK, WAITING = "failed", "labelled", "done before", "at work", "waiting"
TAKE_STATES = (FAILING, LABELLED, DONE_BEFORE, AT_WORK, WAITING)
MEASURED = (LABELLED, DONE_BEFORE)
TABLE = ".csv"
MAX_BYTES = 64 * 1024 * 1024  # of a table that is read: a row is some 150 bytes, and no batch has 400,000 takes

FIGURES = (int, float, float | None)  # kinds of figures
MAX_FIGURE = 2.0**53  # beyond which a float counts no more: format


@dataclass(frozen=True)
class TakeRow:
    """A take of a batch."""

    take: str  # its name, the file's without its ending, and `source` that file's whole name
    source: str
    state: str  # one of TAKE_STATES; what is neither failed nor labelled yet has no figures
    trouble: int = 0  # entries of the report's `trouble` that nobody has answered, and
    at_stake: float = 0.0  # the marker-frames at stake in them
    named: float | None = None  # the part of its blobs or points that has a name; None where there are none
    # what has no name beside the body: of points trajectories, of blobs those beside a marker without one
    on_body: int = 0
    found: float = 0.0  # the part of all samples, markers times frames, that was found
    frames: int = 0  # all of them, and `whole` those in which every marker of the take is found
    whole: int = 0
    seconds: float = 0.0  # that it took
    reason: str = ""  # why it failed, else what is to be looked at first
    page: str = ""  # the name of its page beside the table, empty where there is none
    gaps: tuple[int, int] | None = None  # filled ones and all, None where none were to be filled
    version: str = ""  # of the program
    markers: Mapping[str, int] | None = None  # the frames in which each marker was found

    @property
    def measured(self) -> bool:
        """Whether there are figures of it."""
        return self.state in MEASURED


# Columns of the table, in their order; what else a row knows is for the page.
TABLE_COLUMNS = (
    *("take", "source", "state", "trouble", "at_stake", "named", "on_body", "found", "frames", "whole", "seconds"),
    *("reason", "page"),
)


def row_of(report: Mapping, source: str, state: str = LABELLED, page: str = "") -> TakeRow:
    """The row of a labelled take, by its report, with the name of its page where it has one.

    Raises what Python does where the report is not as `label` writes it.
    """
    open_ones = [one for one in report["trouble"] if not one["answered"]]
    count = report["points" if "points" in report else "blobs"]
    frames, markers = report["frames"], report["markers"]
    found = sum(row["labelled_frames"] for row in markers.values())
    filled = (len(report["filled"]), len(report["filled"]) + len(report["left"])) if "filled" in report else None
    row = TakeRow(
        report["take"],
        source,
        state,
        len(open_ones),
        sum(one["stake"] for one in open_ones),
        (count - report["unlabelled"]) / count if count else None,
        _on_body(report, open_ones),
        found / max(frames * len(markers), 1),
        frames,
        report["frames_whole"],
        sum(value for stage, value in report["timing"].items() if stage != "frames_per_second"),
        report.get("to_look_at", ""),
        page,
        filled,
        report["version"],
        {name: row["labelled_frames"] for name, row in markers.items()},
    )
    for field in fields(TakeRow):
        value = getattr(row, field.name)
        if field.type is str and not isinstance(value, str):
            raise TypeError(f"{field.name} is {value!r}")
        if field.type in FIGURES and value is not None:
            if not isinstance(value, int | float):
                raise TypeError(f"{field.name} is {value!r}")
            if not abs(value) < MAX_FIGURE:
                raise ValueError(f"{field.name} is {value}")
    return row


def _on_body(report: Mapping, open_ones: list[Mapping]) -> int:
    if "points" in report:
        return len({number for one in open_ones if one["kind"] == LEFT_OVER for number in one["trajectories"]})
    return sum(camera.get("unnamed_beside_markers", 0) for camera in report.get("cameras", {}).values())


def worst_first(rows: Iterable[TakeRow]) -> list[TakeRow]:
    """Failed takes, then labelled ones by the marker-frames at stake, then those to come in the order given."""
    return sorted(rows, key=lambda row: (_place(row), -row.at_stake, row.found))


def _place(row: TakeRow) -> int:
    return TAKE_STATES.index(LABELLED) if row.measured else TAKE_STATES.index(row.state)


def write_table(path: Path, rows: Iterable[TakeRow]):
    """Writes the table, in the order given. Figures of takes that have none are empty."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(TABLE_COLUMNS)
    for row in rows:
        writer.writerow([_cell(row, name) for name in TABLE_COLUMNS])
    # A file's name may hold bytes that are no letters.
    Path(path).write_bytes(text.getvalue().encode("utf-8", "surrogateescape"))


def _cell(row: TakeRow, name: str) -> str:
    value = getattr(row, name)
    if isinstance(value, str):
        return cell_of(value)
    if value is None or not row.measured:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def is_table(path: Path) -> bool:
    """Whether a file is a table that was written here."""
    wanted = (",".join(TABLE_COLUMNS) + "\r\n").encode()
    try:
        with open_binary(path) as file:
            return file.read(len(wanted)) == wanted
    except InputError:
        return False


def read_table(path: Path) -> list[TakeRow]:
    """The rows of a table, in its order; InputError where it is none."""
    if not is_table(path):
        raise InputError("is no table of a batch; expected a summary.csv that label --summary wrote", path)
    text = read_bytes(path, MAX_BYTES).decode("utf-8", "surrogateescape")
    kinds = {field.name: field.type for field in fields(TakeRow)}
    try:
        return [
            TakeRow(**{name: _value(kinds[name], cell) for name, cell in row.items() if cell or name == "take"})
            for row in csv.DictReader(io.StringIO(text, newline=""), strict=True)
        ]
    except (csv.Error, ValueError, TypeError, KeyError, AttributeError):
        raise InputError("is damaged; expected the table of a batch as label --summary writes it", path) from None


def _value(kind: object, cell: str) -> Any:
    if kind in (int, "int"):
        return int(cell)
    return in_cell(cell) if kind in (str, "str") else float(cell)


def is_result(path: Path) -> bool:
    """Whether a file lies among what a labelling, a capture or a filling made, and is no take to be labelled.

    Known by their names are labels, truth and the lists of filled gaps; a take that was written, by what lies beside.
    """
    name = path.name.casefold()
    if name.endswith((".labels.csv", ".truth.csv", ".filled.csv")):
        return True
    if os.path.exists(path.with_name(path.stem + ".filled.csv")):  # noqa: PTH110 no name is too long for it
        return True
    return (name.endswith(TABLE) and is_table(path)) or _made(path)


def _made(path: Path) -> bool:
    """Whether the report beside a take says that it was written with it."""
    try:
        return path.suffix in read_report(path.with_name(path.stem + REPORT))["provenance"]["results"]
    except InputError:
        return False
