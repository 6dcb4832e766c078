# SPDX-License-Identifier: GPL-3.0-or-later
"""How well and how fast a stream is named: python -m tests.accuracy.live --keep FOLDER.

Prints the table of results/live.json. Takes are played frame by frame in their own time: a window's names are heard
when the core that solves them would be done. How long that takes is told by how many functions are called, so that
figures are the same whatever else the machine does. In the middle everything is out of sight for a second. Nobody who
is named is in the training of the model.
"""

import argparse
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import islice, product
from pathlib import Path
from time import process_time

import numpy as np
from threadpoolctl import threadpool_limits

from addon.core.body.bodies import BodyModel
from addon.core.data.takes import Points
from addon.core.points.models import Model
from addon.core.points.several.live import namer_of, solved_of_several
from addon.core.points.several.wearers import Wearer
from addon.core.points.whole_take.live import LiveNamer, Window, WindowNames, solved_window, subject_in
from addon.core.posing.posing import FollowedBody
from addon.io.models import open_model
from scripts.results import markdown

from . import people, strangers, whole_takes
from .actors import ACTING_M, Meeting, acting, walkers
from .known_sets import serve
from .whole_takes import Case, Pieces, cut_up

LEAST_S, MOST_S = 10.0, 16.0  # of a take: shorter ones are played there and back, again and again
AWAY_S = 1.0
FOUND = 0.9  # of the markers in sight, of who is found
FOLDS, ACTORS, MEETINGS = 1, 2, 2  # by time: five walkers, two actors, and two meetings of each kind
CUTS = range(3)  # of the takes of other labs: from one to the next as many as six times the names are wrong
FEW = Pieces(hidden=2, ghosts=10)
# As measured: s that a window takes to be solved, for each function that is called for that, and more for each of its
# frames. Of a single window it is off by a third.
SOLVING_S, CALL_S, FRAME_S = 0.05, 2.2e-6, 8e-9


class Calls:
    """How many functions of Python were called since it was begun with; use it as a context manager."""

    def __enter__(self):
        self.count, watch = 0, sys.monitoring
        watch.use_tool_id(watch.PROFILER_ID, "calls")
        watch.register_callback(watch.PROFILER_ID, watch.events.PY_START, self._add)
        watch.set_events(watch.PROFILER_ID, watch.events.PY_START)
        return self

    def _add(self, *_: object):
        self.count += 1

    def __exit__(self, *_: object):
        sys.monitoring.set_events(sys.monitoring.PROFILER_ID, 0)
        sys.monitoring.free_tool_id(sys.monitoring.PROFILER_ID)


@dataclass
class Tally:
    """What came of a take."""

    seconds: float = 0.0
    there: int = 0
    right: int = 0
    wrong: int = 0
    given: int = 0
    renamed: int = 0
    first: float = math.nan
    again: float = math.nan
    ms: list[float] = field(default_factory=list)
    posing: list[float] = field(default_factory=list)
    told: list[float] = field(default_factory=list)
    solving: list[float] = field(default_factory=list)


def there_and_back(take: people.Take) -> people.Take:
    """A take that is long enough, and not too long."""
    xyz = take.xyz[: int(MOST_S * take.rate)]
    while len(xyz) < LEAST_S * take.rate:
        xyz = np.concatenate([xyz, xyz[-2::-1]])
    return people.Take(take.subject, take.name, take.markers, xyz, take.rate)


def played(points: Points, truth: np.ndarray, model: Model, people: int = 1) -> Tally:
    """Names the points (T, P, 3) of a take of so many `people`, whose markers in a row are `truth` (P,) or (T, P)."""
    xyz, truth = points.xyz[:], np.broadcast_to(truth, points.xyz.shape[:2])
    namer, found, solve = namer_of([model] * people, points.rate), Tally(), solver(model, people)
    done, names, body, away = 0, None, None, len(xyz) // 2
    found.seconds = len(xyz) / points.rate
    back = away + round(AWAY_S * points.rate)
    with threadpool_limits(1, user_api="blas"):
        warm_up(points, namer_of([model] * people, points.rate), solve)
        for frame, every in enumerate(xyz):
            at = np.flatnonzero(np.isfinite(every[:, 0])) if not away <= frame < back else np.zeros(0, int)
            begin = process_time()
            if names is not None and frame >= done:
                namer.hear(names)
                names = None
            marker, _ = namer.name(frame, every[at], at + len(truth[0]) * (frame >= back))
            found.renamed += len(namer.renamed)
            if people > 1 and not found.given:  # who is first of them is for the namer to say
                truth = as_called(marker, truth, truth[frame, at], len(model.markerset), people)
            found.ms.append(1000 * (process_time() - begin))
            if body is not None:
                begin, places = process_time(), np.full((len(model.markerset), 3), np.nan)
                places[marker[marker >= 0]] = every[at[marker >= 0]]
                if body.pose(places) is not None:
                    found.posing.append(1000 * (process_time() - begin))
            if names is None and (window := namer.window()) is not None:
                begin = process_time()
                with Calls() as calls:
                    names = solve(window)
                found.solving.append(process_time() - begin)
                found.told.append(SOLVING_S + (CALL_S + FRAME_S * len(window.xyz)) * calls.count)
                done = frame + max(math.ceil(found.told[-1] * points.rate), 1)
                body = body or (_body(model, window, names) if people == 1 else None)
            _count(found, marker, truth[frame, at], frame, back, points.rate)
    return found


def _body(model: Model, window: Window, names: WindowNames) -> FollowedBody | None:
    """Who is in a window, to be posed; None where that is not known."""
    subject = subject_in(model, window, names.marker)
    return None if subject is None else FollowedBody(BodyModel(model.markerset), subject)


def solver(model: Model, people: int) -> Callable[[Window], WindowNames]:
    """What solves the windows of so many who wear a model."""
    if people == 1:
        return partial(solved_window, model)
    return partial(solved_of_several, tuple(Wearer(str(number), model) for number in range(people)))


def as_called(marker: np.ndarray, truth: np.ndarray, now: np.ndarray, size: int, people: int) -> np.ndarray:
    """The truth with people exchanged as they are in a frame's markers (P,), whose truth is `now` (P,)."""
    given = (marker >= 0) & (now >= 0)
    whose = np.arange(people)
    for person in range(people):
        if (own := given & (now // size == person)).any():
            whose[person] = np.bincount(marker[own] // size).argmax()
    return np.where(truth >= 0, size * whose[truth // size] + truth % size, truth)


def warm_up(points: Points, namer: LiveNamer, solve: Callable[[Window], WindowNames]):
    """Solves what is far from any stream: a process that works for long has all loaded."""
    for frame in range(round(points.rate / 2)):
        every = points.xyz[len(points.xyz) - 1 - frame]
        at = np.flatnonzero(np.isfinite(every[:, 0]))
        namer.name(frame, every[at], at)
    window = namer.window()
    assert window is not None
    solve(window)


def _count(found: Tally, marker: np.ndarray, true: np.ndarray, frame: int, back: int, rate: float):
    """Adds a frame; what counts as there is what is there once somebody was found, and was again."""
    right, given = (marker == true) & (true >= 0), marker >= 0
    share = right.sum() / max((true >= 0).sum(), 1)
    if math.isnan(found.first) and share >= FOUND:
        found.first = frame / rate
    if math.isnan(found.again) and frame >= back and share >= FOUND:
        found.again = (frame - back) / rate
    found.right, found.given = found.right + int(right.sum()), found.given + int(given.sum())
    found.wrong += int((given & ~right).sum())
    settled = not math.isnan(found.again) if frame >= back else not math.isnan(found.first)
    found.there += int((true >= 0).sum()) if settled else int(right.sum())


Group = Iterator[tuple[Points, np.ndarray, Model, int]]  # points, their truth, what is worn and by how many


def of_cases(some: list[Case], keep: Path, cuts: Iterable[int] = (0,)) -> Group:
    """The takes of cases of whole takes, or of as many, each cut to pieces so often."""
    for case in some:
        model = whole_takes.model_of(case, keep)
        for take, cut in product(case.tested, cuts):
            yield *cut_up(there_and_back(take), case.markers, FEW, cut), model, 1


def of_actor(keep: Path) -> Group:
    """One of two actors, by the other's model."""
    one, other = (whole_takes.actors("actors53")[name] for name in ("p1", "p2"))
    return of_cases([Case("actors53 p1", (other,), (one,), one.markers)], keep, CUTS)


def built_in(name: str, takes: Iterable[people.Take]) -> Case:
    """Takes of other labs in a built-in set."""
    return Case(name, (), tuple(takes), open_model(name).markerset.markers, built_in=name)


def of_two(meetings: Iterator[Meeting], keep: Path) -> Group:
    """Two who are in one take."""
    for meeting in islice(meetings, MEETINGS):
        both = there_and_back(meeting.together())
        yield *cut_up(both, both.markers, FEW), whole_takes.model_of(meeting.training, keep), len(meeting.people)


def groups(keep: Path) -> dict[str, Callable[[], Group]]:
    """What is tried."""
    known = whole_takes.CASES
    return {
        "walks, `body26` of other people": lambda: of_cases([*known["pieces-body26"]()][:FOLDS], keep),
        "`cmu41`, the others learned": lambda: of_cases([*known["others"]()][:ACTORS], keep),
        "tennis serve, `body39`": lambda: of_cases([built_in("body39", serve())], keep),
        "strangers, `body26`": lambda: of_cases([built_in("body26", strangers.in_body26())], keep, CUTS),
        "two walkers, `body26` of other people": lambda: of_two(walkers(2), keep),
        "two of `cmu41`, the others learned": lambda: of_two(acting(ACTING_M), keep),
        "`actors53`, one learned": lambda: of_actor(keep),
    }


def row(title: str, some: list[Tally]) -> list[str]:
    """A row of the table."""
    every_ms = [np.concatenate([getattr(one, name) for one in some]) for name in ("ms", "posing")]
    there, right, wrong, given = (
        sum(getattr(one, name) for one in some) for name in ("there", "right", "wrong", "given")
    )
    missed = sum(math.isnan(one.first) for one in some)
    recall = f"{100 * right / there:.2f} %" if missed < len(some) else "none"
    times = [np.array([getattr(one, name) for one in some]) for name in ("first", "again")]
    shown = [f"{np.nanmedian(one):.1f}, {np.nanmax(one):.1f}" if np.isfinite(one).any() else "never" for one in times]
    return [
        title, str(len(some)), f"{sum(one.seconds for one in some):.0f}", recall,
        f"{100 * wrong / max(given, 1):.3f} %", str(sum(one.renamed for one in some)), *shown, str(missed),
        *(" / ".join(f"{np.quantile(ms, share):.1f}" for share in (0.5, 0.99, 0.999)) if len(ms) else "none"
          for ms in every_ms),
        " / ".join(f"{np.median(np.concatenate(each)):.2f}"
                   for each in ([one.told for one in some], [one.solving for one in some])),
    ]  # fmt: skip


COLUMNS = [
    "takes", "number", "s", "settled recall", "wrong", "renamed", "first found, s (median, most)",
    "found again, s (median, most)", "never found", "ms of a core a frame (50, 99, 99.9 %)",
    "ms more to pose the body", "s to solve a window, told / measured",
]  # fmt: skip


def main():
    """Prints what came of each group of takes."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--keep", type=Path, required=True, help="where models are kept")
    given = parser.parse_args()
    rows = []
    for title, takes in groups(given.keep).items():
        rows.append(row(title, [played(*one) for one in takes()]))
        print(rows[-1], flush=True)
    print(markdown(COLUMNS, rows))


if __name__ == "__main__":
    main()
