# SPDX-License-Identifier: GPL-3.0-or-later
"""Labelled takes as lessons for a model: which markers, whose, and whether they can be learned from together."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError, UserError
from ..core.data.models import TrainingTake, by_subject
from ..core.training.contradictions import contradictions, leads
from ..io.names import can_be_named, written
from ..io.points import FilePoints, marker_columns, read_points

FEWEST = 4  # markers that can be told apart at all
LEAST_FRAMES = 10
OTHER_UNIT = 5.0  # times larger or smaller than the other takes: a unit was taken for another
KEPT = 600  # frames of a subject that a model keeps
LOOKED_AT = 4000  # of which those are chosen
COMPARED = 9  # frames of an earlier take that are looked for in the one that may take its place
CELL = 0.002  # m, by which points are the same
CELLS = 1 << 20  # of that size along each axis


@dataclass(frozen=True)
class Known:
    """What is known of a take better than from its file: the axis that points up, and the rate where it says none."""

    up: str | None = None
    rate: float | None = None


@dataclass(frozen=True, eq=False)
class Take:
    """One labelled take: its file, whose it is, names P, points (T, P, 3) m, and what is doubtful, in sentences."""

    path: Path
    subject: str
    names: tuple[str, ...]
    xyz: np.ndarray
    doubts: tuple[str, ...]


def read_takes(
    paths: Sequence[Path], subjects: Sequence[tuple[str, str]], known: Mapping[Path, Known] | None = None
) -> list[Take]:
    """The labelled takes, each with its subject: the first of `subjects` (id, glob) that its path suits, or its folder.

    Folders of one name are one subject. `known` is what is known better of a take than from its file.

    Raises InputError with the file where one cannot be learned from.
    """
    takes = [_read(path, subjects, (known or {}).get(path, Known())) for path in paths]
    unused = [glob for _, glob in subjects if not any(_suits(path, glob) for path in paths)]
    if unused:
        raise InputError(f"no take suits the subject {unused[0]!r}; expected a pattern such as '*/ann_*.c3d'")
    sizes = np.array([_size(take.xyz) for take in takes])
    usual = float(np.median(sizes))
    for take, size in zip(takes, sizes, strict=True):
        if not usual / OTHER_UNIT < size < usual * OTHER_UNIT:
            raise InputError(
                f"is {size / usual:.3g} times as large as the other takes, so its unit was not understood; "
                "expected a file that says its unit",
                take.path,
            )
    return takes


def _read(path: Path, subjects: Sequence[tuple[str, str]], known: Known) -> Take:
    try:
        points = read_points(path, up=known.up, rate=known.rate)
        names, xyz, doubled = _named(points)
    except UserError as error:
        raise error if error.file else type(error)(error.message, path) from None
    if len(xyz) < LEAST_FRAMES:
        raise InputError(
            f"has {len(xyz)} {'frame' if len(xyz) == 1 else 'frames'}; expected {LEAST_FRAMES} or more that show the "
            "markers moving",
            path,
        )
    folder = path.resolve().parent.name or "subject"  # of a drive there is no name
    subject = next((name for name, glob in subjects if _suits(path, glob)), folder)
    doubts = [f"{path.name} has the label {name} twice, so it was left out there" for name in doubled]
    if points.assumed:
        doubts.append(f"{path.name} names no unit, so it was taken to be in {points.assumed}")
    doubts += [f"{path.name}: {note}" for note in points.notes]
    return Take(path, written(subject), names, xyz, tuple(doubts))


def _suits(path: Path, glob: str) -> bool:
    return any(fnmatchcase(text, glob) for text in (path.name, path.as_posix(), path.resolve().as_posix()))


def _named(points: FilePoints) -> tuple[tuple[str, ...], np.ndarray, tuple[str, ...]]:
    """Bare names and points of the trajectories that are named once, and the names that are there twice."""
    kept = [index for index, name in enumerate(points.names) if name]
    if not kept:
        raise InputError("has no named markers; expected a labelled take")
    owners = {points.names[index].rpartition(":")[0] for index in kept}
    bare = [points.names[index].rpartition(":")[2] for index in kept]
    doubled = [name for name, count in Counter(bare).items() if count > 1]
    if len(owners) > 1 and len(doubled) >= FEWEST:
        raise InputError(
            f"has two subjects ({', '.join(sorted(owners)[:3])}); expected a take of one, so export them one by one"
        )
    kept = [index for index, name in zip(kept, bare, strict=True) if name not in doubled]
    if len(kept) < FEWEST:
        raise (
            InputError(f"has the label {doubled[0]} twice; expected every marker once")
            if doubled
            else InputError(f"has {len(kept)} named markers; expected {FEWEST} or more")
        )
    if not np.isfinite(points.xyz[:, kept]).any():
        raise InputError("shows none of its named markers in any frame; expected a labelled take")
    return tuple(points.names[index].rpartition(":")[2] for index in kept), points.xyz[:, kept], tuple(doubled)


def _size(xyz: np.ndarray) -> float:
    """m, how far the markers of a frame reach."""
    xyz = xyz[np.isfinite(xyz).any(axis=(1, 2))]
    away = xyz - np.nanmean(xyz, axis=1, keepdims=True)
    return max(float(np.nanmedian(np.linalg.norm(away, axis=2))), 1e-9)


def chosen_markers(takes: Sequence[Take], wanted: Sequence[str] | None, base: Sequence[str] = ()) -> tuple[str, ...]:
    """The markers to learn: `wanted`, or those of the model that is trained on, or those that all takes have.

    Raises InputError where a wanted one is nowhere, too few are common, or the takes have few of the model's.
    """
    if wanted or base:
        markers = tuple(dict.fromkeys(wanted or base))
        lacking = [name for name in markers if not any(_has(take, name) for take in takes)]
        unknown = [name for name in lacking if name not in base]
        if unknown:
            raise InputError(f"no take has a marker {unknown[0]}; expected some of {', '.join(takes[0].names[:12])}, …")
        if base and len(lacking) > len(markers) / 2:
            raise InputError(
                f"has few of the model's markers ({', '.join(base[:6])}, …); expected takes that wear them",
                takes[0].path,
            )
    else:
        common = set.intersection(*({name for name in take.names if _has(take, name)} for take in takes))
        markers = tuple(name for name in takes[0].names if name in common)
        if len(markers) < FEWEST <= min(len(take.names) for take in takes):
            one, two = _least_alike(takes)
            what = "have no marker in common" if not markers else f"have only {', '.join(markers)} in common"
            raise InputError(
                f"the takes {what} ({one.path.name}: {', '.join(one.names[:4])}, …; {two.path.name}: "
                f"{', '.join(two.names[:4])}, …); expected takes of one marker set, or --markers",
                two.path,
            )
    odd = next((name for name in markers if not can_be_named(name)), None)
    if odd is not None:
        raise InputError(
            f"has a marker {odd!r}, which has a sign that label files need; "
            'expected names without | , " or a leading *, or others chosen with --markers',
            takes[0].path,
        )
    if len(markers) < FEWEST:
        raise InputError(f"{len(markers)} markers are too few to be told apart; expected {FEWEST} or more")
    return markers


def _has(take: Take, name: str) -> bool:
    return name in take.names and bool(np.isfinite(take.xyz[:, take.names.index(name)]).any())


def _least_alike(takes: Sequence[Take]) -> tuple[Take, Take]:
    names = [set(take.names) for take in takes]
    pairs = [(one, two) for one in range(len(takes)) for two in range(one + 1, len(takes))] or [(0, 0)]
    one, two = min(pairs, key=lambda pair: len(names[pair[0]] & names[pair[1]]))
    return takes[one], takes[two]


def gathered(takes: Sequence[Take], markers: Sequence[str]) -> dict[str, np.ndarray]:
    """The points (T, M, 3) m of every subject, all takes after one another, NaN where missing."""
    parts: dict[str, list[np.ndarray]] = {}
    for take in takes:
        parts.setdefault(take.subject, []).append(_points(take, markers))
    return {subject: np.concatenate(own) for subject, own in parts.items()}


def _points(take: Take, markers: Sequence[str]) -> np.ndarray:
    """The points (T, M, 3) m of a take in the frames that show any."""
    columns = marker_columns(take.names, markers, take.path)
    points = np.where((columns >= 0)[:, None], take.xyz[:, columns], np.nan)
    return points[np.isfinite(points).all(axis=2).any(axis=1)]


def contradicted(takes: Sequence[Take], markers: Sequence[str], before: Sequence[TrainingTake] = ()) -> list[str]:
    """Takes whose labels contradict those of the others, or what a model learned `before`, in sentences."""
    whose = [take.path.name for take in takes]
    points = [_points(take, markers) for take in takes]
    for subject, kept in by_subject(before).items():
        whose.append(f"what is known of {subject}")
        points.append(kept)
    there = [index for index, own in enumerate(points) if len(own)]
    found = contradictions([leads(points[index]) for index in there])
    said = {}
    for index, groups in zip(there, found, strict=True):
        for group in groups:
            names = " and ".join(markers[place] for place in group)
            where = f"{whose[index]}, if the others are right"
            if len(there) == 2:
                # Each contradicts the other, and nobody can tell which of them is wrong.
                where = f"one of {whose[there[0]]} and {whose[there[1]]}"
            said[f"{names} have each other's names in {where}: look at them, and train again if so"] = None
    return list(said)


def training_takes_of(takes: Sequence[Take], markers: Sequence[str]) -> list[TrainingTake]:
    """What a model keeps of these takes: of each subject the most different frames, a row a take."""
    kept = []
    for subject in dict.fromkeys(take.subject for take in takes):
        own = [take for take in takes if take.subject == subject]
        parts = [_points(take, markers) for take in own]
        points, ends = np.concatenate(parts), np.cumsum([len(part) for part in parts])
        chosen = most_different(points)
        for take, part, rows in zip(own, parts, np.split(chosen, np.searchsorted(chosen, ends[:-1])), strict=True):
            kept.append(TrainingTake(subject, (written(take.path.name),), len(part), points[rows].astype(np.float32)))
    return kept


def without_replaced(
    before: Sequence[TrainingTake], takes: Sequence[Take]
) -> tuple[list[TrainingTake], list[TrainingTake], list[str]]:
    """What a model keeps of earlier takes, without those that are given again with other labels: left, gone, doubts.

    A take is given again where its name and subject are the same and its points are, whatever they are called.
    """
    left, gone, doubts = [], [], []
    for training_take in before:
        again = [
            take
            for take in takes
            if (take.subject, (written(take.path.name),)) == (training_take.subject, training_take.takes)
        ]
        if any(_same_points(training_take.points, take.xyz) for take in again):
            gone.append(training_take)
            continue
        left.append(training_take)
        if again:
            doubts.append(
                f"{again[0].path.name} of {training_take.subject} is another take than the one that the model knows by that "
                "name, so both are kept"
            )
    return left, gone, doubts


def _same_points(kept: np.ndarray, points: np.ndarray) -> bool:
    """Whether kept frames (F, M, 3) m show what frames of points (T, P, 3) m show, in any order of the points."""
    shown = kept[np.isfinite(kept).all(axis=2).any(axis=1)]
    if not len(shown):
        return False
    cells, found = _cells(points), 0
    some = shown[np.unique(np.linspace(0, len(shown) - 1, COMPARED).round().astype(int))]
    for frame in some:
        own = _cells(frame[np.isfinite(frame).all(axis=1)])
        # A label that was corrected may hide a point or two, and a point may lie at the border of its cell.
        found += np.isin(cells, own).sum(axis=1).max() > len(own) / 2
    return found > len(some) / 2


def _cells(points: np.ndarray) -> np.ndarray:
    """(…,) the number of the cell of space that points (…, 3) m lie in, -1 where missing."""
    there = np.isfinite(points).all(axis=-1)
    place = np.floor(np.where(there[..., None], points, 0) / CELL).astype(np.int64) + CELLS // 2
    return np.where(there, (place[..., 0] * CELLS + place[..., 1]) * CELLS + place[..., 2], -1)


def of_markers(
    training_takes: Sequence[TrainingTake], known: Sequence[str], markers: Sequence[str]
) -> list[TrainingTake]:
    """Lessons about the markers `known` as lessons about `markers`: what was not known is missing."""
    columns = marker_columns(known, markers)
    return [
        replace(
            training_take,
            points=np.where((columns >= 0)[:, None], training_take.points[:, columns], np.float32(np.nan)),
        )
        for training_take in training_takes
    ]


def most_different(points: np.ndarray, count: int = KEPT) -> np.ndarray:
    """Which frames of (T, M, 3), in their order, up to `count`: half of them evenly spread, half the least alike."""
    even = np.unique(np.linspace(0, len(points) - 1, min(LOOKED_AT, len(points))).round().astype(int))
    points = points[even]
    if len(points) <= count:
        return even
    flat = np.nan_to_num(points - np.nanmean(points, axis=1, keepdims=True)).reshape(len(points), -1).astype(np.float32)
    chosen = list(np.unique(np.linspace(0, len(points) - 1, count // 2).round().astype(int)))
    nearest = np.full(len(points), np.inf)
    for index in chosen:
        nearest = np.minimum(nearest, np.square(flat - flat[index]).sum(axis=1))
    while len(chosen) < count:
        index = int(nearest.argmax())
        chosen.append(index)
        nearest = np.minimum(nearest, np.square(flat - flat[index]).sum(axis=1))
    return even[np.sort(chosen)]
