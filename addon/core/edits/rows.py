# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits as plain rows of words and numbers and back, the same for a file and for what a Blender file keeps."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields

from ..data.errors import InputError
from ..data.takes import MAX_FRAME
from .kinds import (
    EDIT_KINDS,
    Accepted,
    AssignBlob,
    AssignPoint,
    BlobEdit,
    Delete,
    DeleteBlob,
    Edit,
    Edits,
    Place,
    Right,
    Swap,
    UnlabelBlob,
    UnlabelMarker,
    UnlabelPoint,
    kind_of,
)

EDITS_VERSION = 1


@dataclass(frozen=True)
class EditLimits:
    """What an edit may say; reckoned, so that nothing a person means is beyond it.

    max_edits  a person makes hundreds
    max_m      from the origin that a marker may be placed: beyond any room
    max_px     that a blob may be looked for at: beyond any camera
    max_point  that a trajectory may be counted as
    max_shown  values of a list that a sentence has
    """

    max_edits: int = 100_000
    max_m: float = 10_000.0
    max_px: float = 1e7
    max_point: int = 2**31 - 1
    max_shown: int = 4


EDIT_LIMITS = EditLimits()

BLOB_PLACE = ("camera", "frame", "x", "y")
# Of every kind the shapes that it may have: the keys that its rows must have, and the edit that they make.
FORMS: dict[str, tuple[tuple[type[Edit], tuple[str, ...]], ...]] = {
    "assign": ((AssignPoint, ("point", "marker")), (AssignBlob, (*BLOB_PLACE, "marker"))),
    "unlabel": ((UnlabelMarker, ("marker",)), (UnlabelPoint, ("point",)), (UnlabelBlob, BLOB_PLACE)),
    "swap": ((Swap, ("markers",)),),
    "delete": ((Delete, ("point",)), (DeleteBlob, BLOB_PLACE)),
    "place": ((Place, ("marker", "frame", "xyz")),),
    "right": ((Right, ("marker",)), (Accepted, ("doubt",))),
}
NO_FRAMES = (Place,)  # whose frame is one of their keys


def edits_of(document: object) -> Edits:
    """The edits of a parsed file, `{"version": 1, "edits": [...]}`.

    Raises InputError with the number of the edit, from 1, where it is not to the letter of the contract.
    """
    if not isinstance(document, dict):
        raise InputError('is no object; expected edits as {"version": 1, "edits": [...]}')
    version, rows = document.get("version"), document.get("edits")
    if not _is_whole(version) or version < 1:
        raise InputError(f'has the version {_shown(version)}; expected edits with "version": {EDITS_VERSION}')
    if version > EDITS_VERSION:
        raise InputError(f"is of version {_shown(version)}; expected edits of version {EDITS_VERSION}")
    if not isinstance(rows, list):
        raise InputError('has no list "edits"; expected {"version": 1, "edits": [...]}')
    if len(rows) > EDIT_LIMITS.max_edits:
        raise InputError(f"has {len(rows)} edits; expected at most {EDIT_LIMITS.max_edits}")
    more = {key: value for key, value in document.items() if key not in ("version", "edits")}
    if not _can_be_kept(more):
        raise InputError("holds beside its edits what JSON cannot hold; expected finite numbers and letters of Unicode")
    return Edits(tuple(edit_of(row, number) for number, row in enumerate(rows, 1)), more)


def document_of(edits: Edits) -> dict:
    """The edits as a file has them."""
    return {"version": EDITS_VERSION, **edits.more, "edits": [row_of(edit) for edit in edits]}


def row_of(edit: Edit) -> dict:
    """An edit as a file has it; `frames` only where it has some."""
    own = {one.name: getattr(edit, one.name) for one in fields(edit)}
    more = own.pop("more")
    frames = own.pop("frames", None)
    own.pop("trail", None)
    row = {"kind": kind_of(edit), **{key: list(v) if isinstance(v, tuple) else v for key, v in own.items()}}
    return row | ({} if frames is None else {"frames": list(frames)}) | dict(more)


def edit_of(row: object, number: int) -> Edit:
    """The edit of a row; InputError that calls it by its number where it is none."""
    if not isinstance(row, dict):
        raise InputError(f'edit {number} is no object; expected one such as {{"kind": "right", "marker": "LKNE"}}')
    kind = row.get("kind")
    forms = FORMS.get(kind) if isinstance(kind, str) else None
    if forms is None:
        raise InputError(f"edit {number} is of the kind {_shown(kind)}; expected one of {', '.join(FORMS)}")
    whole, keys = _form(row, forms, number)
    ranged = whole not in NO_FRAMES
    foreign = sorted((ALL_KEYS - {"kind", *keys, *(("frames",) if ranged else ())}) & set(row))
    if foreign:
        words = f"edit {number} has {foreign[0]!r} beside {' '.join(keys)}"
        raise InputError(f"{words}; expected {_shape(whole, keys)}")
    values = {key: CHECKS[key](row[key], number) for key in keys}
    if ranged and row.get("frames") is not None:
        values["frames"] = _frames(row["frames"], number)
        if issubclass(whole, BlobEdit):
            _refuse_elsewhere(values["frame"], values["frames"], number)
    more = {key: value for key, value in row.items() if key not in ALL_KEYS}
    if not _can_be_kept(more):
        raise InputError(f"edit {number} holds what JSON cannot hold; expected finite numbers and letters of Unicode")
    return whole(**values, more=more)


def _refuse_elsewhere(frame: int, frames: tuple[int, int], number: int):
    """Raises InputError where a blob's own frame is not among those that its track is followed through."""
    if not frames[0] <= frame <= frames[1]:
        words = f"edit {number} is of a blob of frame {frame}, in frames {frames[0]} to {frames[1]}"
        raise InputError(f"{words}; expected frames with its own among them")


def _form(row: dict, forms: Sequence[tuple[type[Edit], tuple[str, ...]]], number: int) -> tuple[type[Edit], tuple]:
    """The shape whose keys the row has all of."""
    fitting = [form for form in forms if set(form[1]) <= set(row)]
    if not fitting:
        wanted = " or ".join(_shape(*form) for form in forms)
        raise InputError(f"edit {number} lacks {_lacks(row, forms)}; expected {wanted}")
    return fitting[0]


def _lacks(row: dict, forms: Sequence[tuple[type[Edit], tuple[str, ...]]]) -> str:
    """The keys that the row lacks of the shape that it is nearest to."""
    missing = [[key for key in keys if key not in row] for _, keys in forms]
    return " and ".join(min(missing, key=len))


def _shape(whole: type[Edit], keys: Sequence[str]) -> str:
    """A kind of edit in the keys of its rows."""
    return f"{EDIT_KINDS[whole]} with {' '.join(keys)}" + ("" if whole in NO_FRAMES else " and, if wanted, frames")


def _point(value: object, number: int) -> int:
    if not _is_whole(value) or not 0 <= value <= EDIT_LIMITS.max_point:
        words = f"edit {number} has the point {_shown(value)}"
        raise InputError(f"{words}; expected the number of a trajectory, from 0 to {EDIT_LIMITS.max_point:,}")
    return value


def _frame(value: object, number: int) -> int:
    if not _is_whole(value) or abs(value) > MAX_FRAME:
        words = f"edit {number} has the frame {_shown(value)}"
        raise InputError(f"{words}; expected a whole number as in the source, up to {MAX_FRAME:,}")
    return value


def _frames(value: object, number: int) -> tuple[int, int]:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(
            f"edit {number} has the frames {_shown(value)}; expected the first and the last, such as [1, 9]"
        )
    first, last = (_frame(one, number) for one in value)
    if first > last:
        raise InputError(f"edit {number} has the frames {first} to {last}; expected the first before the last")
    return first, last


def _name(what: str) -> Callable[[object, int], str]:
    def name(value: object, number: int) -> str:
        if not isinstance(value, str) or not value.strip() or not _can_be_kept(value):
            raise InputError(f"edit {number} has the {what} {_shown(value)}; expected its name")
        return value

    return name


def _markers(value: object, number: int) -> tuple[str, str]:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"edit {number} has the markers {_shown(value)}; expected two names")
    one, other = (_name("marker")(name, number) for name in value)
    if one == other:
        raise InputError(f"edit {number} swaps {one!r} with itself; expected two names")
    return one, other


def _pixel(value: object, number: int) -> float:
    if not _is_number(value) or abs(value) > EDIT_LIMITS.max_px:
        limit = f"up to {EDIT_LIMITS.max_px:,.0f}"
        raise InputError(f"edit {number} looks for a blob at {_shown(value)}; expected x and y in px, {limit}")
    return float(value)


def _xyz(value: object, number: int) -> tuple[float, float, float]:
    fine = isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))
    if not fine or max(map(abs, value)) > EDIT_LIMITS.max_m:
        words = f"edit {number} has the place {_shown(value)}"
        raise InputError(f"{words}; expected x, y and z in m, finite and up to {EDIT_LIMITS.max_m:,.0f} either way")
    x, y, z = map(float, value)
    return x, y, z


CHECKS: Mapping[str, Callable] = {
    "point": _point,
    "marker": _name("marker"),
    "camera": _name("camera"),
    "doubt": _name("doubt"),
    "frame": _frame,
    "x": _pixel,
    "y": _pixel,
    "markers": _markers,
    "xyz": _xyz,
}
ALL_KEYS = {"kind", "frames", *CHECKS}


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_number(value: object) -> bool:
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
    if value is None:
        return "none"
    if isinstance(value, list | dict):
        return "an object" if isinstance(value, dict) else _shown_list(value)
    if _is_whole(value) and abs(value) >= 2**63:
        return "of too many digits"
    return ascii(value)[:40]


def _shown_list(values: list) -> str:
    """The same of a list, of which some are enough to find it by."""
    some = ["a list" if isinstance(value, list) else _shown(value) for value in values[: EDIT_LIMITS.max_shown]]
    return f"[{', '.join(some)}{', …' if len(values) > EDIT_LIMITS.max_shown else ''}]"
