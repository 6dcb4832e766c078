# SPDX-License-Identifier: GPL-3.0-or-later
"""What may be the matter with a labelled take, in words: what it is, in which frames, and what to do about it.

How much is at stake is counted in marker-frames: one marker in one frame is one. What a person answered stays in the
list as answered, and counts nothing.

A point without a name that stays on the body for a while is looked at with the missing marker that it may be.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..data.takes import Labels, Motion, PointRows, Suspect, evenly_spread
from ..data.wording import LISTED, listed, words_of_frames
from ..edits.kinds import Accepted, Delete, Edit, Right
from .answering import PAIR
from .summary import MM_PER_M
from .suspects import EITHER_WAY, MOMENT_S, NOT_TOLD, OF_ROOM

# physical: m, from the body's nearest part, or where a missing marker should be; half a limb's length
BESIDE_BODY_M = 0.15  # physical
# measured: frames of each point that are looked at, spread evenly; most of them must say the same
LEFT_SAMPLES = 7  # measured


@dataclass(frozen=True)
class Leftover:
    """A part of a trajectory that is on the body and has no name, from frame `first` to `last` of the source's."""

    trajectory: int  # its index in the file
    first: int
    last: int
    frames: int  # in how many of them it has a point without a name
    beside: int | None  # the marker (an index) that is missing there and should be where it is, None where none is
    distance: float  # how far it is from there, m; NaN without one


def find_leftovers(rows: PointRows, labels: Labels, motion: Motion, rate: float) -> tuple[Leftover, ...]:
    """The points of a take that are left over on the body for more than a moment.

    labels (N,) are row for row, and rate is in frames a second.
    """
    moment = MOMENT_S * rate
    left = np.flatnonzero(~labels.named)
    # Rows are in the order of frames, which a stable sort keeps within each trajectory.
    left = left[np.argsort(rows.trajectory[left].astype(np.int32), kind="stable")]
    new = (np.diff(rows.trajectory[left]) != 0) | (np.diff(rows.frame[left]) > moment)
    parts = [part for part in np.split(left, np.flatnonzero(new) + 1) if len(part) >= moment]
    return tuple(one for one in (_leftover(part, rows, motion) for part in parts) if one is not None)


def joined_leftovers(before: tuple[Leftover, ...], after: tuple[Leftover, ...]) -> tuple[Leftover, ...]:
    """Those of a take so far and of its next frames: what goes on from one to the other is one."""
    ends = {(one.trajectory, one.last): place for place, one in enumerate(before)}
    joined, new = list(before), []
    for one in after:
        place = ends.get((one.trajectory, one.first - 1))
        if place is None:
            new.append(one)
        else:
            old = joined[place]
            longer = max(old, one, key=lambda part: part.frames)
            joined[place] = replace(longer, first=old.first, last=one.last, frames=old.frames + one.frames)
    return tuple(sorted((*joined, *new), key=lambda one: (one.trajectory, one.first)))


def _leftover(part: np.ndarray, rows: PointRows, motion: Motion) -> Leftover | None:
    """A part of a trajectory as what is left over; None where it is not on the body."""
    some = part[evenly_spread(len(part), LEFT_SAMPLES)]
    own = rows.frame[some]
    expected, found = motion.expected[own], motion.markers[own]
    body = np.concatenate([expected, found, motion.joints[own]], axis=1)
    off = _distances(rows.xyz[some], body).min(axis=1, initial=np.inf)
    if 2 * (off <= BESIDE_BODY_M).sum() <= len(some):
        return None
    away = _distances(rows.xyz[some], expected)
    away[np.isfinite(found).all(axis=2)] = np.inf
    near = (away <= BESIDE_BODY_M) & (away == away.min(axis=1, keepdims=True, initial=np.inf))
    often = near.sum(axis=0)
    who, distance = None, float("nan")
    if 2 * often.max(initial=0) > len(some):
        who = int(often.argmax())
        distance = float(np.median(away[near[:, who], who]))
    first, last = (int(rows.frames[rows.frame[row]]) for row in (part[0], part[-1]))
    return Leftover(int(rows.trajectory[part[0]]), first, last, len(part), who, distance)


def _distances(xyz: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(K, B) m from points (K, 3) to others (K, B, 3); inf where these are not there."""
    return np.nan_to_num(np.linalg.norm(others - xyz[:, None], axis=2), nan=np.inf)


# What is the matter, in the words of the list and of reports.
MISSING, LEFT_OVER, OFF_BODY = "missing", "left over", "off the body"
IN_DOUBT, OF_CAMERA, NOBODY_THERE = "doubtful", "camera", "nobody"
# What helps.
NAME_IT, FILL, UNLABEL, RIGHT = "name", "fill", "unlabel", "right"
REFINE, LABEL, DELETE = "refine", "label", "delete"
# What doubts say that is answered in a way of its own.
STAYS_UNNAMED = "stays unnamed"
IT_IS_RIGHT, NOT_WORN, LEAVE_UNNAMED, IS_NONE = "It Is Right", "Not Worn", "Leave Unnamed", "No Marker"
Spans = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Trouble:
    """One thing that is the matter with a take."""

    kind: str  # what is the matter: MISSING, LEFT_OVER, OFF_BODY, IN_DOUBT, OF_CAMERA or NOBODY_THERE
    first: int  # the frames to look at, the source's numbers, both included
    last: int
    reason: str  # what it is, in full
    advice: str  # what to do, in words
    stake: float  # marker-frames that are wrong or missing if it is as it looks; 0 once it is answered
    markers: tuple[str, ...] = ()  # the markers that it is about, and
    trajectories: tuple[int, ...] = ()  # the trajectories of points, by their index in the file, and
    cameras: tuple[str, ...] = ()  # the cameras
    # what does it: NAME_IT, FILL, UNLABEL, RIGHT, REFINE, LABEL or DELETE; empty where only a person can
    action: str = ""
    answer: str = IT_IS_RIGHT  # what a person says who finds that nothing is to be mended, in the words of a button
    ranges: Spans = ()  # all frames that it is about, where that is not one range
    named_in: Spans = ()  # where it is advised to name the first trajectory: the frames in which it has no name
    lasting: str = ""  # what it says, without what changes when a take is labelled again; empty where nothing does
    answered: bool = False  # whether a person has answered it

    @property
    def about(self) -> str:
        """What it is about, in a few words."""
        tracks = [f"trajectory {number}" for number in self.trajectories]
        words = [*self.markers] or [*self.cameras] or tracks[:1]
        return (
            listed(words, " ") if len(words) > 1 or len(tracks) < 2 or self.markers else f"{len(tracks)} trajectories"
        )

    @property
    def topic(self) -> str:
        """What an edit says that accepts it."""
        return self.lasting or self.reason

    @property
    def spans(self) -> Spans:
        """All frames that it is about."""
        return self.ranges or ((self.first, self.last),)

    def answers(self) -> list[Edit]:
        """What `answer` means: markers are right, points are none, or what is said may be as it is.

        Many ranges are answered as a whole, which locks no label between them.
        """
        spans = self.spans
        if len(spans) <= LISTED:
            about_markers = self.kind == IN_DOUBT and not self.trajectories and self.answer == IT_IS_RIGHT
            if self.kind in (MISSING, OFF_BODY) or (about_markers and self.markers):
                return [Right(name, frames=span) for name in self.markers for span in spans]
            if self.kind == LEFT_OVER:
                return [Delete(number, frames=span) for number in self.trajectories for span in spans]
        topics = [gaps_of(name) for name in self.markers] if self.kind == MISSING else [self.topic]
        return [Accepted(topic, frames=(spans[0][0], spans[-1][1])) for topic in topics]

    def as_dict(self) -> dict:
        """What a report says of it."""
        named = "kind", "first", "last", "reason", "markers", "cameras", "advice", "action", "answered"
        tracks, stake = [int(number) for number in self.trajectories], float(f"{self.stake:.4g}")
        return {name: getattr(self, name) for name in named} | {"trajectories": tracks, "stake": stake}


def gaps_of(name: str) -> str:
    """What stays true of a marker that is missing, however often it is labelled again."""
    return f"{name} has gaps"


def nobody(first: int, last: int, markers: int) -> Trouble:
    """Frames in which nobody was found who has so many markers."""
    reason = f"nobody was found in {words_of_frames(first, last)}"
    advice = "Look whether the subject is there; if so, name some markers and label again"
    stake = float((last - first + 1) * markers)
    return Trouble(NOBODY_THERE, first, last, reason, advice, stake, action=LABEL, answer="Nobody Is There")


def missing(name: str, ranges: Spans, frames: int, beside: Sequence[Leftover]) -> Trouble:
    """A marker that is not there in some ranges of so many frames, and the points without a name near its place."""
    lost = sum(last - first + 1 for first, last in ranges)
    first, last = max(ranges, key=lambda one: one[1] - one[0])
    gaps = "" if len(ranges) == 1 else f"the longest of {len(ranges)} gaps is "
    where = f"{gaps or 'not in '}{words_of_frames(first, last)}"
    reason = f"{name} is found in {_percent(1 - lost / frames)} of the frames; {where}"
    advice, action, answer = f"Name the point that is {name} where there is one, and fill the gaps", FILL, "Not Seen"
    if lost == frames:
        if not beside:
            return never_found([name], ranges)
        reason, answer = f"{name} is never found", NOT_WORN
    tracks: tuple[int, ...] = ()
    named_in: Spans = ()
    if beside:
        most = max(beside, key=lambda one: one.frames)
        tracks = tuple(dict.fromkeys((most.trajectory, *(one.trajectory for one in beside))))
        named_in = tuple((one.first, one.last) for one in beside if one.trajectory == most.trajectory)
        away = f"{most.distance * MM_PER_M:.0f} mm from where it should be"
        reason += f"; trajectory {most.trajectory}, which has no name, is {away}"
        advice, action = f"Look whether trajectory {most.trajectory} is {name}; if so, name it", NAME_IT
    return Trouble(
        MISSING, first, last, reason, advice, float(lost), (name,), tracks, action=action, answer=answer, ranges=ranges,
        named_in=named_in, lasting=gaps_of(name),
    )  # fmt: skip


def never_found(names: Sequence[str], ranges: Spans) -> Trouble:
    """Markers that are not there in any of the ranges that are all of the take, in one line: most were not worn."""
    who, are, was, its = listed(names), "are", "were", "their points"
    if len(names) == 1:
        are, was, its = "is", "was", "its point"
    advice = f"If {who} {was} not on the subject, say {NOT_WORN}; else name {its}, and label again"
    stake = float(len(names) * sum(last - first + 1 for first, last in ranges))
    return Trouble(
        MISSING, ranges[0][0], ranges[-1][1], f"{who} {are} never found", advice, stake, tuple(names), action=RIGHT,
        answer=NOT_WORN, ranges=ranges, lasting=", ".join(map(gaps_of, names)),
    )  # fmt: skip


def left_over(one: Leftover, marker: str) -> Trouble:
    """A point on the body without a name, beside which a marker is missing; empty where none is."""
    reason = f"trajectory {one.trajectory} is on the body and has no name in {words_of_frames(one.first, one.last)}"
    advice, markers = f"Name it, or say {IS_NONE}", (marker,) if marker else ()
    if marker:
        reason += f"; {marker}, which is not found there, should be {one.distance * MM_PER_M:.0f} mm from it"
        advice = f"Look whether it is {marker}; if so, name it, else say {IS_NONE}"
    return Trouble(
        LEFT_OVER, one.first, one.last, reason, advice, float(one.frames), markers, (one.trajectory,),
        action=NAME_IT if marker else "", answer=IS_NONE,
    )  # fmt: skip


def extras(many: Sequence[Leftover]) -> Trouble:
    """Points beside which no marker is missing, in one line: no label of the set is wrong by them."""
    numbers = tuple(dict.fromkeys(one.trajectory for one in many))
    who = f"trajectory {numbers[0]} is" if len(numbers) == 1 else f"{len(numbers)} trajectories are"
    frames = sum(one.frames for one in many)
    reason = f"{who} on the body without a name, {frames} frames in all, beside no missing marker"
    advice = f"A marker set of your own can learn those that are markers; of the rest say {IS_NONE}"
    first, last = min(one.first for one in many), max(one.last for one in many)
    return Trouble(
        LEFT_OVER, first, last, reason, advice, 0.0, (), numbers, action=DELETE, answer=IS_NONE
    )  # fmt: skip


def off_body(name: str, ranges: Spans, worst: int, farthest: float, mean: float) -> Trouble:
    """A marker that is away from where the body has it, m, in some ranges, in one of them the most."""
    (first, last), frames = ranges[worst], sum(last - first + 1 for first, last in ranges)
    places = "" if len(ranges) == 1 else f" over {frames} frames in {len(ranges)} places"
    reason = f"{name} and where the body has it are up to {farthest * MM_PER_M:.0f} mm apart in "
    reason += f"{words_of_frames(first, last)}, {mean * MM_PER_M:.0f} mm on average{places}"
    advice = f"Look whether it is {name}: if not, unlabel or swap it; if so, say {IT_IS_RIGHT}"
    lasting = f"{name} is off the body at times"
    return Trouble(
        OFF_BODY, first, last, reason, advice, float(frames), (name,), action=UNLABEL, ranges=ranges, lasting=lasting
    )  # fmt: skip


def of_cameras(doubt: Suspect, cameras: tuple[str, ...], stake: float) -> Trouble:
    """A doubt about some cameras, or about the room."""
    advice, action = "Mend the calibration or the names of the cameras, then label again", ""
    if doubt.words.startswith(OF_ROOM):
        advice = "Import the calibration that the take was recorded with, in metres, then label again"
    elif "moved" in doubt.words:
        action = REFINE
    return Trouble(
        OF_CAMERA, doubt.first, doubt.last, doubt.reason, advice, stake, cameras=cameras, action=action,
        answer="Calibration Is Right",
    )  # fmt: skip


def in_doubt(doubt: Suspect, on_body: bool, stake: float) -> Trouble:
    """A doubt about names; `on_body` where a trajectory that it is about is on the body and has none."""
    markers, tracks = doubt.markers, () if doubt.trajectory is None else (doubt.trajectory,)
    unnamed = STAYS_UNNAMED in doubt.words
    advice, action = f"Look at {', '.join(markers) or 'these frames'}: correct what is wrong, or say {IT_IS_RIGHT}", ""
    if tracks and unnamed and on_body:
        advice, action = f"Look whether it is {' or '.join(markers) or 'a marker'}; if so, name it", NAME_IT
    elif tracks and unnamed:
        advice = f"It is off the body: look what it is; if it is nothing, say {LEAVE_UNNAMED}"
    elif tracks and len(markers) == PAIR:
        advice = f"Look which of {' and '.join(markers)} it is; name it so, or say {IT_IS_RIGHT}"
    elif is_which(doubt):
        advice = "Look which is which: name one of them, of blobs through a camera, and label again, or say "
        advice += LEAVE_UNNAMED
    elif unnamed:  # several trajectories in one line
        advice = f"Look at {', '.join(markers)}: name what you can tell, or say {LEAVE_UNNAMED}"
    elif markers:
        action = RIGHT
    answer = LEAVE_UNNAMED if unnamed else IT_IS_RIGHT
    return Trouble(
        IN_DOUBT, doubt.first, doubt.last, doubt.reason, advice, stake, markers, tracks, action=action, answer=answer
    )  # fmt: skip


def is_which(doubt: Suspect) -> bool:
    """Whether it is asked which of two markers is which, neither of which has a name."""
    return EITHER_WAY in doubt.words or NOT_TOLD in doubt.words


def summary_of_trouble(found: Sequence[Trouble]) -> str:
    """The list in half a sentence, for a line of results; empty where there is nothing open."""
    left = [one for one in found if not one.answered]
    return f"{len(left)} to look at, worst: {left[0].reason}" if left else ""


def _percent(share: float) -> str:
    """A share that is never rounded up to all or down to nothing."""
    value = 100 * share
    return f"{value:.0f} %" if 1 <= value <= 99 else f"{value:.1f} %" if 0.1 <= value <= 99.9 else f"{value:.3g} %"
