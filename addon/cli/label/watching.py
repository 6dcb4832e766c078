# SPDX-License-Identifier: GPL-3.0-or-later
"""`label FOLDER --watch`: takes are labelled as they arrive, and what became of them is told meanwhile."""

import time
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from ...core.data.errors import UserError
from ...io.arrivals import Arrivals
from ...io.batch import AT_WORK, DONE_BEFORE, FAILING, LABELLED, MEASURED, WAITING
from ...io.scratch import take_away_own
from ...jobs import LabelJob, label_for_report
from ..console import complain, print_results
from ..workers import crew
from .batch import Answer, Batch, for_take
from .options import as_job


class Watch:
    """Folders that are watched, and the takes in them that are waiting or worked on."""

    def __init__(self, batch: Batch, arrivals: Arrivals):
        self.batch, self.arguments, self.arrivals, self.summary = batch, batch.arguments, arrivals, batch.summary
        self.begun: list[LabelJob] = []  # by the number that the processes know them by
        self.waiting: deque[Path] = deque()
        self.at_work: set[Path] = set()
        self._last, self._quiet, self._shown = time.monotonic(), False, ""

    def offers(self) -> Iterator[Callable | None]:
        """The work on each take when it is there, None while there is none; ends where it may end."""
        looked = float("-inf")
        while True:
            self.batch.write_summary()  # here, so that what is begun at once never stands there as waiting
            now = time.monotonic()
            if now - looked >= self.arrivals.look_s:
                looked = now
                self._look(now)
            path = self._next()
            if path is not None:
                self._last = now
                job = self.batch.attempt(partial(as_job, self.arguments, path), path)
                if isinstance(job, UserError):
                    self._finish(path, job, LABELLED)
                elif (earlier := self.batch.earlier(job)) is not None:
                    self._finish(path, earlier, DONE_BEFORE)
                else:
                    self.begun.append(job)
                    self.at_work.add(path)
                    self.summary.begin(path)
                    yield partial(label_for_report, job)
                continue
            if self._may_end(looked):
                return
            self._tell()
            yield None

    def run(self):
        """Watches until nothing has come for long enough, or somebody stops it."""
        with crew(self.arguments.jobs) as label:
            for number, answer in label(self.offers()):
                job = self.begun[number]
                self.at_work.discard(job.source)
                self._finish(*self.batch.settled(job, for_take(answer, job.source)))

    @property
    def unfinished(self) -> bool:
        """Whether takes are there that were not worked on to their end."""
        return bool(self.at_work or self.waiting)

    def _look(self, now: float):
        for path in self.arrivals.look(now):
            if path not in self.at_work and path not in self.waiting:
                self.waiting.append(path)
                self.summary.wait_for(path)
        for words in self.arrivals.passed:
            self.batch.progress.clear()
            complain(words)
        self.arrivals.passed.clear()
        self._quiet = not (self.unfinished or self.arrivals.is_arriving(now))
        if not self._quiet:
            self._last = now

    def _next(self) -> Path | None:
        """The next take that is still as it was when it was seen."""
        while self.waiting:
            path = self.waiting.popleft()
            if self.arrivals.try_now(path):
                return path
            self.summary.drop(path)
        return None

    def _finish(self, path: Path, answer: Answer, state: str):
        self._last = time.monotonic()
        line = self.batch.finish(path, answer, state)
        if isinstance(answer, UserError):
            line = f"{line}, {self.summary.rows[path].reason}"
        if not self.arguments.json:
            self.batch.progress.clear()
            print_results([line], {}, False)

    def _may_end(self, looked: float) -> bool:
        """Whether nothing had come for long enough when the folders were looked into."""
        idle = self.arguments.idle
        return idle is not None and self._quiet and not self.unfinished and looked - self._last >= idle

    def _tell(self):
        count = self.summary.count
        parts = [f"{count(*MEASURED)} labelled"]
        parts += [f"{count(state)} {state}" for state in (FAILING, AT_WORK, WAITING) if count(state)]
        words = ", ".join(parts)
        if words != self._shown:
            self.batch.progress.tell(words, at_once=True)
            self._shown = words


def watch(batch: Batch) -> int:
    """Labels the takes of folders as they arrive, in processes of their own; gives the exit status."""
    watched = Watch(batch, Arrivals(batch.arguments.inputs))
    try:
        watched.run()
    except KeyboardInterrupt:
        take_away_own()
    for path in watched.at_work:
        batch.summary.wait_for(path)
    for path in watched.arrivals.empty:
        complain(f"{path}: is empty, and was left out; expected a file with content")
    status = batch.end(batch.summary.lines() if batch.summary.rows else [], summed=True)
    if watched.unfinished:
        complain("stopped before the end; nothing half-written was left")
        return 1
    return status
