# SPDX-License-Identifier: GPL-3.0-or-later
"""A capture to be labelled, and the score of a labelling over many of them."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from addon.core.data.takes import Blobs
from addon.core.evaluation.figures import Counts, Figures
from addon.core.geometry.cameras import Cameras

# Blobs of one take and its cameras in; out: for every blob the marker's name or "", and the step that named it.
LabelFunction = Callable[[Blobs, Cameras], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Trial:
    """One take to be labelled: blobs with their true names, and what the labelling is not told.

    title    says which capture it is, for people to read
    person   who it is
    xyz      (T, M, 3) m where the markers were
    facing   rad, the way the person faces in the first frame
    stature  m
    hidden   (C, M) which markers the real body hid in the first frame
    """

    title: str
    person: str
    cameras: Cameras
    blobs: Blobs
    truth: np.ndarray
    xyz: np.ndarray
    facing: float
    stature: float
    rate: float
    hidden: np.ndarray


class Score:
    """Adds up trials: the contract's figures, and the takes in which a blob is not right."""

    def __init__(self, markers):
        self.figures = Figures(markers)
        self.takes = self.blobs = 0
        self.flawed: list[tuple[str, list[tuple[str, str]]]] = []
        self._frames = 0

    def add(self, trials: Iterable[Trial], label: LabelFunction) -> "Score":
        """Labels every trial and counts. Returns itself."""
        for trial in trials:
            self.count(trial, *label(trial.blobs, trial.cameras))
        return self

    def count(self, trial: Trial, names: np.ndarray, steps: np.ndarray):
        """Counts one labelled trial: the marker's name and the step of every blob."""
        self.figures.add(trial.blobs.frame + self._frames, trial.blobs.camera, names, trial.truth, steps)
        self._frames += len(trial.blobs.frames)
        self.takes += 1
        self.blobs += len(trial.blobs)
        errors = [(str(n), t) for n, t in zip(names, trial.truth, strict=True) if n not in t.split("|")]
        if errors:
            self.flawed.append((trial.title, errors))

    @property
    def counts(self) -> Counts:
        """Over all trials so far."""
        return self.figures.total
