# SPDX-License-Identifier: GPL-3.0-or-later
"""Turns recorded people into the captures that are labelled, and scores what a labelling makes of them."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from addon.core.cameras import Cameras
from addon.core.figures import Figures
from addon.core.takes import Blobs

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


@dataclass(frozen=True, eq=False)
class Outcome:
    """The figures over all trials, and the trials with a blob that is not right: title, label, truth of each."""

    figures: Figures
    trials: int
    flawed: list[tuple[str, list[tuple[str, str]]]]
    frames_wrongly_named: int


def score(trials: Iterable[Trial], label: LabelFunction, markers) -> Outcome:
    """Labels every trial and counts."""
    figures, flawed, count, misnamed = Figures(markers), [], 0, 0
    offset = 0
    for trial in trials:
        names, steps = label(trial.blobs, trial.cameras)
        blobs = trial.blobs
        figures.add(blobs.frame + offset, blobs.camera, names, trial.truth, steps)
        offset += len(blobs.frames)
        wrong = [
            (str(n), str(t)) for n, t in zip(names, trial.truth, strict=True) if (n or t) and n not in t.split("|")
        ]
        named_wrong = [n != "" and n not in t.split("|") for n, t in zip(names, trial.truth, strict=True)]
        misnamed += len(np.unique(blobs.frame[np.array(named_wrong, dtype=bool)]))
        if wrong:
            flawed.append((trial.title, wrong))
        count += 1
    return Outcome(figures, count, flawed, misnamed)
