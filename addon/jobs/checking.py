# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether training on made a model worse: labelled takes are labelled again by the model before and the one after."""

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError, UserError
from ..core.data.lanes import Lanes
from ..core.data.progress import Progress, within
from ..core.data.takes import Points, evenly_spread
from ..core.evaluation.comparing import Comparison, TakeDifference
from ..core.evaluation.relabelling import NO_NAME, UNTOLD, KnownNames, relabelled, without_names
from ..core.points.models import Model, TaughtTake, TrainingTake, by_subject
from ..core.training.takes import standing_apart
from ..io.model_history import seen_at, seen_from
from ..io.points import read_points
from ..io.source import digest, is_still
from .training_takes import KnownBetter, TakeFile, read_takes, suits, trajectories_of

KEPT, TAUGHT, FRAMES = "kept", "taught", "frames"


# What a training on is checked by beside the takes that are kept for it; assumed, by the time that it takes.
MAX_TAUGHT = 6  # takes that earlier trainings learned from, spread over them
CHECKED_FRAMES = (
    60  # of each subject none of whose takes is there: of what the model itself keeps, each named on its own
)
MAX_SUBJECTS_UNSEEN = 12  # subjects of whom such frames are taken


@dataclass(frozen=True, eq=False)
class TakesToCheck:
    """Takes whose names are known, each with where its names are from, and those that are left out, with the reason."""

    takes: tuple[tuple[KnownNames, str], ...]
    left_out: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class KeptFile:
    """A take that a model is checked on, and its file."""

    path: Path
    take: TaughtTake


def kept_file(path: Path, out: Path, known: KnownBetter, subjects: Sequence[tuple[str, str]] = ()) -> KeptFile:
    """A labelled take that a model at `out` is to be checked on, of one of `subjects`; InputError if it is none."""
    sha256 = digest(path)
    (take,) = read_takes([path], [one for one in subjects if suits(path, one[1])], {path: known})
    return KeptFile(path, as_taught(take, sha256, out, known))


def files_of(takes: Iterable[TaughtTake], model: Path) -> list[KeptFile]:
    """The takes of a model's history of which it is known where they are."""
    places = ((seen_at(take.path, model), take) for take in takes)
    return [KeptFile(path, take) for path, take in places if path is not None]


def as_taught(take: TakeFile, sha256: str, out: Path, known: KnownBetter) -> TaughtTake:
    """A take as the history of a model at `out` says it; one without a digest is of no file."""
    path = seen_from(out, take.path) if sha256 else ""
    return TaughtTake(take.name, take.subject, len(take.xyz), sha256, path, known.up or "", known.rate or 0.0)


def takes_to_check(
    base: Model, file: Path, kept: Sequence[KeptFile], given: Sequence[TakeFile], replaced: Sequence[TrainingTake]
) -> TakesToCheck:
    """What a training on of the model `base` in a file, which is taught the takes `given`, is checked by.

    The takes `kept` for it; of those that it was taught before the ones that are where they were, as they were; and of
    subjects of whom there is none what the model keeps of them. What is given again is not among them, nor what was
    `replaced`: its names were wrong.
    """
    wrong = {(one.subject, one.takes) for one in replaced}
    passed = {take.path.resolve() for take in given} | {one.path.resolve() for one in kept}
    taught = [
        one
        for one in files_of(base.history.taught, file)
        if one.path.resolve() not in passed
        and (one.take.subject, (one.take.name,)) not in wrong
        and _is_there(one.path)
    ]
    few = [taught[place] for place in evenly_spread(len(taught), MAX_TAUGHT).tolist()]
    lost = [take for take in base.history.kept_takes if seen_at(take.path, file) is None]
    found, left_out, there = [], [(take.name, "nobody knows where it is") for take in lost], set()
    for one, kind in (*((one, KEPT) for one in kept), *((one, TAUGHT) for one in few)):
        try:
            found.append((_known_names(one, kind == KEPT), kind))
            there.add(one.take.subject)
        except UserError as error:
            left_out.append((one.take.name, error.message.partition(";")[0]))
    rows = [one for one in base.training_takes if (one.subject, one.takes) not in wrong and one.subject not in there]
    unseen = list(by_subject(rows).items())[:MAX_SUBJECTS_UNSEEN]
    found += [(_frames_of(subject, points, base.markerset.markers), FRAMES) for subject, points in unseen]
    return TakesToCheck(tuple(found), tuple(left_out))


def _is_there(path: Path) -> bool:
    """Whether there is such a file; a folder on a network that went away has none."""
    try:
        return path.is_file()
    except OSError:
        return False


def _known_names(one: KeptFile, by_hand: bool) -> KnownNames:
    """A take as if nobody had named it, and its names; InputError where it is not as it was.

    In one whose names were looked at what has none is nothing. Elsewhere nobody knows.
    """
    path = one.path
    if not is_still(path, one.take.sha256):
        raise InputError("was changed since; expected it as it was, or given again to be kept")
    known = KnownBetter(one.take.up or None, one.take.rate or None)
    (take,) = read_takes([path], [(one.take.subject, "*")], {path: known})
    points = read_points(path, up=known.up, rate=known.rate)
    bare = [name.rpartition(":")[2] for name in points.names]
    apart = standing_apart([take], take.names)
    there = [place for place in trajectories_of(points, one.take.subject) if bare[place] not in apart]
    picked = points.picked(there)
    measured = np.isfinite(picked.xyz).all(axis=2) & (picked.residual != 0)  # what was filled is no point
    picked = Points(
        picked.names,
        np.where(measured[..., None], picked.xyz, np.nan),
        picked.residual,
        points.rate,
        points.first_frame,
    )
    truth = np.full(measured.shape, NO_NAME if by_hand else UNTOLD)
    for column, place in enumerate(there):
        if bare[place] in take.names:
            # Of what is doubtful, and nobody looked at, the name is not known.
            number = take.names.index(bare[place])
            truth[:, column] = np.where(np.isfinite(take.xyz[:, number, 0]), number, UNTOLD)
        elif bare[place]:
            truth[:, column] = UNTOLD  # it is there twice
    return without_names(take.name, take.names, picked, truth)


def _frames_of(subject: str, points: np.ndarray, names: tuple[str, ...]) -> KnownNames:
    """What a model keeps of a subject, (F, M, 3) m, as frames that have nothing to do with each other."""
    xyz = points[evenly_spread(len(points), CHECKED_FRAMES)]
    frames, markers = xyz.shape[:2]
    order = np.random.default_rng(frames).permuted(np.tile(np.arange(markers), (frames, 1)), axis=1)
    xyz = np.take_along_axis(xyz, order[..., None], axis=1)
    frame, lane = np.nonzero(np.isfinite(xyz).all(axis=2))
    unnamed = Points(
        ("",) * len(frame),
        xyz,
        np.where(np.isfinite(xyz[..., 0]), 0.0002, np.nan),
        100.0,
        1,
        np.arange(len(frame)),
        Lanes(lane, frame, frame),
    )
    return KnownNames(f"frames of {subject}", names, unnamed, order)


def checking(before: Model, after: Model, check: TakesToCheck) -> Generator[Progress, None, Comparison]:
    """Labels the takes again by both models. Markers that the new one was not to have are not missed."""
    markers, takes = after.markerset.markers, check.takes
    differences = []
    for number, (take, kind) in enumerate(takes):
        counts = []
        for way, model in enumerate((before, after)):
            first, last = ((2 * number + way + one) / (2 * len(takes)) for one in (0, 1))
            yield Progress(first, f"label {take.name} anew")
            counts.append((yield from within(relabelled(take, model, markers), first, last)))
        differences.append(TakeDifference(take.name, kind, len(take.truth), *counts))
    return Comparison(markers, tuple(differences), check.left_out)
