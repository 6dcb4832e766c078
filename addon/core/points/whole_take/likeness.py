# SPDX-License-Identifier: GPL-3.0-or-later
"""How likely a tracklet is each marker, by its distances to the markers that are named beside it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...data.physical import MARKER_LIMITS
from ...data.takes import NO_MARKER
from ...geometry.rigid import MIN_POINTS
from ...kernels import point_calls, stands_for
from ...papers.virtual_occlusions.labelling import Rules
from ..tracklets import CUTTING, VOTE
from .pairs import PAIRING, PairDistances
from .tracklets import PlacedMarkers, Tracklets


@dataclass(frozen=True)
class LikenessOptions:
    """How distances are weighed."""

    # of a marker whose distances keep best, and are there, that are asked; with 8 people of other labs lose 2 %, with
    # 18 plates do
    neighbours: int = 12  # measured
    considered: int = 18  # measured: of a marker, of which those are taken; with 12 people of other labs lose 2 %
    min_neighbours: int = MIN_POINTS  # below which nothing is said: so many distances fix a place
    # of the neighbours asked, whose distances err together; with 3 names of 1 % of plates are wrong, with 6 still
    # trials lose 2 %
    independent: float = 4.0  # measured
    # standard deviations², beyond which a distance is no worse, and a blob is not the marker's; with 9 plates lose 2 %,
    # with 32 names of 1 % of crowds are wrong
    max_square: float = Rules.max_square
    wide_m: float = MARKER_LIMITS.limb_m  # m, that a marker's place is known to, whatever its neighbours say
    ghost_density: float = 0.3  # physical: points that are no marker in a cubic metre: one or two where a person moves
    # s that a tracklet must be longer to say as much again; with twice plates lose 2 %
    sample_s: float = 0.25  # measured
    # what it can say at most, in such times; with 4 names of 1 % of people of other labs are wrong, with 9 they lose
    # 3 %
    max_samples: float = 6.0  # measured
    block: int = 384  # memory: frames of tracklets at once
    change_s: float = PAIRING.min_s  # s, in which its distances become what they are at any time
    link_sd_m: float = MARKER_LIMITS.skin_m  # m, by which they change in no time


LIKENESS = LikenessOptions()
NO_EVIDENCE = 0.0  # log odds of a marker that nothing is known of at the time


def likeness(
    tracklets: Tracklets,
    placed: np.ndarray | PlacedMarkers,
    own: np.ndarray,
    pairs: PairDistances,
    rate: float,
    asked: np.ndarray | None = None,
) -> np.ndarray:
    """(N, M) log odds that each tracklet is each marker, against none at all, the others being where they are `placed`.

    placed (T, M, 3) m; own (N,) the marker that a tracklet is itself named so far, which does not speak for it. Minus
    infinity where it is not `asked` (N, M), if any is not.
    """
    markers = placed.shape[1]
    asked = np.ones((len(tracklets), markers), bool) if asked is None else asked
    near, rows = steadiest(pairs.variance), np.arange(markers)[:, None]
    mean, variance = pairs.mean[rows, near], pairs.variance[rows, near]
    found = np.empty((len(tracklets), markers))
    for some, frames in _by_frames(tracklets.frame):
        frame, beside = _looked_at(placed, tracklets.frame[some, :frames])
        given = frame, tracklets.xyz[some, :frames], beside, own[some], near, mean, variance, asked[some], LIKENESS
        found[some] = of_frames(*given)
    found = np.where(np.isnan(found), NO_EVIDENCE, found * worth_of_length(tracklets, rate)[:, None])
    return np.where(asked, found, -np.inf)


def _by_frames(frame: np.ndarray) -> Iterator[tuple[np.ndarray, int]]:
    """Rows of frames (N, S), -1 beyond those that each has, to look at together, and how many they have at most.

    Ghosts have one frame each, and there may be many of them.
    """
    count = (frame >= 0).sum(axis=1)
    order = np.argsort(-count, kind="stable")
    while len(order):
        most = max(int(count[order[0]]), 1)
        yield order[: max(LIKENESS.block // most, 1)], most
        order = order[max(LIKENESS.block // most, 1) :]


def _looked_at(placed: np.ndarray | PlacedMarkers, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frames (B, S), -1 for none, and markers placed (F, M, 3) m among which they are: of a long take these alone."""
    if isinstance(placed, np.ndarray):
        return frame, placed
    own, at = np.unique(np.maximum(frame, 0), return_inverse=True)
    return np.where(frame >= 0, at.reshape(frame.shape), -1), placed[own]


def worth_of_length(tracklets: Tracklets, rate: float) -> np.ndarray:
    """(N,) independent frames that each tracklet says as much as, at `rate` frames a second."""
    length = (tracklets.last - tracklets.first + 1) / rate
    return np.minimum(1 + length / LIKENESS.sample_s, LIKENESS.max_samples)


def steadiest(variance: np.ndarray) -> np.ndarray:
    """(M, Q) the neighbours of each marker whose distances vary (M, M) least."""
    others = np.where(np.eye(len(variance), dtype=bool), np.inf, variance)
    return np.argsort(others, axis=1)[:, : min(LIKENESS.considered, len(variance) - 1)]


@stands_for(point_calls.of_frames)
def of_frames(frame, xyz, placed, own, near, mean, variance, asked, options: LikenessOptions) -> np.ndarray:
    """(B, M) the mean log odds in the frames (B, S) that are looked at; NaN where half of them know too little.

    NaN, too, where it is not `asked` (B, M).
    """
    beside = _without(placed[np.maximum(frame, 0)], own)[:, :, near]
    odds = _odds(xyz[:, :, None, None].astype(float) - beside, mean, variance, options)
    looked_at = frame >= 0
    seen = np.isfinite(odds) & looked_at[..., None]
    count = seen.sum(axis=1)
    middle = np.where(seen, odds, 0).sum(axis=1) / np.maximum(count, 1)
    return np.where(asked & (count > 0) & (count >= 0.5 * looked_at.sum(axis=1)[:, None]), middle, np.nan)


def _without(placed: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Markers placed (B, ..., M, 3) without each tracklet's own (B,)."""
    rows = np.flatnonzero(own != NO_MARKER)
    placed = placed.copy()
    placed[rows, ..., own[rows], :] = np.nan
    return placed


def _odds(away: np.ndarray, mean: np.ndarray, variance: np.ndarray, options: LikenessOptions) -> np.ndarray:
    """(..., M) log odds of points that are `away` (..., M, Q, 3) m from neighbours, of distances so much expected.

    The distances make a normal density in space, whose precision is that of all of them together.
    """
    distance = np.sqrt(np.einsum("...i,...i->...", away, away))
    there = np.isfinite(distance) & np.isfinite(mean) & np.isfinite(variance)
    there &= np.cumsum(there, axis=-1, dtype=np.int8) <= options.neighbours
    asked = there.sum(axis=-1)
    share = worth_of_each(asked)
    away = np.where(there[..., None], away, 0)
    distance = np.where(there, distance, 1.0)
    variance = np.where(there, variance, 1.0)
    square = np.where(there, (distance - np.where(there, mean, 1.0)) ** 2 / variance, 0)
    square = np.minimum(square, options.max_square).sum(axis=-1) * share
    weight = share[..., None] / (variance * distance**2)
    wide = options.wide_m**-2
    spread = (away * weight[..., None]).swapaxes(-1, -2) @ away
    a, b, c = (spread[..., axis, axis].astype(float) + wide for axis in range(3))
    d, e, f = (spread[..., one, two].astype(float) for one, two in ((0, 1), (0, 2), (1, 2)))
    precision = np.maximum(a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e), wide**3)
    odds = 0.5 * np.log(precision) - 1.5 * np.log(2 * np.pi) - 0.5 * square - np.log(options.ghost_density)
    return np.where(asked >= options.min_neighbours, odds, np.nan)


def worth_of_each(asked: np.ndarray | int) -> np.ndarray:
    """The part for which each of so many neighbours counts, so that all together say no more than the independent."""
    return np.minimum(1, LIKENESS.independent / np.maximum(asked, 1))


def _next_named(tracklets: Tracklets, marker: np.ndarray, which: np.ndarray, markers: int) -> np.ndarray:
    """(2, K, M) the last tracklet that has each name (N,) before some tracklets (K,), and the first after; -1 for none.

    They may overlap by as much as those of one marker do.
    """
    found = np.full((2, len(which), markers), -1)
    named, name = np.flatnonzero(marker != NO_MARKER), np.arange(markers)
    sides = (tracklets.last, tracklets.first), (-tracklets.first, -tracklets.last)
    reach = 2 * (int(tracklets.last.max(initial=0)) + VOTE.max_overlap_frames) + 2  # one marker after the other
    for side, (ends, begins) in zip(found if len(named) else (), sides, strict=False):
        order = named[np.lexsort((ends[named], marker[named]))]
        keys = marker[order] * reach + ends[order]
        latest = begins[which, None] + VOTE.max_overlap_frames
        place = np.searchsorted(keys, name * reach + latest, side="right") - 1
        place -= (place >= 0) & (order[place] == which[:, None])
        side[:] = np.where((place >= 0) & (marker[order[place]] == name), order[place], -1)
    return found


def links(
    tracklets: Tracklets,
    at: tuple[np.ndarray, np.ndarray],
    marker: np.ndarray,
    placed: np.ndarray,
    pairs: PairDistances,
    rate: float,
    which: np.ndarray,
    asked: np.ndarray,
) -> np.ndarray:
    """(K, M) log odds that some tracklets (K,) go on as a marker did before them, and as the marker does after them.

    By names (N,), with markers placed (F, M, 3) m in frames of which `at` has the tracklets' first and last (N,). Over
    a gap the distances to its neighbours hardly change; 0 where nothing is named near in time, and where it is not
    `asked` (K, M).
    """
    markers, near = placed.shape[1], steadiest(pairs.within)
    within = pairs.within[np.arange(markers)[:, None], near]
    found = np.zeros((len(which), markers))
    before, after = _next_named(tracklets, marker, which, markers)
    ends = (0, before, tracklets.first, tracklets.last), (1, after, tracklets.last, tracklets.first)
    last_sample = tracklets.frame[which].argmax(axis=1)
    for (end, other, own_end, other_end), sample in zip(ends, (0, last_sample), strict=True):
        gap = np.abs(own_end[which][:, None] - other_end[other])
        known = (other >= 0) & (gap <= CUTTING.max_gap_s * rate) & asked
        some = np.flatnonzero(known.any(axis=1))
        then = np.where(known, at[1 - end][other], -1)[some]
        xyz = tracklets.xyz[which, sample][some]
        parts = at[end][which[some]], then, gap[some], xyz, placed, marker[which[some]], near, within, rate
        found[some] += of_ends(*parts, LIKENESS)
    return found


def changed(gap: np.ndarray, rate: float, options: LikenessOptions) -> np.ndarray:
    """The part of how distances vary at any time that they vary by over gaps of so many frames."""
    return np.minimum((gap / (options.change_s * rate)) ** 2, 1)


@stands_for(point_calls.of_ends)
def of_ends(frame, then, gap, xyz, placed, own, near, within, rate: float, options: LikenessOptions) -> np.ndarray:
    """(N, M) the log odds at the ends of tracklets, points (N, 3) m in frames (N,), by where a marker was seen next.

    That is in frames then (N, M), -1 for none, which are so many away: gap (N, M). placed (F, M, 3) m, own (N,) as
    above, the neighbours (M, Q) of each marker, whose distances have such a variance (M, Q) at any time.
    """
    old = placed[np.maximum(then, 0)].astype(float)
    own_then = np.take_along_axis(old, np.arange(placed.shape[1])[None, :, None, None], axis=2)
    away = own_then - np.take_along_axis(old, near[None, ..., None], axis=2)
    mean = np.sqrt(np.einsum("...i,...i->...", away, away))
    variance = options.link_sd_m**2 + within * changed(gap, rate, options)[..., None]
    beside = _without(placed[frame].astype(float), own)[:, near]
    odds = _odds(xyz[:, None, None] - beside, mean, variance, options)
    return np.where(then >= 0, np.nan_to_num(odds), 0)
