# SPDX-License-Identifier: GPL-3.0-or-later
"""The poses of a long take on disk while it is labelled, and its motion beside a Blender file that has no keys.

The latter is a point cache, `.pc2`, of which Blender's Mesh Cache modifier reads a frame at a time: a header of 32
bytes, then float32 (F, V, 3), all little-endian; places in m. What is not known is on a straight line between what is
known before and after, and stands still before the first and after the last, as curves of keys do.
"""

import hashlib
import struct
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Self

import numpy as np

from ..core.data.errors import InputError, JobError
from ..core.data.markersets import Worn
from ..core.data.takes import Motion
from .source import open_binary
from .tables import RowFile

PC2_HEADER = struct.Struct("<12siiffi")  # mark, version, vertices, first frame, frames a sample, samples
PC2_MARK, PC2_VERSION = b"POINTCACHE2\0", 1


# How a cache is written and known again; memory, and so that a longer file is told in no time.
PART_BYTES = 8 * 1024 * 1024  # that are worked on at once
MARK_BYTES = 65536  # bytes at each of three places that a file is known again by, beside its size


def write_cache(path: Path, parts: Iterator[np.ndarray], absent: np.ndarray):
    """Writes frames (F, V, 3), part by part; what is never known is as in `absent` (V, 3), else NaN means not known."""
    frames = 0
    with path.open("w+b") as file:
        file.write(PC2_HEADER.pack(PC2_MARK, PC2_VERSION, len(absent), 0.0, 1.0, 0))
        for part in parts:
            file.write(np.ascontiguousarray(part, "<f4").data)
            frames += len(part)
        file.seek(0)
        file.write(PC2_HEADER.pack(PC2_MARK, PC2_VERSION, len(absent), 0.0, 1.0, frames))
    if frames and absent.size:
        _bridge(np.memmap(path, "<f4", "r+", PC2_HEADER.size, (frames, absent.size)), absent.ravel())


def _bridge(table: np.memmap, absent: np.ndarray):
    """Puts straight lines through what is not known: once backwards for what comes after each part, once forwards."""
    columns = table.shape[1]
    size = max(PART_BYTES // (4 * columns), 1)
    starts = range(0, len(table), size)
    later, after = [], (np.full(columns, np.inf), absent.astype(float))
    for start in reversed(starts):
        later.append(after)
        after = _first_known(table[start : start + size], start, after)
    # Before the first that is known there is nothing to go from, and where nothing ever is, nothing to go to.
    before = (np.full(columns, -np.inf), after[1])
    for start, after in zip(starts, reversed(later), strict=True):
        values = table[start : start + size]
        known = _first_known(values[::-1], 0, (np.full(columns, np.inf), before[1]))
        last = np.where(np.isfinite(known[0]), start + len(values) - 1 - known[0], before[0]), known[1]
        for column in np.flatnonzero(~np.isfinite(values).all(axis=0)):
            ends = [(side[0][column], side[1][column]) for side in (before, after)]
            values[:, column] = _bridged(values[:, column], start, *ends)
        before = last


def _first_known(values: np.ndarray, start: int, else_: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """When (C,) each column of (n, C) is first known, and its value then; `else_` where it never is."""
    known = np.isfinite(values)
    first = known.argmax(axis=0)
    any_, columns = known.any(axis=0), np.arange(values.shape[1])
    return np.where(any_, start + first, else_[0]), np.where(any_, values[first, columns], else_[1])


def _bridged(values: np.ndarray, start: int, before: tuple[float, float], after: tuple[float, float]) -> np.ndarray:
    """A column (n,) without gaps, with what is known of it, frame and value, before and after; infinite for nothing."""
    frames = start + np.arange(len(values))
    known = np.isfinite(values)
    ends = [[end] if np.isfinite(end[0]) else [] for end in (before, after)]
    at = np.array([*(e[0] for e in ends[0]), *frames[known], *(e[0] for e in ends[1])], float)
    of = np.array([*(e[1] for e in ends[0]), *values[known], *(e[1] for e in ends[1])], float)
    return np.interp(frames, at, of) if len(at) else np.full(len(values), before[1])


def cache_mark(path: Path) -> str:
    """What a cache is known again by: its size, and a digest of its begin, middle and end."""
    digest, size = hashlib.sha256(), path.stat().st_size
    with open_binary(path) as file:
        for place in (0, size // 2, max(size - MARK_BYTES, 0)):
            file.seek(place)
            digest.update(file.read(MARK_BYTES))
    return f"{size} {digest.hexdigest()}"


def check_cache(path: Path, mark: str):
    """Raises InputError where the file at `path` is not the cache with this mark, saying what it is."""
    if not path.exists():
        raise InputError("is not there; expected the motion beside the Blender file (Find Motion)", path)
    try:
        with open_binary(path) as file:
            head = file.read(PC2_HEADER.size)
        size = path.stat().st_size
        if len(head) < PC2_HEADER.size or not head.startswith(PC2_MARK):
            raise InputError("is no point cache; expected the motion that was saved with this Blender file", path)
        if size < int(mark.split(maxsplit=1)[0]):
            raise InputError("is shorter than it was saved; expected the whole file, copied anew", path)
        if cache_mark(path) != mark:
            raise InputError("is of another take or another labelling; expected the one saved with this file", path)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error}); expected a file that can", path) from None


# When a take is played from a file beside the Blender file, instead of by keys; memory. Opened, each key takes some 240
# bytes with Blender's undo and the tables of the take.
MOST_KEYS = 6_000_000  # that a Blender file holds, of markers and bones: 1.4 GB
MOST_SHOWN = 30_000_000  # keys that a scene is given in which somebody works: 7 GB
# times as many keys, when they are foreseen from what part of the file was read: then what they are made of is not kept
FORESEEN = 2.0
FORESEEN_FROM = 1000  # frames that were read before anything is foreseen
SAMPLED_FRAMES = 2048  # which the build of a long take's bodies is the median of, at least half as many
KEYS_A_MARKER, KEYS_A_BONE, BYTES_A_KEY = 3, 7, 240  # numbers a frame


def is_long(frames: int, markers: int, joints: int) -> bool:
    """Whether a take of so many frames, markers and joints is too long for keys."""
    keys = KEYS_A_MARKER * markers + KEYS_A_BONE * joints
    return frames * keys > MOST_KEYS


def refuse_keys(frames: int, worn: Worn, read: float = 0.0):
    """Raises JobError where the keys of so many frames of these markers would fill the memory of a scene that is open.

    So it is where the frames are the part `read` of a file that promises to have so many; 0 where that is not known.
    """
    if read > 0 and frames >= FORESEEN_FROM:
        frames = max(frames, int(frames / read / FORESEEN))
    keys = KEYS_A_MARKER * len(worn.markers) + KEYS_A_BONE * sum(len(one.skeleton) for _, one in worn.worn)
    most = MOST_SHOWN // keys
    if frames > most:
        words = f"has {frames:,} frames, whose keys take some {frames * keys * BYTES_A_KEY / 1e9:.0f} GB in a scene"
        way = "choose a part of it with Frames, or use Label Folder, whose Blender file plays a take of any length"
        raise JobError(f"{words}; expected at most {most:,}: {way}")


class PoseFile:
    """The poses of a take on disk, and evenly spaced frames of it in memory; use it as a context manager.

    frames       how many there are so far
    first_frame  the source's number of the first
    expected     (M, 3) m where the body carries each marker at first, NaN where it never does
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self.frames, self.first_frame, self.expected = 0, 0, np.zeros((0, 3))
        self.sample: list[Motion] = []
        self._step, self._foreseen, self._joints = 1, False, 0
        self._file = RowFile(folder, np.dtype(np.float32))

    def __enter__(self) -> Self:
        self._file.__enter__()
        return self

    def __exit__(self, *raised: object):
        self._file.__exit__(*raised)

    @property
    def long(self) -> bool:
        """Whether the take is too long for keys."""
        return self._foreseen or is_long(self.frames, len(self.expected), self._joints)

    def append(self, motion: Motion, fraction: float = 1.0):
        """Adds the frames of the next chunk, after which such a `fraction` of the take was read."""
        if not self.frames:
            self.first_frame, self._joints = int(motion.frames[0]), motion.joints.shape[1]
            self.expected = np.full(motion.expected.shape[1:], np.nan)
            kinds = [("joints", np.float32, (self._joints, 3)), ("rotations", np.float32, (self._joints, 3, 3))]
            self._file.kind = np.dtype(kinds)
        rows = np.empty(len(motion.frames), self._file.kind)
        rows["joints"], rows["rotations"] = motion.joints, motion.rotations
        self._file.append(rows)
        self._note(motion)
        self.frames += len(motion.frames)
        if self.frames >= FORESEEN_FROM and 0 < fraction < 1:
            whole = int(self.frames / fraction / FORESEEN)
            self._foreseen |= is_long(whole, len(self.expected), self._joints)

    def parts(self, size: int, around: int = 0) -> Iterator[tuple[slice, slice, np.ndarray, np.ndarray]]:
        """Which frames, so many at a time, and joints (n, J, 3) and rotations (n, J, 3, 3) of these and those around.

        The second slice says where the frames are in what is given.
        """
        rows = self._file.rows()
        for start in range(0, self.frames, size):
            part, first = slice(start, min(start + size, self.frames)), max(start - around, 0)
            wide, inner = slice(first, part.stop + around), slice(start - first, part.stop - first)
            yield part, inner, rows["joints"][wide].astype(float), rows["rotations"][wide].astype(float)

    def sampled(self) -> Motion:
        """Evenly spaced frames of the take."""
        return _joined(self.sample)

    def _note(self, motion: Motion):
        """Keeps what of the chunk the sample wants: each frame whose number is a multiple of the step."""
        known = np.isfinite(motion.expected).all(axis=2)
        fresh = known.any(axis=0) & ~np.isfinite(self.expected).all(axis=1)
        self.expected[fresh] = motion.expected[known.argmax(axis=0)[fresh], np.flatnonzero(fresh)]
        self.sample.append(_picked(motion, np.arange(-self.frames % self._step, len(motion.frames), self._step)))
        if sum(len(one.frames) for one in self.sample) > SAMPLED_FRAMES:
            whole = _joined(self.sample)
            while len(whole.frames) > SAMPLED_FRAMES:
                whole, self._step = _picked(whole, np.arange(0, len(whole.frames), 2)), 2 * self._step
            self.sample = [whole]


def _picked(motion: Motion, rows: np.ndarray) -> Motion:
    return Motion(*(getattr(motion, field.name)[rows] for field in fields(Motion)))


def _joined(parts: list[Motion]) -> Motion:
    return Motion(*(np.concatenate([getattr(one, field.name) for one in parts]) for field in fields(Motion)))
