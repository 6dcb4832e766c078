# SPDX-License-Identifier: GPL-3.0-or-later
"""Models, `*.markerset.json`: a marker set as readable text, and after it its ensemble and what it was trained on."""

import json
from pathlib import Path

from ..core.data.errors import InputError
from ..core.data.models import Model, TrainingTake
from ..core.points.partial_solvers.model import PartialSolvers
from .markersets import builtin_markersets, markerset_text, open_markerset, read_markerset
from .packed import pack, unpack
from .source import read_text

ENSEMBLE, TRAINING_TAKES = "ensemble", "lessons"


def open_model(name: str | Path) -> Model:
    """A built-in model by name, or any by the path of its file; InputError where it is neither."""
    path = builtin_markersets().get(str(name), Path(name))
    if not path.exists():
        open_markerset(name)  # says what is wrong
    return read_model(path)


def read_model(path: Path) -> Model:
    """A model, checked in every part. Raises InputError that names the part."""
    markerset = read_markerset(path)
    top = json.loads(read_text(path, "a model"))
    partial_solvers = unpack(PartialSolvers, top[ENSEMBLE], ENSEMBLE, path) if ENSEMBLE in top else None
    if partial_solvers is not None and partial_solvers.markers != markerset.markers:
        raise InputError("has an ensemble for other markers than its own; expected it as it was trained", path)
    rows = top.get(TRAINING_TAKES, [])
    if not isinstance(rows, list):
        raise InputError(f"has damaged {TRAINING_TAKES}; expected a list", path)
    return Model(markerset, partial_solvers, tuple(unpack(TrainingTake, row, TRAINING_TAKES, path) for row in rows))


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
