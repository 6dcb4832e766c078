# SPDX-License-Identifier: GPL-3.0-or-later
"""How likely a tracklet is each marker, by its distances to the markers that are named beside it."""

from dataclasses import dataclass

import numpy as np

from ...data.takes import NO_MARKER
from .pairs import PairDistances
from .tracklets import Tracklets


@dataclass(frozen=True)
class LikenessOptions:
    """How distances are weighed. All reckoned.

    neighbours        of a marker whose distances keep best, and are there, that are asked
    considered        of a marker, of which those are taken
    min_neighbours    below which nothing is said
    independent       of the neighbours asked: their distances err together
    max_square        standard deviations², beyond which a distance is no worse
    wide_m            that a marker's place is known to, whatever its neighbours say
    ghost_density     points that are no marker in a cubic metre
    sample_s          that a tracklet must be longer to say as much again, and
    max_samples       what it can say at most, in such times
    block             tracklets at once
    max_gap_s         over which a marker goes on as it did,
    change_s          in which its distances become what they are at any time, and
    link_sd_m         by which they change in no time
    """

    neighbours: int = 12
    considered: int = 18
    min_neighbours: int = 3
    independent: float = 4.0
    max_square: float = 16.0
    wide_m: float = 0.5
    ghost_density: float = 0.3
    sample_s: float = 0.25
    max_samples: float = 6.0
    block: int = 32
    max_gap_s: float = 0.5
    change_s: float = 0.3
    link_sd_m: float = 0.006


LIKENESS = LikenessOptions()
NOTHING_SAID = 0.0  # log odds of a marker that nothing is known of at the time


def likeness(
    tracklets: Tracklets, placed: np.ndarray, own: np.ndarray, pairs: PairDistances, rate: float
) -> np.ndarray:
    """(N, M) log odds that each tracklet is each marker, against none at all, the others being where they are `placed`.

    placed (T, M, 3) m; own (N,) the marker that a tracklet is itself named so far, which does not speak for it.
    """
    markers = placed.shape[1]
    near, rows = _steadiest(pairs.variance), np.arange(markers)[:, None]
    mean, variance = (of_pair[rows, near].astype(np.float32) for of_pair in (pairs.mean, pairs.variance))
    found = np.empty((len(tracklets), markers))
    worth = worth_of_length(tracklets, rate)
    for first in range(0, len(tracklets), LIKENESS.block):
        some = slice(first, first + LIKENESS.block)
        each = _of_frames(tracklets.frame[some], tracklets.xyz[some], placed, own[some], near, mean, variance)
        seen = np.isfinite(each)
        count = seen.sum(axis=1)
        middle = np.where(seen, each, 0).sum(axis=1) / np.maximum(count, 1)
        enough = count >= 0.5 * (tracklets.frame[some] >= 0).sum(axis=1)[:, None]
        found[some] = np.where(enough, middle * worth[some, None], NOTHING_SAID)
    return found


def worth_of_length(tracklets: Tracklets, rate: float) -> np.ndarray:
    """(N,) independent frames that each tracklet says as much as, at `rate` frames a second."""
    length = (tracklets.last - tracklets.first + 1) / rate
    return np.minimum(1 + length / LIKENESS.sample_s, LIKENESS.max_samples)


def _steadiest(variance: np.ndarray) -> np.ndarray:
    """(M, Q) the neighbours of each marker whose distances vary (M, M) least."""
    others = np.where(np.eye(len(variance), dtype=bool), np.inf, variance)
    return np.argsort(others, axis=1)[:, : min(LIKENESS.considered, len(variance) - 1)]


def _of_frames(frame, xyz, placed, own, near, mean, variance) -> np.ndarray:
    """(B, S, M) the log odds in each frame (B, S) that is looked at; NaN where too little is known."""
    beside = _without(placed[np.maximum(frame, 0)], own)[:, :, near]
    odds = _odds(xyz[:, :, None, None] - beside, mean, variance)
    return np.where((frame >= 0)[..., None], odds, np.nan)


def _without(placed: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Markers placed (B, ..., M, 3) without each tracklet's own (B,)."""
    rows = np.flatnonzero(own != NO_MARKER)
    placed = placed.copy()
    placed[rows, ..., own[rows], :] = np.nan
    return placed


def _odds(away: np.ndarray, mean: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """(..., M) log odds of points that are `away` (..., M, Q, 3) m from neighbours, of distances so much expected.

    The distances make a normal density in space, whose precision is that of all of them together.
    """
    distance = np.sqrt(np.einsum("...i,...i->...", away, away))
    there = np.isfinite(distance) & np.isfinite(mean) & np.isfinite(variance)
    there &= np.cumsum(there, axis=-1, dtype=np.int8) <= LIKENESS.neighbours
    asked = there.sum(axis=-1)
    share = worth_of_each(asked).astype(np.float32)
    away = np.where(there[..., None], away, 0)
    distance = np.where(there, distance, 1.0)
    variance = np.where(there, variance, 1.0)
    square = np.where(there, (distance - np.where(there, mean, 1.0)) ** 2 / variance, 0)
    square = np.minimum(square, LIKENESS.max_square).sum(axis=-1) * share
    weight = share[..., None] / (variance * distance**2)
    wide = LIKENESS.wide_m**-2
    spread = (away * weight[..., None]).swapaxes(-1, -2) @ away
    a, b, c = (spread[..., axis, axis].astype(float) + wide for axis in range(3))
    d, e, f = (spread[..., one, two].astype(float) for one, two in ((0, 1), (0, 2), (1, 2)))
    precision = np.maximum(a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e), wide**3)
    odds = 0.5 * np.log(precision) - 1.5 * np.log(2 * np.pi) - 0.5 * square - np.log(LIKENESS.ghost_density)
    return np.where(asked >= LIKENESS.min_neighbours, odds, np.nan)


def worth_of_each(asked: np.ndarray | int) -> np.ndarray:
    """The part for which each of so many neighbours counts, so that all together say no more than the independent."""
    return np.minimum(1, LIKENESS.independent / np.maximum(asked, 1))


def links(tracklets: Tracklets, placed: np.ndarray, own: np.ndarray, pairs: PairDistances, rate: float) -> np.ndarray:
    """(N, M) log odds that each tracklet goes on as a marker did before it, and as the marker does after it.

    Over a gap the distances to its neighbours hardly change; 0 where nothing is named near in time.
    """
    markers, near = placed.shape[1], _steadiest(pairs.within)
    within = pairs.within[np.arange(markers)[:, None], near].astype(np.float32)
    there = np.isfinite(placed[..., 0])
    frames = np.arange(len(placed))[:, None]
    before = np.maximum.accumulate(np.where(there, frames, -1), axis=0)
    after = np.minimum.accumulate(np.where(there, frames, len(placed))[::-1], axis=0)[::-1]
    most = LIKENESS.max_gap_s * rate
    found = np.zeros((len(tracklets), markers))
    ends = ((tracklets.first, before, -1, 0), (tracklets.last, after, 1, tracklets.frame.argmax(axis=1)))
    for frame, nearest, step, sample in ends:
        beyond = np.clip(frame + step, 0, len(placed) - 1)
        then = np.where((beyond == frame + step)[:, None], nearest[beyond], -1)
        gap = np.abs(frame[:, None] - then)
        known = (then >= 0) & (then < len(placed)) & (gap <= most)
        xyz = tracklets.xyz[np.arange(len(tracklets)), sample]
        for first in range(0, len(tracklets), LIKENESS.block):
            some = slice(first, first + LIKENESS.block)
            at = np.clip(then[some], 0, len(placed) - 1)
            old = _without(placed[at], own[some])
            index = np.arange(markers)
            mean = np.linalg.norm(
                placed[at, index][:, :, None] - np.take_along_axis(old, near[None, ..., None], axis=2), axis=-1
            )
            part = np.minimum((gap[some] / (LIKENESS.change_s * rate)) ** 2, 1).astype(np.float32)
            variance = LIKENESS.link_sd_m**2 + within * part[..., None]
            beside = _without(placed[frame[some]], own[some])[:, near]
            odds = _odds(xyz[some, None, None] - beside, mean, variance)
            found[some] += np.where(known[some], np.nan_to_num(odds), 0)
    return found
