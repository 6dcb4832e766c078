# SPDX-License-Identifier: GPL-3.0-or-later
"""Naming clouds by our own method and counting what came of it, for measurements of more than one marker set."""

from dataclasses import dataclass

import numpy as np

from addon.core.blobs.pipeline import Options
from addon.core.data.models import Model
from addon.core.points.likelihood import Likelihood, label_frames
from addon.core.points.tracklets import cut
from addon.jobs.naming import Decided, NamedFrames, consistent, decide, joined, name_frames
from addon.jobs.wearer import Wearer, checked, find_wearer

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

    def line(self) -> str:
        """The figures, false occlusions over all markers declared occluded."""
        right = self.given - self.wrong
        missed = (self.there - right) / max(self.places - self.given, 1)
        return (
            f"FA {100 * self.wrong / max(self.given, 1):.3f} %  FO {100 * missed:.2f} %  "
            f"recall {right / max(self.there, 1):.4f}  F1 {2 * right / max(self.given + self.there, 1):.4f}"
        )


def named(likelihood: Likelihood, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Markers and rates (F, P) of all frames."""
    chunks = list(label_frames(likelihood, points))
    return np.concatenate([chunk.marker for chunk in chunks]), np.concatenate([chunk.rate for chunk in chunks])


def labelled_as_product(model: Model, points: np.ndarray, rate: float) -> tuple[NamedFrames, Decided, Wearer]:
    """Trajectories (T, P, 3) m by frames alone, by the steps of the job that labels takes, and who was found there."""
    tracklet = cut(points, rate)
    wearer = find_wearer(model, "evidence", points, tracklet, rate)
    model = wearer.model
    named = joined(list(name_frames(model, "evidence", points, rate, Options())))
    decided = decide(named, tracklet, model, TARGET, 0)
    decided = consistent(decided, points, model.markerset.likelihood, 0)
    return named, checked(decided, wearer, 0), wearer
