# SPDX-License-Identifier: GPL-3.0-or-later
"""The colours of the body's left and right: blue and orange, which people who see few colours tell apart, and light."""

import json
from functools import lru_cache

import bpy
import numpy as np

from ..core.body.anatomy import side_in
from ..core.data.markersets import MarkerSet

KEPT_SIDES = "mocap_sides"

# Of the left, the right and the middle; sRGB. Blue against orange differs by brightness and for every kind of
# colour-blindness; the middle is neither.
SIDE_COLOURS = {"L": (0.13, 0.47, 0.95), "R": (1.0, 0.56, 0.1), "": (0.93, 0.93, 0.88)}


@lru_cache(maxsize=8)
def colours_of(names: tuple[str, ...]) -> list[tuple[float, float, float]]:
    """The colours of markers or segments by their sides; asked for at every redraw, so they are kept."""
    known = set(names)
    return [SIDE_COLOURS[side_in(name, known)] for name in names]


def segment_sides(markerset: MarkerSet) -> dict[str, str]:
    """The side of each segment by its name: that of its name, else the one that most of its markers are on."""
    segments, markers = markerset.skeleton.segments, set(markerset.markers)
    sides = {}
    for index, name in enumerate(segments):
        own = [side_in(markerset.markers[one], markers) for one in np.flatnonzero(markerset.attachment == index)]
        most = max(("L", "R"), key=own.count)
        sides[name] = side_in(name, segments) or (most if own.count(most) > len(own) / 2 else "")
    return sides


def keep_sides(armature: bpy.types.Object, markerset: MarkerSet):
    """Keeps the sides of the segments with their armature."""
    armature[KEPT_SIDES] = json.dumps(segment_sides(markerset))


def kept_sides(armature: bpy.types.Object) -> dict[str, str]:
    """The sides of an armature's segments; nothing of one that does not say."""
    return json.loads(armature.get(KEPT_SIDES, "{}"))
