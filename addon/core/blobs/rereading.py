# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames whose names do not suit the subject that the take shows: read again, from the frames beside them.

A name goes wrong while its marker is hidden, above all where the subject has just been found and nobody knows yet how
its markers sit. Later frames know; from them the stretch is followed again, forwards and backwards, and what explains
it best stays.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import PLACEMENT
from ..geometry.views import View
from .known_subject import KnownSubject, judged, known_subject_of, strain
from .subject import Setup, expect, name, refit
from .swaps import MAX_EXCHANGES, SWAP_STEPS, SWAPS, swap_names, try_swaps
from .tracking import Followed, FrameResult, Track, advanced, difference, follow


@dataclass(frozen=True)
class RereadOptions:
    """Which frames are read again, and which reading is better.

    min_frames     physical: that show a subject, half a second: a marker that is in half of them has its place in them
    around         physical: frames around a doubtful one that are looked at, and that may lie between two of a stretch
    """

    min_frames: int = 30
    around: int = 6


REREADING = RereadOptions()


@dataclass(frozen=True)
class Reread:
    """Frames that were read again, first and last both included; `track` is where one read forwards to its end was."""

    first: int
    last: int
    track: Track | None


class Rereader:
    """Judges frames of a take by the subject that they show. The subject is kept from chunk to chunk."""

    def __init__(self, setup: Setup, options: RereadOptions = REREADING):
        self.setup, self.options = setup, options
        self.known: KnownSubject | None = None

    def read_again(
        self, views: Sequence[View], results: list[FrameResult | None], before: FrameResult | None
    ) -> list[Reread]:
        """Puts better readings into `results` where there are any; returns the stretches that were changed.

        `before` is the frame before the first, None where there is none.
        """
        known = np.array([index for index, result in enumerate(results) if result is not None], dtype=int)
        if len(known) < self.options.min_frames:
            return []
        shown, enough = [results[index] for index in known], self.options.min_frames // 2
        self.known = known_subject_of(shown, self.setup, self.known, enough)
        # What is over in half the frames around is not worth the time.
        doubtful = self._doubtful(views, results, known[:: self.options.around // 2])
        near = known[(np.abs(known[:, None] - doubtful) <= self.options.around).any(axis=1)]
        doubtful = self._doubtful(views, results, near)
        return [
            stretch
            for first, last in self._stretches(doubtful, results)
            if (stretch := self._read_stretch(views, results, before, first, last))
        ]

    def _doubtful(self, views, results, frames: np.ndarray) -> np.ndarray:
        """Those of the frames (K,) in which a name does not suit the subject."""
        if not len(frames):
            return frames
        _, off = self._judged(views, {index: results[index] for index in frames})
        return frames[(off > self.setup.rules.max_on_point).any(axis=1)]

    def _judged(self, views, readings: dict[int, FrameResult]) -> tuple[np.ndarray, np.ndarray]:
        """See `known_subject.judged`; an unnamed blob costs, too."""
        cost, off = judged([views[index] for index in readings], list(readings.values()), self.known, self.setup)
        unnamed = [(views[index].real & (one.naming.owner < 0)).sum() for index, one in readings.items()]
        return cost + self.setup.rules.min_lead * np.array(unnamed), off

    def _stretches(self, doubtful: np.ndarray, results) -> list[tuple[int, int]]:
        """First and last frames of what is to be read again; all of it was labelled."""
        parts = np.split(doubtful, np.flatnonzero(np.diff(doubtful) > self.options.around) + 1)
        found = []
        for part in parts:
            if not len(part):
                continue
            first, last = int(part[0]), int(part[-1])
            if any(result is None for result in results[first : last + 1]):
                continue
            for _ in range(self.options.around // 3):  # names go wrong slowly
                first -= first > 0 and results[first - 1] is not None
                last += last + 1 < len(results) and results[last + 1] is not None
            found.append((first, last))
        return found

    def _read_stretch(self, views, results, before, first: int, last: int) -> Reread | None:
        """Keeps the best of three readings: as it was, or forwards up to some frame and backwards down to it."""
        old, _ = self._judged(views, {index: results[index] for index in range(first, last + 1)})
        earlier = results[first - 2 : first] if first > 1 else [None, before if first == 0 else results[0]]
        later = results[last + 1 : last + 3][::-1]
        forth = self._follow(views, earlier, range(first, last + 1))
        back = self._follow(views, [None] * (2 - len(later)) + later, range(last, first - 1, -1))
        costs = []
        for reading in (forth, back):
            cost = np.full(last - first + 1, np.inf)
            if reading:
                new = {index: self._result(results[index], followed) for index, followed in reading.items()}
                cost[np.array(list(new)) - first], _ = self._judged(views, new)
            costs.append(cost)
        ahead = np.append(0, np.cumsum(costs[0]))
        behind = np.append(np.cumsum(costs[1][::-1])[::-1], 0)
        split = int(np.argmin(ahead + behind))
        if not (ahead + behind)[split] < old.sum():
            return None
        for index in range(first, last + 1):
            followed = forth[index] if index < first + split else back[index]
            results[index] = self._result(results[index], followed)
        return Reread(first, last, forth[last].track if split == len(old) else None)

    @staticmethod
    def _result(old: FrameResult, followed: Followed) -> FrameResult:
        bodies = followed.track.subject.bodies
        return replace(old, bodies=bodies, naming=followed.naming, expected=followed.expected)

    def _follow(self, views, start: Sequence[FrameResult | None], frames: range) -> dict[int, Followed]:
        """The frames followed from the last one of `start`, in their order; fewer where the subject is lost."""
        found: dict[int, Followed] = {}
        if start[-1] is None:
            return found
        track = self._track(*start)
        for index in frames:
            followed = self._thought_over(follow(track, views[index], self.setup), track, views[index])
            if followed.track.lost:
                break
            track = followed.track
            found[index] = followed
        return found

    def _track(self, earlier: FrameResult | None, begin: FrameResult) -> Track:
        """A track from a labelled frame, as fast as it came from the one before."""
        points = begin.naming.meeting.points
        subject = replace(self.known.subject, bodies=self.known.bodies(begin.bodies))
        track = Track.begin(subject, points, begin.expected.visible, self.setup.model)
        track = replace(track, unseen=np.where(np.isfinite(points[:, 0]), 0, track.unseen))
        if earlier is None:
            return track
        velocity = difference(begin.bodies, earlier.bodies)
        velocity[:, 6:PLACEMENT] = 0
        return replace(track, velocity=velocity)

    def _thought_over(self, followed: Followed, track: Track, view: View) -> Followed:
        """The frame after `track`, with names exchanged for as long as that suits the subject better."""
        setup, naming = self.setup, followed.naming
        subject = replace(self.known.subject, bodies=self.known.bodies(followed.track.subject.bodies))
        subject, state = refit(view, naming, subject, setup, SWAP_STEPS, setup.prior)
        if strain(view, naming, self.known, state.posed.markers[0], setup).max() < setup.rules.min_lead:
            return followed
        changed = False
        for _ in range(MAX_EXCHANGES):
            swaps = try_swaps(view, naming, subject, state, setup, setup.prior)
            if not len(swaps.loss) or swaps.loss.min() > -SWAPS.min_gain:
                break
            swap_names(naming, swaps.orders[swaps.loss.argmin()])
            subject, state = refit(view, naming, subject, setup, SWAP_STEPS, setup.prior)
            changed = True
        if not changed:
            return followed
        expected = expect(subject, state, setup)
        naming = name(view, expected, subject, setup)
        return Followed(advanced(track, subject, state.posed, naming, expected, setup), naming, expected)
