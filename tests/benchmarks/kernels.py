# SPDX-License-Identifier: GPL-3.0-or-later
"""What the compiled library saves: each job by NumPy and by the library, in a process of its own, as a Markdown table.

python -m tests.benchmarks.kernels
python -m tests.benchmarks.kernels --only points train --models models

Times are of the processor and of one core, the median of some repeats. Points and training need the recorded people
beside the repository; with --models DIR the models that the people left out are named by are kept there and used again.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from time import process_time

import numpy as np
from threadpoolctl import threadpool_limits

from addon.core.blobs.pipeline import label_take
from addon.core.blobs.search import Hints, find_subject, first_starts
from addon.core.blobs.subject import Setup
from addon.core.blobs.subject import name as name_blobs
from addon.core.body.bodies import Bodies, BodyModel
from addon.core.data.progress import finished
from addon.core.data.takes import Points
from addon.core.geometry import rotations
from addon.core.geometry.views import View
from addon.core.kernels.library import SWITCH
from addon.core.papers.virtual_occlusions.cloud import build_cloud
from addon.core.points.naming import chosen_method
from addon.core.points.whole_take.pipeline import USUAL_TARGET, PointOptions, label_points
from addon.core.simulation.rigs import paper_rig, ring_rig
from addon.core.simulation.simulate import CaptureOptions
from addon.core.simulation.virtual import Act
from addon.core.training.pipeline import TrainingOptions, train
from addon.core.training.takes import LabelledTake
from addon.io.markersets import builtin_markersets, open_markerset
from addon.io.points import read_points
from tests.accuracy import plates, whole_takes
from tests.accuracy.people import BODY26, GAIT15, MCGILL, everyone
from tests.core.papers.virtual_occlusions.stages import fit_nine, stages
from tests.core.scenes import RATE, act, built_in, stand

COLUMNS = ("what", "NumPy", "compiled", "times as fast", "floor", "aim")
FRAMES = 1500  # of the long take of points
WALKS = 8  # one after the other, 1,920 frames
ROOM = CaptureOptions(noise=0.3, reflections=1, flicker=0.1)
WALK = (Act(0.3), Act(1.4, stride=0.9), Act(1.2, stride=0.5, turn=np.pi), Act(1.1, stride=0.9))
Row = tuple[str, str, str, str, Callable[[], object], float, int]


def start_of(bodies: Bodies, model: BodyModel) -> Bodies:
    """A rest body off by 15°, 0.15 m of height and 0.12 m from the person."""
    ahead = model.pose(bodies).rotations[0, 0, :, 0]
    start = model.rest(1, float(bodies.scale.mean()) - 0.15)
    facing = rotations.about_z([np.arctan2(ahead[1], ahead[0]) + np.radians(15)])
    return replace(start, quaternion=facing, translation=bodies.translation * [1, 1, 0] + [0.1, -0.06, 0.02])


def initialise(view: View, setup: Setup) -> Bodies:
    """From blobs to the starts of the fit: the paper's step I without the height and facing that it is given."""
    return first_starts(view, build_cloud(view, setup.sight), setup, Hints())


def fits(_: Path | None) -> Iterator[Row]:
    """The paper's three steps one by one, and one frame from nothing."""
    for name, fit_floor, fit_aim, floor, aim in (
        ("gait15", "0.4 ms", "0.2 ms", "20 ms", "10 ms"),
        ("body26", "0.6 ms", "0.3 ms", "25 ms", "16 ms"),
    ):
        scene = stand(built_in(name), paper_rig(), seed=3, facing=0.7, options=ROOM)
        setup, view = Setup.of(scene.cameras, scene.markerset), scene.views()[0]
        found, where = find_subject(view, setup, Hints()), f"`{name}`, 4 cameras"
        fit = partial(fit_nine, view, start_of(scene.bodies, setup.model), setup, stages(10))
        labelling = partial(name_blobs, view, found.expected, found.subject, setup)
        yield (
            f"step I, cloud, centre, height, facings, {where}",
            "ms",
            "",
            "",
            partial(initialise, view, setup),
            0.001,
            30,
        )
        yield f"10 iterations of the nine-parameter fit, {where}", "ms", fit_floor, fit_aim, fit, 0.001, 100
        yield f"step III, algorithm 1, {where}", "ms", "", "", labelling, 0.001, 100
        whole = partial(find_subject, view, setup, Hints())
        yield f"one frame, no hints, {where}", "ms", floor, aim, whole, 0.001, 15


def following(_: Path | None) -> Iterator[Row]:
    """Walks of half a minute, finding the person included; with rays cast at meshes where there is Blender."""
    for name, floor, aim in (("body26", "700 fps", "1,100 fps"), ("body39", "500 fps", "800 fps")):
        rig = ring_rig(8, radius=4.5, volume_radius=1.3)
        scene = act(built_in(name), rig, WALK * WALKS, seed=3, options=ROOM)
        frames = len(scene.blobs.frames)
        job = partial(_drained, scene.blobs, rig, scene.markerset)
        title = f"following a walk of {frames:,} frames, search included, `{name}`, 8 cameras"
        yield title, "fps", floor, aim, job, frames, 3
    try:
        from addon.scene.occlusion import capsule_meshes
    except ImportError:
        return
    rig = ring_rig(8, radius=4.5, volume_radius=1.3)
    scene = act(built_in("body26"), rig, WALK, seed=3, options=ROOM)
    job = partial(_drained, scene.blobs, rig, scene.markerset, capsule_meshes(scene.markerset))
    yield "the same, `body26`, rays cast at meshes", "fps", "100 fps", "250 fps", job, len(scene.blobs.frames), 3


def _drained(blobs, rig, markerset, occlusion=None) -> int:
    return sum(len(chunk.labels.marker) for chunk in label_take([blobs], rig, markerset, RATE, occlusion=occlusion))


def points(models: Path | None) -> Iterator[Row]:
    """Whole takes of people left out, cut to pieces, markers hidden and ghosts among them."""
    if not whole_takes.PEOPLE.exists():
        return
    cases = (
        (next(whole_takes.case_few("gait15", GAIT15, False)), 3, "2,000 fps", "5,000 fps"),
        (next(whole_takes.case_few("body26", BODY26, False)), 3, "1,200 fps", "2,500 fps"),
        (next(whole_takes.case_others()), 1, "", ""),
    )
    for case, count, floor, aim in cases:
        model = whole_takes.model_of(case, models)
        tested = [take.part(0, FRAMES) for take in case.tested[:count]]
        takes = [whole_takes.anonymous(take, case, seed)[0] for seed, take in enumerate(tested)]
        frames = sum(len(take.xyz) for take in takes)
        title = f"points, {len(case.markers)} markers, takes of {frames} frames in all"
        yield title, "fps", floor, aim, partial(_labelled, takes, model), frames, 3
    model, take = plates.trained([plates.TRAINED]), read_points(plates.TESTED)
    xyz, _ = plates.cut_up(take.xyz, *plates.CUTS[1], np.random.default_rng(plates.SEED))
    residual = np.where(np.isfinite(xyz[..., 0]), 0.0005, np.nan)
    cut = Points(("",) * xyz.shape[1], xyz, residual, take.rate, 1)
    title = f"points, 62 markers on plates, a take of {len(xyz)} frames"
    yield title, "fps", "350 fps", "600 fps", partial(_labelled, [cut], model), len(xyz), 3


def _labelled(takes: list[Points], model):
    for take in takes:
        finished(label_points(take, model, PointOptions(chosen_method(model, "auto"), USUAL_TARGET)))


def training(_: Path | None) -> Iterator[Row]:
    """Models and their calibration, as `train` makes them in one process: of ten people, of three, of one on plates."""
    if not whole_takes.PEOPLE.exists():
        return
    paths = [(person, path) for person in everyone() for path in sorted((MCGILL / person).glob("*.c3d"))]
    worn = [take for person, path in paths if set(GAIT15) <= set((take := whole_takes.read(path, person)).markers)]
    case, file = next(whole_takes.case_others()), read_points(plates.TRAINED)
    plated = whole_takes.Take("clouthier", plates.TRAINED.name, file.names, file.xyz, file.rate)
    for takes, markers, whose, floor, aim in (
        ([take.of(GAIT15) for take in worn], GAIT15, "ten people", "10 s", "5 s"),
        (case.training, case.markers, "three people", "25 s", "12 s"),
        ([plated], plated.markers, "one subject on plates", "20 s", "10 s"),
    ):
        title = f"training {len(markers)} markers, {sum(len(take.xyz) for take in takes)} frames of {whose}"
        yield title, "s", floor, aim, partial(_trained, takes, markers), 1.0, 1


def _trained(takes: Sequence[whole_takes.Take], markers: Sequence[str]):
    labelled = [LabelledTake(take.name, take.subject, take.markers, take.xyz) for take in takes]
    bodies = [open_markerset(name) for name in builtin_markersets()]
    finished(train(labelled, markers, TrainingOptions("measured"), None, bodies))


def _processor_seconds(job: Callable[[], object]) -> float:
    begin = process_time()
    job()
    return process_time() - begin


RUNS = {"fit": fits, "follow": following, "points": points, "train": training}


def measured(names: list[str], models: Path | None):
    """Prints one line of JSON for each row, of this process's way to work."""
    with threadpool_limits(1, user_api="blas"):
        for title, unit, floor, aim, job, per, repeats in chain.from_iterable(RUNS[name](models) for name in names):
            if repeats > 1:
                job()
            seconds = np.median([_processor_seconds(job) for _ in range(repeats)])
            figure = per / seconds if unit == "fps" else seconds / per
            print(json.dumps([title, unit, figure, floor, aim]), flush=True)


def rows_by(numpy: bool, names: list[str], models: str) -> list[list]:
    """The rows that this command prints in a process of its own."""
    again = [sys.executable, "-m", "tests.benchmarks.kernels", "--one-way", "--only", *names, "--models", models]
    way = os.environ | {SWITCH: str(int(numpy))}
    done = subprocess.run(again, check=True, stdout=subprocess.PIPE, text=True, env=way)
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]


def main() -> int:
    """Measures both ways, one process each."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.kernels", description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=list(RUNS), default=list(RUNS), help="these measurements alone")
    parser.add_argument("--models", type=Path, help="folder that models are kept in")
    parser.add_argument("--one-way", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one_way:
        measured(given.only, given.models)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        ways = [rows_by(numpy, given.only, str(given.models or folder)) for numpy in (True, False)]
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    print(f"Python {platform.python_version()}, NumPy {np.__version__}, {os.cpu_count()} cores{load}, ", end="")
    print("processor time of one core, medians\n")
    print(f"| {' | '.join(COLUMNS)} |\n| --- | {' | '.join(['---:'] * (len(COLUMNS) - 1))} |")
    for (title, unit, numpy, floor, aim), (_, _, compiled, _, _) in zip(*ways, strict=True):
        gain = compiled / numpy if unit == "fps" else numpy / compiled
        cells = title, _shown(numpy, unit), _shown(compiled, unit), f"{gain:.1f}", floor, aim
        print(f"| {' | '.join(cells)} |")
    return 0


def _shown(figure: float, unit: str) -> str:
    return f"{figure:,.2f} {unit}" if unit == "ms" else f"{figure:,.0f} {unit}"


if __name__ == "__main__":
    sys.exit(main())
