# SPDX-License-Identifier: GPL-3.0-or-later
"""Learning to name points from labelled takes of any subjects: people, animals or props."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ...data.errors import InputError
from ..rigid_bodies.model import RigidBodies, learn_rigid_bodies
from .calibration import learn_calibration
from .distances import DistanceConstraints, learn_constraints
from .labels import chunks, labels_given, solve_frames
from .model import Calibration, Known, Likelihood
from .shape import Shape, as_strangers, learn_shape
from .sides import mirrored
from .trials import Trial, crowded, make_trial

FOLDS = 5
TRIAL_FRAMES = 1000  # frames of each fold, at most, that are named to see how far margins can be trusted
TRIAL_LABELS = 26000  # that are enough of it
HIDDEN_PART = 1 / 3  # up to this part of the markers is hidden in a trial
MOST_GHOSTS = 3
CROWDED = 4  # one frame in so many is tried with many more points too,
CROWD, MOST_CROWDED = 3, 80  # times as many as there are markers at most, and points at most
FEWEST_MARKERS, FEWEST_FRAMES = 4, 10


def learn_likelihood(
    takes: Sequence[tuple[np.ndarray, str]],
    markers: Sequence[str],
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Likelihood:
    """Evidence from labelled takes: points (T, M, 3) m, z up, NaN where missing, each with the id of its subject.

    `progress` is told the part that is done. The same seed gives the same evidence.
    Raises InputError when the takes do not show the markers together.
    """
    markers = tuple(markers)
    subjects = _by_subject(takes, markers)
    shape, constraints = _learn(list(subjects.values()), markers, seed)
    rigid_bodies = learn_rigid_bodies(list(subjects.values()), shape.radius)
    calibration = _learn_calibration(list(subjects.values()), markers, rigid_bodies, seed, progress)
    return Likelihood(markers, shape, constraints, calibration, len(subjects), rigid_bodies)


def _by_subject(takes, markers: tuple[str, ...]) -> dict[str, np.ndarray]:
    """All usable frames of every subject."""
    if len(markers) < FEWEST_MARKERS:
        raise InputError(f"{len(markers)} markers are too few to be told apart; expected {FEWEST_MARKERS} or more")
    gathered: dict[str, list[np.ndarray]] = {}
    for points, subject in takes:
        if points.ndim != 3 or points.shape[1:] != (len(markers), 3):
            raise InputError(f"a take has the shape {points.shape}; expected frames × {len(markers)} markers × 3")
        enough = np.isfinite(points[..., 0]).sum(axis=1) >= max(FEWEST_MARKERS, len(markers) / 2)
        gathered.setdefault(subject, []).append(points[enough])
    subjects = {subject: np.concatenate(parts) for subject, parts in sorted(gathered.items())}
    subjects = {subject: points for subject, points in subjects.items() if len(points)}
    if not subjects:
        raise InputError("no frame shows half of the markers together; expected labelled takes of this marker set")
    frames = sum(map(len, subjects.values()))
    if frames < FEWEST_FRAMES:
        raise InputError(f"only {frames} frames show half of the markers together; expected {FEWEST_FRAMES} or more")
    everything = np.concatenate([np.isfinite(points[..., 0]).any(axis=0)[None] for points in subjects.values()])
    unseen = [name for name, seen in zip(markers, everything.any(axis=0), strict=True) if not seen]
    if unseen:
        raise InputError(f"no take shows {' '.join(unseen)}; expected every marker in at least one take")
    return subjects


def _learn(subjects: list[np.ndarray], markers: tuple[str, ...], seed: int) -> tuple[Shape, DistanceConstraints]:
    images = mirrored(subjects, markers)
    shape = learn_shape(subjects, seed, images)
    return shape, learn_constraints(subjects, shape.radius, images)


def _learn_calibration(
    subjects: list[np.ndarray], markers: tuple[str, ...], whole: RigidBodies | None, seed: int, progress
) -> Calibration:
    """Trust from naming each subject with what the others teach.

    A single subject's frames are split in time instead, and named as if they were of other subjects: of those nothing
    is known but how much subjects differ in general. Where all that was learned has rigid bodies, so has every part, and else
    none: a few of the takes may look otherwise.
    """
    rng = np.random.default_rng(seed)
    found: list[tuple[np.ndarray, ...]] = []
    splits = _splits(subjects)
    for done, (rest, tested) in enumerate(splits):
        shape, constraints = _learn(rest, markers, seed)
        rigid_bodies = None if whole is None else learn_rigid_bodies(rest, shape.radius) or whole
        known = Known.of(markers, shape, constraints, rigid_bodies)
        # On rigid bodies frames are named several times as fast.
        count = TRIAL_FRAMES if rigid_bodies is not None else min(TRIAL_FRAMES, TRIAL_LABELS // len(markers))
        tested = tested[rng.choice(len(tested), count, replace=len(tested) < count)]
        if len(subjects) == 1 and rigid_bodies is None:
            tested = as_strangers(shape, tested, rng)
        for trial, usual in _trials(tested, known, rng):
            found += _tried(known, trial, usual)
        if progress is not None:
            progress((done + 1) / len(splits))
    if not sum(len(right) for _, right, _ in found):
        raise InputError("in no frame could a marker be told from the others; expected takes that show more of them")
    return learn_calibration(*(np.concatenate(column) for column in zip(*found, strict=True)))


def _trials(tested: np.ndarray, known: Known, rng: np.random.Generator) -> Iterator[tuple[Trial, bool]]:
    """What the frames (T, M, 3) are tried as, and whether that is usual: without ghosts, with a few, in a crowd."""
    hidden = 0, round(tested.shape[1] * HIDDEN_PART)
    for ghosts in (0, MOST_GHOSTS):
        half = tested[ghosts > 0 :: 2]
        if len(half):
            yield make_trial(half, hidden, (0, ghosts), rng), True
    some = tested[::CROWDED]
    if known.rigid_bodies is None:
        most = min(CROWD * tested.shape[1], MOST_CROWDED)
        yield crowded(make_trial(some, hidden, (0, 0), rng), some, most, rng), False


def _splits(subjects: list[np.ndarray]) -> list[tuple[list[np.ndarray], np.ndarray]]:
    """What is learned from and the frames (T, M, 3) that are tested then, so that every subject is tested once.

    But those without whom too few frames are left, or who alone show a marker: nobody else could teach it.
    """
    shown = np.array([np.isfinite(points[..., 0]).any(axis=0) for points in subjects])
    frames = np.array([len(points) for points in subjects])
    needed = (shown & (shown.sum(axis=0) == 1)).any(axis=1) | (frames.sum() - frames < FEWEST_FRAMES)
    tested = np.flatnonzero(~needed)
    if not len(tested):
        parts = [np.array_split(points, FOLDS) for points in subjects]
        whole = [np.concatenate(fold) for fold in zip(*parts, strict=True)]
        return [
            ([np.concatenate(own[:fold] + own[fold + 1 :]) for own in parts], whole[fold])
            for fold in range(FOLDS)
            if len(whole[fold])
        ]
    count = min(FOLDS, len(tested))
    folds = [tested[first::count] for first in range(count)]
    return [
        (
            [points for index, points in enumerate(subjects) if index not in fold],
            np.concatenate([subjects[index] for index in fold]),
        )
        for fold in folds
    ]


def _tried(known: Known, trial: Trial, usual: bool) -> list[tuple[np.ndarray, ...]]:
    """Of all labels given in a trial what their chances depend on, and whether each is right and of a usual frame."""
    found = []
    for frames in chunks(trial.points):
        points, truth = trial.points[frames], trial.truth[frames]
        given = labels_given(solve_frames(known, points), points)
        right = truth[given.frame, given.point] == given.marker
        found.append((given.described, right, np.full(len(right), usual)))
    return found
