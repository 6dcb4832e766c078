# SPDX-License-Identifier: GPL-3.0-or-later
"""The takes of a command, what became of each, and how that is told."""

import json
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TypeVar

from ...core.data.errors import InputError, UserError
from ...core.data.wording import count_of
from ...io.batch import DONE_BEFORE, FAILING, LABELLED, row_of
from ...io.provenance import INSTEAD, REPORT
from ...jobs.job import LabelJob, results_of
from ..console import ProgressLine, complain, not_in_c3d, of_take, print_results
from .options import summary_of


def as_line(report: dict) -> str:
    """One take's result as a line for people."""
    thing = "point" if "points" in report else "blob"
    count, named = report[f"{thing}s"], report[f"{thing}s"] - report["unlabelled"]
    speed = report["timing"]["frames_per_second"]
    pace = "" if speed is None else f", {speed:.0f} frames/s"
    if "edits" in report:
        pace += f", {count_of(sum(report['edits']['applied'].values()), 'edit')} applied"
    unit = f", no known unit in the file, taken for {report['unit_assumed']}" if "unit_assumed" in report else ""
    if "filled" in report:
        pace += f", {len(report['filled']):,} of {count_of(len(report['filled']) + len(report['left']), 'gap')} filled"
    remarks = [*not_in_c3d(report), *_remarks(report)]
    frames, more = count_of(report["frames"], "frame"), "".join(f"; {words}" for words in remarks)
    if report.get("changed_in_all"):
        pace += f", compared with before {report['changed_in_all']}"
    look = f"; {report['to_look_at']}" if report.get("to_look_at") else ""
    return f"{report['take']}: {frames}, {named:,} of {count_of(count, thing)} named{pace}{unit}{more}{look}"


def doubts_in(report: dict) -> list[str]:
    """What is odd about the cameras of a take, and which edits found nothing, a line each."""
    missed = [
        f"edit {one['edit']} ({one['kind']}) found nothing: {one['reason']}"
        for one in report.get("edits", {}).get("found_nothing", [])
    ]
    return [f"{report['take']}: {words}" for words in (*report.get("camera_doubts", []), *missed)]


def _remarks(report: dict) -> list[str]:
    """What was decided about a take's files, in sentences."""
    notes = [words for part in ("capture", "calibration", "notes") for words in report.get(part, [])]
    return [f"{words} (--use chooses)" if " are taken, not " in words else words for words in notes]


def for_take(answer: "Answer", path: Path) -> "Answer":
    """What came of a take in another process, which names the take where it says no file."""
    return of_take(answer, path) if isinstance(answer, UserError) else answer


Result = TypeVar("Result")
Answer = dict | UserError  # a take's report, or why there is none
Runner = Callable[[Sequence[LabelJob]], Generator[tuple[int, Answer], None, None]]  # of takes, by their number


class Batch:
    """The takes of a command and what became of each: told meanwhile, summed up, and printed in the end.

    reports, failed  of takes by their files
    passed           takes that an earlier run has done
    """

    def __init__(self, arguments):
        self.arguments, self.summary = arguments, summary_of(arguments)
        self.reports: dict[Path, dict] = {}
        self.failed: dict[Path, UserError] = {}
        self.passed: set[Path] = set()
        self.progress = ProgressLine(arguments.progress)

    def attempt(self, work: Callable[[], Result], path: Path) -> Result | UserError:
        """What comes of a take, or why nothing does: whatever happens to one, the others have their turn."""
        try:
            return work()
        except Exception as error:  # noqa: BLE001 - every take is its own
            return of_take(error, path, self.arguments.traceback)

    def earlier(self, job: LabelJob) -> Answer | None:
        """What an earlier run made of a take, where that is gone on with, or why it cannot be; else None."""
        return self.attempt(partial(_earlier, job), job.source) if self.arguments.resume else None

    def settled(self, job: LabelJob, answer: Answer) -> tuple[Path, Answer, str]:
        """What came of a take that was worked on, and its state: another batch may have done it meanwhile."""
        earlier = self.earlier(job) if isinstance(answer, UserError) else None
        return (job.source, earlier, DONE_BEFORE) if isinstance(earlier, dict) else (job.source, answer, LABELLED)

    def finish(self, path: Path, answer: Answer, state: str = LABELLED) -> str:
        """Notes what came of a take, the last time that it was worked on; gives it as a line for people."""
        self.reports.pop(path, None)
        self.failed.pop(path, None)
        self.passed.discard(path)
        if self.summary is not None:
            self.summary.finish(path, answer, self.arguments.out, state)
        if isinstance(answer, UserError):
            self.failed[path] = answer
            return f"{path.stem}: {FAILING}"
        if self.arguments.json or not self.arguments.watch:  # memory does not grow with what is watched
            self.reports[path] = answer
        if state == DONE_BEFORE:
            self.passed.add(path)
        return as_line(answer) + (f", {DONE_BEFORE}" if state == DONE_BEFORE else "")

    def write_summary(self):
        """Writes the summary now and then while takes are worked on; what goes wrong with it is said at the end."""
        if self.summary is not None:
            with suppress(UserError):
                self.summary.write()

    def end(self, lines: list[str], summed: bool) -> int:
        """Writes and prints everything, `lines` first, and says what failed; gives the exit status."""
        self.progress.clear()
        arguments, failures, places = self.arguments, list(self.failed.values()), {}
        if self.summary is not None and summed:
            try:
                self.summary.write(at_once=True)
                places = {"summary": self.summary.page, "table": self.summary.table}
            except UserError as error:  # the takes are there all the same
                failures.append(error)
        if lines or arguments.json:
            failed = [
                {"take": path.stem, "status": trouble.exit_status, "reason": str(trouble)}
                for path, trouble in self.failed.items()
            ]
            result: dict = {"takes": list(self.reports.values()), "failed": failed}
            if arguments.resume:
                result["passed_over"] = sorted(path.stem for path in self.passed)
            result |= {name: str(path) for name, path in places.items() if path is not None}
            if not arguments.watch:
                lines += [f"over all takes: {path}" for path in places.values() if path is not None]
            print_results(lines, result, arguments.json)
        for trouble in failures:
            complain(trouble)
        return max((trouble.exit_status for trouble in failures), default=0)


def _earlier(job: LabelJob) -> dict | None:
    """The report of an earlier run of the same job, None where there is none that is whole.

    Raises InputError where what is there may not be replaced, or nobody can tell by the report what came of the take.
    """
    report = results_of(job)
    if report is not None:
        try:
            as_line(report), doubts_in(report), row_of(report, job.source.name)
            json.dumps(report, allow_nan=False)
        except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError):
            raise InputError(
                f"is damaged; expected the report of an earlier run, {INSTEAD}", job.path(REPORT)
            ) from None
    return report
