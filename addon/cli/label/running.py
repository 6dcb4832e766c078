# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels takes one after the other, side by side, over machines, or as they arrive."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from ... import jobs
from ...blendfile import open_cameras
from ...core.data.errors import InputError, UserError
from ...core.data.wording import count_of
from ...io.batch import DONE_BEFORE, LABELLED
from ...io.scratch import take_away_scratch
from ...io.whole import finish_renaming, none_left_empty
from ...jobs.job import LabelJob, occlusion_here
from ..console import complain
from ..serving import load_labelling
from .batch import Answer, Batch, Runner, doubts_in, for_take
from .options import as_job, check, check_models, check_rest, edited_beside, settle_subjects, unused


def run(arguments) -> int:
    """Labels every take; one that fails does not stop the others."""
    settle_subjects(arguments)
    if arguments.watch:
        return _watch(arguments)
    if arguments.idle is not None:
        raise InputError("--idle is for folders that are watched; expected --watch with it")
    # Of processes side by side one has made the folder, and others may still be in it when that one ends.
    with none_left_empty(arguments.out), _runner(arguments) as runner:
        # Once for all takes and processes: the first may bring Blender in.
        asked, arguments.occlusion = arguments.occlusion, occlusion_here(arguments.occlusion)
        kinds = check(arguments)
        take_away_scratch()
        for words in (*unused(arguments, kinds, asked), *edited_beside(arguments)):
            complain(words)
        return _run(Batch(arguments), runner)


@contextmanager
def _runner(arguments) -> Iterator[Runner | None]:
    """What labels takes side by side; None for one take after the other."""
    if arguments.engine == "dask":
        # Nor is farm.py in a zip for Blender, which brings no package that it could use.
        if not (find_spec("distributed") and find_spec(f"{__package__}.farm")):
            words = "--engine dask needs the Python package distributed, which is not here"
            raise InputError(f"{words}; expected it installed, as pip install 'mocap-autolabel[farm]' does")
        from .farm import farm_out

        yield partial(farm_out, arguments.scheduler, arguments.jobs)
        return
    if arguments.scheduler is not None:
        raise InputError("--scheduler is of --engine dask; expected both of them or neither")
    count = min(arguments.jobs, len(arguments.inputs))
    if count == 1:
        yield None
        return
    from ..workers import crew

    with crew(count) as run:
        yield partial(_side_by_side, run)


def _side_by_side(run: Callable, takes: Sequence[LabelJob]) -> Generator[tuple[int, Answer], None, None]:
    with closing(run(partial(jobs.label_for_report, job) for job in takes)) as answers:
        for number, answer in answers:
            yield number, for_take(answer, takes[number].source)


def _run(batch: Batch, runner: Runner | None) -> int:
    """Labels every take by the `runner`, where there is one."""
    arguments, lines, outcomes = batch.arguments, {}, []
    for path, answer, state in _answers(batch, runner):
        lines[path] = batch.finish(path, answer, state)
        if isinstance(answer, UserError):
            batch.progress.tell(lines.pop(path), at_once=len(arguments.inputs) > 1)
        batch.write_summary()
    batch.reports = {path: batch.reports[path] for path in arguments.inputs if path in batch.reports}
    for path, report in batch.reports.items():
        outcomes += [lines[path], *doubts_in(report)]
    if batch.summary is not None and arguments.summary and batch.reports:
        outcomes += batch.summary.lines()
    return batch.end(outcomes, summed=bool(batch.reports) or arguments.summary)


def _answers(batch: Batch, runner: Runner | None) -> Iterator[tuple[Path, Answer, str]]:
    """What comes of each take, and its state after it, as they come."""
    arguments, left = batch.arguments, []
    if arguments.resume:
        finish_renaming(arguments.out)
    for path in arguments.inputs:
        job = batch.attempt(partial(as_job, arguments, path), path)
        if isinstance(job, UserError):
            yield path, job, LABELLED
        elif (earlier := batch.earlier(job)) is not None:
            yield path, earlier, DONE_BEFORE
        else:
            left.append(job)
    if left and runner is not None:
        with closing(runner(left)) as answers:
            for done, (number, answer) in enumerate(answers, 1):
                batch.progress.tell(f"{done} of {count_of(len(left), 'take')}", at_once=True)
                yield batch.settled(left[number], answer)
    elif left:
        yield from _in_turn(batch, left)


def _in_turn(batch: Batch, takes: Sequence[LabelJob]) -> Iterator[tuple[Path, Answer, str]]:
    """The same of takes one after the other, each unless another run has done it by then."""
    load_labelling()

    def label(job: LabelJob) -> dict:
        return batch.progress.drain(jobs.label_file(job), job.source.stem).report

    for job in takes:
        if (earlier := batch.earlier(job)) is not None:
            yield job.source, earlier, DONE_BEFORE
        else:
            yield batch.settled(job, batch.attempt(partial(label, job), job.source))


def _watch(arguments) -> int:
    """Labels the takes in folders as they arrive."""
    from .watching import watch

    if arguments.engine != "local" or arguments.scheduler is not None:
        raise InputError("a folder is watched by this machine; expected --watch without --engine dask and --scheduler")
    arguments.occlusion = occlusion_here(arguments.occlusion)
    check_rest(arguments)
    if arguments.edits is not None:
        raise InputError("--edits is of one take; expected none with --watch, or files such as walk.edits.json there")
    check_models(arguments)
    if arguments.cameras is not None:
        open_cameras(arguments.cameras, arguments.up)
    batch = Batch(arguments)
    batch.summary.check(arguments.overwrite, arguments.resume)
    return watch(batch)
