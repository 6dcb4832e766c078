# SPDX-License-Identifier: GPL-3.0-or-later
"""From what frames say one by one to what is said of the take: tracklets vote, and the rest of the take objects."""

import numpy as np

from ..data.models import Model
from ..data.takes import NO_MARKER, Labels, Verdict
from .consistency import stray_suspects, strays
from .likelihood.model import Likelihood
from .tracklets import vote_tracklets

CROWD = 2.0  # times as many points as markers are a crowd, where
BACKED = 0.5  # of a tracklet's frames must be sure of its name on their own,
BACKED_ALONE = 0.25  # and so many where one subject is all that the model has seen


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
    if (tracklet >= 0).sum() >= CROWD * markers * len(tracklet):
        return BACKED
    few = likelihood is not None and likelihood.subjects == 1 and likelihood.rigid_bodies is None
    return BACKED_ALONE if few else 0.0


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
    placed = np.full((len(points), len(likelihood), 3), np.nan)
    placed[frame, marker] = points[frame, column]
    stray = strays(placed, likelihood.constraints)
    wrong = stray[frame, marker]
    kept = verdict.labels.named
    kept[frame[wrong], column[wrong]] = False
    suspects = verdict.suspects + stray_suspects(stray, likelihood.markers, first_frame)
    return Verdict(verdict.labels.kept(kept), suspects)


def once(marker: np.ndarray, sure: np.ndarray, markers: int) -> np.ndarray:
    """Labels (T, P) of which each frame has every marker once: the surest."""
    kept = np.full(marker.shape, NO_MARKER)
    for index in range(markers):
        worth = np.where(marker == index, sure, -1.0)
        best = worth.argmax(axis=1)
        frames = np.flatnonzero(worth[np.arange(len(worth)), best] >= 0)
        kept[frames, best[frames]] = index
    return kept
