# SPDX-License-Identifier: GPL-3.0-or-later
"""What goes into the labelling and what comes out of it: blobs, labels and the motion of the markers."""

from dataclasses import dataclass, field

import numpy as np

# How a blob came by its name: the three steps of the first paper's algorithm 1. The index is what `Labels.step` holds.
STEPS = ("", "exclusive", "conflict", "remaining")
NO_STEP, EXCLUSIVE, CONFLICT, REMAINING = range(len(STEPS))
NO_MARKER = -1

# C3D files count frames no further than this, and blob files neither.
LARGEST_FRAME = 2**32 - 1


@dataclass(frozen=True, eq=False)
class Blobs:
    """The blobs of F consecutive frames of a take, N in all, in the order of their file.

    frames  (F,) the source's own frame numbers, ascending; a frame without blobs is in the list too
    frame   (N,) index into `frames`
    camera  (N,) index of the camera
    xy      (N, 2) px, lens included
    area    (N,) px², NaN where unknown
    """

    frames: np.ndarray
    frame: np.ndarray
    camera: np.ndarray
    xy: np.ndarray
    area: np.ndarray

    def __len__(self) -> int:
        return len(self.frame)


@dataclass(frozen=True, eq=False)
class Labels:
    """The names of N blobs, row for row.

    marker      (N,) index into the marker set's markers, NO_MARKER where unnamed
    step        (N,) index into STEPS
    confidence  (N,) 0 to 1; 0 where unnamed
    """

    marker: np.ndarray
    step: np.ndarray
    confidence: np.ndarray


@dataclass(frozen=True, eq=False)
class Motion:
    """The person in F frames: the markers in space and the pose of the fitted body.

    frames       (F,) the source's own frame numbers
    markers      (F, M, 3) m, triangulated from two or more cameras; NaN in gaps
    residual     (F, M) how far the rays of a marker's blobs miss its point, root mean square, m
    residual_px  (F, M) the same as reprojection error, px
    conflicts    (F, M) number of blobs of the marker that were in conflict
    expected     (F, M, 3) m, where the fitted body carries each marker, seen or not
    joints       (F, J, 3) m, positions of the skeleton's joints
    rotations    (F, J, 3, 3) world rotation of each segment; the identity is the rest pose
    scale        (F, 3) S of the paper's equation 6: m for one unit of the marker set, along x y z
    confidence   (F,) 0 to 1, how sure the placement is; 0 where nobody was found (poses are NaN there)
    """

    frames: np.ndarray
    markers: np.ndarray
    residual: np.ndarray
    residual_px: np.ndarray
    conflicts: np.ndarray
    expected: np.ndarray
    joints: np.ndarray
    rotations: np.ndarray
    scale: np.ndarray
    confidence: np.ndarray


@dataclass(frozen=True)
class Suspect:
    """A range of frames (the source's numbers, both included) that a person should look at, and why.

    words       what is the matter; of one trajectory only what it does, such as "goes over from A to B"
    trajectory  the number of that trajectory, None where it is about something else
    """

    first: int
    last: int
    words: str
    trajectory: int | None = None

    @property
    def reason(self) -> str:
        """Why to look, for a person to read."""
        return self.words if self.trajectory is None else f"trajectory {self.trajectory} {self.words}"


@dataclass(frozen=True, eq=False)
class LabelledChunk:
    """What the labelling says of one chunk of blobs: `labels` row for row with it, `motion` frame for frame."""

    labels: Labels
    motion: Motion
    suspects: tuple[Suspect, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Points:
    """A take of 3D points: P trajectories over T frames.

    names        P labels as in the file; an unlabelled trajectory has an empty name
    xyz          (T, P, 3) m, z up; NaN where missing
    residual     (T, P) m, NaN where missing or unknown
    rate         frames a second
    first_frame  the source's number of the first frame
    """

    names: tuple[str, ...]
    xyz: np.ndarray
    residual: np.ndarray
    rate: float
    first_frame: int
