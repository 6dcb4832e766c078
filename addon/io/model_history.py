# SPDX-License-Identifier: GPL-3.0-or-later
"""A model's history in its file, behind all that the model is: so the same training makes the same file up to there.

The fingerprint is of what stands before it, whatever the signs between the values: who trained a model, and when, makes
it no other.
"""

import hashlib
import json
import math
import os
import posixpath
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from ..core.data.errors import InputError
from ..core.points.history import NO_HISTORY, CheckedTake, ModelHistory, ModelVersion, TaughtTake
from .markersets import SUFFIX
from .text import can_be_written

HISTORY = "history"
# ours.v2.markerset.json was version 2 of ours, ours.v3-candidate.markerset.json may become version 3.
_BESIDE = re.compile(r"(?P<name>.+)\.v\d+(?P<candidate>-candidate)?(-\d+)?")


def fingerprint_of(top: dict) -> str:
    """SHA-256 of a model's JSON without its history, in one order and without blanks."""
    content = {key: value for key, value in top.items() if key != HISTORY}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def read_history(top: dict, path: Path) -> ModelHistory:
    """The history of a model's JSON; InputError where it is none. What is not known in it is let be."""
    if HISTORY not in top:
        return NO_HISTORY
    try:
        history = top[HISTORY]
        versions = tuple(_version(row) for row in history["versions"])
        kept = tuple(_take(row) for row in history.get("kept_takes", []))
        if any(one.version <= before.version for before, one in pairwise(versions)):
            raise ValueError
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        words = "has a damaged history; expected it as it was trained, or the file without it"
        raise InputError(words, path) from None
    return ModelHistory(versions, kept)


def _version(row: dict) -> ModelVersion:
    version = row["version"]
    if type(version) is not int or version < 1:
        raise ValueError
    date, by, program, origin = (_text(row.get(key)) for key in ("date", "by", "program", "from"))
    takes, checked = tuple(map(_take, row.get("takes", []))), tuple(map(_checked, row.get("checked", [])))
    return ModelVersion(version, date, by, program, origin, takes, checked, row.get("told") is True)


def _take(row: dict) -> TaughtTake:
    frames = row.get("frames", 0)
    if type(frames) is not int or frames < 0:
        raise ValueError
    name, subject = _text(row["take"]), _text(row.get("subject"))
    sha256, path, up = (_text(row.get(key)) for key in ("sha256", "path", "up"))
    return TaughtTake(name, subject, frames, sha256, path, up, _number(row.get("rate") or 0.0))


def _checked(row: dict) -> CheckedTake:
    recall, wrong = (tuple(map(_number, row[key])) for key in ("recall", "wrong"))
    if len(recall) != 2 or len(wrong) != 2:
        raise ValueError
    return CheckedTake(_text(row["take"]), recall, wrong)


def _text(value: object) -> str:
    """A text of one line, empty where there is none."""
    if value is None:
        return ""
    if not isinstance(value, str) or not can_be_written(value):
        raise ValueError
    return value


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not (math.isfinite(value) and value >= 0):
        raise ValueError
    return float(value)


def document_of(history: ModelHistory) -> dict:
    """A history as JSON has it; what is not known is left out."""
    document: dict = {"versions": [_version_row(one) for one in history.versions]}
    if history.kept_takes:
        document["kept_takes"] = list(map(_take_row, history.kept_takes))
    return document


def _version_row(one: ModelVersion) -> dict:
    checked = [{"take": row.name, "recall": row.recall, "wrong": row.wrong} for row in one.checked]
    row = {"date": one.date, "by": one.by, "program": one.program, "from": one.origin, "told": one.told}
    row |= {"takes": list(map(_take_row, one.takes)), "checked": checked}
    return {"version": one.version} | {key: value for key, value in row.items() if value}


def _take_row(take: TaughtTake) -> dict:
    known = {"sha256": take.sha256, "path": take.path, "up": take.up, "rate": take.rate}
    row = {"take": take.name, "subject": take.subject, "frames": take.frames}
    return row | {key: value for key, value in known.items() if value}


def seen_from(model: Path, file: Path) -> str:
    """The path of a file as seen from a model's folder, so that the two can be moved together; empty where none is.

    Between two drives of Windows it is the whole path.
    """
    try:
        path = os.path.relpath(file.resolve(), model.resolve().parent)
    except ValueError:
        path = str(file.resolve())
    path = path.replace(os.sep, posixpath.sep)
    return path if can_be_written(path) else ""


def file_of(take: TaughtTake, model: Path) -> Path | None:
    """Where the file of a take is said to be; None where nobody knows.

    Also of another computer's: whoever opens somebody's model must not be led to ask one for a file.
    """
    if not take.path or take.path.replace("\\", "/").startswith("//"):
        return None
    return Path(os.path.normpath(model.resolve().parent / take.path))


def moved(history: ModelHistory, before: Path, after: Path) -> ModelHistory:
    """The history of a model that goes on in another file, with paths as they are seen from there."""
    if before.resolve().parent == after.resolve().parent:
        return history

    def seen(takes: tuple[TaughtTake, ...]) -> tuple[TaughtTake, ...]:
        files = (file_of(take, before) for take in takes)
        return tuple(
            replace(take, path=seen_from(after, file) if file else take.path)
            for take, file in zip(takes, files, strict=True)
        )

    versions = tuple(replace(one, takes=seen(one.takes)) for one in history.versions)
    return ModelHistory(versions, seen(history.kept_takes))


def beside(model: Path, what: str) -> Path:
    """A file beside a model's that nothing has the name of yet, for what is said of it: `v2` or `v3-candidate`."""
    stem, number = model.name.removesuffix(SUFFIX), 1
    path = model.with_name(f"{stem}.{what}{SUFFIX}")
    while path.exists() or path.is_symlink():
        number += 1
        path = model.with_name(f"{stem}.{what}-{number}{SUFFIX}")
    return path


def is_beside(path: Path) -> bool:
    """Whether a file is a former version or a candidate of a model beside it, by its name."""
    return _said_of(path) is not None


def model_of(candidate: Path) -> Path | None:
    """The file that a candidate may take the place of; None where it is none by its name."""
    said = _said_of(candidate)
    return candidate.with_name(said["name"] + SUFFIX) if said and said["candidate"] else None


def _said_of(path: Path) -> re.Match | None:
    return _BESIDE.fullmatch(path.name.removesuffix(SUFFIX)) if path.name.endswith(SUFFIX) else None
