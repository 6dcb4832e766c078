# SPDX-License-Identifier: GPL-3.0-or-later
"""From what frames say one by one to what is said of the take: tracklets vote, and the rest of the take objects.

It objects to a marker that for some frames is not where its rigid neighbours have it. One subject keeps the distances
between markers on one bone; what they are, the take itself tells best.
"""

from dataclasses import dataclass

import numpy as np

from ..data.takes import NO_MARKER, Labels, Suspect, Verdict
from ..review.suspects import suspect_ranges
from .likelihood.distances import DistanceConstraints
from .likelihood.model import Likelihood
from .models import Model
from .tracklets import vote_tracklets


@dataclass(frozen=True)
class WitnessOptions:
    """Where a vote needs frames that are sure on their own, as its frames may err together. All reckoned.

    crowd                  times as many points as markers are a crowd, where
    min_sure_crowd         of a tracklet's frames must be sure of its name on their own,
    min_sure_one_subject   and so many where one subject is all that the model has seen
    """

    crowd: float = 2.0
    min_sure_crowd: float = 0.5
    min_sure_one_subject: float = 0.25


@dataclass(frozen=True)
class ConsistencyOptions:
    """When a take contradicts a name. All reckoned.

    max_sd            standard deviations of a constraint's length that are no contradiction,
    max_off_m         and what is none whatever they are
    max_broken        share of a marker's constraints that may be broken
    min_constraints   of a marker that must be seen
    min_frames        that tell a distance
    max_break_frames  between two findings that are one
    """

    max_sd: float = 4.0
    max_off_m: float = 0.015
    max_broken: float = 0.5
    min_constraints: int = 2
    min_frames: int = 20
    max_break_frames: int = 5


WITNESSES = WitnessOptions()
CONSISTENCY = ConsistencyOptions()


def decide(named: Labels, tracklet: np.ndarray, model: Model, target: float, first_frame: int) -> Verdict:
    """Lets the tracklets (T, P) vote and keeps what is sure enough that a part `target` of it is right.

    named are the labels (T, P) of frames on their own, with their `rate`. Where the vote says what the frame said, the
    frame's own step stays.
    """
    voted = vote_tracklets(named, tracklet, model.markerset.markers, first_frame)
    marker, confidence = voted.labels.marker, voted.labels.confidence
    alone = marker == named.marker
    chance = np.where(alone, np.maximum(confidence, named.confidence), confidence)
    sure = alone & (named.rate >= target)
    backed = _part_sure(sure, tracklet) >= _needed(model, tracklet)
    marker = np.where((confidence >= target) & backed | sure, marker, NO_MARKER)
    marker = once(marker, chance, len(model.markerset))
    labels = Labels(marker, np.where(alone, named.step, voted.labels.step), chance)
    return Verdict(labels.kept(marker != NO_MARKER), voted.suspects)


def _needed(model: Model, tracklet: np.ndarray) -> float:
    """The part of a tracklet's frames that must be sure of its name for its vote to count.

    A vote takes frames for so many witnesses. They are not where they err together: among many more points than
    markers one that is no marker sits like one through the whole take, and a model of one subject knows nothing of how
    the next one differs.
    """
    likelihood, markers = model.likelihood, len(model.markerset)
    if (tracklet >= 0).sum() >= WITNESSES.crowd * markers * len(tracklet):
        return WITNESSES.min_sure_crowd
    few = likelihood is not None and likelihood.subjects == 1 and likelihood.rigid_bodies is None
    return WITNESSES.min_sure_one_subject if few else 0.0


def _part_sure(sure: np.ndarray, tracklet: np.ndarray) -> np.ndarray:
    """(T, P) of each point the part of its tracklet's frames that are sure (T, P) of its name; 0 without one."""
    present = tracklet >= 0
    frames = np.bincount(tracklet[present])
    part = np.bincount(tracklet[present], weights=sure[present]) / np.maximum(frames, 1)
    return np.where(present, np.append(part, 0.0)[tracklet], 0.0)


def consistent(verdict: Verdict, points: np.ndarray, likelihood: Likelihood | None, first_frame: int) -> Verdict:
    """Takes back names of points (T, P, 3) m that contradict the rest of the take, and says so."""
    if likelihood is None:
        return verdict
    frame, column = np.nonzero(verdict.labels.named)
    marker = verdict.labels.marker[frame, column]
    stray = strays(verdict.labels.placed(points, len(likelihood)), likelihood.constraints)
    wrong = stray[frame, marker]
    kept = verdict.labels.named
    kept[frame[wrong], column[wrong]] = False
    suspects = verdict.suspects + stray_suspects(stray, likelihood.markers, first_frame)
    return Verdict(verdict.labels.kept(kept), suspects)


def strays(
    markers: np.ndarray, constraints: DistanceConstraints, options: ConsistencyOptions = CONSISTENCY
) -> np.ndarray:
    """(T, M) True where a marker of (T, M, 3) m, NaN where missing, is off most of those that it moves with."""
    count, size = markers.shape[:2]
    broken, known = np.zeros((2, count, size))
    for (one, two), sd in zip(constraints.pair.tolist(), constraints.sd.tolist(), strict=True):
        distance = np.linalg.norm(markers[:, one] - markers[:, two], axis=1)
        there = np.isfinite(distance)
        if there.sum() < min(options.min_frames, count):
            continue
        usual = np.median(distance[there])
        off = there & (np.abs(distance - usual) > max(options.max_sd * sd, options.max_off_m))
        for marker in (one, two):
            broken[:, marker] += off
            known[:, marker] += there
    return (known >= options.min_constraints) & (broken > options.max_broken * known)


def stray_suspects(stray: np.ndarray, names, first_frame: int) -> tuple[Suspect, ...]:
    """What a person should look at: ranges of frames by marker, short interruptions bridged."""
    frames, found = first_frame + np.arange(len(stray)), []
    for marker, name in enumerate(names):
        words = f"{name} was off the markers that it moves with, and lost its name"
        found += suspect_ranges(frames, stray[:, marker], words, CONSISTENCY.max_break_frames, (name,))
    return tuple(found)


def once(marker: np.ndarray, sure: np.ndarray, markers: int) -> np.ndarray:
    """Labels (T, P) of which each frame has every marker once: the surest."""
    kept = np.full(marker.shape, NO_MARKER)
    for index in range(markers):
        worth = np.where(marker == index, sure, -1.0)
        best = worth.argmax(axis=1)
        frames = np.flatnonzero(worth[np.arange(len(worth)), best] >= 0)
        kept[frames, best[frames]] = index
    return kept
