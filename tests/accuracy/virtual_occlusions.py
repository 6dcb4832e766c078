# SPDX-License-Identifier: GPL-3.0-or-later
"""The first paper's own figures on standing people whom the tested models have never seen, as Markdown tables.

python -m tests.accuracy.virtual_occlusions                    starts, iterations, standing: hours
python -m tests.accuracy.virtual_occlusions starts --count 10 | python scripts/results.py --take starts

Starts: how far off those of the minimisation may be. Iterations: what each of them brings. Standing: which markers are
right in a frame. What is measured take by take is in the cases of `registry.py`.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from addon.core.blobs.search import FINDING, name_found, visible_pull
from addon.core.blobs.subject import Setup, Subject, expect, name
from addon.core.body.bodies import Bodies, BodyModel
from addon.core.body.prior import Prior
from addon.core.evaluation.figures import Figures
from addon.core.geometry import rotations
from addon.core.geometry.views import View, split_views
from addon.core.papers.virtual_occlusions.fit import State, body_state, fit_placement
from addon.core.papers.virtual_occlusions.labelling import Naming
from addon.core.simulation.simulate import CaptureOptions
from tests.core.papers.virtual_occlusions.stages import PLACEMENT_STAGES, QUARTERS, fit_from, fit_nine, stages

from . import people
from .captures import Trial
from .models import labelled, left_out_model
from .standing import standing
from .tables import share, table

SETS = ("gait15", "body26")
SEED = 1
CLEAN = CaptureOptions(reflections=0, flicker=0.0)
STANDING = {"no ghosts": CLEAN, "ghosts": CaptureOptions(), "ghosts, blobs off by 1.5 px": CaptureOptions(noise=1.5)}
MOST_NOT_RIGHT = 4  # markers in a frame; more are counted together
# A fit has converged when its markers are this near to the real ones on average: less than half of what parts rivals.
CONVERGED = 0.05
TIMES = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # the paper's box, so many times as wide
LEAST_HEIGHT = 0.3  # m, of a start however wide the box is
EACH = 2  # starts of a kind in a frame
ITERATIONS = (0, 1, 2, 3, 5, 10, 20)
LABELLED = (5, 10)


def standing_people(set_name: str, count: int, options: CaptureOptions) -> Iterator[tuple[Trial, Setup]]:
    """So many captures of each group of left-out people, and what they are labelled with."""
    for fold in people.folds():
        markerset = left_out_model(set_name, fold)
        for trial in standing(markerset.markers, fold, count, SEED, options):
            yield trial, Setup.of(trial.cameras, markerset)


def standing_tables(count: int) -> Iterator[str]:
    """A24: frames by the markers that are not right."""
    frames = []
    for set_name in SETS:
        for title, options in STANDING.items():
            not_right = Counter()
            for trial, setup in standing_people(set_name, count, options):
                names, markers = labelled(setup.model.markerset, trial), set(setup.model.markerset.markers)
                pairs = [(given, true.split("|")) for given, true in zip(names, trial.truth, strict=True)]
                wrong = {one for given, true in pairs if given not in true for one in (given, *true)}
                not_right[min(len(markers & wrong), MOST_NOT_RIGHT)] += 1
            frames.append([f"`{set_name}`", title, *(not_right[many] for many in range(MOST_NOT_RIGHT + 1))])
    many = ["1 marker not", *(f"{number} not" for number in range(2, MOST_NOT_RIGHT)), f"{MOST_NOT_RIGHT} or more not"]
    yield table(("set", "capture", "all right", *many), frames)


@dataclass(frozen=True)
class Off:
    """Half the widths of a box of starts: rotation about each axis, rad; height, m; place along each axis, m."""

    turn: float = 0.0
    height: float = 0.0
    place: float = 0.0


BOX = Off(np.radians(20), 0.25, 0.2)
KINDS = {
    "rotation alone": Off(turn=BOX.turn),
    "height alone": Off(height=BOX.height),
    "place alone": Off(place=BOX.place),
    "all together": BOX,
}


@dataclass(frozen=True)
class Start:
    """A kind of starts: which parameters are off, in a box how many times as wide as the paper's, where in it."""

    kind: str
    times: float = 1.0
    corners: bool = False
    anywhere: bool = False

    def off(self, ideal: Bodies, generator: np.random.Generator) -> Bodies:
        """A start that is off from the ideal one, drawn evenly from the box or from its corners alone."""
        box, part = KINDS[self.kind], generator.uniform(-1, 1, 7)
        part = self.times * (np.sign(part) if self.corners else part)
        turn = box.turn * part[:3]
        if self.anywhere:
            turn = np.array([0.0, 0.0, generator.uniform(-np.pi, np.pi)])
        return replace(
            ideal,
            quaternion=rotations.turned(ideal.quaternion, turn[None]),
            scale=np.maximum(ideal.scale + box.height * float(part[3]), LEAST_HEIGHT),
            translation=ideal.translation + box.place * part[4:],
        )


STARTS = (
    *(Start(kind, times) for kind in KINDS for times in TIMES),
    Start("all together", corners=True),
    Start("all together", anywhere=True),
)


def starts_tables(count: int) -> Iterator[str]:
    """A21: starts off in one parameter and in all, within the paper's box and beyond; how many converge."""
    rows = []
    for set_name in SETS:
        counts, generator = {start: np.zeros(3, dtype=int) for start in STARTS}, np.random.default_rng([SEED, 7])
        for trial, setup in standing_people(set_name, count, CLEAN):
            view, ideal = _seen(trial, setup)
            each = [start for start in STARTS for _ in range(EACH)]
            bodies = Bodies.join([start.off(ideal, generator) for start in each])
            fits = (fit_from(view, bodies, setup, quarters).bodies for quarters in (1, QUARTERS))
            good = [_miss(setup.model.pose(fit).markers, trial) < CONVERGED for fit in fits]
            for start, once, turned in zip(each, *good, strict=True):
                counts[start] += [once, turned, 1]
        for start, (once, turned, total) in counts.items():
            where = "corners" if start.corners else "facing anywhere" if start.anywhere else "evenly"
            rows.append([set_name, start.kind, f"{start.times:g}", where, share(once, total), share(turned, total)])
    columns = ("set", "off", "times the paper's box", "drawn", "converged", "tried in four quarter turns, the best")
    yield table(columns, rows)


def _seen(trial: Trial, setup: Setup) -> tuple[View, Bodies]:
    return split_views(trial.blobs, trial.cameras)[0], best_placed(setup.model, trial.xyz[0])


def _miss(markers: np.ndarray, trial: Trial) -> np.ndarray:
    """(B,) m between markers (B, M, 3) and the real ones, on average."""
    return np.nanmean(np.linalg.norm(markers - trial.xyz[0], axis=-1), axis=1)


def best_placed(model: BodyModel, points: np.ndarray) -> Bodies:
    """The rest body turned about the vertical, sized and placed to lie best on points (M, 3) m: the ideal start."""
    seen = np.isfinite(points[:, 0])
    rest, real = model.markerset.rest_markers[seen], points[seen]
    from_middle, off = rest - rest.mean(axis=0), real - real.mean(axis=0)
    yaw = np.arctan2(
        (from_middle[:, 0] * off[:, 1] - from_middle[:, 1] * off[:, 0]).sum(),
        (from_middle[:, :2] * off[:, :2]).sum(),
    )
    height = np.ptp(real[:, 2]) / np.ptp(rest[:, 2])
    quaternion = rotations.about_z(np.array([yaw]))
    turned = rest * height @ rotations.quaternion_to_matrix(quaternion)[0].T
    return replace(model.rest(1, height), quaternion=quaternion, translation=(real - turned).mean(axis=0)[None])


def iterations_tables(count: int) -> Iterator[str]:
    """A22: the cost after each iteration from starts in the paper's box, and the labels that follow."""
    descents, rows, box = [], [], Start("all together")
    for set_name in SETS:
        costs, placed, generator = [], {steps: [] for steps in ITERATIONS}, np.random.default_rng([SEED, 11])
        found: dict[tuple[int, str], Figures] = {}
        for trial, setup in standing_people(set_name, count, CLEAN):
            view, ideal = _seen(trial, setup)
            starts = Bodies.join([box.off(ideal, generator) for _ in range(EACH)])
            # One stage of the fit: between two stages the cost is another one.
            pull = visible_pull(starts, setup.model.pose(starts), view, setup, *PLACEMENT_STAGES[0][:2])
            costs.append(fit_placement(setup.model, starts, pull, max(ITERATIONS), setup.prior).trace)
            for steps in ITERATIONS:
                state = fit_nine(view, starts, setup, stages(steps))
                placed[steps] += list(_miss(state.posed.markers, trial))
                for at in range(EACH):
                    for way, naming in _named(view, state.bodies.pick([at]), setup, steps):
                        figures = found.setdefault((steps, way), Figures(setup.model.markerset.markers))
                        _count(figures, trial, view, naming, setup)
        trace = np.concatenate(costs, axis=1)
        left = np.median((trace - trace[-1]) / (trace[0] - trace[-1]), axis=1)  # of the descent, which has no zero
        descents.append([set_name, trace.shape[1], *(f"{100 * left[steps]:.2f} %" for steps in ITERATIONS)])
        for (steps, way), figures in found.items():
            total = figures.total
            cells = share(total.given - total.right, total.given, 2), f"{100 * total.found / total.present:.2f} %"
            rows.append([set_name, steps, f"{1000 * np.median(placed[steps]):.0f} mm", way, *cells])
    yield table(("set", "starts", *map(str, ITERATIONS)), descents)
    yield table(("set", "iterations", "markers off, median", "named", "wrong labels", "recall"), rows)


def _named(view: View, bodies: Bodies, setup: Setup, steps: int) -> Iterator[tuple[str, Naming]]:
    """The names that algorithm 1 gives to a body as it is, and, after the paper's five and ten, those of our rounds."""
    prior = Prior(setup.model, upright_sd=FINDING.upright_sd_rad)
    pull = visible_pull(bodies, setup.model.pose(bodies), view, setup, *PLACEMENT_STAGES[-1][:2])
    state: State = body_state(setup.model, bodies, pull, prior)
    subject = Subject(bodies, setup.marker_sd * float(bodies.scale.mean()), setup.rules.pixel)
    yield "at once", name(view, expect(subject, state, setup), subject, setup)
    if steps in LABELLED:
        yield "in rounds", name_found(view, state, setup, prior, 1.0, state.cost[None]).naming


def _count(figures: Figures, trial: Trial, view: View, naming: Naming, setup: Setup):
    names = np.full(len(trial.blobs), "", dtype=object)
    camera, marker = np.nonzero(naming.slot >= 0)
    markers = np.array(setup.model.markerset.markers, dtype=object)
    names[view.row[camera, naming.slot[camera, marker]]] = markers[marker]
    figures.add(trial.blobs.frame, trial.blobs.camera, names, trial.truth)


RUNS = {"starts": starts_tables, "iterations": iterations_tables, "standing": standing_tables}


def main() -> int:
    """Prints what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("only", nargs="*", help=f"of {' '.join(RUNS)}; all unless said")
    parser.add_argument("--count", type=int, default=20, help="captures of each of the five groups of people")
    given = parser.parse_args()
    if not people.available():
        print("the recorded people are not here; expected them in ../shared/data/people", file=sys.stderr)
        return 1
    with threadpool_limits(1, user_api="blas"):
        for chosen in given.only or RUNS:
            for text in RUNS[chosen](given.count):
                print(f"\n{text}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
