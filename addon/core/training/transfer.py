# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set for people whose markers are partly known: a known body with the markers that the takes show.

The known markers pose the body; every other marker goes to the segment in whose axes it stays most constant.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import BodyModel
from ..data.markersets import MarkerSet
from ..data.takes import evenly_spread
from ..posing.posing import POSING, fit_points
from .segments import distance_to_axis


@dataclass(frozen=True)
class TransferOptions:
    """How a known body is taken over; reckoned.

    frames               of a subject, spread over what shows it
    min_set_share        of a known set's markers must be there for its body to be taken, and
    min_known_share      of the takes' markers must be known
    min_pose_share       of the known markers must be seen in a frame that is used
    known_subjects       subjects that the known marker set counts for when these say where a known marker sits
    surface_cost         heights of movement that a height between a marker and a segment's body counts as: where hardly
                         anything moves, as in a single frame, a marker sits on what it is nearest to
    min_marker_sd        heights, by which subjects' markers sit elsewhere
    unknown_marker_sd    heights, the same of a marker that one subject only had
    settled_surface_cost the same where all markers are to be hung up anew: a hand that no marker holds moves with any
    settling_rounds      of posing a body on all markers and putting these where they are on it
    """

    frames: int = 120
    min_set_share: float = 0.6
    min_known_share: float = 0.5
    min_pose_share: float = 0.5
    known_subjects: float = 4.0
    surface_cost: float = 0.02
    min_marker_sd: float = 0.006
    unknown_marker_sd: float = 0.015
    settled_surface_cost: float = 0.1
    settling_rounds: int = 2


TRANSFER = TransferOptions()


def known_body(markers: Sequence[str], known: Sequence[MarkerSet]) -> MarkerSet | None:
    """The one of the known marker sets whose body suits these markers best; None where none does."""

    def shared(markerset: MarkerSet) -> int:
        return int((known_places(markerset, markers) >= 0).sum())

    least = TRANSFER.min_known_share * len(markers)
    fitting = [one for one in known if shared(one) >= max(TRANSFER.min_set_share * len(one), least)]
    return max(fitting, key=lambda one: (shared(one), -len(one))) if fitting else None


def transferred(
    body: MarkerSet,
    subjects: Sequence[np.ndarray],
    markers: Sequence[str],
    name: str,
    place: np.ndarray | None = None,
    surface_cost: float = TRANSFER.surface_cost,
) -> MarkerSet:
    """The body of a known marker set with these markers, from labelled frames of each subject (T, M, 3) m.

    `place` (M,) is the body's marker that each of them is, -1 for none, where that is known otherwise than by names.
    Raises ValueError when no frame shows markers enough to pose it.
    """
    place = known_places(body, markers) if place is None else place
    here = np.flatnonzero(place >= 0)
    bare = _with_markers(body, place[here])
    model = BodyModel(bare)
    found = [_in_segments(model, _thinned(points, here), here) for points in subjects]
    found = [one for one in found if one is not None]
    if not found:
        raise ValueError("no frame shows enough of the known markers together")
    means, spreads = np.array([mean for mean, _ in found]), np.array([spread for _, spread in found])
    away = np.array([_off_surface(bare, mean) for mean in means])
    seen = np.isfinite(spreads).any(axis=(0, 2))
    if not seen[place < 0].all():
        raise ValueError("a marker that the body does not know is never seen with enough of those that it knows")
    attachment = np.zeros(len(markers), dtype=int)
    attachment[seen] = np.nanmean((spreads + surface_cost * away)[:, seen], axis=0).argmin(axis=1)
    attachment[here] = bare.attachment
    offsets, sd = np.zeros((len(markers), 3)), np.zeros(len(markers))
    offsets[seen], sd[seen] = _placed(means[:, np.flatnonzero(seen), attachment[seen]])
    count = np.isfinite(means[:, here, bare.attachment, 0]).sum(axis=0)[:, None]
    shift = np.where(count > 0, offsets[here] - bare.offsets, 0)
    offsets[here] = bare.offsets + shift * count / (count + TRANSFER.known_subjects)
    sd[here] = np.maximum(bare.spread.marker_sd, np.where(count[:, 0] > 1, sd[here], 0))
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
        attachment=attachment,
        offsets=offsets,
        spread=replace(bare.spread, modes=modes, marker_sd=sd),
    )


def settled(body: MarkerSet, subjects: Sequence[np.ndarray], rounds: int = TRANSFER.settling_rounds) -> MarkerSet:
    """A marker set with all its markers where labelled frames of each subject (T, M, 3) m have them.

    Each round poses the body on all of them, hangs every marker on the segment in whose axes it stays most constant,
    and puts it where it is there. Raises ValueError when no frame shows markers enough to pose it.
    """
    here = np.arange(len(body))
    for _ in range(rounds):
        model = BodyModel(body)
        found = [one for points in subjects if (one := _in_segments(model, _thinned(points, here), here)) is not None]
        if not found:
            raise ValueError("no frame shows enough of the markers together")
        means, spreads = np.array([mean for mean, _ in found]), np.array([spread for _, spread in found])
        away = np.array([_off_surface(body, mean) for mean in means])
        seen = np.isfinite(spreads).any(axis=(0, 2))
        attachment, offsets, sd = body.attachment.copy(), body.offsets.copy(), body.spread.marker_sd.copy()
        attachment[seen] = np.nanmean((spreads + TRANSFER.settled_surface_cost * away)[:, seen], axis=0).argmin(axis=1)
        offsets[seen], sd[seen] = _placed(means[:, np.flatnonzero(seen), attachment[seen]])
        body = replace(body, attachment=attachment, offsets=offsets, spread=replace(body.spread, marker_sd=sd))
    return body


def without_markers(markerset: MarkerSet, kept: np.ndarray) -> MarkerSet:
    """The marker set with only the markers at `kept` (K,), in that order."""
    return _with_markers(markerset, kept)


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


def _with_markers(body: MarkerSet, chosen: np.ndarray) -> MarkerSet:
    """The marker set with only the markers `chosen`, in that order."""
    joints = len(body.skeleton)
    rows = np.concatenate([np.arange(joints), joints + chosen])
    spread = replace(body.spread, modes=body.spread.modes[:, rows], marker_sd=body.spread.marker_sd[chosen])
    names = tuple(body.markers[index] for index in chosen)
    return replace(
        body,
        markers=names,
        attachment=body.attachment[chosen],
        offsets=body.offsets[chosen],
        spread=spread,
    )


def _thinned(points: np.ndarray, here: np.ndarray) -> np.ndarray:
    seen = np.isfinite(points[:, here]).all(axis=2).sum(axis=1)
    good = np.flatnonzero(seen >= max(POSING.min_markers, TRANSFER.min_pose_share * len(here)))
    return points[good[evenly_spread(len(good), TRANSFER.frames)]]


def _in_segments(model: BodyModel, points: np.ndarray, here: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Where every marker sits in the axes of every segment (M, J, 3), and how constantly (M, J); heights."""
    if not len(points):
        return None
    bodies = fit_points(model, points[:, here])
    posed = model.pose(bodies)
    size = bodies.scale.mean(axis=1)[:, None, None, None]
    offset = points[:, :, None] - posed.joints[:, None]
    local = np.einsum("fjba,fmjb->fmja", posed.rotations, offset) / size
    seen = np.isfinite(local).all(axis=3).any(axis=0)
    mean, spread = np.full(local.shape[1:], np.nan), np.full(local.shape[1:3], np.nan)
    mean[seen] = np.nanmedian(local[:, seen], axis=0)
    away = np.sqrt(np.square(local - mean).sum(axis=3))
    spread[seen] = np.nanmedian(away[:, seen], axis=0)
    return mean, spread


def _off_surface(body: MarkerSet, places: np.ndarray) -> np.ndarray:
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


def _placed(offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (M, 3) and standard deviation (M,) over subjects (N, M, 3), NaN where one has no such marker."""
    mean = np.nanmean(offsets, axis=0)
    count = np.isfinite(offsets[..., 0]).sum(axis=0)
    deviation = np.sqrt(np.nanmean(np.square(offsets - mean), axis=0).mean(axis=1) * count / np.maximum(count - 1, 1))
    deviation = np.where(count > 1, deviation, TRANSFER.unknown_marker_sd)
    return mean, np.maximum(deviation, TRANSFER.min_marker_sd)
