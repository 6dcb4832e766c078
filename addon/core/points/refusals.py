# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that a model is not for: another marker set, or two subjects at once. Said, instead of garbled.

They show in what single frames say on their own. Trajectories that vote would make a name even of what no frame
was sure about, and of another marker set they vote as one for wrong names.
"""

from dataclasses import dataclass

import numpy as np

from ..data.errors import ForceableError, JobError
from ..data.lanes import blocks
from ..data.made import Table
from ..data.physical import MARKER_LIMITS
from ..data.takes import NO_MARKER, Labels, evenly_spread
from ..geometry.rigid import MIN_POINTS
from .models import USUAL_TARGET, Model, Namer
from .possible import FRAMES_ASKED, mistaken_unit


class REFUSAL:
    """When a take is refused; shares are of what could be given."""

    max_points: int = 400  # memory: of a frame; more are no marker system's
    # of a label that counts, or a rate of USUAL_TARGET, as who was trained on little may never promise it; with half of
    # it two crowds of ten are refused
    min_confidence: float = 0.99  # measured
    # share of the markers whose labels count: 0.13 at least in takes of the model's, 0 of plates by other sets, 0.05 at
    # most of people by a set on plates
    min_sure: float = 0.12  # measured
    # share of the markers that such a take is given in the end, with twice of it a person in two sets at once is
    # refused; and that frames must be sure of among the points that one subject leaves over, if they are another: of
    # spare markers 0.05 at most; where they are sure of fewer, it is asked whether they would be of so many in another
    # unit
    min_named: float = 0.25  # measured
    # the same where single frames are not sure: 0.97 at least in takes of other labs, 0.92 at most of other sets
    min_all: float = 0.75  # measured
    # times as many points as markers: 1.14 at most of one subject among 40 ghosts, 1.44 of who wears two sets, 2 of two
    # subjects, 2.3 at least among all that a lab puts on
    crowd: float = 1.6  # measured
    # share of the markers, and of the frames: of who is there half is seen, half of the time
    min_half: float = 0.5  # physical
    # mean square, over what training leaves, between markers and where the set has them: 0.14 to 0.2 on walks in a
    # crowd, 0.2 to 0.52 on people in each other's reach, 0.7 to 2.4 on other sets
    max_residual: float = 0.6  # measured
    # log odds a marker of where the set has it, where single frames are not sure: 5.1 at least in takes of other labs,
    # 4.7 at most of other sets and where many names are wrong
    min_layout: float = 4.9  # measured


def refuse_floods(points: Table):
    """Raises JobError where a frame of points (T, P, 3), NaN where missing, has more than can be worked with."""
    most = int(points_at_a_time(points).max(initial=0))
    if most > REFUSAL.max_points:
        raise JobError(f"has {most} points in one frame; expected the markers of a subject and some ghosts")


@dataclass(frozen=True)
class SetFit:
    """How markers that were named sit as their set has them."""

    # in a crowd, the usual square of what is left between markers and where their set has them, over what training
    # leaves; 0 where there is no crowd, and where no frame shows enough of them
    residual: float
    # nats a marker of the usual frame, by the shape of the training; minus infinity where no frame does
    log_likelihood: float
    # log odds a marker, by how far markers are from each other in all of the take, whatever the pose
    layout: float = -np.inf


NO_FIT = SetFit(0.0, -np.inf)


@dataclass(frozen=True, eq=False)
class Sample:
    """Some frames (F,) of a take and what each says on its own, (F, P); whether they are sure of the markers."""

    frames: np.ndarray
    labels: Labels
    sure: bool


def refuse_others(model: Model, namer: Namer, points: Table, solvable: bool = False) -> Sample:
    """Looks at some frames of points (T, P, 3) m, NaN where missing, before all of them are named.

    Which they are and what they say is returned.

    Of a take that is `solvable` as a whole, frames on their own need not be sure of one subject: then `refuse_unlike`
    has the say.

    Raises UnsuitedError where frames on their own are not sure of the model's markers, or would be surer of them in
    another unit, SubjectsError where they are of two subjects' at once.
    """
    count = points_at_a_time(points)
    frames = np.flatnonzero(count >= min(MIN_POINTS + 1, len(model.markerset)))
    if not len(frames):
        raise UnsuitedError("has no frame with enough points to tell markers apart; expected four or more at a time")
    frames = frames[evenly_spread(len(frames), FRAMES_ASKED)]
    some = points[frames]
    first = _each_alone(namer, some)
    alone = sure_share(first, some, len(model.markerset))
    found = alone >= REFUSAL.min_sure
    wanted = REFUSAL.min_named if found else REFUSAL.min_sure
    others = [part for part in _seconds(model, some, first, found) if _sure(model, namer, part) >= wanted]
    if len(others) + found >= 2:
        raise _two_subjects(model)
    if not found and not (solvable and _are_together(model, some)):
        raise _unrecognised(model, namer, some, _recognised(alone))
    # Of who is small for a wrong unit frames can be sure of some markers.
    if found and alone < REFUSAL.min_named and not is_crowd(some, model) and (unit := _unit_of(model, namer, some)):
        raise unit
    return Sample(frames, first, found)


def refuse_two_groups(model: Model, points: Table):
    """Raises SubjectsError where points (T, P, 3) m are in two groups, each of which may be a subject of the model.

    NaN where missing; some frames are looked at.
    """
    some = points[evenly_spread(len(points), FRAMES_ASKED)]
    if _grouped(some, MARKER_LIMITS.limb_m, REFUSAL.min_half * len(model.markerset)):
        raise _two_subjects(model)


def _are_together(model: Model, points: np.ndarray) -> bool:
    """Whether frames of points (T, P, 3) show one group of them that is large enough for a subject."""
    if model.likelihood is None:
        return False
    return not _grouped(points, model.likelihood.shape.radius, REFUSAL.min_half * len(model.markerset))


def refuse_unlike(model: Model, namer: Namer, points: Table, fit: SetFit, sure: bool = True):
    """Raises UnsuitedError where the markers found among points (T, P, 3) do not lie as the set's do, or are too few.

    Names can be found for any points, if there are enough. Among many more of them the residual tells and, where
    single frames were not `sure`, how far the markers are from each other.
    """
    if fit.residual > REFUSAL.max_residual or not (sure or fit.layout >= REFUSAL.min_layout):
        few, unlike = "no frame shows enough of its markers", "the points do not lie as its markers do"
        raise _unrecognised(model, namer, points, few if fit.log_likelihood == -np.inf else unlike)


def refuse_unrecognised(model: Model, namer: Namer, points: Table, given: Labels, sure: bool = True):
    """Raises UnsuitedError where the labels given (T, P) are so few that points (T, P, 3) are of another marker set.

    The labels are those of the usual target: of a stricter one there are few in any take. Where single frames were not
    `sure`, nearly all must have one.
    """
    share = given.named.sum() / _possible(points, len(model.markerset))
    if share < (REFUSAL.min_named if sure else REFUSAL.min_all):
        raise _unrecognised(model, namer, points, _recognised(share))


def sure_share(named: Labels, points: Table, markers: int) -> float:
    """The share of the markers, or of the points (T, P, 3) if they are fewer, that frames alone are sure of."""
    return float(is_sure(named).sum() / _possible(points, markers))


def is_sure(named: Labels) -> np.ndarray:
    """(T, P) the labels of single frames that count."""
    return (named.sure(USUAL_TARGET) != NO_MARKER) | (named.confidence >= REFUSAL.min_confidence)


def _seconds(model: Model, points: np.ndarray, first: Labels, found: bool) -> list[np.ndarray]:
    """The points (T, P, 3) of each who may be a subject beside the one that was named, if one was; NaN elsewhere."""
    size = len(model.markerset)
    crowded = points_at_a_time(points) >= REFUSAL.crowd * size
    if crowded.mean() < REFUSAL.min_half:
        return []
    if found:
        return [np.where(~first.named[..., None], points, np.nan)]
    if model.likelihood is None:
        return []
    chosen = _grouped(points, model.likelihood.shape.radius, REFUSAL.min_half * size)
    if not chosen:
        return []
    return [np.array([np.where(own[place][:, None], frame, np.nan) for frame, own in chosen]) for place in (0, 1)]


def _grouped(points: np.ndarray, gap: float, least: float) -> list[tuple[np.ndarray, list[np.ndarray]]]:
    """The frames of points (T, P, 3) that show two groups of `least` points or more, with them; none where few do."""
    groups = [far_groups(frame, gap, least) for frame in points]
    chosen = [(frame, own) for frame, own in zip(points, groups, strict=True) if len(own) >= 2]
    return chosen if len(chosen) >= REFUSAL.min_half * len(points) else []


def far_groups(points: np.ndarray, gap: float, least: float) -> list[np.ndarray]:
    """(P,) which of points (P, 3) m are together, for every group of `least` points or more; the largest first.

    Two groups are `gap` m from each other or more: what two subjects in one room look like before anything is named.
    """
    there = np.flatnonzero(np.isfinite(points).all(axis=1))
    if len(there) < 2:
        return []
    # Axis by axis: NumPy is slow to add up three of something.
    x, y, z = ((axis[:, None] - axis) ** 2 for axis in points[there].T)
    near = x + y + z <= gap**2
    found, left = [], near.sum(axis=1) > (1 if least > 1 else 0)  # most ghosts are near to nothing, and no group
    while left.any():
        group, before = near[left.argmax()], 0
        while group.sum() > before:  # whoever is near to one of them
            before, group = group.sum(), near[group].any(axis=0)
        left &= ~group
        own = np.zeros(len(points), dtype=bool)
        own[there[group]] = True
        found.append(own)
    return sorted((own for own in found if own.sum() >= least), key=lambda own: -own.sum())


def _sure(model: Model, namer: Namer, points: np.ndarray) -> float:
    """How sure the frames of points (T, P, 3) m are of the model's markers, 0 where there are seldom enough points."""
    size = len(model.markerset)
    enough = points_at_a_time(points) >= REFUSAL.min_half * size
    if enough.mean() < REFUSAL.min_half:
        return 0.0
    return sure_share(_each_alone(namer, points[enough]), points[enough], size)


def _each_alone(namer: Namer, points: np.ndarray) -> Labels:
    """What single frames of points (T, P, 3) m say."""
    return Labels.join(namer.name(points, 0.0))


def points_at_a_time(points: Table) -> np.ndarray:
    """(T,) how many of points (T, P, 3), NaN where missing, are there."""
    count = np.zeros(len(points), int)
    for part in blocks(*points.shape[:2]):
        count[part] = np.isfinite(points[part]).all(axis=2).sum(axis=1)
    return count


def is_crowd(points: Table, model: Model) -> bool:
    """Whether the usual frame of points (T, P, 3), NaN where missing, has many more than the model's markers."""
    return bool(np.median(points_at_a_time(points)) >= REFUSAL.crowd * len(model.markerset))


def _possible(points: Table, markers: int) -> int:
    """How many labels could be given, all frames together."""
    return max(int(np.minimum(points_at_a_time(points), markers).sum()), 1)


HOW_TO_ASK = "by --model MODEL and --subjects 2 or auto"  # on the command line; Blender puts words of its sidebar there


class UnsuitedError(ForceableError):
    """A take that the model is not for."""


class SubjectsError(UnsuitedError):
    """A take of several subjects, where fewer were asked for."""


def _two_subjects(model: Model) -> SubjectsError:
    words = f"shows two subjects or more that wear {model.markerset.name}"
    return SubjectsError(f"{words}; expected a take of one, so ask for all of them {HOW_TO_ASK}")


def _recognised(share: float) -> str:
    """A share of what points could be of a set's markers: of those of a part of a body there are fewer than it has."""
    return f"{share:.0%} of what could be its markers was recognised for sure"


def _unit_of(model: Model, namer: Namer, points: np.ndarray) -> UnsuitedError | None:
    """What is said where frames of points (F, P, 3) m are of the model in another unit; in a crowd their size tells."""
    sure = (lambda scaled: _sure(model, namer, scaled) >= REFUSAL.min_named) if not is_crowd(points, model) else None
    unit = mistaken_unit(model, points, sure)
    return None if unit is None else UnsuitedError(unit.message)


def _unrecognised(model: Model, namer: Namer, points: Table, why: str) -> UnsuitedError:
    name, size = model.markerset.name, len(model.markerset)
    unit = _unit_of(model, namer, points[evenly_spread(len(points), FRAMES_ASKED)])
    if unit:
        return unit
    present = points_at_a_time(points)
    many = f" or of several subjects at once ({int(present.max())} points, {size} markers)"
    several, ask = (many, f", or ask for several {HOW_TO_ASK}") if is_crowd(points, model) else ("", "")
    return UnsuitedError(
        f"does not look like a take of model {name}{several}: {why}; "
        f"expected a take of that marker set, so choose its model or train one{ask}"
    )
