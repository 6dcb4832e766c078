# SPDX-License-Identifier: GPL-3.0-or-later
"""How time and memory grow with a take, so that a cliff is seen: Markdown tables, by the library and by NumPy.

python -m tests.benchmarks.growth
python -m tests.benchmarks.growth --only cameras ghosts --models models

Each row says how many times the time of the row above it takes for how many times its size. Times are of the processor
and of one core, the least of some repeats where a job is short; memory is the peak beyond what the process has before,
on Linux. Blobs are virtual people's, points are recorded people's who are left out of training, cut to pieces, and need
the recordings beside the repository; with --models DIR the models that name them are kept there and used again.
"""

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from addon.core.blobs.pipeline import label_take
from addon.core.blobs.search import Hints, find_subject
from addon.core.blobs.subject import Setup
from addon.core.data.lanes import Lanes
from addon.core.data.progress import finished
from addon.core.data.takes import Points
from addon.core.points.naming import chosen_method
from addon.core.points.whole_take.pipeline import USUAL_TARGET, PointOptions, label_points
from addon.core.simulation.rigs import ring_rig
from addon.io.points import read_points
from tests.accuracy import plates, whole_takes
from tests.accuracy.people import BODY26, GAIT15
from tests.benchmarks.both_ways import BY_NUMPY, COMPILED, machine, processor_seconds, rows_of_ways
from tests.benchmarks.cases import RATE, ROOM, WALK
from tests.benchmarks.long_points import forget_peak, megabytes
from tests.core.scenes import Scene, act, built_in, stand

COLUMNS = ("compiled", "grows", "NumPy", "grows", "peak, compiled", "peak, NumPy")
LONG_ENOUGH_S, REPEATS = 1.0, 5  # no more repeats once they took so long
FRAMES = 600  # of takes of points, unless frames are what grows
GAP = 3  # frames between two pieces of a marker
GROUP, EVERY = 8, 32  # ghosts in one frame of so many


@dataclass(frozen=True, eq=False)
class Point:
    """One size of something, a number, and the job that is timed at that size."""

    size: float
    job: Callable[[], object]


Series = Iterator[tuple[str, Iterator[Point]]]


def scene_of(name: str, cameras: int, ghosts: int | None = None, acts: tuple = ()) -> Scene:
    """A virtual person before a ring of cameras, who stands or acts, with so many ghosts in each camera."""
    rig = ring_rig(cameras, radius=4.5, volume_radius=1.3)
    options = ROOM if ghosts is None else replace(ROOM, reflections=ghosts, reflection_on=1.0)
    if acts:
        return act(built_in(name), rig, acts, seed=3, options=options)
    return stand(built_in(name), rig, seed=3, facing=0.7, options=options)


def search_in(scene: Scene) -> Callable[[], object]:
    """The first search in a frame."""
    return partial(find_subject, scene.views()[0], Setup.of(scene.cameras, scene.markerset), Hints())


def walk_of(scene: Scene) -> Callable[[], object]:
    """A take labelled from end to end, in chunks as a file is read."""
    first, last = scene.blobs.frames[[0, -1]].tolist()
    chunks = [scene.blobs.between(at, min(at + 255, last)) for at in range(first, last + 1, 256)]
    return lambda: sum(len(one.labels.marker) for one in label_take(chunks, scene.cameras, scene.markerset, RATE))


def frames(models: Path | None) -> Series:
    """Takes of 240 to 1,920 frames of blobs, and of 500 to 4,000 frames of points."""
    walks = ((240 * times, scene_of("body26", 8, acts=WALK * times)) for times in (1, 2, 4, 8))
    yield "frames of blobs, `body26`, 8 cameras", (Point(size, walk_of(scene)) for size, scene in walks)
    if available():
        model, case, take = person(2, models)
        parts = ((size, take.part(0, size)) for size in (500, 1000, 2000, 3000))
        yield (
            "frames of points, 41 markers in pieces, ghosts as often in all",
            (Point(size, points_job(part, case, model, ghosts=size // 50)) for size, part in parts),
        )


def cameras(_: Path | None) -> Series:
    """Two to sixteen cameras."""
    for name in ("gait15", "body26"):
        sizes = ((count, scene_of(name, count)) for count in (2, 4, 8, 12, 16))
        yield f"cameras, first search, `{name}`", (Point(count, search_in(scene)) for count, scene in sizes)
    sizes = ((count, scene_of("body26", count, acts=WALK)) for count in (2, 4, 8, 12, 16))
    yield "cameras, a walk of four seconds, `body26`", (Point(count, walk_of(scene)) for count, scene in sizes)


def markers(models: Path | None) -> Series:
    """Fifteen to thirty-nine markers of blobs, fifteen to sixty-two of points."""
    sets = ("gait15", "body26", "body39")
    yield "markers, first search, 8 cameras", (Point(int(name[4:]), search_in(scene_of(name, 8))) for name in sets)
    yield (
        "markers, a walk of four seconds, 8 cameras",
        (Point(int(name[4:]), walk_of(scene_of(name, 8, acts=WALK))) for name in sets),
    )
    if available():
        yield f"markers, {FRAMES} frames of points in pieces, 40 ghosts", _points_by_markers(models)


def _points_by_markers(models: Path | None) -> Iterator[Point]:
    for which in range(4):
        model, case, take = person(which, models)
        yield Point(len(case.markers), points_job(take.part(0, FRAMES), case, model))
    model, take = plates.trained([plates.TRAINED]), read_points(plates.TESTED)
    xyz, _ = plates.cut_up(take.xyz[:FRAMES], *plates.CUTS[1], np.random.default_rng(plates.SEED))
    yield Point(62, partial(labelled, anonymous(xyz, take.rate), model))


def ghosts(models: Path | None) -> Series:
    """None to twenty ghosts in each camera, none to forty among a take's points, and some in a few of its frames."""
    counts = (0, 5, 10, 20)
    yield (
        "ghosts in each of 8 cameras, first search, `body26`, beside 26 markers",
        (Point(26 + count, search_in(scene_of("body26", 8, count))) for count in counts),
    )
    yield (
        "ghosts in each of 8 cameras, a walk of four seconds, `body26`, beside 26 markers",
        (Point(26 + count, walk_of(scene_of("body26", 8, count, WALK))) for count in counts),
    )
    if not available():
        return
    model, case, take = person(1, models)
    part = take.part(0, FRAMES)
    yield (
        f"ghosts for a while in {FRAMES} frames of points, beside 26 markers",
        (Point(26 + count, points_job(part, case, model, ghosts=count)) for count in (0, 10, 20, 40)),
    )
    yield (
        f"ghosts in every frame of {FRAMES}, beside 26 markers",
        (Point(26 + count, points_job(part, case, model, every=(count, 1))) for count in (0, 3, 10, 20, 40)),
    )
    yield (
        f"frames of {FRAMES} with {GROUP} ghosts, beside the others",
        (Point(FRAMES + count, points_job(part, case, model, every=(GROUP, FRAMES // count if count else 0)))
         for count in (0, FRAMES // EVERY, FRAMES // 4, FRAMES)),
    )  # fmt: skip


def tracklets(models: Path | None) -> Series:
    """Trajectories cut ever shorter."""
    if not available():
        return
    model, _, take = person(2, models)
    part = take.part(0, 3000)
    yield (
        "tracklets in 3,000 frames of 41 markers",
        (
            Point(len(points.names), partial(labelled, points, model))
            for points in (cut_evenly(part, length) for length in (2000, 300, 60, 30, 12))
        ),
    )


def cut_evenly(take: whole_takes.Take, length: int) -> Points:
    """The take without names, every trajectory cut to pieces of so many frames with gaps between, no two in step.

    Pieces share lanes as a file's do: with a column each, twenty thousand would fill the memory.
    """
    count, marker_count = take.xyz.shape[:2]
    pieces = [
        (max(first, 0), min(first + length - GAP, count), marker)
        for marker in range(marker_count)
        for first in range(-(marker * GAP) % length - length, count, length)
        if np.isfinite(take.xyz[max(first, 0) : max(first + length - GAP, 0), marker, 0]).any()
    ]
    first, after, marker = np.random.default_rng(0).permutation(pieces).T
    lanes = Lanes.packed(first, after - 1)
    xyz = np.full((count, lanes.count, 3), np.nan)
    for begin, end, one, lane in zip(first, after, marker, lanes.lane, strict=True):
        xyz[begin:end, lane] = take.xyz[begin:end, one]
    residual = np.where(np.isfinite(xyz[..., 0]), 0.0005, np.nan)
    return Points(("",) * len(first), xyz, residual, take.rate, 1, lanes=lanes)


def available() -> bool:
    """Whether the recorded people are there."""
    return whole_takes.PEOPLE.exists()


def person(which: int, models: Path | None):
    """A model, its case and a take of somebody left out of it: 15, 26, 41 or 59 markers."""
    cases = (
        lambda: whole_takes.case_few("gait15", GAIT15, False),
        lambda: whole_takes.case_few("body26", BODY26, False),
        whole_takes.case_others,
        lambda: whole_takes.case_lab(3),
    )
    case = next(cases[which]())
    return whole_takes.model_of(case, models), case, max(case.tested, key=lambda take: len(take.xyz))


def points_job(take, case, model, ghosts: int = 40, every: tuple[int, int] = (0, 0)) -> Callable[[], object]:
    """A take cut to pieces and labelled, with so many ghosts in all, or `every` so many in each of so many frames."""
    count, step = every
    how = whole_takes.Pieces(ghosts=0 if step else ghosts)
    points, _ = whole_takes.cut_up(take, case.markers, how)
    if count and step:
        shape = len(points.xyz), count, 3
        around = np.nanmean(points.xyz, axis=1, keepdims=True)
        more = around + np.random.default_rng(0).normal(0, 0.5, shape)
        more[np.arange(shape[0]) % step != 0] = np.nan
        points = anonymous(np.concatenate([points.xyz, more], axis=1), take.rate)
    return partial(labelled, points, model)


def anonymous(xyz: np.ndarray, rate: float) -> Points:
    """Points (T, P, 3) without names."""
    residual = np.where(np.isfinite(xyz[..., 0]), 0.0005, np.nan)
    return Points(("",) * xyz.shape[1], xyz, residual, rate, 1)


def labelled(points: Points, model):
    """The whole take of points."""
    return finished(label_points(points, model, PointOptions(chosen_method(model, "auto"), USUAL_TARGET)))


RUNS: dict[str, Callable[[Path | None], Series]] = {
    "frames": frames,
    "cameras": cameras,
    "markers": markers,
    "ghosts": ghosts,
    "tracklets": tracklets,
}


def measured(names: list[str], models: Path | None):
    """Prints a line of JSON for each point, of this process's way to work."""
    linux = Path("/proc/self/clear_refs").exists()
    with threadpool_limits(1, user_api="blas"):
        search_in(scene_of("gait15", 4))()  # so that nothing is loaded while it is timed
        for name in names:
            for title, points in RUNS[name](models):
                for point in points:
                    before = megabytes("VmRSS") if linux else 0.0
                    if linux:
                        forget_peak()
                    seconds = [processor_seconds(point.job)]
                    while sum(seconds) < LONG_ENOUGH_S and len(seconds) < REPEATS:
                        seconds.append(processor_seconds(point.job))
                    peak = megabytes("VmHWM") - before if linux else float("nan")
                    print(json.dumps([title, point.size, min(seconds), peak]), flush=True)


def main() -> int:
    """Measures both ways, one process each, and prints a table for everything that grows."""
    ways = rows_of_ways("tests.benchmarks.growth", __doc__, list(RUNS), measured, (COMPILED, BY_NUMPY))
    if not ways:
        return 0
    print(f"{machine()}, processor time of one core")
    last = None
    for rows in zip(*ways, strict=True):
        (title, size, _, _), above = rows[0], last
        if last is None or title != last[0][0]:
            above = None
            print(f"\n| {title} | {' | '.join(COLUMNS)} |\n| ---: | {' | '.join(['---:'] * len(COLUMNS))} |")
        cells = [f"{size:,.0f}"]
        for way, row in enumerate(rows):
            cells += [_shown(row[2]), "" if above is None else _growth(above[way], row)]
        print(f"| {' | '.join([*cells, *(f'{row[3]:,.0f} MB' for row in rows)])} |", flush=True)
        last = rows
    return 0


def _growth(above: list, row: list) -> str:
    return f"{row[2] / above[2]:.2f} for {row[1] / above[1]:.2f}"


def _shown(seconds: float) -> str:
    return f"{1000 * seconds:,.1f} ms" if seconds < 1 else f"{seconds:,.2f} s"


if __name__ == "__main__":
    sys.exit(main())
