# SPDX-License-Identifier: GPL-3.0-or-later
"""Captures through the doors that people use, files in and files out: the command line, and that of a real Blender."""

import csv
import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from addon.core.data.markersets import MarkerSet
from addon.core.data.takes import Blobs
from addon.core.geometry.cameras import Cameras
from addon.io.blobs import write_blobs
from addon.io.cameras import write_cameras
from addon.io.markersets import write_markerset
from scripts import build, real_blender

from .captures import Score, Trial
from .models import left_out_model
from .runs import Plan, show
from .standing import standing
from .tables import SCORE_COLUMNS, score_cells, share, table
from .walking import RATE, walking

PLATFORM = "linux-x64"
ROOMS = ("vicon12", "ring")
TAKE_COLUMNS = ("take", "cameras", "frames", "blobs", "labels", "wrong", "recall", "F1", "most often", "frames/s")
SUM_COLUMNS = ("takes", "wrong labels", "precision", "recall", "F1", "blobs named otherwise than outside Blender")
BOTH_COLUMNS = ("take", "cameras", "frames", "blobs", "labels", "wrong", "precision", "recall")
# Words of a command line in, the ended program out.
Program = Callable[..., subprocess.CompletedProcess]


class Door:
    """Labels takes as `mocap-autolabel label` does. `report` is what it said of the last one."""

    def __init__(self, markerset: MarkerSet, program: Program, folder: Path, rate: float):
        folder.mkdir()
        self.program, self.folder, self.rate = program, folder, rate
        self.model = folder / f"{markerset.name}.markerset.json"
        write_markerset(self.model, markerset)
        self.report: dict = {}
        self.done = 0

    def __call__(self, blobs: Blobs, cameras: Cameras) -> tuple[np.ndarray, np.ndarray]:
        """The marker's name and the step of every blob, in the blobs' order."""
        self.done += 1
        take, room, out = self.folder / f"take{self.done}.csv", self.folder / "room.toml", self.folder / "out"
        write_blobs(take, blobs, cameras)
        write_cameras(room, cameras)
        words = ["label", take, "--model", self.model, "--cameras", room, "--rate", self.rate, "--out", out]
        ended = self.program(*map(str, words))
        if ended.returncode:
            raise RuntimeError(ended.stdout + ended.stderr)
        self.report = json.loads((out / f"take{self.done}.report.json").read_text(encoding="utf-8"))
        with (out / f"take{self.done}.labels.csv").open(encoding="utf-8") as file:
            rows = [(row["marker"], row["step"]) for row in csv.DictReader(file)]
        names, steps = np.array(rows, dtype=object).reshape(-1, 2).T
        return names, steps


def here(*words: str) -> subprocess.CompletedProcess:
    """The command line of this Python, with rays cast at the body as inside Blender."""
    program = (sys.executable, "-c", "import sys; from addon.cli import main; sys.exit(main(sys.argv[1:]))")
    command = (*program, *words, "--occlusion", "bvh")
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=build.ROOT)


def run_walking(plan: Plan):
    """Every walk and turn of everybody, take by take, through the command line."""
    rows, takes, occlusions, cameras = [], [], set(), set()
    with tempfile.TemporaryDirectory() as name:
        for set_name in plan.sets:
            for room in ROOMS:
                score, seconds = None, 0.0
                for number, fold in enumerate(plan.folds):
                    markerset = left_out_model(set_name, fold)
                    score = score or Score(markerset.markers)
                    door = Door(markerset, here, Path(name) / f"{set_name}-{room}-{number}", RATE)
                    for trial in walking(markerset.markers, fold, None, plan.seed, room=room):
                        names, steps = door(trial.blobs, trial.cameras)
                        score.count(trial, names, steps)
                        speed = door.report["timing"]["frames_per_second"]
                        seconds += len(trial.blobs.frames) / speed
                        occlusions.add(door.report["occlusion"])
                        cameras.add(len(trial.cameras))
                        alone = Score(markerset.markers)
                        alone.count(trial, names, steps)
                        takes.append([set_name, room, *_take_cells(trial, alone, speed)])
                counts = score.counts
                rows.append([set_name, room, score.takes, *score_cells(counts), f"{counts.frames / seconds:.0f}"])
                show(plan, score)
    seen_by = " or ".join(map(str, sorted(cameras)))
    print(f"\n### Walks and turns, {seen_by} cameras, 60 Hz, ghosts ({plan.people()})\n")
    print(f"Through `mocap-autolabel label`; the body in the way: {', '.join(sorted(occlusions))}.\n")
    print(table(("set", "room", "takes", *SCORE_COLUMNS, "frames a second"), rows))
    print("\n" + table(("set", "room", *TAKE_COLUMNS), takes))


def _take_cells(trial: Trial, score: Score, speed: float) -> list:
    """The cells under `TAKE_COLUMNS` of one take."""
    counts = score.counts
    figures = counts.as_dict()
    wrong = Counter(error for _, errors in score.flawed for error in errors if error[0])
    often = [f"{name} for {true or 'a ghost'}, {times}" for (name, true), times in wrong.most_common(1)]
    return [
        trial.title,
        len(trial.cameras),
        counts.frames,
        len(trial.blobs),
        counts.given,
        counts.given - counts.right,
        f"{100 * figures['recall']:.2f} %",
        f"{100 * figures['f1']:.2f} %",
        *(often or [""]),
        f"{speed:.0f}",
    ]


def run_door(plan: Plan):
    """Every walk and turn of everybody in both rooms, by a real Blender and by this Python's command line."""
    rows, takes = [], []
    with tempfile.TemporaryDirectory() as name, _both(Path(name)) as programs:
        for set_name, room in product(plan.sets, ROOMS):
            score, differing = Score(left_out_model(set_name, plan.folds[0]).markers), 0
            for number, fold in enumerate(plan.folds):
                markerset = left_out_model(set_name, fold)
                trials = walking(markerset.markers, fold, None, plan.seed, room=room)
                place = Path(name) / f"{set_name}-{room}-{number}"
                for trial, labels, otherwise in _by_both(trials, markerset, programs, place, RATE):
                    alone = Score(markerset.markers)
                    for one in (score, alone):
                        one.count(trial, *labels)
                    differing += otherwise
                    takes.append([set_name, room, *_both_cells(trial, alone), otherwise])
                    print(*takes[-1], sep=" | ", file=sys.stderr, flush=True)
            rows.append([set_name, f"walks and turns, {room}", *_sum_cells(score, differing)])
            show(plan, score)
    print(f"\n### Walks and turns through the command line of a real Blender, ghosts ({plan.people()})\n")
    print(table(("set", "captures", *SUM_COLUMNS), rows))
    print("\n" + table(("set", "room", *BOTH_COLUMNS, "named otherwise outside"), takes))


def run_door_standing(plan: Plan):
    """Standing frames in the paper's rig, by a real Blender and by this Python's command line."""
    rows = []
    with tempfile.TemporaryDirectory() as name, _both(Path(name)) as programs:
        for set_name in plan.sets:
            score, differing = Score(left_out_model(set_name, plan.folds[0]).markers), 0
            for number, fold in enumerate(plan.folds):
                markerset = left_out_model(set_name, fold)
                trials = standing(markerset.markers, fold, max(plan.count // 4, 2), plan.seed)
                for trial, labels, otherwise in _by_both(
                    trials, markerset, programs, Path(name) / f"{set_name}-{number}"
                ):
                    score.count(trial, *labels)
                    differing += otherwise
            rows.append([set_name, "standing frames, paper's rig", *_sum_cells(score, differing)])
            show(plan, score)
    print(f"\n### Standing frames through the command line of a real Blender, ghosts ({plan.people()})\n")
    print(table(("set", "captures", *SUM_COLUMNS), rows))


@contextmanager
def _both(folder: Path) -> Iterator[tuple[Program, Program]]:
    """The command lines of a real Blender, with the zip installed, and of this Python; says which Blender."""
    blender = real_blender.find()
    yield _install(blender, folder), here
    print("\nBlender {}.{}.{}".format(*blender.version))


def _by_both(trials: Iterable[Trial], markerset: MarkerSet, programs, place: Path, rate: float = 100.0):
    """Yields each capture, its names and steps by the first program, and how many blobs the second names otherwise."""
    doors = [
        Door(markerset, program, place.with_name(f"{place.name}-{number}"), rate)
        for number, program in enumerate(programs)
    ]
    for trial in trials:
        labels, others = (door(trial.blobs, trial.cameras) for door in doors)
        yield trial, labels, int((labels[0] != others[0]).sum())


def _sum_cells(score: Score, differing: int) -> list:
    """The cells under `SUM_COLUMNS`."""
    counts = score.counts
    figures = counts.as_dict()
    wrong = share(counts.given - counts.right, counts.given, 3)
    rates = [f"{100 * figures[name]:.2f} %" for name in ("precision", "recall", "f1")]
    return [score.takes, wrong, *rates, share(differing, score.blobs, 3)]


def _both_cells(trial: Trial, score: Score) -> list:
    """The cells under `BOTH_COLUMNS` of one take."""
    counts = score.counts
    rates = [f"{100 * counts.as_dict()[name]:.2f} %" for name in ("precision", "recall")]
    wrong = counts.given - counts.right
    return [trial.title, len(trial.cameras), counts.frames, len(trial.blobs), counts.given, wrong, *rates]


def _install(blender: real_blender.RealBlender, folder: Path) -> Program:
    """Builds the zip for this Blender, installs it among settings of its own, and gives its command line."""
    package = build.build("{}.{}".format(*blender.version[:2]), PLATFORM, folder, None)
    home = folder / "home"
    home.mkdir()
    words = ("install-file", "--repo", "user_default", "--enable", str(package))
    ended = blender.run("--background", "--command", "extension", *words, home=home)
    if ended.returncode:
        raise RuntimeError(ended.stdout + ended.stderr)
    return partial(blender.run, "--background", "--command", "mocap_autolabel", home=home)
