# SPDX-License-Identifier: GPL-3.0-or-later
"""What a C3D file holds of points, as it stands there."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.data.errors import InputError
from ..source import read_bytes
from .layout import FileLayout, find_layout
from .parameters import C3dFile

MAX_RATE_HZ = 1e6
CORNER_NUMBERS = 12  # of a force plate


@dataclass(frozen=True, eq=False)
class C3dTake:
    """What a C3D file holds of points, as it stands there.

    labels      P names
    xyz         (T, P, 3) in the file's units; NaN where missing
    residual    (T, P) in the file's units; NaN where missing or not stated
    rate        frames a second
    first_frame number of the first frame
    texts       text parameters, lists of texts by "GROUP:NAME"
    plates      (N, 4, 3) the corners of force plates, in the file's units
    notes       where the file contradicts itself and what was done about it, in sentences
    """

    labels: list[str]
    xyz: np.ndarray
    residual: np.ndarray
    rate: float
    first_frame: int
    texts: dict[str, list[str]]
    plates: np.ndarray
    notes: tuple[str, ...]


def read_c3d(path: Path, rate: float | None = None) -> C3dTake:
    """Reads a file; `rate` is used where the file says none.

    Raises InputError where the file is no C3D file, is damaged or cut off, has no points, or no rate is known.
    """
    file = C3dFile(read_bytes(path), path)
    layout = find_layout(file)
    rate, notes = _rate(file, rate)
    xyz, residual = _samples(file, layout)
    texts = {key: file.texts(key) for key, parameter in file.parameters.items() if parameter.kind == -1}
    labels = _labels(texts, layout.points)
    return C3dTake(labels, xyz, residual, rate, layout.first, texts, _plates(file), layout.notes + notes)


def _rate(file: C3dFile, given: float | None) -> tuple[float, tuple[str, ...]]:
    """Frames a second, and what there is to say of that."""
    claims = [file.number(key, 0) for key in ("POINT:RATE", "TRIAL:CAMERA_RATE")]
    claims.insert(1, file.header_real(10))
    stated = next((claim for claim in claims if 0 < claim < MAX_RATE_HZ), None)
    if stated is not None:
        return stated, ()
    if given is None:
        raise InputError(
            f"has a rate of {claims[0]:g} frames a second; expected a rate above zero, or one that is given", file.path
        )
    return given, (f"the file has a rate of {claims[0]:g} frames a second, so the {given:g} that are given were taken",)


def _samples(file: C3dFile, layout: FileLayout) -> tuple[np.ndarray, np.ndarray]:
    """Points (T, P, 3) and residuals (T, P), NaN where missing."""
    content = file.content[layout.start : layout.start + layout.frames * layout.stride * file.width]
    words = file.reals(content) if file.scale < 0 else np.frombuffer(content, file.order + "i2")
    words = words.reshape(layout.frames, layout.stride)[:, : 4 * layout.points].reshape(layout.frames, -1, 4)
    with np.errstate(invalid="ignore", over="ignore"):
        xyz = words[..., :3].astype(float) * (1 if file.scale < 0 else file.scale)
        word, known = _fourth_word(words[..., 3])
        missing = ~(np.isfinite(xyz).all(axis=2) & (np.abs(xyz) < 1e9).all(axis=2)) | (xyz == 0).all(axis=2)
    missing |= word < 0
    xyz[missing] = np.nan
    return xyz, np.where(missing | ~known, np.nan, (word & 0xFF) * abs(file.scale))


def _fourth_word(words: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The fourth words of samples as signed 16-bit numbers, and whether they are such numbers at all.

    The sign says that a sample is missing, the high byte which cameras saw it, and the low byte, times the scale, is
    the residual. A real is to be made a whole number first (user guide, "The 3D point residual"); some programs write
    that without a sign. What is no 16-bit number is no residual, unless it is below zero: then the sample is missing.
    """
    values = words.astype(float)
    known = (values > -32769) & (values < 65536)
    whole = np.where(known, values, np.where(values < 0, -1, 0)).astype(np.int64)
    return np.where(np.isnan(values), -1, (whole + 0x8000) % 0x10000 - 0x8000), known


def _plates(file: C3dFile) -> np.ndarray:
    """(N, 4, 3) the corners of force plates."""
    numbers = file.numbers("FORCE_PLATFORM:CORNERS").astype(float)
    return numbers[: len(numbers) // CORNER_NUMBERS * CORNER_NUMBERS].reshape(-1, 4, 3)


def _labels(texts: dict[str, Sequence[str]], count: int) -> list[str]:
    """All labels: LABELS holds 255 of them, LABELS2, LABELS3, … go on."""
    labels = list(texts.get("POINT:LABELS", []))
    number = 2
    while f"POINT:LABELS{number}" in texts:
        labels += texts[f"POINT:LABELS{number}"]
        number += 1
    return (labels + [""] * count)[:count]
