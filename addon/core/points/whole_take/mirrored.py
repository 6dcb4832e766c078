# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a take of points is mirrored, by whether its single frames or their mirror images are likelier."""

import numpy as np
from threadpoolctl import threadpool_limits

from ...body.sides import MIRROR
from ...data.made import Table
from ...data.takes import Points, evenly_spread
from ...geometry.rigid import MIN_POINTS
from ..likelihood.frames import scores
from ..models import USUAL_TARGET, Model
from ..possible import FRAMES_TRIED, mirrored_error
from .deciding import least_margin
from .solving import MARGINS


def refuse_mirrored(take: Points, marker: Table, models: list[Model], expected: str):
    """Raises MirroredError where the mirror images of the take's frames are likelier, as surely as a name has to be.

    marker (T, L) is how its points are named, with the markers of one model after those of another. What tells left
    from right may have no name: of some frames, all points are asked about that nobody else has. A set that has all
    markers twice is as likely either way. Models on rigid bodies, or of one subject, are not asked: single frames know
    the rigid bodies of the training alone, and one subject may wear markers higher on one side. `expected` mends it.
    """
    frames = evenly_spread(len(take.xyz), FRAMES_TRIED)
    some = take.in_order(frames)
    named, there, first = some.of(marker[frames]), np.isfinite(some.xyz[..., 0]), 0
    for model in models:
        own = there & (named >= first) & (named < first + len(model.markerset))
        first += len(model.markerset)
        seen = own.sum(axis=1) > MIN_POINTS
        likelihood = model.likelihood
        if likelihood is None or model.of_one_subject or model.rigid_bodies is not None or not seen.any():
            continue
        points = np.where((own | (named < 0))[..., None], some.xyz, np.nan)[seen]
        with threadpool_limits(1, user_api="blas"):
            plain, image = (scores(likelihood, one) for one in (points, points * MIRROR))
        if MARGINS.looks * np.median(image - plain) >= least_margin(USUAL_TARGET):
            why = f"single frames fit the mirror image of {model.markerset.name} clearly better"
            raise mirrored_error(why, expected)
