# SPDX-License-Identifier: GPL-3.0-or-later
"""The poses of a long take on disk while it is labelled, for a Blender file that plays it without keys."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Self

import numpy as np

from ..core.data.errors import JobError
from ..core.data.markersets import Worn
from ..core.data.takes import Motion
from .scratch import RowFile


@dataclass(frozen=True)
class PlayedOptions:
    """When a take is played from a file beside the Blender file, instead of by keys; memory.

    most_keys      that a Blender file holds, of markers and bones; opened, each takes some 240 bytes with Blender's
                   undo and the tables of the take, so that these are 1.4 GB
    most_shown     keys that a scene is given in which somebody works, 7 GB of them
    foreseen       times as many keys, when they are foreseen from what part of the file was read: then what keys are
                   made of is not even gathered
    foreseen_from  frames that were read before anything is foreseen
    sample_frames  which the build of a long take's bodies is the median of, at least half as many
    """

    most_keys: int = 6_000_000
    most_shown: int = 30_000_000
    foreseen: float = 2.0
    foreseen_from: int = 1000
    sample_frames: int = 2048


PLAYING = PlayedOptions()
KEYS_A_MARKER, KEYS_A_BONE, BYTES_A_KEY = 3, 7, 240  # numbers a frame


def is_long(frames: int, markers: int, joints: int, options: PlayedOptions | None = None) -> bool:
    """Whether a take of so many frames, markers and joints is too long for keys."""
    keys = KEYS_A_MARKER * markers + KEYS_A_BONE * joints
    return frames * keys > (options or PLAYING).most_keys


def refuse_keys(frames: int, worn: Worn, read: float = 0.0, options: PlayedOptions | None = None):
    """Raises JobError where the keys of so many frames of these markers would fill the memory of a scene that is open.

    So it is where the frames are the part `read` of a file that promises to have so many; 0 where that is not known.
    """
    options = options or PLAYING
    if read > 0 and frames >= options.foreseen_from:
        frames = max(frames, int(frames / read / options.foreseen))
    keys = KEYS_A_MARKER * len(worn.markers) + KEYS_A_BONE * sum(len(one.skeleton) for _, one in worn.worn)
    most = options.most_shown // keys
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

    def __init__(self, folder: Path, options: PlayedOptions | None = None):
        self.folder, self.options = folder, options or PLAYING
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
        return self._foreseen or is_long(self.frames, len(self.expected), self._joints, self.options)

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
        if self.frames >= self.options.foreseen_from and 0 < fraction < 1:
            whole = int(self.frames / fraction / self.options.foreseen)
            self._foreseen |= is_long(whole, len(self.expected), self._joints, self.options)

    def parts(self, size: int) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """Which frames, their joints (n, J, 3) and rotations (n, J, 3, 3), so many at a time."""
        rows = self._file.rows()
        for start in range(0, self.frames, size):
            part = slice(start, min(start + size, self.frames))
            yield part, rows["joints"][part].astype(float), rows["rotations"][part].astype(float)

    def sampled(self) -> Motion:
        """Evenly spaced frames of the take."""
        return _joined(self.sample)

    def _note(self, motion: Motion):
        """Keeps what of the chunk the sample wants: each frame whose number is a multiple of the step."""
        known = np.isfinite(motion.expected).all(axis=2)
        fresh = known.any(axis=0) & ~np.isfinite(self.expected).all(axis=1)
        self.expected[fresh] = motion.expected[known.argmax(axis=0)[fresh], np.flatnonzero(fresh)]
        self.sample.append(_picked(motion, np.arange(-self.frames % self._step, len(motion.frames), self._step)))
        if sum(len(one.frames) for one in self.sample) > self.options.sample_frames:
            whole = _joined(self.sample)
            while len(whole.frames) > self.options.sample_frames:
                whole, self._step = _picked(whole, np.arange(0, len(whole.frames), 2)), 2 * self._step
            self.sample = [whole]


def _picked(motion: Motion, rows: np.ndarray) -> Motion:
    return Motion(*(getattr(motion, field.name)[rows] for field in fields(Motion)))


def _joined(parts: list[Motion]) -> Motion:
    return Motion(*(np.concatenate([getattr(one, field.name) for one in parts]) for field in fields(Motion)))
