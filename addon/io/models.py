# SPDX-License-Identifier: GPL-3.0-or-later
"""Models, `*.markerset.json`: a marker set as readable text, then what its markers are named by, and training takes."""

import json
from pathlib import Path

from ..core.data.errors import InputError
from ..core.data.models import Model, TrainingTake
from ..core.points.partial_solvers.model import PartialSolvers
from .likelihood import likelihood_text, read_likelihood
from .markersets import builtin_markersets, markerset_in, markerset_text, open_document, open_markerset
from .packed import pack, unpack

# What the parts are called in the file, as they were from the first version on.
LIKELIHOOD, PARTIAL_SOLVERS, TRAINING_TAKES = "evidence", "ensemble", "lessons"


def open_model(name: str | Path) -> Model:
    """A built-in model by name, or any by the path of its file; InputError where it is neither."""
    path = builtin_markersets().get(str(name), Path(name))
    if not path.exists():
        open_markerset(name)  # says what is wrong
    return read_model(path)


def read_model(path: Path) -> Model:
    """A model, checked in every part. Raises InputError that names the part."""
    reader, top = open_document(path)
    markerset = markerset_in(reader, top)
    likelihood = read_likelihood(reader, top[LIKELIHOOD], markerset.markers) if LIKELIHOOD in top else None
    solvers = unpack(PartialSolvers, top[PARTIAL_SOLVERS], PARTIAL_SOLVERS, path) if PARTIAL_SOLVERS in top else None
    if solvers is not None and solvers.markers != markerset.markers:
        raise InputError("has an ensemble for other markers than its own; expected it as it was trained", path)
    rows = top.get(TRAINING_TAKES, [])
    if not isinstance(rows, list):
        raise InputError(f"has damaged {TRAINING_TAKES}; expected a list", path)
    takes = tuple(unpack(TrainingTake, row, TRAINING_TAKES, path) for row in rows)
    return Model(markerset, likelihood, solvers, takes)


def write_model(path: Path, model: Model):
    """Writes a model; partial solvers and training takes come back exactly, the rest with six significant digits."""
    rows = [markerset_text(model.markerset).rstrip().removesuffix("}").rstrip()]
    if model.likelihood is not None:
        rows.append(f"  {json.dumps(LIKELIHOOD)}: {likelihood_text(model.likelihood)}")
    if model.partial_solvers is not None:
        rows.append(f"  {json.dumps(PARTIAL_SOLVERS)}: {json.dumps(pack(model.partial_solvers))}")
    if model.training_takes:
        takes = ",\n".join(f"    {json.dumps(pack(take), ensure_ascii=False)}" for take in model.training_takes)
        rows.append(f"  {json.dumps(TRAINING_TAKES)}: [\n{takes}\n  ]")
    Path(path).write_text(",\n".join(rows) + "\n}\n", encoding="utf-8", newline="\n")
