# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set for people whose markers are partly known: a known body with the markers that the takes show.

The known markers pose the body; every other marker goes to the segment in whose axes it stays most constant.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..body.bodies import Bodies, BodyModel
from ..data.markersets import MarkerSet
from ..posing.posing import POSING, fit_points
from .segments import distance_to_axis
from .spread import MAJORITY, SPREAD, full_frames, some_of

SETTLING = 2  # times that a body is posed on all markers, and they are put where they are on it: then nothing moves


# Heights of movement that a height off a segment's surface counts as: so all of the plates on a whole body go to their
# segments. In a single frame a marker sits on what it is nearest to.
SURFACE_COST = 0.1

# Heights, 12 cm, off all limbs that are worn: no wand is as long, so an elbow's marker beside the trunk is an arm's.
OFF_LIMBS = 0.07  # physical


def known_body(markers: Sequence[str], known: Sequence[MarkerSet]) -> MarkerSet | None:
    """The one of the known marker sets whose body suits these markers best; None where none does."""

    def shared(markerset: MarkerSet) -> int:
        return int((known_places(markerset, markers) >= 0).sum())

    fitting = [one for one in known if shared(one) >= MAJORITY * max(len(one), len(markers))]
    return max(fitting, key=lambda one: (shared(one), -len(one))) if fitting else None


def transferred(
    body: MarkerSet,
    subjects: Sequence[np.ndarray],
    markers: Sequence[str],
    name: str,
    place: np.ndarray | None = None,
) -> MarkerSet:
    """The body of a known marker set with these markers, from labelled frames of each subject (T, M, 3) m.

    `place` (M,) is the body's marker that each of them is, -1 for none, where that is known otherwise than by names.
    Raises ValueError when no frame shows markers enough to pose it.
    """
    place = known_places(body, markers) if place is None else place
    here = np.flatnonzero(place >= 0)
    bare = without_markers(body, place[here])
    carrier, offsets, sd = np.full(len(markers), -1), np.zeros((len(markers), 3)), np.zeros(len(markers))
    carrier[here], offsets[here], sd[here] = bare.attachment, bare.offsets, bare.spread.marker_sd
    carrier, offsets, sd = _hung(bare, subjects, here, carrier, offsets, sd)
    if (carrier < 0).any():
        raise ValueError("a marker that the body does not know is never seen with enough of those that it knows")
    joints = len(bare.skeleton)
    modes = np.zeros((len(bare.spread.modes), joints + len(markers), 3))
    modes[:, :joints], modes[:, joints + here] = bare.spread.modes[:, :joints], bare.spread.modes[:, joints:]
    aliases = {alias: meant for alias, meant in bare.aliases.items() if meant in markers and alias not in markers}
    return replace(
        bare,
        name=name,
        description=f"{len(markers)} markers on the body of {body.name}",
        markers=tuple(markers),
        aliases=aliases,
        attachment=carrier,
        offsets=offsets,
        spread=replace(bare.spread, modes=modes, marker_sd=sd),
    )


def settled(body: MarkerSet, subjects: Sequence[np.ndarray]) -> MarkerSet:
    """A marker set with all its markers where labelled frames of each subject (T, M, 3) m have them.

    Each round poses the body on all of them, hangs every marker on the segment in whose axes it stays most constant,
    and puts it where it is there. Raises ValueError when no frame shows markers enough to pose it.
    """
    here, anywhere = np.arange(len(body)), np.full(len(body), -1)
    for _ in range(SETTLING):
        carrier, offsets, sd = _hung(body, subjects, here, anywhere, body.offsets, body.spread.marker_sd)
        carrier = np.where(carrier < 0, body.attachment, carrier)
        body = replace(body, attachment=carrier, offsets=offsets, spread=replace(body.spread, marker_sd=sd))
    return body


def _hung(
    body: MarkerSet,
    subjects: Sequence[np.ndarray],
    here: np.ndarray,
    carrier: np.ndarray,
    offsets: np.ndarray,
    sd: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The segment that carries each of M markers (M,), where it sits on it (M, 3), and how that varies (M,), heights.

    The body has the markers at `here`. Those that are carried by none yet, -1, go where they stay most constant; what
    no frame shows stays as it is.
    """
    model = BodyModel(body)
    found = [one for points in subjects if (one := in_segments(model, points, here)) is not None]
    if not found:
        raise ValueError("no frame shows enough of the known markers together")
    means, spreads = np.array([mean for mean, _ in found]), np.array([spread for _, spread in found])
    away = np.array([off_surface(body, mean) for mean in means])
    seen = np.flatnonzero(np.isfinite(spreads).any(axis=(0, 2)))
    carrier, offsets, sd = carrier.copy(), offsets.copy(), np.where(carrier < 0, SPREAD.marker_sd, sd)
    cost = np.nanmean((spreads + SURFACE_COST * away)[:, seen], axis=0)
    allowed = may_carry(body, np.nanmean(away[:, seen], axis=0))
    nearest = np.where(allowed, cost, np.inf).argmin(axis=1)
    carrier[seen] = np.where(carrier[seen] < 0, nearest, carrier[seen])
    own = means[:, seen, carrier[seen]]
    offsets[seen] = np.nanmean(own, axis=0)
    count = np.isfinite(own[..., 0]).sum(axis=0)
    squares = np.nanmean(np.square(own - offsets[seen]), axis=(0, 2)) * count / np.maximum(count - 1, 1)
    sd[seen] = np.maximum(sd[seen], np.sqrt(squares))
    return carrier, offsets, sd


def on_worn_limbs(body: MarkerSet) -> np.ndarray:
    """(J,) whether a segment is where a body with these markers says: not on a limb that has none of them."""
    limbs = body.skeleton.limbs
    return (limbs < 0) | np.isin(limbs, limbs[body.attachment])


def may_carry(body: MarkerSet, away: np.ndarray) -> np.ndarray:
    """(M, J) whether a segment may carry a marker that is off the segments' skins by `away` (M, J) heights.

    None on a limb that has none of the body's markers, but for what is on no other.
    """
    worn = on_worn_limbs(body)
    return worn | (away[:, worn].min(axis=1) > OFF_LIMBS)[:, None]


def known_places(markerset: MarkerSet, markers: Sequence[str]) -> np.ndarray:
    """(M,) the known marker that each of the names means, -1 for none; each known one once."""
    found = np.full(len(markers), -1)
    for index, name in enumerate(markers):
        try:
            place = markerset.index(name)
        except KeyError:
            continue
        if place not in found:
            found[index] = place
    return found


def without_markers(body: MarkerSet, chosen: np.ndarray) -> MarkerSet:
    """The marker set with only the markers `chosen` (K,), in that order."""
    joints = len(body.skeleton)
    rows = np.concatenate([np.arange(joints), joints + chosen])
    spread = replace(body.spread, modes=body.spread.modes[:, rows], marker_sd=body.spread.marker_sd[chosen])
    names, attachment = tuple(body.markers[index] for index in chosen), body.attachment[chosen]
    return replace(body, markers=names, attachment=attachment, offsets=body.offsets[chosen], spread=spread)


def in_segments(model: BodyModel, points: np.ndarray, here: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Where every marker sits in the axes of every segment (M, J, 3), and how constantly (M, J); heights.

    None where no frame shows enough of the markers at `here`, which are the body's.
    """
    points = some_of(points[full_frames(points[:, here], POSING.min_markers)])
    if not len(points):
        return None
    local = places_in_segments(model, fit_points(model, points[:, here]), points)
    seen = np.isfinite(local).all(axis=3).any(axis=0)
    mean, spread = np.full(local.shape[1:], np.nan), np.full(local.shape[1:3], np.nan)
    mean[seen] = np.nanmedian(local[:, seen], axis=0)
    away = np.sqrt(np.square(local - mean).sum(axis=3))
    spread[seen] = np.nanmedian(away[:, seen], axis=0)
    return mean, spread


def places_in_segments(model: BodyModel, bodies: Bodies, points: np.ndarray) -> np.ndarray:
    """(F, M, J, 3) points, (F, M, 3) m or (M, 3) of all bodies, in the axes of every segment of F bodies, heights."""
    posed = model.pose(bodies)
    offset = points[..., None, :] - posed.joints[:, None]
    return np.einsum("fjba,fmjb->fmja", posed.rotations, offset) / bodies.scale.mean(axis=1)[:, None, None, None]


def off_surface(body: MarkerSet, places: np.ndarray) -> np.ndarray:
    """(M, J) how far markers at places (M, J, 3) in each segment's axes are off that segment's capsules, heights.

    Far off a segment that has none.
    """
    capsules, away = body.capsules, np.ones(places.shape[:2])
    for segment, start, end, radius in zip(
        capsules.segment, capsules.start, capsules.end, capsules.radius, strict=True
    ):
        off = np.abs(distance_to_axis(places[:, segment], start, end) - radius)
        away[:, segment] = np.fmin(away[:, segment], off)
    return away
