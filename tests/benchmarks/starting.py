# SPDX-License-Identifier: GPL-3.0-or-later
"""What `label` takes beyond naming, from the shell to its files, and 36 short takes side by side, as a Markdown table.

python -m tests.benchmarks.starting
python -m tests.benchmarks.starting --only start --repeats 15

By NumPy and by the compiled library, each command in processes of its own as a shell starts them; wall and processor
time, medians. Naming is what it takes in a process that has named the take before, so that all that is loaded for it
counts as beyond. Points are parts of 200 frames of recorded people, who must be beside the repository; blobs are of the
take that the project makes by itself.
"""

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import numpy as np

from addon.capturing import cut, write_capture
from addon.core.data.takes import Points
from addon.core.kernels.library import SWITCH
from addon.demo.take import MODEL, TROUBLE, make_performance
from addon.io.cameras import write_cameras
from addon.io.markersets import open_markerset
from addon.io.points import write_c3d
from tests.accuracy import whole_takes
from tests.accuracy.people import BODY26, GAIT15

COLUMNS = ("what", "NumPy", "compiled", "floor", "aim")
TAKES, FRAMES = 36, 200
COMMAND = (sys.executable, "-c", "import sys; from addon.cli import main; sys.exit(main())", "label")
# The same command again and again in one process; prints wall and processor time of naming, the shortest of all.
NAMING = """
import io, json, sys, time
from contextlib import redirect_stdout
from addon.cli import main
from addon.jobs import blobs, points

spent = [0.0, 0.0]

def watched(module, name):
    work = getattr(module, name)
    def steps(*given):
        steps, begin = work(*given), (time.perf_counter(), time.process_time())
        while True:
            try:
                step = next(steps)
            except StopIteration as end:
                return end.value
            finally:
                spent[:] = [one + now() - was for one, now, was in zip(spent, CLOCKS, begin)]
            yield step
            begin = time.perf_counter(), time.process_time()
    setattr(module, name, steps)

CLOCKS = time.perf_counter, time.process_time
watched(points, "label_take")
watched(blobs, "label_blobs")
seen = []
for _ in range(6):
    spent[:] = [0.0, 0.0]
    with redirect_stdout(io.StringIO()):
        assert main(["label", *sys.argv[1:], "--overwrite"]) == 0
    seen.append(list(spent))
print(json.dumps([min(one) for one in zip(*seen[1:])]))
"""
Times = tuple[float, float]  # s of wall and of processor


def short_takes(folder: Path, name: str, markers: list[str], pieces: bool, count: int) -> list[Path]:
    """Parts of walks of people, in the order of a set's markers or cut to pieces with ghosts among them."""
    folder.mkdir()
    parts = (
        (case, take.part(0, FRAMES)) for case in whole_takes.case_few(name, markers, False) for take in case.tested
    )
    while len(paths := sorted(folder.glob("*.c3d"))) < count:
        case, take = next(parts)
        for seed in range(min(6, count - len(paths))):
            if pieces:
                points, _ = whole_takes.anonymous(take, case, seed)
            else:
                xyz = take.of(np.random.default_rng(seed).permutation(case.markers).tolist()).xyz
                residual = np.where(np.isfinite(xyz[..., 0]), 0.0005, np.nan)
                points = Points(("",) * xyz.shape[1], xyz, residual, take.rate, 1)
            write_c3d(folder / f"{len(paths) + seed:02}.c3d", points)
    return paths


def blobs(folder: Path) -> list[str]:
    """Arguments for the first frames of the demo's take."""
    folder.mkdir()
    made = make_performance(open_markerset(MODEL))
    body = made.body
    part = slice(0, FRAMES)
    body = type(body)(body.occlusion, body.attachment, body.rotations[part], body.joints[part], body.scale[part])
    for _ in write_capture(cut(made.take, (1, FRAMES)), made.cameras, TROUBLE, body, folder / "walk.csv"):
        pass
    write_cameras(folder / "room.toml", made.cameras)
    return [str(folder / "walk.csv"), "--cameras", str(folder / "room.toml"), "--model", MODEL]


def starts(folder: Path) -> Iterator[tuple[str, list[str], str, str]]:
    """Single takes: what they are and the arguments."""
    yield f"`label`, blobs, {FRAMES} frames, beyond naming", blobs(folder / "blobs"), "", ""
    if whole_takes.PEOPLE.exists():
        for name, markers in (("gait15", GAIT15), ("body26", BODY26)):
            [take] = short_takes(folder / f"one-{name}", name, markers, pieces=name == "body26", count=1)
            what = (
                f"`label`, points, `{name}`{' in pieces' if name == 'body26' else ''}, {FRAMES} frames, beyond naming"
            )
            yield what, [str(take), "--model", name], "0.45", "0.3"


def batches(folder: Path) -> Iterator[tuple[str, list[str], str, str]]:
    """Batches: what they are and the arguments."""
    if not whole_takes.PEOPLE.exists():
        return
    for name, markers, pieces in (("gait15", GAIT15, False), ("gait15", GAIT15, True), ("body26", BODY26, True)):
        takes = short_takes(folder / f"{name}-{pieces}", name, markers, pieces, TAKES)
        for jobs in (1, 2):
            what = f"{TAKES} takes of {FRAMES} frames, `{name}`{' in pieces' if pieces else ''}, `--jobs {jobs}`"
            given = [*map(str, takes), "--model", name, "--jobs", str(jobs)]
            yield what, given, *(("8", "5") if jobs == 2 else ("", ""))


def run(command: list[str], numpy: bool) -> tuple[Times, str]:
    """Wall and processor time of a process and all that it starts, and what it prints."""
    environment = os.environ | {SWITCH: "1" if numpy else "0"}
    begin, before = time.perf_counter(), os.times()
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=environment)
    after, wall = os.times(), time.perf_counter() - begin
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    return (wall, spent), done.stdout


def whole(given: list[str], out: Path, numpy: bool, repeats: int) -> Times:
    """The usual time of the whole command, into a folder that is not there."""
    seen = []
    for _ in range(repeats):
        shutil.rmtree(out, ignore_errors=True)
        seen.append(run([*COMMAND, *given, "--out", str(out)], numpy)[0])
    return tuple(median(one) for one in zip(*seen, strict=True))


def beyond(given: list[str], out: Path, numpy: bool, repeats: int) -> Times:
    """The same without naming."""
    named = json.loads(run([sys.executable, "-c", NAMING, *given, "--out", str(out)], numpy)[1])
    return tuple(one - other for one, other in zip(whole(given, out, numpy, repeats), named, strict=True))


def main() -> int:
    """Measures both ways."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.starting", description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=("start", "batch"), help="these measurements alone")
    parser.add_argument("--repeats", type=int, default=9, help="of each command that labels one take (default 9)")
    given = parser.parse_args()
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    print(f"Python {platform.python_version()}, NumPy {np.__version__}, {os.cpu_count()} cores{load}; ", end="")
    print("seconds of wall / processor\n")
    print(f"| {' | '.join(COLUMNS)} |\n| --- | {' | '.join(['---:'] * (len(COLUMNS) - 1))} |")
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        work = [(starts, beyond, given.repeats)] if given.only != "batch" else []
        work += [(batches, whole, 1)] if given.only != "start" else []
        for rows, measure, repeats in work:
            for what, words, floor, aim in rows(folder):
                ways = [measure(words, folder / "out", numpy, repeats) for numpy in (True, False)]
                cells = what, *(f"{wall:.2f} / {spent:.2f}" for wall, spent in ways), floor, aim
                print(f"| {' | '.join(cells)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
