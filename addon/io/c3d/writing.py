# SPDX-License-Identifier: GPL-3.0-or-later
"""The labelled take as a C3D file."""

import struct
import unicodedata
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...core.data.errors import InputError
from ...core.data.lanes import blocks
from ...core.data.made import Table
from .reading import BLOCK, INTEL, MASK_KEY

# 255 steps of this many mm are what the residual of a sample has room for: 0 to 12.75 mm.
RESIDUAL_STEP = 0.05

# Of a measured sample whose residual nobody knows: 0 would say that it was filled.
UNKNOWN_RESIDUAL_M = 0.0001

MILLIMETRES = 1000.0
MAX_POINTS = 64 * 255
MAX_MASK = 127  # of the cameras that saw a sample, beside the sign
MAX_NAME_BYTES = 255  # bytes
LAST_NUMBER = 2**32 - 1  # of a frame


def first_number(first_frame: int, frames: int) -> int:
    """The number that a C3D file gives the first frame: its own, or 0 where 32 bits without a sign cannot tell it."""
    return first_frame if 0 <= first_frame <= LAST_NUMBER + 1 - frames else 0


def names_in_c3d(labels: Sequence[str]) -> list[str]:
    """The names as a C3D file can hold them: up to 255 bytes, without control characters, no two become the same."""
    fitted, used = [], set(labels)
    for label in labels:
        plain = "".join("_" if unicodedata.category(sign) in ("Cc", "Cs") else sign for sign in label)
        name, number = _cut(plain, MAX_NAME_BYTES), 2
        while name != label and name in used:
            name, number = f"{_cut(plain, MAX_NAME_BYTES - 8)}~{number}", number + 1
        used.add(name)
        fitted.append(name)
    return fitted


def _cut(text: str, width: int) -> str:
    """The text, or as many of its first letters as fill `width` bytes."""
    return text.encode("utf-8")[:width].decode("utf-8", "ignore")


def write_c3d_file(path: Path, labels: list[str], xyz: Table, residual: Table, rate: float, first_frame: int):
    """Writes points in mm as Intel reals, z up; missing samples are NaN with residual -1.

    xyz (T, P, 3) m; residual (T, P) m, 0 where a sample was filled, NaN where unknown. They may be on disk (np.memmap),
    for they are read piece by piece. Any number of frames and up to 16320 points. What the format cannot say is written
    as `names_in_c3d` and `first_number` tell.
    Raises InputError where the file cannot hold the take.
    """
    frames, count = xyz.shape[:2]
    if not count or not frames or count > MAX_POINTS:
        raise InputError(f"cannot hold {count} points over {frames} frames; expected 1 to {MAX_POINTS} points", path)
    first = first_number(first_frame, frames)
    last = first + frames - 1
    section = _parameters(names_in_c3d(labels), frames, rate, first, last)
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
        file.writelines(_samples(xyz[part], residual[part]).tobytes() for part in blocks(frames, count))
        # Readers that cannot count beyond 65535 frames read to the end: the padding must be shorter than a frame.
        padding = -(frames * 16 * count) % BLOCK
        file.write(b"\0" * (padding if last < 65535 else padding % (16 * count)))


def _samples(xyz: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """(T, P, 4) the words of samples: x, y, z in mm, and the residual in steps or -1."""
    words = np.empty((*xyz.shape[:2], 4), "<f4")
    words[..., :3] = np.asarray(xyz, dtype=float) * MILLIMETRES
    missing = ~np.isfinite(words[..., :3]).all(axis=2)
    filled = residual == 0
    steps = np.where(np.isfinite(residual), residual, UNKNOWN_RESIDUAL_M) * (MILLIMETRES / RESIDUAL_STEP)
    steps = np.clip(np.rint(steps), np.where(filled, 0, 1), 255)
    # ezc3d, and what is built on it, looks for the residual in the byte of the cameras, of which nothing is known here.
    words[..., 3] = np.where(missing, -1, steps + 256 * np.minimum(steps, MAX_MASK))
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
    analog = [_record("USED", 3, 2, (), struct.pack("<H", 0)), _record("GEN_SCALE", 3, 4, (), struct.pack("<f", 1))]
    groups = [_group("POINT", 1), *point, _group("TRIAL", 2), *trial, _group("ANALOG", 3), *analog]
    return bytes(4) + b"".join(groups) + bytes(2)


def _group(name: str, group: int) -> bytes:
    return struct.pack("<bb", len(name), -group) + name.encode() + struct.pack("<HB", 3, 0)


def _record(name: str, group: int, kind: int, dimensions: tuple[int, ...], content: bytes) -> bytes:
    body = struct.pack("<bB", kind, len(dimensions)) + bytes(dimensions) + content + b"\0"
    return struct.pack("<bb", len(name), group) + name.encode() + struct.pack("<H", len(body) + 2) + body


def _text_record(name: str, group: int, texts: list[str]) -> bytes:
    encoded = [text.encode("utf-8") for text in texts]
    width = max(map(len, encoded), default=0) or 1
    # A single text is a row of letters, several are a table of them.
    dimensions = (
        (width,) if len(texts) == 1 and not name.startswith(("LABELS", "DESCRIPTIONS")) else (width, len(texts))
    )
    return _record(name, group, -1, dimensions, b"".join(text.ljust(width) for text in encoded))
