# SPDX-License-Identifier: GPL-3.0-or-later
"""Left and right: which markers are each other's mirror image, so that every subject teaches twice."""

import re
from collections.abc import Sequence

import numpy as np

from ...geometry.upright import upright_aligned
from .shape import learn_shape

PAIRED = 0.5  # part of the markers that must have another side for a set to have sides at all
ALIKE = 0.25  # radii that the mirrored mean may differ from the mean
MIRROR = np.array([1.0, -1.0, 1.0])
_OTHER = {"l": "r", "r": "l", "L": "R", "R": "L", "left": "right", "right": "left", "Left": "Right", "Right": "Left"}
_SIDE = re.compile(r"^(left|right|Left|Right)|^([LRlr])(?=[A-Z_.\- ])|(?<=[_.\- ])([LRlr])$")


def mirror_order(markers: Sequence[str]) -> np.ndarray | None:
    """(M,) each marker's mirror image, itself where it has none; None where the names have no sides."""
    order = np.arange(len(markers))
    for index, name in enumerate(markers):
        other = _SIDE.sub(lambda match: _OTHER[match.group()], name, count=1)
        if other in markers:
            order[index] = markers.index(other)
    paired = (order != np.arange(len(markers))).mean()
    return order if paired >= PAIRED and (order[order] == np.arange(len(markers))).all() else None


def mirrored(subjects: Sequence[np.ndarray], markers: Sequence[str]) -> list[np.ndarray]:
    """The mirror images of labelled clouds, one array (T, M, 3) a subject, with the sides' names exchanged.

    Empty where the names have no sides, or where the clouds do not look as if they meant sides.
    """
    order = mirror_order(tuple(markers))
    if order is None:
        return []
    mean = learn_shape(subjects).mean
    image = upright_aligned((mean[order] * MIRROR)[None], mean)[0]
    apart = np.sqrt(((image - mean) ** 2).sum(axis=1).mean())
    if apart > ALIKE * np.sqrt((mean**2).sum(axis=1).mean()):
        return []
    return [points[:, order] * MIRROR for points in subjects]
