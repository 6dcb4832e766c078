# SPDX-License-Identifier: GPL-3.0-or-later
"""A person's skeleton and body in labelled takes whose marker names nobody knows.

A known body is laid into a frame by where the markers sit (`laying`) and posed on all of the takes; every marker goes
to the segment that carries it. What no person's body explains is none.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.bodies import BodyModel
from ..body.prior import Prior
from ..data.markersets import MarkerSet
from ..posing.posing import fit_points
from .laying import laid_into, marker_sides
from .spread import some_of
from .transfer import settled, transferred


@dataclass(frozen=True)
class PeopleOptions:
    """When a take is a person's.

    max_off      heights, how far markers may be from where the body has them, in the mean of their medians; measured:
                 0.0002 to 0.006 for walkers, actors and players whose names nobody knew, 0.010 to 0.020 for nine of ten
                 bodies laid over plates
    max_unusual  how far poses and shape may be from those of people, in squares of standard deviations; measured: of
                 people who fence, dance and crawl up to 150 were seen, of left taken for right 400
    """

    max_off: float = 0.008
    max_unusual: float = 200.0


PEOPLE = PeopleOptions()


def person_in(
    subjects: Sequence[np.ndarray], markers: Sequence[str], name: str, bodies: Sequence[MarkerSet]
) -> tuple[MarkerSet, str] | None:
    """The person whom labelled frames of each subject (T, M, 3) m show moving: their markers on a known body, its name.

    None where no body suits: a thing, an animal, a hand, plates, or too little of a person.
    """
    laid = laid_into(subjects, markers, bodies)
    if laid is None:
        return None
    try:
        body = settled(transferred(laid.body, subjects, markers, name, laid.place), subjects)
    except ValueError:  # the takes do not show them together enough
        return None
    model, away, unusual = BodyModel(body), [], []
    for points in subjects:
        some = some_of(points)
        bodies_posed = fit_points(model, some)
        gaps = np.linalg.norm(model.pose(bodies_posed).markers - some, axis=2)
        away.append(gaps / bodies_posed.scale.mean(axis=1)[:, None])
        there = np.isfinite(bodies_posed.translation).all(axis=1)
        unusual.append(float(Prior(model).terms(bodies_posed.pick(there))[0].mean()))
    off = np.nanmean(np.nanmedian(np.concatenate(away), axis=0))
    suits = off <= PEOPLE.max_off and np.mean(unusual) <= PEOPLE.max_unusual
    return (body, laid.body.name) if suits and _sides_agree(body, marker_sides(markers)) else None


def _sides_agree(body: MarkerSet, sides: np.ndarray) -> bool:
    """Whether most of the markers whose names have sides (M,) sit on limbs of that side."""
    own = np.array([{".L": 1, ".R": -1}.get(name[-2:], 0) for name in body.skeleton.segments])[body.attachment]
    return bool((own * sides).sum() >= 0)
