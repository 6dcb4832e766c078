# SPDX-License-Identifier: GPL-3.0-or-later
"""A model's history in its file, behind all that the model is: so the same training makes the same file up to there.

The fingerprint is of what stands before it, whatever the signs between the values: who trained a model, and when, makes
it no other.
"""

import hashlib
import json
import os
import posixpath
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from ..core.data.errors import InputError
from ..core.points.models import NO_HISTORY, ModelHistory, TaughtTake
from .markersets import SUFFIX
from .packing import NOT_PACKED, from_json
from .text import can_be_written
from .whole import free_path

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
        history = from_json(ModelHistory, top[HISTORY])
        numbers = [0, *(each.version for each in history.versions)]
        if "versions" not in top[HISTORY] or any(one <= before for before, one in pairwise(numbers)):
            raise ValueError
    except NOT_PACKED:
        words = "has a damaged history; expected it as it was trained, or the file without it"
        raise InputError(words, path) from None
    return history


def own_models(folder: Path) -> list[Path]:
    """The models in a user's folder, but for other versions of them."""
    return sorted(path for path in folder.glob(f"*{SUFFIX}") if not is_beside(path))


def path_from(model: Path, file: Path) -> str:
    """The path of a file as seen from a model's folder, so that the two can be moved together.

    Between two drives of Windows it is the whole path.
    """
    try:
        path = os.path.relpath(file.resolve(), model.resolve().parent)
    except ValueError:
        path = str(file.resolve())
    return path.replace(os.sep, posixpath.sep)


def seen_from(model: Path, file: Path) -> str:
    """The same where a model can have it; else empty."""
    path = path_from(model, file)
    return path if can_be_written(path) else ""


def seen_at(path: str, model: Path) -> Path | None:
    """Where the file is that a model's folder sees there, as `path_from` says; None where nobody knows.

    Also of another computer's: whoever opens somebody's model must not be led to ask one for a file.
    """
    if not path or path.replace("\\", "/").startswith("//"):
        return None
    return Path(os.path.normpath(model.resolve().parent / path))


def moved(history: ModelHistory, before: Path, after: Path) -> ModelHistory:
    """The history of a model that goes on in another file, with paths as they are seen from there."""
    if before.resolve().parent == after.resolve().parent:
        return history

    def seen(takes: tuple[TaughtTake, ...]) -> tuple[TaughtTake, ...]:
        files = (seen_at(take.path, before) for take in takes)
        return tuple(
            replace(take, path=seen_from(after, file) if file else take.path)
            for take, file in zip(takes, files, strict=True)
        )

    versions = tuple(replace(one, takes=seen(one.takes)) for one in history.versions)
    return ModelHistory(versions, seen(history.kept_takes))


def beside(model: Path, what: str) -> Path:
    """A file beside a model's that nothing has the name of yet, for what is said of it: `v2` or `v3-candidate`."""
    return free_path(model.with_name(f"{model.name.removesuffix(SUFFIX)}.{what}"), SUFFIX)


def is_beside(path: Path) -> bool:
    """Whether a file is a former version or a candidate of a model beside it, by its name."""
    return _match_of(path) is not None


def model_of(candidate: Path) -> Path | None:
    """The file that a candidate may take the place of; None where it is none by its name."""
    match = _match_of(candidate)
    return candidate.with_name(match["name"] + SUFFIX) if match and match["candidate"] else None


def _match_of(path: Path) -> re.Match | None:
    return _BESIDE.fullmatch(path.name.removesuffix(SUFFIX)) if path.name.endswith(SUFFIX) else None
