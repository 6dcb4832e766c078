# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs that a person named: what they are to the fit, frame by frame, and what they say against its names."""

import numpy as np

from ..data.takes import NO_MARKER
from ..geometry.views import View
from ..papers.virtual_occlusions.labelling import Naming


def fixed_in(view: View, seeds: np.ndarray | None, markers: int) -> np.ndarray | None:
    """(C, M) the blob of a view that is each marker by the `seeds` (N,) of its chunk; None where none is."""
    if seeds is None:
        return None
    camera, slot = np.nonzero(view.real)
    marker = seeds[view.row[camera, slot]]
    known = marker != NO_MARKER
    if not known.any():
        return None
    fixed = np.full((len(view.real), markers), -1)
    fixed[camera[known], marker[known]] = slot[known]
    return fixed


def contradicted(naming: Naming, fixed: np.ndarray) -> np.ndarray | None:
    """(M,) the exchange of names that a person's names (C, M) ask of a frame that is named otherwise; None for none.

    Of two markers each, whose names one blob has: the program's and the person's.
    """
    order = np.arange(fixed.shape[1])
    camera, marker = np.nonzero(fixed >= 0)
    owner = naming.owner[camera, fixed[camera, marker]]
    for mine, other in zip(marker.tolist(), owner.tolist(), strict=True):
        if other not in (-1, mine) and order[mine] == mine and order[other] == other:
            order[[mine, other]] = other, mine
    return None if (order == np.arange(len(order))).all() else order
