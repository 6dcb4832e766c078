# SPDX-License-Identifier: GPL-3.0-or-later
"""Results as Markdown tables."""

from collections.abc import Iterable, Sequence


def table(columns: Sequence[str], rows: Iterable[Sequence]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(columns) + " |", "| " + " | ".join("---" for _ in columns) + " |"]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def share(part: int, whole: int, digits: int = 1) -> str:
    """`part` of `whole` as counts and per cent."""
    return f"{part} of {whole} ({100 * part / whole:.{digits}f} %)" if whole else "none"
