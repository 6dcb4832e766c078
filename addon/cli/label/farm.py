# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes spread over machines by `dask.distributed`: jobs are handed out here, and done by its workers.

What is sent is made of Python's own functions, text and bytes: so the scheduler needs no package of ours, and the name
that this package goes by here, another one in Blender, is nobody's concern. Results are written where they belong by
the worker; its answer is the report.
"""

import logging
import operator
import os
import pkgutil
import queue
import socket
import threading
import time
import uuid
import warnings
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ...core.data.errors import InputError, JobError, UserError
from ...io.markersets import AUTO_MODEL, markerset_file
from ...io.scratch import naming_scratch, scratch_folder
from ...io.source import read_bytes
from ...io.whole import check_targets
from ...jobs import label_for_report
from ...jobs.job import LabelJob, results_of
from ...version import version
from ..console import complain, of_take
from ..parcels import read_parcel, write_parcel
from ..serving import PATIENCE, POLL
from ..workers import crew

THERE = "mocap_autolabel.addon.cli.label.farm"  # this file, as workers know it
CONNECT_S = 10.0  # s, within which a scheduler has to answer
AHEAD = 2  # takes sent for each thread of the workers: one at work, and one so that nobody waits for the next
UNFIT = 0  # an exit status that no failed take has: the worker can do no take of this batch


def farm_out(
    address: str | None, most: int, jobs: Sequence[LabelJob]
) -> Generator[tuple[int, dict | UserError], None, None]:
    """Has jobs done by the workers of the scheduler at `address`; yields number and answer.

    Without an address they are up to `most` workers of dask's own cluster on this machine, which ends with them.
    Closing the generator stops what runs. JobError where the scheduler is not there or goes away, or a worker has no
    such version or does not see the takes.
    """
    batch = f"mocap-autolabel-{uuid.uuid4().hex}"
    at_work: dict[str, tuple] = {}
    with _scheduler(address, min(most, len(jobs))) as address, _connected(address) as client:
        if not client.nthreads():
            complain(f"the scheduler at {address} has no workers yet: the takes wait for the first of them")
        try:
            yield from _answers_of(client, batch, jobs, at_work)
        except OSError as error:
            raise _gone(address) from error
        finally:
            _end(client, batch, [future for future, *_ in at_work.values()])


@contextmanager
def _scheduler(address: str | None, workers: int) -> Iterator[str]:
    """The scheduler's address; where none is given one is started, which needs no port: every take has a process."""
    import distributed

    # Whatever matters of it is said in our words; it gives several of its loggers a level of their own.
    for name in [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    if address:
        yield address
        return
    with scratch_folder() as folder:
        try:
            cluster = distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=False,
                memory_limit=0,  # the takes' memory is that of other processes
                # Its pages are for this machine alone, at any free ports.
                dashboard_address="127.0.0.1:0",
                worker_dashboard_address="127.0.0.1:0",
                local_directory=str(folder),
                silence_logs=logging.CRITICAL,
            )
        except (OSError, RuntimeError) as error:
            reason = " ".join(str(error).split())[:200]
            raise JobError(f"dask's own cluster does not start ({reason}); expected fewer --jobs") from None
        with cluster:
            yield cluster.scheduler_address


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    """A client of the scheduler; JobError where none answers."""
    from distributed import Client

    client = Client.__new__(Client)
    try:
        with warnings.catch_warnings(action="ignore"):
            client.__init__(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError, ImportError) as error:
        client.close()  # or its end, at that of the process, waits for 20 s and leaves a traceback
        reason = " ".join(str(error).split())[:200]
        what = f"no scheduler answers at {address} ({reason})"
        raise JobError(f"{what}; expected the address that `dask scheduler` prints") from None
    with client:
        yield client


def _answers_of(client, batch: str, jobs: Sequence[LabelJob], at_work: dict) -> Iterator[tuple[int, dict | UserError]]:
    """Number and answer of each job, as they come; what is not yet wanted is not yet sent.

    `at_work` has what was sent and is not answered: a future, the number and the job by the future's key.
    """
    waiting = deque(enumerate(jobs))
    answers: queue.SimpleQueue = queue.SimpleQueue()
    while waiting or at_work:
        room = AHEAD * max(sum(client.nthreads().values()), 1)
        while waiting and len(at_work) < room:
            number, job = waiting.popleft()
            try:
                # Asked here and not by the worker, which is told to go on with what is there: of a take whose worker is
                # lost the next one may find the results whole.
                if not (job.resume or job.overwrite):
                    check_targets(job.written, False, job.read)
                sent = _for_elsewhere(job)
            except Exception as error:  # noqa: BLE001 - every take is its own
                yield number, of_take(error, job.source)
                continue
            take = os.path.abspath(job.source)  # noqa: PTH100 - links stay as they are
            future = _send(client, f"{batch}-{number}", "work", batch, version(), take, sent)
            at_work[future.key] = future, number, job
            future.add_done_callback(answers.put)
        if at_work:
            future, number, job = at_work.pop(_waited_for(answers).key)
            yield number, _answer_of(client, future, job)


def _waited_for(answers: queue.SimpleQueue):
    """The next answer, however long it takes; an interruption is heard meanwhile, on Windows too."""
    while True:
        with suppress(queue.Empty):
            return answers.get(timeout=POLL)


def _for_elsewhere(job: LabelJob) -> bytes:
    """A job as it holds in any folder, and for a take that was begun before, as a parcel."""

    def whole(model: str) -> str:
        return model if model == AUTO_MODEL or markerset_file(model) != Path(model) else os.path.abspath(model)  # noqa: PTH100

    files = {name: getattr(job, name) for name in ("source", "cameras", "out", "own", "edits")}
    paths = {name: Path(os.path.abspath(file)) for name, file in files.items() if isinstance(file, Path)}  # noqa: PTH100
    wearers = tuple((name, whole(model)) for name, model in job.wearers)
    again = job.resume or not job.overwrite
    job = replace(job, model=whole(job.model), wearers=wearers, resume=again, **paths)
    with scratch_folder() as folder:
        write_parcel(folder / "job", job)
        return read_bytes(folder / "job")


def _send(client, key: str, name: str, *words: str | bytes, workers: list[str] | None = None):
    """The future of a function of this file, called where the scheduler, or `workers`, will have it."""
    task = (operator.call, (pkgutil.resolve_name, f"{THERE}:{name}"), *words)
    [future] = client.get({key: task}, [key], sync=False, workers=workers, allow_other_workers=False)
    return future


def _answer_of(client, future, job: LabelJob) -> dict | UserError:
    """What came of a take; JobError where its worker, or the scheduler, can do none."""
    from concurrent.futures import CancelledError

    from distributed import KilledWorker

    take = job.source
    try:
        status, words = future.result()
    except KilledWorker as error:
        lost = f"the workers that had it were lost {error.allowed_failures + 1} times"
        return JobError(f"{lost}; expected workers that stay, as with memory enough", take)
    except CancelledError:
        raise _gone(client.scheduler.address) from None
    except (ImportError, AttributeError) as error:
        raise JobError(f"a worker has another Mocap Autolabel or none ({error}); {_expected()}") from None
    except Exception as error:  # noqa: BLE001 - the others are labelled all the same
        return of_take(error, take)
    if isinstance(words, dict):
        return words
    if status == UNFIT:
        raise JobError(f"{words}; {_expected()}")
    if not job.overwrite:
        # A worker that was believed lost may have finished it after all, before the one that was asked next.
        with suppress(UserError):
            return results_of(job) or _failure(status, words, take)
    return _failure(status, words, take)


def _failure(status: int, words: str, take: Path) -> UserError:
    error = InputError if status == InputError.exit_status else JobError
    return error(words.replace(os.path.abspath(take), str(take)))  # noqa: PTH100


def _end(client, batch: str, futures: list):
    """Has the workers stop what they still do of a batch, and waits until they have cleaned up."""
    limit = time.monotonic() + PATIENCE
    with suppress(OSError, RuntimeError, TimeoutError):  # whoever does not hear it finishes its take, and that whole
        client.cancel(futures, force=True)
        ends = [_send(client, f"{batch}-end-{one}", "let_go", batch, workers=[one]) for one in client.nthreads()]
        for future in ends:
            future.exception(timeout=max(limit - time.monotonic(), 0.1))


def _gone(address: str) -> JobError:
    return JobError(f"the scheduler at {address} went away; expected it to stay, --resume goes on")


def _expected() -> str:
    return f"expected version {version()} and the same paths on every worker; --resume goes on"


# From here on what workers do. A worker takes as many takes at once as it has threads, each in a process of its own
# that labels one take after the other.

RESTING: dict[str, list] = defaultdict(list)  # of each batch: pairs of a process's `crew`, and what closes it
BUSY: Counter[str] = Counter()  # how many more are at work
CHANGED = threading.Condition()


def work(batch: str, wanted: str, take: str, sent: bytes) -> tuple[int, dict | str]:
    """Does a job on this worker: status 0 and the report, or the exit status and why there is none."""
    if version() != wanted:
        return UNFIT, f"the worker on {socket.gethostname()} has version {version()} of Mocap Autolabel"
    if not Path(take).exists():
        return UNFIT, f"the worker on {socket.gethostname()} does not see the take {take}"
    try:
        with scratch_folder() as folder, _hand(batch) as (run, stop), _stopped_when_unwanted(stop):
            with naming_scratch(folder):
                (folder / "job").write_bytes(sent)
            [(_, answer)] = run([partial(label_for_report, read_parcel(folder / "job"))])
    except UserError as error:
        answer = error
    return (0, answer) if isinstance(answer, dict) else (answer.exit_status, str(of_take(answer, Path(take))))


@contextmanager
def _hand(batch: str) -> Iterator[tuple[Callable, Callable]]:
    """What does jobs one after the other in a process, and what stops it; it is kept for the batch's next."""
    with CHANGED:
        BUSY[batch] += 1
        pair = RESTING[batch].pop() if RESTING[batch] else None
    try:
        if pair is None:
            stack = ExitStack()
            pair = stack.enter_context(crew(1)), stack.close
        yield pair
        with CHANGED:
            RESTING[batch].append(pair)
    finally:
        with CHANGED:
            BUSY[batch] -= 1
            CHANGED.notify_all()


@contextmanager
def _stopped_when_unwanted(stop: Callable[[], None]) -> Iterator[None]:
    """Stops what is done in the block as soon as nobody waits for this task of the worker any more."""
    from distributed import Reschedule, get_worker

    worker = get_worker()
    key, over, unwanted = worker.get_current_task(), threading.Event(), threading.Event()

    def watch():
        while not over.wait(POLL):
            # Released by a client that cancels it, and by the scheduler when its client is gone.
            task = worker.state.tasks.get(key)
            if task is None or task.state == "cancelled":
                unwanted.set()
                stop()
                return

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    except (OSError, ValueError):  # the answer's file is gone with its process
        if not unwanted.is_set():
            raise
    finally:
        over.set()
        watcher.join()
    if unwanted.is_set():
        raise Reschedule


def let_go(batch: str):
    """Ends this worker's processes of a batch, once those that are being stopped have cleaned up."""
    with CHANGED:
        CHANGED.wait_for(lambda: not BUSY[batch], PATIENCE)
        pairs = RESTING.pop(batch, [])
        if not BUSY[batch]:
            del BUSY[batch]
    for _, stop in pairs:
        stop()
