# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a take is one that a model can name at all: of its marker set, and of one subject."""

import numpy as np

from ..errors import JobError
from .labels import label_some
from .model import Evidence

LOOKED_AT = 40  # frames, spread over the take
SURE = 0.99
FITTING = 0.5  # part of the points or markers, whichever are fewer, that are named surely where a model fits
SECOND = 0.5  # part of the markers that is named surely among what is left over where there is a second subject
OFTEN = 0.4  # part of the frames that show it


def check_take(evidence: Evidence, points: np.ndarray):
    """Looks at some frames of points (T, P, 3) m, z up, NaN where there is none.

    Raises JobError when the points do not fit the model, or when more than one subject is there: names would be wrong.
    """
    count = np.isfinite(points[..., 0]).sum(axis=1)
    frames = np.flatnonzero(count >= min(4, len(evidence)))
    if not len(frames):
        raise JobError("no frame has enough points to tell markers apart; expected four or more at a time")
    some = points[frames[np.unique(np.linspace(0, len(frames) - 1, LOOKED_AT).round().astype(int))]]
    first = label_some(evidence, some)
    sure = first.confidence >= SURE
    possible = np.minimum(np.isfinite(some[..., 0]).sum(axis=1), len(evidence))
    if np.mean(sure.sum(axis=1) / possible) < FITTING:
        raise JobError("the points do not fit the model; expected a take of the marker set that it was trained on")
    left = np.where((first.marker >= 0)[..., None], np.nan, some)
    if not (np.isfinite(left[..., 0]).sum(axis=1) >= SECOND * len(evidence)).mean() > OFTEN:
        return
    second = label_some(evidence, left)
    if ((second.confidence >= SURE).sum(axis=1) >= SECOND * len(evidence)).mean() > OFTEN:
        raise JobError("there is more than one subject in the take; expected one, so that no name is given twice")
