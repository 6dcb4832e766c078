# SPDX-License-Identifier: GPL-3.0-or-later
"""Models, `*.markerset.json`: a marker set as readable text, then what its markers are named by, and training takes."""

import json
from pathlib import Path

from ..core.data.errors import InputError
from ..core.points.models import Model, TrainingTake
from ..core.points.partial_solvers.model import PartialSolvers
from .likelihood import likelihood_text, read_likelihood
from .markersets import markerset_file, markerset_in, markerset_text, open_document, open_markerset
from .packed import LARGEST_PACKED, declared_bytes, pack, unpack
from .trained import sound_partial_solvers, sound_training_take

# What the parts are called in the file. The training takes had another name at first, and are read by it too.
LIKELIHOOD, PARTIAL_SOLVERS, TRAINING_TAKES = "evidence", "ensemble", "training_takes"
FORMER_TRAINING_TAKES = "lessons"


def open_model(name: str | Path) -> Model:
    """A built-in model by name, or any by the path of its file; InputError where it is neither."""
    path = markerset_file(name)
    if not path.exists():
        open_markerset(name)  # says what is wrong
    return read_model(path)


def read_model(path: Path) -> Model:
    """A model, checked in every part. Raises InputError that names the part."""
    reader, top = open_document(path)
    markerset = markerset_in(reader, top)
    likelihood = read_likelihood(reader, top[LIKELIHOOD], markerset.markers) if LIKELIHOOD in top else None
    solvers = None
    if PARTIAL_SOLVERS in top:
        solvers = _partial_solvers(top[PARTIAL_SOLVERS], markerset.markers, path)
    return Model(markerset, likelihood, solvers, _training_takes(top, len(markerset), path))


def _partial_solvers(packed: object, markers: tuple[str, ...], path: Path) -> PartialSolvers:
    """The partial solvers of these markers, checked in every part."""
    solvers = unpack(PartialSolvers, packed, PARTIAL_SOLVERS, path)
    if solvers.markers != markers:
        raise InputError("has an ensemble for other markers than its own; expected it as it was trained", path)
    if not sound_partial_solvers(solvers):
        words = f"has an {PARTIAL_SOLVERS} whose numbers do not go together"
        raise InputError(f"{words}; expected it as it was trained, so train the model anew", path)
    return solvers


def _training_takes(top: dict, markers: int, path: Path) -> tuple[TrainingTake, ...]:
    """What the model keeps of its training, checked in every part."""
    rows = top.get(TRAINING_TAKES, top.get(FORMER_TRAINING_TAKES, []))
    if not isinstance(rows, list):
        raise InputError("has damaged training takes; expected a list", path)
    if declared_bytes(rows) > LARGEST_PACKED:
        raise InputError(f"has over {LARGEST_PACKED >> 20} MB of training takes; expected what was trained", path)
    takes = tuple(unpack(TrainingTake, row, TRAINING_TAKES, path) for row in rows)
    if not all(sound_training_take(take, markers) for take in takes):
        words = "has training takes that are not about its markers in metres"
        raise InputError(f"{words}; expected them as they were trained", path)
    return takes


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
