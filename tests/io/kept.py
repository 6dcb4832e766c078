# SPDX-License-Identifier: GPL-3.0-or-later
"""What a C3D file that we wrote of another has otherwise than that: word by word, and as two other readers say."""

import warnings
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import c3d
import ezc3d
import numpy as np

from addon.io.c3d.file import MIPS, C3dFile, find_layout, point_texts, words_of
from addon.io.c3d.kept import OURS
from addon.io.c3d.reading import marker_indices

# What is said of rotations that are somewhere else now, or some of them.
TURNS = "ROTATION:DATA_START", "ROTATION:FRAMES"
FIELDS = "TRIAL:ACTUAL_START_FIELD", "TRIAL:ACTUAL_END_FIELD"


def otherwise(source: Path, written: Path, frames: tuple[int, int] | None = None, anew: tuple[str, ...] = ()):
    """Sentences; none where all that is not ours of `source`, or of its frames from A to B, both included, is there.

    `anew` are the groups that are said anew.
    """
    files = [C3dFile(path.read_bytes(), path) for path in (source, written)]
    layouts = [find_layout(file) for file in files]
    first, last = frames or (layouts[0].first, layouts[0].first + layouts[0].frames - 1)
    part = slice(first - layouts[0].first, last + 1 - layouts[0].first)
    skipped = tuple(f"{group}:" for group in anew) + (FIELDS if frames else ()) + TURNS[: 2 if frames else 1]
    found = [_of_header(*layouts, first, last), _of_parameters(*files, skipped), _of_data(files, layouts, part)]
    found.append(_of_c3d(source, written, part))
    if files[0].processor != MIPS:  # which ezc3d does not read
        found.append(_of_ezc3d(source, written, part, skipped))
    return list(chain.from_iterable(found))


def _of_header(before, after, first, last) -> Iterator[str]:
    if (after.first, after.frames, after.notes) != (first, last - first + 1, ()):
        yield f"{after.frames} frames from {after.first} on, {after.notes}"
    if before.analog != after.analog:
        yield f"{after.analog} words of analog data"


def _of_parameters(before, after, skipped) -> Iterator[str]:
    if before.whole("ANALOG:USED") and after.word(9) * after.whole("ANALOG:USED") != after.word(2):
        yield "samples of analog data"
    found = dict(after.records)
    for key, record in before.records:
        if not OURS.fullmatch(key) and not key.startswith(skipped):
            facts = [_facts(*each) for each in ((before, key, record), (after, key, found.get(key)))]
            if facts[0] != facts[1]:
                yield f"{key}: {facts}"


def _facts(file, key, record):
    if record is None or record.parameter is None:
        return record and (record.description, record.head[2:], record.head[0])
    kind, words = record.parameter.kind, record.parameter.content
    values = file.numbers(key).astype(float).tobytes() if kind in (2, 4) else words
    return kind, record.parameter.dimensions, values, record.description, record.head[2:], record.head[0]


def _of_data(files, layouts, part) -> Iterator[str]:
    pairs = zip(files, layouts, strict=True)
    names = [point_texts(file.all_texts(), "LABELS", layout.points) for file, layout in pairs]
    others = np.setdiff1d(np.arange(len(names[0])), marker_indices(names[0], files[0].all_texts()))
    behind = layouts[1].points - len(others)
    if names[1][behind:] != [names[0][index] for index in others]:
        yield "labels of points that are no markers"
    parts = part, slice(0, part.stop - part.start)
    before, after = (words_of(*each) for each in zip(files, layouts, parts, strict=True))
    scale = np.ones(4, np.float32)
    if files[1].scale < 0 < files[0].scale:
        scale[:3] = files[0].scale
    for index, place in zip(others, range(behind, layouts[1].points), strict=True):
        one, two = before[:, 4 * index : 4 * index + 4] * scale, after[:, 4 * place : 4 * place + 4]
        if not np.array_equal(one, two, equal_nan=True):
            yield f"point {names[0][index]}"
    one, two = before[:, 4 * layouts[0].points :], after[:, 4 * layouts[1].points :]
    if files[0].scale > 0 and "UNSIGNED" in files[0].all_texts().get("ANALOG:FORMAT", ()):
        one, two = one.astype(int) % 65536, two.astype(int) % 65536
    if not np.array_equal(one, two, equal_nan=one.dtype.kind == "f"):
        yield "analog data"
    one, two = (_turns_of(file, layout) for file, layout in zip(files, layouts, strict=True))
    if not np.array_equal(one[part], two):
        yield "rotations"


def _turns_of(file, layout):
    start, reals = layout.turns
    return file.reals(file.content[start : start + 4 * reals * layout.frames]).reshape(layout.frames, reals)


def _of_ezc3d(source, written, part, skipped) -> Iterator[str]:
    before, after = (ezc3d.c3d(str(path)) for path in (source, written))
    one, two = _facts_of_ezc3d(before, skipped), _facts_of_ezc3d(after, skipped)
    yield from (f"ezc3d: {key}" for key in one if key not in two or not np.array_equal(one[key], two[key]))
    heads = [take["header"] for take in (before, after)]
    rate = heads[0]["analogs"]["frame_rate"] / heads[0]["points"]["frame_rate"]
    analog = before["data"]["analogs"][..., round(part.start * rate) : round(part.stop * rate)]
    if not np.array_equal(analog, after["data"]["analogs"], equal_nan=True):
        yield "ezc3d: analog data"
    turns = [take["data"]["rotations"] for take in (before, after)]
    if turns[0].size and not np.array_equal(turns[0][..., 2 * part.start : 2 * part.stop], turns[1]):
        yield "ezc3d: rotations"  # whose ratio is 2
    if any(heads[0][kind]["frame_rate"] != heads[1][kind]["frame_rate"] for kind in ("points", "analogs")):
        yield "ezc3d: rates"
    if not part.start and heads[0]["events"] != heads[1]["events"]:
        yield "ezc3d: events of the header"
    firsts = [head["points"]["first_frame"] for head in heads]
    if firsts[0] + part.start != firsts[1]:
        yield f"ezc3d: first frame {firsts[1]}"


def _facts_of_ezc3d(take, skipped) -> dict:
    groups = take["parameters"].items()
    keys = [(f"{group}:{name}", facts) for group, parameters in groups for name, facts in parameters.items()]
    kept = [(key, facts) for key, facts in keys if not OURS.fullmatch(key) and not key.startswith(skipped)]
    return {f"{key} {name}": value for key, facts in kept for name, value in facts.items()}


def _of_c3d(source, written, part) -> Iterator[str]:
    before, after = (_by_c3d(path) for path in (source, written))
    if not isinstance(before, Exception):  # it refuses many sound files
        before = after if isinstance(after, Exception) else before[part]
        same = len(before) == len(after) and all(
            np.array_equal(one, two, equal_nan=True) for one, two in zip(before, after, strict=True)
        )
        if isinstance(after, Exception) or not same:
            yield f"c3d: {after if isinstance(after, Exception) else 'analog data'}"


def _by_c3d(path) -> list[np.ndarray] | Exception:
    """The analog data of each frame, or why it cannot say."""
    with warnings.catch_warnings(), path.open("rb") as file:
        warnings.simplefilter("ignore")
        try:
            return [analog for _, _, analog in c3d.Reader(file).read_frames(check_nan=False)]
        except Exception as error:  # noqa: BLE001 six kinds of it
            return error
