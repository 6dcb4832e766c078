# SPDX-License-Identifier: GPL-3.0-or-later
"""Models, `*.markerset.json`: a marker set as readable text, what names its markers, training takes, and history.

Learned numbers are text too, or dataclasses of arrays, packed; both come back as data alone.
"""

import warnings
from functools import lru_cache
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.papers.partial_solvers.model import DOMAIN, FUNCTIONS, NO_POINT, Classifiers, PartialSolvers, Solver
from ..core.points.likelihood.distances import DistanceConstraints
from ..core.points.likelihood.model import FEATURES, FRAME_KINDS, Calibration, Likelihood
from ..core.points.likelihood.shape import Shape
from ..core.points.likelihood.sides import NO_SIDES, Sides
from ..core.points.models import Model, TrainingTake
from ..core.points.rigid_bodies.model import RigidBodies
from .markersets import (
    Reader,
    builtin_markersets,
    document_of,
    markerset_file,
    markerset_in,
    open_document,
    open_markerset,
)
from .model_history import HISTORY, fingerprint_of, own_models, read_history
from .packing import MAX_PACKED_BYTES, declared_bytes, pack, to_json, unpack
from .text import rounded, write_json
from .whole import LeftAlone

MAX_LEARNED = 1e9  # of a number that was learned; format


def likelihood_document(likelihood: Likelihood) -> dict:
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
    sides = likelihood.sides
    if len(sides):
        document["sides"] = rounded(np.column_stack([sides.markers, sides.height, sides.variance]))
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

    def array(key: str, *shape: int | None) -> np.ndarray:
        return reader.array(part.get(key), shape, f'evidence "{key}"', MAX_LEARNED)

    modes, constraints, rates = array("modes", None, 3 * count), array("ties", None, 4), array("rates", None)
    if not len(rates) or (rates < 0).any() or (rates > 1).any():
        reader.fail('evidence "rates" are not parts from 0 to 1; expected one or more')
    if ((constraints[:, :2] < 0) | (constraints[:, :2] >= count)).any() or (constraints[:, 2:] <= 0).any():
        reader.fail('evidence "ties" name no marker or a length below 0; expected two indices, m and m')
    noise = array("noise", count)
    if (noise <= 0).any():
        reader.fail('evidence "noise" is not above 0; expected a variance for each marker')
    pair, size_sd = constraints[:, :2].astype(int), reader.number(part, "size_sd", "evidence", low=1e-6)
    bodies = None
    if "plates" in part:
        form = array("form", count, 3)
        low, high = (reader.triangle(part.get(key), count, f'evidence "{key}"', MAX_LEARNED) for key in ("low", "high"))
        bodies = RigidBodies(_plates(reader, part["plates"], count), form, low, high)
    return Likelihood(
        markers=markers,
        shape=Shape(array("mean", count, 3), np.moveaxis(modes.reshape(-1, count, 3), 0, 2), noise),
        constraints=DistanceConstraints(pair, constraints[:, 2], constraints[:, 3], size_sd),
        calibration=Calibration(array("trust", FEATURES), rates, array("least", FRAME_KINDS, len(rates))),
        subjects=int(reader.number(part, "subjects", "evidence", low=1)),
        rigid_bodies=bodies,
        sides=_sides(reader, array("sides", None, 6), count) if "sides" in part else NO_SIDES,
    )


def _sides(reader: Reader, rows: np.ndarray, count: int) -> Sides:
    """The sides of so many markers, of rows (Q, 6)."""
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    markers, height, variance = rows[:, :4].astype(int), rows[:, 4], rows[:, 5]
    sound = (markers == rows[:, :4]).all() and ((markers >= 0) & (markers < count)).all()
    sound = sound and (np.diff(np.sort(markers, axis=1), axis=1) > 0).all()
    if not sound or (np.abs(height) > MAX_MARKER_M).any() or (variance < 0).any():
        reader.fail('evidence "sides" are not of four markers; expected four indices, a height (m) and a variance (m²)')
    return Sides(markers, height, variance)


def _plates(reader: Reader, value: object, count: int) -> tuple[np.ndarray, ...]:
    """The markers of each rigid body."""
    bodies = value if isinstance(value, list) and all(isinstance(one, list) and one for one in value) else [[None]]
    flat = [index for body in bodies for index in body]
    if any(type(index) is not int or not 0 <= index < count for index in flat) or len(set(flat)) != len(flat):
        reader.fail('evidence "plates" are not lists of different indices of markers; expected [[0, 1, 2], …]')
    return tuple(np.array(body, dtype=int) for body in bodies)


# What the parts are called in the file.
LIKELIHOOD, SECOND = "evidence", "second_evidence"
PARTIAL_SOLVERS, TRAINING_TAKES = "ensemble", "training_takes"
INDICES, PLAIN_NUMBERS = "iu", "fiu"  # kinds of arrays
MAX_MARKER_M = 1e3  # m; no marker of a training take is farther away


def open_model(name: str | Path) -> Model:
    """A built-in model by name, or any by the path of its file; InputError where it is neither."""
    path = markerset_file(name)
    if not path.exists():
        open_markerset(name)  # says what is wrong
        return read_model(path)
    now = path.stat()
    return _as_it_was(path.resolve(), now.st_mtime_ns, now.st_size)


def known_models(folder: Path | None) -> list[str]:
    """The built-in models by their names, and those in a user's folder by their paths.

    What is none is left out, with a warning. Raises InputError where that is no folder.
    """
    if folder is not None and not folder.is_dir():
        raise InputError("is no folder; expected the one of your own marker sets", folder)
    known = list(builtin_markersets())
    for path in own_models(folder) if folder else ():
        try:
            open_model(path)
            known.append(str(path))
        except InputError as error:
            warnings.warn(LeftAlone(f"{error}; it is not among the sets that are tried"), stacklevel=2)
    return known


@lru_cache(maxsize=32)  # several subjects have a model each, and all that are known are looked at for each take
def _as_it_was(path: Path, changed_ns: int, size: int) -> Model:  # noqa: ARG001 - when a file is another one
    """A model as its file was then: whoever labels many takes with it reads it once."""
    return read_model(path)


def read_model(path: Path) -> Model:
    """A model, checked in every part. Raises InputError that names the part."""
    reader, top = open_document(path)
    markerset = markerset_in(reader, top)
    learned, second = (
        read_likelihood(reader, top[key], markerset.markers) if key in top else None for key in (LIKELIHOOD, SECOND)
    )
    solvers = None
    if PARTIAL_SOLVERS in top:
        solvers = _partial_solvers(top[PARTIAL_SOLVERS], markerset.markers, path)
    takes = _training_takes(top, len(markerset), path)
    return Model(markerset, learned, solvers, takes, read_history(top, path), fingerprint_of(top), second)


def _partial_solvers(packed: object, markers: tuple[str, ...], path: Path) -> PartialSolvers:
    """The partial solvers of these markers, checked in every part."""
    solvers = unpack(PartialSolvers, packed, PARTIAL_SOLVERS, path)
    if solvers.markers != markers:
        raise InputError("has an ensemble for other markers than its own; expected it as it was trained", path)
    if not _sound_partial_solvers(solvers):
        words = f"has an {PARTIAL_SOLVERS} whose numbers do not go together"
        raise InputError(f"{words}; expected it as it was trained, so train the model anew", path)
    return solvers


def _training_takes(top: dict, markers: int, path: Path) -> tuple[TrainingTake, ...]:
    """What the model keeps of its training, checked in every part."""
    rows = top.get(TRAINING_TAKES, [])
    if not isinstance(rows, list):
        raise InputError("has damaged training takes; expected a list", path)
    if declared_bytes(rows) > MAX_PACKED_BYTES:
        raise InputError(f"has over {MAX_PACKED_BYTES >> 20} MB of training takes; expected what was trained", path)
    takes = tuple(unpack(TrainingTake, row, TRAINING_TAKES, path) for row in rows)
    arrays = [take.points for take in takes]
    alike = all((one.ndim, one.dtype.kind, one.shape[1:]) == (3, "f", (markers, 3)) for one in arrays)
    if not alike or any((np.abs(one) > MAX_MARKER_M).any() for one in arrays):
        words = "has training takes that are not about its markers in metres"
        raise InputError(f"{words}; expected them as they were trained", path)
    return takes


def write_model(path: Path, model: Model):
    """Writes a model; partial solvers and training takes come back exactly, the rest with six significant digits."""
    document = document_of(model.markerset)
    for key, likelihood in ((LIKELIHOOD, model.likelihood), (SECOND, model.second)):
        if likelihood is not None:
            document[key] = likelihood_document(likelihood)
    if model.partial_solvers is not None:
        document[PARTIAL_SOLVERS] = pack(model.partial_solvers)
    if model.training_takes:
        document[TRAINING_TAKES] = [pack(take) for take in model.training_takes]
    # Behind all else: who trained a model, and when, changes nothing before it.
    if model.history.versions or model.history.kept_takes:
        document[HISTORY] = to_json(model.history)
    write_json(path, document)


def _sound_partial_solvers(solvers: PartialSolvers) -> bool:
    """Whether every index has its place and every number is one, so that points can be named by it."""
    own, count, free = solvers.classifiers, len(solvers.markers), (-np.inf, np.inf)
    kinds = len(own.kind) if own.kind.ndim else -1
    arrays: list[tuple[np.ndarray, str, tuple[int, ...], float, float]] = [
        (own.kind, INDICES, (kinds,), 0, len(FUNCTIONS) - 1),
        (own.points, INDICES, (kinds, max(DOMAIN)), NO_POINT, count - 1),
        *((bound, PLAIN_NUMBERS, (kinds,), *free) for bound in (own.low, own.high)),
        (solvers.targets, PLAIN_NUMBERS, (count,), 0, 1),
    ]
    for one in solvers.solvers:
        size, chosen, record = one.markers.size or -1, one.strong.chosen, one.record
        arrays += [
            (one.markers, INDICES, (size,), 0, count - 1),
            (chosen, INDICES, (chosen.size,), 0, kinds - 1),
            (one.strong.weights, PLAIN_NUMBERS, (chosen.size,), 0, np.inf),
            (one.reached, "b", (size,), False, True),
            *((column, PLAIN_NUMBERS, (size,), 0, 2**53) for column in (record.hits, record.failures, record.answers)),
        ]
    return (
        all(_is_sound(*row) for row in arrays)
        and _sound_points(own)
        and all(_sound_solver(one, own) for one in solvers.solvers)
    )


def _is_sound(values: np.ndarray, kinds: str, shape: tuple[int, ...], low: float, high: float) -> bool:
    """Whether an array is of one of these kinds and of this shape, and all of it between two bounds."""
    return values.dtype.kind in kinds and values.shape == shape and bool(((values >= low) & (values <= high)).all())


def _sound_points(classifiers: Classifiers) -> bool:
    """Whether each classifier has as many points as its function takes, none of them twice."""
    points = classifiers.points
    inside = np.arange(max(DOMAIN)) < np.array(DOMAIN)[classifiers.kind][:, None]
    twice = (points[:, :, None] == points[:, None]) & inside[:, :, None] & inside[:, None] & ~np.eye(4, dtype=bool)
    return bool(((points != NO_POINT) == inside).all() and not twice.any())


def _sound_solver(solver: Solver, classifiers: Classifiers) -> bool:
    """Whether a solver's markers ascend, its classifiers are of these, and it was tried as often as it answered."""
    own, record = solver.markers, solver.record
    within = (np.diff(own.astype(int)) > 0).all() and classifiers[solver.strong.chosen].within(own).all()
    return bool(within and (record.hits + record.failures <= record.answers).all())
