# SPDX-License-Identifier: GPL-3.0-or-later
"""Left and right in names: L and R before those of markers and joint centres, .L and .R behind those of segments."""

from collections.abc import Collection

BODY_SIDES = ("L", "R")
# A marker on one side only: nothing on the other side mirrors it.
UNPAIRED = ("RBAK",)


def other_side(name: str) -> str:
    """The mirrored name of a marker, a joint centre or a segment; names without a side are their own."""
    if name.endswith((".L", ".R")):
        return name[:-1] + ("R" if name[-1] == "L" else "L")
    if name in UNPAIRED or name[:1] not in BODY_SIDES:
        return name
    return ("R" if name[0] == "L" else "L") + name[1:]


def is_right(name: str) -> bool:
    """Whether a marker, joint centre or segment is the body's right one of two."""
    return name.endswith(".R") or (name[:1] == "R" and name not in UNPAIRED)


def side_in(name: str, names: Collection[str]) -> str:
    """Which side a marker or a segment is on, "L" or "R", by another of the names that mirrors it; "" in the middle."""
    other = other_side(name)
    if other == name or other not in names:
        return ""
    return "R" if is_right(name) else "L"
