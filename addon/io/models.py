# SPDX-License-Identifier: GPL-3.0-or-later
"""Models, `*.markerset.json`: a marker set as readable text, and after it its ensemble and what it was trained on."""

import json
from pathlib import Path

from ..core.ensemble.model import Ensemble
from ..core.errors import InputError
from ..core.models import Lessons, Model
from .jsontext import read_json
from .markersets import markerset_file, markerset_text, open_markerset, parse_markerset
from .packed import LARGEST, declared_bytes, pack, unpack
from .trained import sound_ensemble, sound_lessons

ENSEMBLE, LESSONS = "ensemble", "lessons"


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
    ensemble = _ensemble(top[ENSEMBLE], markerset.markers, path) if ENSEMBLE in top else None
    rows = top.get(LESSONS, [])
    if not isinstance(rows, list):
        raise InputError(f"has damaged {LESSONS}; expected a list", path)
    if declared_bytes(rows) > LARGEST:
        raise InputError(f"has over {LARGEST >> 20} MB of {LESSONS}; expected what was trained", path)
    lessons = tuple(unpack(Lessons, row, LESSONS, path) for row in rows)
    if not all(sound_lessons(lesson, len(markerset)) for lesson in lessons):
        raise InputError(
            f"has {LESSONS} that are not about its markers in metres; expected them as they were trained", path
        )
    return Model(markerset, ensemble, lessons)


def _ensemble(packed: object, markers: tuple[str, ...], path: Path) -> Ensemble:
    """The ensemble of these markers, checked in every part."""
    ensemble = unpack(Ensemble, packed, ENSEMBLE, path)
    if ensemble.markers != markers:
        raise InputError("has an ensemble for other markers than its own; expected it as it was trained", path)
    if not sound_ensemble(ensemble):
        raise InputError(
            f"has an {ENSEMBLE} whose numbers do not go together; expected it as it was trained, so train the model "
            "anew",
            path,
        )
    return ensemble


def write_model(path: Path, model: Model):
    """Writes a model; ensemble and lessons come back exactly, the rest with six significant digits."""
    rows = [markerset_text(model.markerset).rstrip().removesuffix("}").rstrip()]
    if model.ensemble is not None:
        rows.append(f"  {json.dumps(ENSEMBLE)}: {json.dumps(pack(model.ensemble))}")
    if model.lessons:
        lessons = ",\n".join(f"    {json.dumps(pack(lesson), ensure_ascii=False)}" for lesson in model.lessons)
        rows.append(f"  {json.dumps(LESSONS)}: [\n{lessons}\n  ]")
    Path(path).write_text(",\n".join(rows) + "\n}\n", encoding="utf-8", newline="\n")
