# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set in words: which marker sits where on which segment."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Site:
    """Where a marker sits."""

    segment: str  # of the body, such as thigh.L
    place: str  # a landmark of the segment; or one or two sides of the segment with a space between, and `along`
    along: float | None = None  # from the segment's own joint, 0, to the next, 1; None at a landmark
    side: str = ""  # L or R of a landmark that a segment in the middle has on both sides; empty for none
    off_m: float = 0.0  # m, from the skin to the marker, as on a wand; format: most markers are on the skin


@dataclass(frozen=True, eq=False)
class Layout:
    """A marker set in words."""

    name: str  # for people to read, as the next two
    description: str
    source: str  # who has published it
    sites: Mapping[str, Site]  # where each marker sits, in the order of everything that is written
