# SPDX-License-Identifier: GPL-3.0-or-later
"""Why a take is not of a model: it would be if another axis pointed up, or is of another model that is known.

What single frames say shows which is likeliest; whether it would be named so, a part of the take shows.
"""

from collections.abc import Generator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from ..data.errors import JobError
from ..data.progress import Progress, within
from ..data.takes import Labels, Points, evenly_spread
from ..points.models import Model, namer_of
from ..points.refusals import UnsuitedError, points_at_a_time
from ..points.whole_take.objective import usual_fit
from ..points.whole_take.pipeline import PointOptions, label_take

HOW_TO_TURN = "by --up"  # on the command line; Blender puts words of its sidebar there
FRAMES_TRIED = 12  # that say which is likeliest: memory and time
TRIED_S = 2.0  # of the take, around its middle, that is labelled again: memory and time
MOST_TRIED = 2  # models: sets share most of their places


def misfit_of(
    error: UnsuitedError,
    take: Points,
    models: Sequence[Model],
    options: PointOptions,
    turns: dict[str, np.ndarray],
    others: Sequence[Model],
) -> Generator[Progress, None, UnsuitedError]:
    """The error with which a take that is of none of the models was refused, with the reason where there is one.

    turns are rotations (3, 3) by the axis that would then point up, others the models that are known.
    """
    asked = take.in_order(evenly_spread(len(take.xyz), FRAMES_TRIED)).xyz
    each = product(models, turns)
    model, axis = max(each, key=lambda one: worth_of(one[0], asked @ turns[one[1]].T))
    part = middle_of(take)
    turned = replace(part, xyz=part.xyz @ turns[axis].T)
    if worth_of(model, asked @ turns[axis].T) > worth_of(model, asked) and (yield from _suits(turned, model, options)):
        words = f"stands with {axis} up, as which it looks like a take of model {model.markerset.name}"
        return UnsuitedError(f"{words}; expected that axis to be given, {HOW_TO_TURN} {axis}")
    suited = ""
    for other in sorted(others, key=lambda other: -worth_of(other, asked))[:MOST_TRIED]:
        if (yield from _suits(part, other, options)):
            suited += f" or {other.markerset.name}" if suited else f"; it looks like a take of {other.markerset.name}"
    return UnsuitedError(error.message + suited)


def worth_of(model: Model, points: np.ndarray) -> float:
    """Log likelihood of the usual frame of points (F, P, 3) m with the names that each finds on its own."""
    if model.likelihood is None:
        return 0.0
    labels = Labels.join(namer_of(model, "likelihood").name(points, 0.0))
    found = usual_fit(model.likelihood, labels.placed(points, len(model.markerset))).log_likelihood
    return float(found * labels.named.sum()) if np.isfinite(found) else 0.0


def middle_of(take: Points) -> Points:
    """The part of a take that is tried: around the middle of the frames that show as many points as is usual."""
    count = points_at_a_time(take.xyz)
    shown = np.flatnonzero(count >= max(np.median(count), 1))
    half, middle = max(round(TRIED_S * take.rate / 2), 1), int(shown[len(shown) // 2]) if len(shown) else 0
    rows = slice(max(middle - half, 0), min(middle + half, len(take.xyz)))
    first = take.first_frame + rows.start
    lanes = None if take.lanes is None else take.lanes.between(rows.start, rows.stop)
    return replace(take, xyz=take.xyz[rows], residual=take.residual[rows], first_frame=first, lanes=lanes)


def _suits(take: Points, model: Model, options: PointOptions) -> Generator[Progress, None, bool]:
    """Whether a take would be named by a model."""
    tried = PointOptions(options.method, options.target, traced=True)
    try:
        yield from within(label_take(take, model, tried), 1.0, 1.0, f"try {model.markerset.name}")
    except JobError:
        return False
    return True
