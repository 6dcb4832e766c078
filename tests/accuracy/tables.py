# SPDX-License-Identifier: GPL-3.0-or-later
"""Results as Markdown tables."""

from collections.abc import Iterable, Sequence

from addon.core.evaluation.figures import Counts

SCORE_COLUMNS = ("frames perfect", "wrong labels", "precision", "recall", "F1", "false occlusions")


def table(columns: Sequence[str], rows: Iterable[Sequence]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(columns) + " |", "| " + " | ".join("---" for _ in columns) + " |"]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def share(part: int, whole: int, digits: int = 1) -> str:
    """`part` of `whole` as counts and per cent."""
    return f"{part} of {whole} ({100 * part / whole:.{digits}f} %)" if whole else "none"


def score_cells(counts: Counts) -> list[str]:
    """The cells under `SCORE_COLUMNS`."""
    figures = counts.as_dict()
    cells = [share(counts.frames - counts.spoilt, counts.frames), share(counts.given - counts.right, counts.given, 3)]
    names = ("precision", "recall", "f1", "false_occlusions")
    return cells + ["none" if figures[name] is None else f"{100 * figures[name]:.2f} %" for name in names]
