# SPDX-License-Identifier: GPL-3.0-or-later
"""A known body laid into a labelled frame whose names nobody knows: which of its markers each marker is like.

Bodies in many poses are turned about the vertical and compared with the cloud; the likeliest are then fitted to it,
markers to points one to one. What ends up near one of the body's markers is taken for it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import Bodies, BodyModel
from ..body.prior import Prior
from ..data.markersets import MarkerSet
from ..data.takes import evenly_spread
from ..geometry import rotations
from ..geometry.rigid import MIN_POINTS
from ..geometry.upright import turned
from ..papers.virtual_occlusions.fit import fit_body
from ..points.likelihood.sides import mirror_order
from ..posing.posing import labelled_pull
from .poses import posed_bodies


@dataclass(frozen=True)
class LayingOptions:
    """How a body is laid into a cloud of points. All reckoned.

    poses, yaws      in how many poses and headings it is tried
    starts           so many of the likeliest are fitted
    heights_m        between which people's are
    reach            heights; a marker without a point nearer than this says nothing of where it is, at the start
    rounds, steps    of matching, and of fitting after each
    gates            heights, from the first round to the last, how near a point must be to be a marker's
    min_matched      part of the body's markers that must end up with a point for the body to be the subject's
    min_cloud        part of the points that must
    max_off          heights, how far off the body's markers may be in the mean, those without a point a whole gate
    min_side_agree   part of the names with sides that must mean the sides that the body has
    """

    poses: int = 120
    yaws: int = 12
    starts: int = 40
    heights_m: tuple[float, float] = (1.0, 2.1)
    reach: float = 0.15
    rounds: int = 10
    steps: int = 4
    gates: tuple[float, float] = (0.2, 0.05)
    min_matched: float = 0.75
    min_cloud: float = 0.5
    max_off: float = 0.022
    min_side_agree: float = 0.75


LAYING = LayingOptions()


@dataclass(frozen=True, eq=False)
class LaidBody:
    """A body and which of its markers each of M markers is like.

    place  (M,) index of the body's marker, -1 for none
    off    heights, how far body and markers are from each other in the mean; who has no partner is a whole gate off
    """

    body: MarkerSet
    place: np.ndarray
    off: float


def laid_body(
    frame: np.ndarray,
    bodies: Sequence[tuple[MarkerSet, np.ndarray]],
    sides: np.ndarray,
    options: LayingOptions = LAYING,
) -> LaidBody | None:
    """The one of the bodies that fits the labelled frame (M, 3) m, NaN where missing, z up, best; None where none does.

    Each body comes with the poses (P, J, 3) that it may be in, as `Spread.poses` has them. `sides` (M,) as
    `marker_sides` gives them. The options say when it fits.
    """
    found = [one for body, poses in bodies if (one := _laid(frame, body, poses, sides, options)) is not None]
    return min(found, key=lambda one: one.off) if found else None


def _laid(
    frame: np.ndarray, body: MarkerSet, poses: np.ndarray, sides: np.ndarray, options: LayingOptions
) -> LaidBody | None:
    """The body as it fits best of all starts; None where it does not fit."""
    there = np.flatnonzero(np.isfinite(frame).all(axis=1))
    if len(there) < MIN_POINTS:
        return None
    cloud, model, gate = frame[there], BodyModel(body), LAYING.gates[1]
    height = float(np.ptp(cloud[:, 2]) / np.ptp(body.rest_markers[:, 2]))
    height = float(np.clip(height, *LAYING.heights_m))
    fitted = _fitted(model, cloud, _starts(model, cloud, poses, height), height)
    matched = _matched(fitted, cloud, gate * height)
    away = np.linalg.norm(fitted - cloud[matched], axis=2) / height
    found = matched >= 0
    off = np.where(found, away, gate).mean(axis=1)
    own = marker_sides(body.markers) * np.where(found, sides[there][matched], 0)
    right, named = (own > 0).sum(axis=1), (own != 0).sum(axis=1)
    fits = (off <= options.max_off) & (found.mean(axis=1) >= options.min_matched)
    fits &= found.sum(axis=1) >= options.min_cloud * len(cloud)
    fits &= right >= options.min_side_agree * named
    if not fits.any():
        return None
    best = np.where(fits, off, np.inf).argmin()
    mine = np.flatnonzero(found[best])
    place = np.full(len(frame), -1)
    place[there[matched[best, mine]]] = mine
    alone = len(cloud) - len(mine)
    return LaidBody(body, place, float(off[best] * len(body) + gate * alone) / (len(body) + len(cloud)))


def _fitted(model: BodyModel, cloud: np.ndarray, bodies: Bodies, height: float) -> np.ndarray:
    """(B, N, 3) m, the markers of bodies that were fitted to a cloud (P, 3), matched ever more closely."""
    prior = Prior(model, height=height)
    for gate in np.geomspace(*LAYING.gates, LAYING.rounds) * height:
        matched = _matched(model.pose(bodies).markers, cloud, gate)
        goal = np.where((matched >= 0)[..., None], cloud[matched], np.nan)
        bodies = fit_body(model, bodies, labelled_pull(goal), LAYING.steps, prior).bodies
    return model.pose(bodies).markers


def marker_sides(markers: Sequence[str]) -> np.ndarray:
    """(M,) 1 for a marker whose name says left, -1 for right, 0 for what has no other side."""
    order = mirror_order(tuple(markers))
    sides = np.zeros(len(markers), dtype=int)
    for index, name in enumerate(markers if order is not None else ()):
        other = markers[order[index]]
        if other != name:
            first = next(one for one, two in zip(name, other, strict=False) if one != two)
            sides[index] = 1 if first in "lL" else -1
    return sides


def _starts(model: BodyModel, cloud: np.ndarray, poses: np.ndarray, height: float) -> Bodies:
    """The likeliest bodies in some of the poses, turned about the vertical, their markers' middle at the cloud's."""
    some = poses[evenly_spread(len(poses), LAYING.poses)]
    some = np.concatenate([np.zeros_like(some[:1]), some])
    bodies = posed_bodies(model, some, height)
    markers = model.pose(bodies).markers
    middle = (markers.min(axis=1) + markers.max(axis=1)) / 2
    goal = (cloud.min(axis=0) + cloud.max(axis=0)) / 2
    yaws = np.arange(LAYING.yaws) * 2 * np.pi / LAYING.yaws
    placed = [turned(markers - middle[:, None], np.full(len(markers), yaw)) + goal for yaw in yaws]
    costs = np.array([_far(row, cloud, LAYING.reach * height) for row in placed])
    chosen = np.argsort(costs, axis=None)[: LAYING.starts]
    yaw, pose = np.unravel_index(chosen, costs.shape)
    picked, about = bodies.pick(pose), rotations.about_z(yaws[yaw])
    moved = goal - turned(middle[pose][:, None], yaws[yaw])[:, 0]
    return replace(picked, translation=moved, quaternion=rotations.quaternion_product(about, picked.quaternion))


def _far(markers: np.ndarray, cloud: np.ndarray, reach: float) -> np.ndarray:
    """(B,) how far markers (B, N, 3) and a cloud (P, 3) are from each other's nearest, none farther than reach."""
    squares = (markers**2).sum(axis=2)[:, :, None] + (cloud**2).sum(axis=1) - 2 * (markers @ cloud.T)
    nearest = (np.sqrt(np.clip(squares.min(axis=axis), 0, reach**2)) for axis in (1, 2))
    return sum(away.mean(axis=1) for away in nearest)


def _matched(markers: np.ndarray, cloud: np.ndarray, gate: float) -> np.ndarray:
    """(B, N) the point of a cloud (P, 3) that each of markers (B, N, 3) is, one to one, -1 beyond the gate."""
    from scipy.optimize import linear_sum_assignment

    found = np.full(markers.shape[:2], -1)
    for row, own in zip(found, markers, strict=True):
        away = np.minimum(np.linalg.norm(own[:, None] - cloud, axis=2), gate)
        one, two = linear_sum_assignment(away**2)
        near = away[one, two] < gate
        row[one[near]] = two[near]
    return found
