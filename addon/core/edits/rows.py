# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits as plain rows of words and numbers and back, the same for a file and for what a Blender file keeps."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any, TypeGuard

from ..data.errors import InputError
from ..data.takes import MAX_FRAME
from ..data.wording import words_of_frames
from .kinds import EDIT_KINDS, BlobEdit, Edit, Edits, Place

EDITS_VERSION = 1


MAX_EDITS = 100_000  # memory: some 100 MB of them; a person makes hundreds
MAX_PLACE_M = 10_000.0  # physical: m from the origin that a marker may be placed: beyond any room
MAX_PX = 1e7  # physical: px that a blob may be looked for at: a thousand times the width of a camera's image
MAX_POINT = 2**31 - 1  # format: indices of trajectories are whole numbers of 32 bits


def _keys_of(kind: type[Edit]) -> tuple[str, ...]:
    """The keys that a row of this kind must have, `frames` and what a program adds aside."""
    return tuple(one.name for one in fields(kind) if not one.kw_only)


# Of every verb the shapes that it may have: edits and the keys that their rows must have; the first that fits is meant.
FORMS: dict[str, list[tuple[type[Edit], tuple[str, ...]]]] = {
    verb: [(kind, _keys_of(kind)) for kind in EDIT_KINDS if kind.verb.kind == verb]
    for verb in dict.fromkeys(kind.verb.kind for kind in EDIT_KINDS)
}


def edits_of(document: object) -> Edits:
    """The edits of a parsed file, `{"version": 1, "edits": [...]}`.

    Raises InputError with the number of the edit, from 1, where it is not to the letter of the contract.
    """
    if not isinstance(document, dict):
        raise InputError('is no object; expected edits as {"version": 1, "edits": [...]}')
    version: Any = document.get("version")
    rows = document.get("edits")
    if not _is_whole(version) or version < 1:
        raise InputError(f'has the version {_shown(version)}; expected edits with "version": {EDITS_VERSION}')
    if version > EDITS_VERSION:
        raise InputError(f"is of version {_shown(version)}; expected edits of version {EDITS_VERSION}")
    if not isinstance(rows, list):
        raise InputError('has no list "edits"; expected {"version": 1, "edits": [...]}')
    if len(rows) > MAX_EDITS:
        raise InputError(f"has {len(rows)} edits; expected at most {MAX_EDITS}")
    more = {key: value for key, value in document.items() if key not in ("version", "edits")}
    if not _can_be_kept(more):
        raise InputError("holds beside its edits what JSON cannot hold; expected finite numbers and letters of Unicode")
    return Edits(tuple(edit_of(row, number) for number, row in enumerate(rows, 1)), more)


def document_of(edits: Edits) -> dict:
    """The edits as a file has them."""
    return {"version": EDITS_VERSION, **edits.more, "edits": [row_of(edit) for edit in edits]}


def row_of(edit: Edit) -> dict:
    """An edit as a file has it; `frames` only where it has some."""
    own = {key: getattr(edit, key) for key in _keys_of(type(edit))}
    row = {"kind": edit.verb.kind, **{key: list(v) if isinstance(v, tuple) else v for key, v in own.items()}}
    return row | ({} if edit.frames is None else {"frames": list(edit.frames)}) | dict(edit.more)


def edit_of(row: object, number: int) -> Edit:
    """The edit of a row; InputError that calls it by its number where it is none."""
    if not isinstance(row, dict):
        raise InputError(f'edit {number} is no object; expected one such as {{"kind": "right", "marker": "LKNE"}}')
    kind = row.get("kind")
    forms = FORMS.get(kind) if isinstance(kind, str) else None
    if forms is None:
        raise InputError(f"edit {number} is of the kind {_shown(kind)}; expected one of {', '.join(FORMS)}")
    whole, keys = _form(row, forms, number)
    ranged = whole is not Place
    foreign = sorted((ALL_KEYS - {"kind", *keys, *(("frames",) if ranged else ())}) & set(row))
    if foreign:
        words = f"edit {number} has {foreign[0]!r} beside {' '.join(keys)}"
        raise InputError(f"{words}; expected {_shape(whole, keys)}")
    values = {key: _value(key, row[key], number) for key in keys}
    if ranged and row.get("frames") is not None:
        values["frames"] = _frames(row["frames"], number)
        first, last = values["frames"]
        if issubclass(whole, BlobEdit) and not first <= values["frame"] <= last:
            words = f"edit {number} is of a blob of frame {values['frame']}, in {words_of_frames(first, last)}"
            raise InputError(f"{words}; expected frames with its own among them")
    more = {key: value for key, value in row.items() if key not in ALL_KEYS}
    if not _can_be_kept(more):
        raise InputError(f"edit {number} holds what JSON cannot hold; expected finite numbers and letters of Unicode")
    return whole(**values, more=more)


def _form(row: dict, forms: Sequence[tuple[type[Edit], tuple[str, ...]]], number: int) -> tuple[type[Edit], tuple]:
    """The shape whose keys the row has all of."""
    for form in forms:
        if set(form[1]) <= set(row):
            return form
    lacking = min(([key for key in keys if key not in row] for _, keys in forms), key=len)
    wanted = " or ".join(_shape(*form) for form in forms)
    raise InputError(f"edit {number} lacks {' and '.join(lacking)}; expected {wanted}")


def _shape(whole: type[Edit], keys: Sequence[str]) -> str:
    """A kind of edit in the keys of its rows."""
    return f"{whole.verb.kind} with {' '.join(keys)}" + ("" if whole is Place else " and, if wanted, frames")


def _frames(value: Any, number: int) -> tuple[int, int]:
    first, last = (_value("frame", one, number) for one in _value("frames", value, number))
    if first > last:
        raise InputError(f"edit {number} has the frames {first} to {last}; expected the first before the last")
    return first, last


def _value(key: str, value: Any, number: int) -> Any:
    """What a row has for a key, as an edit has it; InputError that shows it where it is none."""
    fine, has, expected = CHECKS[key]
    if not fine(value):
        raise InputError(f"edit {number} {has} {_shown(value)}; expected {expected}")
    if key == "markers":
        one, other = (_value("marker", name, number) for name in value)
        if one == other:
            raise InputError(f"edit {number} swaps {one!r} with itself; expected two names")
        return one, other
    if key == "xyz":
        return tuple(map(float, value))
    return float(value) if key in ("x", "y") else value


def _is_whole(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_number(value: object) -> TypeGuard[float]:
    return (_is_whole(value) and abs(value) < 2**53) or (isinstance(value, float) and math.isfinite(value))


def _can_be_kept(value: object) -> bool:
    """Whether what a file says beside its edits can be written again."""
    try:
        json.dumps(value, ensure_ascii=False, allow_nan=False).encode("utf-8")
    except (TypeError, ValueError, RecursionError):
        return False
    return True


def _shown(value: object) -> str:
    """A value in a sentence: short, on one line, with nothing that a terminal stumbles over."""
    if value is None or isinstance(value, dict):
        return "none" if value is None else "an object"
    if isinstance(value, list):
        some = ["a list" if isinstance(one, list) else _shown(one) for one in value[:4]]
        return f"[{', '.join(some)}{', …' if len(value) > len(some) else ''}]"
    return "of too many digits" if _is_whole(value) and abs(value) >= 2**63 else ascii(value)[:40]


def _is_pixel(value: object) -> bool:
    return _is_number(value) and abs(value) <= MAX_PX


def _is_place(value: object) -> bool:
    return _is_list(value, 3) and all(_is_number(one) and abs(one) <= MAX_PLACE_M for one in value)


def _is_list(value: object, length: int) -> TypeGuard[list]:
    return isinstance(value, list) and len(value) == length


def _is_name(value: object) -> bool:
    return isinstance(value, str) and bool(value.strip()) and _can_be_kept(value)


# Of each key whether a value is one for it, and the words for an edit that has another.
CHECKS: dict[str, tuple[Callable[[Any], bool], str, str]] = {
    "point": (
        lambda value: _is_whole(value) and 0 <= value <= MAX_POINT,
        "has the point",
        f"the number of a trajectory, from 0 to {MAX_POINT:,}",
    ),
    "frame": (
        lambda value: _is_whole(value) and abs(value) <= MAX_FRAME,
        "has the frame",
        f"a whole number as in the source, up to {MAX_FRAME:,}",
    ),
    "frames": (lambda value: _is_list(value, 2), "has the frames", "the first and the last, such as [1, 9]"),
    "markers": (lambda value: _is_list(value, 2), "has the markers", "two names"),
    "xyz": (_is_place, "has the place", f"x, y and z in m, finite and up to {MAX_PLACE_M:,.0f} either way"),
    **dict.fromkeys(("x", "y"), (_is_pixel, "looks for a blob at", f"x and y in px, up to {MAX_PX:,.0f}")),
    **{what: (_is_name, f"has the {what}", "its name") for what in ("marker", "camera", "doubt")},
}
ALL_KEYS = {"kind", *CHECKS}
