# SPDX-License-Identifier: GPL-3.0-or-later
"""Names in the few frames between those in which a marker's path is sure: it was where it must have come through.

For a frame or two a name may lie on a neighbour, or a blob stay unnamed, without anything in these frames to speak
against it: where a body is known badly, markers of one elbow look much alike. But before and after, the marker goes on
smoothly, and that says where it was in between far better than any body does.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..data.takes import REMAINING
from ..papers.virtual_occlusions.labelling import TOO_FAR, Frame, Naming, withdraw_unmet
from .tracking import FrameResult, met_points


@dataclass(frozen=True)
class BetweenOptions:
    """What is a sure path, and how well it says where a marker was beside it; reckoned.

    min_frames      in a row that make a path sure
    window          frames whose median is the speed that a frame's is compared with
    noise_m         by which a marker may be off beside that
    push_m_s2       how hard markers change their velocity, standard deviation; limbs of people who run
    max_push_m_s2   beyond which a path does not go on: a foot that is put down
    max_sd_m        of where a marker was: beyond it a neighbour's blob would do
    rounds          of all this: a frame put right makes the paths beside it longer
    max_off         standard deviations by which a name may be off the path before it is taken back
    """

    min_frames: int = 6
    window: int = 7
    noise_m: float = 0.003
    push_m_s2: float = 40.0
    max_push_m_s2: float = 120.0
    max_sd_m: float = 0.015
    max_off: float = 4.0
    rounds: int = 3


BETWEEN = BetweenOptions()


@dataclass(frozen=True, eq=False)
class Passage:
    """Where a marker was in a frame between two in which that is sure: place (3,) m, give or take sd m."""

    marker: int
    place: np.ndarray
    sd: float


def put_between(
    results: list[FrameResult | None], rate: float, options: BetweenOptions = BETWEEN
) -> dict[int, list[int]]:
    """Names blobs in `results` by the paths of their markers; returns the markers of which some changed, by frame."""
    return in_rounds(lambda: _put_once(results, rate, options), options.rounds)


def in_rounds(once: Callable[[], dict[int, list[int]]], most: int) -> dict[int, list[int]]:
    """Does something to names that makes more of the same possible, until it changes none; the markers of all rounds.

    By frame, as `once` tells those of one.
    """
    changed: dict[int, list[int]] = {}
    for _ in range(most):
        moved = once()
        if not moved:
            break
        for index, markers in moved.items():
            changed[index] = sorted({*changed.get(index, []), *markers})
    return changed


def _put_once(results: list[FrameResult | None], rate: float, options: BetweenOptions) -> dict[int, list[int]]:
    points = met_points(results)
    changed: dict[int, list[int]] = {}
    for index, passages in passages_of(points, rate, options).items():
        result = results[index]
        if result is not None:
            naming = _renamed(result, points[index], passages, options)
            moved = (naming.slot != result.naming.slot).any(axis=0)
            if moved.any():
                results[index] = replace(result, naming=naming)
                changed[index] = np.flatnonzero(moved).tolist()
    return changed


def passages_of(points: np.ndarray, rate: float, options: BetweenOptions = BETWEEN) -> dict[int, list[Passage]]:
    """By frame, the markers of points (F, M, 3) m, NaN where none, that pass between two sure paths there."""
    found: dict[int, list[Passage]] = {}
    goes_on = _going_on(points, rate, options)
    for marker in range(goes_on.shape[1]):
        runs = _sure_runs(goes_on[:, marker], options)
        for (_, before), (after, _) in pairwise(runs):
            for index, passage in _passed(points[:, marker], marker, before, after, rate, options):
                found.setdefault(index, []).append(passage)
    return found


def _going_on(points: np.ndarray, rate: float, options: BetweenOptions) -> np.ndarray:
    """(F - 1, M) whether markers (F, M, 3) go on to the next frame about as fast as in the frames around it."""
    if len(points) <= options.window:
        return np.zeros((0, points.shape[1]), bool)
    speed = np.diff(points, axis=0)
    half = options.window // 2
    padded = np.pad(speed, ((half, half), (0, 0), (0, 0)), constant_values=np.nan)
    # What is missing is last, so that the median is in the middle of the rest.
    ranked = np.sort(np.lib.stride_tricks.sliding_window_view(padded, options.window, axis=0), axis=3)
    count = np.isfinite(ranked[..., :1, :]).sum(axis=3)[..., None]
    low, high = (np.take_along_axis(ranked, np.maximum(at, 0) // 2, axis=3) for at in (count - 1, count))
    usual = np.where(count[..., 0] > half, (low + high)[..., 0] / 2, np.nan)
    reach = options.noise_m + options.max_push_m_s2 / rate**2
    return np.linalg.norm(speed - usual, axis=2) < reach


def _sure_runs(goes_on: np.ndarray, options: BetweenOptions) -> list[tuple[int, int]]:
    """First and last frames, both included, of a marker's smooth stretches, by where it goes on (F - 1,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], goes_on.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a + 1 >= options.min_frames]


def _passed(place: np.ndarray, marker: int, before: int, after: int, rate: float, options: BetweenOptions):
    """Frames between `before` and `after`, and where the marker was there: a cubic through both ends and speeds."""
    gap = after - before
    at = np.arange(before + 1, after)
    sd = options.noise_m + options.push_m_s2 / 2 * (at - before) * (after - at) / rate**2
    if gap < 2 or sd.max() > options.max_sd_m:
        return
    early = (place[before] - place[before - 3]) / 3 * gap
    late = (place[after + 3] - place[after]) / 3 * gap
    chord = place[after] - place[before]
    if (
        max(np.linalg.norm(chord - early), np.linalg.norm(chord - late))
        > options.max_push_m_s2 / 2 * (gap / rate) ** 2 + options.max_sd_m
    ):
        return
    share = ((at - before) / gap)[:, None]
    own = (
        (2 * share**3 - 3 * share**2 + 1) * place[before]
        + (share**3 - 2 * share**2 + share) * early
        + (3 * share**2 - 2 * share**3) * place[after]
        + (share**3 - share**2) * late
    )
    for index, where, deviation in zip(at.tolist(), own, sd.tolist(), strict=True):
        yield index, Passage(marker, where, deviation)


def _renamed(result: FrameResult, points: np.ndarray, passages: list[Passage], options: BetweenOptions) -> Naming:
    """A frame's names with those of markers that pass put where they must be."""
    old, frame = result.naming, result.naming.frame
    passages = [one for one in passages if not (frame.fixed[:, one.marker] >= 0).any()]
    marker = np.array([one.marker for one in passages], dtype=int)
    place, covariance = frame.expected.points.copy(), frame.expected.covariance.copy()
    for one in passages:
        place[one.marker], covariance[one.marker] = one.place, one.sd**2 * np.eye(3)
    expected = replace(frame.expected, points=place, covariance=covariance)
    frame = Frame(frame.view, frame.sight, expected, frame.rules, frame.fixed)
    naming = Naming(frame, old.slot.copy(), old.step.copy(), old.owner.copy(), old.partner.copy(), old.conflicts)
    for one in passages:
        camera = np.flatnonzero(naming.slot[:, one.marker] >= 0)
        if np.isfinite(points[one.marker, 0]):
            away = np.linalg.norm(points[one.marker] - one.place)
            wrong = camera[:0] if away < options.max_off * one.sd else camera
        else:
            wrong = camera[frame.nll[camera, one.marker, naming.slot[camera, one.marker]] >= TOO_FAR]
        naming.withdraw(wrong, np.full(len(wrong), one.marker))
        naming.partner[wrong, one.marker] = -1
    _fill(frame, naming, marker)
    withdraw_unmet(frame, naming)
    return naming


def _fill(frame: Frame, naming: Naming, marker: np.ndarray):
    """Names free blobs after the markers (N,) that pass there, where nothing else could be meant."""
    nll = np.where(naming.open, frame.nll, TOO_FAR)
    taken = np.ones(nll.shape[1], bool)
    taken[marker] = False
    others = np.where(taken[:, None] & (naming.slot < 0)[..., None], naming.reprojection, TOO_FAR).min(axis=1)
    nll[:, taken] = TOO_FAR
    nll = np.where((others < frame.rules.max_on_point)[:, None], TOO_FAR, nll)
    for axis in (1, 2):
        if nll.shape[axis] > 1:
            two = np.partition(nll, 1, axis=axis)
            least, second = np.take(two, [0], axis=axis), np.take(two, [1], axis=axis)
            nll = np.where((nll == least) & (second - least >= frame.rules.min_lead), nll, TOO_FAR)
    camera, which, slot = np.nonzero(nll < TOO_FAR)
    naming.give(camera, which, slot, REMAINING)
