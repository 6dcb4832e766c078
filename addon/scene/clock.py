# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of Blender's frames a take's frames are: the one place where the two ways to count meet."""

import math
from dataclasses import dataclass
from typing import Self

import bpy
import numpy as np

from ..core.data.errors import JobError

LAST_FRAME = 1048574  # Blender's last frame
RATE_ROUNDING = 1e-4  # of a rate, that Blender rounds
KEYS_APART = 0.02  # of Blender's frames, to which keys 0.01 apart are one, and each is rounded
# What is nearest to a moment between two frames is the later one, also where single precision puts it a bit before.
TIES_UP = 0.5 + 1 / 1024


def fps_of(scene: bpy.types.Scene) -> float:
    """How many frames a second a scene plays."""
    return scene.render.fps / scene.render.fps_base


def is_rate(fps: float, rate: float) -> bool:
    """Whether two rates are the same but for what Blender rounds."""
    return math.isclose(fps, rate, rel_tol=RATE_ROUNDING)


def plays_at(scene: bpy.types.Scene, rate: float) -> bool:
    """Whether a scene has a rate, but for what Blender rounds."""
    return is_rate(fps_of(scene), rate)


@dataclass(frozen=True)
class TakeClock:
    """Blender's frame of the source's frame `first` is `start`; of each further one it is `step` more.

    `step` is the scene's rate over the take's, 1 where the scene plays frame by frame what was recorded.
    """

    first: int = 0
    start: int = 0
    step: float = 1.0

    @classmethod
    def of(cls, frames: np.ndarray, start: int | None = None) -> Self:
        """That of a take of the source's frames (F,), frame by frame: with its own numbers, or from `start` on.

        From 1 on where Blender cannot count so far, or below 0. JobError where there are more than it counts.
        """
        if not len(frames):
            return cls()
        first, last = int(frames[0]), int(frames[-1])
        if last - first >= LAST_FRAME:
            raise JobError(
                f"goes from frame {first} to {last}; expected at most {LAST_FRAME} frames, which is how far "
                "Blender counts, so choose some of them"
            )
        own = 1 if first < 0 or last > LAST_FRAME else first
        return cls(first, own if start is None else start)

    def at_rate(self, fps: float, rate: float) -> "TakeClock":
        """The same of a take of `rate` in a scene that plays `fps` frames a second."""
        return TakeClock(self.first, self.start, 1.0 if rate <= 0 or is_rate(fps, rate) else fps / rate)

    def fits(self, last: int) -> bool:
        """Whether Blender counts to where the source's frame `last` is shown, and tells those around it apart."""
        end = self.shown(last)
        apart = self.step >= KEYS_APART and np.spacing(np.float32(end)) <= self.step / 2
        return self.step == 1 or bool(end <= LAST_FRAME and apart)

    @property
    def shift(self) -> int:
        """What is added to the source's frames to count them as Blender does where it plays frame by frame."""
        return self.start - self.first

    def shown(self, frames):
        """Blender's frames, whole ones where those of the take are, of a frame of the source or of some (F,)."""
        after = frames - self.first
        return self.start + (after if self.step == 1 else after * self.step)

    def whole(self, frame: float) -> int:
        """Blender's whole frame nearest to a frame of the source."""
        return math.floor(self.shown(frame) + 0.5)

    def at(self, now: float) -> int:
        """The source's frame that is nearest in a moment of Blender's time, in the take or not."""
        return self.first + math.floor((now - self.start) / self.step + TIES_UP)

    def inside(self, first: int, last: int) -> tuple[int, int]:
        """The source's first and last frame of those that are nearest to Blender's whole frames `first` to `last`."""
        begin, end = ((edge - self.start) / self.step for edge in (first - 0.5, last + 0.5))
        return self.first + math.ceil(begin), self.first + math.ceil(end) - 1

    def go_to(self, scene: bpy.types.Scene, frame: int):
        """Lets a scene show a frame of the source, whatever part of one of Blender's it begins at."""
        set_moment(scene, self.shown(frame))


def set_moment(scene: bpy.types.Scene, moment: float):
    """Makes a moment of Blender's time, a frame and maybe a part of one, the scene's current one."""
    scene.frame_set(math.floor(moment), subframe=moment - math.floor(moment))


def refresh_frame(scene: bpy.types.Scene):
    """Lets a scene show its current moment again, with what was changed in it."""
    scene.frame_set(scene.frame_current, subframe=scene.frame_subframe)
