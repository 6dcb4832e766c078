# SPDX-License-Identifier: GPL-3.0-or-later
"""`label FOLDER --watch`: takes are labelled as they arrive, and what became of them is told meanwhile."""

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ...core.data.errors import UserError
from ...io.arrivals import Arrivals
from ...io.batch import AT_WORK, DONE_BEFORE, FAILING, LABELLED, MEASURED, WAITING
from ...io.scratch import take_away_own
from ...jobs.batches import BatchSummary
from ..console import ProgressLine, complain, print_results
from ..failures import of_take
from ..workers import crew


@dataclass(frozen=True)
class TakeWork:
    """What is done with each take.

    earlier  gives the report of an earlier run, None where there is none to be kept; UserError where that is in the way
    command  gives the command line that labels it
    line     says in a line what came of it, by its report
    """

    earlier: Callable[[Path], dict | None]
    command: Callable[[Path], list[str]]
    line: Callable[[dict], str]


class Watch:
    """Folders that are watched, and the takes in them.

    With `keep` all reports are kept until the end; else only their rows in the summary, so that memory does not grow.
    """

    def __init__(self, arguments, arrivals: Arrivals, work: TakeWork, summary: BatchSummary):
        self.arguments, self.arrivals, self.work, self.summary = arguments, arrivals, work, summary
        self.begun: list[Path] = []  # by the number that the processes know them by
        self.waiting: deque[Path] = deque()
        self.at_work: set[Path] = set()
        self.reports: dict[Path, dict] = {}
        self.failed: dict[Path, UserError] = {}
        self.passed: set[Path] = set()
        self.progress = ProgressLine(arguments.progress)
        self._last, self._quiet, self._told = time.monotonic(), False, ""

    def offers(self) -> Iterator[list[str] | None]:
        """A command line for each take when it is there, None while there is none; ends where it may end."""
        looked = float("-inf")
        while True:
            self.write()  # here, so that what is begun at once never stands there as waiting
            now = time.monotonic()
            if now - looked >= self.arrivals.options.look_s:
                looked = now
                self._look(now)
            path = self._next()
            if path is not None:
                self._last = now
                if not self._done_before(path):
                    yield self._begin(path)
                continue
            if self._may_end(looked):
                return
            self._tell()
            yield None

    def run(self):
        """Watches until nothing has come for long enough, or somebody stops it."""
        with crew(self.arguments.jobs) as label:
            for number, answer in label(self.offers()):
                self.at_work.discard(self.begun[number])
                self._finish(self.begun[number], answer, LABELLED)

    def stop(self):
        """Notes that what is at work is worked on no more."""
        for path in self.at_work:
            self.summary.wait_for(path)

    @property
    def unfinished(self) -> bool:
        """Whether takes are there that were not worked on to their end."""
        return bool(self.at_work or self.waiting)

    def write(self, at_once: bool = False):
        """Writes the summary; what goes wrong with it while takes are worked on is said at the end."""
        try:
            self.summary.write(at_once)
        except UserError:
            if at_once:
                raise

    def _look(self, now: float):
        for path in self.arrivals.look(now):
            if path not in self.at_work and path not in self.waiting:
                self.waiting.append(path)
                self.summary.wait_for(path)
        for words in self.arrivals.passed:
            self._say(complain, words)
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

    def _done_before(self, path: Path) -> bool:
        """Whether an earlier run has done a take, or left what may not be replaced."""
        if not self.arguments.resume:
            return False
        try:
            answer = self.work.earlier(path)
        except Exception as error:  # noqa: BLE001 - every take is its own
            answer = of_take(error, path, self.arguments.traceback)
        if answer is None:
            return False
        self._finish(path, answer, DONE_BEFORE)
        return True

    def _begin(self, path: Path) -> list[str] | None:
        self.begun.append(path)
        self.at_work.add(path)
        self.summary.begin(path)
        return self.work.command(path)

    def _finish(self, path: Path, answer: dict | UserError, state: str):
        self._last = time.monotonic()
        self.summary.finish(path, answer, self.arguments.out, state)
        self.failed.pop(path, None)
        self.passed.discard(path)
        self.reports.pop(path, None)
        if isinstance(answer, UserError):
            self.failed[path] = answer
            words = f"{path.stem}: {FAILING}, {self.summary.rows[path].reason}"
        else:
            words = self.work.line(answer)
            if state == DONE_BEFORE:
                self.passed.add(path)
                words += f", {DONE_BEFORE}"
            if self.arguments.json:
                self.reports[path] = answer
        if not self.arguments.json:
            self._say(lambda line: print_results([line], {}, False), words)

    def _say(self, how: Callable[[str], None], words: str):
        self.progress.clear()
        how(words)

    def _may_end(self, looked: float) -> bool:
        """Whether nothing had come for long enough when the folders were looked into."""
        idle = self.arguments.idle
        return idle is not None and self._quiet and not self.unfinished and looked - self._last >= idle

    def _tell(self):
        count = self.summary.count
        said = [f"{count(*MEASURED)} labelled"]
        said += [f"{count(state)} {state}" for state in (FAILING, AT_WORK, WAITING) if count(state)]
        words = ", ".join(said)
        if words != self._told:
            self.progress.tell(words, at_once=True)
            self._told = words


def watch(arguments, work: TakeWork, summary: BatchSummary) -> int:
    """Labels the takes of folders as they arrive, in processes of their own; gives the exit status."""
    watched = Watch(arguments, Arrivals(arguments.inputs), work, summary)
    try:
        watched.run()
    except KeyboardInterrupt:
        take_away_own()
    watched.progress.clear()
    watched.stop()
    failures = list(watched.failed.values())
    try:
        watched.write(at_once=True)
    except UserError as error:  # the takes are there all the same
        failures.append(error)
    _print(arguments, watched)
    for error in failures:
        complain(error)
    if watched.unfinished:
        complain("stopped before the end; nothing half-written was left")
        return 1
    return max((error.exit_status for error in failures), default=0)


def _print(arguments, watched: Watch):
    summary = watched.summary
    failed = [
        {"take": path.stem, "status": error.exit_status, "reason": str(error)} for path, error in watched.failed.items()
    ]
    result = {"takes": list(watched.reports.values()), "failed": failed}
    result |= {"passed_over": sorted(path.stem for path in watched.passed)} if arguments.resume else {}
    result |= {name: str(path) for name, path in (("summary", summary.page), ("table", summary.table)) if path}
    if arguments.json or summary.rows:
        print_results(summary.lines(), result, arguments.json)
