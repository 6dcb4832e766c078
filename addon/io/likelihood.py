# SPDX-License-Identifier: GPL-3.0-or-later
"""What was learned for naming 3D points, as the readable part "evidence" of a marker set's file."""

import numpy as np

from ..core.points.likelihood.calibration import FEATURES, FRAME_KINDS, Calibration
from ..core.points.likelihood.distances import DistanceConstraints
from ..core.points.likelihood.model import Likelihood
from ..core.points.likelihood.shape import Shape
from ..core.points.rigid_bodies.model import RigidBodies
from .markersets import Reader
from .text import rounded

MAX_LEARNED = 1e9  # of a number that was learned; format


def document_of(likelihood: Likelihood) -> dict:
    """A likelihood as JSON has it; ValueError where a number is not finite."""
    shape, constraints, calibration = likelihood.shape, likelihood.constraints, likelihood.calibration
    document = {
        "subjects": likelihood.subjects,
        "mean": rounded(shape.mean),
        "noise": rounded(shape.noise),
        "modes": rounded(np.moveaxis(shape.modes, 2, 0).reshape(shape.modes.shape[2], -1)),
        "size_sd": rounded(constraints.size_sd),
        "ties": rounded(np.column_stack([constraints.pair, constraints.length, constraints.sd])),
        "trust": rounded(calibration.weights),
        "rates": rounded(calibration.rates),
        "least": rounded(calibration.least),
    }
    bodies = likelihood.rigid_bodies
    if bodies is not None:
        document["plates"] = [list(map(int, body)) for body in bodies.members]
        document["form"] = rounded(bodies.form)
        for name, table in (("low", bodies.low), ("high", bodies.high)):
            document[name] = [rounded(row[: index + 1]) for index, row in enumerate(table)]
    return document


def read_likelihood(reader: Reader, value: object, markers: tuple[str, ...]) -> Likelihood:
    """The likelihood of these markers, checked in every part; raises InputError naming what is not as expected."""
    part, count = reader.mapping(value, "evidence"), len(markers)

    def row(key: str, length: int | None) -> np.ndarray:
        return reader.row(part.get(key), length, f'evidence "{key}"', MAX_LEARNED)

    def table(key: str, rows: int | None, columns: int) -> np.ndarray:
        return reader.table(part.get(key), rows, columns, f'evidence "{key}"', MAX_LEARNED)

    modes, constraints, rates = table("modes", None, 3 * count), table("ties", None, 4), row("rates", None)
    if not len(rates) or (rates < 0).any() or (rates > 1).any():
        reader.fail('evidence "rates" are not parts from 0 to 1; expected one or more')
    if ((constraints[:, :2] < 0) | (constraints[:, :2] >= count)).any() or (constraints[:, 2:] <= 0).any():
        reader.fail('evidence "ties" name no marker or a length below 0; expected two indices, m and m')
    noise = row("noise", count)
    if (noise <= 0).any():
        reader.fail('evidence "noise" is not above 0; expected a variance for each marker')
    pair, size_sd = constraints[:, :2].astype(int), reader.number(part, "size_sd", "evidence", low=1e-6)
    bodies = None
    if "plates" in part:
        form = table("form", count, 3)
        low, high = (reader.triangle(part.get(key), count, f'evidence "{key}"', MAX_LEARNED) for key in ("low", "high"))
        bodies = RigidBodies(_plates(reader, part["plates"], count), form, low, high)
    return Likelihood(
        markers=markers,
        shape=Shape(table("mean", count, 3), np.moveaxis(modes.reshape(-1, count, 3), 0, 2), noise),
        constraints=DistanceConstraints(pair, constraints[:, 2], constraints[:, 3], size_sd),
        calibration=Calibration(row("trust", FEATURES), rates, table("least", FRAME_KINDS, len(rates))),
        subjects=int(reader.number(part, "subjects", "evidence", low=1)),
        rigid_bodies=bodies,
    )


def _plates(reader: Reader, value: object, count: int) -> tuple[np.ndarray, ...]:
    """The markers of each rigid body."""
    bodies = value if isinstance(value, list) and all(isinstance(one, list) and one for one in value) else [[None]]
    flat = [index for body in bodies for index in body]
    if any(type(index) is not int or not 0 <= index < count for index in flat) or len(set(flat)) != len(flat):
        reader.fail('evidence "plates" are not lists of different indices of markers; expected [[0, 1, 2], …]')
    return tuple(np.array(body, dtype=int) for body in bodies)
