# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that cannot be as they say, by what people are and can do: a unit, a rate, an order that is wrong.

A rate that is too low can be: who moves slowly may do so. It is no more than said.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from ..data.errors import ForceableError, JobError
from ..data.lanes import Lanes
from ..data.made import Table
from ..data.takes import evenly_spread
from ..geometry.rigid import MIN_POINTS
from .models import Model
from .tracklets import are_trajectories

GRAVITY = 9.81  # m/s², physical
UNIT_M = {"mm": 0.001, "cm": 0.01, "inches": 0.0254, "m": 1.0}  # metres in one of each; format


@dataclass(frozen=True)
class PossibleOptions:
    """What cannot be, and how it is looked at.

    part           physical: of the frames; nothing of a body falls faster than by gravity, so it is pushed up by that
                   on average, and by more than four times that in no more than a quarter of the time
    step_s         physical: s, over which accelerations are taken; noise of 3 mm adds a tenth of the limit to them
    min_reach_m    physical: from end to end of a frame's points, longer than a hand, which can be shaken faster
    nearer         measured: times nearer than the frames beside it another frame is, where they are out of order; 1.1
                   at most in takes as recorded, 8 and more in others
    max_size       physical: times larger or smaller than those of a set's usual wearer markers are, in the right unit:
                   from the shortest newborn to the tallest man there ever was it is 0.25 to 1.6
    slow_hz        physical: cameras that look at markers take as many pictures a second at least; and
    slow_speed     measured: m/s, beyond which next to no point of people is who get about, at a tenth of their rate:
                   0.7 at most there, 1.2 at least at their own
    """

    part: float = 0.25
    step_s: float = 0.04
    min_reach_m: float = 0.3
    nearer: float = 4.0
    max_size: float = 3.0
    slow_hz: float = 25.0
    slow_speed: float = 0.8


POSSIBLE = PossibleOptions()
FRAMES_LOOKED_AT = 200  # spread over the take, and
COLUMNS_LOOKED_AT = 100  # which have the most points; by time
FRAMES_THAT_TELL = 20  # of which a quarter is more than chance


def refuse_impossible(points: Table, rate: float, lanes: Lanes | None, models: Iterable[Model]):
    """Raises ForceableError where points (T, L, 3) m, NaN where missing, move at `rate` frames a second as nobody can.

    It says what is wrong: the unit, by the size of what the models are of, the order of the frames, or the rate.
    Points that are in no order within their frames follow nothing, and are let pass; so is what stands or is slow.
    """
    gravities = usual_acceleration(points, rate) / GRAVITY
    if gravities <= 1 / POSSIBLE.part:
        return
    some = points[evenly_spread(len(points), FRAMES_LOOKED_AT)]
    for unit in filter(None, (mistaken_unit(model, some) for model in models)):
        raise unit
    if times_nearer(points) >= POSSIBLE.nearer:
        raise ForceableError(
            "has its frames out of order: most look far more like some other frame than like those before and after; "
            "expected frames in the order in which they were recorded"
        )
    if are_trajectories(points, lanes):
        raise ForceableError(
            f"has a rate that cannot be: at {rate:g} Hz half of its points accelerate by more than {gravities:.0f} "
            "times gravity in a quarter of the frames, which nobody can; expected the rate at which it was recorded, "
            f"such as {rate / 10:g} Hz"
        )


def slow_words(points: np.ndarray, rate: float) -> str:
    """What to look at where points (T, L, 3) m that get about do so as at a rate ten times too low; else empty."""
    chosen = evenly_spread(max(len(points) - 1, 0), FRAMES_LOOKED_AT)
    speed = np.linalg.norm(points[chosen + 1] - points[chosen], axis=2) * rate
    if rate > POSSIBLE.slow_hz or np.isfinite(speed).sum() < FRAMES_LOOKED_AT:
        return ""
    there = points[chosen][:, np.isfinite(speed).any(axis=0)]
    about, fast = np.median(_reach(there.swapaxes(0, 1))), np.nanquantile(speed, 0.99)
    if about < POSSIBLE.min_reach_m or fast > POSSIBLE.slow_speed:
        return ""
    return f"nothing is faster than {fast:.1g} m/s at {rate:g} Hz: look whether the rate is ten times as high"


def mistaken_unit(
    model: Model, points: np.ndarray, sure: Callable[[np.ndarray], bool] | None = None
) -> JobError | None:
    """What is said where points (F, P, 3) m are those of the model in another unit than they are taken for.

    By their size; `sure` says of points in the right unit whether they are the model's, where that can be asked.
    """
    if model.likelihood is None:
        return None
    own, seen = _sizes(model.likelihood.shape.mean[None]), _sizes(points)
    off = {pair: np.abs(np.log(seen * UNIT_M[pair[0]] / UNIT_M[pair[1]] / own)) for pair in permutations(UNIT_M, 2)}
    near = [pair for pair in off if (off[pair] < np.log(POSSIBLE.max_size)).all()]
    for unit, taken_for in sorted(near, key=lambda pair: off[pair][0]):
        times = UNIT_M[taken_for] / UNIT_M[unit]
        apart = f"times as far apart as those of {model.markerset.name}"
        if sure is not None and sure(points / times):
            words = f"seems to be in {unit} and is taken for {taken_for}: its points are {times:.4g} {apart}"
            return JobError(f"{words}; expected a file that says their unit")
        # What fits in two units by its size is in neither for sure.
        if sure is None and max(times, 1 / times) > POSSIBLE.max_size**2:
            roughly = float(f"{np.sqrt((seen / own).prod()):.1g}")
            words = f"has a unit that cannot be: its points are about {roughly:g} {apart}"
            return JobError(f"{words}; expected a file that says their unit")
    return None


def usual_acceleration(points: Table, rate: float) -> float:
    """m/s², beyond which half of points (T, L, 3) m accelerate in `part` of the frames; 0 where too few tell.

    A column that was empty in between may hold another point: some programs fill it with the next that appears.
    """
    step = max(round(POSSIBLE.step_s * rate), 1)
    middle = step + evenly_spread(max(len(points) - 2 * step, 0), FRAMES_LOOKED_AT)
    before, now, after = (points[middle + off].astype(float) for off in (-step, 0, step))
    found = np.linalg.norm(before - 2 * now + after, axis=2) * (rate / step) ** 2
    for off in range(1 - step, step):
        found[np.isnan(points[middle + off][..., 0])] = np.nan
    enough = np.isfinite(found).sum(axis=1) >= MIN_POINTS
    if enough.sum() < FRAMES_THAT_TELL or np.median(_reach(now[enough])) < POSSIBLE.min_reach_m:
        return 0.0
    return float(np.quantile(np.nanmedian(found[enough], axis=1), 1 - POSSIBLE.part))


def times_nearer(points: Table) -> float:
    """How many times nearer to the usual frame of points (T, L, 3) m another is than the nearest of those beside it."""
    chosen = 1 + evenly_spread(max(len(points) - 2, 0), FRAMES_LOOKED_AT)
    there = np.isfinite(points[chosen]).all(axis=2).sum(axis=0)
    columns = np.sort(np.argsort(-there, kind="stable")[:COLUMNS_LOOKED_AT])
    before, now, after = (points[chosen + off][:, columns].astype(float) for off in (-1, 0, 1))
    beside = np.fmin(_apart(now, before), _apart(now, after))
    nearest = np.full(len(now), np.nan)
    for one, frame in enumerate(now):
        others = np.delete(now, one, axis=0)
        nearest[one] = np.nanmin(_apart(others, frame), initial=np.inf)
    enough = np.isfinite(beside) & np.isfinite(nearest)
    ratio = np.where(beside[enough] > 0, beside[enough] / np.maximum(nearest[enough], np.finfo(float).tiny), 0.0)
    return float(np.median(ratio)) if len(ratio) >= FRAMES_THAT_TELL else 0.0


def _apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(F,) m, how far half of the points (F, C, 3) m of a frame are at least from those of another; NaN of too few."""
    distance = np.linalg.norm(one - other, axis=2)
    enough = np.isfinite(distance).sum(axis=1) >= MIN_POINTS
    found = np.full(len(one), np.nan)
    found[enough] = np.nanmedian(distance[enough], axis=1)
    return found


def _reach(points: np.ndarray) -> np.ndarray:
    """(F,) m, how far points (F, L, 3) m, of which each row has some, reach from end to end along some axis."""
    return (np.nanmax(points, axis=1) - np.nanmin(points, axis=1)).max(axis=1)


def _sizes(points: np.ndarray) -> np.ndarray:
    """(2,) m, how far the usual point of frames (T, P, 3) is from the middle of all, and from the one next to it."""
    out, beside = [np.nan], [np.nan]
    for frame in points:
        there = frame[np.isfinite(frame).all(axis=1)]
        if len(there) > 1:
            out.extend(np.linalg.norm(there - np.median(there, axis=0), axis=1))
            distance = np.linalg.norm(there[:, None] - there[None], axis=2)
            np.fill_diagonal(distance, np.inf)
            beside.extend(distance.min(axis=1))
    return np.array([np.median(some[1:]) if len(some) > 1 else np.nan for some in (out, beside)])
