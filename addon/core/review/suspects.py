# SPDX-License-Identifier: GPL-3.0-or-later
"""Points a person to the frames that are worth a look: markers that leave the body, or move as no marker moves."""

from collections.abc import Sequence

import numpy as np

from ..data.takes import Motion, Suspect

ASTRAY = 0.07  # m between a marker and where the fitted body has it
JERK = 600.0  # m/s², more than a marker on a person is ever accelerated
APART = 5  # frames between two findings that are one
BRIDGED = 0.25  # s between two findings with one reason that a person looks at as one
SEVERAL = 3  # findings with one reason from which on they are one entry
MOST = 40  # entries that a person works through
NAMED = 8  # markers named in an entry that is of many


def find_suspects(motion: Motion, names: tuple[str, ...], rate: float) -> tuple[Suspect, ...]:
    """Ranges of frames in which a marker is doubtful, marker by marker.

    `names` are the M markers' names and `rate` the frames a second of `motion`.
    """
    astray = np.linalg.norm(motion.markers - motion.expected, axis=-1) > ASTRAY
    jumps = _jumps(motion.markers, rate)
    found = []
    for index, name in enumerate(names):
        found += _ranges(motion.frames, astray[:, index], f"{name} is far from where the body has it")
        found += _ranges(motion.frames, jumps[:, index], f"{name} jumps")
    return tuple(sorted(found, key=lambda suspect: suspect.first))


def _jumps(markers: np.ndarray, rate: float) -> np.ndarray:
    """(F, M) True where a marker is accelerated beyond JERK: the middle one of three frames in a row."""
    jumps = np.zeros(markers.shape[:2], dtype=bool)
    if len(markers) > 2:
        change = np.linalg.norm(np.diff(markers, 2, axis=0), axis=-1) * rate**2
        jumps[1:-1] = change > JERK
    return jumps


def _ranges(frames: np.ndarray, doubtful: np.ndarray, reason: str) -> list[Suspect]:
    """The doubtful frames (F,) as ranges of the source's numbers; short interruptions are bridged."""
    at = np.flatnonzero(doubtful)
    if not len(at):
        return []
    breaks = np.flatnonzero(np.diff(at) > APART)
    firsts, lasts = np.append(at[0], at[breaks + 1]), np.append(at[breaks], at[-1])
    return [Suspect(int(frames[a]), int(frames[b]), reason) for a, b in zip(firsts, lasts, strict=True)]


def summarised(suspects: Sequence[Suspect], rate: float, most: int = MOST) -> tuple[Suspect, ...]:
    """The suspects as a list that a person can work through: at most about `most`, those of the whole take first.

    Findings with one reason that are close in time, or many, become one; where there are still too many, so do
    findings of one kind about different markers. Nothing is dropped. `rate` is in frames a second.
    """
    reasons: dict[str, list[Suspect]] = {}
    for suspect in sorted(suspects, key=lambda one: one.first):
        reasons.setdefault(suspect.reason, []).append(suspect)
    entries = [entry for reason, found in reasons.items() for entry in _of_one_reason(reason, found, BRIDGED * rate)]
    while len(entries) > most:
        kinds: dict[str, list[Suspect]] = {}
        for entry in entries:
            kinds.setdefault(_kind(entry.reason), []).append(entry)
        kind, many = max(kinds.items(), key=lambda item: len(item[1]))
        if len(many) < 2:
            break
        entries = [entry for entry in entries if _kind(entry.reason) != kind] + [_of_one_kind(many)]
    return tuple(sorted(entries, key=lambda one: (one.first, -one.last)))


def _of_one_reason(reason: str, found: list[Suspect], apart: float) -> list[Suspect]:
    """Findings in the order of their first frames, joined where they are close, or all where they are many."""
    joined = [found[0]]
    for suspect in found[1:]:
        last = joined[-1]
        if suspect.first <= last.last + 1 + apart:
            joined[-1] = Suspect(last.first, max(last.last, suspect.last), reason)
        else:
            joined.append(suspect)
    if len(joined) < SEVERAL:
        return joined
    return [Suspect(joined[0].first, max(one.last for one in joined), f"{reason}, in {len(joined)} places")]


def _kind(reason: str) -> str:
    """What is said, without of whom: the first word of a reason, or a trajectory's number, is whom."""
    words = reason.split(", in ", maxsplit=1)[0].split(" ")
    return " ".join(["trajectory", *words[2:3]] if words[0] == "trajectory" else words[1:])


def _of_one_kind(found: list[Suspect]) -> Suspect:
    """One entry for findings of one kind about several markers or trajectories."""
    tracks = found[0].reason.startswith("trajectory ")
    whom = list(dict.fromkeys(suspect.reason.split(" ")[1 if tracks else 0] for suspect in found))
    listed = " ".join(whom[:NAMED]) + (f" and {len(whom) - NAMED} more" if len(whom) > NAMED else "")
    words = f"trajectories {listed}: as {found[0].reason}" if tracks else f"{listed}: {_kind(found[0].reason)}"
    return Suspect(min(one.first for one in found), max(one.last for one in found), words)
