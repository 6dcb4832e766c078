# SPDX-License-Identifier: GPL-3.0-or-later
"""Marker sets learned without the people they are tested on, and the labelling with them."""

import hashlib
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from addon.core.blobs.pipeline import label_take
from addon.core.data.markersets import MarkerSet
from addon.io.markersets import read_markerset, write_markerset
from scripts import learn_markersets

from . import people
from .people import Trial

CACHE = Path(tempfile.gettempdir()) / "mocap-autolabel-accuracy"
LEARNED_BY = (
    "scripts/anatomy.py",
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


def labelled(markerset: MarkerSet, trial: Trial) -> np.ndarray:
    """(N,) the names that the product gives to a capture's blobs without any hint, "" for none."""
    (chunk,) = label_take([trial.blobs], trial.cameras, markerset, trial.rate)
    return np.array([*markerset.markers, ""], object)[chunk.labels.marker]
