# SPDX-License-Identifier: GPL-3.0-or-later
"""What is the matter with a labelled take, the worst first: what is missing, left over, off, doubtful, or a camera's.

Each trouble says in full what it is, in which frames, of which markers, what to do about it and how many marker-frames
are at stake: one marker in one frame is one. What a person answered stays in the list as answered, and counts nothing.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..data.takes import Blobs, Labels, Motion, PointRows, Suspect
from ..data.wording import words_of_frames
from ..edits.kinds import NO_EDITS, Accepted, Delete, Edit, Edits, Right
from ..geometry.cameras import NO_CAMERAS, Cameras
from .answering import PAIR, accepted_in, is_heard, right_in, settled_in
from .camera_blobs import CameraBlobs
from .camera_words import OF_ROOM, cameras_in
from .leftovers import LEAVING, Leftover, find_leftovers, joined_leftovers
from .summary import MM_PER_M
from .suspects import FAR_OFF, JUMPS, SUSPECTING

# What is the matter, in the words of the list and of reports.
MISSING, LEFT_OVER, OFF_BODY, IN_DOUBT, OF_CAMERA, NOBODY_THERE = (
    "missing",
    "left over",
    "off the body",
    "doubtful",
    "camera",
    "nobody",
)
TROUBLE_KINDS = (NOBODY_THERE, MISSING, LEFT_OVER, OFF_BODY, IN_DOUBT, OF_CAMERA)
# What helps.
NAME_IT, FILL, UNLABEL, RIGHT, SWAP = "name", "fill", "unlabel", "right", "swap"
REFINE, LABEL, DELETE = "refine", "label", "delete"
# What reasons say, and what answers it.
NEVER_FOUND, STAYS_UNNAMED = "is never found", "stays unnamed"
NOT_WORN, LEAVE_UNNAMED = "Not Worn", "Leave Unnamed"


@dataclass(frozen=True)
class TroubleOptions:
    """What is worth a line in the list; reckoned.

    min_missing_share    of the frames with a subject that a marker lacks, or
    min_gap_s            the length of a gap, from which it is listed: shorter ones any method fills
    max_filled_gap_s     the longest gap that filling is advised for; in longer ones a person names what is there
    never_share          of the frames: a marker found in fewer is said to be found almost never
    min_camera_unnamed   share of the blobs beside markers that a camera may leave unnamed, and
    times_usual          as many times the median of the others, is a camera's trouble; of its error likewise, and
    min_error_px         at least so much of it
    change_s             at stake for each marker where a trajectory goes over to another: how long a person looks at
    extra_weight         at stake for a frame of a point on the body beside which no marker is missing: it may be one
                         that the set lacks, which is no label of this set; and of what is said of the whole take
    min_share_of_points  of the points left over for a moment each, of all points, that is worth a line
    max_answers          ranges that are answered one by one; more are answered as a whole, which locks no label between
                         them
    """

    min_missing_share: float = 0.01
    min_gap_s: float = 0.5
    max_filled_gap_s: float = 1.0
    never_share: float = 0.02
    min_camera_unnamed: float = 0.2
    times_usual: float = 2.0
    min_error_px: float = 1.0
    change_s: float = 1.0
    extra_weight: float = 0.1
    min_share_of_points: float = 0.005
    max_answers: int = 8


TROUBLING = TroubleOptions()


@dataclass(frozen=True)
class Trouble:
    """One thing that is the matter with a take.

    kind          one of TROUBLE_KINDS
    first, last   the frames to look at, the source's numbers, both included
    reason        what it is, in full
    markers       the markers that it is about, and
    trajectories  the trajectories of points, by their index in the file, and
    cameras       the cameras
    stake         marker-frames that are wrong or missing if it is as it looks; 0 once it is answered
    advice        what to do, in words
    action        what does it: NAME_IT, FILL, UNLABEL, RIGHT, SWAP, REFINE, LABEL or DELETE; empty where only a person
                  can
    answered      whether a person has answered it
    ranges        all frames that it is about, where that is not one range
    named_in      where it is advised to name the first trajectory: the frames in which it has no name
    """

    kind: str
    first: int
    last: int
    reason: str
    markers: tuple[str, ...] = ()
    trajectories: tuple[int, ...] = ()
    cameras: tuple[str, ...] = ()
    stake: float = 0.0
    advice: str = ""
    action: str = ""
    answered: bool = False
    ranges: tuple[tuple[int, int], ...] = ()
    named_in: tuple[tuple[int, int], ...] = ()

    @property
    def about(self) -> str:
        """What it is about, in a few words."""
        tracks = [f"trajectory {number}" for number in self.trajectories]
        words = [*self.markers] or [*self.cameras] or tracks[:1]
        return " ".join(words) if len(words) > 1 or len(tracks) < 2 or self.markers else f"{len(tracks)} trajectories"

    @property
    def topic(self) -> str:
        """What it says, without what changes when a take is labelled again."""
        said = {MISSING: "has gaps", OFF_BODY: "is off the body at times"}.get(self.kind)
        return f"{self.markers[0]} {said}" if said else self.reason

    @property
    def answer(self) -> str:
        """What a person says who finds that nothing is to be mended, in the words of a button."""
        if self.kind == MISSING:
            return NOT_WORN if NEVER_FOUND in self.reason else "Not Seen"
        if self.kind == LEFT_OVER:
            return "No Marker" if self.trajectories else "No Markers"
        if self.kind == IN_DOUBT:
            return LEAVE_UNNAMED if STAYS_UNNAMED in self.reason else "It Is Right"
        return {NOBODY_THERE: "Nobody Is There", OF_CAMERA: "Calibration Is Right"}.get(self.kind, "It Is Right")

    def answers(self) -> list[Edit]:
        """What `answer` means: markers are right, points are none, or what is said may be as it is."""
        ranges = self.ranges or ((self.first, self.last),)
        if len(ranges) > TROUBLING.max_answers:
            return [Accepted(self.topic, frames=(ranges[0][0], ranges[-1][1]))]
        if self.kind in (MISSING, OFF_BODY) or (self.kind == IN_DOUBT and self.markers and not self.trajectories):
            return [Right(name, frames=span) for name in self.markers for span in ranges]
        if self.kind == LEFT_OVER and self.trajectories:
            return [Delete(number, frames=span) for number in self.trajectories for span in ranges]
        return [Accepted(self.reason, frames=span) for span in ranges]

    def as_dict(self) -> dict:
        """What a report says of it."""
        said = {"kind": self.kind, "first": self.first, "last": self.last, "reason": self.reason}
        about = {
            "markers": list(self.markers),
            "trajectories": [int(number) for number in self.trajectories],
            "cameras": list(self.cameras),
        }
        more = {"stake": float(f"{self.stake:.4g}"), "advice": self.advice, "action": self.action}
        return said | about | more | {"answered": self.answered}


@dataclass(frozen=True, eq=False)
class MarkerSight:
    """Where the M markers of a motion of F frames are seen.

    present  (M, F) True where a marker is there
    off      (M, F) m from where the body has it; NaN without one of the two
    """

    present: np.ndarray
    off: np.ndarray

    @classmethod
    def of(cls, motion: Motion) -> "MarkerSight":
        """That of a motion."""
        frames, markers = motion.markers.shape[:2]
        sight = cls(np.empty((markers, frames), bool), np.empty((markers, frames)))
        sight.look_again(motion, dict.fromkeys(range(markers), slice(None)))
        return sight

    def look_again(self, motion: Motion, changed: Mapping[int, slice]):
        """Makes it that of a motion which is another in some frames of some markers only; quicker than all of them."""
        for marker, frames in changed.items():
            places = motion.markers[frames, marker]
            self.present[marker, frames] = np.isfinite(places).all(axis=1)
            away = places - motion.expected[frames, marker]
            self.off[marker, frames] = np.sqrt(np.einsum("fx,fx->f", away, away))


class TakeTrouble:
    """Looks at a take chunk by chunk while it is labelled, or at all of it at once; `found` gives the list.

    names are the M markers'; edits what a person said, which answers some of it; words the index of each marker by all
    that edits may call it, its name alone unless they are given; rate in frames a second.
    """

    def __init__(
        self,
        names: Sequence[str],
        rate: float,
        edits: Edits = NO_EDITS,
        cameras: Cameras = NO_CAMERAS,
        words: Mapping[str, int] | None = None,
    ):
        self.names, self.rate, self.edits = tuple(names), rate, edits
        self.words = words or {name: index for index, name in enumerate(self.names)}
        self.by_camera = CameraBlobs(cameras)
        self.first = self.last = 0
        self.frames = self.subject_frames = self.points = 0
        count = len(self.names)
        self._missing, self._excused = _Ranges(count), _Ranges(count)
        self._off, self._accepted = _Ranges(count), _Ranges(count)
        self._nobody = _Ranges(1)
        self._filled: dict[str, list[tuple[int, int]]] = {}
        self._left: tuple[Leftover, ...] = ()
        self._brief = 0

    def add(self, rows: Blobs | PointRows, labels: Labels, motion: Motion, sight: "MarkerSight | None" = None):
        """Adds a chunk, which follows the last. `sight` is the motion's, where it is known."""
        sight = MarkerSight.of(motion) if sight is None else sight
        frames = motion.frames
        self.first = int(frames[0]) if not self.frames else self.first
        self.frames, self.last = self.frames + len(frames), int(frames[-1])
        present, off = sight.present, sight.off
        here = (motion.confidence > 0) | present.any(axis=0)
        self.subject_frames += int(here.sum())
        if isinstance(rows, PointRows):
            self.points += len(rows)
            left, brief = find_leftovers(rows, labels, motion, self.rate)
            self._left, self._brief = joined_leftovers(self._left, left), self._brief + brief
        else:
            self.by_camera.add(rows, labels, motion)
        lacking = here & ~present
        with np.errstate(invalid="ignore"):
            far = off > SUSPECTING.max_off_body_m
        self._nobody.add(frames, ~here[None])
        right = right_in(self.edits, self.words, frames)
        if right.any():
            right = np.ascontiguousarray(right.T)
            self._excused.add(frames, lacking & right)
            self._accepted.add(frames, far & right, off)
            lacking, far = lacking & ~right, far & ~right
        self._missing.add(frames, lacking)
        self._off.add(frames, far, off)

    def fill(self, marker: str, first: int, last: int):
        """Notes that a marker's gap from frame `first` to `last`, by the source's numbers, was filled: no trouble."""
        self._filled.setdefault(marker, []).append((first, last))

    def found(self, suspects: Iterable[Suspect] = (), answered: Iterable[Suspect] = ()) -> tuple[Trouble, ...]:
        """All trouble, the worst first and what is answered last; suspects are the doubts, open and answered."""
        found = [*self._of_nobody(), *self._of_missing(), *self._of_leftovers(), *self._of_body()]
        doubts = list(self._of_doubts(suspects))
        doubted = {name for one in doubts for name in one.cameras}
        found += [*doubts, *(one for one in self._of_cameras() if one.cameras[0] not in doubted)]
        found += [replace(one, stake=0.0, answered=True) for one in self._of_doubts(answered)]
        if any(isinstance(edit, Accepted) for edit in self.edits):
            found = [self._accepted_by(one) for one in found]
        return tuple(sorted(found, key=lambda one: (one.answered, -one.stake, one.first)))

    def heard(self, suspects: Iterable[Suspect] = ()) -> frozenset[Accepted]:
        """The edits that accept some trouble, or what is said of a marker's doubtful frames."""
        listening = [edit for edit in self.edits if isinstance(edit, Accepted)]
        if not listening:
            return frozenset()
        said = [(one.topic, one.first, one.last) for one in self.found(suspects)]
        said += [(f"{name} {what}", self.first, self.last) for name in self.names for what in (FAR_OFF, JUMPS)]
        return frozenset(edit for edit in listening if any(is_heard(edit, *one) for one in said))

    def _accepted_by(self, one: Trouble) -> Trouble:
        """A trouble as answered, where a person accepted what it says in all of its frames."""
        ranges = one.ranges or ((one.first, one.last),)
        accepted = all(accepted_in(self.edits, one.topic, np.arange(a, b + 1)).all() for a, b in ranges)
        return replace(one, stake=0.0, answered=True) if accepted and not one.answered else one

    def _of_nobody(self):
        for first, last, _, _ in self._nobody.of(0):
            yield Trouble(
                NOBODY_THERE,
                first,
                last,
                f"nobody was found in {words_of_frames(first, last)}",
                stake=float((last - first + 1) * len(self.names)),
                advice="Look whether the subject is there; if so, name some markers and label again",
                action=LABEL,
            )

    def _of_missing(self):
        for index, name in enumerate(self.names):
            filled, excused = self._filled.get(name, ()), self._excused.of(index)
            open_ = [one for one in self._missing.of(index) if not any(a <= one[0] and one[1] <= b for a, b in filled)]
            for ranges, answered in ((open_, False), (excused, True)):
                lost = sum(last - first + 1 for first, last, _, _ in ranges)
                longest = max(ranges, key=lambda one: one[1] - one[0], default=None)
                if longest is None:
                    continue
                length = longest[1] - longest[0] + 1
                worth = lost >= TROUBLING.min_missing_share * self.subject_frames
                if answered or worth or length >= TROUBLING.min_gap_s * self.rate:
                    yield self._missing_marker(name, ranges, lost, longest, answered)

    def _missing_marker(self, name: str, ranges: list, lost: int, longest: tuple, answered: bool) -> Trouble:
        share, length = 1 - lost / max(self.subject_frames, 1), longest[1] - longest[0] + 1
        where = f"the longest of {len(ranges)} gaps is {words_of_frames(longest[0], longest[1])}"
        if len(ranges) == 1:
            where = f"not in {words_of_frames(longest[0], longest[1])}"
        short = length <= TROUBLING.max_filled_gap_s * self.rate
        beside = [one for one in self._left if one.beside is not None and self.names[one.beside] == name]
        if not share:
            reason, action = f"{name} {NEVER_FOUND}", RIGHT
            advice = f"If {name} was not on the subject, say {NOT_WORN}; else name its point, and label again"
        elif share < TROUBLING.never_share:
            reason, action = f"{name} is found in {_percent(share)} of the frames only; {where}", NAME_IT
            advice = f"Look whether what is called {name} is {name}; name the point that is, and label again"
        else:
            reason, action = f"{name} is found in {_percent(share)} of the frames; {where}", FILL if short else NAME_IT
            advice = "Fill the gaps" if short else f"Name the point that is {name} there, else fill the gaps"
        named_in: tuple[tuple[int, int], ...] = ()
        if beside:
            most = max(beside, key=lambda one: one.frames)
            beside.sort(key=lambda one: one.trajectory != most.trajectory)
            named_in = tuple((one.first, one.last) for one in beside if one.trajectory == most.trajectory)
            reason += f"; trajectory {most.trajectory}, which has no name, is {most.distance * MM_PER_M:.0f} mm from "
            reason += "where it should be"
            action, advice = NAME_IT, f"Look whether trajectory {most.trajectory} is {name}; if so, name it"
        return Trouble(
            MISSING,
            longest[0],
            longest[1],
            reason,
            (name,),
            tuple(dict.fromkeys(one.trajectory for one in beside)),
            stake=0.0 if answered else float(lost),
            advice=advice,
            action=action,
            answered=answered,
            ranges=tuple((first, last) for first, last, _, _ in ranges),
            named_in=named_in,
        )

    def _of_leftovers(self):
        extra = []
        for one in self._left:
            answered = settled_in(self.edits, one.trajectory, one.first, one.last)
            if one.beside is None and not answered:
                extra.append(one)
                continue
            yield self._left_over(one, answered)
        yield from self._extras(extra)
        if self._brief > TROUBLING.min_share_of_points * self.points:
            yield Trouble(
                LEFT_OVER,
                self.first,
                self.last,
                f"{self._brief} points on the body have no name, each for less than {LEAVING.min_s:g} s at a time: "
                f"{self._brief / max(self.subject_frames, 1):.1f} a frame",
                stake=TROUBLING.extra_weight * self._brief,
                advice="Look whether they are markers or reflections; markers get names where neighbours have theirs",
            )

    def _left_over(self, one: Leftover, answered: bool) -> Trouble:
        words = f"trajectory {one.trajectory} is on the body and has no name in {words_of_frames(one.first, one.last)}"
        markers: tuple[str, ...] = ()
        advice, action = "Say that it is no marker, or name it", ""
        if one.beside is not None:
            markers = (self.names[one.beside],)
            words += f"; {markers[0]}, which is not found there, should be {one.distance * MM_PER_M:.0f} mm from it"
            advice, action = f"Look whether it is {markers[0]}; if so, name it, else delete it", NAME_IT
        stake = 0.0 if answered else float(one.frames)
        return Trouble(
            LEFT_OVER,
            one.first,
            one.last,
            words,
            markers,
            (one.trajectory,),
            stake=stake,
            advice=advice,
            action=action,
            answered=answered,
        )

    def _extras(self, extra: list[Leftover]):
        """Points beside which no marker is missing: one line for all of them."""
        if not extra:
            return
        numbers = list(dict.fromkeys(one.trajectory for one in extra))
        frames = sum(one.frames for one in extra)
        if len(numbers) == 1:
            who = f"trajectory {numbers[0]} is on the body and has no name"
        else:
            who = f"{len(numbers)} trajectories are on the body and have no name"
        yield Trouble(
            LEFT_OVER,
            min(one.first for one in extra),
            max(one.last for one in extra),
            f"{who}, {frames} frames in all; no marker of the set is missing beside "
            f"{'it' if len(numbers) == 1 else 'them'}",
            (),
            tuple(numbers),
            stake=TROUBLING.extra_weight * frames,
            advice="Markers that the set lacks can be learned; what is none is no marker",
            action=DELETE,
        )

    def _of_body(self):
        for index, name in enumerate(self.names):
            for ranges, answered in ((self._off.of(index), False), (self._accepted.of(index), True)):
                if not ranges:
                    continue
                frames = sum(last - first + 1 for first, last, _, _ in ranges)
                worst = max(ranges, key=lambda one: one[2])
                mean = sum(total for *_, total in ranges) / frames
                where = "" if len(ranges) == 1 else f" over {frames} frames in {len(ranges)} places"
                yield Trouble(
                    OFF_BODY,
                    worst[0],
                    worst[1],
                    f"{name} and where the body has it are up to {worst[2] * MM_PER_M:.0f} mm apart in "
                    f"{words_of_frames(worst[0], worst[1])}, {mean * MM_PER_M:.0f} mm on average{where}",
                    (name,),
                    stake=0.0 if answered else float(frames),
                    advice=f"Look whether it is {name}: if not, unlabel or swap it; if so, say It Is Right",
                    action=UNLABEL,
                    answered=answered,
                    ranges=tuple((first, last) for first, last, _, _ in ranges),
                )

    def _of_doubts(self, suspects: Iterable[Suspect]):
        for one in suspects:
            if FAR_OFF in one.words:
                continue  # said with figures above
            if one.words.startswith(OF_ROOM):
                yield Trouble(
                    OF_CAMERA,
                    one.first,
                    one.last,
                    one.reason,
                    stake=float(one.frames * len(self.names)),  # no name can be relied on
                    advice="Import the calibration that the take was recorded with, in metres, then label again",
                )
                continue
            if cameras := cameras_in(one.words, self.by_camera.names):
                yield Trouble(
                    OF_CAMERA,
                    one.first,
                    one.last,
                    one.reason,
                    cameras=cameras,
                    stake=sum(self.by_camera.blobs_of(name) for name in cameras) / max(len(self.by_camera.names), 1),
                    advice="Mend the calibration or the names of the cameras, then label again",
                    action=REFINE if "moved" in one.words else "",
                )
                continue
            advice, action = _advice_of(one)
            if action == NAME_IT and not self._is_on_body(one):
                advice, action = f"It is off the body: look what it is; if it is nothing, say {LEAVE_UNNAMED}", ""
            tracks = () if one.trajectory is None else (one.trajectory,)
            stake = self._stake_of(one)
            yield Trouble(
                IN_DOUBT,
                one.first,
                one.last,
                one.reason,
                one.markers,
                tracks,
                stake=stake,
                advice=advice,
                action=action,
            )

    def _is_on_body(self, suspect: Suspect) -> bool:
        """Whether a trajectory without a name that is doubted is left over on the body, in some of these frames."""
        return any(
            one.trajectory == suspect.trajectory and one.first <= suspect.last and suspect.first <= one.last
            for one in self._left
        )

    def _stake_of(self, suspect: Suspect) -> float:
        """Marker-frames at stake in a doubt."""
        frames = float(suspect.frames)
        if (
            suspect.trajectory is not None and len(suspect.markers) == PAIR
        ):  # a change of names; in the gap there is none
            frames = min(frames, TROUBLING.change_s * self.rate)
        if suspect.trajectory is None and not suspect.markers and suspect.frames >= self.frames:  # about the whole take
            frames *= TROUBLING.extra_weight
        return frames * max(len(suspect.markers), 1)

    def _of_cameras(self):
        figures = self.by_camera.figures()
        unnamed = np.array([one.unnamed_share for one in figures])
        error = np.array([one.error_px for one in figures])
        for index, one in enumerate(figures):
            usual, typical = (_median_of_others(values, index) for values in (unnamed, error))
            said = []
            if one.unnamed_share > max(TROUBLING.min_camera_unnamed, TROUBLING.times_usual * usual):
                said.append(
                    f"of its blobs beside markers {_percent(one.unnamed_share)} have no name, in other cameras "
                    f"{_percent(usual)}"
                )
            if one.error_px > max(TROUBLING.min_error_px, TROUBLING.times_usual * typical):
                said.append(f"its blobs are {one.error_px:.1f} px off the markers, those of others {typical:.1f} px")
            if not said:
                continue
            lost = one.unnamed_beside + (one.named if len(said) == 2 or "px off" in said[0] else 0)
            yield Trouble(
                OF_CAMERA,
                self.first,
                self.last,
                f"camera {one.name}: {'; '.join(said)}",
                cameras=(one.name,),
                stake=lost / max(len(figures), 1),
                advice="Refine the calibration, then label again",
                action=REFINE,
            )


def summary_of_trouble(found: Sequence[Trouble]) -> str:
    """The list in half a sentence, for a line of results; empty where there is nothing open."""
    left = [one for one in found if not one.answered]
    if not left:
        return ""
    return f"{len(left)} to look at, worst: {left[0].reason}"


def _advice_of(suspect: Suspect) -> tuple[str, str]:
    """What to do about a doubt, and what does it."""
    pair = len(suspect.markers) == PAIR
    if suspect.trajectory is not None and STAYS_UNNAMED in suspect.words:
        return f"Look whether it is {suspect.markers[0]}; if so, name it" if suspect.markers else "Name it", NAME_IT
    if pair and suspect.trajectory is not None:
        return f"Look which of {' and '.join(suspect.markers)} it is; name it so, or say It Is Right", ""
    if pair:
        return "Look which is which: swap them, or say It Is Right", SWAP
    if suspect.markers:
        return f"Look at {', '.join(suspect.markers)}: correct what is wrong, or say It Is Right", RIGHT
    return "Look at these frames", ""


def _percent(share: float) -> str:
    """A share that is never rounded up to all or down to nothing."""
    value = 100 * share
    return f"{value:.0f} %" if 1 <= value <= 99 else f"{value:.1f} %" if 0.1 <= value <= 99.9 else f"{value:.3g} %"


def _median_of_others(values: np.ndarray, index: int) -> float:
    others = np.delete(values, index)
    others = others[np.isfinite(others)]
    return float(np.median(others)) if len(others) else float("inf")


class _Ranges:
    """Ranges of frames of each of M markers, gathered over chunks: (first, last, worst value, sum of the values)."""

    def __init__(self, count: int):
        self._of: list[list[tuple[int, int, float, float]]] = [[] for _ in range(count)]

    def add(self, frames: np.ndarray, flags: np.ndarray, values: np.ndarray | None = None):
        """Adds the flagged frames of a chunk (F,), flags (M, F); values (M, F) of which the worst and sum are kept."""
        if not flags.any():
            return
        # Marker after marker, with an edge where what is flagged begins and where it has ended.
        edge = np.empty((flags.shape[0], flags.shape[1] + 1), bool)
        edge[:, 0], edge[:, -1] = flags[:, 0], flags[:, -1]
        np.not_equal(flags[:, 1:], flags[:, :-1], out=edge[:, 1:-1])
        edges = np.flatnonzero(edge).reshape(-1, 2)
        markers, starts = np.divmod(edges[:, 0], edge.shape[1])
        stops = edges[:, 1] % edge.shape[1]
        told = zip(markers.tolist(), starts.tolist(), frames[starts].tolist(), frames[stops - 1].tolist(), strict=True)
        for (marker, start, first, last), stop in zip(told, stops.tolist(), strict=True):
            mine, worst, total = self._of[marker], 0.0, 0.0
            if values is not None:
                part = values[marker, start:stop]
                worst, total = float(part.max()), float(part.sum())
            if mine and mine[-1][1] + 1 == first:
                before = mine.pop()
                first, worst, total = before[0], max(before[2], worst), before[3] + total
            mine.append((first, last, worst, total))

    def of(self, index: int) -> list[tuple[int, int, float, float]]:
        """The ranges of one marker."""
        return self._of[index]
