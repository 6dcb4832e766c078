# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames in no order: what is named in them teaches their subject, and all are named again by that.

Nothing is followed from frame to frame, so the whole take is no help through time; but one subject wears one set of
markers in one layout, whatever the frame. The training says how people and poses differ together; a subject has one
size, one layout of the markers and a way of moving. Left and right, front and back stay what the training says, as the
frames are laid on its mean by a turn about the vertical only. Names make the likelihood that of this subject, which
makes more names, until nothing changes.
"""

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from ..data.made import Table
from ..data.takes import Labels, evenly_spread
from ..geometry.upright import upright_aligned
from .likelihood.distances import CONSTRAINING, MAX_OF_MARKER, DistanceConstraints, surest
from .likelihood.frames import label_frames
from .likelihood.model import Likelihood, raised
from .likelihood.shape import SHAPE, Shape, completed, factors
from .models import Model
from .refusals import REFUSAL
from .tracklets import are_lasting


class UNORDERED:
    """How frames in no order teach their subject, and how much its own count against the training."""

    # that the training's spread counts for; of the cloud 80 are as good on people left out, with 8 three clouds with
    # six markers hidden lose 61 of 13,176 names
    frames: float = 20.0  # measured
    # of the logarithm of the size that is left once the subject's own distances are known
    size_sd: float = 0.01  # physical: 1 %
    # of the markers that are enough; twice of it loses 2 % of `clouds-p2`, half nothing
    min_part: float = 1 / 3  # measured
    # this far about where they are expected are markers sought that are seldom named, else 7 % of `clouds-p1` and
    # `clouds-p2` are lost; they are there if most are as near to one place of the body; half and twice of it name 1 %
    # more of `clouds-serve`, and others alike
    loose_radii: float = 0.25  # measured
    hidden_part: float = 1 / 12  # of a frame's points that is hidden to try how far labels keep


SUBJECT_ROUNDS = 6  # of expectation maximisation; it settles sooner
FRAMES_LEARNED_FROM = 600  # of a take; by time
MIN_CLOUDS = 20  # of them that have enough sure names, else there is nothing to learn from
LEARNING_ROUNDS = 10  # of learning and naming; it settles before
SETTLED = 0.9995  # part of the points that keep their names, when nothing changes any more,
NEARLY_SETTLED = 0.995  # and when it is time to look for markers that are placed elsewhere
KEEPING_TRIALS = 2  # in each frame; by time
LEARNING_STEPS = LEARNING_ROUNDS + KEEPING_TRIALS


def of_subject(likelihood: Likelihood, clouds: np.ndarray) -> Likelihood:
    """The likelihood for a subject of whom such clouds (F, M, 3) m are named, NaN where a marker is not.

    What margins are worth stays as it is: they are log odds of a better likelihood.
    """
    shape = _subject_shape(likelihood.shape, clouds)
    constraints = _subject_constraints(likelihood.constraints, clouds, shape.radius)
    return replace(likelihood, shape=shape, constraints=constraints)


def loosened(likelihood: Likelihood, markers: np.ndarray, sd_radii: float) -> Likelihood:
    """The likelihood with some markers (M,) sitting anywhere so far from where they are expected."""
    shape, constraints = likelihood.shape, likelihood.constraints
    noise = shape.noise + markers * (sd_radii * shape.radius) ** 2
    kept = ~markers[constraints.pair].any(axis=1)
    known = DistanceConstraints(
        constraints.pair[kept], constraints.length[kept], constraints.sd[kept], constraints.size_sd
    )
    return replace(likelihood, shape=replace(shape, noise=noise), constraints=known)


def off_expected(shape: Shape, clouds: np.ndarray, marker: int) -> np.ndarray:
    """(F, 3) m, how far a marker of clouds (F, M, 3) m is from where the frame's others expect it; NaN where missing.

    In the axes of the shape.
    """
    others = clouds.copy()
    others[:, marker] = np.nan
    filled, _ = completed(_flat(upright_aligned(others, shape.mean)), shape.mean.ravel(), shape.covariance)
    expected = filled.reshape(clouds.shape)
    # The marker itself goes along with the others, as one that is none of the shape's.
    along = upright_aligned(np.concatenate([others, clouds[:, marker : marker + 1]], axis=1), shape.mean)
    return along[:, -1] - expected[:, marker]


def _subject_shape(shape: Shape, clouds: np.ndarray) -> Shape:
    """Mean and covariance by expectation maximisation, the training's covariance counting for some frames."""
    known, spread, frames = shape.mean.ravel(), shape.covariance, len(clouds)
    mean, covariance = known, spread
    seen = np.isfinite(clouds[..., :1])
    aligned = upright_aligned(clouds, shape.mean)
    for _ in range(SUBJECT_ROUNDS):
        filled, unsure = completed(_flat(aligned), mean, covariance)
        # Whole clouds are laid on the mean, not what happens to be seen of them.
        whole = upright_aligned(filled.reshape(clouds.shape), mean.reshape(-1, 3))
        aligned = np.where(seen, whole, np.nan)
        own = _flat(whole).mean(axis=0)
        away = _flat(whole) - own
        total = UNORDERED.frames * spread + away.T @ away + unsure
        covariance = total / (UNORDERED.frames + frames)
        mean = known + spread @ np.linalg.solve(spread + covariance / frames, own - known)
    modes, noise = factors(covariance, SHAPE.min_sd_radii * shape.radius)
    placed = mean.reshape(-1, 3)
    return Shape(placed - placed.mean(axis=0), modes, noise)


def _subject_constraints(trained: DistanceConstraints, clouds: np.ndarray, radius: float) -> DistanceConstraints:
    """The subject's own distances and how much they vary; where none is seen, the training's in the subject's size."""
    pair = np.array(np.triu_indices(clouds.shape[1], 1)).T
    distance = np.linalg.norm(clouds[:, pair[:, 0]] - clouds[:, pair[:, 1]], axis=2)
    frames = np.isfinite(distance).sum(axis=0)
    often = frames >= CONSTRAINING.min_frames
    length, variance = np.zeros(len(pair)), np.zeros(len(pair))
    length[often] = np.nanmedian(distance[:, often], axis=0)
    variance[often] = np.nanmean((distance[:, often] - length[often]) ** 2, axis=0)
    place = np.full((clouds.shape[1],) * 2, -1)
    place[tuple(pair.T)] = place[tuple(pair[:, ::-1].T)] = np.arange(len(pair))
    mine = place[tuple(trained.pair.T)]
    both = often[mine]
    size = np.exp(np.median(np.log(length[mine[both]] / trained.length[both]))) if both.any() else 1.0
    # A distance that no training keeps may be kept by this subject, as far as its frames show.
    loose = np.full(len(pair), CONSTRAINING.max_sd_radii * radius)
    loose[mine] = size * trained.sd
    weight, least = UNORDERED.frames, CONSTRAINING.min_sd_radii * radius
    sd = np.sqrt((weight * loose**2 + frames * variance) / (weight + frames) + least**2)
    unseen = mine[~both]
    length[unseen], sd[unseen] = size * trained.length[~both], loose[unseen]
    kept = often & (sd < CONSTRAINING.max_sd_radii * radius)
    kept[mine] = True
    pair, length, sd = pair[kept], length[kept], sd[kept]
    few = surest(pair, sd, MAX_OF_MARKER)
    return DistanceConstraints(pair[few], length[few], sd[few], UNORDERED.size_sd)


def _flat(clouds: np.ndarray) -> np.ndarray:
    return clouds.reshape(len(clouds), -1)


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
        clouds = labels.placed(points, len(trained))
        clouds = clouds[np.isfinite(clouds[..., 0]).mean(axis=1) >= UNORDERED.min_part]
        if len(clouds) < MIN_CLOUDS:
            return trained
        likelihood = of_subject(trained, clouds)
        before, labels = labels, (yield from _named(likelihood, points, done / LEARNING_STEPS, 1 / LEARNING_STEPS))
        same = (labels.marker == before.marker)[present].mean()
        # Hardly ever named, as when they are placed where nobody in training had them.
        often = np.isfinite(clouds[..., 0]).mean(axis=0)
        rare = (often < REFUSAL.min_half * np.median(often)) & ~sought
        # Among many more points than markers, what is left over is other markers.
        if same >= NEARLY_SETTLED and rare.any() and not crowded:
            sought |= rare
            loose = loosened(likelihood, rare, UNORDERED.loose_radii)
            wide = yield from _named(loose, points, done / LEARNING_STEPS, 1 / LEARNING_STEPS)
            labels = _in_place(wide, points, rare, likelihood.shape, clouds)
        elif same >= SETTLED:
            break
    return (yield from _tried(likelihood, points, labels))


def _named(likelihood: Likelihood, points: np.ndarray, first: float, part: float) -> Generator[float, None, Labels]:
    """The labels of frames, while it tells how far the work is: `part` of all of it, from `first` on."""
    parts, done = [], 0
    for labels in label_frames(likelihood, points):
        parts.append(labels)
        done += len(labels.marker)
        yield first + part * done / len(points)
    return Labels.join(parts)


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
        if near.sum() < REFUSAL.min_half * max(there.sum(), usual):
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
        chance = np.maximum(again.confidence[again.named], 0.5)  # nothing is lost by those that are likelier wrong
        odds.append(np.log(chance) - np.log1p(-chance))
        right.append((again.marker == labels.marker)[again.named])
    calibration = raised(likelihood.calibration, np.concatenate(odds), np.concatenate(right))
    return replace(likelihood, calibration=calibration)
