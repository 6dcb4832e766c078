# SPDX-License-Identifier: GPL-3.0-or-later
"""A known body laid into a labelled frame of whose names few are known: which of its markers each marker is like.

Bodies in many poses are turned about the vertical and compared with the cloud; the likeliest are then fitted to it,
markers to points one to one. What ends up near one of the body's markers is taken for it. What has the name of one is
that one and no other: without it shoulders are taken for hips where the arms have few markers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import Bodies, BodyModel
from ..body.prior import Prior
from ..body.sides import mirror_order
from ..data.markersets import MarkerSet
from ..data.physical import possible_height
from ..geometry import rotations
from ..geometry.rigid import MIN_POINTS
from ..geometry.upright import turned
from ..papers.virtual_occlusions.fit import fit_body
from ..posing.posing import labelled_pull
from .poses import known_poses, posed_bodies
from .spread import MAJORITY, some_of
from .takes import LabelledTake, gathered
from .transfer import (
    in_segments,
    known_body,
    known_places,
    may_carry,
    off_surface,
    places_in_segments,
    without_markers,
)

Mates = tuple[np.ndarray, np.ndarray]  # of the body's N markers and of P points, each one's mirror image, or itself

HEADINGS = 12  # in which a body is tried: every 30 degrees, less than half of how far the fit turns it
MATCHINGS, FIT_STEPS = 10, 4  # of matching, from the first gate to the last, and of the fit's iterations after each


class LAYING:
    """How a body is laid into a cloud of points."""

    starts: int = 20  # so many of the likeliest are fitted; measured: 10 to 80 lay the same into walkers of McGill
    # heights, from the first round to the last, how near a point must be to be a marker's; 0.1 to 0.4 at first and
    # 0.025 at last lay the same into walkers of McGill, 0.1 at last no other set
    gates: tuple[float, float] = (0.2, 0.05)  # measured
    # heights, how far they may be off each other in the mean; 0.007 to 0.014 for people in other sets, without arms'
    # markers or a foot; 0.018 for a hand's points, 0.021 for somebody who kneels
    max_off: float = 0.016  # measured


@dataclass(frozen=True, eq=False)
class LaidBody:
    """A body and which of its markers each of M markers is like."""

    body: MarkerSet
    place: np.ndarray  # (M,) index of the body's marker, -1 for none
    # heights, how far body's and frame's markers are off each other in the mean: those of the body alone by the last
    # gate, those of the frame alone by how far they are off its skin, or the first gate
    off: float


def laid_into(subjects: Sequence[np.ndarray], markers: Sequence[str], bodies: Sequence[MarkerSet]) -> LaidBody | None:
    """The known body that fits a frame of the subjects (T, M, 3) m that shows most markers and reaches as high as most.

    None where none does.
    """
    points = max(subjects, key=lambda own: np.isfinite(own[..., 0]).sum(axis=1).max())
    seen = np.isfinite(points[..., 0]).sum(axis=1)
    full = points[seen == seen.max()]
    reach = np.nanmax(full[..., 2], axis=1) - np.nanmin(full[..., 2], axis=1)
    posable = [(body, poses) for body in bodies if len(poses := known_poses(body, bodies))]
    return laid_body(full[np.argsort(reach)[len(full) // 2]], posable, markers)


def lying_beside(takes: Sequence[LabelledTake], markers: Sequence[str], bodies: Sequence[MarkerSet]) -> tuple[str, ...]:
    """The names among the markers' that are of what lies on the floor beside whoever wears the others in the takes.

    Starting blocks, a ball, the corners of a plate: no higher than a foot, and as far off the skin of a known body as
    no marker is worn. None where no known body fits.
    """
    subjects = list(gathered(takes, markers).values())
    body, place = known_body(markers, bodies), None
    if body is not None:
        place = known_places(body, markers)
    elif (laid := laid_into(subjects, markers, bodies)) is not None:
        body, place = laid.body, laid.place
    if body is None or place is None:
        return ()
    here = np.flatnonzero(place >= 0)
    bare, gate, beside = without_markers(body, place[here]), LAYING.gates[1], []
    for points in subjects:
        found = in_segments(BodyModel(bare), points, here)
        if found is not None:
            off_skin = off_surface(bare, found[0]).min(axis=1)
            height, low = points[..., 2], np.nanmin(points[..., 2])
            on_floor = np.nan_to_num(height, nan=low).max(axis=0) <= low + gate * (np.nanmax(height) - low)
            shown = np.isfinite(found[0]).all(axis=(1, 2))
            beside.append(shown & on_floor & (off_skin > 2 * gate))
    return tuple(name for name, own in zip(markers, np.transpose(beside), strict=False) if own.all())


def laid_body(
    frame: np.ndarray, bodies: Sequence[tuple[MarkerSet, np.ndarray]], markers: Sequence[str]
) -> LaidBody | None:
    """The one of the bodies that fits the labelled frame (M, 3) m, NaN where missing, z up, best; None where none does.

    Each body comes with the poses (P, J, 3) that it may be in, as `Spread.poses` has them. `markers` are the names of
    the frame's. The options say when it fits.
    """
    parts = [(body, chosen, poses) for body, poses in bodies for chosen in _parts(body)]
    found = [one for part in parts if (one := _laid(frame, *part, markers)) is not None]
    return min(found, key=lambda one: one.off) if found else None


def _parts(whole: MarkerSet) -> list[np.ndarray]:
    """The markers (K,) of a whole body, of one without those on the head, and of one without those on head and arms.

    What a set lacks up there is what makes a body too small or too large for it: its shoulders would be the head.
    Where next to none is left, that is no body.
    """
    segment = whole.attachment
    head = np.array([name == "head" for name in whole.skeleton.segments])[segment]
    arm = _arms(whole)[segment]
    lacking = np.unique([head & False, head, head | arm], axis=0)
    return [np.flatnonzero(~one) for one in lacking if (~one).sum() > MIN_POINTS]


def _arms(body: MarkerSet) -> np.ndarray:
    """(J,) whether a segment is on a limb that hangs from no pelvis."""
    limb = body.skeleton.limbs
    return (limb >= 0) & (np.array(body.skeleton.parents)[limb] != 0)


def _laid(
    frame: np.ndarray, whole: MarkerSet, chosen: np.ndarray, poses: np.ndarray, markers: Sequence[str]
) -> LaidBody | None:
    """A body's markers `chosen` (K,) as they fit a frame of `markers` best of all starts; None if not."""
    body = without_markers(whole, chosen)
    there = np.flatnonzero(np.isfinite(frame).all(axis=1))
    if len(there) < MIN_POINTS:
        return None
    cloud, model, gate = frame[there], BodyModel(body), LAYING.gates[1]
    apart = _apart(whole, markers)[np.ix_(chosen, there)]
    mates = _mates(body.markers), _mates([markers[one] for one in there.tolist()])
    height = float(np.ptp(cloud[:, 2]) / np.ptp(body.rest_markers[:, 2]))
    height = float(possible_height(height))
    bodies = _fitted(model, cloud, apart, mates, _starts(model, cloud, poses, height), height)
    placed = model.pose(bodies).markers
    matched = _matched(placed, cloud, apart, mates, gate * height)
    found = matched >= 0
    away = np.where(found, np.linalg.norm(placed - cloud[matched], axis=2) / height, gate)
    size = bodies.scale.mean(axis=1)  # a hand and a rat fit bodies of 0.2 to 0.7 m
    alone = ~(matched[..., None] == np.arange(len(cloud))).any(axis=1)
    places = places_in_segments(model, bodies, cloud)
    skins = [off_surface(body, own) for own in places]
    off_skin = alone * [np.where(may_carry(body, skin), skin, np.inf).min(axis=1) for skin in skins]
    # What somebody holds may be anywhere and is no reason against a body, but of two that fit the other has an arm.
    near, off = (
        (away.sum(axis=1) + np.minimum(off_skin, most).sum(axis=1)) / (len(body) + len(cloud))
        for most in (gate, LAYING.gates[0])
    )
    fits = (near <= LAYING.max_off) & (size == possible_height(size))
    if not fits.any():
        return None
    best = np.where(fits, off, np.inf).argmin()
    # What is nearer to the skin of a thigh than to where a hand beside it has a marker is the thigh's, on both sides.
    arms = _arms(body)
    others = arms[body.attachment] & (skins[best][:, ~arms].min(axis=1)[matched[best]] < away[best])
    found = found[best] & ~(others | others[mates[0]])
    mine = np.flatnonzero(found & _on_worn_limbs(body, found))
    place = np.full(len(frame), -1)
    place[there[matched[best, mine]]] = chosen[mine]
    return LaidBody(whole, place, float(off[best]))


def _apart(body: MarkerSet, markers: Sequence[str]) -> np.ndarray:
    """(K, M) which of the body's markers each of `markers` is not: its name says the other side, or another marker."""
    meant, own = known_places(body, markers), np.arange(len(body))
    known = np.isin(own, meant)[:, None] | (meant >= 0)
    across = marker_sides(body.markers)[:, None] * marker_sides(markers) < 0  # what is left is nothing right
    return across | (known & (meant != own[:, None]))


def _on_worn_limbs(body: MarkerSet, found: np.ndarray) -> np.ndarray:
    """(N,) whether a marker of the body is on trunk, head, or a limb most of whose markers were found (N,).

    Arms that hang beside the hips have a few markers of whoever wears none on the arms.
    """
    limb = body.skeleton.limbs[body.attachment]
    worn = np.array([found[limb == one].mean() >= MAJORITY for one in limb])
    return (limb < 0) | worn


def _mates(markers: Sequence[str]) -> np.ndarray:
    """(M,) each marker's mirror image by its name, itself where it has none."""
    order = mirror_order(tuple(markers))
    return np.arange(len(markers)) if order is None else order


def _fitted(
    model: BodyModel, cloud: np.ndarray, apart: np.ndarray, mates: Mates, bodies: Bodies, height: float
) -> Bodies:
    """Bodies fitted to a cloud (P, 3), matched ever more closely; `apart` and `mates` as in `_matched`."""
    prior = Prior(model, height=height)
    for gate in np.geomspace(*LAYING.gates, MATCHINGS) * height:
        matched = _matched(model.pose(bodies).markers, cloud, apart, mates, gate)
        goal = np.where((matched >= 0)[..., None], cloud[matched], np.nan)
        bodies = fit_body(model, bodies, labelled_pull(goal), FIT_STEPS, prior).bodies
    return bodies


def marker_sides(markers: Sequence[str]) -> np.ndarray:
    """(M,) 1 for a marker whose name says left, -1 for right, 0 for what has no other side."""
    sides = np.zeros(len(markers), dtype=int)
    for index, (name, mate) in enumerate(zip(markers, _mates(markers), strict=True)):
        other = markers[mate]
        if other != name:
            first = next(one for one, two in zip(name.lower(), other.lower(), strict=False) if one != two)
            sides[index] = 1 if first == "l" else -1
    return sides


def _starts(model: BodyModel, cloud: np.ndarray, poses: np.ndarray, height: float) -> Bodies:
    """The likeliest bodies in some of the poses, turned about the vertical, above a middle of the cloud."""
    some = np.concatenate([np.zeros_like(poses[:1]), some_of(poses)])
    bodies = posed_bodies(model, some, height)
    markers = model.pose(bodies).markers
    yaws = np.arange(HEADINGS) * 2 * np.pi / HEADINGS
    ways = [
        (turned(markers - middle[:, None], np.full(len(markers), yaw)) + goal, middle, goal, yaw)
        for middle, goal in zip(_feet(markers), _feet(cloud), strict=True)
        for yaw in yaws
    ]
    costs = np.array([_far(placed, cloud, LAYING.gates[0] * height) for placed, *_ in ways])
    chosen = np.argsort(costs, axis=None)[: LAYING.starts]
    way, pose = np.unravel_index(chosen, costs.shape)
    middle = np.array([ways[one][1][own] for one, own in zip(way, pose, strict=True)])
    goal, yaw = np.array([ways[one][2] for one in way]), np.array([ways[one][3] for one in way])
    picked, about = bodies.pick(pose), rotations.about_z(yaw)
    moved = goal - turned(middle[:, None], yaw)[:, 0]
    return replace(picked, translation=moved, quaternion=rotations.quaternion_product(about, picked.quaternion))


def _feet(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(..., 3) two middles of points (..., N, 3) on the ground below them: one may go up farther than the other.

    The first counts limbs alike however many markers are on each, the second hardly what lies about.
    """
    low, high = points.min(axis=-2), points.max(axis=-2)
    middles = (low + high)[..., :2] / 2, np.median(points, axis=-2)[..., :2]
    box, usual = (np.concatenate([middle, low[..., 2:]], axis=-1) for middle in middles)
    return box, usual


def _far(markers: np.ndarray, cloud: np.ndarray, reach: float) -> np.ndarray:
    """(B,) how far markers (B, N, 3) and a cloud (P, 3) are from each other's nearest, none farther than reach."""
    squares = (markers**2).sum(axis=2)[:, :, None] + (cloud**2).sum(axis=1) - 2 * (markers @ cloud.T)
    nearest = (np.sqrt(np.clip(squares.min(axis=axis), 0, reach**2)) for axis in (1, 2))
    return sum(away.mean(axis=1) for away in nearest)


def _matched(markers: np.ndarray, cloud: np.ndarray, apart: np.ndarray, mates: Mates, gate: float) -> np.ndarray:
    """(B, N) the point of a cloud (P, 3) that each of markers (B, N, 3) is, one to one, -1 beyond the gate.

    No marker is a point that is `apart` (N, P). By their `mates` what is called alike on both sides is alike: a hand
    that may have a thigh's marker on one side has it on neither.
    """
    from scipy.optimize import linear_sum_assignment

    found = np.full(markers.shape[:2], -1)
    own, others = (order != np.arange(len(order)) for order in mates)
    for row, placed in zip(found, markers, strict=True):
        away = np.where(apart, gate, np.minimum(np.linalg.norm(placed[:, None] - cloud, axis=2), gate))
        square = away**2
        both = (square + square[np.ix_(*mates)]) / 2
        one, two = linear_sum_assignment(np.where(own[:, None] & others, both, square))
        near = away[one, two] < gate
        row[one[near]] = two[near]
    return found
