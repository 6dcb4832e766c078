# SPDX-License-Identifier: GPL-3.0-or-later
"""A C3D file read: header and parameters in its own byte order, where its samples lie.

Everything is said twice or more in a C3D file, and programs that write it err in one of the places. The length of the
file is the witness: the claim that fills it is right.
"""

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...core.data.errors import InputError
from ...core.data.lanes import blocks
from ..source import BytesOnDisk, windows_text

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


@dataclass(frozen=True)
class C3dRecord:
    """A group, which has no parameter, or a parameter as the section has it."""

    head: bytes  # length of its name, group and name as bytes
    parameter: Parameter | None
    description: bytes  # what stands behind it


class C3dFile:
    """Header and parameters of a file.

    records     all groups and parameters in their order, with "GROUP:" or "GROUP:NAME" of each
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
        self.records = self._parse(content[self.section + 4 : self._end()])
        self.parameters = {key: record.parameter for key, record in self.records if record.parameter is not None}
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

    def _parse(self, section: bytes) -> list[tuple[str, C3dRecord]]:
        groups: dict[int, str] = {}
        found: list[tuple[int, str, C3dRecord]] = []
        position, whole = 0, memoryview(section)
        while position + 4 <= len(section):
            length, group = struct.unpack_from("bb", section, position)
            if length == 0 or group == 0:
                break
            name_end = position + 2 + abs(length)
            if name_end + 2 > len(section):
                raise InputError(f"has parameters that are cut off; expected {KIND}", self.path)
            name = as_text(section[position + 2 : name_end]).upper()
            offset = struct.unpack_from(self.order + "H", section, name_end)[0]
            parameter, end = None, name_end + 2
            if group < 0:
                groups[-group], name = name, ""
            else:
                parameter = self._parameter(whole[end:])
                end += 2 + len(parameter.dimensions) + len(parameter.content)
            stop = name_end + offset if offset else len(section)
            description = section[end + 1 : min(end + 1 + section[end], stop)] if end < min(stop, len(section)) else b""
            found.append((abs(group), name, C3dRecord(section[position:name_end], parameter, description)))
            if offset == 0:
                break
            position = name_end + offset
        return [(f"{groups.get(group, group)}:{name}", record) for group, name, record in found]

    def _parameter(self, record: memoryview) -> Parameter:
        if len(record) < 2:
            raise InputError(f"has parameters that are cut off; expected {KIND}", self.path)
        kind, count = struct.unpack_from("bB", record)
        dimensions = tuple(record[2 : 2 + count])
        size = int(np.prod(dimensions, dtype=np.int64)) * abs(kind) if len(dimensions) < 8 else -1
        content = bytes(record[2 + count : 2 + count + max(size, 0)])
        if kind not in (-1, 1, 2, 4) or size < 0:
            raise InputError(f"has a damaged parameter; expected {KIND}", self.path)
        if len(dimensions) < count or len(content) < size:
            raise InputError(f"has parameters that are cut off; expected {KIND}", self.path)
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

    def all_texts(self) -> dict[str, list[str]]:
        """The texts of all text parameters."""
        return {key: self.texts(key) for key, parameter in self.parameters.items() if parameter.kind == -1}


def as_text(content: bytes) -> str:
    """UTF-8, the last letter of which may be cut off; Windows-1252 where it is not."""
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        # A parameter has room for 255 bytes, and a program that cuts there may cut a letter.
        whole = content[: error.start] if error.reason == "unexpected end of data" and error.start else b""
        text = whole.decode("utf-8") if whole and not whole.isascii() else windows_text(content)
    return text.strip(" \0\t\r\n")


SIXTEEN_BITS = 65535


@dataclass(frozen=True)
class FileLayout:
    """What lies where in the file."""

    start: int  # byte at which the data begin
    points: int  # points in a frame
    analog: int  # words of analog data in a frame, behind the points
    frames: int  # number of frames
    first: int  # number of the first frame
    left: int  # bytes behind the last frame, up to rotations where there are some
    notes: tuple[str, ...]  # what of all that departs from what the file says, in sentences
    # byte at which the rotations begin, and how many reals of them there are in a frame; 0 without any
    turns: tuple[int, int] = (0, 0)

    @property
    def stride(self) -> int:
        """Words a frame."""
        return 4 * self.points + self.analog


def find_layout(file: C3dFile) -> FileLayout:
    """The layout that fills the file: the header's, unless another claim of the file does and that one does not.

    Raises InputError where the file has no points or ends before its data do.
    """
    if not (file.word(1) or file.whole("POINT:USED")):
        raise InputError("has no points; expected a take with markers", file.path)
    starts = [
        start
        for start in _distinct([(block - 1) * BLOCK for block in (file.whole("POINT:DATA_START"), file.word(8))])
        if file.section < start < len(file.content)
    ]
    if not starts:
        raise InputError("points to data that are not there; expected a whole C3D file", file.path)
    found = []
    for start in starts:
        for points in _point_counts(file):
            for analog in _analog(file):
                layout = _filled(file, start, points, analog)
                if layout is not None and layout.left < BLOCK:
                    return layout
                found.append(layout)
    if found[0] is None:
        return _unfinished(file, starts[0])
    likeliest = found[0]
    if likeliest.left <= BLOCK:
        return likeliest
    note = f"behind its {likeliest.frames} frames the file holds {likeliest.left} bytes more, which were passed over"
    return replace(likeliest, notes=(*likeliest.notes, note))


def _point_counts(file: C3dFile) -> list[int]:
    return [count for count in _distinct([file.word(1), file.whole("POINT:USED")]) if count > 0]


def _analog(file: C3dFile) -> list[int]:
    """Words of analog data a frame; some programs write the number of channels there, or of one sample of each."""
    words, samples, channels = file.word(2), file.word(9), file.whole("ANALOG:USED")
    counts = [words, words * samples, channels * samples, channels * _each_frame(file, "ANALOG")]
    return _distinct([count for count in counts if 0 <= count <= SIXTEEN_BITS])


def _each_frame(file: C3dFile, group: str) -> int:
    """How often what a group is about was sampled in a frame, by its rate; 0 where that cannot be."""
    rates = file.number(f"{group}:RATE", 0), file.number("POINT:RATE", file.header_real(10))
    each = rates[0] / rates[1] if np.isfinite(rates).all() and rates[1] > 0 else 0
    return round(each) if 0 < each < SIXTEEN_BITS else 0


REALS_OF_TURN = 17  # format: a matrix of 4 x 4 and how far it can be relied on


def _turns(file: C3dFile, start: int) -> tuple[int, int]:
    """Where rotations begin behind data from `start` on, and their reals a frame; the file's end and 0 without any.

    They are a block of their own (C-Motion, ROTATION data type, 2019).
    """
    begin = (file.whole("ROTATION:DATA_START") - 1) * BLOCK
    each = file.whole("ROTATION:RATIO") or _each_frame(file, "ROTATION")
    reals = REALS_OF_TURN * file.whole("ROTATION:USED") * each
    return (begin, reals) if reals > 0 and start < begin < len(file.content) else (len(file.content), 0)


def _distinct(values: list[int]) -> list[int]:
    return list(dict.fromkeys(values))


def _filled(file: C3dFile, start: int, points: int, analog: int) -> FileLayout | None:
    """The layout with the stated frames that best fill the data; None where all of them want more than there are."""
    size, (end, turns) = (4 * points + analog) * file.width, _turns(file, start)
    available = (end - start) // size
    stated = _stated_frames(file)
    if max(stated)[0] == SIXTEEN_BITS < available and (more := _uncounted(file, start, end, points, size)):
        stated.append((more, stated[0][1]))
    fitting = [one for one in stated if 1 <= one[0] <= available]
    if not fitting:
        return None
    frames, first = _likeliest(fitting, size, end - start)
    left, notes = end - start - frames * size, tuple(_notes(file, points, analog, frames, stated))
    turned = end + 4 * turns * frames <= len(file.content)
    return FileLayout(start, points, analog, frames, first, left, notes, (end, turns) if turned else (0, 0))


def _uncounted(file: C3dFile, start: int, end: int, points: int, size: int) -> int:
    """How many frames of `size` bytes fill a file that says 65535, the most that 16 bits can; 0 where that is in doubt.

    Reals alone tell: of points the fourth is a whole number, and no frame is of one number, as what fills a file is.
    """
    last = file.content[end - BLOCK : end]
    whole = -(-(end - start - len(last) + len(last.rstrip(b"\0"))) // size)
    counted = file.whole("POINT:LONG_FRAMES") > 0 or len(file.numbers("TRIAL:ACTUAL_END_FIELD")) > 1
    # ezc3d pads a file that needs no padding with a block.
    if counted or file.scale > 0 or whole <= SIXTEEN_BITS or not 0 <= end - start - whole * size <= BLOCK:
        return 0
    for part in blocks(whole - SIXTEEN_BITS, size // 16):
        begin, stop = (start + (SIXTEEN_BITS + at) * size for at in (part.start, part.stop))
        reals = file.reals(file.content[begin:stop]).reshape(-1, size // 4)
        fourth = reals[:, 3 : 4 * points : 4]
        if not (fourth == np.rint(fourth)).all() or (reals.min(axis=1) == reals.max(axis=1)).any():
            return 0
    return whole


def _likeliest(stated: list[tuple[int, int]], size: int, length: int) -> tuple[int, int]:
    """Those stated frames that leave least of the data over; the commonest of those that leave what may be padding."""
    filling = [frames for frames, _ in stated if length - frames * size < BLOCK]
    return max(stated, key=lambda one: (filling.count(one[0]), one[0]))


def trial_range(file: C3dFile) -> tuple[int, int] | None:
    """First and last frame as the group TRIAL says; None where it does not."""
    starts, ends = (file.numbers(f"TRIAL:ACTUAL_{end}_FIELD").astype(np.int64) for end in ("START", "END"))
    if not len(starts) or not len(ends):
        return None
    begin, end = (int(words[0]) + (int(words[1]) << 16 if len(words) > 1 else 0) for words in (starts, ends))
    return begin, end


def _stated_frames(file: C3dFile) -> list[tuple[int, int]]:
    """Numbers of frames and of the first of them, from the places where files keep them."""
    first, last = file.word(3), file.word(4)
    stated = [(last - first + 1, first)] if last < SIXTEEN_BITS else []
    if trial := trial_range(file):
        first, end = trial
        stated.insert(0, (end - first + 1, first))
    stated += [(file.whole(key), first) for key in ("POINT:LONG_FRAMES", "POINT:FRAMES")]
    if max((frames for frames, _ in stated), default=0) > SIXTEEN_BITS:
        # Sixteen bits say 65535 where they mean more.
        stated = [one for one in stated if one[0] != SIXTEEN_BITS]
    return stated


def _notes(file: C3dFile, points: int, analog: int, frames: int, stated: list[tuple[int, int]]) -> Iterator[str]:
    others = [str(count) for count in _distinct([count for count, _ in stated]) if count > 0 and count != frames]
    if others:
        yield f"the file says in places that it has {' or '.join(others)} frames, but {frames} fill it and were read"
    if file.word(1) and points != file.word(1):
        yield f"the header says that there are {file.word(1)} points, but {points} fill the file and were read"
    if min(file.scale, said := file.header_real(6)) > 0 and not np.isclose(said, file.scale):
        yield f"the header says a scale of {said:g}, but the groups' {file.scale:g} was taken"
    if analog != file.word(2):
        yield (
            f"the header says that a frame has {file.word(2)} words of analog data, but {analog} fill the file "
            "and were passed over"
        )


def _unfinished(file: C3dFile, start: int) -> FileLayout:
    """A file with fewer frames than it says that nevertheless ends with a frame, as no copy does that was cut off."""
    points, analog = _point_counts(file)[0], _analog(file)[0]
    size = (4 * points + analog) * file.width
    length = len(file.content) - start
    stated = _stated_frames(file)
    wanted = max((frames for frames, _ in stated), default=0)
    # What is cut off by a disk or a network ends with a block, where frames of a fitting size would end too.
    if length % size or length < size or len(file.content) % BLOCK == 0:
        words = (
            f"has data for {length // size} of {wanted} frames" if wanted > 0 else "says nowhere how many frames it has"
        )
        raise InputError(f"{words}; expected a whole C3D file", file.path)
    frames = length // size
    note = f"the file says that it has {wanted} frames, but ends with the end of frame {frames}: those were read"
    return FileLayout(start, points, analog, frames, stated[0][1] if stated else 1, 0, (note,))


@dataclass(frozen=True, eq=False)
class TrialFile:
    """The C3D file that a take came from, for writing all of it that is not the take's markers into the named one."""

    path: Path
    state: tuple[int, int]  # of the file when it was read
    layout: FileLayout  # where its samples lie
    others: np.ndarray  # (K,) which of its points are no markers
    metre: float = 1.0  # of one of its units, and
    turn: np.ndarray | None = None  # (3, 3) its axes to ours: how the take was read


def words_of(file: C3dFile, layout: FileLayout, part: slice) -> np.ndarray:
    """(F, stride) all words of the data of some frames from start to stop: reals, or whole numbers of 16 bits."""
    size = layout.stride * file.width
    content = file.content[layout.start + part.start * size : layout.start + part.stop * size]
    words = file.reals(content) if file.scale < 0 else np.frombuffer(content, file.order + "i2")
    return words.reshape(-1, layout.stride)


def point_texts(texts: Mapping[str, Sequence[str]], name: str, count: int) -> list[str]:
    """All labels of points, or what else of each has a `name`: LABELS holds 255 of them, LABELS2, LABELS3, … go on."""
    found = [*texts.get(f"POINT:{name}", [])]
    number = 2
    while f"POINT:{name}{number}" in texts:
        found += texts[f"POINT:{name}{number}"]
        number += 1
    return (found + [""] * count)[:count]
