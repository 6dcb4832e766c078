# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that a model is not for: another marker set, or two subjects at once. Said, instead of garbled."""

import numpy as np

from ..core.errors import JobError
from ..core.models import Model
from ..core.pipeline import Options
from ..core.takes import NO_MARKER
from .naming import name_frames

SAMPLE = 40  # frames
LEAST_NAMED = 0.25  # share of the markers that a take of the model's must have been given
CROWDED = 1.6  # times as many points as markers, at least, where there may be two subjects
OFTEN = 0.3  # share of the frames that are so
SECOND = 0.7  # share of the markers that the points left over make where there is a second subject
SURE = 0.9  # confidence of a name that counts


def refuse_second_subject(model: Model, method: str, points: np.ndarray, marker: np.ndarray, options: Options):
    """Raises JobError where what points (T, P, 3), named (T, P) frame by frame, leave over is another subject."""
    name, size = model.markerset.name, len(model.markerset)
    present = np.isfinite(points).all(axis=2)
    crowded = np.flatnonzero(present.sum(axis=1) >= CROWDED * size)
    if method == "fit" or len(crowded) < OFTEN * len(points):
        return
    frames = crowded[:: max(len(crowded) // SAMPLE, 1)][:SAMPLE]
    left = np.where((marker[frames] == NO_MARKER)[..., None], points[frames], np.nan)
    again = list(name_frames(model, method, left, 100.0, options))
    counts = np.concatenate([(part.confidence >= SURE).sum(axis=1) for part in again])
    if np.median(counts) >= SECOND * size:
        raise JobError(f"shows two subjects that wear {name}; expected a take of one, so export them one by one")


def refuse_strangers(model: Model, points: np.ndarray, given: np.ndarray):
    """Raises JobError where the labels given (T, P) are so few that points (T, P, 3) are of another marker set."""
    name, size = model.markerset.name, len(model.markerset)
    present = np.isfinite(points).all(axis=2).sum(axis=1)
    share = (given != NO_MARKER).sum() / np.minimum(present, size).sum()
    if share < LEAST_NAMED:
        many = f" or of several subjects at once ({int(present.max())} points, {size} markers)"
        several = many if np.median(present) >= CROWDED * size else ""
        raise JobError(
            f"does not look like a take of model {name}{several}: {share:.0%} of its markers were recognised for sure; "
            "expected a take of that marker set, so choose its model or train one"
        )
