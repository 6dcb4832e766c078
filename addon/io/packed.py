# SPDX-License-Identifier: GPL-3.0-or-later
"""Learned numbers inside a text file: dataclasses of arrays as JSON, exact to the bit, and back as data alone."""

import base64
import binascii
import hashlib
import json
import types
import typing
import zlib
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError

KINDS = {f"{letter}{size}": f"<{letter}{size}" for letter in "iuf" for size in (1, 2, 4, 8)} | {"b1": "|b1"}
LARGEST = 1 << 28  # bytes of one array; no model comes near
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
    content = {key: value for key, value in packed.items() if key != DIGEST}
    try:
        if packed.get(DIGEST) != _digest(content):
            raise broken
        return _unpacked(kind, content)
    except (KeyError, TypeError, ValueError, binascii.Error, zlib.error):
        raise broken from None


def _digest(packed: dict) -> str:
    return hashlib.sha256(json.dumps(packed, sort_keys=True).encode()).hexdigest()[:16]


def _packed(value: object):
    if is_dataclass(value):
        return {field.name: _packed(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, np.ndarray):
        kind = value.dtype.kind + str(value.dtype.itemsize)
        content = zlib.compress(np.ascontiguousarray(value, KINDS[kind]).tobytes(), 9)
        data = base64.b64encode(content).decode("ascii")
        return {"kind": kind, "shape": list(value.shape), "data": data}
    if isinstance(value, tuple):
        return [_packed(part) for part in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"{type(value).__name__} cannot be packed")


def _unpacked(kind, packed):
    """`packed` as a value of the type that a dataclass' field is annotated with."""
    if is_dataclass(kind):
        hints = typing.get_type_hints(kind)
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
    unzipped = zlib.decompressobj()
    data = unzipped.decompress(base64.b64decode(packed["data"], validate=True), LARGEST)
    if unzipped.unconsumed_tail:
        raise ValueError
    return np.frombuffer(data, KINDS[packed["kind"]]).reshape(packed["shape"]).copy()
