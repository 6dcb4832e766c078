# SPDX-License-Identifier: GPL-3.0-or-later
"""Naming clouds by our own method and counting what came of it, for measurements of more than one marker set."""

from dataclasses import dataclass

import numpy as np

from addon.core.data.takes import Labels
from addon.core.points.adaptation import Adaptation, adapt, borne_out
from addon.core.points.deciding import decide
from addon.core.points.likelihood.frames import LikelihoodNamer, label_frames
from addon.core.points.likelihood.model import Likelihood
from addon.core.points.models import Model
from addon.core.points.tracklets import cut
from addon.core.points.whole_take.deciding import can_be_solved, labels_of, solution_of

SEED = 5
TARGET = 0.999  # the share of right labels that the product asks for


@dataclass
class Counts:
    """Labels given, wrong ones, markers that were there, and all places for markers."""

    given: int = 0
    wrong: int = 0
    there: int = 0
    places: int = 0

    def add(self, marker: np.ndarray, truth: np.ndarray, markers: int):
        """Counts frames' markers (F, P), -1 where unnamed, against the truth (F, P)."""
        self.given += int((marker >= 0).sum())
        self.wrong += int(((marker >= 0) & (marker != truth)).sum())
        self.there += int((truth >= 0).sum())
        self.places += markers * len(truth)

    @property
    def false_assignments(self) -> float:
        """Wrong labels over labels given."""
        return self.wrong / max(self.given, 1)

    @property
    def false_occlusions(self) -> float:
        """Markers that were there and are not rightly labelled, over all that are declared occluded."""
        return (self.there - self.given + self.wrong) / max(self.places - self.given, 1)

    def line(self) -> str:
        """The figures, false occlusions over all markers declared occluded."""
        right = self.given - self.wrong
        return (
            f"FA {100 * self.false_assignments:.3f} %  FO {100 * self.false_occlusions:.2f} %  "
            f"recall {right / max(self.there, 1):.4f}  F1 {2 * right / max(self.given + self.there, 1):.4f}"
        )


def named(likelihood: Likelihood, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Markers and rates (F, P) of all frames."""
    found = Labels.join(label_frames(likelihood, points))
    return found.marker, found.rate


def labelled_as_product(model: Model, points: np.ndarray, rate: float) -> tuple[Labels, Labels, Adaptation]:
    """Trajectories (T, P, 3) m by frames alone, by the steps of the pipeline of points, and who was found there."""
    tracklet = cut(points, rate)
    adaptation = adapt(model, points, tracklet, rate)
    model = adaptation.model
    named = Labels.join(LikelihoodNamer(model.likelihood).name(points, rate))
    if can_be_solved(model, tracklet):
        solution = solution_of(named, tracklet, points, model, rate)
        return named, labels_of(solution, named, TARGET, model.markerset.markers).labels, adaptation
    decided = decide(named, tracklet, model, TARGET, 0)
    return named, borne_out(decided, adaptation, 0).labels, adaptation
