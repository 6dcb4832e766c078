# SPDX-License-Identifier: GPL-3.0-or-later
"""Dataclasses of arrays with one row a naming, taken apart and put together by rows."""

from dataclasses import fields, is_dataclass

import numpy as np


def rows_of(data, rows: np.ndarray):
    """The same dataclass with these rows only."""
    parts = ((field, getattr(data, field.name)) for field in fields(data))
    return type(data)(*(_cut(part, rows) if field.metadata.get("rows", True) else part for field, part in parts))


def _cut(part, rows: np.ndarray):
    return rows_of(part, rows) if is_dataclass(part) else part[rows]


def put_rows(data, other, rows: np.ndarray):
    """Writes the rows of `other` over these rows of `data`, in place."""
    for field in fields(data):
        part, new = getattr(data, field.name), getattr(other, field.name)
        if is_dataclass(part):
            put_rows(part, new, rows)
        elif field.metadata.get("rows", True):
            part[rows] = new
