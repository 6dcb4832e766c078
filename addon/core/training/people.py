# SPDX-License-Identifier: GPL-3.0-or-later
"""A person's skeleton and body in labelled takes whose marker names nobody knows.

Two ways lead to a guess: a known body is laid into frames by where the markers sit (`laying`), or the groups that move
as one are read as limbs (`limbs`). Each guess poses the body on all of the take, every marker goes to the segment that
carries it, and the guess is kept that explains the take best. What no person's body explains is none.
"""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import Bodies, BodyModel
from ..body.prior import Prior
from ..data.markersets import MarkerSet
from ..data.takes import evenly_spread
from ..posing.posing import fit_points, labelled_pull
from .laying import LAYING, laid_body, marker_sides
from .limbs import Limb, guide, has_limbs, readings, sites_of
from .poses import known_poses
from .segments import Segments, find_segments, of_one_size
from .transfer import TRANSFER, settled, transferred, without_markers


@dataclass(frozen=True)
class PeopleOptions:
    """When a take is a person's. All reckoned.

    reach_quantiles  of how high frames reach, where bodies are laid into them: who stands with the arms down
    screened_frames  of a subject, that each reading of limbs is tried on
    settled_ways     so many of the likeliest readings are settled on all markers, of those
    settled_ratio    times the likeliest one's misfit that the others may have
    site_sd          heights, how well joints between groups are known
    checked_frames   of each subject, that a settled body is judged by
    max_off          heights, how far markers may be from where the body has them, in the mean of their medians
    max_marker_off   heights, the same of the tenth of the markers that is farthest off
    max_unusual      how far poses and shape may be from those of people, in squares of standard deviations: of people
                     who fence, dance and crawl up to 150 were seen, of left taken for right 400
    """

    reach_quantiles: tuple[float, ...] = (0.5, 0.3, 0.7)
    screened_frames: int = 12
    settled_ways: int = 2
    settled_ratio: float = 1.3
    site_sd: float = 0.02
    checked_frames: int = 40
    max_off: float = 0.008
    max_marker_off: float = 0.013
    max_unusual: float = 200.0


PEOPLE = PeopleOptions()
# How well a body must fit a frame where all of the take judges it afterwards.
LOOSELY = replace(LAYING, min_matched=0.6, min_cloud=0.4, max_off=0.027)


@dataclass(frozen=True, eq=False)
class FoundPerson:
    """A person's body found in takes.

    markerset  the takes' markers on it
    known      the known body that it is of
    off        (M,) heights, how far each marker is from where the posed body has it, in the middle
    cost       of the posed frames, in the mean: how badly markers and poses suit what is known of people
    """

    markerset: MarkerSet
    known: str
    off: np.ndarray
    cost: float


def person_in(
    subjects: Sequence[np.ndarray], markers: Sequence[str], name: str, bodies: Sequence[MarkerSet]
) -> Generator[float, None, FoundPerson | None]:
    """The person whom labelled frames of each subject (T, M, 3) m show moving, on one of the known bodies.

    None where no body suits: a thing, an animal, a hand, or too little of a person. Yields the share that is done.
    """
    posable = [(body, poses) for body in bodies if len(poses := known_poses(body, bodies))]
    sides, tried = marker_sides(markers), 0
    yield 0.0
    for guesses, most in (
        (_read_guesses(subjects, markers, name, posable), PEOPLE.settled_ways),
        (_laid_guesses(subjects, markers, name, posable, sides), 1),
    ):
        found: list[FoundPerson] = []
        for guess in guesses:
            person = None if guess is None else _judged(guess[1], guess[0], subjects, sides)
            found += [] if person is None else [person]
            tried += 1
            yield min(tried / (PEOPLE.settled_ways + len(PEOPLE.reach_quantiles) + 1), 1.0)
            if len(found) == most:
                break
        if found:
            return min(found, key=lambda one: one.cost)
    return None


def _read_guesses(subjects, markers, name, posable) -> Iterator[tuple[str, MarkerSet] | None]:
    """Marker sets by the limbs that groups of markers are read as, the likeliest first; None once these are found."""
    whole = [(body, poses) for body, poses in posable if has_limbs(body)]
    if not whole:
        return
    body, _ = max(whole, key=lambda one: len(one[1]))
    scaled, sizes, height = of_one_size(subjects)
    found = find_segments(scaled)
    ways = [(_misfit(body, found, scaled, way), way) for way in readings(found)]
    ways.sort(key=lambda one: one[0])
    yield None
    for misfit, way in ways[: PEOPLE.settled_ways]:
        if misfit > PEOPLE.settled_ratio * ways[0][0]:
            return
        guided = guide(body, way, PEOPLE.site_sd)
        both = [
            np.concatenate([points, sites_of(found, points, way)], axis=1) * (size / height)
            for points, size in zip(scaled, sizes, strict=True)
        ]
        place = np.append(np.full(len(markers), -1), np.arange(len(guided)))
        names = (*markers, *guided.markers)
        for known, guess in _tried(body.name, guided, both, names, name, place):
            yield known, without_markers(guess, np.arange(len(markers)))


def _laid_guesses(subjects, markers, name, posable, sides) -> Iterator[tuple[str, MarkerSet] | None]:
    """Marker sets of known bodies that were laid into frames; None for a frame into which none was."""
    for frame in _frames(subjects):
        laid = laid_body(frame, posable, sides, LOOSELY)
        if laid is None:
            yield None
        else:
            yield from _tried(laid.body.name, laid.body, subjects, markers, name, laid.place)


def _tried(known, body, subjects, markers, name, place) -> Iterator[tuple[str, MarkerSet]]:
    """The body with all markers, if the takes show them together enough."""
    try:
        yield known, transferred(body, subjects, markers, name, place, TRANSFER.settled_surface_cost)
    except ValueError:
        return


def _frames(subjects: Sequence[np.ndarray]) -> Iterator[np.ndarray]:
    """Full frames of subjects that reach as high as most, one after the other."""
    for number, quantile in enumerate(PEOPLE.reach_quantiles):
        points = subjects[number % len(subjects)]
        seen = np.isfinite(points[..., 0]).sum(axis=1)
        full = points[seen >= np.quantile(seen, 0.9)]
        reach = np.nanmax(full[..., 2], axis=1) - np.nanmin(full[..., 2], axis=1)
        yield full[np.argsort(reach)[int(quantile * (len(full) - 1))]]


def _misfit(body: MarkerSet, found: Segments, subjects: Sequence[np.ndarray], way: Sequence[Limb]) -> float:
    """How badly a reading's joints suit a body that is posed on them; infinite where no frame shows them."""
    model, costs = BodyModel(guide(body, way, PEOPLE.site_sd)), []
    for points in subjects:
        sites = sites_of(found, points[evenly_spread(len(points), PEOPLE.screened_frames)], way)
        try:
            costs.append(sum(_cost(model, fit_points(model, sites), sites)))
        except ValueError:
            return np.inf
    return float(np.mean(costs))


def _cost(model: BodyModel, bodies: Bodies, points: np.ndarray) -> tuple[float, float]:
    """How badly posed bodies suit points (T, M, 3) m, and what is known of people: a frame in the mean."""
    there = np.isfinite(bodies.translation).all(axis=1)
    bodies, points = bodies.pick(there), points[there]
    data = labelled_pull(points)(model.pose(bodies).markers).cost
    return float(data.mean()), float(Prior(model).terms(bodies)[0].mean())


def _judged(guess: MarkerSet, known: str, subjects: Sequence[np.ndarray], sides: np.ndarray) -> FoundPerson | None:
    """The person that a guess makes of the subjects; None where its body is not theirs."""
    try:
        body = settled(guess, subjects)
    except ValueError:
        return None
    model, away, costs = BodyModel(body), [], []
    for points in subjects:
        some = points[evenly_spread(len(points), PEOPLE.checked_frames)]
        bodies = fit_points(model, some)
        gaps = np.linalg.norm(model.pose(bodies).markers - some, axis=2)
        away.append(gaps / bodies.scale.mean(axis=1)[:, None])
        costs.append(_cost(model, bodies, some))
    off = np.nanmedian(np.concatenate(away), axis=0)
    suits, usual = np.mean(costs, axis=0)
    near = np.nanmean(off) <= PEOPLE.max_off and np.nanquantile(off, 0.9) <= PEOPLE.max_marker_off
    if not near or usual > PEOPLE.max_unusual or not _sides_agree(body, sides):
        return None
    return FoundPerson(body, known, off, float(suits + usual))


def _sides_agree(body: MarkerSet, sides: np.ndarray) -> bool:
    """Whether most of the markers whose names have sides (M,) sit on limbs of that side."""
    own = np.array([{".L": 1, ".R": -1}.get(name[-2:], 0) for name in body.skeleton.segments])[body.attachment]
    both = own * sides
    return bool((both > 0).sum() >= LAYING.min_side_agree * (both != 0).sum())
