# SPDX-License-Identifier: GPL-3.0-or-later
"""A labelled take as the file keeps it, read back as plain arrays."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from zlib import crc32

import numpy as np

from ..core.data.errors import InputError
from ..core.data.takes import Blobs, EditOutcome, Labels, Motion, PointRows, Suspect
from ..core.edits.following import Held, changed_frames
from ..core.edits.kinds import NO_EDITS, Edits
from ..core.filling.kept import KeptFill, filled_samples, fills_by_marker
from ..core.geometry.cameras import Cameras
from .clock import TakeClock
from .performers import Performer, performers_in_row, rows_of

MIXING = np.uint64(0x9E3779B97F4A7C15)  # format: odd, its bits as if by lot; by another all kept bodies are old


@dataclass(frozen=True, eq=False)
class Stored:
    """What the file keeps of a take: as `Take`, with the names of the markers for the marker set."""

    name: str
    rate: float
    cameras: Cameras
    names: tuple[str, ...]
    rows: Blobs | PointRows
    labels: Labels
    motion: Motion
    suspects: tuple[Suspect, ...]
    source: str
    clock: TakeClock  # which of Blender's frames those of the take are
    words: Mapping[str, int] = field(default_factory=dict)  # index of each marker by its name, aliases too
    edits: Edits = NO_EDITS  # what a person said of the labels, which these follow
    outcomes: tuple[EditOutcome, ...] = ()  # what became of each edit
    model: str = ""  # the name of the marker set, or those of several
    performers: tuple[Performer, ...] = ()  # who is in the take
    # of each joint of the skeleton, -1 for the root; none where the file does not keep them
    parents: tuple[int, ...] = ()
    segments: tuple[str, ...] = ()  # the names of what turns about these joints; none where the file does not keep them
    fills: tuple[KeptFill, ...] = ()  # gaps that were filled; `motion` has those that go with it
    unfit: tuple[str, ...] = ()  # why each fill does not go with the take as it is now, "" where it does
    measured: Motion | None = None  # the motion without fills and not smoothed; None where that is `motion`
    cutoff: float | None = None  # Hz, by which `motion` is smoothed; None where it is not

    @property
    def unfilled(self) -> Motion:
        """The motion with nothing in it but what was measured, or placed by hand."""
        return self.motion if self.measured is None else self.measured

    @property
    def fitting(self) -> tuple[KeptFill, ...]:
        """The fills that are in the motion."""
        return tuple(fill for fill, reason in zip(self.fills, self.unfit, strict=True) if not reason)

    @cached_property
    def filled_markers(self) -> dict[int, np.ndarray]:
        """(F,) True where a sample was filled, of each marker that was filled at all, by its index."""
        fills = self.fitting
        names = tuple(dict.fromkeys(fill.marker for fill in fills))
        flags = filled_samples(self.motion.frames, names, fills)
        return {self.names.index(name): column for name, column in zip(names, flags.T, strict=True)}

    placed: tuple[tuple[int, int], ...] = ()  # index of the frame and marker of each that a person placed
    held: Held | None = None  # which rows are the markers by the edits, for telling what one more of them changes
    # (F,) the digests of the labels that the body was posed on; None where there is no body
    posed_on: np.ndarray | None = None

    @cached_property
    def label_digests(self) -> np.ndarray:
        """(F,) those of the labels as they are."""
        return digests_of(self.rows, self.labels, self.unfilled)

    @cached_property
    def body_digest(self) -> str:
        """That of the body: of the labels that it was posed on, and of how it is smoothed."""
        return "" if self.posed_on is None else digest_of(self.posed_on, self.cutoff)

    @cached_property
    def stale(self) -> np.ndarray:
        """(F,) True where the body was posed on other labels."""
        return np.zeros(len(self.motion.frames), bool) if self.posed_on is None else self.posed_on != self.label_digests

    def index_of(self, now: float) -> int:
        """Which of the take's frames is nearest in a moment of Blender's time; -1 outside."""
        frames = self.motion.frames
        at = self.clock.at(now) - int(frames[0]) if len(frames) else -1
        return at if 0 <= at < len(frames) else -1

    def index_here(self, now: float) -> int:
        """The same; InputError outside the take."""
        return self.source_frame(now) - int(self.motion.frames[0])

    def source_frame(self, now: float) -> int:
        """The same in the source's numbers; InputError outside the take."""
        frame, first, last = self.clock.at(now), int(self.motion.frames[0]), int(self.motion.frames[-1])
        if not first <= frame <= last:
            words = f"expected one of the take, {self.clock.whole(first)} to {self.clock.whole(last)}"
            raise InputError(f"the current frame is {now:g}; {words}")
        return frame


def digests_of(rows: Blobs | PointRows, labels: Labels, motion: Motion) -> np.ndarray:
    """(F,) whole numbers of 31 bits that are others where other rows are markers, or a person placed one elsewhere."""
    named, (frame, marker) = np.flatnonzero(labels.named), np.nonzero(motion.residual == 0)
    placed = motion.markers[frame, marker].astype(np.float32).view(np.uint32)
    facts = [np.column_stack([np.full(len(named), 3), named, labels.marker[named]])]
    facts += [np.column_stack([np.full(len(frame), axis), placed[:, axis], marker]) for axis in range(3)]
    return _sums(np.concatenate([rows.frame[named], *[frame] * 3]), np.concatenate(facts), len(rows.frames))


def _sums(frame: np.ndarray, facts: np.ndarray, frames: int) -> np.ndarray:
    """(F,) what facts (K, 3), whole numbers, of a frame each (K,) come to in each frame, in whatever order they are."""
    mixed = np.zeros(len(facts), np.uint64)
    for column in facts.T.astype(np.uint64):
        # Twice, with shifts between: of one product alone the sum stays when two rows exchange their markers.
        for shift in (32, 29):
            mixed = (mixed + column + np.uint64(1)) * MIXING
            mixed ^= mixed >> np.uint64(shift)
    # The sum of a frame's numbers of 31 bits is exact: it has far fewer than 2^22 of them.
    return np.bincount(frame, mixed >> np.uint64(33), frames).astype(np.int64) % 2**31


def digest_of(digests: np.ndarray, cutoff: float | None) -> str:
    """One digest of those of all frames, and of the cut-off by which they are smoothed, Hz."""
    return f"{crc32(digests.astype(np.int64).tobytes()):08x}" + ("" if cutoff is None else f" {cutoff:g} Hz")


def alone(stored: Stored, performer: Performer) -> Stored:
    """The take of one of its performers as a take of one: under the names of the marker set, without other points.

    What was said and doubted of all is left out, and so are the points without a name: nobody knows whose they are.
    """
    if not performer.name:
        return stored
    markers, first = performer.marker_rows, performer.markers[0]
    names = tuple(performer.own_name(name) for name in stored.names[markers])
    mine = (stored.labels.marker >= markers.start) & (stored.labels.marker < markers.stop)
    labels = stored.labels[mine]
    own = {one.name: getattr(stored.rows, one.name) for one in fields(stored.rows) if one.name != "frames"}
    fills = [
        (fill, why)
        for fill, why in zip(stored.fills, stored.unfit, strict=True)
        if fill.marker in stored.names[markers]
    ]
    return replace(
        stored,
        name=f"{stored.name} {performer.name}",
        names=names,
        rows=replace(stored.rows, **{name: None if kept is None else kept[mine] for name, kept in own.items()}),
        labels=replace(labels, marker=labels.marker - first),
        motion=performer.motion_of(stored.motion),
        suspects=(),
        words={name: index for index, name in enumerate(names)},
        edits=NO_EDITS,
        outcomes=(),
        model=performer.model,
        performers=performers_in_row([["", *rows_of([performer])[0][1:]]]),
        parents=tuple(max(above - performer.joints[0], -1) for above in stored.parents[performer.joint_rows]),
        segments=stored.segments[performer.joint_rows],
        fills=tuple(replace(fill, marker=performer.own_name(fill.marker)) for fill, _ in fills),
        unfit=tuple(why for _, why in fills),
        measured=None if stored.measured is None else performer.motion_of(stored.measured),
        placed=(),
        held=None,
    )


def changed_between(before: Stored, after: Stored, by_hand: bool = True) -> dict[int, slice] | None:
    """The markers that are elsewhere, or, with `by_hand`, of which edits say something else, and in which frames.

    By their indices. None where two takes differ by more than edits and fills that go with the one but not with the
    other.
    """
    same = before.rows is after.rows and before.fills is after.fills
    if not same or before.cutoff is not None or after.cutoff is not None:
        return None
    found = changed_frames(before.held, after.held, by_hand)
    if before.unfit == after.unfit:
        return found
    for marker, own in fills_by_marker(after.motion.frames, after.names, after.fills).items():
        for rows in (rows for number, rows in own if before.unfit[number] != after.unfit[number]):
            span = found.get(marker, rows)
            found[marker] = slice(min(span.start, rows.start), max(span.stop, rows.stop))
    return found
