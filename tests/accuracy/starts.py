# SPDX-License-Identifier: GPL-3.0-or-later
"""The first paper's minimisation from given starts: how far off they may be, and what each iteration brings."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

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

from .captures import Trial
from .models import left_out_model
from .standing import standing
from .tables import share, table

CLEAN = CaptureOptions(reflections=0, flicker=0.0)
# A fit has converged when its markers are this near to the real ones on average: less than half of what parts rivals.
CONVERGED = 0.05
TIMES = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # the paper's box, so many times as wide
LEAST_HEIGHT = 0.3  # m, of a start however wide the box is
EACH = 2  # starts of a kind in a frame
ITERATIONS = (0, 1, 2, 3, 5, 10, 20)
LABELLED = (5, 10)
SHADES = {"gait15": "#2b6ca3", "body26": "#c8423b"}


@dataclass(frozen=True)
class Off:
    """Half the widths of a box of starts: rotation about each axis, rad; height, m; place along each axis, m."""

    turn: float = 0.0
    height: float = 0.0
    place: float = 0.0

    def times(self, factor: float) -> "Off":
        """The box so many times as wide."""
        return Off(self.turn * factor, self.height * factor, self.place * factor)

    def drawn(self, corners: bool, generator: np.random.Generator) -> tuple[np.ndarray, float, np.ndarray]:
        """Rotation vector (3,), height and place (3,) from the box, evenly; or from its corners alone."""
        share = generator.uniform(-1, 1, 7)
        share = np.sign(share) if corners else share
        return self.turn * share[:3], self.height * float(share[3]), self.place * share[4:]


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
        """A start that is off from the ideal one."""
        turn, height, place = KINDS[self.kind].times(self.times).drawn(self.corners, generator)
        if self.anywhere:
            turn = np.array([0.0, 0.0, generator.uniform(-np.pi, np.pi)])
        return replace(
            ideal,
            quaternion=rotations.turned(ideal.quaternion, turn[None]),
            scale=np.maximum(ideal.scale + height, LEAST_HEIGHT),
            translation=ideal.translation + place,
        )

    @property
    def words(self) -> str:
        """What the start is off by, for a table."""
        box = KINDS[self.kind].times(self.times)
        turn = "facing anywhere" if self.anywhere else f"±{np.degrees(box.turn):.0f}° about each axis"
        parts = [turn] if box.turn else []
        parts += [f"±{box.height:g} m of height"] if box.height else []
        parts += [f"±{box.place:g} m along each axis"] if box.place else []
        return ("a corner of " if self.corners else "") + ", ".join(parts)


STARTS = (
    *(Start(kind, times) for kind in KINDS for times in TIMES),
    Start("all together", corners=True),
    Start("all together", anywhere=True),
)


def run_starts(plan):
    """A21: starts off in one parameter and in all, within the paper's box and beyond; how many converge."""
    counts = {(set_name, start): np.zeros(3, dtype=int) for set_name in plan.sets for start in STARTS}
    for set_name in plan.sets:
        for trial, setup, view, ideal, generator in _frames(plan, set_name, 7):
            each = [start for start in STARTS for _ in range(EACH)]
            bodies = Bodies.join([start.off(ideal, generator) for start in each])
            good = [_near(fit_from(view, bodies, setup, quarters), trial, setup) for quarters in (1, QUARTERS)]
            for start, once, turned in zip(each, *good, strict=True):
                counts[set_name, start] += [once, turned, 1]
    rows = [
        [set_name, start.kind, f"{start.times:g}", start.words, share(once, total), share(turned, total)]
        for (set_name, start), (once, turned, total) in counts.items()
    ]
    print(f"\n### Starts that are off: the fit ends within {CONVERGED * 1000:.0f} mm on average ({plan.people()})\n")
    names = ("set", "off", "times the paper's box", "drawn from", "converged", "tried in four quarter turns, the best")
    print(table(names, rows))
    if plan.plots:
        _draw_starts(counts, plan)


def _frames(plan, set_name: str, seed: int) -> Iterator[tuple[Trial, Setup, View, Bodies, np.random.Generator]]:
    """Standing frames of left-out people, what they are labelled with, and the ideal start."""
    for fold in plan.folds:
        markerset = left_out_model(set_name, fold)
        generator = np.random.default_rng([plan.seed, seed])
        for trial in standing(markerset.markers, fold, plan.count, plan.seed, CLEAN):
            setup = Setup.of(trial.cameras, markerset)
            view = split_views(trial.blobs, trial.cameras)[0]
            yield trial, setup, view, best_placed(markerset, trial.xyz[0]), generator


def _near(fit, trial: Trial, setup: Setup) -> np.ndarray:
    """(B,) whether each fit ended at the person."""
    off = np.linalg.norm(setup.model.pose(fit.bodies).markers - trial.xyz[0], axis=-1)
    return np.nanmean(off, axis=1) < CONVERGED


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


def run_iterations(plan):
    """A22: the cost after each iteration from starts in the paper's box, and the labels that follow."""
    traces, rows, after = {}, [], {}
    box = Start("all together")
    for set_name in plan.sets:
        costs, placed = [], {count: [] for count in ITERATIONS}
        found: dict[tuple[int, str], Figures] = {}
        for trial, setup, view, ideal, generator in _frames(plan, set_name, 11):
            starts = Bodies.join([box.off(ideal, generator) for _ in range(EACH)])
            costs.append(_trace(view, starts, setup, max(ITERATIONS)))
            for count in ITERATIONS:
                state = fit_nine(view, starts, setup, stages(count))
                off = np.linalg.norm(state.posed.markers - trial.xyz[0], axis=-1)
                placed[count] += list(np.nanmean(off, axis=1))
                for at in range(EACH):
                    for way, naming in _named(view, state.bodies.pick([at]), setup, count):
                        figures = found.setdefault((count, way), Figures(setup.model.markerset.markers))
                        _count(figures, trial, view, naming, setup)
        traces[set_name] = np.concatenate(costs, axis=1)
        after[set_name] = found
        for (count, way), figures in found.items():
            total = figures.total
            wrong = share(total.given - total.right, total.given, 2)
            recall = f"{100 * total.found / total.present:.2f} %"
            rows.append([set_name, count, f"{1000 * np.median(placed[count]):.0f} mm", way, wrong, recall])
    print(f"\n### What is left of the descent of the cost after each iteration, median ({plan.people()})\n")
    print(table(("set", "starts", *map(str, ITERATIONS)), [_left(traces[name], name) for name in plan.sets]))
    print(f"\n### Labels after few iterations, starts from the paper's box ({plan.people()})\n")
    names = ("set", "iterations", "markers off, median", "named", "wrong labels", "recall")
    print(table(names, rows))
    if plan.plots:
        _draw_iterations(traces, after, plan.plots)


def _left(trace: np.ndarray, set_name: str) -> list[str]:
    cost = np.median(_remaining(trace), axis=1)
    return [set_name, str(trace.shape[1]), *(f"{100 * cost[count]:.2f} %" for count in ITERATIONS)]


def _remaining(trace: np.ndarray) -> np.ndarray:
    """What each iteration of (steps + 1, B) costs leaves of the descent from the start to the end; it has no zero."""
    return (trace - trace[-1]) / (trace[0] - trace[-1])


def _trace(view: View, starts: Bodies, setup: Setup, steps: int) -> np.ndarray:
    """(steps + 1, B) cost of one stage of the nine-parameter fit: between two stages the cost is another one."""
    pull = visible_pull(starts, setup.model.pose(starts), view, setup, *PLACEMENT_STAGES[0][:2])
    return fit_placement(setup.model, starts, pull, steps, setup.prior).trace


AT_ONCE, WITH_ROUNDS = "at once", "in rounds, joints and shape fitted to the names"


def _named(view: View, bodies: Bodies, setup: Setup, count: int) -> Iterator[tuple[str, Naming]]:
    """The names that algorithm 1 gives to a body as it is, and, after the paper's five and ten, those of our rounds."""
    prior = Prior(setup.model, upright_sd=FINDING.upright_sd_rad)
    pull = visible_pull(bodies, setup.model.pose(bodies), view, setup, *PLACEMENT_STAGES[-1][:2])
    state: State = body_state(setup.model, bodies, pull, prior)
    subject = Subject(bodies, setup.marker_sd * float(bodies.scale.mean()), setup.rules.pixel)
    yield AT_ONCE, name(view, expect(subject, state, setup), subject, setup)
    if count in LABELLED:
        yield WITH_ROUNDS, name_found(view, state, setup, prior, 1.0, state.cost[None]).naming


def _count(figures: Figures, trial: Trial, view: View, naming: Naming, setup: Setup):
    names = np.full(len(trial.blobs), "", dtype=object)
    camera, marker = np.nonzero(naming.slot >= 0)
    markers = np.array(setup.model.markerset.markers, dtype=object)
    names[view.row[camera, naming.slot[camera, marker]]] = markers[marker]
    figures.add(trial.blobs.frame, trial.blobs.camera, names, trial.truth)


def _draw_starts(counts: dict, plan):
    from .plots import saved

    with saved(plan.plots / "blobs-starts.png", (1, len(plan.sets)), (10, 4)) as axes:
        for axis, set_name in zip(axes, plan.sets, strict=True):
            for kind, shade in zip(KINDS, ("#2b6ca3", "#2a9d8f", "#e0a030", "#c8423b"), strict=True):
                rates = np.array([counts[set_name, Start(kind, times)] for times in TIMES], dtype=float)
                axis.plot(TIMES, 100 * rates[:, 1] / rates[:, 2], "o-", color=shade, ms=4, label=kind)
                axis.plot(TIMES, 100 * rates[:, 0] / rates[:, 2], "--", color=shade, lw=1)
            axis.axvline(1, color="k", ls=":", lw=1)
            axis.set(title=f"{set_name} (dashed: without quarter turns)", ylim=(0, 102))
            axis.set(xlabel="times the paper's ±20°, ±0.25 m, ±0.2 m", ylabel="converged, %")
            axis.legend(fontsize=8)


def _draw_iterations(traces: dict, after: dict, folder: Path):
    from .plots import saved

    with saved(folder / "blobs-iterations.png", (1, 2), (10, 4)) as (cost, labels):
        for set_name, trace in traces.items():
            shade, part = SHADES.get(set_name, "k"), 100 * _remaining(trace)
            cost.plot(np.median(part, axis=1), "o-", color=shade, ms=3, label=f"{set_name}, median")
            cost.fill_between(range(len(part)), *np.percentile(part, (5, 95), axis=1), color=shade, alpha=0.15, lw=0)
            totals = [after[set_name][count, AT_ONCE].total for count in ITERATIONS]
            recall = [100 * total.found / total.present for total in totals]
            wrong = [100 * (total.given - total.right) / max(total.given, 1) for total in totals]
            labels.plot(ITERATIONS, recall, "o-", color=shade, ms=4, label=f"{set_name}, recall")
            labels.plot(ITERATIONS, wrong, "s--", color=shade, ms=4, label=f"{set_name}, wrong of those given")
        cost.set(xlabel="iteration", ylabel="left of the descent, % (band: 5 to 95 % of starts)", ylim=(-2, 102))
        labels.set(xlabel="iterations", ylabel="labels at once, %", ylim=(0, 102))
        for axis in (cost, labels):
            axis.legend(fontsize=8)
