# SPDX-License-Identifier: GPL-3.0-or-later
"""Dataclasses as JSON and back: arrays packed, exact to the bit, and all of it data alone."""

import base64
import hashlib
import json
import math
import types
import typing
import zlib
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from .text import can_be_written

# Fields that are called otherwise in files.
FILE_KEYS = {"name": "take", "origin": "from"}
ARRAY_KINDS = {f"{letter}{size}": f"<{letter}{size}" for letter in "iuf" for size in (1, 2, 4, 8)} | {"b1": "|b1"}
MAX_PACKED_BYTES = 1 << 28  # bytes of all arrays of a file; no model comes near
DIGEST = "digest"
# What `from_json` raises where something is not of the type that it should be.
NOT_PACKED = (AttributeError, KeyError, OverflowError, TypeError, ValueError, RecursionError, zlib.error)


def pack(value: object) -> dict:
    """A dataclass as a JSON object, with a digest that tells whether it came through unchanged."""
    packed = to_json(value)
    return {DIGEST: _digest(packed), **packed}


def unpack(kind: type, packed: object, what: str, path: Path):
    """The dataclass of type `kind` that `pack` made the object of; InputError naming `what` where it is not one."""
    broken = InputError(f"has damaged {what}; expected it as it was trained, so train the model anew", path)
    if not isinstance(packed, dict):
        raise broken
    # What is compressed can be a thousand times as large, so nothing is unpacked before it is known to have room.
    if declared_bytes(packed) > MAX_PACKED_BYTES:
        raise InputError(f"has over {MAX_PACKED_BYTES >> 20} MB of {what}; expected what was trained", path)
    content = {key: value for key, value in packed.items() if key != DIGEST}
    try:
        if packed.get(DIGEST) != _digest(content):
            raise broken
        return from_json(kind, content)
    except NOT_PACKED:
        raise broken from None


def declared_bytes(packed: object) -> int:
    """The bytes that the arrays in a packed object, or in a list of them, say that they have."""
    waiting, total = [packed], 0
    while waiting:
        value = waiting.pop()
        if isinstance(value, list):
            waiting += value
        elif isinstance(value, dict):
            waiting += value.values()
            total += _declared_size(value) if "data" in value else 0
    return total


def _declared_size(packed: dict) -> int:
    """The bytes that an array says that it has; none where it is no array, as unpacking it finds out."""
    shape, kind = packed.get("shape"), packed.get("kind")
    if (
        not isinstance(kind, str)
        or kind not in ARRAY_KINDS
        or not isinstance(shape, list)
        or not all(type(one) is int and one >= 0 for one in shape)
    ):
        return 0
    return math.prod(shape) * np.dtype(ARRAY_KINDS[kind]).itemsize


def _digest(packed: dict) -> str:
    return hashlib.sha256(json.dumps(packed, sort_keys=True).encode()).hexdigest()[:16]


def to_json(value: object):
    """A dataclass, or a part of one, as JSON has it; what is empty as by default is left out."""
    if is_dataclass(value):
        parts = [(field, getattr(value, field.name)) for field in fields(value)]
        return {FILE_KEYS.get(f.name, f.name): to_json(part) for f, part in parts if f.default is MISSING or part}
    if isinstance(value, np.ndarray):
        kind = value.dtype.kind + str(value.dtype.itemsize)
        content = zlib.compress(np.ascontiguousarray(value, ARRAY_KINDS[kind]).tobytes(), 9)
        data = base64.b64encode(content).decode("ascii")
        return {"kind": kind, "shape": list(value.shape), "data": data}
    if isinstance(value, tuple):
        return [to_json(part) for part in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"{type(value).__name__} cannot be packed")


_hints: Callable[[typing.Any], dict[str, typing.Any]] = cache(typing.get_type_hints)


def from_json(kind: typing.Any, packed: typing.Any) -> typing.Any:
    """What `to_json` made the JSON of, as the type that a dataclass' field is annotated with; raises NOT_PACKED.

    Texts have one line, and numbers are finite and not below zero.
    """
    if isinstance(kind, type) and is_dataclass(kind):
        given = {f.name: packed.get(FILE_KEYS.get(f.name, f.name)) for f in fields(kind)}
        there = [f.name for f in fields(kind) if f.default is MISSING or given[f.name] is not None]
        return kind(**{name: from_json(_hints(kind)[name], given[name]) for name in there})
    if kind is np.ndarray:
        return _array_of(packed)
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        if packed is None and type(None) in parts:
            return None
        (kind,) = (part for part in parts if part is not type(None))
        return from_json(kind, packed)
    if origin is tuple:
        each = parts[:1] * len(packed) if parts[-1] is Ellipsis else parts
        if not isinstance(packed, list):
            raise TypeError
        return tuple(from_json(part, one) for part, one in zip(each, packed, strict=True))
    number = kind in (int, float) and not isinstance(packed, bool) and isinstance(packed, int | kind)
    if number and math.isfinite(packed) and packed >= 0:
        return kind(packed)
    if kind in (bool, str) and isinstance(packed, kind) and (kind is bool or can_be_written(packed)):
        return packed
    raise TypeError


def _array_of(packed: dict) -> np.ndarray:
    kind, size = ARRAY_KINDS[packed["kind"]], _declared_size(packed)
    unzipped = zlib.decompressobj()
    data = unzipped.decompress(base64.b64decode(packed["data"], validate=True), size + 1)
    if len(data) != size:
        raise ValueError
    values = np.frombuffer(data, kind).reshape(packed["shape"]).copy()
    # Of a byte that is neither nought nor one, nobody knows what NumPy makes.
    return values.view("u1") > 0 if kind == ARRAY_KINDS["b1"] else values
