# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs that go on in one camera's image: nearly always one marker's, whatever a few of their frames are called.

A marker that is partly hidden draws its blob aside, two rays may meet where no marker is, and then a blob loses its
name or has a neighbour's for some frames. But in the image it moves on as it did, and before and after it is named.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..data.takes import REMAINING
from ..geometry.views import View
from .labelling import TOO_FAR, Naming
from .tracking import FrameResult


@dataclass(frozen=True)
class TrackletOptions:
    """When blobs are one tracklet, and when its name overrules a frame's; reckoned, but as said.

    noise_m       by which a blob may be off beside what moves it: partly hidden ones jump
    push_m_s2     how hard markers change their velocity; limbs of people who run
    speed_m_s     at most, of a blob of which nothing is known yet
    rival_ratio   another blob must be so many times as far off, and
    rival_m       by so much more
    min_frames    of a tracklet that have its name, and
    min_ratio     times as many as have any other
    part_m        by which the middle of a marker that is partly hidden may be off: as large as markers are
    rounds        of all this: a blob that lost a wrong name is free for its own
    """

    noise_m: float = 0.004
    push_m_s2: float = 40.0
    speed_m_s: float = 4.0
    rival_ratio: float = 2.0
    rival_m: float = 0.003
    min_frames: int = 12
    min_ratio: float = 4.0
    part_m: float = 0.008
    rounds: int = 2


TRACKLETS = TrackletOptions()


def name_by_tracklets(
    views: Sequence[View], results: Sequence[FrameResult | None], rate: float, options: TrackletOptions = TRACKLETS
) -> dict[int, list[int]]:
    """Gives blobs the names of their tracklets where these meet in space; returns the markers changed, by frame."""
    changed: dict[int, list[int]] = {}
    markers = next((len(result.naming.slot[0]) for result in results if result is not None), 0)
    if not markers:
        return changed
    tracklet, count = tracklets_of(views, _depths(results), rate, options)
    for _ in range(options.rounds):
        claims = _claims(tracklet, count, results, markers, options)
        moved = {}
        for index, (result, claim) in enumerate(zip(results, claims, strict=True)):
            if result is not None and (some := _settle(result.naming, claim, options)):
                moved[index] = some
        if not moved:
            break
        for index, some in moved.items():
            changed[index] = sorted({*changed.get(index, []), *some})
    return changed


def _depths(results: Sequence[FrameResult | None]) -> list[np.ndarray | None]:
    """By frame, (C,) m, how far from each camera the subject is; None where nobody is."""
    return [None if result is None else np.median(result.naming.frame.depth, axis=1) for result in results]


def tracklets_of(
    views: Sequence[View], depths: Sequence[np.ndarray | None], rate: float, options: TrackletOptions = TRACKLETS
) -> tuple[list[np.ndarray], int]:
    """By frame, (C, K) the number of each blob's tracklet, -1 where there is no blob; and how many there are.

    `depths` (C,) m are how far from each camera the subject is, by frame: there a blob's way is measured.
    """
    numbers: list[np.ndarray] = []
    speed, count = None, 0
    for index, view in enumerate(views):
        own = np.full(view.real.shape, -1)
        ahead = np.full(view.image.shape, np.nan)
        if index and depths[index] is not None and depths[index - 1] is not None:
            before = views[index - 1]
            camera, old, new = _links(before, view, speed, depths[index], rate, options)
            own[camera, new] = numbers[-1][camera, old]
            ahead[camera, new] = view.image[camera, new] - before.image[camera, old]
        fresh = view.real & (own < 0)
        own[fresh] = count + np.arange(fresh.sum())
        count += int(fresh.sum())
        numbers.append(own)
        speed = ahead
    return numbers, count


def _links(before: View, view: View, speed: np.ndarray, depth: np.ndarray, rate: float, options: TrackletOptions):
    """Cameras, slots before and slots now of the blobs that are one; speed (C, K, 2) a frame, NaN where unknown."""
    known = np.isfinite(speed[..., 0])
    there = before.image + np.where(known[..., None], speed, 0)
    reach = np.where(known, options.noise_m + options.push_m_s2 / rate**2, options.speed_m_s / rate)
    between = there[:, :, None] - view.image[:, None]
    away = np.hypot(between[..., 0], between[..., 1]) * depth[:, None, None]
    away = np.where(before.real[..., None] & view.real[:, None], away, TOO_FAR)
    nearest, least = away.argmin(axis=2), away.min(axis=2)
    camera, old = np.nonzero(least < reach)
    new, least = nearest[camera, old], least[camera, old]
    room = options.rival_ratio * least + options.rival_m
    rivals = (away[camera, old] < room[:, None]).sum(axis=1) + (away[camera, :, new] < room[:, None]).sum(axis=1)
    clear = rivals == 2
    return camera[clear], old[clear], new[clear]


def _claims(tracklet: list[np.ndarray], count: int, results, markers: int, options: TrackletOptions):
    """By frame, (C, K) the marker that each blob's tracklet mostly is, -1 where none."""
    frames = np.zeros((count, markers))
    for own, result in zip(tracklet, results, strict=True):
        if result is not None:
            camera, slot = np.nonzero(result.naming.owner >= 0)
            np.add.at(frames, (own[camera, slot], result.naming.owner[camera, slot]), 1)
    best = frames.argmax(axis=1)
    each = np.arange(count)
    most = frames[each, best]
    frames[each, best] = 0
    mostly = np.where(most >= np.maximum(options.min_frames, options.min_ratio * frames.max(axis=1)), best, -1)
    mostly = np.append(mostly, -1)
    return [mostly[own] for own in tracklet]


def _settle(naming: Naming, claim: np.ndarray, options: TrackletOptions) -> list[int]:
    """Gives markers the blobs that tracklets claim (C, K) for them, as far as they meet; returns those changed."""
    frame = naming.frame
    camera, slot = np.nonzero((claim >= 0) & (claim != naming.owner))
    said = (frame.fixed[camera, claim[camera, slot]] >= 0) | (frame.fixed[camera] == slot[:, None]).any(axis=1)
    camera, slot = camera[~said], slot[~said]
    some = np.unique(claim[camera, slot])
    return [int(marker) for marker in some if _settled(naming, claim, int(marker), options)]


def _settled(naming: Naming, claim: np.ndarray, marker: int, options: TrackletOptions) -> bool:
    """Names one marker's blobs by where most of what its tracklets and the frame say meet; True if any changed."""
    frame, cameras = naming.frame, naming.frame.cameras
    claimed = claim == marker
    claimed_slot = np.where(claimed.sum(axis=1) == 1, claimed.argmax(axis=1), -1)
    old = naming.slot[:, marker].copy()
    confirmed = (old >= 0) & claimed[cameras, np.maximum(old, 0)]
    claimed_slot = np.where(confirmed, old, claimed_slot)
    against = (old >= 0) & (claim[cameras, np.maximum(old, 0)] >= 0) & ~confirmed
    undecided = np.where((old >= 0) & ~confirmed & ~against & (claimed_slot < 0), old, -1)
    rays = np.where(naming.partner[:, marker] < 0, old, -1)
    tried = np.stack([claimed_slot, np.maximum(claimed_slot, undecided), rays], axis=1)
    points = frame.rays.meet(tried).points
    points = points[np.isfinite(points[:, 0])]
    if not len(points):
        return False
    image = frame.sight.image(frame.sight.local(points[None]))[0]
    candidates = np.where(claimed_slot >= 0, claimed_slot, np.where(frame.fixed[:, marker] >= 0, old, undecided))
    off = frame.view.image[cameras, np.maximum(candidates, 0)][:, None] - image
    off = np.hypot(off[..., 0], off[..., 1]) * frame.depth[:, [marker]]
    near = (off < options.part_m + frame.metres[:, [marker]]) & (candidates >= 0)[:, None]
    weight = (near * np.where(claimed_slot >= 0, 2, 1)[:, None]).sum(axis=0)
    best = int(np.argmax(weight - 1e-3 * np.where(near, off, 0).sum(axis=0)))
    near, off = near[:, best], off[:, best]
    if near.sum() < 2:
        return False
    new = np.where(near, candidates, -1)
    if (new == old).all():
        return False
    gone = np.flatnonzero((old >= 0) & (new != old))
    naming.withdraw(gone, np.full(len(gone), marker))
    naming.partner[gone, marker] = -1
    for index in np.flatnonzero((new >= 0) & (new != old)):
        other = naming.owner[index, new[index]]
        if other >= 0:
            naming.withdraw(np.array([index]), np.array([other]))
            naming.partner[index, other] = -1
        naming.give(index, marker, new[index], REMAINING)
        part = off[index] > frame.rules.max_off_point * frame.metres[index, marker]
        naming.partner[index, marker] = marker if part else -1
    return True
