# SPDX-License-Identifier: GPL-3.0-or-later
"""Points named while they are recorded.

Every frame is followed at once: a name stays with its trajectory, and a point that comes new is named by where the
subject's markers were a moment ago and by its distances to those that have names. What the names are in the first place
is said by the last moment solved as whole takes are, which takes longer than a frame: a process beside does that.
"""

from dataclasses import dataclass

import numpy as np

from ...data.errors import JobError
from ...data.physical import MARKER_LIMITS
from ...data.progress import finished, in_stages
from ...data.takes import NO_MARKER, NO_POINT, Points
from ...reconstruction.linking import Links
from ..models import Model
from ..tracklets import CUTTING, cut
from .likeness import LIKENESS, NO_EVIDENCE, of_ends, of_frames, steadiest
from .pairs import PairDistances, corrected, moments, trained_pairs
from .pipeline import PointOptions, as_a_whole, begins, name_frames
from .solving import ROUNDS

WINDOW_S = 2.0  # s of the past that are solved at once: a step or two
FIRST_S = LIKENESS.sample_s  # s of it that are enough to begin with
REMEMBERED = 2000  # frames of a subject whose distances are known by them: memory
STRICT = 2.0  # times more is asked of what is not where the marker was a moment ago: a ghost may be beside it
MOST_DOUBTS = 2  # windows that leave a trajectory unnamed, after which a name of ours is taken back
NO_POINTS = np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class Window:
    """The last moment: points (T, L, 3) m, NaN where missing, of L trajectories with a number each (L,).

    row   of its first frame since the stream began
    rate  frames a second
    """

    row: int
    rate: float
    number: np.ndarray
    xyz: np.ndarray


@dataclass(frozen=True, eq=False)
class WindowNames:
    """What came of a window: marker (L,) of trajectories number (L,), NO_MARKER where none is sure.

    pairs    (3, M, M) what is known of the subject's distances, as `PairDistances`; none where the window was refused
    refused  why, else empty
    """

    number: np.ndarray
    marker: np.ndarray
    pairs: np.ndarray
    refused: str = ""


class WindowSolver:
    """Solves one window after the other as whole takes are, and remembers who the subject is."""

    def __init__(self, model: Model):
        self.model, self.row, self.pairs = model, 0, trained_pairs(model)
        self.placed = np.zeros((0, len(model.markerset), 3), np.float32)

    def solve(self, window: Window) -> WindowNames:
        """The names at the end of a window."""
        lanes = len(window.number)
        take = Points(("",) * lanes, window.xyz, np.full(window.xyz.shape[:2], np.nan), window.rate, 0)
        nobody = np.full(lanes, NO_MARKER)
        try:
            options = PointOptions("likelihood")
            marker = finished(in_stages(self._named(take, options), begins(len(take.xyz))))
        except JobError as error:
            return WindowNames(window.number, nobody, np.zeros((0, 0, 0)), error.message)
        there = np.isfinite(window.xyz[..., 0])
        last = len(there) - 1 - there[::-1].argmax(axis=0)
        frame, lane = np.nonzero(marker != NO_MARKER)
        placed = np.full((len(there), self.placed.shape[1], 3), np.nan, np.float32)
        placed[frame, marker[frame, lane]] = window.xyz[frame, lane]
        new = placed[max(self.row - window.row, 0) :]
        self.row = window.row + len(placed)
        self.placed = np.concatenate([self.placed, new])[-REMEMBERED:]
        pairs = corrected(self.pairs, moments(self.placed))
        every = np.stack([pairs.mean, pairs.unsure, pairs.within])
        return WindowNames(window.number, np.where(there.any(axis=0), marker[last, np.arange(lanes)], NO_MARKER), every)

    def _named(self, take: Points, options: PointOptions):
        frames = yield from name_frames(take, cut(take.xyz, take.rate), self.model, options)
        _, verdict = yield from as_a_whole(frames, options)
        return verdict.labels.marker


class _Trail:
    """A trajectory that is followed: its last point, when it came, the marker that it is, and what speaks for each.

    solved  whether the solver has named it
    doubts  else how often it had no name for it
    looks   frames in which it was compared with every marker: `odds` (M,) in all, in `count` (M,) of them, and what
            spoke for each marker `before`, when the trajectory began
    """

    def __init__(self, number: int, place: np.ndarray, row: int):
        self.number, self.place, self.row, self.marker = number, place, row, NO_MARKER
        self.solved, self.doubts, self.looks = False, 0, 0
        self.odds = self.count = self.before = np.zeros(0)


class LiveNamer:
    """Names the frames of a stream, each at once; `window` is for a `WindowSolver`, and `hear` for what it says.

    A name that is given is settled. Where the solver takes it back, `renamed` says so: the marker that was, and that is
    now, until the next frame. Memory does not grow.
    """

    def __init__(self, markers: int, rate: float):
        self.markers, self.rate = markers, rate
        self.pairs: PairDistances | None = None
        self.begun, self.row, self.last = 0, -1, NO_POINT
        self.renamed: list[tuple[int, int]] = []
        self._kept = max(round(WINDOW_S * rate), 2)
        self._gap = max(round(CUTTING.max_gap_s * rate), 2)
        self._forget()

    def _forget(self):
        """Follows nothing any more; who the subject is stays known."""
        self.trails: dict[int, _Trail] = {}
        self.links = Links.at(self.rate)
        self.past: list[tuple[int, np.ndarray, np.ndarray]] = []
        self.placed = np.full((self._gap + 1, self.markers, 3), np.nan, np.float32)
        self.seen = np.full(self.markers, -self._gap)

    def name(self, number: int, points: np.ndarray, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The marker (P,) of each point (P, 3) m of the next frame, NO_MARKER where it is not sure, and its trajectory.

        `number` is the sender's of the frame, ids (P,) those of the points' trajectories, NO_POINT where there is none.
        """
        step = number - self.last if self.row >= 0 else 1
        if not 0 < step <= self._kept:  # it began anew, or was away
            self._forget()
            step = 1
        self.last, self.row = number, self.row + step
        trails = self._followed(points, ids, step)
        marker = np.array([trail.marker for trail in trails], int)
        _, first = np.unique(marker, return_index=True)
        twice = np.ones(len(marker), bool)
        twice[first] = False
        marker[twice] = NO_MARKER
        for missed in range(self.row - step + 1, self.row + 1):
            self.placed[missed % len(self.placed)] = np.nan
        now = self.placed[self.row % len(self.placed)]
        now[marker[marker != NO_MARKER]] = points[marker != NO_MARKER]
        if self.pairs is not None:
            self._recognise(trails, points, marker, now)
        self.seen[marker[marker != NO_MARKER]] = self.row
        trajectory = np.array([trail.number for trail in trails], int)
        self.past.append((self.row, trajectory, points))
        while self.past[0][0] <= self.row - self._kept:
            self.past.pop(0)
        return marker, trajectory

    def _followed(self, points: np.ndarray, ids: np.ndarray, step: int) -> list[_Trail]:
        """The trail of each point: by the sender's number or, where it has none or says one twice, by where it goes."""
        for _ in range(step - 1):
            self.links.link(NO_POINTS)
        loose = np.ones(len(ids), bool)
        loose[np.unique(ids, return_index=True)[1]] = False
        loose |= ids == NO_POINT
        key = 2 * ids + 1
        key[loose] = 2 * self.links.link(points[loose])
        found = []
        far = MARKER_LIMITS.fastest_m_s / self.rate
        for one, place in zip(key.tolist(), points, strict=True):
            trail = self.trails.get(one)
            if trail is not None:
                gap, away = self.row - trail.row, place - trail.place
                if gap > self._gap or away @ away > (far * gap) ** 2:
                    trail = None
            if trail is None:
                trail = self.trails[one] = _Trail(self.begun, place, self.row)
                self.begun += 1
            trail.place, trail.row = place, self.row
            found.append(trail)
        if len(self.trails) > 2 * len(found):
            self.trails = {key: one for key, one in self.trails.items() if self.row - one.row <= self._gap}
        return found

    def _recognise(self, trails: list[_Trail], points: np.ndarray, marker: np.ndarray, now: np.ndarray):
        """Names points that have no name, (P,) of `marker`, by markers that are placed `now` (M, 3) or were."""
        free = np.isnan(now[:, 0])
        new = np.flatnonzero(marker == NO_MARKER)
        if not len(new) or not free.any() or len(now) - free.sum() < LIKENESS.min_neighbours:
            return
        xyz, nobody = points[new].astype(np.float32), np.full(len(new), NO_MARKER)
        asked = np.broadcast_to(free, (len(new), self.markers))
        given = self._near, self._mean, self._variance, asked, LIKENESS
        odds = of_frames(np.zeros((len(new), 1), int), xyz[:, None], now[None], nobody, *given)
        fresh = np.array([trails[one].looks == 0 for one in new])
        if fresh.any():
            gap = np.broadcast_to(self.row - self.seen, asked.shape)[fresh]
            then = np.where(asked[fresh] & (gap < self._gap), (self.row - gap) % len(self.placed), -1)
            at = np.full(len(then), self.row % len(self.placed))
            ends = at, then, gap, xyz[fresh], self.placed, nobody[fresh], self._near_within, self._within
            before = of_ends(*ends, self.rate, LIKENESS)
            # What was seen a moment ago is not far from there.
            before -= STRICT * ROUNDS.margin * ((then >= 0) & (before < ROUNDS.margin))
            for one, said in zip(new[fresh], before, strict=True):
                trails[one].odds, trails[one].count = np.zeros((2, self.markers))
                trails[one].before = said
        for one, said in zip(new, odds, strict=True):
            trail = trails[one]
            trail.looks += 1
            there = np.isfinite(said)
            trail.odds[there] += said[there]
            trail.count += there
        mean = np.array([trails[one].odds / np.maximum(trails[one].count, 1) for one in new])
        worth = 1 + np.array([trails[one].looks for one in new]) / self.rate / LIKENESS.sample_s
        total = mean * np.minimum(worth, LIKENESS.max_samples)[:, None] + [trails[one].before for one in new]
        total = np.where(asked, total, -np.inf)
        best = total.argmax(axis=1)
        rows = np.arange(len(new))
        ahead = total[rows, best]
        total[rows, best] = -np.inf
        own = np.maximum(total.max(axis=1), NO_EVIDENCE)
        for row in rows:
            others = np.flatnonzero(best == best[row])
            rival = max(ahead[others[others != row]], default=-np.inf)
            rival = max(rival, np.delete(total[:, best[row]], row).max(initial=-np.inf), own[row])
            if ahead[row] - rival > ROUNDS.margin:
                trails[new[row]].marker = marker[new[row]] = best[row]
                now[best[row]] = points[new[row]]

    def window(self) -> Window | None:
        """What there is to be solved; None where that is not enough."""
        if not self.past or self.row - self.past[0][0] < FIRST_S * self.rate:
            return None
        every = np.concatenate([numbers for _, numbers, _ in self.past])
        number, lane = np.unique(every, return_inverse=True)
        first = self.past[0][0]
        frame = np.repeat([row - first for row, *_ in self.past], [len(numbers) for _, numbers, _ in self.past])
        xyz = np.full((self.row - first + 1, len(number), 3), np.nan)
        xyz[frame, lane] = np.concatenate([points for *_, points in self.past])
        return Window(first, self.rate, number, xyz)

    def hear(self, names: WindowNames):
        """Takes what a window came to for those that are still followed."""
        if names.pairs.size:
            self.pairs = pairs = PairDistances(*names.pairs)
            rows = np.arange(self.markers)[:, None]
            self._near, self._near_within = steadiest(pairs.variance), steadiest(pairs.within)
            self._mean, self._variance = pairs.mean[rows, self._near], pairs.variance[rows, self._near]
            self._within = pairs.within[rows, self._near_within]
        said = dict(zip(names.number.tolist(), names.marker.tolist(), strict=True))
        self.renamed = []
        latest: dict[int, int] = {}
        for trail in self.trails.values():
            marker = said.get(trail.number, NO_MARKER)
            if marker != NO_MARKER:
                self._rename(trail, marker)
                trail.solved, latest[marker] = True, max(latest.get(marker, 0), trail.number)
        for trail in self.trails.values():
            doubted = said.get(trail.number) == NO_MARKER
            trail.doubts += doubted and not trail.solved
            if trail.doubts >= MOST_DOUBTS or (doubted and latest.get(trail.marker, 0) > trail.number):
                self._rename(trail, NO_MARKER)
                trail.before = np.full(self.markers, -np.inf)

    def _rename(self, trail: _Trail, marker: int):
        if trail.marker not in (NO_MARKER, marker):
            self.renamed.append((trail.marker, marker))
        trail.marker = marker
