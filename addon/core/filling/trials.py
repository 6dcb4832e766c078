# SPDX-License-Identifier: GPL-3.0-or-later
"""How well each way of filling does on gaps cut into the same take, where the truth is known."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..data.physical import SIGMAS
from ..data.takes import evenly_spread
from .gaps import LEARNED_BY, Gap, KnownMarkers
from .kernels import PRIOR_SCALES

# Positions (L, 3) m of a gap by a method and, where it says so, how sure each is (L,) m; None where it cannot fill it.
Answer = tuple[np.ndarray, np.ndarray | None] | None
Way = Callable[[Gap, np.ndarray], Answer]


@dataclass(frozen=True)
class GapTrialOptions:
    """How gaps are cut for trials.

    gaps        measured: cut for each marker, length and set of neighbours that a gap of the take has; 2 err as much
    grade       measured: lengths, and how fast neighbours move, are distinguished in steps of this factor; 4 errs as
                much, and says less well by how much
    still_m_s   physical: m/s, as people sway who stand still; slower is no motion
    max_factor  measured: by which errors to expect are themselves off at most, so by which one is changed where the
                favourite is more, or less, sure of a gap than it was in the trials; 10 says the same
    """

    gaps: int = 4
    grade: float = 2.0
    still_m_s: float = 0.02
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
    middle = take.xyz[:, neighbours[: LEARNED_BY.of_axes]].mean(axis=1) if len(neighbours) else take.xyz[:, 0] * np.nan
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
    while length * GAPPED.max_factor >= len(gap):
        width = length + 2
        starts = np.flatnonzero(total[width:] - total[:-width] == width) + 1
        if len(starts):
            other = np.abs(np.log(pace_of(summed, starts, starts + length) / pace))
            alike = bool((other <= np.log(GAPPED.grade)).sum() >= GAPPED.gaps)
            most = min(GAPPED.gaps * width, len(starts))  # as many as begin in so many gaps
            starts = starts[other <= (np.log(GAPPED.grade) if alike else np.sort(other)[most - 1])]
            trials = [
                Gap(start, start + length, gap.marker)
                for start in starts[evenly_spread(len(starts), GAPPED.gaps)].tolist()
            ]
            return trials, alike
        length = int(length / GAPPED.grade)
    return [], False


def own_in_trial(own: np.ndarray, trial: Gap, gap: Gap, rate: float) -> np.ndarray:
    """The frames whose samples of the marker a trial may look at: outside, and at no end that the real gap lacks."""
    hidden, beyond = own.copy(), int(SIGMAS * PRIOR_SCALES.slow_s * rate)
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
    if alike and AT_ONCE in ways and (quick := _quick_choice(take, gap, own, ways[AT_ONCE], trials, rate)) is not None:
        return quick
    mixes, sure = {}, []
    for trial in trials:
        hidden, truth = own_in_trial(own, trial, gap, rate), take.xyz[trial.start : trial.stop, gap.marker]
        answers = {name: way(trial, hidden) for name, way in ways.items()}
        answer = answers.get(next(iter(ways)))
        if answer is not None and answer[1] is not None:
            sure.append(float(answer[1].mean()))
        found = {name: answer[0] for name, answer in answers.items() if answer is not None}
        for parts in _mixes(tuple(found), next(iter(ways))):
            mean = sum(found[part] for part in parts) / len(parts)
            error = float(np.linalg.norm(mean - truth, axis=1).mean())
            mixes.setdefault(parts, []).append(error)
    # Where trials move at another pace, what is not carried along counts if nothing else answers.
    carried = {parts: errors for parts, errors in mixes.items() if not set(parts) & set(UNCARRIED)}
    return _best(mixes if alike or not carried else carried, float(np.mean(sure)) if sure else np.nan)


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
        if errors[-1] > PRIOR_SCALES.noise_m:
            return None
    return Choice((AT_ONCE,), float(np.mean(errors)), float("nan")) if errors else None


def _mixes(found: tuple[str, ...], favourite: str) -> list[tuple[str, ...]]:
    """Each method, and each with the favourite."""
    pairs = [(favourite, name) for name in found if name != favourite] if favourite in found else []
    return [(name,) for name in found] + pairs


def _best(mixes: dict[tuple[str, ...], list[float]], sureness: float) -> Choice | None:
    most = max((len(errors) for errors in mixes.values()), default=0)
    means = {parts: float(np.mean(errors)) for parts, errors in mixes.items() if len(errors) == most}
    if not means:
        return None
    least = min(means, key=means.__getitem__)
    return Choice(least, means[least], sureness)
