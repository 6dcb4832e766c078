# SPDX-License-Identifier: GPL-3.0-or-later
"""Marker sets learned without the people they are tested on, and the labelling with them as one function."""

import hashlib
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from addon.core.blobs.pipeline import Options, label_take
from addon.core.data.markersets import MarkerSet
from addon.core.data.takes import NO_MARKER, STEPS
from addon.io.markersets import read_markerset, write_markerset
from scripts import learn_markersets

from . import people
from .captures import LabelFunction

LOST = "the subject was lost"  # what the pipeline says
CACHE = Path(tempfile.gettempdir()) / "mocap-autolabel-accuracy"
LEARNED_BY = (
    "addon/core/body/anatomy.py",
    "scripts/people_study.py",
    "addon/core/posing/posing.py",
    "scripts/learn_markersets.py",
)


def left_out_model(set_name: str, left_out: tuple[str, ...]) -> MarkerSet:
    """The built-in marker set learned without the people `left_out`; kept for the next run."""
    path = CACHE / f"{set_name}-without-{'-'.join(left_out)}-{_learning_version()}.json"
    if not path.exists():
        learned = learn_markersets.learn_set(learn_markersets.read_people(people.DATA / "people", left_out), set_name)
        CACHE.mkdir(parents=True, exist_ok=True)
        write_markerset(path, learned)
    return read_markerset(path)


@cache
def _learning_version() -> str:
    root = Path(__file__).resolve().parents[2]
    return hashlib.sha256(b"".join((root / name).read_bytes() for name in LEARNED_BY)).hexdigest()[:10]


class Labeller:
    """The project's labelling as a function of blobs, with no hints; adds up the seconds that it reports.

    lost    how often it said that it had lost a subject
    nobody  frames without one
    """

    def __init__(self, markerset: MarkerSet, rate: float = 100.0, options: Options | None = None, occlusion=None):
        self.markerset, self._rate, self._options, self._occlusion = markerset, rate, options, occlusion
        self._names = np.array([*markerset.markers, ""], dtype=object)
        self.seconds: dict[str, float] = {}
        self.frames = self.lost = self.nobody = 0

    def __call__(self, blobs, cameras) -> tuple[np.ndarray, np.ndarray]:
        (chunk,) = label_take([blobs], cameras, self.markerset, self._rate, self._options, self._occlusion)
        for stage, seconds in chunk.seconds.items():
            self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds
        self.frames += len(blobs.frames)
        self.lost += sum(suspect.reason == LOST for suspect in chunk.suspects)
        self.nobody += int(np.isnan(chunk.motion.expected[:, 0, 0]).sum())
        marker = np.where(chunk.labels.marker == NO_MARKER, len(self.markerset), chunk.labels.marker)
        return self._names[marker], np.asarray(STEPS, dtype=object)[chunk.labels.step]


def labeller(markerset: MarkerSet) -> LabelFunction:
    """The labelling with its defaults."""
    return Labeller(markerset)
