# SPDX-License-Identifier: GPL-3.0-or-later
"""The colours of the body's left and right: blue and orange, which people who see few colours tell apart, and light."""

from collections.abc import Sequence

from ..core.body.anatomy import side_in

# Of the left, the right and the middle; sRGB. Blue against orange differs by brightness and for every kind of
# colour-blindness; the middle is neither.
SIDE_COLOURS = {"L": (0.13, 0.47, 0.95), "R": (1.0, 0.56, 0.1), "": (0.93, 0.93, 0.88)}


def colours_of(names: Sequence[str]) -> list[tuple[float, float, float]]:
    """The colours of markers or segments by their sides."""
    known = set(names)
    return [SIDE_COLOURS[side_in(name, known)] for name in names]
