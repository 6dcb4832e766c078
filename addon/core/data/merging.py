# SPDX-License-Identifier: GPL-3.0-or-later
"""A range of a take that was labelled again, put into the take: nothing is there twice, and nothing outside is lost."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from .errors import InputError
from .takes import Blobs, Labels, Motion, PointRows, Suspect


@dataclass(frozen=True, eq=False)
class LabelledRange:
    """Consecutive frames of a take with all that is said of them."""

    rows: Blobs | PointRows  # N blobs or points
    labels: Labels  # (N,) row for row
    motion: Motion  # frame for frame with `rows.frames`
    suspects: tuple[Suspect, ...] = ()  # what to look at
    # (N,) the program's own labels, of which the edits give `labels`; None where they are these
    unedited: Labels | None = None

    @property
    def first(self) -> int:
        """The source's number of the first frame."""
        return int(self.motion.frames[0])

    @property
    def last(self) -> int:
        """The source's number of the last frame."""
        return int(self.motion.frames[-1])

    @property
    def own(self) -> Labels:
        """(N,) the program's own labels."""
        return self.labels if self.unedited is None else self.unedited


def can_merge(old: LabelledRange, new: LabelledRange) -> bool:
    """Whether two ranges are of the same kind of rows, the same markers and the same skeleton."""
    alike = type(old.rows) is type(new.rows)
    return alike and all(
        getattr(old.motion, name).shape[1:] == getattr(new.motion, name).shape[1:] for name in ("markers", "joints")
    )


def merged(old: LabelledRange, new: LabelledRange) -> LabelledRange:
    """The old range with the new one in its place: in the frames of `new` only what it says holds.

    Where the two do not touch, the frames between them are there with nothing in them. Raises InputError where they are
    not of one take.
    """
    if not can_merge(old, new):
        raise InputError("two ranges are of other markers or of another skeleton; expected ranges of one take")
    around = _cut(old, old.first, new.first - 1), new, _cut(old, new.last + 1, old.last)
    parts = [part for part in around if part is not None]
    whole: list[LabelledRange] = []
    for part in parts:
        if whole and part.first > whole[-1].last + 1:
            whole.append(_nothing(part, whole[-1].last + 1, part.first - 1))
        whole.append(part)
    return joined(whole)


def joined(parts: Sequence[LabelledRange]) -> LabelledRange:
    """Ranges that follow each other as one; suspects that touch and say the same become one."""
    edited = any(part.unedited is not None for part in parts)
    return LabelledRange(
        _joined_rows([part.rows for part in parts]),
        Labels.join(_bare(part.labels) for part in parts),
        Motion(*(np.concatenate([getattr(part.motion, one.name) for part in parts]) for one in fields(Motion))),
        _joined_suspects([suspect for part in parts for suspect in part.suspects]),
        Labels.join(_bare(part.own) for part in parts) if edited else None,
    )


def _bare(labels: Labels) -> Labels:
    """The labels without rates, which are not kept with a take."""
    return replace(labels, rate=None)


def _cut(one: LabelledRange, first: int, last: int) -> LabelledRange | None:
    """The frames of a range from `first` to `last`; None where there are none."""
    frames = np.flatnonzero((one.motion.frames >= first) & (one.motion.frames <= last))
    if not len(frames):
        return None
    begin, end = int(frames[0]), int(frames[-1]) + 1
    rows = slice(*np.searchsorted(one.rows.frame, [begin, end]).tolist())
    motion = Motion(*(getattr(one.motion, field.name)[begin:end] for field in fields(Motion)))
    first, last = int(motion.frames[0]), int(motion.frames[-1])
    suspects = [
        replace(suspect, first=max(suspect.first, first), last=min(suspect.last, last), doubtful=None)
        if suspect.first < first or suspect.last > last
        else suspect
        for suspect in one.suspects
        if suspect.first <= last and suspect.last >= first
    ]
    return LabelledRange(
        _rows_of(one.rows, rows, begin, end),
        one.labels[rows],
        motion,
        tuple(suspects),
        None if one.unedited is None else one.unedited[rows],
    )


def _rows_of(whole: Blobs | PointRows, rows: slice, begin: int, end: int) -> Blobs | PointRows:
    values = {one.name: getattr(whole, one.name) for one in fields(whole)}
    some = {name: None if value is None else value[rows] for name, value in values.items()}
    return type(whole)(**some | {"frames": whole.frames[begin:end], "frame": whole.frame[rows] - begin})


def _nothing(like: LabelledRange, first: int, last: int) -> LabelledRange:
    """Frames with nothing in them, of the same shapes."""
    frames = np.arange(first, last + 1)
    motion = {"frames": frames}
    for one in fields(Motion)[1:]:
        value = getattr(like.motion, one.name)
        fill = 0 if one.name in ("conflicts", "confidence") else np.nan
        motion[one.name] = np.full((len(frames), *value.shape[1:]), fill, value.dtype)
    none = _rows_of(like.rows, slice(0, 0), 0, 0)
    return LabelledRange(replace(none, frames=frames), Labels.none(0), Motion(**motion))


def _joined_rows(parts: list) -> Blobs | PointRows:
    if len(parts) == 1:
        return parts[0]
    if isinstance(parts[0], Blobs):
        return Blobs.join(parts)
    before = np.cumsum([0, *(len(part.frames) for part in parts)])[:-1]
    known = all(part.residual is not None for part in parts)
    return PointRows(
        np.concatenate([part.frames for part in parts]),
        np.concatenate([part.frame + start for part, start in zip(parts, before, strict=True)]),
        np.concatenate([part.trajectory for part in parts]),
        np.concatenate([part.xyz for part in parts]),
        np.concatenate([part.residual for part in parts]) if known else None,
    )


def _joined_suspects(suspects: list[Suspect]) -> tuple[Suspect, ...]:
    """Suspects in the order of their frames; those that were cut and say the same are one again."""
    joined: list[Suspect] = []
    for suspect in sorted(suspects, key=lambda one: (one.reason, one.first)):
        last = joined[-1] if joined else None
        if last is not None and last.reason == suspect.reason and suspect.first <= last.last + 1:
            joined[-1] = replace(last, last=max(last.last, suspect.last), doubtful=None)
        else:
            joined.append(suspect)
    return tuple(sorted(joined, key=lambda one: (one.first, -one.last)))
