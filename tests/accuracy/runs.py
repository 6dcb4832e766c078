# SPDX-License-Identifier: GPL-3.0-or-later
"""The measurements behind the figures: each prints one table, with its counts and its seed."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from addon.core.body.bodies import Bodies, BodyModel
from addon.core.body.occlusion import CapsuleOcclusion
from addon.core.geometry import rotations
from addon.core.points.fitted_body import NothingInTheWay
from addon.core.simulation.simulate import CaptureOptions

from .captures import Score, Trial
from .models import Labeller, left_out_model
from .standing import standing
from .tables import SCORE_COLUMNS, score_cells, share, table

CLEAN = CaptureOptions(reflections=0, flicker=0.0)
# The paper's tolerance: how far a start may be off.
OFF_TURN, OFF_HEIGHT, OFF_PLACE = np.radians(20), 0.25, 0.2
# A fit has converged when its markers are this near to the real ones on average: less than half of what parts rivals.
CONVERGED = 0.05


@dataclass(frozen=True)
class Plan:
    """How much is measured.

    sets   marker sets
    folds  groups of left-out people, one model each
    count  standing captures a group
    seed   of everything random
    show   how many flawed takes are listed
    """

    sets: tuple[str, ...]
    folds: tuple[tuple[str, ...], ...]
    count: int
    seed: int
    show: int = 0

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
    """Single standing frames with no hints, in the paper's rig, with and without ghosts."""
    rows, steps, swaps = [], [], []
    for set_name in plan.sets:
        for ghosts, options in (("none", CLEAN), ("2 fixed, 0.2 flicker a camera", CaptureOptions())):
            score, labellers = measured(
                plan,
                set_name,
                lambda markers, persons, count, seed, o=options: standing(markers, persons, count, seed, o),
                plan.count,
            )
            rows.append([set_name, ghosts, *score_cells(score.counts), f"{milliseconds(labellers):.0f} ms"])
            figures = score.figures.as_dict()
            steps += [
                [set_name, ghosts, name, share(step["right"], step["labels"], 3)]
                for name, step in figures["steps"].items()
            ]
            swaps += [[set_name, ghosts, "/".join(swap["markers"]), swap["count"]] for swap in figures["swaps"][:5]]
            show(plan, score)
    print(f"\n### One standing frame, no hints, paper's rig ({plan.people()})\n")
    print(table(("set", "ghosts", *SCORE_COLUMNS, "time a frame"), rows))
    print("\n" + table(("set", "ghosts", "step", "labels right"), steps))
    print("\n" + table(("set", "ghosts", "swapped", "times"), swaps))


def run_starts(plan: Plan):
    """The paper's tolerance: starts off by up to ±20°, ±0.25 m of height and ±0.2 m at once, and facing anywhere."""
    rows = []
    for set_name in plan.sets:
        for name, turn in (("within the paper's box", OFF_TURN), ("the same, but facing ±180°", np.pi)):
            good = total = 0
            for fold in plan.folds:
                markerset = left_out_model(set_name, fold)
                generator = np.random.default_rng([plan.seed, 7])
                for trial in standing(markerset.markers, fold, plan.count, plan.seed, CLEAN):
                    start = shaken(best_placed(markerset, trial.xyz[0]), turn, generator)
                    good += converges(markerset, trial, start)
                    total += 1
            rows.append([set_name, name, share(good, total)])
    print(f"\n### Starts that are off: the fit ends within {CONVERGED * 1000:.0f} mm on average ({plan.people()})\n")
    print(table(("set", "start", "converged"), rows))


def converges(markerset, trial: Trial, start: Bodies) -> bool:
    """Whether the paper's fit ends at the person."""
    from addon.core.blobs.subject import Setup
    from addon.core.geometry.views import split_views
    from tests.core.blobs.paper import fit_from

    setup = Setup.of(trial.cameras, markerset)
    fit = fit_from(split_views(trial.blobs, trial.cameras)[0], start, setup)
    apart = np.linalg.norm(setup.model.pose(fit.bodies).markers[0] - trial.xyz[0], axis=-1)
    return bool(np.nanmean(apart) < CONVERGED)


def best_placed(markerset, points: np.ndarray) -> Bodies:
    """The rest body turned about the vertical, sized and placed to lie best on points (M, 3) m: the ideal start."""
    seen = np.isfinite(points[:, 0])
    rest, real = markerset.rest_markers[seen], points[seen]
    from_middle, off = rest - rest.mean(axis=0), real - real.mean(axis=0)
    yaw = np.arctan2(
        (from_middle[:, 0] * off[:, 1] - from_middle[:, 1] * off[:, 0]).sum(),
        (from_middle[:, :2] * off[:, :2]).sum(),
    )
    height = np.ptp(real[:, 2]) / np.ptp(rest[:, 2])
    bodies = BodyModel(markerset).rest(1, height)
    quaternion = rotations.about_z(np.array([yaw]))
    turned = rest * height @ rotations.quaternion_to_matrix(quaternion)[0].T
    return replace(bodies, quaternion=quaternion, translation=(real - turned).mean(axis=0)[None])


def shaken(bodies: Bodies, turn: float, generator: np.random.Generator) -> Bodies:
    """A start somewhere in the paper's box around `bodies`, with `turn` rad for its ±20°."""
    yaw = generator.uniform(-turn, turn, 1)
    place = generator.uniform(-1, 1, (1, 3))
    return replace(
        bodies,
        quaternion=rotations.turned(bodies.quaternion, np.stack([0 * yaw, 0 * yaw, yaw], axis=1)),
        scale=bodies.scale + generator.uniform(-OFF_HEIGHT, OFF_HEIGHT),
        translation=bodies.translation + OFF_PLACE * place / np.maximum(np.linalg.norm(place), 1),
    )


def run_occlusion(plan: Plan):
    """How often the model's body is wrong about what is hidden, for bodies of full size and shrunk."""
    from addon.core.body.posing import fit_points

    rows = []
    for set_name in plan.sets:
        counts = {shrink: np.zeros(4, dtype=int) for shrink in (1.0, 0.9, 0.8, 0.7, 0.5)}
        for fold in plan.folds:
            markerset = left_out_model(set_name, fold)
            model = BodyModel(markerset)
            trials = list(standing(markerset.markers, fold, plan.count, plan.seed, CLEAN))
            bodies = [fit_points(model, trial.xyz) for trial in trials]
            for shrink, count in counts.items():
                occlusion = CapsuleOcclusion(markerset, shrink)
                for trial, body in zip(trials, bodies, strict=True):
                    posed = model.pose(body)
                    found = occlusion.hidden(
                        posed.rotations, posed.joints, body.scale, posed.markers, trial.cameras.centres
                    )
                    truth, guess = trial.hidden, found[0]
                    count += [(truth & ~guess).sum(), truth.sum(), (~truth & guess).sum(), (~truth).sum()]
        rows += [[set_name, shrink, share(*count[:2]), share(*count[2:])] for shrink, count in counts.items()]
    print(f"\n### Virtual occlusion against the real body ({plan.people()})\n")
    print(table(("set", "capsules' radius ×", "hidden, believed visible", "visible, believed hidden"), rows))


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
    from addon.core.body.cost import blob_pull
    from addon.core.body.fit import fit_placement
    from addon.core.geometry.views import split_views

    rows = []
    for set_name in plan.sets:
        markerset = left_out_model(set_name, plan.folds[0])
        generator = np.random.default_rng([plan.seed, 9])
        times = []
        for trial in standing(markerset.markers, plan.folds[0], plan.count, plan.seed):
            setup = Setup.of(trial.cameras, markerset)
            view = split_views(trial.blobs, trial.cameras)[0]
            bodies = shaken(best_placed(markerset, trial.xyz[0]), OFF_TURN, generator)
            begin = perf_counter()
            for softness, reach in ((0.12, 0.5), (0.06, 0.25)):
                visible = setup.visible(bodies.scale, setup.model.pose(bodies))
                bodies = fit_placement(
                    setup.model,
                    bodies,
                    lambda m, v=visible, w=view, u=setup, s=softness, r=reach: blob_pull(m, v, w, u.sight, s, r),
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
