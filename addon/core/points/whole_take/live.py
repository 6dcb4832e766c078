# SPDX-License-Identifier: GPL-3.0-or-later
"""Points named while they are recorded.

Every frame is followed at once: a name stays with its trajectory, which goes on under another number where those around
it carry it, and goes over to a point that comes where its marker was a moment ago and must be now. What the names are
in the first place, and what is not so sure, is said by the last moment solved as whole takes are, which takes longer
than a frame: a process beside does that. What it says is carried on through the frames that came meanwhile. By what was
named, those who wear the markers are known better and better.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...body.bodies import Bodies, BodyModel
from ...body.prior import Prior
from ...data.errors import JobError
from ...data.physical import MARKER_LIMITS
from ...data.progress import finished, in_stages
from ...data.takes import NO_MARKER, NO_POINT, Points
from ...posing.posing import subject_of
from ...reconstruction.linking import Links
from ..models import USUAL_TARGET, Model
from ..motion import SUBJECT_FRAMES
from ..refusals import REFUSAL
from ..tracklets import CUTTING, cut
from ..unordered import of_subject
from .along import carried_along, going_on_odds
from .deciding import least_margin
from .likeness import LIKENESS, NO_EVIDENCE, changed, of_frames, steadiest
from .matching import leading
from .objective import OBJECTIVE
from .pairs import PairDistances, in_take
from .pipeline import PointOptions, as_a_whole, begins, name_frames, refuse_named

WINDOW_S = 2.0  # s of the past that are solved at once: a step or two
FIRST_S = LIKENESS.sample_s  # s of it that are enough to begin with
CAUGHT_UP = 12  # frames of the past that names are carried on through at each new one; by time
SHOWN_S = 0.1  # s from one frame by which the subject is known to the next, at first
MAX_SHOWN = 40  # such frames
NO_POINTS = np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class Window:
    """The last moment: points (T, L, 3) m, NaN where missing, of L trajectories with a number each (L,)."""

    row: int  # of its first frame since the stream began
    rate: float  # frames a second
    number: np.ndarray
    xyz: np.ndarray
    marker: np.ndarray  # (L,) what each trajectory is called so far, NO_MARKER where it is not
    # (K, M, 3) m where the markers of whoever is there were before, in some frames, NaN where one was not
    shown: np.ndarray

    @property
    def end(self) -> int:
        """The row of its last frame."""
        return self.row + len(self.xyz) - 1


@dataclass(frozen=True, eq=False)
class WindowNames:
    """What came of a window: marker (L,) of trajectories number (L,), NO_MARKER where none is sure."""

    number: np.ndarray
    marker: np.ndarray
    refused: str = ""  # why, else empty
    anew: bool = False  # whether they are not as it was known of who was there before
    others: tuple[int, ...] = ()  # the numbers of those that are likelier another marker than they were called
    # where somebody has asked for it, the size and shape of everybody who may wear them, as `subject_in`
    subjects: tuple[Bodies | None, ...] = ()


def solved_window(model: Model, window: Window) -> WindowNames:
    """The names at the end of a window, solved as whole takes are.

    By what is known of who is there, with whom no more than exchanges are tried: that takes a third of the time, and
    names come as much sooner.
    """
    if len(window.shown) and model.likelihood is not None:
        own = replace(model, likelihood=of_subject(model.likelihood, window.shown))
        if not (found := _solved(own, window, known=True)).refused:
            return found
        found = _solved(model, window)
        return replace(found, anew=not found.refused)  # it is somebody else
    return _solved(model, window)


def as_take(window: Window) -> Points:
    """A window as a take of its own."""
    nothing = np.full(window.xyz.shape[:2], np.nan)
    return Points(("",) * len(window.number), window.xyz, nothing, window.rate, 0)


def at_the_end(window: Window, marker: np.ndarray) -> np.ndarray:
    """(L,) the last of the names (T, L) of each trajectory."""
    there = np.isfinite(window.xyz[..., 0])
    return marker[len(there) - 1 - there[::-1].argmax(axis=0), np.arange(there.shape[1])]


def _solved(model: Model, window: Window, known: bool = False) -> WindowNames:
    take, options = as_take(window), PointOptions("likelihood", search="exchanges" if known else "all")

    def named():
        frames = yield from name_frames(take, cut(take.xyz, take.rate), model, options)
        frames = replace(frames, shown=window.shown if known else None)
        solution, verdict = yield from as_a_whole(frames, options)
        refuse_named(frames, solution, verdict, options)
        marker = verdict.labels.marker
        if solution is None:
            return marker, marker
        return marker, solution.tracklets.spread(solution.marker, NO_MARKER, slice(0, len(marker)))

    try:
        marker, likeliest = finished(in_stages(named(), begins(len(window.xyz))))
    except JobError as error:
        return WindowNames(window.number, np.full(len(window.number), NO_MARKER), error.message)
    likeliest = at_the_end(window, likeliest)
    other = (likeliest != window.marker) & (likeliest != NO_MARKER) & (window.marker != NO_MARKER)
    others = tuple(window.number[other].tolist())
    return WindowNames(window.number, at_the_end(window, marker), others=others)


def subject_in(model: Model, window: Window, marker: np.ndarray) -> Bodies | None:
    """The size and shape of whoever is in a window, by its names marker (L,), a batch of 1; None where too few are.

    What is none of the model's markers is somebody else's, or nobody's.
    """
    lanes = np.flatnonzero((marker >= 0) & (marker < len(model.markerset)))
    points = np.full((len(window.xyz), len(model.markerset), 3), np.nan)
    for lane in lanes:
        there = np.isfinite(window.xyz[:, lane, 0])
        points[there, marker[lane]] = window.xyz[there, lane]
    body = BodyModel(model.markerset)
    try:
        return subject_of(body, points, Prior(body), SUBJECT_FRAMES)
    except ValueError:
        return None


class _Trail:
    """A trajectory that is followed: its last point, and when that came."""

    def __init__(self, number: int, place: np.ndarray, row: int):
        self.number, self.place, self.row = number, place, row


def longest_gap(rate: float) -> int:
    """Frames, at `rate` a second, after which what comes may be anything."""
    return max(round(CUTTING.max_gap_s * rate), 2)


class _Given:
    """The names of trajectories, from a frame on.

    marker  of each trajectory that has one, by its number
    solved  the numbers of those that the solver has named
    row     of the last frame
    newest  the number of the last trajectory that the solver was asked about; later ones are new
    placed  (M, 3) m the markers in the last frame, NaN where one is not
    sure    the same by the solver's names alone
    """

    def __init__(self, pairs: PairDistances, rate: float, row: int, newest: int = -1):
        self.marker: dict[int, int] = {}
        self.solved: set[int] = set()
        self.rate, self.row, self.newest = rate, row, newest
        size = len(pairs.mean)
        self.placed = self.sure = np.full((size, 3), np.nan)
        self._pairs, self._near = pairs, steadiest(pairs.variance)
        # As which trajectory and when each marker was there last, and where all of them were then.
        self._had = np.full(size, NO_POINT)
        self._seen, self._then = np.full(size, -np.inf), np.full((size, size, 3), np.nan, np.float32)
        # Of new trajectories when they came, in how many frames they were asked for each marker, and what these said.
        self._asked: dict[int, tuple[int, np.ndarray, np.ndarray]] = {}

    def on(self, row: int, number: np.ndarray, points: np.ndarray) -> np.ndarray:
        """The marker (P,) of each of a later frame's points (P, 3) m, which are of trajectories number (P,)."""
        marker = np.array([self.marker.get(one, NO_MARKER) for one in number.tolist()], int)
        marker[_said_before(marker)] = NO_MARKER
        self.row, self.placed, self.sure = row, np.full_like(self.placed, np.nan), np.full_like(self.placed, np.nan)
        self.placed[marker[marker != NO_MARKER]] = points[marker != NO_MARKER]
        self._ask_back(number, points, marker)
        named = marker != NO_MARKER
        solved = named & np.array([one in self.solved for one in number.tolist()], bool)
        self.sure[marker[solved]] = points[solved]
        self._name_new(np.flatnonzero((number > self.newest) & ~named), number, points, marker)
        there = np.isfinite(self.placed[:, 0])
        self._had[marker[marker != NO_MARKER]] = number[marker != NO_MARKER]
        self._seen[there], self._then[there] = row, self.placed
        return marker

    def _ask_back(self, number: np.ndarray, points: np.ndarray, marker: np.ndarray):
        """Takes the names of those of points (P, 3) m that were away for a moment and come back where they cannot be.

        By their distances: what goes on where a trajectory was lost may be a ghost.
        """
        away = (marker != NO_MARKER) & (self._had[marker] == number) & (self.row - self._seen[marker] > 1)
        if not len(back := np.flatnonzero(away)):
            return
        self.placed[marker[back]] = np.nan
        here = self._likely(points[back], np.isnan(self.placed[:, 0]))[np.arange(len(back)), marker[back]]
        for at in back[here <= NO_EVIDENCE].tolist():
            self.marker.pop(int(number[at]))
            marker[at] = NO_MARKER
        back = back[marker[back] != NO_MARKER]
        self.placed[marker[back]] = points[back]

    def _name_new(self, new: np.ndarray, number: np.ndarray, points: np.ndarray, marker: np.ndarray):
        """Names those of points (P, 3) m that are `new` (N,) where a marker must be that is not there.

        If it was a moment before they came; later what comes may be anything else. The longer they are there, the surer
        are they no ghosts; but two markers are as like each other in all frames.
        """
        now, missing = self.placed, np.isnan(self.placed[:, 0])
        if not len(new) or (~missing).sum() < LIKENESS.min_neighbours:
            return
        odds, worth, may_be = self._odds(number[new], points[new], missing)
        best, own, rival = leading(odds)
        rows = np.arange(len(new))
        sure = may_be[rows, best] & (own > NO_EVIDENCE) & (own > rival + OBJECTIVE.max_marker)
        sure &= own * worth[rows, best] > NO_EVIDENCE + OBJECTIVE.max_marker
        for at, name in zip(new[sure].tolist(), best[sure].tolist(), strict=True):
            self.marker[int(number[at])] = marker[at] = name
            now[name] = points[at]

    def _odds(self, number: np.ndarray, points: np.ndarray, missing: np.ndarray) -> tuple[np.ndarray, ...]:
        """Mean log odds (N, M) that new trajectories number (N,), now at points (N, 3) m, are markers `missing` (M,).

        With how many independent frames they are worth (N, M), and whether the marker was there a moment before.
        """
        said = [self._asked.setdefault(one, (self.row, *np.zeros((2, len(missing))))) for one in number.tolist()]
        here = self._likely(points, missing)
        for now, (_, count, total) in zip(here, said, strict=True):
            count += np.isfinite(now)
            total += np.nan_to_num(now)
        count, total = (np.array([one[part] for one in said]) for part in (1, 2))
        odds = np.where(np.isfinite(here), total / np.maximum(count, 1), -np.inf)
        worth = np.minimum(1 + count / self.rate / LIKENESS.sample_s, LIKENESS.max_samples)
        may_be = np.array([[came] for came, *_ in said]) - self._seen < longest_gap(self.rate)
        return odds, worth, may_be

    def _likely(self, points: np.ndarray, missing: np.ndarray) -> np.ndarray:
        """Log odds (N, M) that points (N, 3) m are markers `missing` (M,), by what is there now; NaN of all others."""
        frame, nobody = np.zeros((len(points), 1), int), np.full(len(points), NO_MARKER)
        given = nobody, self._near, *self._expected(missing), np.tile(missing, (len(points), 1)), LIKENESS
        return of_frames(frame, points[:, None], self.placed[None], *given)

    def _expected(self, missing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean m and variance m² of the distances (M, Q) of each of `missing` (M,) to its neighbours now.

        They are what they were when it was there last, and become what they are at any time. By how much they vary
        training says, and its neighbours do: who is off from those that go with the marker is as far off from it.
        """
        rows, pairs = np.arange(len(self._near))[:, None], self._pairs
        mean, unsure, within = (part[rows, self._near] for part in (pairs.mean, pairs.unsure, pairs.within))
        before = np.linalg.norm(self._then[rows, rows] - self._then[rows, self._near], axis=2)
        part = changed(self.row - self._seen[:, None], self.rate, LIKENESS)
        part = np.where(np.isfinite(before), part, 1.0)
        kept = np.sqrt(1 - part)
        variance = LIKENESS.link_sd_m**2 + part * within + (1 - kept) ** 2 * unsure
        some = np.flatnonzero(missing)
        variance[some] += self._off(some)
        return mean + kept * np.where(np.isfinite(before), before - mean, 0.0), variance

    def _off(self, some: np.ndarray) -> np.ndarray:
        """(K, Q) m², how far off the neighbours of some markers (K,) are from those that keep their distances best.

        Of these as many are asked as fix a place. Off is what is not as when the marker was there last.
        """
        near, rows = self._near[some], np.arange(len(some))[:, None]
        now, then = self.placed[near], self._then[some[:, None], near]
        best = np.argsort(np.isnan(now[..., 0]), axis=1, kind="stable")[:, : LIKENESS.min_neighbours]
        new, old = (np.linalg.norm(each[rows, best][:, :, None] - each[:, None], axis=3) for each in (now, then))
        off = new - old
        known = np.isfinite(off) & (near[rows, best][:, :, None] != near[:, None])
        return np.where(known, off**2, 0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)

    def forget(self, numbers: set[int]):
        """Forgets all trajectories but some."""
        self.marker = {one: marker for one, marker in self.marker.items() if one in numbers}
        self.solved &= numbers
        self._asked = {one: said for one, said in self._asked.items() if one in numbers}


class _Shown:
    """Where the markers of subjects `whose` (M,) were in some frames, spread over all of the stream, however long."""

    def __init__(self, whose: np.ndarray, rate: float):
        self.frames: list[np.ndarray] = []
        self._whose = whose
        self._next, self._step = 0, max(round(SHOWN_S * rate), 1)

    def add(self, row: int, placed: np.ndarray):
        """Adds a frame's markers (M, 3) m, if it is time for one, of whoever has half of them there."""
        if row < self._next:
            return
        there = np.bincount(self._whose, np.isfinite(placed[:, 0])) / np.bincount(self._whose)
        known = there >= REFUSAL.min_half
        if not known.any():
            return
        self.frames.append(np.where(known[self._whose, None], placed, np.nan))
        if len(self.frames) > MAX_SHOWN:
            self.frames, self._step = self.frames[::2], 2 * self._step
        self._next = row + self._step

    def take_back(self, markers: np.ndarray):
        """Forgets where some markers (N,) were, as they were not there."""
        for placed in self.frames:
            placed[markers] = np.nan


class LiveNamer:
    """Names the frames of a stream, each at once; `window` is for `solved_window`, and `hear` for what it says.

    A name that is given is settled. Where the solver takes it back, `renamed` says so: the marker that was, and that is
    from this frame on, NO_MARKER for none. Memory does not grow.
    """

    def __init__(self, trained: Sequence[PairDistances], rate: float):
        """`trained` is how far the markers of each subject are from each other."""
        self.trained, self.rate = trained, rate
        self.whose = whose = np.repeat(np.arange(len(trained)), [len(one.mean) for one in trained])
        self.begun, self.row, self.last = 0, -1, NO_POINT
        self.renamed: list[tuple[int, int]] = []
        self._kept = max(round(WINDOW_S * rate), 2)
        self._gap = longest_gap(rate)
        self._least = REFUSAL.min_named * np.bincount(whose).min()  # points, of fewer a window would be refused
        self._there = 0  # the last row with as many
        self._forget()

    def _forget(self):
        """Follows nothing any more."""
        self.trails: dict[int, _Trail] = {}
        self.links = Links.at(self.rate)
        self.past: list[tuple[int, np.ndarray, np.ndarray]] = []
        self.given, self.shown = _Given(self._pairs(()), self.rate, self.row), _Shown(self.whose, self.rate)
        self._asked: Window | None = None
        self._later: _Given | None = None  # what was heard, on its way through the frames that came meanwhile

    def _pairs(self, shown: Sequence[np.ndarray]) -> PairDistances:
        """How far all markers are from each other, by training and where they were `shown`, each (M, 3) m.

        Those of two subjects say nothing.
        """
        every = np.full((3, len(self.whose), len(self.whose)), np.nan)
        for person, trained in enumerate(self.trained):
            own = self.whose == person
            known = in_take(trained, np.array(shown)[:, own]) if len(shown) else trained
            every[:, *np.ix_(own, own)] = known.mean, known.unsure, known.within
        return PairDistances(*every)

    def name(self, number: int, points: np.ndarray, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The marker (P,) of each point (P, 3) m of the next frame, NO_MARKER where it is not sure, and its trajectory.

        `number` is the sender's of the frame, ids (P,) those of the points' trajectories, NO_POINT where there is none.
        """
        step = number - self.last if self.row >= 0 else 1
        if not 0 < step <= self._kept:  # it began anew, or was away
            self._forget()
            step = 1
        self.last, self.row, self.renamed = number, self.row + step, []
        trajectory = self._followed(points, ids, step)
        self.past.append((self.row, trajectory, points))
        while self.past[0][0] <= self.row - self._kept:
            self.past.pop(0)
        marker = self.given.on(self.row, trajectory, points)
        if self._later is not None:
            marker = self._caught_up(self._later, marker)
        self.shown.add(self.row, self.given.sure)
        if len(points) >= self._least:
            self._there = self.row
        elif self.row - self._there > self._kept:  # who comes then may be somebody else
            self.shown = _Shown(self.whose, self.rate)
        return marker, trajectory

    def _followed(self, points: np.ndarray, ids: np.ndarray, step: int) -> np.ndarray:
        """(P,) the trajectory of each point, by the sender's number or, where it has none or says one twice, by motion.

        Where these begin a new one, by what is around it.
        """
        for _ in range(step - 1):
            self.links.link(NO_POINTS)
        loose = _said_before(ids) | (ids == NO_POINT)
        key = 2 * ids + 1
        key[loose] = 2 * self.links.link(points[loose])
        number = np.array([self._followed_to(one, place) for one, place in zip(key.tolist(), points, strict=True)], int)
        new = np.flatnonzero(number == NO_POINT).tolist()
        again = self._going_on(number, points) if new else {}
        for at in new:
            if at not in again:
                again[at] = _Trail(self.begun, points[at], self.row)
                self.begun += 1
            trail = self.trails[int(key[at])] = again[at]
            trail.place, trail.row, number[at] = points[at], self.row, trail.number
        if len(self.trails) > 2 * len(number):
            self.trails = {key: one for key, one in self.trails.items() if self.row - one.row <= self._gap}
            self.given.forget({one.number for one in self.trails.values()})
        return number

    def _followed_to(self, key: int, place: np.ndarray) -> int:
        """The trajectory of a key, which goes on at a place (3,) m; NO_POINT where it has none, or none that can."""
        trail = self.trails.get(key)
        if trail is None:
            return NO_POINT
        gap, away = self.row - trail.row, place - trail.place
        if gap > self._gap or away @ away > (MARKER_LIMITS.fastest_m_s / self.rate * gap) ** 2:
            return NO_POINT
        trail.place, trail.row = place, self.row
        return trail.number

    def _going_on(self, number: np.ndarray, points: np.ndarray) -> dict[int, _Trail]:
        """By its row the lost trail that each point (P, 3) m plainly goes on that has no trajectory number (P,) yet.

        It is no other key's any more.
        """
        lost = {key: trail for key, trail in self.trails.items() if 0 < self.row - trail.row <= self._gap}
        old, new = np.flatnonzero(number != NO_POINT), np.flatnonzero(number == NO_POINT)
        if not lost or not len(old):
            return {}
        now, order, rows = number[old], np.argsort(number[old]), np.array([trail.row for trail in lost.values()])
        then, wanted = np.full((len(lost), len(now), 3), np.nan), set(rows.tolist())
        for row, before, place in self.past[-self._gap :]:
            if row in wanted:
                at = order[np.minimum(np.searchsorted(now, before, sorter=order), len(now) - 1)]
                same = now[at] == before
                then[np.ix_(rows == row, at[same])] = place[same]
        expected = carried_along(np.array([trail.place for trail in lost.values()]), then, points[old])
        best, own, rival = leading(going_on_odds(expected, (self.row - rows) / self.rate, points[new]).T)
        sure = own > np.maximum(rival, NO_EVIDENCE) + least_margin(USUAL_TARGET)
        keys = list(lost)
        return {at: self.trails.pop(keys[one]) for at, one in zip(new[sure].tolist(), best[sure].tolist(), strict=True)}

    def window(self) -> Window | None:
        """What there is to be solved; None where that is not enough."""
        past, lost = self.past, False
        if not past or self._later is not None or len(past[-1][1]) < self._least:
            return None
        if self.shown.frames:
            there = min(len(past[-1][1]), len(self.whose))
            lost = np.isfinite(self.given.placed[:, 0]).sum() < REFUSAL.min_half * there
        if lost:  # what comes first is what there is since then
            past = [part for part in past if part[0] > self.row - FIRST_S * self.rate]
            if not all(len(number) for _, number, _ in past):
                return None
        if self.row - past[0][0] < FIRST_S * self.rate - 1:
            return None
        every = np.concatenate([numbers for _, numbers, _ in past])
        number, lane = np.unique(every, return_inverse=True)
        first = past[0][0]
        frame = np.repeat([row - first for row, *_ in past], [len(numbers) for _, numbers, _ in past])
        xyz = np.full((self.row - first + 1, len(number), 3), np.nan)
        xyz[frame, lane] = np.concatenate([points for *_, points in past])
        shown = np.array(self.shown.frames).reshape(-1, len(self.whose), 3)
        marker = np.array([self.given.marker.get(one, NO_MARKER) for one in number.tolist()], int)
        self._asked = Window(first, self.rate, number, xyz, marker, shown)
        return self._asked

    def hear(self, names: WindowNames):
        """Takes what the last window came to; a window that is refused says nothing.

        The next frames go by it, as soon as it is carried on through those that came meanwhile.
        """
        if self._asked is None:
            return
        past = [self._asked.number, *(numbers for _, numbers, _ in self.past)]
        self.given.forget({one.number for one in self.trails.values()}.union(*(numbers.tolist() for numbers in past)))
        if names.anew:
            self.shown = _Shown(self.whose, self.rate)
        if names.refused:
            return
        pairs = self._pairs(self.shown.frames)
        later = _Given(pairs, self.rate, self._asked.end - self._gap, int(names.number.max(initial=-1)))
        told = dict(zip(names.number.tolist(), names.marker.tolist(), strict=True))
        said = {number: marker for number, marker in told.items() if marker != NO_MARKER}
        kept = {number: marker for number, marker in self.given.marker.items() if number <= later.newest}
        for number in self._taken_back(self._asked, said, names.others):
            kept.pop(number, None)
        later.marker, later.solved = kept | said, (self.given.solved & kept.keys()) | said.keys()
        self._later = later

    def _taken_back(self, window: Window, said: dict[int, int], others: tuple[int, ...]) -> list[int]:
        """The trajectories of a window that lose a name of ours as it leaves them unnamed.

        Because they were there for as long as naming takes, or are among `others`, which are likelier another marker,
        or that name goes to a newer one, or to one that is there.
        """
        there = np.isfinite(window.xyz[..., 0])
        begun = there.argmax(axis=0)
        now = set(window.number[there[-1]].tolist())
        elsewhere = {marker for number, marker in said.items() if number in now}
        latest: dict[int, int] = {}
        for number, marker in said.items():
            latest[marker] = max(latest.get(marker, 0), number)
        found = []
        for number, first in zip(window.number.tolist(), begun.tolist(), strict=True):
            ours = self.given.marker.get(number, NO_MARKER)
            if ours == NO_MARKER or number in said:
                continue
            shown = len(there) - first > FIRST_S * self.rate and number not in self.given.solved
            if shown or number in others or ours in elsewhere or latest.get(ours, 0) > number:
                found.append(number)
        return found

    def _caught_up(self, later: _Given, marker: np.ndarray) -> np.ndarray:
        """The markers (P,) of the last frame by what was heard, if that has come so far; else as they are."""
        for part in [part for part in self.past if part[0] > later.row][:CAUGHT_UP]:
            told = later.on(*part)
            self.shown.add(later.row, later.sure)
        if later.row < self.row:
            return marker
        self.given, self._later = later, None
        changed = (marker != told) & (marker != NO_MARKER)
        self.renamed = list(zip(marker[changed].tolist(), told[changed].tolist(), strict=True))
        self.shown.take_back(marker[changed])
        return told


def _said_before(values: np.ndarray) -> np.ndarray:
    """(P,) whether the same stands before each of the values (P,)."""
    order = np.argsort(values, kind="stable")
    before = np.zeros(len(values), bool)
    before[order[1:]] = values[order[1:]] == values[order[:-1]]
    return before
