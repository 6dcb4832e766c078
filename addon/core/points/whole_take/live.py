# SPDX-License-Identifier: GPL-3.0-or-later
"""Points named while they are recorded.

Every frame is followed at once: a name stays with its trajectory, and goes over to a point that comes where its marker
was a moment ago. What the names are in the first place, and what has been away for longer, is said by the last moment
solved as whole takes are, which takes longer than a frame: a process beside does that.
"""

from dataclasses import dataclass

import numpy as np

from ...body.bodies import Bodies, BodyModel
from ...body.prior import Prior
from ...data.errors import JobError
from ...data.physical import MARKER_LIMITS
from ...data.progress import finished, in_stages
from ...data.takes import NO_MARKER, NO_POINT, Points
from ...posing.posing import subject_of
from ...reconstruction.linking import Links
from ..models import Model
from ..motion import SUBJECT_FRAMES
from ..tracklets import CUTTING, cut
from .likeness import LIKENESS, NO_EVIDENCE, of_ends, steadiest
from .pipeline import PointOptions, as_a_whole, begins, name_frames
from .solving import ROUNDS

WINDOW_S = 2.0  # s of the past that are solved at once: a step or two
FIRST_S = LIKENESS.sample_s  # s of it that are enough to begin with
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

    refused  why, else empty
    subject  the size and shape of who wears them, a batch of 1, where somebody has asked for it
    """

    number: np.ndarray
    marker: np.ndarray
    refused: str = ""
    subject: Bodies | None = None


def solved_window(model: Model, window: Window) -> WindowNames:
    """The names at the end of a window, solved as whole takes are."""
    there = np.isfinite(window.xyz[..., 0])
    names, nothing = ("",) * len(window.number), np.full(there.shape, np.nan)
    take, options = Points(names, window.xyz, nothing, window.rate, 0), PointOptions("likelihood")

    def named():
        frames = yield from name_frames(take, cut(take.xyz, take.rate), model, options)
        _, verdict = yield from as_a_whole(frames, options)
        return verdict.labels.marker

    try:
        marker = finished(in_stages(named(), begins(len(there))))
    except JobError as error:
        return WindowNames(window.number, np.full(len(window.number), NO_MARKER), error.message)
    last = len(there) - 1 - there[::-1].argmax(axis=0)
    return WindowNames(window.number, marker[last, np.arange(len(last))])


def subject_in(model: Model, window: Window, names: WindowNames) -> Bodies | None:
    """The size and shape of whoever is in a window, by what its names are, a batch of 1; None where too few are."""
    lanes = np.flatnonzero(names.marker != NO_MARKER)
    points = np.full((len(window.xyz), len(model.markerset), 3), np.nan)
    for lane, marker in zip(lanes, names.marker[lanes], strict=True):
        there = np.isfinite(window.xyz[:, lane, 0])
        points[there, marker] = window.xyz[there, lane]
    body = BodyModel(model.markerset)
    try:
        return subject_of(body, points, Prior(body), SUBJECT_FRAMES)
    except ValueError:
        return None


class _Trail:
    """A trajectory that is followed: when it began, its last point, when it came, and the marker that it is.

    solved  whether the solver has named it
    fresh   whether it begins with this frame
    """

    def __init__(self, number: int, place: np.ndarray, row: int):
        self.number, self.begun, self.place, self.row, self.marker = number, row, place, row, NO_MARKER
        self.solved, self.fresh = False, True


class LiveNamer:
    """Names the frames of a stream, each at once; `window` is for `solved_window`, and `hear` for what it says.

    A name that is given is settled. Where the solver takes it back, `renamed` says so: the marker that was, and that is
    now, until the next frame. Memory does not grow.
    """

    def __init__(self, within: np.ndarray, rate: float):
        """`within` is how the distances between the markers vary on a subject, variances (M, M) m²."""
        self.markers, self.rate = len(within), rate
        self._near = steadiest(within)
        self._within = within[np.arange(self.markers)[:, None], self._near]
        self.begun, self.row, self.last = 0, -1, NO_POINT
        self.renamed: list[tuple[int, int]] = []
        self._kept = max(round(WINDOW_S * rate), 2)
        self._gap = max(round(CUTTING.max_gap_s * rate), 2)
        self._asked = 0  # the row of the last window's end
        self._forget()

    def _forget(self):
        """Follows nothing any more."""
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
        marker[_said_before(marker)] = NO_MARKER
        for missed in range(self.row - step + 1, self.row + 1):
            self.placed[missed % len(self.placed)] = np.nan
        now = self.placed[self.row % len(self.placed)]
        now[marker[marker != NO_MARKER]] = points[marker != NO_MARKER]
        self._go_on(trails, points, marker, now)
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
        loose = _said_before(ids) | (ids == NO_POINT)
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

    def _go_on(self, trails: list[_Trail], points: np.ndarray, marker: np.ndarray, now: np.ndarray):
        """Names points (P,) that come new where a marker that is not placed `now` (M, 3) was just before."""
        free = np.isnan(now[:, 0])
        new = np.flatnonzero([trail.fresh for trail in trails])
        for one in new:
            trails[one].fresh = False
        if not len(new) or not free.any() or len(now) - free.sum() < LIKENESS.min_neighbours:
            return
        gap = np.tile(self.row - self.seen, (len(new), 1))
        then = np.where(free & (gap < self._gap), (self.row - gap) % len(self.placed), -1)
        at, nobody = np.full(len(new), self.row % len(self.placed)), np.full(len(new), NO_MARKER)
        ends = at, then, gap, points[new].astype(np.float32), self.placed, nobody, self._near, self._within
        odds = np.where(then >= 0, of_ends(*ends, self.rate, LIKENESS), -np.inf)
        for row, best in enumerate(odds.argmax(axis=1)):
            ahead = odds[row, best]
            rivals = np.append(np.delete(odds[row], best), np.delete(odds[:, best], row))
            if ahead - max(rivals.max(initial=-np.inf), NO_EVIDENCE) > ROUNDS.margin:
                trails[new[row]].marker = marker[new[row]] = best
                now[best] = points[new[row]]

    def window(self) -> Window | None:
        """What there is to be solved; None where that is not enough."""
        if not self.past or self.row - self.past[0][0] < FIRST_S * self.rate:
            return None
        self._asked = self.row
        every = np.concatenate([numbers for _, numbers, _ in self.past])
        number, lane = np.unique(every, return_inverse=True)
        first = self.past[0][0]
        frame = np.repeat([row - first for row, *_ in self.past], [len(numbers) for _, numbers, _ in self.past])
        xyz = np.full((self.row - first + 1, len(number), 3), np.nan)
        xyz[frame, lane] = np.concatenate([points for *_, points in self.past])
        return Window(first, self.rate, number, xyz)

    def hear(self, names: WindowNames):
        """Takes what the last window came to for those that are still followed.

        What of them it leaves unnamed loses a name of ours, if it was there for as long as naming takes. A window that
        is refused says nothing.
        """
        self.renamed = []
        if names.refused:
            return
        said = dict(zip(names.number.tolist(), names.marker.tolist(), strict=True))
        latest: dict[int, int] = {}
        for trail in self.trails.values():
            marker = said.get(trail.number, NO_MARKER)
            if marker != NO_MARKER:
                self._rename(trail, marker)
                trail.solved, latest[marker] = True, max(latest.get(marker, 0), trail.number)
        for trail in self.trails.values():
            shown = not trail.solved and self._asked - trail.begun >= FIRST_S * self.rate
            if said.get(trail.number) == NO_MARKER and (shown or latest.get(trail.marker, 0) > trail.number):
                self._rename(trail, NO_MARKER)
        now = self.placed[self.row % len(self.placed)]
        for trail in self.trails.values():
            if trail.marker != NO_MARKER and trail.row == self.row:
                now[trail.marker], self.seen[trail.marker] = trail.place, self.row

    def _rename(self, trail: _Trail, marker: int):
        if trail.marker not in (NO_MARKER, marker):
            self.renamed.append((trail.marker, marker))
        trail.marker = marker


def _said_before(values: np.ndarray) -> np.ndarray:
    """(P,) whether the same stands before each of the values (P,)."""
    before = np.ones(len(values), bool)
    before[np.unique(values, return_index=True)[1]] = False
    return before
