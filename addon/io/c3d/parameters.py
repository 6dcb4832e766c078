# SPDX-License-Identifier: GPL-3.0-or-later
"""Header and parameters of a C3D file, in its own byte order."""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.data.errors import InputError
from ..source import BytesOnDisk

KIND = "a C3D file"
BLOCK = 512
INTEL, DEC, MIPS = 84, 85, 86
MASK_KEY = 80


@dataclass(frozen=True)
class Parameter:
    """One parameter as it stands in the file; kind -1 is text, 1, 2 and 4 are bytes, whole numbers and reals."""

    kind: int
    dimensions: tuple[int, ...]
    content: bytes


class C3dFile:
    """Header and parameters of a file.

    parameters  by "GROUP:NAME"
    scale       of whole numbers; below zero where the file holds reals
    width       bytes of a word of data
    """

    def __init__(self, content: bytes | BytesOnDisk, path: Path):
        """Raises InputError where the file is no C3D file or its parameters are damaged."""
        head = content[:2]
        if len(content) < 2 * BLOCK or head[1] != MASK_KEY:
            raise InputError(f"does not begin as a C3D file does; expected {KIND}", path)
        self.content, self.path = content, path
        self.section = (head[0] - 1) * BLOCK
        if head[0] < 2 or self.section + 4 > len(content):
            raise InputError(f"points to parameters that are not there; expected {KIND}", path)
        self.blocks, self.processor = content[self.section + 2 : self.section + 4]
        if self.processor not in (INTEL, DEC, MIPS):
            raise InputError(
                f"is of an unknown processor ({self.processor}); expected {KIND} of Intel, DEC or MIPS", path
            )
        self.order = ">" if self.processor == MIPS else "<"
        self.parameters = self._parse(content[self.section + 4 : self._end()])
        self.scale = self.number("POINT:SCALE", self.header_real(6))
        if not 0 < abs(self.scale) < 1e6:
            raise InputError(f"has the scale {self.scale:g}; expected {KIND} with a scale", path)
        self.width = 4 if self.scale < 0 else 2

    def _end(self) -> int:
        """Where the parameters end at the latest.

        Some programs count too few blocks of parameters; the data, which the header points to, come after them all.
        """
        blocks, data = self.blocks, self.word(8) * BLOCK - BLOCK
        ends = [self.section + blocks * BLOCK if blocks else 0, data if data <= len(self.content) else 0]
        return max(ends) if max(ends) > self.section else len(self.content)

    def word(self, index: int) -> int:
        """The unsigned 16-bit word at `index` of the header, from zero."""
        return struct.unpack(self.order + "H", self.content[2 * index : 2 * index + 2])[0]

    def header_real(self, index: int) -> float:
        """The real number whose first word is at `index` of the header."""
        return float(self.reals(self.content[2 * index : 2 * index + 4])[0])

    def reals(self, content: bytes) -> np.ndarray:
        """32-bit reals of this processor; a DEC's are IEEE's with the halves changed round, four times as large."""
        if self.processor != DEC:
            return np.frombuffer(content, self.order + "f4")
        halves = np.frombuffer(content, "<u2").reshape(-1, 2)[:, ::-1]
        with np.errstate(invalid="ignore"):
            return np.ascontiguousarray(halves).view("<f4").ravel() / np.float32(4)

    def _parse(self, section: bytes) -> dict[str, Parameter]:
        groups: dict[int, str] = {}
        found: list[tuple[int, str, Parameter]] = []
        position = 0
        while position + 4 <= len(section):
            length, group = struct.unpack_from("bb", section, position)
            if length == 0 or group == 0:
                break
            name_end = position + 2 + abs(length)
            if name_end + 2 > len(section):
                raise InputError(f"has parameters that are cut off; expected {KIND}", self.path)
            name = as_text(section[position + 2 : name_end]).upper()
            offset = struct.unpack_from(self.order + "H", section, name_end)[0]
            if group < 0:
                groups[-group] = name
            else:
                found.append((group, name, self._parameter(section[name_end + 2 :])))
            if offset == 0:
                break
            position = name_end + offset
        return {f"{groups.get(group, group)}:{name}": parameter for group, name, parameter in found}

    def _parameter(self, record: bytes) -> Parameter:
        if len(record) < 2:
            raise InputError(f"has parameters that are cut off; expected {KIND}", self.path)
        kind, count = struct.unpack_from("bB", record)
        dimensions = tuple(record[2 : 2 + count])
        size = int(np.prod(dimensions, dtype=np.int64)) * abs(kind) if len(dimensions) < 8 else -1
        content = record[2 + count : 2 + count + max(size, 0)]
        if kind not in (-1, 1, 2, 4) or size < 0 or len(dimensions) < count or len(content) < size:
            raise InputError(f"has a damaged parameter; expected {KIND}", self.path)
        return Parameter(kind, dimensions, content)

    def number(self, key: str, default: float) -> float:
        """The first value of a number parameter, `default` where there is none."""
        values = self.numbers(key)
        return float(values[0]) if len(values) else default

    def whole(self, key: str) -> int:
        """The first value of a number parameter as a whole number, 0 where there is none."""
        value = self.number(key, 0)
        return int(value) if np.isfinite(value) else 0

    def numbers(self, key: str) -> np.ndarray:
        """The values of a number parameter; whole numbers without sign, as files beyond 32767 frames mean them."""
        parameter = self.parameters.get(key)
        if parameter is None or parameter.kind == -1:
            return np.zeros(0)
        if parameter.kind == 4:
            return self.reals(parameter.content)
        return np.frombuffer(parameter.content, "u1" if parameter.kind == 1 else self.order + "u2")

    def texts(self, key: str) -> list[str]:
        """The texts of a text parameter."""
        parameter = self.parameters[key]
        width = max(parameter.dimensions[0] if parameter.dimensions else 1, 1)
        return [as_text(parameter.content[start : start + width]) for start in range(0, len(parameter.content), width)]


def as_text(content: bytes) -> str:
    """UTF-8, the last letter of which may be cut off; Latin-1 where it is not."""
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        # A parameter has room for 255 bytes, and a program that cuts there may cut a letter.
        whole = content[: error.start] if error.reason == "unexpected end of data" and error.start else b""
        text = whole.decode("utf-8") if whole and not whole.isascii() else content.decode("latin-1")
    return text.strip(" \0\t\r\n")
