# SPDX-License-Identifier: GPL-3.0-or-later
"""How far any two markers are from each other: what training knows, and what the take itself shows of its subject.

What a single frame's likelihood asks, how usual a pose is, counts for nothing here: only distances that keep, on one
bone or across a joint, and how well they keep, which the take tells best.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...data.lanes import PACKING
from ...data.physical import MARKER_LIMITS
from ...data.takes import evenly_spread
from ...kernels import point_calls, stands_for
from ..likelihood.distances import CONSTRAINING
from ..likelihood.model import Likelihood
from ..likelihood.shape import SUBJECT_PRIOR
from ..models import Model


class PAIRING:
    """How distances are learned."""

    min_frames: int = 30  # physical: of a subject, or of a tracklet, that show how it moves: a third of a second
    # s, the same of a tracklet that has few frames a second: less than a step; with 30 frames in its place, 4 % of
    # names at 25 a second are wrong, and with this alone 6 % of a take at 240
    min_s: float = 0.3  # physical
    shapes: int = 400  # memory: drawn from a likelihood of which few frames were kept
    # of a distance of other subjects than those of the training, besides their size, in parts of it; with 0.03 two of
    # 48 parts of people lose 4 and 13 % of their names
    length_sd: float = 0.04  # measured
    # m, between two markers that may be taken for each other: a forearm or a shank's half
    max_confused_m: float = 0.35  # physical
    # frames that training's spread counts for when the take shows another; half of it loses 1 % of still trials
    within_frames: float = 8.0  # measured
    # the same of a guess where training knows nothing; with as many, people of other labs lose 5 %, and names of 2 %
    # are wrong
    unknown_frames: float = 0.5  # measured
    # of a subject's size, that distances vary by where poses are shown; standing is 0.01
    min_sway: float = 0.03  # physical
    # frames of a take that say as much as one independent one, as neighbours show the same pose; with 1 plates lose 2 %
    independent: float = 4.0  # measured
    block: int = 64  # memory: frames at once


@dataclass(frozen=True, eq=False)
class PairDistances:
    """Distances (M, M) between markers, m: their mean, how unsure that is (variance, m²), and their own variance, m².

    NaN where nothing is known.
    """

    mean: np.ndarray
    unsure: np.ndarray
    within: np.ndarray

    @property
    def variance(self) -> np.ndarray:
        """(M, M) of a distance that is seen next, m²."""
        return self.unsure + self.within + MARKER_LIMITS.skin_m**2


@lru_cache(maxsize=1)  # asked twice of each take, and takes often follow each other with one model
def trained_pairs(model: Model) -> PairDistances:
    """What training knows: of the frames that the model keeps or, where these show one pose, of its likelihood.

    Who stood still shows no more than what keeps, and so does a single frame; how all else moves is in the likelihood,
    for which it was made up if a body is known. ValueError where the model has neither.
    """
    own = [moments(points) for points in model.subjects.values()]
    long = [one for one in own if one.frames >= PAIRING.min_frames]
    moving = [one for one in long if not is_still(one)]
    if moving or (long and not len(model.markerset.spread.modes)):
        return _of_subjects(moving or long)
    made_up = _of_shape(model.learned_likelihood)
    if not own:
        return made_up
    seen, keeps = _of_subjects(own), np.zeros(made_up.mean.shape, bool)
    keeps[tuple(model.learned_likelihood.constraints.pair.T)] = True
    keeps = (keeps | keeps.T) & np.isfinite(seen.mean)
    shown = zip((seen.mean, seen.unsure, seen.within), (made_up.mean, made_up.unsure, made_up.within), strict=True)
    return PairDistances(*(np.where(keeps, one, other) for one, other in shown))


@lru_cache(maxsize=1)  # asked of each take, and of each window of a stream
def stood(model: Model) -> bool:
    """Whether all who taught a set stood still: how their distances vary the take alone shows then."""
    own = [moments(points) for points in model.subjects.values()]
    return bool(own) and all(map(is_still, own))


def _of_subjects(own: Sequence["Moments"]) -> PairDistances:
    """What subjects show, of whatever size each is."""
    means, within, counts = (np.stack([getattr(one, name) for one in own]) for name in ("mean", "variance", "count"))
    seen = counts > 0
    number = seen.sum(axis=0)
    size = np.ones(len(own))
    for _ in range(2):
        sized = np.where(seen, means / size[:, None, None], 0)
        mean = np.where(number > 0, sized.sum(axis=0) / np.maximum(number, 1), np.nan)
        size = np.array(
            [
                np.nanmedian(np.where(there & (mean > 0), one / np.maximum(mean, 1e-9), np.nan))
                for one, there in zip(means, seen, strict=True)
            ]
        )
    between = np.where(seen, sized - mean, 0) ** 2
    between = between.sum(axis=0) / np.maximum(number - 1, 1)
    within = np.where(seen, within, 0).sum(axis=0) / np.maximum(number, 1)
    return PairDistances(mean, between + _guess(mean), within)


def _guess(mean: np.ndarray) -> np.ndarray:
    """Variance of distances (M, M) on a subject never seen, whatever training shows, m²."""
    return (PAIRING.length_sd * mean) ** 2 + MARKER_LIMITS.placed_m**2


def _of_shape(likelihood: Likelihood) -> PairDistances:
    shape, rng = likelihood.shape, np.random.default_rng(0)
    pose = rng.standard_normal((PAIRING.shapes, shape.modes.shape[2]))
    clouds = shape.mean + np.einsum("fk,mak->fma", pose, shape.modes)
    clouds = clouds + np.sqrt(shape.noise)[:, None] * rng.standard_normal(clouds.shape)
    shown = moments(clouds)
    mean, guess = shown.mean, _guess(shown.mean)
    within = np.maximum(shown.variance - guess, 0.1 * shown.variance)
    one, other = likelihood.constraints.pair.T
    sd = likelihood.constraints.sd
    mean[one, other] = mean[other, one] = likelihood.constraints.length
    within[one, other] = within[other, one] = sd**2 / 2
    guess[one, other] = guess[other, one] = sd**2 + _guess(likelihood.constraints.length)
    return PairDistances(mean, guess, within)


def widened(trained: PairDistances, bend: float, motion_m: float, layout_m: float) -> PairDistances:
    """The same where subjects move, and wear their markers, farther from the training than is usual."""
    within = np.maximum(trained.within, (bend * np.nan_to_num(trained.mean) ** 2) ** 2)
    return PairDistances(trained.mean, trained.unsure + layout_m**2, within + motion_m**2)


def with_unknown(trained: PairDistances, count: int) -> PairDistances:
    """The same with so many markers more, of which nothing is known."""
    if not count:
        return trained
    markers = len(trained.mean)
    every = np.full((3, markers + count, markers + count), np.nan)
    every[:, :markers, :markers] = trained.mean, trained.unsure, trained.within
    return PairDistances(*every)


@dataclass(frozen=True, eq=False)
class Moments:
    """Mean (m), variance (m²) and number of frames of all distances (M, M) in so many frames."""

    mean: np.ndarray
    variance: np.ndarray
    count: np.ndarray
    frames: int


def is_still(shown: Moments) -> bool:
    """Whether frames of a subject show it in one pose: nine of ten distances hardly vary."""
    known = shown.count > 1
    if not known.any():
        return True
    size = np.sqrt(np.mean(shown.mean[known] ** 2) / 2)  # from the middle, as `cloud_radius` has it
    return bool(np.quantile(np.sqrt(shown.variance[known]), 0.9) <= PAIRING.min_sway * size)


def in_take(trained: PairDistances, placed: np.ndarray) -> PairDistances:
    """What the markers as they are named so far, (T, M, 3) m, NaN where they are not, add to what is known."""
    return corrected(trained, moments(placed))


def without_markers(shown: Moments, some: np.ndarray) -> Moments:
    """The same where some markers (B,) are nowhere."""
    count = shown.count.copy()
    count[some] = count[:, some] = 0
    return Moments(shown.mean, shown.variance, count, shown.frames)


def corrected(trained: PairDistances, shown: Moments) -> PairDistances:
    """What a take shows of distances, added to what is known."""
    mean, within, count = shown.mean, shown.variance, shown.count
    coverage = count / max(shown.frames, 1)
    count = count / PAIRING.independent
    some = count > 0
    mean, within = np.where(some, mean, 0), np.where(some, within, 0)
    size, size_variance = _size(trained, mean, within, count)
    prior = np.where(np.isfinite(trained.mean), size * trained.mean, mean)
    unsure = np.where(np.isfinite(trained.unsure), trained.unsure + size_variance * prior**2, 1.0)
    known = np.where(np.isfinite(trained.within), trained.within, 0.01)
    counts_for = np.where(np.isfinite(trained.within), PAIRING.within_frames, PAIRING.unknown_frames)
    part = coverage * count / (count + counts_for)
    spread = (1 - part) * known + part * within
    sampling = (spread + MARKER_LIMITS.skin_m**2) / np.maximum(count, 1e-9)
    weight = np.where(some, unsure / (unsure + sampling), 0)
    return PairDistances(prior + weight * (mean - prior), (1 - weight) * unsure, spread)


def sized(trained: PairDistances, shown: Moments) -> float:
    """The size of a subject whose distances a take shows, 1 for that of the training."""
    some = shown.count[: len(trained.mean), : len(trained.mean)]
    mean, within = (np.where(some > 0, part[: len(some), : len(some)], 0) for part in (shown.mean, shown.variance))
    return _size(trained, mean, within, some / PAIRING.independent)[0]


def _size(trained: PairDistances, mean: np.ndarray, within: np.ndarray, count: np.ndarray) -> tuple[float, float]:
    """The size of a subject of distances `mean` (M, M) m, 1 for that of the training, and its variance."""
    one, other = np.nonzero(np.triu((count > 1) & (trained.mean > 0), 1))
    length = trained.mean[one, other]
    ratio = np.log(np.maximum(mean[one, other], 1e-6) / length)
    off = (trained.unsure + trained.within + within)[one, other] / length**2
    # A marker is in many pairs, so these are not as many measurements as they look.
    weight = np.where(np.abs(ratio) < CONSTRAINING.max_size_ratio, 2 / (off * len(mean)), 0)
    known = weight.sum() + SUBJECT_PRIOR.size_sd**-2
    return float(np.exp((weight * ratio).sum() / known)), float(1 / known)


def moments(points: np.ndarray) -> Moments:
    """Of all distances (M, M) in some frames of (T, M, 3) m."""
    some = points[evenly_spread(len(points), PACKING.spread_out)].astype(float)
    total, squares, count = distance_sums(some)
    mean = total / np.maximum(count, 1)
    variance = np.maximum(squares / np.maximum(count, 1) - mean**2, 0) * count / np.maximum(count - 1, 1)
    return Moments(np.where(count > 0, mean, np.nan), variance, count, len(some))


@stands_for(point_calls.distance_sums)
def distance_sums(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sum, sum of squares and number (M, M) of all distances in frames (F, M, 3) m, NaN where a marker is missing."""
    total, squares, count = np.zeros((3, points.shape[1], points.shape[1]))
    for first in range(0, len(points), PAIRING.block):
        some = points[first : first + PAIRING.block]
        square = ((some[:, :, None] - some[:, None]) ** 2).sum(axis=3)
        seen = np.isfinite(square)
        square = np.where(seen, square, 0)
        total += np.sqrt(square).sum(axis=0)
        squares += square.sum(axis=0)
        count += seen.sum(axis=0)
    return total, squares, count
