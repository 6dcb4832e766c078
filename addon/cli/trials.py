# SPDX-License-Identifier: GPL-3.0-or-later
"""Trials of a training side by side, in processes that go through the same door as this one."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..core.data.errors import UserError
from ..core.points.likelihood.trying import TrialOutcome, TrialWork, Trying, in_turn
from ..io.scratch import scratch_folder
from ..jobs.trials import outcome_of, try_file, write_trial
from .serving import TRY
from .workers import crew


@dataclass(frozen=True)
class SideBySideOptions:
    """How many processes try, where nobody says.

    max_jobs    a core each; reckoned: what goes before the trials is soon longer than they are
    min_points  of all trials, for which more than one process is worth its start: so many take 2 s; measured on 41
                markers
    """

    max_jobs: int = 4
    min_points: int = 40_000


SIDE_BY_SIDE = SideBySideOptions()


def trying(jobs: int | None) -> Trying:
    """What tries the trials in so many processes; None for as many as are worth it."""
    return partial(_tried, jobs)


def run_trial(argv: Sequence[str]) -> int:
    """Does what a command of a trial asks for."""
    _, result, path = argv  # behind the word itself
    try_file(Path(path), Path(result))
    return 0


def _tried(jobs: int | None, works: Sequence[TrialWork]) -> Iterator[TrialOutcome]:
    if jobs is None:
        points = sum(int((work.trial.truth >= 0).sum()) for work in works)
        jobs = min(os.cpu_count() or 1, SIDE_BY_SIDE.max_jobs) if points >= SIDE_BY_SIDE.min_points else 1
    return in_turn(works) if min(jobs, len(works)) < 2 else _tried_side_by_side(works, jobs)


def _tried_side_by_side(works: Sequence[TrialWork], jobs: int) -> Iterator[TrialOutcome]:
    """The outcomes in the order of the trials, each as soon as all before it are there too."""
    with scratch_folder() as scratch:
        paths = [scratch / f"{number}.trial" for number in range(len(works))]
        for path, work in zip(paths, works, strict=True):
            write_trial(path, work)
        found, given = {}, 0
        with crew(min(jobs, len(works))) as run:
            for number, answer in run([[TRY, str(path)] for path in paths]):
                if isinstance(answer, UserError):
                    raise type(answer)(f"a trial could not be made: {answer.message}")
                found[number] = outcome_of(answer, paths[number])
                while given in found:
                    yield found.pop(given)
                    given += 1
