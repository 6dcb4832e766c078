# SPDX-License-Identifier: GPL-3.0-or-later
"""Points a person to the frames that are worth a look: markers that leave the body, or move as no marker moves."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..data.physical import MARKER_LIMITS
from ..data.takes import Motion, Suspect
from ..data.wording import listed

# physical: m, between a marker and where the fitted body has it: soft tissue moves skin by up to 40 mm (Leardini and
# others 2005), and clothes move on it.
MAX_OFF_BODY_M = 0.07  # physical
MOMENT_S = 0.25  # physical: s, about as long as it takes a person to see something; shorter is no finding of its own
MAX_BREAK_FRAMES = 5  # format: between two findings that a list shows as one range
MAX_ALIKE = 2  # format: findings with one reason that have entries of their own; more are one entry
MAX_ENTRIES = 40  # format: in a list of doubtful ranges, as many as a person works through
FAR_OFF, JUMPS = "is far from where the body has it", "jumps"
EITHER_WAY = "may be either way round"  # what is said of two markers without a name
NOT_TOLD = "do not tell which is which"  # of blobs that a person named as one of them, of neither of which they were
OF_ROOM = "the room seems"  # how sentences about a room as a whole begin


def find_suspects(motion: Motion, names: tuple[str, ...], rate: float) -> tuple[Suspect, ...]:
    """Ranges of frames in which a marker is doubtful, marker by marker.

    `names` are the M markers' names and `rate` the frames a second of `motion`.
    """
    return suspects_of(*doubtful_flags(motion, rate), motion.frames, names)


def doubtful_flags(motion: Motion, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """(F, M) True where a marker is far from where the body has it, and (F, M) where it jumps.

    It does where it is accelerated as no marker is: in the middle one of three frames in a row.
    """
    off_body = np.linalg.norm(motion.markers - motion.expected, axis=-1) > MAX_OFF_BODY_M
    jumps = np.zeros(off_body.shape, dtype=bool)
    if len(jumps) > 2:
        change = np.linalg.norm(np.diff(motion.markers, 2, axis=0), axis=-1) * rate**2
        jumps[1:-1] = change > MARKER_LIMITS.max_impact_m_s2
    return off_body, jumps


def suspects_of(
    off_body: np.ndarray, jumps: np.ndarray, frames: np.ndarray, names: tuple[str, ...]
) -> tuple[Suspect, ...]:
    """What `doubtful_flags` (F, M) say, as ranges of the frames (F,), by the source's numbers."""
    found = []
    for index, name in enumerate(names):
        for doubtful, what in ((off_body, FAR_OFF), (jumps, JUMPS)):
            found += suspect_ranges(frames, doubtful[:, index], f"{name} {what}", MAX_BREAK_FRAMES, (name,))
    return tuple(sorted(found, key=lambda suspect: suspect.first))


def summarised(suspects: Sequence[Suspect], rate: float) -> tuple[Suspect, ...]:
    """The suspects as a list that a person can work through, those of the whole take first.

    Findings with one reason that are close in time, or many, become one; where there are still too many, so do
    findings of one kind about different markers. Nothing is dropped. `rate` is in frames a second.
    """
    reasons: dict[str, list[Suspect]] = {}
    for suspect in sorted(suspects, key=lambda one: one.first):
        reasons.setdefault(suspect.reason, []).append(suspect)
    entries = [entry for found in reasons.values() for entry in _of_one_reason(found, MOMENT_S * rate)]
    while len(entries) > MAX_ENTRIES:
        kinds: dict[str, list[Suspect]] = {}
        for entry in entries:
            kinds.setdefault(_kind(entry.reason), []).append(entry)
        kind, many = max(kinds.items(), key=lambda item: len(item[1]))
        if len(many) < 2:
            break
        entries = [entry for entry in entries if _kind(entry.reason) != kind] + [_of_one_kind(many)]
    return tuple(sorted(entries, key=lambda one: (one.first, -one.last)))


def _of_one_reason(found: list[Suspect], max_break: float) -> list[Suspect]:
    """Findings in the order of their first frames, joined where they are close, or all where they are many."""
    joined = [found[0]]
    for suspect in found[1:]:
        last = joined[-1]
        if suspect.first <= last.last + 1 + max_break:
            joined[-1] = _as_one([last, suspect], suspect.words)
        else:
            joined.append(suspect)
    if len(joined) <= MAX_ALIKE:
        return joined
    return [_as_one(joined, f"{joined[0].words}, in {len(joined)} places")]


def _as_one(found: list[Suspect], words: str) -> Suspect:
    """One entry for several, which is about the frames and markers of all."""
    first, last = min(one.first for one in found), max(one.last for one in found)
    return replace(
        found[0],
        first=first,
        last=last,
        words=words,
        markers=tuple(dict.fromkeys(name for one in found for name in one.markers)),
        doubtful=min(sum(one.frames for one in found), last - first + 1),  # they may share some
    )


def _kind(reason: str) -> str:
    """What is said, without of whom: the first word of a reason, or a trajectory's number, is whom."""
    words = reason.split(", in ", maxsplit=1)[0].split(" ")
    return " ".join(["trajectory", *words[2:3]] if words[0] == "trajectory" else words[1:])


def _of_one_kind(found: list[Suspect]) -> Suspect:
    """One entry for findings of one kind about several markers or trajectories."""
    tracks = found[0].reason.startswith("trajectory ")
    whom = list(dict.fromkeys(suspect.reason.split(" ")[1 if tracks else 0] for suspect in found))
    who = listed(whom, " ")
    words = f"trajectories {who}: as {found[0].reason}" if tracks else f"{who}: {_kind(found[0].reason)}"
    return replace(_as_one(found, words), trajectory=None)


def suspect_ranges(
    frames: np.ndarray, doubtful: np.ndarray, words: str, max_break_frames: int, markers: tuple[str, ...] = ()
) -> list[Suspect]:
    """The doubtful frames (F,) as ranges of the source's numbers (F,); breaks of up to so many frames are bridged.

    `markers` are those that it is about.
    """
    found = runs(doubtful, max_break_frames)
    return [Suspect(int(frames[start]), int(frames[stop - 1]), words, markers=markers) for start, stop in found]


def runs(flags: np.ndarray, max_break: int = 1) -> list[tuple[int, int]]:
    """Where flags (F,) are set, as ranges (start, stop) without `stop`; steps of up to `max_break` are bridged."""
    at = np.flatnonzero(flags)
    ends = np.flatnonzero(np.diff(at) > max_break)
    starts, stops = at[np.append(0, ends + 1)[: len(at)]], at[np.append(ends, -1)[: len(at)]] + 1
    return list(zip(starts.tolist(), stops.tolist(), strict=True))


class Ranges:
    """Ranges of frames of each of M markers, gathered over chunks: (first, last, worst value, sum of the values)."""

    def __init__(self, count: int):
        self.of: list[list[tuple[int, int, float, float]]] = [[] for _ in range(count)]

    def add(self, frames: np.ndarray, flags: np.ndarray, values: np.ndarray | None = None):
        """Adds the flagged frames of a chunk (F,), flags (M, F); values (M, F) of which the worst and sum are kept."""
        for marker in np.flatnonzero(flags.any(axis=1)).tolist():
            mine = self.of[marker]
            for start, stop in runs(flags[marker]):
                part = np.zeros(1) if values is None else values[marker, start:stop]
                first, last = int(frames[start]), int(frames[stop - 1])
                worst, total = float(part.max()), float(part.sum())
                if mine and mine[-1][1] + 1 == first:
                    before = mine.pop()
                    first, worst, total = before[0], max(before[2], worst), before[3] + total
                mine.append((first, last, worst, total))

    def spans(self, marker: int) -> list[list[int]]:
        """First and last frame of each range of a marker."""
        return [[first, last] for first, last, _, _ in self.of[marker]]

    def lengths(self, marker: int) -> list[int]:
        """How many frames each of its ranges is of."""
        return [last - first + 1 for first, last, _, _ in self.of[marker]]


def cameras_in(words: str, names: Sequence[str]) -> tuple[str, ...]:
    """The cameras, of these names, that a sentence of `CameraCheck` is about; none where it is about something else."""
    return tuple(name for name in names if _is_about(words, name))


def _is_about(words: str, name: str) -> bool:
    # By what stands around a name, as cameras may be called 1, 2 and 12, and the sentences hold figures.
    single = words.startswith((f"camera {name} seems ", f"camera {name} shows ", f"cameras {name} and "))
    return single or f" and {name} seem to have " in words or f" of {name} fit the calibration " in words
