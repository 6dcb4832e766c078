# SPDX-License-Identifier: GPL-3.0-or-later
"""How well each way of filling does on gaps cut into the same take, where the truth is known."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..data.takes import evenly_spread
from .gaps import Gap, KnownMarkers

# Positions (L, 3) m of a gap by a method and, where it says so, how sure each is (L,) m; None where it cannot fill it.
Answer = tuple[np.ndarray, np.ndarray | None] | None
Way = Callable[[Gap, np.ndarray], Answer]


@dataclass(frozen=True)
class GapTrialOptions:
    """How gaps are cut for trials; reckoned, but what names takes.

    gaps         cut for each marker, length and set of neighbours that a gap of the take has
    first        of them after which a method that errs `hopeless` times as much as the best is tried no more
    hopeless     the same
    grade        lengths, and how fast neighbours move, are distinguished in steps of this factor: errors grow slowly
    alike        factor within which the neighbours must move as fast in a trial; where no place is like that, those
                 that are most like it are taken, and what does not turn with the neighbours is not used
    least        part of all places that are always looked at
    still_m_s    speed that is no motion but noise
    carried_by   neighbours whose middle tells how fast they move
    shortest     part of its length that a gap may be shortened by where the take has no room to cut it whole
    open_s       seconds hidden beyond a gap that stands for one at the start or end of the take; what time carries
                 has ended by then
    lead         part by which another method must err less than the favourite to be taken: few trials are mostly luck
                 (chosen on `s02`, `ball` and `p1` of the recorded people)
    alike_by     neighbours that gaps of one class have in common, the nearest ones: what is farther decides little
    good_m       error of a spline in trials below which nothing else is tried: no more than what markers jitter by
    max_factor  factor by which the error to expect is changed at most where the favourite is more, or less, sure of a
                 gap than it was in the trials
    """

    gaps: int = 4
    first: int = 2
    hopeless: float = 1.6
    grade: float = 2.0
    alike: float = 1.5
    least: float = 0.02
    still_m_s: float = 0.02
    carried_by: int = 4
    shortest: float = 0.25
    open_s: float = 2.0
    lead: float = 0.15
    alike_by: int = 10
    good_m: float = 0.0001
    max_factor: float = 3.0


GAPPED = GapTrialOptions()
AT_ONCE = "spline"  # takes a thousandth of the time of the favourite
UNCARRIED = (AT_ONCE,)  # does not turn with the neighbours: right where all is calm, far off where it is not
MEAN_OF_DISTANCE = np.sqrt(8 / np.pi)  # of a place whose three coordinates are off by one standard deviation


@dataclass(frozen=True)
class Choice:
    """What trials say: the mix of methods to take, and what to expect of it.

    parts     names of methods, the mean of which is taken
    error     m, mean over the trials; NaN where there were none: then what the favourite tells of itself is taken
    sureness  m, mean standard deviation that the favourite gave in them; NaN where it gave none
    """

    parts: tuple[str, ...]
    error: float
    sureness: float

    @property
    def name(self) -> str:
        """What tables call it."""
        return "+".join(self.parts)

    def expected(self, sure: np.ndarray | None) -> float:
        """The mean error to expect in a gap of which the favourite is so sure (L,), m."""
        if sure is None:
            return self.error
        if not self.sureness > 0:  # nothing was tried
            return MEAN_OF_DISTANCE * float(sure.mean())
        ratio = float(sure.mean()) / self.sureness
        return self.error * float(np.clip(ratio, 1 / GAPPED.max_factor, GAPPED.max_factor))


def graded(amount: float) -> float:
    """The length, or speed, that stands for this one in trials."""
    return float(GAPPED.grade ** np.round(np.log(amount) / np.log(GAPPED.grade)))


def paces(take: KnownMarkers, neighbours: np.ndarray, rate: float) -> np.ndarray:
    """(T + 1,) m/s, summed up to each frame, how fast the middle of the first neighbours moves; 0 where not known."""
    middle = take.xyz[:, neighbours[: GAPPED.carried_by]].mean(axis=1) if len(neighbours) else take.xyz[:, 0] * np.nan
    speed = np.linalg.norm(np.diff(middle, axis=0), axis=1) * rate
    return np.r_[0, 0, np.cumsum(np.nan_to_num(speed))]


def pace_of(summed: np.ndarray, start: np.ndarray | int, stop: np.ndarray | int) -> np.ndarray:
    """m/s, mean from the frame before `start` to the frame at `stop`, of `paces`; at least what noise looks like."""
    last = np.minimum(stop, len(summed) - 2)
    return np.maximum((summed[last + 1] - summed[start]) / (last + 1 - start), GAPPED.still_m_s)


def cut_gaps(
    take: KnownMarkers, gap: Gap, neighbours: np.ndarray, own: np.ndarray, summed: np.ndarray
) -> tuple[list[Gap], bool]:
    """Gaps like this one where marker and neighbours are known, spread over the take; none where there is no room.

    Also whether the neighbours move as fast in them, by their `paces` summed.
    """
    length = max(1, round(graded(len(gap))))
    there = own & np.isfinite(take.xyz[:, neighbours, 0]).all(axis=1)
    total = np.r_[0, np.cumsum(there)]
    pace = pace_of(summed, gap.start, gap.stop)
    while length >= max(1, GAPPED.shortest * len(gap)):
        width = length + 2
        starts = np.flatnonzero(total[width:] - total[:-width] == width) + 1
        if len(starts):
            other = np.abs(np.log(pace_of(summed, starts, starts + length) / pace))
            nearest = np.sort(other)[min(max(GAPPED.gaps, int(GAPPED.least * len(starts))), len(starts)) - 1]
            starts = starts[other <= max(nearest, np.log(GAPPED.alike))]
            some = starts[evenly_spread(len(starts), GAPPED.gaps)]
            # Every second one first, so that the first of them are not neighbours.
            some = np.r_[some[1::2], some[::2]]
            return [Gap(int(start), int(start) + length, gap.marker) for start in some], nearest <= np.log(GAPPED.alike)
        length = int(length / GAPPED.grade)
    return [], False


def own_in_trial(own: np.ndarray, trial: Gap, gap: Gap, rate: float) -> np.ndarray:
    """The frames whose samples of the marker a trial may look at: outside, and at no end that the real gap lacks."""
    hidden, beyond = own.copy(), int(GAPPED.open_s * rate)
    before = beyond if gap.start == 0 else 0
    after = beyond if gap.stop == len(own) else 0
    hidden[max(trial.start - before, 0) : trial.stop + after] = False
    return hidden


def choose(
    take: KnownMarkers,
    gap: Gap,
    neighbours: np.ndarray,
    own: np.ndarray,
    ways: dict[str, Way],
    summed: np.ndarray,
    rate: float,
) -> Choice | None:
    """The best of the ways for gaps like this one, the favourite first among them; None where none can be tried.

    `summed` as `paces` gives it.
    """
    trials, alike = cut_gaps(take, gap, neighbours, own, summed)
    names = [name for name in ways if alike or name not in UNCARRIED or len(ways) == 1]
    if AT_ONCE in names and (quick := _quick_choice(take, gap, own, ways[AT_ONCE], trials, rate)) is not None:
        return quick
    errors, mixes, sure = {}, {}, []
    for number, trial in enumerate(trials):
        if number == GAPPED.first:
            names = _hopeful(names, errors)
        hidden, truth = own_in_trial(own, trial, gap, rate), take.xyz[trial.start : trial.stop, gap.marker]
        answers = {name: ways[name](trial, hidden) for name in names}
        answer = answers.get(next(iter(ways)))
        if answer is not None and answer[1] is not None:
            sure.append(float(answer[1].mean()))
        found = {name: answer[0] for name, answer in answers.items() if answer is not None}
        for parts in _mixes(tuple(found), next(iter(ways))):
            mean = sum(found[part] for part in parts) / len(parts)
            error = float(np.linalg.norm(mean - truth, axis=1).mean())
            mixes.setdefault(parts, []).append(error)
            if len(parts) == 1:
                errors.setdefault(parts[0], []).append(error)
    return _best(mixes, next(iter(ways)), float(np.mean(sure)) if sure else np.nan)


def _quick_choice(
    take: KnownMarkers, gap: Gap, own: np.ndarray, way: Way, trials: list[Gap], rate: float
) -> Choice | None:
    """The way that takes no time, where it is as good as can be; None where it is not."""
    errors = []
    for trial in trials:
        answer = way(trial, own_in_trial(own, trial, gap, rate))
        if answer is None:
            return None
        truth = take.xyz[trial.start : trial.stop, gap.marker]
        errors.append(float(np.linalg.norm(answer[0] - truth, axis=1).mean()))
        if errors[-1] > GAPPED.good_m:
            return None
    return Choice((AT_ONCE,), float(np.mean(errors)), float("nan")) if errors else None


def _hopeful(names: list[str], errors: dict[str, list[float]]) -> list[str]:
    """The methods that may still be the best."""
    means = {name: float(np.mean(errors[name])) for name in names if name in errors}
    best = min(means.values(), default=0.0)
    return [name for name in names if name in means and means[name] <= GAPPED.hopeless * best]


def _mixes(found: tuple[str, ...], favourite: str) -> list[tuple[str, ...]]:
    """Each method, and each with the favourite."""
    pairs = [(favourite, name) for name in found if name != favourite] if favourite in found else []
    return [(name,) for name in found] + pairs


def _best(mixes: dict[tuple[str, ...], list[float]], favourite: str, sureness: float) -> Choice | None:
    most = max((len(errors) for errors in mixes.values()), default=0)
    means = {parts: float(np.mean(errors)) for parts, errors in mixes.items() if len(errors) == most}
    if not means:
        return None
    least = min(means, key=means.__getitem__)
    usual = (favourite,)
    if usual in means and means[least] > (1 - GAPPED.lead) * means[usual]:
        least = usual
    return Choice(least, means[least], sureness)
