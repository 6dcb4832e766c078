# SPDX-License-Identifier: GPL-3.0-or-later
"""The measurements behind the figures: each prints one table, with its counts and its seed."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from addon.blendfile import has_blender, mesh_occlusion
from addon.core.body.bodies import BodyModel
from addon.core.data.markersets import MarkerSet
from addon.core.papers.virtual_occlusions.occlusion import OCCLUDING, CapsuleOcclusion, Occlusion
from addon.core.points.fitted_body import NothingInTheWay
from addon.core.simulation.simulate import CaptureOptions

from .captures import Score, Trial
from .models import Labeller, left_out_model
from .standing import standing
from .starts import Start, best_placed
from .tables import SCORE_COLUMNS, score_cells, share, table

CLEAN = CaptureOptions(reflections=0, flicker=0.0)
STANDING = {
    "no ghosts": CLEAN,
    "2 ghosts fixed, 0.2 flicker a camera": CaptureOptions(),
    "the same, blobs off by 1.5 px": CaptureOptions(noise=1.5),
}
MOST_NOT_RIGHT = 4  # markers in a frame; more are counted together
MOST_MARKERS = 8  # that are listed


@dataclass(frozen=True)
class Plan:
    """How much is measured.

    sets   marker sets
    folds  groups of left-out people, one model each
    count  standing captures a group
    seed   of everything random
    show   how many flawed takes are listed
    plots  the folder for pictures, None for none
    """

    sets: tuple[str, ...]
    folds: tuple[tuple[str, ...], ...]
    count: int
    seed: int
    show: int = 0
    plots: Path | None = None

    def people(self) -> str:
        """Who is tested, for a table's caption."""
        return f"{sum(map(len, self.folds))} left-out people, seed {self.seed}"


TrialsOf = Callable[[tuple[str, ...], tuple[str, ...], int, int], Iterator[Trial]]


def measured(plan: Plan, set_name: str, trials_of: TrialsOf, count: int, rate: float = 100.0, occlusion=None):
    """Score and labellers of `count` trials a fold; `trials_of(markers, people, count, seed)` makes them."""
    score, labellers = None, []
    for fold in plan.folds:
        markerset = left_out_model(set_name, fold)
        score = score or Score(markerset.markers)
        labellers.append(Labeller(markerset, rate, occlusion=occlusion))
        score.add(trials_of(markerset.markers, fold, count, plan.seed), labellers[-1])
    return score, labellers


def milliseconds(labellers: list[Labeller]) -> float:
    """A frame's labelling, all stages."""
    return 1000 * sum(sum(one.seconds.values()) for one in labellers) / max(sum(one.frames for one in labellers), 1)


def run_standing(plan: Plan):
    """A24, A28: single standing frames with no hints, in the paper's rig: without ghosts, with, and blurred."""
    rows, steps, frames, markers = [], [], [], []
    for set_name in plan.sets:
        for title, options in STANDING.items():
            score, labellers = measured(
                plan,
                set_name,
                lambda markers, persons, count, seed, o=options: standing(markers, persons, count, seed, o),
                plan.count,
            )
            rows.append([set_name, title, *score_cells(score.counts), f"{milliseconds(labellers):.0f} ms"])
            figures = score.figures.as_dict()
            steps += [
                [set_name, title, name, share(step["right"], step["labels"], 3)]
                for name, step in figures["steps"].items()
            ]
            frames.append([set_name, title, *_by_frame(score)])
            markers += [[set_name, title, *row] for row in _by_marker(score)]
            show(plan, score)
    print(f"\n### One standing frame, no hints, paper's rig ({plan.people()})\n")
    print(table(("set", "capture", *SCORE_COLUMNS, "time a frame"), rows))
    print("\n" + table(("set", "capture", "step", "labels right"), steps))
    many = [f"{count} not" for count in range(1, MOST_NOT_RIGHT)] + [f"{MOST_NOT_RIGHT} or more not"]
    print("\n" + table(("set", "capture", "frames", "all markers right that are seen", *many), frames))
    names = ("its blobs", "of them right", "unnamed", "named otherwise", "as", "its name on ghosts and others")
    print("\n" + table(("set", "capture", "marker", *names), markers))


def _by_frame(score: Score) -> list[int]:
    """Single frames, and those in which no, one, two … markers have a blob or a name that is not right."""
    known = set(score.figures.markers or ())
    counts = [0] * (MOST_NOT_RIGHT + 1)
    for _, errors in score.flawed:
        wrong = known & {name for given, truth in errors for name in (given, *truth.split("|"))}
        counts[min(len(wrong), MOST_NOT_RIGHT)] += 1
    return [score.takes, score.takes - len(score.flawed), *counts[1:]]


def _by_marker(score: Score) -> list[list]:
    """Of each marker with an error, the worst first: its blobs, and what became of them."""
    rows = []
    for marker in score.figures.markers or ():
        counts = score.figures.marker(marker)
        names = Counter(
            given for _, errors in score.flawed for given, truth in errors if marker in truth.split("|") and given
        )
        elsewhere = counts.given - counts.right
        if counts.found < counts.present or elsewhere:
            others = names.total()
            kinds = ", ".join(f"{name} {count}" for name, count in names.most_common())
            missed = counts.present - counts.found - others
            rows.append([marker, counts.present, counts.found, missed, others, kinds, elsewhere])
    return sorted(rows, key=lambda row: row[2] - row[1] - row[-1])[:MOST_MARKERS]


def run_occlusion(plan: Plan):
    """How often the model's body is wrong about what is hidden: of full size and shrunk, and of meshes."""
    from addon.core.posing.posing import fit_points

    rows = []
    for set_name in plan.sets:
        counts: dict[str, np.ndarray] = {}
        for fold in plan.folds:
            markerset = left_out_model(set_name, fold)
            model = BodyModel(markerset)
            trials = list(standing(markerset.markers, fold, plan.count, plan.seed, CLEAN))
            bodies = [fit_points(model, trial.xyz) for trial in trials]
            for title, occlusion in bodies_in_the_way(markerset).items():
                count = counts.setdefault(title, np.zeros(4, dtype=int))
                for trial, body in zip(trials, bodies, strict=True):
                    posed = model.pose(body)
                    found = occlusion.hidden(
                        posed.rotations, posed.joints, body.scale, posed.markers, trial.cameras.centres
                    )
                    truth, guess = trial.hidden, found[0]
                    count += [(truth & ~guess).sum(), truth.sum(), (~truth & guess).sum(), (~truth).sum()]
        rows += [[set_name, title, share(*count[:2]), share(*count[2:])] for title, count in counts.items()]
    print(f"\n### Virtual occlusion against the real body ({plan.people()})\n")
    print(table(("set", "body in the way", "hidden, believed visible", "visible, believed hidden"), rows))


def bodies_in_the_way(markerset: MarkerSet) -> dict[str, Occlusion]:
    """Capsules of full size and shrunk, and the meshes of two bodies, shrunk as they are used, where bpy is."""
    found: dict[str, Occlusion] = {}
    for shrink in (1.0, 0.9, 0.8, 0.7, 0.5):
        found[f"capsules, radius × {shrink}"] = CapsuleOcclusion(markerset, shrink)
    if has_blender():
        found[f"meshes of the capsules, radius × {OCCLUDING.fitted_shrink}"] = mesh_occlusion(markerset)
        from .characters import character_occlusion

        found[f"a character's own mesh, thickness × {OCCLUDING.fitted_shrink}"] = character_occlusion(markerset)
    return found


def sweeps() -> dict[str, list[tuple[str, CaptureOptions, int | None]]]:
    """What is turned up: by name, the settings as (value, capture, cameras)."""
    some = CaptureOptions()
    return {
        "cameras": [(str(n), some, n) for n in range(2, 13)],
        "noise, px": [(f"{n:g}", replace(some, noise=n), None) for n in (0.0, 0.5, 1.0, 1.5, 2.0)],
        "fixed ghosts a camera": [(str(n), replace(some, reflections=n), None) for n in range(6)],
        "markers off by up to, mm": [
            (str(n), replace(some, marker_offset=n / 1000), None) for n in (0, 10, 20, 30, 40)
        ],
        "cameras off by, mm (and 0.2 mrad for each)": [
            (str(n), replace(some, calibration_mm=n, calibration_mrad=0.2 * n), None) for n in range(6)
        ],
    }


def run_sweeps(plan: Plan):
    """Curves of standing frames: number of cameras (with and without the occlusion test), and what can be bad."""
    for title, settings in sweeps().items():
        rows = []
        for set_name in plan.sets:
            for value, options, cameras in settings:
                for tested, occlusion in (("yes", None), ("no", NothingInTheWay())):
                    if tested == "no" and title != "cameras":
                        continue
                    score, labellers = measured(
                        plan,
                        set_name,
                        lambda markers, persons, count, seed, o=options, c=cameras: standing(
                            markers, persons, count, seed, o, c
                        ),
                        plan.count,
                        occlusion=occlusion,
                    )
                    cells = score_cells(score.counts)
                    rows.append([set_name, value, tested, *cells, f"{milliseconds(labellers):.0f} ms"])
        print(f"\n### Standing frames against {title} ({plan.people()})\n")
        print(table(("set", title, "occlusion test", *SCORE_COLUMNS, "time a frame"), rows), flush=True)


def run_speed(plan: Plan):
    """Ten iterations of the nine-parameter fit with occlusion test, on one core."""
    from addon.core.blobs.subject import Setup
    from addon.core.geometry.views import split_views
    from addon.core.papers.virtual_occlusions.cost import BlobPull
    from addon.core.papers.virtual_occlusions.fit import fit_placement

    rows = []
    for set_name in plan.sets:
        markerset = left_out_model(set_name, plan.folds[0])
        generator = np.random.default_rng([plan.seed, 9])
        times = []
        for trial in standing(markerset.markers, plan.folds[0], plan.count, plan.seed):
            setup = Setup.of(trial.cameras, markerset)
            view = split_views(trial.blobs, trial.cameras)[0]
            bodies = Start("all together").off(best_placed(markerset, trial.xyz[0]), generator)
            begin = perf_counter()
            for softness, reach in ((0.12, 0.5), (0.06, 0.25)):
                visible = setup.visible(bodies.scale, setup.model.pose(bodies))
                bodies = fit_placement(
                    setup.model,
                    bodies,
                    BlobPull(visible, view, setup.sight, softness, reach),
                    5,
                ).bodies
            times.append(perf_counter() - begin)
        quick, middle, slow = np.percentile(np.array(times) * 1000, [5, 50, 95])
        rows.append([set_name, len(times), f"{middle:.2f} ms", f"{quick:.2f} to {slow:.2f} ms"])
    print("\n### Ten iterations of the nine-parameter fit, visibility renewed after five, one core\n")
    print(table(("set", "frames", "median", "5 to 95 %"), rows))


def show(plan: Plan, score: Score):
    """Lists flawed takes: (name given, truth) of blobs that are not right."""
    for title, errors in score.flawed[: plan.show]:
        print(f"- {title}: {len(errors)} not right: {errors[:6]}")
