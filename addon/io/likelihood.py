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
    part = reader.mapping(value, "evidence")
    count = len(markers)
    modes = _table(reader, part, "modes", columns=3 * count)
    constraints = _table(reader, part, "ties", columns=4)
    rates = _list(reader, part, "rates")
    if not len(rates) or (rates < 0).any() or (rates > 1).any():
        reader.fail('evidence "rates" are not parts from 0 to 1; expected one or more')
    weights = _list(reader, part, "trust", FEATURES)
    if ((constraints[:, :2] < 0) | (constraints[:, :2] >= count)).any() or (constraints[:, 2:] <= 0).any():
        reader.fail('evidence "ties" name no marker or a length below 0; expected two indices, m and m')
    noise = _list(reader, part, "noise", count)
    if (noise <= 0).any():
        reader.fail('evidence "noise" is not above 0; expected a variance for each marker')
    return Likelihood(
        markers=markers,
        shape=Shape(
            mean=_table(reader, part, "mean", count, 3),
            modes=np.moveaxis(modes.reshape(-1, count, 3), 0, 2),
            noise=noise,
        ),
        constraints=DistanceConstraints(
            pair=constraints[:, :2].astype(int),
            length=constraints[:, 2],
            sd=constraints[:, 3],
            size_sd=reader.number(part, "size_sd", "evidence", low=1e-6),
        ),
        calibration=Calibration(
            weights=weights,
            rates=rates,
            least=_table(reader, part, "least", FRAME_KINDS, len(rates)),
        ),
        subjects=int(reader.number(part, "subjects", "evidence", low=1)),
        rigid_bodies=_rigid_bodies(reader, part, count) if "plates" in part else None,
    )


def _rigid_bodies(reader: Reader, part: dict, count: int) -> RigidBodies:
    bodies = part["plates"]
    flat = [index for body in bodies for index in body] if _is_lists(bodies) else [None]
    if any(type(index) is not int or not 0 <= index < count for index in flat) or len(set(flat)) != len(flat):
        reader.fail('evidence "plates" are not lists of different indices of markers; expected [[0, 1, 2], …]')
    return RigidBodies(
        members=tuple(np.array(body, dtype=int) for body in bodies),
        form=_table(reader, part, "form", count, 3),
        low=_symmetric(reader, part, "low", count),
        high=_symmetric(reader, part, "high", count),
    )


def _is_lists(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(group, list) and group for group in value)


def _list(reader: Reader, part: dict, key: str, count: int | None = None) -> np.ndarray:
    value = part.get(key)
    if not _is_row(value, count):
        expected = "finite numbers" if count is None else f"{count} finite numbers"
        reader.fail(f'evidence "{key}" is not a list of {expected}; expected what training wrote')
    return np.array(value, dtype=float)


def _table(reader: Reader, part: dict, key: str, rows: int | None = None, columns: int = 0) -> np.ndarray:
    value = part.get(key)
    if (
        not isinstance(value, list)
        or len(value) != (rows or len(value))
        or not all(_is_row(row, columns) for row in value)
    ):
        reader.fail(
            f'evidence "{key}" is not {rows or ""} rows of {columns} finite numbers; expected what training wrote'
        )
    return np.array(value, dtype=float).reshape(-1, columns)


def _symmetric(reader: Reader, part: dict, key: str, count: int) -> np.ndarray:
    rows = part.get(key)
    if not isinstance(rows, list) or len(rows) != count or not all(_is_row(row, i + 1) for i, row in enumerate(rows)):
        reader.fail(f'evidence "{key}" is not the lower triangle of {count} rows; expected what training wrote')
    table = np.zeros((count, count))
    for index, row in enumerate(rows):
        table[index, : index + 1] = table[: index + 1, index] = row
    return table


def _is_row(value: object, count: int | None) -> bool:
    """True for a list of finite numbers, `count` of them unless that is None."""
    if not isinstance(value, list) or len(value) != (len(value) if count is None else count):
        return False
    return all(
        isinstance(number, (int, float)) and not isinstance(number, bool) and abs(number) < 1e9 for number in value
    )
