# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames in no order: what is named in them teaches their subject, and all are named again by that.

Nothing is followed from frame to frame, so the whole take is no help through time; but one subject wears one set of
markers in one layout, whatever the frame. Names make the likelihood that of this subject, which makes more names, until
nothing changes.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ..data.made import Table
from ..data.takes import Labels, evenly_spread
from .likelihood.calibration import raised
from .likelihood.frames import label_frames
from .likelihood.model import Likelihood
from .likelihood.shape import Shape
from .likelihood.subject import loosened, of_subject, off_expected
from .models import Model
from .tracklets import are_lasting


@dataclass(frozen=True)
class UnorderedOptions:
    """How frames in no order teach their subject.

    min_part         measured: of the markers that are enough; twice of it loses 0.4 % of `clouds-bd`, half nothing
    rare             measured: named less often than this part of what is usual; they are looked for, else 85 % of
                     `clouds-bd` are named and not 99 %
    loose_radii      measured: this far about where they are expected, and are there if they are as near to one place of
                     the body; half loses 7 % of `clouds-bd`, twice none. In
    min_near         measured: this part of the frames that have them, and of what is usual of a marker; all of
                     it loses 14 % of `clouds-bd`
    hidden_part      of a frame's points that is hidden to try how far labels keep
    """

    min_part: float = 1 / 3
    rare: float = 0.5
    loose_radii: float = 0.25
    min_near: float = 0.5
    hidden_part: float = 1 / 12


UNORDERED = UnorderedOptions()
FRAMES_LEARNED_FROM = 600  # of a take; by time
MIN_CLOUDS = 20  # of them that have enough sure names, else there is nothing to learn from
LEARNING_ROUNDS = 10  # of learning and naming; it settles before
SETTLED = 0.9995  # part of the points that keep their names, when nothing changes any more,
NEARLY_SETTLED = 0.995  # and when it is time to look for markers that are placed elsewhere
KEEPING_TRIALS = 2  # in each frame; by time
LEARNING_STEPS = LEARNING_ROUNDS + KEEPING_TRIALS


def is_unordered(model: Model, tracklet: np.ndarray) -> bool:
    """Whether the subject of a take with tracklets (T, P) must be learned from frames that nothing connects.

    A set on rigid bodies is known by these.
    """
    return model.likelihood is not None and model.rigid_bodies is None and not are_lasting(tracklet)


def learn_subject(trained: Likelihood, points: Table, named: Labels) -> Generator[float, None, Likelihood]:
    """The likelihood of the subject of frames of points (T, P, 3) m, which `trained` named with their `rate`.

    Yields the share of the work that is done. Where too little is sure it is the training's own.
    """
    chosen = evenly_spread(len(points), FRAMES_LEARNED_FROM)
    points, labels = points[chosen], named[chosen]
    present = np.isfinite(points).all(axis=2)
    crowded = np.median(present.sum(axis=1)) > len(trained)
    likelihood, sought = trained, np.zeros(len(trained), dtype=bool)
    for done in range(LEARNING_ROUNDS):
        clouds = named_clouds(labels, points, len(trained))
        if len(clouds) < MIN_CLOUDS:
            return trained
        likelihood = of_subject(trained, clouds)
        before, labels = labels, (yield from _named(likelihood, points, done / LEARNING_STEPS, 1 / LEARNING_STEPS))
        same = (labels.marker == before.marker)[present].mean()
        rare = _rare(clouds) & ~sought
        # Among many more points than markers, what is left over is other markers.
        if same >= NEARLY_SETTLED and rare.any() and not crowded:
            sought |= rare
            loose = loosened(likelihood, rare, UNORDERED.loose_radii)
            wide = yield from _named(loose, points, done / LEARNING_STEPS, 1 / LEARNING_STEPS)
            labels = _in_place(wide, points, rare, likelihood.shape, clouds)
        elif same >= SETTLED:
            break
    return (yield from _tried(likelihood, points, labels))


def named_clouds(labels: Labels, points: np.ndarray, markers: int) -> np.ndarray:
    """(F, M, 3) m, NaN where unnamed, the frames of points (T, P, 3) m that have enough names to learn from."""
    clouds = labels.placed(points, markers)
    return clouds[np.isfinite(clouds[..., 0]).mean(axis=1) >= UNORDERED.min_part]


def _named(likelihood: Likelihood, points: np.ndarray, first: float, part: float) -> Generator[float, None, Labels]:
    """The labels of frames, while it tells how far the work is: `part` of all of it, from `first` on."""
    parts, done = [], 0
    for labels in label_frames(likelihood, points):
        parts.append(labels)
        done += len(labels.marker)
        yield first + part * done / len(points)
    return Labels.join(parts)


def _rare(clouds: np.ndarray) -> np.ndarray:
    """(M,) True for markers that are hardly ever named, as when they are placed where nobody in training had them."""
    often = np.isfinite(clouds[..., 0]).mean(axis=0)
    return often < UNORDERED.rare * np.median(often)


def _in_place(labels: Labels, points: np.ndarray, rare: np.ndarray, shape: Shape, clouds: np.ndarray) -> Labels:
    """The labels without those of rare markers (M,) that are not in one place of the body: ghosts are anywhere.

    `clouds` (F, M, 3) m are what was named before.
    """
    placed = labels.placed(points, len(rare))
    usual = np.median(np.isfinite(clouds[..., 0]).sum(axis=0))
    kept = labels.named
    for marker in np.flatnonzero(rare).tolist():
        off = off_expected(shape, placed, marker)
        there = np.isfinite(off).all(axis=1)
        near = np.zeros(len(off), dtype=bool)
        if there.any():
            distance = np.linalg.norm(off - np.median(off[there], axis=0), axis=1)
            near = there & (distance < UNORDERED.loose_radii * shape.radius)
        if near.sum() < UNORDERED.min_near * max(there.sum(), usual):
            near[:] = False
        kept &= (labels.marker != marker) | near[:, None]
    return labels.kept(kept)


def _tried(likelihood: Likelihood, points: np.ndarray, labels: Labels) -> Generator[float, None, Likelihood]:
    """The likelihood promising no more than labels (T, P) keep when more of the points (T, P, 3) m are hidden.

    What its margins are worth was learned of other people and of their poses. How often names change here when less of
    a frame is seen is about how often they are wrong.
    """
    rng, present = np.random.default_rng(0), np.isfinite(points).all(axis=2)
    count = present.sum(axis=1, keepdims=True)
    gone = np.maximum(np.rint(UNORDERED.hidden_part * count), 1)
    odds, right = [], []
    for trial in range(KEEPING_TRIALS):
        rank = np.where(present, rng.random(present.shape), 2.0).argsort(axis=1).argsort(axis=1)
        seen = np.where((present & (rank >= gone))[..., None], points, np.nan)
        again = yield from _named(likelihood, seen, (LEARNING_ROUNDS + trial) / LEARNING_STEPS, 1 / LEARNING_STEPS)
        odds.append(_log_odds(again)[again.named])
        right.append((again.marker == labels.marker)[again.named])
    calibration = raised(likelihood.calibration, np.concatenate(odds), np.concatenate(right))
    return replace(likelihood, calibration=calibration)


def _log_odds(labels: Labels) -> np.ndarray:
    """(T, P) of labels; 0 for those that are likelier wrong, and without a name."""
    chance = np.maximum(labels.confidence, 0.5)
    return np.log(chance) - np.log1p(-chance)
