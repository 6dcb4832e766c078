# SPDX-License-Identifier: GPL-3.0-or-later
"""The checks behind a marker set file: every part is what it says, or one sentence says which is not."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from ..core.data.errors import InputError
from .names import EXPECTED, can_be_written, is_unicode


@dataclass(frozen=True)
class FieldLimits:
    """What no marker set holds; physical.

    max_number  heights, metres and square radians of a body are all far below it
    max_rows    of a table: a subject has a hundred markers at most and fewer joints
    """

    max_number: float = 1e3
    max_rows: int = 1000


FIELDS = FieldLimits()


class Reader:
    """Takes parts out of a parsed file; each method raises InputError naming the part, where it is not as expected."""

    def __init__(self, path: Path):
        self.path = path

    def fail(self, message: str) -> NoReturn:
        """Raises the error."""
        raise InputError(message, self.path)

    def mapping(self, value: object, where: str) -> dict:
        """`value` as an object."""
        if not isinstance(value, dict):
            self.fail(f"{where} is missing or not an object; expected a marker set's {{…}}")
        return value

    def rows(self, top: dict, key: str, empty: bool = False) -> list[tuple[str, dict]]:
        """The objects of the list `key`, each with words for where it stands."""
        value = top.get(key)
        if not isinstance(value, list) or not (value or empty):
            self.fail(f'"{key}" is missing or empty; expected a list')
        if len(value) > FIELDS.max_rows:
            self.fail(f'"{key}" has {len(value)} rows; expected at most {FIELDS.max_rows}')
        words = [f"{key}[{index}]" for index in range(len(value))]
        return [(where, self.mapping(row, where)) for where, row in zip(words, value, strict=True)]

    def text(self, row: dict, key: str, where: str) -> str:
        """The name under `key`."""
        value = row.get(key)
        if not isinstance(value, str) or not value.strip():
            self.fail(f'{where} has no "{key}"; expected a text')
        return self._writable(value, f'{where} "{key}"')

    def prose(self, top: dict, key: str) -> str:
        """The text of any length under `key`, empty where there is none."""
        value = top.get(key, "")
        if not isinstance(value, str) or not is_unicode(value):
            self.fail(f'"{key}" is no text; expected one in Unicode')
        return value

    def _writable(self, name: str, where: str) -> str:
        if not can_be_written(name):
            self.fail(f"{where} is {name!r}; {EXPECTED}")
        return name

    def texts(self, value: object, where: str) -> dict[str, str]:
        """An object of texts."""
        if not isinstance(value, dict) or not all(
            isinstance(text, str) and is_unicode(text) for pair in value.items() for text in pair
        ):
            self.fail(f'"{where}" is not an object of texts; expected {{"people": "…"}}')
        return value

    def names(self, value: object, where: str) -> list[str]:
        """A list of names."""
        if not isinstance(value, list) or not all(isinstance(name, str) and name.strip() for name in value):
            self.fail(f"{where} are not a list of names; expected texts")
        return [self._writable(name, where) for name in value]

    def unique(self, names: Sequence[str], key: str):
        """Checks that no name is there twice."""
        doubled = next((name for name, count in Counter(names).items() if count > 1), None)
        if doubled is not None:
            self.fail(f'"{key}" has {doubled!r} twice; expected every name once')

    def on_segments(self, rows: Sequence[tuple[str, dict]], segments: Sequence[str]) -> np.ndarray:
        """(N,) the indices of the segments that N rows are on."""
        place, found = {name: index for index, name in enumerate(segments)}, []
        for where, row in rows:
            name = self.text(row, "segment", where)
            if name not in place:
                self.fail(f"{where} is on {name!r}, which is no segment; expected one of {', '.join(segments[:8])}")
            found.append(place[name])
        return np.array(found, dtype=int)

    def number(
        self, row: dict, key: str, where: str, low: float = -FIELDS.max_number, high: float = FIELDS.max_number
    ) -> float:
        """The number under `key`, within bounds."""
        value = row.get(key)
        if value is None or not _is_number(value) or not low <= value <= high:
            self.fail(f'{where} has no "{key}" from {low:g} to {high:g}; expected a number')
        return float(value)

    def vector(self, row: dict, key: str, where: str) -> np.ndarray:
        """The three numbers under `key`."""
        return self._numbers(row.get(key), 3, f'{where} "{key}"')

    def row(self, value: object, count: int, where: str) -> np.ndarray:
        """(count,) the numbers of a list."""
        return self._numbers(value, count, where)

    def vectors(self, value: object, names: Sequence[str], where: str) -> np.ndarray:
        """(N, 3) of an object that holds one vector for every name."""
        table = self.mapping(value, where)
        missing = next((name for name in names if name not in table), None)
        if missing is not None:
            self.fail(f"{where} has no {missing!r}; expected three numbers for each")
        return np.array([self._numbers(table[name], 3, f"{where} {name!r}") for name in names]).reshape(-1, 3)

    def covariance(self, value: object, size: int) -> np.ndarray:
        """(size, size) out of its lower triangle; it must be one of real motion, so never negative in any direction."""
        where = "pose covariance"
        if not isinstance(value, list) or len(value) != size:
            self.fail(f"{where} is missing or not {size} rows; expected the lower triangle of a matrix")
        matrix = np.zeros((size, size))
        for index, row in enumerate(value):
            matrix[index, : index + 1] = self._numbers(row, index + 1, f"{where} row {index}")
        matrix += np.tril(matrix, -1).T
        eigenvalues = np.linalg.eigvalsh(matrix)
        if eigenvalues[0] < -1e-4 * max(eigenvalues[-1], 1e-9):
            self.fail(f"{where} is negative in some direction; expected a covariance")
        return matrix

    def _numbers(self, value: object, count: int, where: str) -> np.ndarray:
        if not isinstance(value, list) or len(value) != count or not all(map(_is_number, value)):
            self.fail(f"{where} is not {count} finite numbers; expected a list of them")
        return np.array(value, dtype=float)


def _is_number(value: object) -> bool:
    """True for a finite JSON number of a size that a body can have; True and false are none."""
    return (
        isinstance(value, (int, float))
        and not isinstance(value, bool)
        and -FIELDS.max_number <= value <= FIELDS.max_number
    )
