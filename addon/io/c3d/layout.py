# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the samples of a C3D file lie: how many points, frames and words a frame, where header and groups may differ.

Everything is said twice or more in a C3D file, and programs that write it err in one of the places. The length of the
file is the witness: the claim that fills it is right.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...core.data.errors import InputError
from .parameters import BLOCK, C3dFile

SIXTEEN_BITS = 65535


@dataclass(frozen=True)
class FileLayout:
    """What lies where in the file.

    start   byte at which the data begin
    points  points in a frame
    analog  words of analog data in a frame, behind the points
    frames  number of frames
    first   number of the first frame
    left    bytes behind the last frame
    notes   what of all that departs from what the file says, in sentences
    """

    start: int
    points: int
    analog: int
    frames: int
    first: int
    left: int
    notes: tuple[str, ...]

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
    starts = [start for start in _starts(file) if file.section < start < len(file.content)]
    if not starts:
        raise InputError("points to data that are not there; expected a whole C3D file", file.path)
    found = []
    for start in starts:
        for points in _points(file):
            for analog in _analog(file):
                layout = _filled(file, start, points, analog)
                if layout is not None and layout.left < BLOCK:
                    return layout
                found.append(layout)
    if found[0] is None:
        return _unfinished(file, starts[0])
    return found[0]


def _starts(file: C3dFile) -> list[int]:
    return _distinct([(block - 1) * BLOCK for block in (file.whole("POINT:DATA_START"), file.word(8))])


def _points(file: C3dFile) -> list[int]:
    return [count for count in _distinct([file.word(1), file.whole("POINT:USED")]) if count > 0]


def _analog(file: C3dFile) -> list[int]:
    """Words of analog data a frame; some programs write the number of channels there, or of one sample of each."""
    words, samples, channels = file.word(2), file.word(9), file.whole("ANALOG:USED")
    rates = file.number("ANALOG:RATE", 0), file.number("POINT:RATE", file.header_real(10))
    each = rates[0] / rates[1] if np.isfinite(rates).all() and rates[1] > 0 else 0
    claims = [words, words * samples, channels * samples, channels * round(each) if each < SIXTEEN_BITS else 0]
    return _distinct([claim for claim in claims if 0 <= claim <= SIXTEEN_BITS])


def _distinct(values: list[int]) -> list[int]:
    return list(dict.fromkeys(values))


def _filled(file: C3dFile, start: int, points: int, analog: int) -> FileLayout | None:
    """The layout with the claim about frames that best fills the data; None where each wants more than there are."""
    size = (4 * points + analog) * file.width
    available = (len(file.content) - start) // size
    claims = list(_claims(file))
    fitting = [claim for claim in claims if 1 <= claim[0] <= available]
    if not fitting:
        return None
    frames, first = _likeliest(fitting, size, len(file.content) - start)
    left = len(file.content) - start - frames * size
    return FileLayout(start, points, analog, frames, first, left, tuple(_notes(file, points, analog, frames, claims)))


def _likeliest(claims: list[tuple[int, int]], size: int, length: int) -> tuple[int, int]:
    """The claim that leaves least of the data over; the commonest of those that leave what may be padding."""
    filling = [frames for frames, _ in claims if length - frames * size < BLOCK]
    return max(claims, key=lambda claim: (filling.count(claim[0]), claim[0]))


def _claims(file: C3dFile) -> list[tuple[int, int]]:
    """Numbers of frames and of the first of them, from the places where files keep them."""
    first, last = file.word(3), file.word(4)
    claims = [(last - first + 1, first)] if last < SIXTEEN_BITS else []
    starts, ends = (file.numbers(f"TRIAL:ACTUAL_{end}_FIELD").astype(np.int64) for end in ("START", "END"))
    if len(starts) and len(ends):
        begin, end = (int(words[0]) + (int(words[1]) << 16 if len(words) > 1 else 0) for words in (starts, ends))
        claims.insert(0, (end - begin + 1, begin))
        first = begin
    claims += [(file.whole(key), first) for key in ("POINT:LONG_FRAMES", "POINT:FRAMES")]
    if max((frames for frames, _ in claims), default=0) > SIXTEEN_BITS:
        # Sixteen bits say 65535 where they mean more.
        claims = [claim for claim in claims if claim[0] != SIXTEEN_BITS]
    return claims


def _notes(file: C3dFile, points: int, analog: int, frames: int, claims: list[tuple[int, int]]) -> Iterator[str]:
    others = [str(claim) for claim in _distinct([claim for claim, _ in claims]) if claim > 0 and claim != frames]
    if others:
        yield f"the file says in places that it has {' or '.join(others)} frames, but {frames} fill it and were read"
    if file.word(1) and points != file.word(1):
        yield f"the header says that there are {file.word(1)} points, but {points} fill the file and were read"
    if analog != file.word(2):
        yield (
            f"the header says that a frame has {file.word(2)} words of analog data, but {analog} fill the file "
            "and were passed over"
        )


def _unfinished(file: C3dFile, start: int) -> FileLayout:
    """A file with fewer frames than it says that nevertheless ends with a frame, as no copy does that was cut off."""
    points, analog = _points(file)[0], _analog(file)[0]
    size = (4 * points + analog) * file.width
    length = len(file.content) - start
    claims = _claims(file)
    wanted = max((frames for frames, _ in claims), default=0)
    # What is cut off by a disk or a network ends with a block, where frames of a fitting size would end too.
    if length % size or length < size or len(file.content) % BLOCK == 0:
        raise InputError(f"has data for {length // size} of {wanted} frames; expected a whole C3D file", file.path)
    frames = length // size
    note = f"the file says that it has {wanted} frames, but ends with the end of frame {frames}: those were read"
    return FileLayout(start, points, analog, frames, claims[0][1] if claims else 1, 0, (note,))
