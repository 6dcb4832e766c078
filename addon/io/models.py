# SPDX-License-Identifier: GPL-3.0-or-later
"""Models, `*.markerset.json`: a marker set as readable text, and after it its ensemble and what it was trained on."""

import json
from pathlib import Path

from ..core.data.errors import InputError
from ..core.data.models import Model, TrainingTake
from ..core.points.partial_solvers.model import PartialSolvers
from .jsontext import read_json
from .markersets import markerset_file, markerset_text, open_markerset, parse_markerset
from .packed import LARGEST, declared_bytes, pack, unpack
from .trained import sound_ensemble, sound_lessons

ENSEMBLE, TRAINING_TAKES = "ensemble", "lessons"


def open_model(name: str | Path) -> Model:
    """A built-in model by name, or any by the path of its file; InputError where it is neither."""
    path = markerset_file(name)
    if not path.exists():
        open_markerset(name)  # says what is wrong
    return read_model(path)


def read_model(path: Path) -> Model:
    """A model, checked in every part. Raises InputError that names the part."""
    top = read_json(path, "a model")
    markerset = parse_markerset(top, path)
    partial_solvers = _partial_solvers(top[ENSEMBLE], markerset.markers, path) if ENSEMBLE in top else None
    rows = top.get(TRAINING_TAKES, [])
    if not isinstance(rows, list):
        raise InputError(f"has damaged {TRAINING_TAKES}; expected a list", path)
    if declared_bytes(rows) > LARGEST:
        raise InputError(f"has over {LARGEST >> 20} MB of {TRAINING_TAKES}; expected what was trained", path)
    training_takes = tuple(unpack(TrainingTake, row, TRAINING_TAKES, path) for row in rows)
    if not all(sound_lessons(training_take, len(markerset)) for training_take in training_takes):
        raise InputError(
            f"has {TRAINING_TAKES} that are not about its markers in metres; expected them as they were trained", path
        )
    return Model(markerset, partial_solvers, training_takes)


def _partial_solvers(packed: object, markers: tuple[str, ...], path: Path) -> PartialSolvers:
    """The ensemble of these markers, checked in every part."""
    partial_solvers = unpack(PartialSolvers, packed, ENSEMBLE, path)
    if partial_solvers.markers != markers:
        raise InputError("has an ensemble for other markers than its own; expected it as it was trained", path)
    if not sound_ensemble(partial_solvers):
        raise InputError(
            f"has an {ENSEMBLE} whose numbers do not go together; expected it as it was trained, so train the model "
            "anew",
            path,
        )
    return partial_solvers


def write_model(path: Path, model: Model):
    """Writes a model; ensemble and lessons come back exactly, the rest with six significant digits."""
    rows = [markerset_text(model.markerset).rstrip().removesuffix("}").rstrip()]
    if model.partial_solvers is not None:
        rows.append(f"  {json.dumps(ENSEMBLE)}: {json.dumps(pack(model.partial_solvers))}")
    if model.training_takes:
        training_takes = ",\n".join(
            f"    {json.dumps(pack(training_take), ensure_ascii=False)}" for training_take in model.training_takes
        )
        rows.append(f"  {json.dumps(TRAINING_TAKES)}: [\n{training_takes}\n  ]")
    Path(path).write_text(",\n".join(rows) + "\n}\n", encoding="utf-8", newline="\n")
