# SPDX-License-Identifier: GPL-3.0-or-later
"""Learned numbers inside a text file: dataclasses of arrays as JSON, exact to the bit, and back as data alone."""

import base64
import binascii
import hashlib
import json
import math
import types
import typing
import zlib
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError

ARRAY_KINDS = {f"{letter}{size}": f"<{letter}{size}" for letter in "iuf" for size in (1, 2, 4, 8)} | {"b1": "|b1"}
MAX_PACKED_BYTES = 1 << 28  # bytes of all arrays of a file; no model comes near
DIGEST = "digest"


def pack(value: object) -> dict:
    """A dataclass as a JSON object, with a digest that tells whether it came through unchanged."""
    packed = _packed(value)
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
        return _unpacked(kind, content)
    except (KeyError, TypeError, ValueError, RecursionError, binascii.Error, zlib.error):
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
            total += _size(value) if "data" in value else 0
    return total


def _size(packed: dict) -> int:
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


def _packed(value: object):
    if is_dataclass(value):
        return {field.name: _packed(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, np.ndarray):
        kind = value.dtype.kind + str(value.dtype.itemsize)
        content = zlib.compress(np.ascontiguousarray(value, ARRAY_KINDS[kind]).tobytes(), 9)
        data = base64.b64encode(content).decode("ascii")
        return {"kind": kind, "shape": list(value.shape), "data": data}
    if isinstance(value, tuple):
        return [_packed(part) for part in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"{type(value).__name__} cannot be packed")


_hints = cache(typing.get_type_hints)


def _unpacked(kind, packed):
    """`packed` as a value of the type that a dataclass' field is annotated with."""
    if is_dataclass(kind):
        hints = _hints(kind)
        return kind(**{field.name: _unpacked(hints[field.name], packed[field.name]) for field in fields(kind)})
    if kind is np.ndarray:
        return _array(packed)
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        if packed is None and type(None) in parts:
            return None
        (kind,) = (part for part in parts if part is not type(None))
        return _unpacked(kind, packed)
    if origin is tuple:
        each = parts[:1] * len(packed) if parts[-1] is Ellipsis else parts
        return tuple(_unpacked(part, one) for part, one in zip(each, packed, strict=True))
    if kind is float and isinstance(packed, int):
        packed = float(packed)
    if not isinstance(packed, kind):
        raise TypeError
    return packed


def _array(packed: dict) -> np.ndarray:
    kind, size = ARRAY_KINDS[packed["kind"]], _size(packed)
    unzipped = zlib.decompressobj()
    data = unzipped.decompress(base64.b64decode(packed["data"], validate=True), size + 1)
    if len(data) != size:
        raise ValueError
    values = np.frombuffer(data, kind).reshape(packed["shape"]).copy()
    # Of a byte that is neither nought nor one, nobody knows what NumPy makes.
    return values.view("u1") > 0 if kind == ARRAY_KINDS["b1"] else values
