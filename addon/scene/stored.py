# SPDX-License-Identifier: GPL-3.0-or-later
"""A labelled take as the file keeps it, read back as plain arrays."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..core.data.errors import InputError
from ..core.data.takes import Blobs, EditOutcome, Labels, Motion, PointRows, Suspect
from ..core.edits.following import Group
from ..core.edits.kinds import NO_EDITS, Edits
from ..core.geometry.cameras import Cameras


@dataclass(frozen=True, eq=False)
class Stored:
    """What the file keeps of a take: as `Take`, with the names of the markers for the marker set.

    shift     added to the source's frame numbers to get Blender's
    words     index of each marker by its name, aliases too
    edits     what a person said of the labels, which these follow
    outcomes  what became of each edit
    placed    index of the frame and marker of each that a person placed
    groups    what the edits make of the take, for telling what one more of them changes
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
    placed: tuple[tuple[int, int], ...] = ()
    groups: tuple[Group, ...] = ()

    def source_frame(self, current: int) -> int:
        """Blender's current frame in the source's numbers; InputError outside the take."""
        frame, first, last = current - self.shift, int(self.motion.frames[0]), int(self.motion.frames[-1])
        if not first <= frame <= last:
            words = f"expected one of the take, {first + self.shift} to {last + self.shift}"
            raise InputError(f"the current frame is {current}; {words}")
        return frame
