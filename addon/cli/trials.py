# SPDX-License-Identifier: GPL-3.0-or-later
"""Trials of a training side by side, in processes that go through the same door as this one."""

import json
import os
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from threadpoolctl import threadpool_limits

from ..core.data.errors import UserError
from ..core.points.likelihood.trying import TrialOutcome, TrialWork, Trying, in_turn, tried
from ..io.models import pack, unpack
from ..io.scratch import naming_scratch, scratch_folder
from ..io.source import read_bytes
from .serving import TRY
from .workers import crew

# How many processes try, where nobody says.
MAX_JOBS = 4  # a core each; assumed: what goes before the trials is soon longer than they are
# of all trials, for which more than one process is worth its start: so many take 2 s; measured on 41 markers
WORTH_POINTS = 40_000


def trying(jobs: int | None) -> Trying:
    """What tries the trials in so many processes; None for as many as are worth it."""
    return partial(_tried, jobs)


def run_trial(argv: Sequence[str]) -> int:
    """Tries the trial of a scratch file, as it would be tried in the process that wrote it; writes what comes of it."""
    result, path = map(Path, argv[1:])  # behind the word itself
    work = unpack(TrialWork, json.loads(read_bytes(path)), "trial", path)
    with threadpool_limits(1, user_api="blas"):
        outcome = tried(work)
    _write(result, outcome)
    return 0


def _write(path: Path, what: TrialWork | TrialOutcome):
    with naming_scratch(path.parent):
        path.write_text(json.dumps(pack(what)), encoding="utf-8", newline="\n")


def _tried(jobs: int | None, works: Sequence[TrialWork]) -> Iterator[TrialOutcome]:
    if jobs is None:
        points = sum(int((work.trial.truth >= 0).sum()) for work in works)
        jobs = min(os.cpu_count() or 1, MAX_JOBS) if points >= WORTH_POINTS else 1
    return in_turn(works) if min(jobs, len(works)) < 2 else _tried_side_by_side(works, jobs)


def _tried_side_by_side(works: Sequence[TrialWork], jobs: int) -> Iterator[TrialOutcome]:
    """The outcomes in the order of the trials, each as soon as all before it are there too."""
    with scratch_folder() as scratch:
        paths = [scratch / f"{number}.trial" for number in range(len(works))]
        for path, work in zip(paths, works, strict=True):
            _write(path, work)
        found, given = {}, 0
        with crew(min(jobs, len(works))) as run:
            for number, answer in run([[TRY, str(path)] for path in paths]):
                if isinstance(answer, UserError):
                    raise type(answer)(f"a trial could not be made: {answer.message}")
                found[number] = unpack(TrialOutcome, answer, "trial", paths[number])
                while given in found:
                    yield found.pop(given)
                    given += 1
