# SPDX-License-Identifier: GPL-3.0-or-later
"""What a C3D file holds of points: markers apart from what else stands there, rates, and samples part by part."""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ...core.data.errors import InputError
from ...core.data.lanes import blocks
from ...core.data.takes import MAX_RATE_HZ, MIN_RATE_HZ
from ..samples import PointFile, Samples
from ..source import BytesOnDisk
from .file import C3dFile, FileLayout, TrialFile, find_layout, point_texts, words_of

# Groups of Vicon's model outputs; TYPE_GROUPS of a file may name more.
OUTPUT_GROUPS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "MODELED_MARKERS", "REACTIONS")
_COMPUTED = re.compile(r"[LR]?[HKASEW]JC\w*|cent(?:re|er)ofmass\w*", re.IGNORECASE)


@contextmanager
def open_c3d(path: Path, rate: float | None = None, everything: bool = False) -> Iterator[PointFile]:
    """What a file says of its points, the markers among them or `everything`; samples are read from disk part by part.

    `rate` is used where the file says none.
    Raises InputError where the file is no C3D file, is damaged or cut off, has no markers, or no rate is known.
    """
    with BytesOnDisk(path) as content:
        file = C3dFile(content, path)
        layout = find_layout(file)
        rate, notes = _rate(file, rate)
        texts = file.all_texts()
        labels = point_texts(texts, "LABELS", layout.points)
        columns = np.arange(len(labels)) if everything else marker_indices(labels, texts)
        if not len(columns):
            raise InputError("has no markers among its points; expected a take with markers", path)
        unit, word = (next(iter(texts.get(f"POINT:{name}", [])), "") for name in ("UNITS", "Y_SCREEN"))
        yield PointFile(
            [labels[index] for index in columns],
            columns,
            len(labels),
            layout.frames,
            rate,
            layout.first,
            lambda: _parts(file, layout),
            unit.lower(),
            word.upper(),
            scale=(1.0 if file.scale < 0 else file.scale, abs(file.scale)),
            notes=layout.notes + notes,
            trial=TrialFile(path, content.state, layout, np.setdiff1d(np.arange(len(labels)), columns)),
        )


def _rate(file: C3dFile, given: float | None) -> tuple[float, tuple[str, ...]]:
    """Frames a second, and what there is to say of that."""
    rates = [file.number(key, 0) for key in ("POINT:RATE", "TRIAL:CAMERA_RATE")]
    rates.insert(1, file.header_real(10))
    stated = next((rate for rate in rates if MIN_RATE_HZ <= rate <= MAX_RATE_HZ), None)
    if stated is not None:
        return float(str(np.float32(stated))), ()  # 59.94, and not what its 32 bits come to in 64
    if given is None:
        raise InputError(
            f"has a rate of {rates[0]:g} frames a second; expected a rate above zero, or one that is given", file.path
        )
    return given, (f"the file has a rate of {rates[0]:g} frames a second, so the {given:g} that are given were taken",)


def _parts(file: C3dFile, layout: FileLayout) -> Iterator[Samples]:
    """The samples of all frames."""
    for part in blocks(layout.frames, layout.stride):
        yield _samples(file, words_of(file, layout, part)[:, : 4 * layout.points], part.start)


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


def marker_indices(labels: Sequence[str], texts: Mapping[str, Sequence[str]]) -> np.ndarray:
    """Which points are markers, by the file's own groups and by the names that Vicon's models use."""
    groups = [*OUTPUT_GROUPS, *texts.get("POINT:TYPE_GROUPS", [])[::2]]
    outputs = {name for group in groups for name in texts.get(f"POINT:{group.upper()}", [])}
    computed = {one for one in labels if one in outputs or _COMPUTED.fullmatch(one.rpartition(":")[2])} | _axes(labels)
    if outputs - {""}:
        computed |= _variants(labels)
    return np.array([index for index, label in enumerate(labels) if label not in computed], dtype=int)


def _axes(labels: Sequence[str]) -> set[str]:
    """The origin and the three axes of a segment: four names that differ in their last letter, O A L P."""
    present = set(labels)
    stems = {label[:-1] for label in labels if len(label) >= 4 and label.endswith("O")}
    return {stem + end for stem in stems for end in "OALP" if all(stem + other in present for other in "OALP")}


def _variants(labels: Sequence[str]) -> set[str]:
    """Virtual points of a model, numbered after a marker or from zero: LTIB1 beside LTIB, LFOF0 to LFOF3."""
    present = set(labels)
    numbered = [(label, re.fullmatch(r"(.{3,}[A-Za-z])\d", label)) for label in labels]
    return {label for label, match in numbered if match and (match[1] in present or match[1] + "0" in present)}
