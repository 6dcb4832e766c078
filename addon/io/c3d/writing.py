# SPDX-License-Identifier: GPL-3.0-or-later
"""The labelled take as a C3D file."""

import re
import struct
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...core.data.errors import InputError
from ...core.data.lanes import blocks
from ...core.data.made import Table
from ...core.data.takes import MAX_RATE_HZ, MIN_RATE_HZ
from ..samples import TextHead
from .file import BLOCK, INTEL, MASK_KEY, TrialFile
from .kept import NO_ROOM, TURNS_START, USES_PREFIXES, Kept, kept_of, packed_record

# 255 steps of this many mm are what the residual of a sample has room for: 0 to 12.75 mm.
RESIDUAL_STEP = 0.05

# Of a measured sample whose residual nobody knows: 0 would say that it was filled.
UNKNOWN_RESIDUAL_M = 0.0001

MILLIMETRES = 1000.0
WHOLE_STEP = 0.01  # of a step; format: numbers of 32 bits, as Blender keeps places, lose less than that
MAX_POINTS = 64 * 255
MAX_MASK = 127  # of the cameras that saw a sample, beside the sign
MAX_NAME_BYTES = 255  # bytes
MAX_EVENTS = 255  # format: a byte says how many
MAX_EVENT_BYTES = 2**15 // MAX_EVENTS  # of a name: readers take the length of a parameter as signed
MAX_KEY_LETTERS = 127  # letters of a parameter's name; format
LAST_NUMBER = 2**32 - 1  # of a frame
LAST_TURNS_START = (65535 - 257) * BLOCK  # bytes of points; format: rotations begin at a block with a number of 16 bits


def first_number(first_frame: int, frames: int) -> int:
    """The number that a C3D file gives the first frame: its own, or 0 where 32 bits without a sign cannot tell it."""
    return first_frame if 0 <= first_frame <= LAST_NUMBER + 1 - frames else 0


def names_in_c3d(labels: Sequence[str]) -> list[str]:
    """The names as a C3D file can hold them: up to 255 bytes, without control characters, no two become the same."""
    fitted, used = [], set(labels)
    for label in labels:
        plain = _plain(label)
        name, number = _cut(plain, MAX_NAME_BYTES), 2
        while name != label and name in used:
            name, number = f"{_cut(plain, MAX_NAME_BYTES - 8)}~{number}", number + 1
        used.add(name)
        fitted.append(name)
    return fitted


def _plain(text: str) -> str:
    return "".join("_" if unicodedata.category(sign) in ("Cc", "Cs") else sign for sign in text)


def _cut(text: str, width: int) -> str:
    """The text, or as many of its first letters as fill `width` bytes."""
    return text.encode("utf-8")[:width].decode("utf-8", "ignore")


def write_c3d_file(
    path: Path,
    labels: list[str],
    xyz: Table,
    residual: Table,
    rate: float,
    first_frame: int,
    trial: TrialFile | TextHead | None = None,
    subjects: Sequence[str] = (),
) -> list[str]:
    """Writes points as Intel reals, z up, in mm; missing samples are NaN with residual -1.

    xyz (T, P, 3) m; residual (T, P) m, 0 where a sample was filled, NaN where unknown. They may be on disk (np.memmap),
    for they are read piece by piece. Any number of frames and up to 16320 points. What the format cannot say is written
    as `names_in_c3d` and `first_number` tell.
    All else of the `trial` that they come from goes with them, a C3D file or a text's head: of a C3D file they are in
    its unit, axes and scale, as whole numbers where it has such and these can hold them, with 0 0 0 for what is
    missing. `subjects` are those whose names stand before markers. Gives what there was no room for, in sentences.
    Raises InputError where the file cannot hold the take, and where the trial's is not as it was.
    """
    frames, count = xyz.shape[:2]
    with kept_of(trial if isinstance(trial, TrialFile) else None, first_frame) as kept:
        labels = names_in_c3d([*labels, *(kept.labels if kept else ())])
        if not count or not frames or len(labels) > MAX_POINTS:
            what = f"cannot hold {len(labels)} points over {frames} frames"
            raise InputError(f"{what}; expected 1 to {MAX_POINTS} points", path)
        first = first_number(first_frame, frames)
        last = first + frames - 1
        units = _units_of(xyz, residual, kept)
        ours = _ours(labels, frames, rate, units.scale, first, kept)
        if isinstance(trial, TextHead):
            ours |= _of_head(trial)
        ours |= _subjects(subjects, labels, kept)
        events, notes = trial.events if isinstance(trial, TextHead) else (), []
        if some := _events(ours, events[:MAX_EVENTS], rate):
            ours |= some
        if left := len(events) - (min(len(events), MAX_EVENTS) if some else 0):
            notes = [f"the C3D file has no room for {left} of {len(events)} events, which were left out"]
        analog, gap, samples = (kept.trial.layout.analog, kept.file.word(5), kept.samples) if kept else (0, 0, 0)
        size = (4 * len(labels) + analog) * (4 if units.scale < 0 else 2)
        turned = kept is not None and kept.trial.layout.turns[1] > 0 and frames * size < LAST_TURNS_START
        if kept and turned:
            ours[TURNS_START], said = _words(0), kept.file.whole("ROTATION:FRAMES")
            if said and frames != kept.trial.layout.frames:
                ours["ROTATION:FRAMES"] = _words(min(said * frames // kept.trial.layout.frames, 65535))
        section = _parameters(ours, kept, -(-frames * size // BLOCK) if turned else 0)
        header = struct.pack(
            "<BBHHHHHfHHf",
            2,
            MASK_KEY,
            len(labels),
            analog,
            min(first, 65535),
            min(last, 65535),
            gap,
            units.scale,
            2 + len(section) // BLOCK,
            samples,
            rate,
        )

        def content(part: slice) -> bytes:
            words = units.words(xyz[part], residual[part])
            return (np.hstack([words, kept.words(part, units.scale < 0)]) if kept else words).tobytes()

        with Path(path).open("wb") as file:
            file.write(header + (kept.header(rate) if kept else bytes(BLOCK - len(header))))
            file.write(section)
            file.writelines(map(content, blocks(frames, size // 16)))
            # Readers that cannot count beyond 65535 frames read to the end: the padding must be shorter than a frame.
            padding = -(frames * size) % BLOCK
            file.write(b"\0" * (padding if last < 65535 or turned else padding % size))
            if kept and turned:
                reals = kept.trial.layout.turns[1]
                file.writelines(map(kept.turns, blocks(frames, reals)))
                file.write(bytes(-4 * frames * reals % BLOCK))
    return notes


@dataclass(frozen=True)
class Units:
    """What the places of a file are in."""

    per_metre: float = MILLIMETRES  # units in a metre
    scale: float = -RESIDUAL_STEP  # of whole numbers; below zero for reals, and then a step of residuals
    turn: np.ndarray | None = None  # (3, 3) what turns our axes, z up, into the file's

    def places(self, xyz: np.ndarray) -> np.ndarray:
        """Places (…, 3) m as the file has them; whole numbers are not rounded yet."""
        found = np.asarray(xyz, dtype=float) * self.per_metre
        found = found if self.turn is None else found @ self.turn
        return found / self.scale if self.scale > 0 else found

    def words(self, xyz: np.ndarray, residual: np.ndarray) -> np.ndarray:
        """(T, 4 P) the words of samples: x, y, z, and the residual in steps or -1."""
        words = np.empty((*xyz.shape[:2], 4), "<f4")
        words[..., :3] = self.places(xyz)
        missing = ~np.isfinite(words[..., :3]).all(axis=2)
        filled = residual == 0
        steps = np.where(np.isfinite(residual), residual, UNKNOWN_RESIDUAL_M) * (self.per_metre / abs(self.scale))
        steps = np.clip(np.rint(steps), np.where(filled, 0, 1), 255)
        # ezc3d, and what is built on it, looks for the residual in the byte of the cameras, of which nothing is known.
        words[..., 3] = np.where(missing, -1, steps + 256 * np.minimum(steps, MAX_MASK))
        words[missing, :3] = np.nan if self.scale < 0 else 0
        words = words.reshape(len(words), -1)
        return words if self.scale < 0 else np.rint(words).astype("<i2")


def _units_of(xyz: Table, residual: Table, kept: Kept | None) -> Units:
    """Those of the file that is kept, as far as they hold the points; else mm, z up, as reals."""
    if kept is None:
        return Units()
    parts = list(blocks(*xyz.shape[:2]))
    units = Units(1 / kept.trial.metre, kept.file.scale, kept.trial.turn)
    if units.scale > 0:
        return units if all(_whole(units.places(xyz[part])) for part in parts) else replace(units, scale=-units.scale)
    # A step of many files that state no residual is a whole mm or m, which is more than a measured sample may have.
    stated = any((residual[part] > 0).any() for part in parts)
    return units if stated else replace(units, scale=-RESIDUAL_STEP / MILLIMETRES * units.per_metre)


def _whole(numbers: np.ndarray) -> bool:
    """Whether these are whole numbers of 16 bits, NaN besides."""
    numbers = numbers[np.isfinite(numbers)]
    whole = np.rint(numbers)
    return bool((np.abs(numbers - whole) < WHOLE_STEP).all() and (np.abs(whole) < 2**15).all())


Parameters = dict[str, tuple[int, tuple[int, ...], bytes]]  # kind, dimensions and content by "GROUP:NAME"


def _parameters(ours: Parameters, kept: Kept | None, turned: int) -> bytes:
    """The whole parameter section, padded to blocks; where rotations come behind the points, these have `turned`."""
    others, numbers = (b"".join(kept.records(ours)), kept.group_numbers()) if kept else (b"", {})
    data_start = 0
    for _ in range(2):
        # The section tells where it ends, and its length does not depend on what it tells.
        ours["POINT:DATA_START"] = _words(data_start)
        if turned:
            ours[TURNS_START] = _words(data_start + turned)
        section = bytes(4) + others + _records(ours, dict(numbers)) + bytes(2)
        blocks = -(-len(section) // BLOCK)
        data_start = 2 + blocks
    if blocks > 255:
        raise InputError(NO_ROOM)
    return (bytes([0, 0, blocks, INTEL]) + section[4:]).ljust(blocks * BLOCK, b"\0")


def _records(ours: Parameters, numbers: dict[str, int]) -> bytes:
    """Parameters, and those of their groups that are not among the `numbers` of groups that there are."""
    found = []
    for key, (kind, dimensions, content) in ours.items():
        group, name = key.split(":")
        if group not in numbers:
            free = {*range(1, 128)} - {*numbers.values()}
            if not free:
                raise InputError(NO_ROOM)
            numbers[group] = min(free)
            found.append(packed_record(struct.pack("bb", len(group), -numbers[group]) + group.encode()))
        body = struct.pack("bB", kind, len(dimensions)) + bytes(dimensions) + content
        found.append(packed_record(struct.pack("bb", len(name), numbers[group]) + name.encode(), body))
    return b"".join(found)


def _ours(labels: list[str], frames: int, rate: float, scale: float, first: int, kept: Kept | None) -> Parameters:
    """What is said of this take, whatever file it came from."""
    ours = {
        "POINT:USED": _words(len(labels)),
        "POINT:SCALE": _real(scale),
        "POINT:RATE": _real(rate),
        "POINT:DATA_START": _words(0),
        "POINT:FRAMES": _words(min(frames, 65535)),
    }
    if kept is None:
        ours |= {"POINT:UNITS": _text("mm"), "POINT:X_SCREEN": _text("+X"), "POINT:Y_SCREEN": _text("+Z")}
    if frames > 65535:
        ours["POINT:LONG_FRAMES"] = _real(frames)
    for part, start in enumerate(range(0, len(labels), 255), 1):
        suffix = "" if part == 1 else str(part)
        chunk = labels[start : start + 255]
        described = [kept.descriptions.get(label, "") if kept else "" for label in chunk]
        ours |= {f"POINT:LABELS{suffix}": _table(chunk), f"POINT:DESCRIPTIONS{suffix}": _table(described)}
    last = first + frames - 1
    if kept is None or kept.lacks_range(first, last):
        fields = {"ACTUAL_START_FIELD": first, "ACTUAL_END_FIELD": last}
        ours |= {f"TRIAL:{name}": (2, (2,), struct.pack("<I", number)) for name, number in fields.items()}
    if kept is None:
        ours |= {"ANALOG:USED": _words(0), "ANALOG:GEN_SCALE": _real(1)}
    return ours


def _of_head(head: TextHead) -> Parameters:
    """What the head of a text file says: the cameras' rate as C3D files have it, else under its own names."""
    keys = (re.sub("[^A-Z0-9]+", "_", name.upper())[:MAX_KEY_LETTERS] for name in head.said)
    said = {f"{head.group}:{key}": text for key, text in zip(keys, head.said.values(), strict=True)}
    try:
        rate = float(head.fields.get("CameraRate", ""))
    except ValueError:
        rate = 0.0
    known = {"TRIAL:CAMERA_RATE": _real(rate)} if MIN_RATE_HZ <= rate <= MAX_RATE_HZ else {}
    return known | {key: _table(names_in_c3d([text])) for key, text in said.items()}


def _events(ours: Parameters, events: Sequence[tuple[str, float]], rate: float) -> Parameters:
    """Events of a text file, each a name and a frame, as C3D files have them; none where `ours` leave no room."""
    if not events:
        return {}
    times = [part for _, frame in events for part in divmod((frame - 1) / rate, 60)]  # minutes and seconds
    found = {
        "EVENT:USED": _words(len(events)),
        "EVENT:CONTEXTS": _table([""] * len(events)),
        "EVENT:LABELS": _table([_cut(_plain(name), MAX_EVENT_BYTES) for name, _ in events]),
        "EVENT:TIMES": (4, (2, len(events)), struct.pack(f"<{len(times)}f", *times)),
    }
    try:
        _parameters(ours | found, None, 0)
    except InputError:
        return {}
    return found


def _subjects(names: Sequence[str], labels: Sequence[str], kept: Kept | None) -> Parameters:
    """What says whether the names of subjects stand before those of markers; all of them where the file knows more."""
    if not names:
        return {USES_PREFIXES: _words(0)} if kept and kept.lacks_prefixes(labels) else {}
    found = {}
    if kept is not None and kept.knows(names):
        names = kept.file.texts("SUBJECTS:NAMES")
    else:
        found = {"SUBJECTS:USED": _words(len(names)), "SUBJECTS:NAMES": _table(names)}
    prefixes = [f"{name}:" if name else "" for name in names]
    return found | {USES_PREFIXES: _words(1), "SUBJECTS:LABEL_PREFIXES": _table(prefixes)}


def _words(number: int) -> tuple[int, tuple[int, ...], bytes]:
    return 2, (), struct.pack("<H", number)


def _real(number: float) -> tuple[int, tuple[int, ...], bytes]:
    return 4, (), struct.pack("<f", number)


def _text(text: str) -> tuple[int, tuple[int, ...], bytes]:
    return -1, (len(text),), text.encode()


def _table(texts: Sequence[str]) -> tuple[int, tuple[int, ...], bytes]:
    encoded = [text.encode("utf-8")[:255] for text in texts]
    width = max(map(len, encoded)) or 1
    return -1, (width, len(texts)), b"".join(text.ljust(width) for text in encoded)
