# SPDX-License-Identifier: GPL-3.0-or-later
"""Work that tells its progress by calling a function, as a generator that can be stepped, and the other way round."""

import queue
import threading
from collections.abc import Callable, Generator
from typing import Any

from .progress import Progress, finished

WORK_DONE = object()


MAX_WAIT_S = 0.2  # that a step waits for news of the work: as long as a person does not mind a window that stands


def in_background(work: Callable[[Callable[[float], None]], Any]) -> Generator[float, None, Any]:
    """Runs `work(tell)` in a thread; yields the last share that it gave, now and then, and returns its result.

    What `work` raises is raised here. Closing the generator makes the next `tell` end the work.
    """
    news: queue.SimpleQueue = queue.SimpleQueue()
    stop = threading.Event()
    outcome: dict[str, Any] = {}

    def tell(share: float):
        if stop.is_set():
            raise _StoppedError
        news.put(share)

    def run():
        try:
            outcome["result"] = work(tell)
        except BaseException as error:  # noqa: BLE001 - raised again where the work was asked for
            outcome["error"] = error
        news.put(WORK_DONE)

    # A daemon, so that whoever stops the program does not wait for it.
    threading.Thread(target=run, daemon=True).start()
    share = 0.0
    try:
        while True:
            try:
                item = news.get(timeout=MAX_WAIT_S)
            except queue.Empty:
                yield share
                continue
            if item is WORK_DONE:
                break
            share = item
            yield share
    finally:
        stop.set()
    if "error" in outcome:
        raise outcome["error"]
    return outcome["result"]


def drained(steps: Generator[Progress, None, Any], tell: Callable[[float], None]) -> Any:
    """What a job returns, having said how far it is all the way; a `tell` that raises ends it."""
    return finished(steps, lambda progress: tell(progress.fraction))


class _StoppedError(Exception):
    """Nobody waits for the work any more."""
