# SPDX-License-Identifier: GPL-3.0-or-later
"""A person's skeleton and body in labelled takes whose marker names nobody knows.

Two ways lead to a guess: a known body is laid into frames by where the markers sit (`laying`), or the groups that move
as one are read as limbs (`limbs`). Each guess poses the body on all of the take, every marker goes to the segment that
carries it, and the guess is kept that explains the take best. What no person's body explains is none.
"""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..body.bodies import Bodies, BodyModel
from ..body.prior import Prior
from ..data.markersets import MarkerSet
from ..posing.posing import fit_points, labelled_pull
from .laying import laid_into, marker_sides
from .limbs import Limb, guide, has_limbs, readings, sites_of
from .poses import known_poses
from .segments import Segments, find_segments, of_one_size
from .spread import SPREAD, some_of
from .transfer import settled, transferred, without_markers

READINGS = 2  # of limbs that are tried on all markers: the likeliest, and mostly its mirror image
SCREENED = 10  # one frame in so many shows which readings are likely


@dataclass(frozen=True)
class PeopleOptions:
    """When a take is a person's.

    max_off      heights, how far markers may be from where the body has them, in the mean of their medians; measured:
               0.003 for plates read as limbs, 0.010 to 0.020 for nine of ten bodies laid over them
    max_unusual  how far poses and shape may be from those of people, in squares of standard deviations; measured: of
                 people who fence, dance and crawl up to 150 were seen, of left taken for right 400
    """

    max_off: float = 0.008
    max_unusual: float = 200.0


PEOPLE = PeopleOptions()


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
    sides, done = marker_sides(markers), 0
    yield 0.0
    for guesses in (
        _read_guesses(subjects, markers, name, bodies),
        _laid_guesses(subjects, markers, name, bodies),
    ):
        found: list[FoundPerson] = []
        for known, guess in guesses:
            person = _judged(guess, known, subjects, sides)
            found += [] if person is None else [person]
            done += 1
            yield min(done / (READINGS + 1), 1.0)
        if found:
            return min(found, key=lambda one: one.cost)
    yield 1.0
    return None


def _read_guesses(subjects, markers, name, bodies) -> Iterator[tuple[str, MarkerSet]]:
    """Marker sets by the limbs that groups of markers are read as, the likeliest first."""
    whole = [body for body in bodies if has_limbs(body) and len(known_poses(body, bodies))]
    if not whole:
        return
    body = max(whole, key=lambda one: len(known_poses(one, bodies)))
    scaled, sizes, height = of_one_size(subjects)
    found = find_segments(scaled)
    ways = sorted(readings(found), key=lambda way: _misfit(body, found, scaled, way))
    for way in ways[:READINGS]:
        guided = guide(body, way, SPREAD.marker_sd)
        both = [
            np.concatenate([points, sites_of(found, points, way)], axis=1) * (size / height)
            for points, size in zip(scaled, sizes, strict=True)
        ]
        place = np.append(np.full(len(markers), -1), np.arange(len(guided)))
        names = (*markers, *guided.markers)
        for known, guess in _tried(body.name, guided, both, names, name, place):
            yield known, without_markers(guess, np.arange(len(markers)))


def _laid_guesses(subjects, markers, name, bodies) -> Iterator[tuple[str, MarkerSet]]:
    """The marker set of the known body that fits a frame."""
    laid = laid_into(subjects, markers, bodies)
    if laid is not None:
        yield from _tried(laid.body.name, laid.body, subjects, markers, name, laid.place)


def _tried(known, body, subjects, markers, name, place) -> Iterator[tuple[str, MarkerSet]]:
    """The body with all markers, if the takes show them together enough."""
    try:
        yield known, transferred(body, subjects, markers, name, place)
    except ValueError:
        return


def _misfit(body: MarkerSet, found: Segments, subjects: Sequence[np.ndarray], way: Sequence[Limb]) -> float:
    """How badly a reading's joints suit a body that is posed on them; infinite where no frame shows them."""
    model, costs = BodyModel(guide(body, way, SPREAD.marker_sd)), []
    for points in subjects:
        sites = sites_of(found, some_of(points)[::SCREENED], way)
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
        some = some_of(points)
        bodies = fit_points(model, some)
        gaps = np.linalg.norm(model.pose(bodies).markers - some, axis=2)
        away.append(gaps / bodies.scale.mean(axis=1)[:, None])
        costs.append(_cost(model, bodies, some))
    off = np.nanmedian(np.concatenate(away), axis=0)
    suits, usual = np.mean(costs, axis=0)
    if np.nanmean(off) > PEOPLE.max_off or usual > PEOPLE.max_unusual or not _sides_agree(body, sides):
        return None
    return FoundPerson(body, known, off, float(suits + usual))


def _sides_agree(body: MarkerSet, sides: np.ndarray) -> bool:
    """Whether most of the markers whose names have sides (M,) sit on limbs of that side."""
    own = np.array([{".L": 1, ".R": -1}.get(name[-2:], 0) for name in body.skeleton.segments])[body.attachment]
    return bool((own * sides).sum() >= 0)
