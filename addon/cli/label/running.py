# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels takes one after the other, side by side, over machines, or as they arrive."""

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ... import jobs
from ...blendfile import open_cameras
from ...core.data.errors import InputError, UserError
from ...io.batch import DONE_BEFORE, LABELLED
from ...io.scratch import naming_scratch, take_away_scratch
from ...io.whole import finish_renaming
from ...jobs.resuming import results_of
from ..console import ProgressLine, complain, print_results
from ..failures import of_take
from ..loading import load_labelling
from .asked import as_job, command_for, summary_of
from .checks import check, check_rest, edited_beside, unused
from .lines import as_line, doubts_in
from .subjects import check_models, settle_subjects

if TYPE_CHECKING:  # with the pages, which a take alone does not need
    from ...jobs.batches import BatchSummary


def run(arguments) -> int:
    """Labels every take; one that fails does not stop the others."""
    settle_subjects(arguments)
    if arguments.watch:
        return _watch(arguments)
    if arguments.idle is not None:
        raise InputError("--idle is for folders that are watched; expected --watch with it")
    with ExitStack() as stack:
        return _run(arguments, _crew(arguments, stack))


def _crew(arguments, stack: ExitStack) -> Callable[[list[list[str]]], Iterator[tuple[int, dict | UserError]]] | None:
    """What runs command lines side by side; None for one take after the other, and where nobody knows what is left."""
    if arguments.engine == "dask":
        from .farm import farm_out

        return partial(farm_out, arguments.scheduler, arguments.jobs, partial(as_job, arguments))
    count = min(arguments.jobs, len(arguments.inputs))
    if count == 1 or arguments.resume:
        return None
    from ..workers import crew

    return stack.enter_context(crew(count))


def _run(arguments, crew: Callable | None) -> int:
    """Labels every take by the `crew`, where there is one."""
    # Once for all takes and processes: the first may bring Blender in.
    arguments.occlusion = jobs.occlusion_here(arguments.occlusion)
    check(arguments)
    if not arguments.result:  # whoever started this process side by side with others has done so already
        take_away_scratch()
        for words in (*unused(arguments), *edited_beside(arguments)):
            complain(words)
    summary, passed = summary_of(arguments), set()
    reports, failures = _worked(arguments, crew, summary, passed)
    failed = [{"take": path.stem, "status": error.exit_status, "reason": str(error)} for path, error in failures]
    written = {}
    if summary is not None and (reports or arguments.summary):
        try:
            summary.write(at_once=True)
            written = {"summary": summary.page, "table": summary.table}
        except UserError as error:  # the takes are there all the same
            failures.append((arguments.out, error))
    if arguments.result and not failures:
        with naming_scratch(arguments.result.parent):
            arguments.result.write_text(json.dumps(reports[0]), encoding="utf-8", newline="\n")
    if reports or arguments.json:
        lines = [line for report in reports for line in (_line_of(report, passed), *doubts_in(report))]
        lines += summary.lines() if arguments.summary else []
        result = {"takes": reports, "failed": failed} | ({"passed_over": sorted(passed)} if arguments.resume else {})
        places = {name: str(path) for name, path in written.items() if path is not None}
        print_results(
            [*lines, *(f"over all takes: {path}" for path in places.values())], result | places, arguments.json
        )
    for _, error in failures:
        complain(error)
    return max((error.exit_status for _, error in failures), default=0)


def _worked(
    arguments, crew: Callable | None, summary: "BatchSummary | None", passed: set[str]
) -> tuple[list[dict], list[tuple[Path, UserError]]]:
    """The reports of all takes in the order given, and why others have none; `passed` gets those that were done."""
    reports, failures = [], []
    progress = ProgressLine(arguments.progress)
    for path, answer in _answers(arguments, progress, passed, crew):
        if isinstance(answer, UserError):
            failures.append((path, answer))
            progress.tell(f"{path.name}: failed", at_once=len(arguments.inputs) > 1)
        else:
            reports.append(answer)
        if summary is not None:
            summary.finish(path, answer, arguments.out, DONE_BEFORE if path.stem in passed else LABELLED)
            with suppress(UserError):  # said at the end
                summary.write()
    progress.clear()
    places = {path.stem: place for place, path in enumerate(arguments.inputs)}
    return sorted(reports, key=lambda report: places[report["take"]]), failures


def _watch(arguments) -> int:
    """Labels the takes in folders as they arrive."""
    from .watching import TakeWork, watch

    if arguments.engine != "local" or arguments.scheduler is not None:
        raise InputError("a folder is watched by this machine; expected --watch without --engine dask and --scheduler")
    arguments.occlusion = jobs.occlusion_here(arguments.occlusion)
    check_rest(arguments)
    if arguments.edits is not None:
        raise InputError("--edits is of one take; expected none with --watch, or files such as walk.edits.json there")
    check_models(arguments)
    if arguments.cameras is not None:
        open_cameras(arguments.cameras, arguments.up)
    summary = summary_of(arguments)
    summary.check(arguments.overwrite, arguments.resume)
    work = TakeWork(lambda path: results_of(as_job(arguments, path)), partial(command_for, arguments), as_line)
    return watch(arguments, work, summary)


def _answers(
    arguments, progress: ProgressLine, passed: set[str], crew: Callable | None
) -> Iterator[tuple[Path, dict | UserError]]:
    """Each take's report, or why there is none, as they come; `passed` gets those that an earlier run has done."""
    left = list(arguments.inputs)
    if arguments.resume:
        finish_renaming(arguments.out)
        for path, answer in _each(left, lambda path: results_of(as_job(arguments, path)), arguments.traceback):
            if answer is None:
                continue
            left.remove(path)
            if not isinstance(answer, UserError):
                passed.add(path.stem)
            yield path, answer
    if arguments.engine == "dask" or min(arguments.jobs, len(left)) > 1:
        yield from _side_by_side(left, arguments, progress, crew)
        return

    load_labelling()

    def label(path: Path) -> dict:
        return progress.drain(jobs.label_file(as_job(arguments, path)), path.stem).report

    yield from _each(left, label, arguments.traceback)


def _line_of(report: dict, passed: set[str]) -> str:
    return as_line(report) + (", done before" if report["take"] in passed else "")


def _each(paths: Iterable[Path], work: Callable[[Path], dict | None], trace: bool):
    """What comes of each path, or why nothing does: whatever happens to one, the others have their turn."""
    for path in tuple(paths):
        try:
            answer = work(path)
        except Exception as error:  # noqa: BLE001 - every take is its own
            answer = of_take(error, path, trace)
        yield path, answer


def _side_by_side(
    paths: list[Path], arguments, progress: ProgressLine, crew: Callable | None
) -> Iterator[tuple[Path, dict | UserError]]:
    from ..workers import side_by_side

    done = 0
    commands = [command_for(arguments, path) for path in paths]
    with closing(crew(commands) if crew else side_by_side(commands, arguments.jobs)) as answers:
        for number_, answer in answers:
            done += 1
            progress.tell(f"{done} of {len(commands)} takes", at_once=True)
            yield paths[number_], answer
