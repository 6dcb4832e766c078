# SPDX-License-Identifier: GPL-3.0-or-later
"""What one of our processes hands to another, as one file: work to be done, or what came of it; data alone, no code."""

import json
from collections.abc import Mapping
from dataclasses import fields
from functools import partial
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from ..core.data.errors import UserError
from ..core.data.made import Made
from ..io.scratch import naming_scratch
from ..io.source import open_binary

ADDON = __package__.removesuffix("cli")  # what it is called in this process, with its dot


def _name(of: Any) -> str:
    """What a class or function of ours is called in every process; TypeError for another."""
    if not of.__module__.startswith(ADDON) or of.__qualname__ != of.__name__:
        raise TypeError(f"{of.__module__}.{of.__qualname__} cannot be handed to another process")
    return f"{of.__module__.removeprefix(ADDON)}:{of.__name__}"


def _named(name: str) -> Any:
    module, _, own = name.partition(":")
    return getattr(import_module(ADDON + module), own)


# How things are taken apart and put together again, by the name that they have in the file.
KINDS: dict[str, tuple] = {
    "tuple": (tuple, list, lambda *parts: parts),
    "list": (list, list, lambda *parts: list(parts)),
    "dict": (
        Mapping,
        lambda value: [part for pair in value.items() for part in pair],
        lambda *parts: dict(zip(parts[::2], parts[1::2], strict=True)),
    ),
    "path": (Path, lambda value: [str(value)], Path),
    "work": (
        partial,
        lambda value: [value.func, value.args, value.keywords],
        lambda function, given, named: partial(function, *given, **named),
    ),
    "function": (FunctionType, lambda value: [_name(value)], _named),
    "trouble": (
        UserError,
        lambda value: [_name(type(value)), value.message, value.file, value.line],
        lambda name, *given: _named(name)(*given),
    ),
    "data": (
        object,
        lambda value: [_name(type(value)), {one.name: getattr(value, one.name) for one in fields(value) if one.init}],
        lambda name, parts: _named(name)(**parts),
    ),
}


def write_parcel(path: Path, value: Any):
    """Writes plain values, arrays, dataclasses and functions of ours, and trouble; TypeError for anything else.

    What is the same thing twice is so afterwards.
    """
    arrays, held, places = [], [], {}

    def plain(value: Any) -> Any:
        if value is None or isinstance(value, bool | int | float | str):
            return value
        if isinstance(value, np.generic):
            return value.item()
        if id(value) in places:
            return ["held", places[id(value)]]
        if isinstance(value, np.ndarray | Made):
            arrays.append(np.asarray(value))
            kind, parts = "array", [len(arrays) - 1]
        else:
            kind, apart = next((kind, apart) for kind, (of, apart, _) in KINDS.items() if isinstance(value, of))
            parts = list(map(plain, apart(value)))
        if kind not in ("array", "data"):
            return [kind, *parts]
        held.append([kind, *parts])
        places[id(value)] = len(held) - 1  # it is held, so nothing else has its number meanwhile
        return ["held", places[id(value)]]

    text = json.dumps([plain(value), held])
    with naming_scratch(path.parent), path.open("wb") as file:
        np.savez(file, np.array(text), *arrays)


def read_parcel(path: Path) -> Any:
    """What `write_parcel` wrote, in this process or in another in which the add-on has another name."""
    with open_binary(path) as file, np.load(file, allow_pickle=False) as packed:
        text, *arrays = (packed[name] for name in packed.files)
    root, held = json.loads(str(text))
    made: list[Any] = []

    def whole(value: Any) -> Any:
        if not isinstance(value, list):
            return value
        kind, *parts = value
        if kind in ("held", "array"):
            return (made if kind == "held" else arrays)[parts[0]]
        return KINDS[kind][2](*map(whole, parts))

    for one in held:
        made.append(whole(one))  # noqa: PERF401 - each may hold those before it
    return whole(root)
