# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs that go on in one camera's image: nearly always one marker's, whatever a few of their frames are called.

A marker that is partly hidden draws its blob aside, two rays may meet where no marker is, and then a blob loses its
name or has a neighbour's for some frames. But in the image it moves on as it did, and before and after it is named.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from ..data.physical import MARKER_LIMITS
from ..data.takes import REMAINING
from ..geometry.views import View
from ..kernels import frame_calls, stands_for
from ..papers.virtual_occlusions.labelling import TOO_FAR, Frame, Naming
from .tracking import FrameResult


class IMAGE_TRACKLETS:
    """When blobs are one tracklet, and when its name overrules a frame's."""

    speed_m_s: float = 4.0  # physical: at most, of a blob of which nothing is known yet
    # another blob must be so many times as far off, so that the nearest is the same either way
    other_ratio: float = 2.0  # physical
    min_frames: int = 12  # physical: of a tracklet that have its name, more than a marker is in doubt at a time, and
    min_ratio: float = 4.0  # physical: times as many as have any other


def name_by_tracklets(views: Sequence[View], results: Mapping[int, FrameResult], rate: float):
    """Gives blobs the names of their tracklets where these meet in space.

    `results` are those of the views that are labelled, by index.
    """
    if not results:
        return
    tracklet, count = _tracklets_of(views, results, rate)
    claims = _claims([tracklet[index] for index in results], count, [one.naming for one in results.values()])
    for result, claim in zip(results.values(), claims, strict=True):
        if claim is not None:
            _settle(result.naming, claim)


def _tracklets_of(
    views: Sequence[View], results: Mapping[int, FrameResult], rate: float
) -> tuple[list[np.ndarray], int]:
    """By frame, (C, K) the number of each blob's tracklet, -1 where there is no blob; and how many there are.

    A blob's way is measured as far from each camera as the subject is, so tracklets end where nobody is.
    """
    numbers: list[np.ndarray] = []
    speed, count = np.zeros(0), 0
    reaches = MARKER_LIMITS.noise_m + MARKER_LIMITS.push_sd_m_s2 / rate**2, IMAGE_TRACKLETS.speed_m_s / rate
    clear = IMAGE_TRACKLETS.other_ratio, MARKER_LIMITS.noise_m
    for index, view in enumerate(views):
        own = np.full(view.real.shape, -1)
        ahead = np.full(view.image.shape, np.nan)
        if index in results and index - 1 in results:
            depth = np.median(results[index].naming.frame.depth, axis=1)
            link, ahead = link_blobs(views[index - 1], view, speed, depth, reaches, clear)
            own = np.where(link >= 0, np.take_along_axis(numbers[-1], link, axis=1), -1)
        fresh = view.real & (own < 0)
        many = int(fresh.sum())
        own[fresh] = np.arange(count, count + many)
        count += many
        numbers.append(own)
        speed = ahead
    return numbers, count


@stands_for(frame_calls.link_blobs)
def link_blobs(
    before: View,
    view: View,
    speed: np.ndarray,
    depth: np.ndarray,
    reaches: tuple[float, float],
    clear: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray]:
    """The slot before of each blob that goes on (C, K), -1 where none does; and its way (C, K, 2) since then, or NaN.

    speed (C, K', 2) a frame, NaN where unknown; depth (C,) m of the subject; `reaches` m of blobs of known speed and
    of others, `clear` by how many times, and by how many m more, another blob must be farther off.
    """
    known = np.isfinite(speed[..., 0])
    there = before.image + np.where(known[..., None], speed, 0)
    reach = np.where(known, *reaches)
    square = there @ (-2 * view.across)
    square += view.square + (there**2).sum(axis=2)[..., None]
    away = np.sqrt(np.maximum(square, 0)) * depth[:, None, None]
    away[~(before.real[..., None] & view.real[:, None])] = TOO_FAR
    nearest, least = away.argmin(axis=2), away.min(axis=2)
    camera, old = np.nonzero(least < reach)
    new, least = nearest[camera, old], least[camera, old]
    room = clear[0] * least + clear[1]
    others = (away[camera, old] < room[:, None]).sum(axis=1) + (away[camera, :, new] < room[:, None]).sum(axis=1)
    one = others == 2
    camera, old, new = camera[one], old[one], new[one]
    link, ahead = np.full(view.real.shape, -1), np.full(view.image.shape, np.nan)
    link[camera, new] = old
    ahead[camera, new] = view.image[camera, new] - before.image[camera, old]
    return link, ahead


def _claims(tracklet: Sequence[np.ndarray], count: int, namings: Sequence[Naming]) -> list[np.ndarray | None]:
    """By frame, (C, K) the marker that each blob's tracklet mostly is, -1 where none; None where the frame agrees."""
    own = np.concatenate([one.ravel() for one in tracklet])
    owner = np.concatenate([naming.owner.ravel() for naming in namings])
    claim = _mostly(own, owner, count, namings[0].slot.shape[1])[own]
    ends = np.cumsum([one.size for one in tracklet])[:-1]
    otherwise = [part.any() for part in np.split((claim >= 0) & (claim != owner), ends)]
    claims = zip(tracklet, np.split(claim, ends), otherwise, strict=True)
    return [mostly.reshape(one.shape) if differs else None for one, mostly, differs in claims]


def _mostly(own: np.ndarray, owner: np.ndarray, count: int, markers: int) -> np.ndarray:
    """(count + 1,) the marker that each tracklet mostly is, -1 where none, by the markers `owner` (N,) of blobs `own`.

    The last is of where no blob is.
    """
    named = np.flatnonzero(owner >= 0)
    long = np.flatnonzero(np.bincount(own[named], minlength=count) >= IMAGE_TRACKLETS.min_frames)
    row = np.full(count, -1)
    row[long] = np.arange(len(long))
    named = named[row[own[named]] >= 0]
    cells = row[own[named]] * markers + owner[named]
    frames = np.bincount(cells, minlength=len(long) * markers).reshape(len(long), markers)
    best, most = frames.argmax(axis=1), frames.max(axis=1, initial=0)
    frames[np.arange(len(long)), best] = 0
    rest = frames.max(axis=1)
    sure = most >= np.maximum(IMAGE_TRACKLETS.min_frames, IMAGE_TRACKLETS.min_ratio * rest)
    mostly = np.full(count + 1, -1)
    mostly[long[sure]] = best[sure]
    return mostly


def _settle(naming: Naming, claim: np.ndarray):
    """Gives markers the blobs that tracklets claim (C, K) for them, as far as they meet."""
    fixed = naming.frame.fixed
    camera, slot = np.nonzero((claim >= 0) & (claim != naming.owner))
    marker, owner = claim[camera, slot], naming.owner[camera, slot]
    left = (fixed[camera, marker] >= 0) | (fixed[camera] == slot[:, None]).any(axis=1)
    left |= (owner >= 0) & (naming.partner[camera, owner] >= 0)  # either of two markers may give it its name
    for one in np.unique(marker[~left]).tolist():
        _settle_marker(naming, claim, one)


def _settle_marker(naming: Naming, claim: np.ndarray, marker: int):
    """Names one marker's blobs by where most of what its tracklets and the frame say meet."""
    frame, cameras = naming.frame, naming.frame.cameras
    old = naming.slot[:, marker].copy()
    of_old = np.where(old >= 0, claim[cameras, np.maximum(old, 0)], -1)
    claimed = claim == marker
    claimed[frame.fixed[:, marker] >= 0] = False
    slot = np.where(claimed.sum(axis=1) == 1, claimed.argmax(axis=1), -1)
    slot = np.where(of_old == marker, old, slot)
    undecided = np.where((slot < 0) & (of_old < 0), old, slot)
    rays = np.where(naming.partner[:, marker] < 0, old, -1)
    points = frame.rays.meet(np.stack([slot, undecided, rays], axis=1)).points
    points = points[np.isfinite(points[:, 0])]
    if not len(points):
        return
    room = frame.metres[:, marker]
    mine, other = (_off(frame, points, marker, one) for one in (slot, old))
    near, kept = mine < (frame.rules.min_behind_m + room)[:, None], other < (frame.rules.max_off_point * room)[:, None]
    weight = np.where(near, 2, kept & (of_old < 0)[:, None])
    best = int(np.argmax(weight.sum(axis=0) - np.where(near, np.minimum(mine, 1), 0).sum(axis=0)))
    near, kept, off = near[:, best], kept[:, best], mine[:, best]
    new = np.where(kept, old, np.where(near, slot, -1))
    if (new >= 0).sum() >= 2 and (new != old).any():
        _give(naming, marker, new, off > frame.rules.max_off_point * room)


def _off(frame: Frame, points: np.ndarray, marker: int, slot: np.ndarray) -> np.ndarray:
    """(C, P) m, how far blobs in slots (C,) are from points (P, 3) m at a marker's depth; TOO_FAR where none."""
    image = frame.sight.image(frame.sight.local(points[None]))[0]
    off = np.linalg.norm(frame.view.image[frame.cameras, np.maximum(slot, 0)][:, None] - image, axis=2)
    return np.where((slot >= 0)[:, None], off * frame.depth[:, [marker]], TOO_FAR)


def _give(naming: Naming, marker: int, slot: np.ndarray, part: np.ndarray):
    """Names the blobs in slots (C,) after a marker, and none else; `part` (C,) where they show a part of it only."""
    old = naming.slot[:, marker].copy()
    for camera in np.flatnonzero(slot != old).tolist():
        owner = naming.owner[camera, slot[camera]] if slot[camera] >= 0 else -1
        for before in (marker if old[camera] >= 0 else -1, owner):
            if before >= 0:
                naming.withdraw(camera, before)
                naming.partner[camera, before] = -1
        if slot[camera] >= 0:
            naming.give(camera, marker, slot[camera], REMAINING)
            naming.partner[camera, marker] = marker if part[camera] else -1
