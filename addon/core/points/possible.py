# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that cannot be as they say, by what people are and can do: a mirrored axis, a unit, a rate, an order.

A rate that is too low can be: who moves slowly may do so. It is no more than said. In a mirror left and right are
exchanged, and every name with them. A body looks the same there, and so does a marker set that has everything twice.
What is lopsided tells: a marker without its like on the other side. In labelled takes, whose names say which side is
which, the whole body does.
"""

from collections.abc import Callable, Iterable
from itertools import permutations
from math import log

import numpy as np
from threadpoolctl import threadpool_limits

from ..body.bodies import BodyModel
from ..body.prior import Prior
from ..body.sides import MIRROR, mirror_order
from ..data.errors import ForceableError
from ..data.lanes import Lanes
from ..data.made import Table
from ..data.markersets import MarkerSet, Worn
from ..data.physical import MARKER_LIMITS
from ..data.takes import evenly_spread
from ..geometry.rigid import MIN_POINTS, in_axes, laid_on
from ..posing.posing import POSING, fit_subject, labelled_pull
from .models import USUAL_TARGET, Model
from .tracklets import are_trajectories

GRAVITY = 9.81  # m/s², physical
UNIT_M = {"mm": 0.001, "cm": 0.01, "inches": 0.0254, "m": 1.0}  # metres in one of each; format


class POSSIBLE:
    """What cannot be, and how it is looked at."""

    part: float = 0.25  # measured: of the frames; in so many of them half of a body is never beyond `gravities`
    # times gravity: 8.2 in a sprint at 9.5 m/s with most markers on the legs, 14 to 48 in walks at ten times their rate
    gravities: float = 10.0  # measured
    # s, over which accelerations are taken; noise of 3 mm adds a tenth of the limit to them
    step_s: float = 0.04  # physical
    # from end to end of a frame's points, longer than a hand, which can be shaken faster
    min_reach_m: float = 0.3  # physical
    # times nearer than the frames beside it another frame is, where they are out of order; 1.1 at most in takes as
    # recorded, 8 and more in others
    nearer: float = 4.0  # measured
    # times larger or smaller than those of a set's usual wearer markers are, in the right unit: from the shortest
    # newborn to the tallest man there ever was it is 0.25 to 1.6
    max_size: float = 3.0  # physical
    slow_hz: float = 25.0  # physical: cameras that look at markers take as many pictures a second at least
    # m/s, beyond which next to no point of people is who get about, at a tenth of their rate: 0.7 at most there, 1.2 at
    # least at their own
    slow_speed: float = 0.8  # measured


FRAMES_ASKED = 40  # spread over a take, of which something slow is asked; by time
FRAMES_TRIED = 12  # the same, of which it is asked in several ways; by time
FRAMES_LOOKED_AT = 200  # spread over the take, and
COLUMNS_LOOKED_AT = 100  # which have the most points; by time
FRAMES_THAT_TELL = 20  # of which a quarter is more than chance


def refuse_impossible(points: Table, rate: float, lanes: Lanes | None, models: Iterable[Model]):
    """Raises ForceableError where points (T, L, 3) m, NaN where missing, move at `rate` frames a second as nobody can.

    It says what is wrong: the unit, by the size of what the models are of, the order of the frames, or the rate.
    Points that are in no order within their frames follow nothing, and are let pass; so is what stands or is slow.
    """
    gravities, speed = usual_acceleration(points, rate) / GRAVITY, usual_speed(points, rate)
    if gravities <= POSSIBLE.gravities and speed <= MARKER_LIMITS.fastest_m_s:
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
        what = f"are faster than {speed:.0f} m/s, which nobody is"
        if gravities > POSSIBLE.gravities:
            what = f"accelerate by more than {gravities:.0f} times gravity in a quarter of the frames, which nobody can"
        words = f"has a rate that cannot be: at {rate:g} Hz half of its points {what}"
        raise ForceableError(f"{words}; expected the rate at which it was recorded, such as {rate / 10:g} Hz")


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
) -> ForceableError | None:
    """What is said where points (F, P, 3) m are those of the model in another unit than they are taken for.

    By their size; `sure` says of points in the right unit whether they are the model's, where that can be asked.
    """
    if model.likelihood is None:
        return None
    return _mistaken_unit(model.markerset.name, model.likelihood.shape.mean[None], points, sure)


def _mistaken_unit(
    name: str, usual: np.ndarray, points: np.ndarray, sure: Callable[[np.ndarray], bool] | None = None
) -> ForceableError | None:
    """The same by a set's name, and frames (F, M, 3) m of its markers on their usual wearer."""
    own, seen = _sizes(usual), _sizes(points)
    with np.errstate(divide="ignore"):  # of points that are all in one place
        off = {pair: np.abs(np.log(seen * UNIT_M[pair[0]] / UNIT_M[pair[1]] / own)) for pair in permutations(UNIT_M, 2)}
    near = [pair for pair in off if (off[pair] < np.log(POSSIBLE.max_size)).all()]
    for unit, taken_for in sorted(near, key=lambda pair: off[pair][0]):
        times = UNIT_M[taken_for] / UNIT_M[unit]
        apart = f"times as far apart as those of {name}"
        if sure is not None and sure(points / times):
            words = f"seems to be in {unit} and is taken for {taken_for}: its points are {times:.4g} {apart}"
            return ForceableError(f"{words}; expected a file that says their unit")
        # What fits in two units by its size is in neither for sure.
        if sure is None and max(times, 1 / times) > POSSIBLE.max_size**2:
            roughly = float(f"{np.sqrt((seen / own).prod()):.1g}")
            words = f"has a unit that cannot be: its points are about {roughly:g} {apart}"
            return ForceableError(f"{words}; expected a file that says their unit")
    return None


def usual_acceleration(points: Table, rate: float) -> float:
    """m/s², beyond which half of points (T, L, 3) m accelerate in `part` of the frames; 0 where too few tell."""
    step = _step(rate)
    middle = step + evenly_spread(max(len(points) - 2 * step, 0), FRAMES_LOOKED_AT)
    before, now, after = (points[middle + off].astype(float) for off in (-step, 0, step))
    found = np.linalg.norm(before - 2 * now + after, axis=2) * (rate / step) ** 2
    enough, usual = _of_half(found, points, middle, range(1 - step, step))
    if not len(usual) or np.median(_reach(now[enough])) < POSSIBLE.min_reach_m:
        return 0.0
    return float(np.quantile(usual, 1 - POSSIBLE.part))


def usual_speed(points: Table, rate: float) -> float:
    """m/s, beyond which half of points (T, L, 3) m are in the usual frame, where these are too few for accelerations.

    What noise may add is taken off. 0 where there are more frames, and where too few of them tell.
    """
    more = len(points) - FRAMES_THAT_TELL
    if not 0 < more < 2 * _step(rate):
        return 0.0
    lag = min(more, FRAMES_THAT_TELL)
    chosen = evenly_spread(len(points) - lag, FRAMES_LOOKED_AT)
    found = np.linalg.norm(points[chosen + lag] - points[chosen], axis=2)
    usual = _of_half(found, points, chosen, range(1, lag))[1]
    return float(np.median(usual) - MARKER_LIMITS.max_noise_m) * rate / lag if len(usual) else 0.0


def _step(rate: float) -> int:
    """Frames over which accelerations are taken."""
    return max(round(POSSIBLE.step_s * rate), 1)


def _of_half(
    found: np.ndarray, points: Table, chosen: np.ndarray, between: Iterable[int]
) -> tuple[np.ndarray, np.ndarray]:
    """(F,) which of the chosen frames tell, none where few do, and for each of these the median of those found (F, L).

    A column that is empty so many frames off as `between` says may hold another point: some programs fill it with the
    next that appears.
    """
    for off in between:
        found[np.isnan(points[chosen + off][..., 0])] = np.nan
    enough = np.isfinite(found).sum(axis=1) >= MIN_POINTS
    if enough.sum() < FRAMES_THAT_TELL:
        enough[:] = False
    return enough, np.nanmedian(found[enough], axis=1)


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


# Log odds from which it is said, by as much as names must be sure of. Of 59 takes of all labs, those that have RBAC or
# RBAK are at 11.6 to 24 as they are, and at -11.6 to -24 mirrored.
SURE = log(USUAL_TARGET / (1 - USUAL_TARGET))


HOW_TO_MIRROR = "by label --mirror"  # on the command line; Blender puts words of its sidebar there
# What is expected of points as their file has them, of those that were mirrored as they were read, and of blobs.
MEND_POINTS = f"right-handed axes, so have its 3D points mirrored as they are read, {HOW_TO_MIRROR}"
MEND_MIRRORED = "points whose file is left-handed, so have these read as they are, without mirroring them"
MEND_BLOBS = "images and a calibration of which none is mirrored"


class MirroredError(ForceableError):
    """A take whose points are the mirror image of what was there."""


class Handedness:
    """Hears where the markers of a take are, part by part; says at its end whether all of it is mirrored.

    Of each segment that carries a marker without its like, the markers are laid on the set's in frames spread over the
    take, once as they are, and once in the mirror with the names of the sides exchanged. `expected` is what mends it.
    """

    def __init__(self, worn: Worn, expected: str = MEND_POINTS):
        self.expected = expected
        self.segments: list[_Segment] = []
        first = 0
        for name, markerset in worn.worn:
            self.segments += _lopsided(markerset, first, f"{name}:" if name else "")
            first += len(markerset)

    def add(self, markers: np.ndarray):
        """Adds markers (T, M, 3) m of all who are in the take, NaN where missing."""
        some = markers[evenly_spread(len(markers), FRAMES_ASKED)]
        for segment in self.segments:
            segment.add(some)

    def refuse(self):
        """Raises MirroredError where the take is mirrored for sure."""
        misfits = np.array([segment.misfits() for segment in self.segments]).reshape(-1, 2)
        plain, image = misfits.sum(axis=0)
        # In the mirror all is where the set has it; of wrong names it is nowhere.
        if plain - image > SURE and image < SURE:
            segment = self.segments[int((misfits[:, 0] - misfits[:, 1]).argmax())]
            why = f"{' and '.join(segment.names)} would be on the other side of the body"
            raise mirrored_error(why, self.expected)


def mirrored_error(why: str, expected: str = MEND_POINTS) -> MirroredError:
    """The refusal, and how to mend it."""
    return MirroredError(
        f"is left-handed: one axis is mirrored, as {why}, so left and right are exchanged; expected {expected}"
    )


class _Segment:
    """Markers on one segment, of which some are lopsided.

    names   of these
    source  (2, N) which of the take's markers each of them is, as the take is and in the mirror
    form    (N, 3) where the set has them, heights
    size    m, the mean stature
    judged  (N,) which are lopsided
    """

    def __init__(self, names: list[str], source: np.ndarray, form: np.ndarray, size: float, judged: np.ndarray):
        self.names, self.source, self.form, self.size, self.judged = names, source, form, size, judged
        self.total, self.count = np.zeros((2, *form.shape)), np.zeros(source.shape, int)

    def add(self, markers: np.ndarray):
        """Adds frames of all markers (T, M, 3) m, NaN where missing."""
        for way, axes in enumerate((np.ones(3), MIRROR)):
            points = markers[:, self.source[way]] * axes
            back = in_axes(*laid_on(self.size * self.form, points), points)
            seen = np.isfinite(back).all(axis=2)
            self.total[way] += np.where(seen[..., None], back, 0).sum(axis=0)
            self.count[way] += seen.sum(axis=0)

    def misfits(self) -> tuple[float, float]:
        """Minus the log density of where the lopsided markers are, as the take is, and in the mirror."""
        known = (self.count > 0).all(axis=0)
        if known.sum() <= MIN_POINTS:  # three and their mirror image are one form
            return 0.0, 0.0
        plain, image = (
            self._misfit(total[known] / count[known, None], known)
            for total, count in zip(self.total, self.count, strict=True)
        )
        return plain, image

    def _misfit(self, mean: np.ndarray, known: np.ndarray) -> float:
        form = self.form[known] - self.form[known].mean(axis=0)
        own = in_axes(*laid_on(form, mean[None]), mean[None])[0]
        off = own * (form**2).sum() / (own * form).sum() - form
        return float((off[self.judged[known]] ** 2).sum() / (2 * POSING.own_sd**2))


def _lopsided(markerset: MarkerSet, first: int, prefix: str) -> list[_Segment]:
    """The segments of a set, whose markers begin at `first` in the take, that carry a marker without its like."""
    order = mirror_order(markerset.markers)
    order = np.arange(len(markerset)) if order is None else order
    found = []
    for segment in range(len(markerset.skeleton)):
        own = np.flatnonzero(markerset.attachment == segment)
        alone = order[own] == own
        if alone.any() and len(own) > MIN_POINTS:
            off = np.abs(markerset.rest_markers[own, 1]) > POSING.own_sd  # where a marker of the middle may be
            names = [prefix + markerset.markers[index] for index in own[alone & off]]
            source = first + np.stack([own, order[own]])
            found.append(_Segment(names, source, markerset.offsets[own], markerset.spread.height, alone))
    return found


def refuse_labelled(markerset: MarkerSet, points: np.ndarray):
    """Raises ForceableError where points (T, M, 3) m, NaN where missing, labelled as in the set, cannot be so.

    They are in another unit, by their size, or mirrored for sure: a body is posed on some frames as they are, and on
    their mirror image; what is labelled may also have been named by us, which `Handedness` tells.
    """
    some = points[evenly_spread(len(points), FRAMES_ASKED)]
    usual = np.where(np.isfinite(some), markerset.spread.height * markerset.rest_markers, np.nan)
    unit = _mistaken_unit(markerset.name, usual, some)
    if unit is not None:
        raise unit
    there = np.isfinite(points[..., 0]).sum(axis=1)
    fullest = np.flatnonzero(there >= max(POSING.min_markers, there.max(initial=0) - 1))
    if not len(fullest):
        return
    some = points[fullest[evenly_spread(len(fullest), FRAMES_ASKED)]]
    model = BodyModel(markerset)
    prior = Prior(model)
    with threadpool_limits(1, user_api="blas"):
        (plain, _), (image, off) = (_posed(model, prior, one) for one in (some, some * MIRROR))
    # Names that are wrong otherwise fit no better in a mirror than by chance.
    if (plain - image) / 2 > SURE and off < POSING.own_sd:
        raise mirrored_error("the body of its labels is the mirror image of one")
    check = Handedness(markerset)
    check.add(points)
    check.refuse()


def _posed(model: BodyModel, prior: Prior, points: np.ndarray) -> tuple[float, float]:
    """Twice minus the log likelihood of the body in the usual one of frames (T, M, 3) m, and how far markers are off.

    The latter root mean square, in heights.
    """
    bodies = fit_subject(model, points, prior)
    markers = model.pose(bodies).markers
    off = np.linalg.norm(markers - points, axis=2) / bodies.scale.mean()
    cost = labelled_pull(points)(markers).cost + prior.terms(bodies)[0]
    return float(np.median(cost)), float(np.sqrt(np.nanmean(off**2)))
