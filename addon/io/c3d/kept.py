# SPDX-License-Identifier: GPL-3.0-or-later
"""What a C3D file holds beside a take's markers, as it goes into the file with their names: in Intel's byte order."""

import re
import struct
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager

import numpy as np

from ...core.data.errors import InputError
from ..source import BytesOnDisk
from .file import BLOCK, SIXTEEN_BITS, C3dFile, Parameter, TrialFile, point_texts, trial_range, words_of

# What of a file is written of the take that is written.
OURS = re.compile(r"POINT:(USED|SCALE|RATE|DATA_START|FRAMES|LONG_FRAMES|(LABELS|DESCRIPTIONS)\d*)")

# Bytes of the header; format.
OWN_HEADER = 24  # the first words, which are ours
RANGE_KEY, RANGES = 147, slice(294, 298)  # word, bytes: that labels and ranges have a section, which is not kept
EVENT_KEY, EVENT_COUNT, EVENT_TIMES = 149, 150, slice(304, 376)  # word, word, bytes: 18 reals, s after the first frame
EVENT_FLAGS, EVENT_LABELS = slice(376, 394), slice(396, 468)
NEW_KEY = 12345  # of what is there

TURNS_START = "ROTATION:DATA_START"
USES_PREFIXES = "SUBJECTS:USES_PREFIXES"
MAX_RECORD = 65535  # bytes behind the name; format: 16 bits say where the next one is
NO_ROOM = "has more names than a C3D file has room for, with all else that it says; expected fewer or shorter names"


def packed_record(head: bytes, body: bytes = b"", description: bytes = b"") -> bytes:
    """A group or a parameter, as `C3dRecord` has it; InputError where it is longer than any can be."""
    length = 2 + len(body) + 1 + len(description)
    if length > MAX_RECORD:
        raise InputError(NO_ROOM)
    return head + struct.pack("<H", length) + body + bytes([len(description)]) + description


class Kept:
    """The other contents of a file, for writing a take of some frames that begins at `first_frame`.

    file          the file, open
    labels        of the points that are no markers
    descriptions  of points, by label
    """

    def __init__(self, file: C3dFile, trial: TrialFile, first_frame: int):
        self.file, self.trial, self.start = file, trial, first_frame - trial.layout.first
        texts = file.all_texts()
        labels, words = (point_texts(texts, name, trial.layout.points) for name in ("LABELS", "DESCRIPTIONS"))
        self.labels = [labels[index] for index in trial.others]
        self.descriptions = dict(zip(labels, words, strict=True))
        layout = trial.layout
        points = (4 * trial.others[:, None] + np.arange(4)).ravel()
        self._columns = np.append(points, np.arange(4 * layout.points, layout.stride))
        self._scale = np.ones(len(self._columns), np.float32)  # which makes reals of whole numbers
        self._scale[: len(points)].reshape(-1, 4)[:, :3] = abs(file.scale)
        self._unsigned = "UNSIGNED" in map(str.upper, texts.get("ANALOG:FORMAT", []))

    @property
    def samples(self) -> int:
        """Analog samples of a channel in a frame."""
        used, words = self.file.whole("ANALOG:USED"), self.trial.layout.analog
        return words // used if used and words else self.file.word(9)

    def header(self, rate: float) -> bytes:
        """What stands in the header behind the first words; times of its events count from the first frame."""
        content = self.file.content[:BLOCK]
        found = bytearray(np.frombuffer(content, self.file.order + "u2").astype("<u2"))
        times = self.file.reals(content[EVENT_TIMES]).astype("<f4")
        if self.file.word(EVENT_KEY) == NEW_KEY:
            times[: self.file.word(EVENT_COUNT)] -= np.float32(self.start / rate)
        found[EVENT_TIMES] = times.tobytes()
        if self.file.word(RANGE_KEY) == NEW_KEY:
            found[RANGES] = bytes(4)
        for letters in (EVENT_FLAGS, EVENT_LABELS):
            found[letters] = content[letters]
        return bytes(found[OWN_HEADER:])

    def lacks_range(self, first: int, last: int) -> bool:
        """Whether the file says other frames than these, or none where the header has no room for them."""
        stated = trial_range(self.file)
        return stated != (first, last) if stated else last >= SIXTEEN_BITS

    def knows(self, subjects: Collection[str]) -> bool:
        """Whether the file names all of these subjects."""
        return "SUBJECTS:NAMES" in self.file.parameters and {*subjects} <= {*self.file.texts("SUBJECTS:NAMES")}

    def lacks_prefixes(self, labels: Iterable[str]) -> bool:
        """Whether subjects' names stand before those of markers by what the file says, and before none of these."""
        texts = self.file.all_texts()
        prefixes, names = (texts.get(f"SUBJECTS:{one}", ()) for one in ("LABEL_PREFIXES", "NAMES"))
        said = tuple(filter(None, prefixes)) or tuple(f"{name}:" for name in names if name)
        return self.file.whole(USES_PREFIXES) > 0 and not any(label.startswith(said) for label in labels)

    def group_numbers(self) -> dict[str, int]:
        """The number of each group by its name."""
        numbers = [(key.partition(":")[0], record.head[1]) for key, record in self.file.records]
        # Of a group it is below zero; no parameter has 128.
        return {name: min(number, 256 - number) for name, number in numbers if number != 128}

    def records(self, again: Collection[str]) -> Iterator[bytes]:
        """Groups and parameters without those that are written again, by "GROUP:NAME", and what has no meaning then.

        That is all else of SUBJECTS where that is written again, and of rotations where these are not.
        """
        gone = ["SUBJECTS:"] if "SUBJECTS:USED" in again else []
        gone += ["ROTATION:"] if self.file.whole("ROTATION:USED") and TURNS_START not in again else []
        for key, record in self.file.records:
            replaced = key in again or OURS.fullmatch(key) or key.startswith(tuple(gone))
            if record.parameter is None or not replaced:
                yield packed_record(record.head, self._packed(record.parameter), record.description)

    def _packed(self, parameter: Parameter | None) -> bytes:
        if parameter is None:
            return b""
        content = parameter.content
        if parameter.kind == 4:
            content = self.file.reals(content).astype("<f4").tobytes()
        elif parameter.kind == 2:
            content = np.frombuffer(content, self.file.order + "u2").astype("<u2").tobytes()
        return struct.pack("bB", parameter.kind, len(parameter.dimensions)) + bytes(parameter.dimensions) + content

    def words(self, part: slice, real: bool) -> np.ndarray:
        """(F, N) the words of other points and of analog data in some of the take's frames, as reals or as they are."""
        frames = slice(part.start + self.start, part.stop + self.start)
        words = words_of(self.file, self.trial.layout, frames)[:, self._columns]
        if not real or self.file.scale < 0:
            return words
        words = words.astype("<f4") * self._scale
        if self._unsigned:
            words[:, 4 * len(self.labels) :] %= 65536
        return words

    def turns(self, part: slice) -> bytes:
        """The rotations of some of the take's frames."""
        start, reals = self.trial.layout.turns
        begin, end = (start + 4 * reals * (frame + self.start) for frame in (part.start, part.stop))
        return self.file.reals(self.file.content[begin:end]).astype("<f4").tobytes()


@contextmanager
def kept_of(trial: TrialFile | None, first_frame: int) -> Iterator[Kept | None]:
    """What is kept of a file, while it is open; InputError where it changed since it was read."""
    if trial is None:
        yield None
        return
    with BytesOnDisk(trial.path) as content:
        if content.state != trial.state:
            raise InputError("changed after it was read; expected it as it was, for all else of it is kept", trial.path)
        yield Kept(C3dFile(content, trial.path), trial, first_frame)
