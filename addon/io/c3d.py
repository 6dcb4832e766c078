# SPDX-License-Identifier: GPL-3.0-or-later
"""C3D files: every processor (Intel, DEC, MIPS), integers or reals, as one array; and the labelled take written.

Read here and not by a library, with reasons that were measured: py-c3d refuses sound files whose header and parameters
differ in a detail, counts first frames beyond 65535 wrongly and lets six kinds of exception escape from damaged ones;
ezc3d cannot read MIPS files and would need a compiled wheel for every platform. Both serve as second opinion in tests.
The format: the C3D file format user guide, Motion Lab Systems, 2008.
"""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from .source import read_bytes

KIND = "a C3D file"
BLOCK = 512
INTEL, DEC, MIPS = 84, 85, 86
MASK_KEY = 80

# 255 steps of this many mm are what the residual of a sample has room for: 0 to 12.75 mm.
RESIDUAL_STEP = 0.05

MILLIMETRES = 1000.0
FRAMES_AT_ONCE = 4096


@dataclass(frozen=True, eq=False)
class C3dTake:
    """What a C3D file holds of points, as it stands there.

    labels      P names
    xyz         (T, P, 3) in the file's units; NaN where missing
    residual    (T, P) in the file's units; NaN where missing
    rate        frames a second
    first_frame number of the first frame
    texts       text parameters, lists of texts by "GROUP:NAME"
    """

    labels: list[str]
    xyz: np.ndarray
    residual: np.ndarray
    rate: float
    first_frame: int
    texts: dict[str, list[str]]


def read_c3d(path: Path) -> C3dTake:
    """Raises InputError where the file is no C3D file, is damaged or cut off, or has no points."""
    content = read_bytes(path)
    if len(content) < 2 * BLOCK or content[1] != MASK_KEY:
        raise InputError(f"does not begin as a C3D file does; expected {KIND}", path)
    file = _File(content, path)
    count, frames, first, stride = _extent(file)
    texts = {key: file.texts(key) for key in file.parameters if file.parameters[key].kind == -1}
    labels = _labels(texts, count)
    words = file.data(frames, stride)[:, : 4 * count].reshape(frames, count, 4)
    scale = abs(file.scale)
    with np.errstate(invalid="ignore", over="ignore"):
        xyz = words[..., :3].astype(float) * (1 if file.scale < 0 else scale)
        last = words[..., 3].astype(float)
        missing = (
            ~(np.isfinite(xyz).all(axis=2) & (np.abs(xyz) < 1e9).all(axis=2)) | ~(last >= 0) | (xyz == 0).all(axis=2)
        )
    residual = (np.clip(np.where(missing, 0, last), 0, 0xFFFF).astype(np.int64) & 0xFF) * scale
    xyz[missing], residual[missing] = np.nan, np.nan
    return C3dTake(labels, xyz, residual, file.rate, first, texts)


@dataclass(frozen=True)
class _Parameter:
    kind: int
    dimensions: tuple[int, ...]
    content: bytes


class _File:
    """Header and parameters of a file, in its own byte order."""

    def __init__(self, content: bytes, path: Path):
        self.content, self.path = content, path
        start = (content[0] - 1) * BLOCK
        if content[0] < 2 or start + 4 > len(content):
            raise InputError(f"points to parameters that are not there; expected {KIND}", path)
        blocks, self.processor = content[start + 2], content[start + 3]
        if self.processor not in (INTEL, DEC, MIPS):
            raise InputError(
                f"is of an unknown processor ({self.processor}); expected {KIND} of Intel, DEC or MIPS", path
            )
        self.order = ">" if self.processor == MIPS else "<"
        end = start + blocks * BLOCK if blocks else len(content)
        self.parameters = self._parse(content[start + 4 : min(end, len(content))])
        self.scale = self.number("POINT:SCALE", self._header_float(6))
        self.rate = self.number("POINT:RATE", self._header_float(10))
        if not 0 < abs(self.scale) < 1e6:
            raise InputError(f"has the scale {self.scale:g}; expected {KIND} with a scale", path)
        if not 0 < self.rate < 1e6:
            raise InputError(f"has a rate of {self.rate:g} frames a second; expected a rate above zero", path)

    def word(self, index: int) -> int:
        """The unsigned 16-bit word at `index` of the header, from zero."""
        return struct.unpack_from(self.order + "H", self.content, 2 * index)[0]

    def _header_float(self, index: int) -> float:
        return float(self._reals(self.content[2 * index : 2 * index + 4])[0])

    def _reals(self, content: bytes) -> np.ndarray:
        """32-bit reals of this processor; a DEC's are IEEE's with the halves changed round, four times as large."""
        if self.processor != DEC:
            return np.frombuffer(content, self.order + "f4")
        halves = np.frombuffer(content, "<u2").reshape(-1, 2)[:, ::-1]
        with np.errstate(invalid="ignore"):
            return np.ascontiguousarray(halves).view("<f4").ravel() / np.float32(4)

    def _parse(self, section: bytes) -> dict[str, _Parameter]:
        groups: dict[int, str] = {}
        found: list[tuple[int, str, _Parameter]] = []
        position = 0
        while position + 4 <= len(section):
            length, group = struct.unpack_from("bb", section, position)
            if length == 0 or group == 0:
                break
            name_end = position + 2 + abs(length)
            if name_end + 2 > len(section):
                raise InputError(f"has parameters that are cut off; expected {KIND}", self.path)
            name = _text(section[position + 2 : name_end]).upper()
            offset = struct.unpack_from(self.order + "H", section, name_end)[0]
            if group < 0:
                groups[-group] = name
            else:
                found.append((group, name, self._parameter(section[name_end + 2 :])))
            if offset == 0:
                break
            position = name_end + offset
        return {f"{groups.get(group, group)}:{name}": parameter for group, name, parameter in found}

    def _parameter(self, record: bytes) -> _Parameter:
        if len(record) < 2:
            raise InputError(f"has parameters that are cut off; expected {KIND}", self.path)
        kind, count = struct.unpack_from("bB", record)
        dimensions = tuple(record[2 : 2 + count])
        size = int(np.prod(dimensions, dtype=np.int64)) * abs(kind) if len(dimensions) < 8 else -1
        content = record[2 + count : 2 + count + max(size, 0)]
        if kind not in (-1, 1, 2, 4) or size < 0 or len(dimensions) < count or len(content) < size:
            raise InputError(f"has a damaged parameter; expected {KIND}", self.path)
        return _Parameter(kind, dimensions, content)

    def number(self, key: str, default: float) -> float:
        values = self.numbers(key)
        return float(values[0]) if len(values) else default

    def numbers(self, key: str) -> np.ndarray:
        """The values of a number parameter; whole numbers without sign, as files beyond 32767 frames mean them."""
        parameter = self.parameters.get(key)
        if parameter is None or parameter.kind == -1:
            return np.zeros(0)
        if parameter.kind == 4:
            return self._reals(parameter.content)
        return np.frombuffer(parameter.content, "u1" if parameter.kind == 1 else self.order + "u2")

    def texts(self, key: str) -> list[str]:
        parameter = self.parameters[key]
        width = parameter.dimensions[0] if parameter.dimensions else 1
        return [
            _text(parameter.content[start : start + width]) for start in range(0, len(parameter.content), max(width, 1))
        ]

    def data(self, frames: int, stride: int) -> np.ndarray:
        """(frames, stride) words of the data section."""
        start, width = self.start, 4 if self.scale < 0 else 2
        content = self.content[start : start + frames * stride * width]
        words = self._reals(content) if self.scale < 0 else np.frombuffer(content, self.order + "i2")
        return words.reshape(frames, stride)

    @property
    def start(self) -> int:
        return (int(self.number("POINT:DATA_START", 0)) or self.word(8)) * BLOCK - BLOCK


def _extent(file: _File) -> tuple[int, int, int, int]:
    """Points, frames, number of the first frame and words a frame."""
    count = file.word(1) or int(file.number("POINT:USED", 0))
    if not count:
        raise InputError("has no points; expected a take with markers", file.path)
    stride = 4 * count + file.word(2)
    width = 4 if file.scale < 0 else 2
    if not BLOCK < file.start < len(file.content):
        raise InputError("points to data that are not there; expected a whole C3D file", file.path)
    available = (len(file.content) - file.start) // (stride * width)
    frames, first = _frames(file, available)
    return count, frames, first, stride


def _frames(file: _File, available: int) -> tuple[int, int]:
    """Frames and the number of the first, from the places where files keep them: the claim that best fills the data."""
    first, last = file.word(3), file.word(4)
    claims = [(last - first + 1, first)] if last < 65535 else []
    starts, ends = (file.numbers(f"TRIAL:ACTUAL_{end}_FIELD").astype(np.int64) for end in ("START", "END"))
    if len(starts) and len(ends):
        begin, end = (int(words[0]) + (int(words[1]) << 16 if len(words) > 1 else 0) for words in (starts, ends))
        claims.insert(0, (end - begin + 1, begin))
        first = begin
    for key in ("POINT:LONG_FRAMES", "POINT:FRAMES"):
        value = file.number(key, 0)
        claims.append((int(value) if np.isfinite(value) else 0, first))
    if max(frames for frames, _ in claims) > 65535:
        # Sixteen bits say 65535 where they mean more.
        claims = [claim for claim in claims if claim[0] != 65535]
    fitting = [claim for claim in claims if 1 <= claim[0] <= available]
    if not fitting:
        wanted = max(frames for frames, _ in claims)
        raise InputError(f"has data for {available} of {wanted} frames; expected a whole C3D file", file.path)
    # Where claims differ, the one that leaves least of the data over is right.
    return max(fitting, key=lambda claim: claim[0])


def _labels(texts: dict[str, list[str]], count: int) -> list[str]:
    """All labels: LABELS holds 255 of them, LABELS2, LABELS3, … go on."""
    labels = list(texts.get("POINT:LABELS", []))
    number = 2
    while f"POINT:LABELS{number}" in texts:
        labels += texts[f"POINT:LABELS{number}"]
        number += 1
    return (labels + [""] * count)[:count]


def _text(content: bytes) -> str:
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    return text.strip(" \0\t\r\n")


def write_c3d_file(path: Path, labels: list[str], xyz: np.ndarray, residual: np.ndarray, rate: float, first_frame: int):
    """Writes points in mm as Intel reals, z up; missing samples are NaN with residual -1.

    xyz (T, P, 3) m; residual (T, P) m, NaN where unknown; they may be on disk (np.memmap), for they are read piece by
    piece. Any number of frames and up to 16320 points.
    Raises InputError where the file cannot hold the take.
    """
    frames, count = xyz.shape[:2]
    if not count or not frames or count > 64 * 255:
        raise InputError(f"cannot hold {count} points over {frames} frames; expected 1 to 16320 points", path)
    first = max(first_frame, 0)
    last = first + frames - 1
    section = _parameters(labels, frames, rate, first, last)
    header = struct.pack(
        "<BBHHHHHfHHf",
        2,
        MASK_KEY,
        count,
        0,
        min(first, 65535),
        min(last, 65535),
        0,
        -RESIDUAL_STEP,
        2 + len(section) // BLOCK,
        0,
        rate,
    )
    with Path(path).open("wb") as file:
        file.write(header.ljust(BLOCK, b"\0"))
        file.write(section)
        for start in range(0, frames, FRAMES_AT_ONCE):
            part = slice(start, start + FRAMES_AT_ONCE)
            file.write(_samples(xyz[part], residual[part]).tobytes())
        # Readers that cannot count beyond 65535 frames read to the end: the padding must be shorter than a frame.
        padding = -(frames * 16 * count) % BLOCK
        file.write(b"\0" * (padding if last < 65535 else padding % (16 * count)))


def _samples(xyz: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """(T, P, 4) the words of samples: x, y, z in mm, and the residual in steps or -1."""
    words = np.empty((*xyz.shape[:2], 4), "<f4")
    words[..., :3] = np.asarray(xyz, dtype=float) * MILLIMETRES
    missing = ~np.isfinite(words[..., :3]).all(axis=2)
    steps = np.clip(np.rint(np.nan_to_num(residual) * (MILLIMETRES / RESIDUAL_STEP)), 0, 255)
    words[..., 3] = np.where(missing, -1, steps)
    words[missing, :3] = np.nan
    return words


def _parameters(labels: list[str], frames: int, rate: float, first: int, last: int) -> bytes:
    """The whole parameter section, padded to blocks."""
    data_start = 0
    for _ in range(2):
        # The section tells where it ends, and its length does not depend on what it tells.
        section = _section(labels, frames, rate, first, last, data_start)
        blocks = -(-len(section) // BLOCK)
        data_start = 2 + blocks
    if blocks > 255:
        raise InputError("has more names than a C3D file has room for; expected fewer or shorter names")
    return (bytes([0, 0, blocks, INTEL]) + section[4:]).ljust(blocks * BLOCK, b"\0")


def _section(labels: list[str], frames: int, rate: float, first: int, last: int, data_start: int) -> bytes:
    point = [
        _record("USED", 1, 2, (), struct.pack("<H", len(labels))),
        _record("SCALE", 1, 4, (), struct.pack("<f", -RESIDUAL_STEP)),
        _record("RATE", 1, 4, (), struct.pack("<f", rate)),
        _record("DATA_START", 1, 2, (), struct.pack("<H", data_start)),
        _record("FRAMES", 1, 2, (), struct.pack("<H", min(frames, 65535))),
        _text_record("UNITS", 1, ["mm"]),
        _text_record("X_SCREEN", 1, ["+X"]),
        _text_record("Y_SCREEN", 1, ["+Z"]),
    ]
    if frames > 65535:
        point.append(_record("LONG_FRAMES", 1, 4, (), struct.pack("<f", frames)))
    for part, start in enumerate(range(0, len(labels), 255), 1):
        suffix = "" if part == 1 else str(part)
        chunk = labels[start : start + 255]
        point += [
            _text_record(f"LABELS{suffix}", 1, chunk),
            _text_record(f"DESCRIPTIONS{suffix}", 1, [""] * len(chunk)),
        ]
    trial = [
        _record("ACTUAL_START_FIELD", 2, 2, (2,), struct.pack("<I", first)),
        _record("ACTUAL_END_FIELD", 2, 2, (2,), struct.pack("<I", last)),
    ]
    analog = [
        _record("USED", 3, 2, (), struct.pack("<H", 0)),
        _record("GEN_SCALE", 3, 4, (), struct.pack("<f", 1)),
    ]
    groups = [_group("POINT", 1), *point, _group("TRIAL", 2), *trial, _group("ANALOG", 3), *analog]
    return bytes(4) + b"".join(groups) + bytes(2)


def _group(name: str, group: int) -> bytes:
    return struct.pack("<bb", len(name), -group) + name.encode() + struct.pack("<HB", 3, 0)


def _record(name: str, group: int, kind: int, dimensions: tuple[int, ...], content: bytes) -> bytes:
    body = struct.pack("<bB", kind, len(dimensions)) + bytes(dimensions) + content + b"\0"
    return struct.pack("<bb", len(name), group) + name.encode() + struct.pack("<H", len(body) + 2) + body


def _text_record(name: str, group: int, texts: list[str]) -> bytes:
    encoded = [text.encode("utf-8")[:255] for text in texts]
    width = max(map(len, encoded), default=0) or 1
    # A single text is a row of letters, several are a table of them.
    dimensions = (
        (width,) if len(texts) == 1 and not name.startswith(("LABELS", "DESCRIPTIONS")) else (width, len(texts))
    )
    return _record(name, group, -1, dimensions, b"".join(text.ljust(width) for text in encoded))
