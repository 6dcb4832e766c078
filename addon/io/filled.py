# SPDX-License-Identifier: GPL-3.0-or-later
"""The gaps of a take that were filled: `*.filled.csv`, a row a gap, and the same for reports."""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from ..core.filling.filling import FilledGap, LeftGap
from ..core.filling.kept import KeptFill, resting_on
from .text import cell_of

GAP_COLUMNS = ("marker", "first", "last", "method", "expected_mm")


def gap_rows(gaps: Sequence[FilledGap], names: Sequence[str], first_frame: int) -> list[dict]:
    """Each gap with its marker's name, the source's first and last frame, the method and the error to expect, mm.

    The error is None where it is not known. `rests_on`, for reports, says at which ends the marker was measured.
    """
    return [_row(*_where(one, names, first_frame), one.method, one.expected, resting_on(one.ends)) for one in gaps]


def kept_rows(fills: Iterable[KeptFill]) -> list[dict]:
    """The same rows of fills that a take keeps."""
    return [_row(f.marker, f.first, f.last, f.method, f.expected, resting_on(f.ends)) for f in fills]


def left_rows(left: Sequence[LeftGap], names: Sequence[str], first_frame: int) -> list[dict]:
    """Each gap that was left with its marker's name, its frames and the reason."""
    columns = ("marker", "first", "last", "reason")
    return [dict(zip(columns, (*_where(one, names, first_frame), one.reason), strict=True)) for one in left]


def write_filled(path: Path, rows: Sequence[dict]):
    """Writes rows of `gap_rows`; an error that is not known is an empty field."""
    with Path(path).open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, GAP_COLUMNS, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(row | {"marker": cell_of(row["marker"])} for row in rows)


def _row(marker: str, first: int, last: int, method: str, expected: float, rests_on: str) -> dict:
    rows = zip(
        GAP_COLUMNS,
        (marker, first, last, method, (round(1000 * expected, 2) if np.isfinite(expected) else None)),
        strict=True,
    )
    return dict(rows) | {"rests_on": rests_on}


def _where(one: FilledGap | LeftGap, names: Sequence[str], first_frame: int) -> tuple[str, int, int]:
    return names[one.gap.marker], first_frame + one.gap.start, first_frame + one.gap.stop - 1
