# SPDX-License-Identifier: GPL-3.0-or-later
"""What a C3D file holds of points, as it stands there."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.data.errors import InputError
from ...core.data.lanes import blocks
from ...core.data.takes import MAX_RATE_HZ, MIN_RATE_HZ
from ..samples import Parts, Samples
from ..source import BytesOnDisk
from .layout import C3dFile, FileLayout, find_layout


@dataclass(frozen=True, eq=False)
class C3dHead:
    """What a C3D file says of its points.

    labels      P names
    frames      how many
    rate        frames a second
    first_frame number of the first frame
    texts       text parameters, lists of texts by "GROUP:NAME"
    notes       where the file contradicts itself and what was done about it, in sentences
    scales      what the numbers of a sample are times, to be in the file's units: its place, and its residual
    """

    labels: list[str]
    frames: int
    rate: float
    first_frame: int
    texts: dict[str, list[str]]
    notes: tuple[str, ...]
    scales: tuple[float, float]


@contextmanager
def open_c3d(path: Path, rate: float | None = None) -> Iterator[tuple[C3dHead, Parts]]:
    """A file's head, and the numbers of its samples, which are read from disk part by part.

    `rate` is used where the file says none.
    Raises InputError where the file is no C3D file, is damaged or cut off, has no points, or no rate is known.
    """
    with BytesOnDisk(path) as content:
        file = C3dFile(content, path)
        layout = find_layout(file)
        rate, notes = _rate(file, rate)
        texts = {key: file.texts(key) for key, parameter in file.parameters.items() if parameter.kind == -1}
        labels, notes = _labels(texts, layout.points), layout.notes + notes
        scales = (1.0 if file.scale < 0 else file.scale), abs(file.scale)
        head = C3dHead(labels, layout.frames, rate, layout.first, texts, notes, scales)
        yield head, lambda: _parts(file, layout)


def _rate(file: C3dFile, given: float | None) -> tuple[float, tuple[str, ...]]:
    """Frames a second, and what there is to say of that."""
    claims = [file.number(key, 0) for key in ("POINT:RATE", "TRIAL:CAMERA_RATE")]
    claims.insert(1, file.header_real(10))
    stated = next((claim for claim in claims if MIN_RATE_HZ <= claim <= MAX_RATE_HZ), None)
    if stated is not None:
        return stated, ()
    if given is None:
        raise InputError(
            f"has a rate of {claims[0]:g} frames a second; expected a rate above zero, or one that is given", file.path
        )
    return given, (f"the file has a rate of {claims[0]:g} frames a second, so the {given:g} that are given were taken",)


def _parts(file: C3dFile, layout: FileLayout) -> Iterator[Samples]:
    """The samples of all frames."""
    size = layout.stride * file.width
    for part in blocks(layout.frames, layout.stride):
        content = file.content[layout.start + part.start * size : layout.start + part.stop * size]
        words = file.reals(content) if file.scale < 0 else np.frombuffer(content, file.order + "i2")
        yield _samples(file, words.reshape(-1, layout.stride)[:, : 4 * layout.points], part.start)


def _samples(file: C3dFile, words: np.ndarray, first: int) -> Samples:
    """Those of some frames of words (F, 4P), of which the first is the frame `first`."""
    words = words.reshape(len(words), -1, 4)
    with np.errstate(invalid="ignore", over="ignore"):
        word, known = _fourth_word(words[..., 3])
        frame, column = np.nonzero(word >= 0)
        numbers = words[frame, column, :3].astype(np.float32)  # which holds all that either kind of word says
        xyz = numbers.astype(float) * (1 if file.scale < 0 else file.scale)
        there = np.isfinite(xyz).all(axis=1) & (np.abs(xyz) < 1e9).all(axis=1) & ~(xyz == 0).all(axis=1)
    frame, column = frame[there], column[there]
    residual = np.where(known[frame, column], word[frame, column] & 0xFF, np.nan).astype(np.float32)
    return Samples(frame + first, column, numbers[there], residual)


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


def _labels(texts: dict[str, list[str]], count: int) -> list[str]:
    """All labels: LABELS holds 255 of them, LABELS2, LABELS3, … go on."""
    labels = [*texts.get("POINT:LABELS", [])]
    number = 2
    while f"POINT:LABELS{number}" in texts:
        labels += texts[f"POINT:LABELS{number}"]
        number += 1
    return (labels + [""] * count)[:count]
