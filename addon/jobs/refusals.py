# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that a model is not for: another marker set, or two subjects at once. Said, instead of garbled.

What tells them is what single frames say on their own. Trajectories that vote would make a name even of what no frame
was sure about, and of another marker set they vote as one for wrong names.
"""

import numpy as np

from ..core.blobs.pipeline import Options
from ..core.data.errors import JobError
from ..core.data.models import Model
from ..core.data.takes import NO_MARKER
from ..core.points.apart import groups_apart
from .naming import NamedFrames, joined, name_frames

SAMPLE = 40  # frames, spread over the take
MOST_POINTS = 400  # of a frame; more are no marker system's, and would fill the memory
FEWEST = 4  # points of a frame that can be told apart
SURE = 0.999  # part of the labels like it that is right, of a label that counts; or, as a model that was trained on
CONFIDENT = 0.99  # little may never promise so much, its confidence
LEAST_SURE = 0.12  # share of the markers whose labels count, in a take of the model's
LEAST_SURE_PLATES = 0.2  # the same of a set on plates, of which there is often one that any body seems to wear
LEFT_SURE = 0.3  # the same of the points that one subject leaves over, where they are another: spare markers are not
LEAST_NAMED = 0.25  # share of the markers that such a take is given in the end
LEAST_FITTED = 0.6  # the same of a fitted body, which makes do with any points that are near enough
APART = 0.6  # m between two subjects, where nothing is known of how far one reaches
CROWDED = 1.6  # times as many points as markers, at least, where there may be two subjects
SECOND = 0.5  # share of the markers that a second subject's points must be enough for
OFTEN = 0.4  # share of the frames that are so


def refuse_floods(points: np.ndarray):
    """Raises JobError where a frame of points (T, P, 3), NaN where missing, has more than can be worked with."""
    most = int(np.isfinite(points).all(axis=2).sum(axis=1).max(initial=0))
    if most > MOST_POINTS:
        raise JobError(f"has {most} points in one frame; expected the markers of a subject and some ghosts")


def refuse_others(model: Model, method: str, points: np.ndarray, options: Options):
    """Looks at some frames of points (T, P, 3) m, NaN where missing, before all of them are named.

    Raises JobError where frames on their own are not sure of the model's markers, or are of two
    subjects' at once. The fitted body needs its frames in a row: for it two groups of points are two subjects, and the
    rest is for `refuse_strangers`.
    """
    if method == "fit":
        if _apart(points[:: max(len(points) // SAMPLE, 1)], APART, SECOND * len(model.markerset)):
            raise _two_subjects(model)
        return
    likelihood = model.markerset.likelihood
    count = np.isfinite(points).all(axis=2).sum(axis=1)
    frames = np.flatnonzero(count >= min(FEWEST, len(model.markerset)))
    if not len(frames):
        raise JobError("has no frame with enough points to tell markers apart; expected four or more at a time")
    some = points[frames[np.unique(np.linspace(0, len(frames) - 1, SAMPLE).round().astype(int))]]
    first = _named(model, method, some, options)
    alone = sure_share(first, some, len(model.markerset))
    least = LEAST_SURE if likelihood is None or likelihood.rigid_bodies is None else LEAST_SURE_PLATES
    found = alone >= least
    wanted = LEFT_SURE if found else least
    others = [part for part in _seconds(model, some, first, found) if _sure(model, method, part, options) >= wanted]
    if len(others) + found >= 2:
        raise _two_subjects(model)
    if not found:
        raise _stranger(model, some, alone)


def refuse_strangers(model: Model, method: str, points: np.ndarray, given: np.ndarray):
    """Raises JobError where the labels given (T, P) are so few that points (T, P, 3) are of another marker set.

    The labels are those of the usual target: of a stricter one there are few in any take.
    """
    share = (given != NO_MARKER).sum() / _possible(points, len(model.markerset))
    if share < (LEAST_FITTED if method == "fit" else LEAST_NAMED):
        raise _stranger(model, points, share)


def sure_share(named: NamedFrames, points: np.ndarray, markers: int) -> float:
    """The share of the markers, or of the points (T, P, 3) if they are fewer, that frames alone are sure of."""
    counts = (named.rate >= SURE) | (named.confidence >= CONFIDENT)
    return float(counts.sum() / _possible(points, markers))


def _seconds(model: Model, points: np.ndarray, first: NamedFrames, found: bool) -> list[np.ndarray]:
    """The points (T, P, 3) of each who may be a subject beside the one that was named, if one was; NaN elsewhere."""
    size = len(model.markerset)
    crowded = np.isfinite(points).all(axis=2).sum(axis=1) >= CROWDED * size
    if crowded.mean() < OFTEN:
        return []
    if found:
        return [np.where((first.marker == NO_MARKER)[..., None], points, np.nan)]
    if model.markerset.likelihood is None:
        return []
    chosen = _apart(points, model.markerset.likelihood.shape.radius, SECOND * size)
    if not chosen:
        return []
    return [np.array([np.where(own[place][:, None], frame, np.nan) for frame, own in chosen]) for place in (0, 1)]


def _apart(points: np.ndarray, gap: float, least: float) -> list[tuple[np.ndarray, list[np.ndarray]]]:
    """The frames of points (T, P, 3) that show two groups of `least` points or more, with them; none where few do."""
    groups = [groups_apart(frame, gap, least) for frame in points]
    chosen = [(frame, own) for frame, own in zip(points, groups, strict=True) if len(own) >= 2]
    return chosen if len(chosen) >= OFTEN * len(points) else []


def _sure(model: Model, method: str, points: np.ndarray, options: Options) -> float:
    """How sure the frames of points (T, P, 3) are of the model's markers, 0 where there are seldom enough points."""
    size = len(model.markerset)
    enough = np.isfinite(points).all(axis=2).sum(axis=1) >= SECOND * size
    if enough.mean() < OFTEN:
        return 0.0
    return sure_share(_named(model, method, points[enough], options), points[enough], size)


def _named(model: Model, method: str, points: np.ndarray, options: Options) -> NamedFrames:
    return joined(list(name_frames(model, method, points, 100.0, options)))


def _possible(points: np.ndarray, markers: int) -> int:
    """How many labels could be given, all frames together."""
    return max(int(np.minimum(np.isfinite(points).all(axis=2).sum(axis=1), markers).sum()), 1)


def _two_subjects(model: Model) -> JobError:
    name = model.markerset.name
    return JobError(f"shows two subjects or more that wear {name}; expected a take of one, so export them one by one")


def _stranger(model: Model, points: np.ndarray, share: float) -> JobError:
    name, size = model.markerset.name, len(model.markerset)
    present = np.isfinite(points).all(axis=2).sum(axis=1)
    many = f" or of several subjects at once ({int(present.max())} points, {size} markers)"
    several = many if np.median(present) >= CROWDED * size else ""
    return JobError(
        f"does not look like a take of model {name}{several}: {share:.0%} of its markers were recognised for sure; "
        "expected a take of that marker set, so choose its model or train one"
    )
