# SPDX-License-Identifier: GPL-3.0-or-later
"""Learning to name points from labelled takes of any subjects: people, animals or props.

What margins are worth is measured by trials: anonymous frames made of labelled ones, with markers hidden, ghosts added,
points shuffled and the truth kept, named by what was learned without their subjects. Each needs nothing else: whoever
trains may try them side by side.
"""

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...body.sides import MIRROR, mirror_order
from ...data.errors import InputError
from ...data.physical import MARKER_LIMITS, SIGMAS
from ...data.progress import finished
from ...data.wording import count_of
from ...geometry.upright import upright_aligned
from ...posing.posing import POSING
from ..rigid_bodies.model import RigidBodies, learn_rigid_bodies
from .distances import DistanceConstraints, learn_constraints
from .frames import chunks, labels_given, solve_frames
from .model import Calibration, Known, Likelihood, learn_calibration
from .shape import Shape, as_other_subjects, cloud_radius, learn_shape
from .sides import learn_sides


class LEARN:
    """What is learned from, how a calibration is measured, and where the points of its trials lie."""

    min_frames: int = 10  # to learn from; physical: a tenth of a second at 100 Hz, fewer show no motion
    max_frames: int = 1000  # memory and time: of each fold that are named
    max_labels: int = 26000  # memory and time: that are enough of them
    # part of the markers that is hidden in a trial
    max_hidden: float = 1 / 3  # paper: 4 of 15 (partial solvers, table 3), and one more
    # that the mirrored mean may differ from the mean, where names mean sides
    max_mirrored_radii: float = 0.25  # physical: 20 cm, half of what left and right are apart
    around_radii: float = 0.5  # beyond the subject's own box where ghosts still appear; physical: 40 cm, a hand's reach
    # standard deviation of where a marker of another set sits about one of this
    beside_sd_radii: float = 0.25  # physical: 20 cm
    # how far along the line through two markers others may sit, in parts of their distance
    max_along: float = 1.5  # physical: sets have markers between theirs, and beyond the last of a limb


FOLDS = 5  # that subjects or frames are split into
MAX_GHOSTS = 3  # in a frame of a trial
CROWD_EVERY = 4  # one frame in so many is tried with many more points too,
CROWD_MARKERS, MAX_CROWD = 3, 80  # up to so many times as there are markers, and so many at most
LEARNED_SHARE = 0.1  # of the time of a calibration, that is over when the trials begin


@dataclass(frozen=True, eq=False)
class Trial:
    """Frames with nothing but points."""

    points: np.ndarray  # (F, P, 3) m, NaN where there is none
    truth: np.ndarray  # (F, P) the marker, -1 for ghosts and where there is no point


def crowded(trial: Trial, labelled: np.ndarray, most: int, rng: np.random.Generator) -> Trial:
    """The trial of labelled clouds (F, M, 3) m with up to `most` points more a frame, as markers that the set lacks.

    Half of them sit beside markers, as on a foot that is marked all over; half anywhere along the line through two, as
    those on a part of the body that the set leaves out.
    """
    frames, markers = labelled.shape[:2]
    radius = cloud_radius(labelled)
    one, other = np.moveaxis(rng.integers(0, markers, (frames, most, 2)), 2, 0)
    rows = np.arange(frames)[:, None]
    part = np.where(np.arange(most) % 2, rng.uniform(1 - LEARN.max_along, LEARN.max_along, (frames, most)), 0)
    extra = labelled[rows, one] + part[..., None] * (labelled[rows, other] - labelled[rows, one])
    extra += LEARN.beside_sd_radii * radius * rng.standard_normal(extra.shape)
    extra[np.arange(most) >= rng.integers(0, most + 1, (frames, 1))] = np.nan
    return Trial(
        np.concatenate([trial.points, extra], axis=1),
        np.concatenate([trial.truth, np.full((frames, most), -1)], axis=1),
    )


def make_trial(
    labelled: np.ndarray, hidden: tuple[int, int], ghosts: tuple[int, int], rng: np.random.Generator
) -> Trial:
    """A trial out of labelled clouds (F, M, 3) m, NaN where missing.

    Of each frame's markers a number within `hidden` (both ends included) is taken away, and a number within `ghosts` of
    points anywhere about the subject is added.
    """
    frames, markers = labelled.shape[:2]
    seen = np.isfinite(labelled[..., 0])
    radius = cloud_radius(labelled)
    gone = rng.integers(hidden[0], hidden[1] + 1, (frames, 1))
    order = np.argsort(np.where(seen, rng.random((frames, markers)), 2), axis=1)
    kept = seen & (np.argsort(order, axis=1) >= gone)
    extra = rng.integers(ghosts[0], ghosts[1] + 1, (frames, 1))
    room = LEARN.around_radii * radius
    low, high = np.nanmin(labelled, axis=1) - room, np.nanmax(labelled, axis=1) + room
    low[:, 2] = np.maximum(low[:, 2], min(0.0, np.nanmin(labelled[..., 2])))
    spread = low[:, None] + (high - low)[:, None] * rng.random((frames, ghosts[1], 3))
    spread[np.arange(ghosts[1]) >= extra] = np.nan
    cloud = np.concatenate([np.where(kept[..., None], labelled, np.nan), spread], axis=1)
    truth = np.concatenate([np.where(kept, np.arange(markers), -1), np.full((frames, ghosts[1]), -1)], axis=1)
    # Shuffled, with the places that hold no point last.
    shuffle = np.argsort(np.where(np.isfinite(cloud[..., 0]), rng.random(truth.shape), 2), axis=1)
    cloud, truth = np.take_along_axis(cloud, shuffle[..., None], axis=1), np.take_along_axis(truth, shuffle, axis=1)
    width = max(int(np.isfinite(cloud[..., 0]).sum(axis=1).max()), 1)
    return Trial(cloud[:, :width], truth[:, :width])


@dataclass(frozen=True, eq=False)
class TrialWork:
    """A trial to be named by what was learned without its subjects."""

    # what was learned, as in `Likelihood`
    markers: tuple[str, ...]
    shape: Shape
    constraints: DistanceConstraints
    rigid_bodies: RigidBodies | None
    trial: Trial  # the frames
    usual: bool  # whether they are as most takes' frames are, and no crowd


@dataclass(frozen=True, eq=False)
class TrialOutcome:
    """All N labels given in a trial: what their chances depend on (N, FEATURES), and whether each is right (N,)."""

    described: np.ndarray
    right: np.ndarray


# Tries all trials and gives the outcomes in the same order.
Trying = Callable[[Sequence[TrialWork]], Iterable[TrialOutcome]]


def tried(work: TrialWork) -> TrialOutcome:
    """The labels given in a trial."""
    # Sums hang in their last bit on how an array lies in memory, which nobody keeps who takes the work elsewhere.
    shape = Shape(*map(np.ascontiguousarray, (work.shape.mean, work.shape.modes, work.shape.noise)))
    known = Known.of(work.markers, shape, work.constraints, work.rigid_bodies)
    described, right = [], []
    for frames in chunks(work.trial.points, work.rigid_bodies is not None):
        points, truth = work.trial.points[frames], work.trial.truth[frames]
        given = labels_given(solve_frames(known, points), points)
        described.append(given.described)
        right.append(truth[given.frame, given.point] == given.marker)
    return TrialOutcome(np.concatenate(described), np.concatenate(right))


def in_turn(works: Sequence[TrialWork]) -> Iterator[TrialOutcome]:
    """The outcomes of trials, tried one after the other."""
    return map(tried, works)


def learn_likelihood(takes: Sequence[tuple[np.ndarray, str]], markers: Sequence[str]) -> Likelihood:
    """What labelled takes teach: points (T, M, 3) m, z up, NaN where missing, each with the id of its subject.

    The same every time. Raises InputError when the takes do not show the markers together.
    """
    return finished(learning(takes, markers))


def learning(
    takes: Sequence[tuple[np.ndarray, str]], markers: Sequence[str], seed: int = 0, try_all: Trying = in_turn
) -> Generator[tuple[float, str], None, Likelihood]:
    """The same as a generator of (share done, what is being done); the likelihood is what it returns.

    `try_all` makes the trials: the result is the same wherever each is made.
    """
    markers = tuple(markers)
    subjects = _by_subject(takes, markers)
    images = _mirrored(list(subjects.values()), markers)
    shape, constraints = _learn(list(subjects.values()), images, seed)
    rigid_bodies = learn_rigid_bodies(list(subjects.values()), shape.radius)
    calibration = yield from _learn_calibration(list(subjects.values()), markers, rigid_bodies, seed, try_all)
    sides = learn_sides([*subjects.values(), *images], shape.radius)
    return Likelihood(markers, shape, constraints, calibration, len(subjects), rigid_bodies, sides)


def _by_subject(takes, markers: tuple[str, ...]) -> dict[str, np.ndarray]:
    """All usable frames of every subject."""
    if len(markers) < POSING.min_markers:
        raise InputError(
            f"{count_of(len(markers), 'marker')} cannot be told apart; expected {POSING.min_markers} or more"
        )
    gathered: dict[str, list[np.ndarray]] = {}
    for points, subject in takes:
        if points.ndim != 3 or points.shape[1:] != (len(markers), 3):
            raise InputError(f"a take has the shape {points.shape}; expected frames × {len(markers)} markers × 3")
        enough = np.isfinite(points[..., 0]).sum(axis=1) >= max(POSING.min_markers, len(markers) / 2)
        gathered.setdefault(subject, []).append(points[enough])
    subjects = {subject: np.concatenate(parts) for subject, parts in sorted(gathered.items())}
    subjects = {subject: points for subject, points in subjects.items() if len(points)}
    if not subjects:
        raise InputError("no frame shows half of the markers together; expected labelled takes of this marker set")
    frames = sum(map(len, subjects.values()))
    if frames < LEARN.min_frames:
        words = f"half of the markers are together in {count_of(frames, 'frame')} only"
        raise InputError(f"{words}; expected {LEARN.min_frames} or more")
    everything = np.concatenate([np.isfinite(points[..., 0]).any(axis=0)[None] for points in subjects.values()])
    unseen = [name for name, seen in zip(markers, everything.any(axis=0), strict=True) if not seen]
    if unseen:
        raise InputError(f"no take shows {' '.join(unseen)}; expected every marker in at least one take")
    return subjects


def _learn(subjects: list[np.ndarray], images: Sequence[np.ndarray], seed: int) -> tuple[Shape, DistanceConstraints]:
    shape = learn_shape(subjects, seed, images)
    return shape, learn_constraints(subjects, shape.radius, images)


def _mirrored(subjects: Sequence[np.ndarray], markers: Sequence[str]) -> list[np.ndarray]:
    """The mirror images of labelled clouds, one array (T, M, 3) a subject, with the sides' names exchanged.

    Empty where the names have no sides, or where the clouds do not look as if they meant sides.
    """
    order = mirror_order(tuple(markers))
    if order is None:
        return []
    mean = learn_shape(subjects).mean
    image = upright_aligned((mean[order] * MIRROR)[None], mean)[0]
    away = np.sqrt(((image - mean) ** 2).sum(axis=1))
    if np.sqrt((away**2).mean()) > LEARN.max_mirrored_radii * np.sqrt((mean**2).sum(axis=1).mean()):
        return []
    # What has no other side by name is as far off the middle as hands put it, half as far as from its image, or was
    # never meant to be there.
    beside = (order == np.arange(len(order))) & (away > 2 * SIGMAS * MARKER_LIMITS.placed_m)
    return [np.where(beside[:, None], np.nan, points[:, order] * MIRROR) for points in subjects]


def _learn_calibration(
    subjects: list[np.ndarray], markers: tuple[str, ...], whole: RigidBodies | None, seed: int, try_all: Trying
) -> Generator[tuple[float, str], None, Calibration]:
    """The calibration by naming each subject with what the others teach.

    A single subject's frames are split in time instead, and named as if they were of other subjects: of those nothing
    is known but how much subjects differ in general. Where all that was learned has rigid bodies, so has every part,
    and else none: a few of the takes may look otherwise.
    """
    works = yield from _works(subjects, markers, whole, seed)
    outcomes = []
    for outcome in try_all(works):
        outcomes.append(outcome)
        yield LEARNED_SHARE + (1 - LEARNED_SHARE) * len(outcomes) / len(works), "learn the likelihood"
    right = np.concatenate([outcome.right for outcome in outcomes])
    if not len(right):
        raise InputError("in no frame could a marker be distinguished; expected takes that show more of them")
    usual = np.repeat([work.usual for work in works], [len(outcome.right) for outcome in outcomes])
    return learn_calibration(np.concatenate([outcome.described for outcome in outcomes]), right, usual)


def _works(
    subjects: list[np.ndarray], markers: tuple[str, ...], whole: RigidBodies | None, seed: int
) -> Generator[tuple[float, str], None, list[TrialWork]]:
    """The trials of all folds, with what is learned without each fold."""
    rng = np.random.default_rng(seed)
    works, splits = [], _splits(subjects)
    for done, (rest, tested) in enumerate(splits):
        yield LEARNED_SHARE * done / len(splits), "learn the likelihood"
        shape, constraints = _learn(rest, _mirrored(rest, markers), seed)
        rigid_bodies = None if whole is None else learn_rigid_bodies(rest, shape.radius) or whole
        # On rigid bodies frames are named several times as fast.
        count = LEARN.max_frames
        if rigid_bodies is None:
            count = min(count, LEARN.max_labels // len(markers))
        tested = tested[rng.choice(len(tested), count, replace=len(tested) < count)]
        if len(subjects) == 1 and rigid_bodies is None:
            tested = as_other_subjects(shape, tested, rng)
        for trial, usual in _trials(tested, rigid_bodies is None, rng):
            works.append(TrialWork(markers, shape, constraints, rigid_bodies, trial, usual))
    return works


def _trials(tested: np.ndarray, crowds: bool, rng: np.random.Generator) -> Iterator[tuple[Trial, bool]]:
    """What the frames (T, M, 3) are tried as, and whether that is usual: without ghosts, with a few, in a crowd."""
    hidden = 0, round(tested.shape[1] * LEARN.max_hidden)
    for ghosts in (0, MAX_GHOSTS):
        half = tested[ghosts > 0 :: 2]
        if len(half):
            yield make_trial(half, hidden, (0, ghosts), rng), True
    some = tested[::CROWD_EVERY]
    if crowds:
        most = min(CROWD_MARKERS * tested.shape[1], MAX_CROWD)
        yield crowded(make_trial(some, hidden, (0, 0), rng), some, most, rng), False


def _splits(subjects: list[np.ndarray]) -> list[tuple[list[np.ndarray], np.ndarray]]:
    """What is learned from and the frames (T, M, 3) that are tested then, so that every subject is tested once.

    But those without whom too few frames are left, or who alone show a marker: nobody else could teach it.
    """
    shown = np.array([np.isfinite(points[..., 0]).any(axis=0) for points in subjects])
    frames = np.array([len(points) for points in subjects])
    needed = (shown & (shown.sum(axis=0) == 1)).any(axis=1) | (frames.sum() - frames < LEARN.min_frames)
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
