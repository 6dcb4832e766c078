# SPDX-License-Identifier: GPL-3.0-or-later
"""A labelled take as the file keeps it, read back as plain arrays."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..core.data.errors import InputError
from ..core.data.takes import Blobs, EditOutcome, Labels, Motion, PointRows, Suspect
from ..core.edits.following import Group
from ..core.edits.following_blobs import BlobGroup
from ..core.edits.kinds import NO_EDITS, Edits
from ..core.filling.kept import KeptFill, filled_samples
from ..core.geometry.cameras import Cameras


@dataclass(frozen=True, eq=False)
class Stored:
    """What the file keeps of a take: as `Take`, with the names of the markers for the marker set.

    shift     added to the source's frame numbers to get Blender's
    words     index of each marker by its name, aliases too
    edits     what a person said of the labels, which these follow
    outcomes  what became of each edit
    model     the name of the marker set
    parents   of each joint of the skeleton, -1 for the root; none where the file does not keep them
    segments  the names of what turns about these joints; none where the file does not keep them
    fills     gaps that were filled; `motion` has those that go with it
    unfit     why each fill does not go with the take as it is now, "" where it does
    measured  the motion without fills and not smoothed; None where that is `motion`
    cutoff    Hz, by which `motion` is smoothed; None where it is not
    placed    index of the frame and marker of each that a person placed
    groups    what the edits make of the take, for telling what one more of them changes
    own_labels  whether the labels are what the program gave before any edit; not so of blobs of the first versions
    """

    name: str
    rate: float
    cameras: Cameras
    names: tuple[str, ...]
    rows: Blobs | PointRows
    labels: Labels
    motion: Motion
    suspects: tuple[Suspect, ...]
    source: str
    shift: int
    words: Mapping[str, int] = field(default_factory=dict)
    edits: Edits = NO_EDITS
    outcomes: tuple[EditOutcome, ...] = ()
    model: str = ""
    parents: tuple[int, ...] = ()
    segments: tuple[str, ...] = ()
    fills: tuple[KeptFill, ...] = ()
    unfit: tuple[str, ...] = ()
    measured: Motion | None = None
    cutoff: float | None = None

    @property
    def unfilled(self) -> Motion:
        """The motion with nothing in it but what was measured, or placed by hand."""
        return self.motion if self.measured is None else self.measured

    @property
    def fitting(self) -> tuple[KeptFill, ...]:
        """The fills that are in the motion."""
        return tuple(fill for fill, reason in zip(self.fills, self.unfit, strict=True) if not reason)

    def filled(self) -> np.ndarray:
        """(F, M) True where a sample was filled."""
        return filled_samples(self.motion.frames, self.names, self.fitting)

    def filled_markers(self) -> dict[int, np.ndarray]:
        """(F,) True where a sample was filled, of each marker that was filled at all, by its index."""
        fills = self.fitting
        names = tuple(dict.fromkeys(fill.marker for fill in fills))
        flags = filled_samples(self.motion.frames, names, fills)
        return {self.names.index(name): column for name, column in zip(names, flags.T, strict=True)}

    placed: tuple[tuple[int, int], ...] = ()
    groups: tuple[Group | BlobGroup, ...] = ()
    own_labels: bool = True

    def source_frame(self, current: int) -> int:
        """Blender's current frame in the source's numbers; InputError outside the take."""
        frame, first, last = current - self.shift, int(self.motion.frames[0]), int(self.motion.frames[-1])
        if not first <= frame <= last:
            words = f"expected one of the take, {first + self.shift} to {last + self.shift}"
            raise InputError(f"the current frame is {current}; {words}")
        return frame


def differ_by_edits(one: Stored, other: Stored) -> bool:
    """Whether two takes are one of points with different edits, the same fills in both, and neither smoothed."""
    if not isinstance(one.rows, PointRows):
        return False  # of blobs nothing says what an edit changes
    same = one.rows is other.rows and one.motion.expected is other.motion.expected
    same_fills = one.fills is other.fills and one.unfit == other.unfit
    return same and same_fills and one.cutoff is None and other.cutoff is None
