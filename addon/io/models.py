# SPDX-License-Identifier: GPL-3.0-or-later
"""Models, `*.markerset.json`: a marker set as readable text, and after it its ensemble and what it was trained on."""

import json
from pathlib import Path

from ..core.ensemble.model import Ensemble
from ..core.errors import InputError
from ..core.models import Lessons, Model
from .markersets import markerset_file, markerset_text, open_markerset, read_markerset
from .packed import pack, unpack
from .source import read_text

ENSEMBLE, LESSONS = "ensemble", "lessons"


def open_model(name: str | Path) -> Model:
    """A built-in model by name, or any by the path of its file; InputError where it is neither."""
    path = markerset_file(name)
    if not path.exists():
        open_markerset(name)  # says what is wrong
    return read_model(path)


def read_model(path: Path) -> Model:
    """A model, checked in every part. Raises InputError that names the part."""
    markerset = read_markerset(path)
    top = json.loads(read_text(path, "a model"))
    ensemble = unpack(Ensemble, top[ENSEMBLE], ENSEMBLE, path) if ENSEMBLE in top else None
    if ensemble is not None and ensemble.markers != markerset.markers:
        raise InputError("has an ensemble for other markers than its own; expected it as it was trained", path)
    rows = top.get(LESSONS, [])
    if not isinstance(rows, list):
        raise InputError(f"has damaged {LESSONS}; expected a list", path)
    return Model(markerset, ensemble, tuple(unpack(Lessons, row, LESSONS, path) for row in rows))


def write_model(path: Path, model: Model):
    """Writes a model; ensemble and lessons come back exactly, the rest with six significant digits."""
    rows = [markerset_text(model.markerset).rstrip().removesuffix("}").rstrip()]
    if model.ensemble is not None:
        rows.append(f"  {json.dumps(ENSEMBLE)}: {json.dumps(pack(model.ensemble))}")
    if model.lessons:
        lessons = ",\n".join(f"    {json.dumps(pack(lesson), ensure_ascii=False)}" for lesson in model.lessons)
        rows.append(f"  {json.dumps(LESSONS)}: [\n{lessons}\n  ]")
    Path(path).write_text(",\n".join(rows) + "\n}\n", encoding="utf-8", newline="\n")
