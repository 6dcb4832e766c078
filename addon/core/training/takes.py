# SPDX-License-Identifier: GPL-3.0-or-later
"""Labelled takes to learn from: what of each is worth it, whether they go together, what a model keeps and replaces."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..data.lanes import PACKING
from ..data.physical import MARKER_LIMITS
from ..data.takes import evenly_spread
from ..data.wording import listed
from ..geometry.rigid import pairwise_distances
from ..points.likelihood.learn import LEARN
from ..points.models import TrainingTake, by_subject
from .contradictions import contradictions, leads
from .spread import MAJORITY

CELLS_A_SIDE = 1 << 20  # so many cells of space along an axis have a number of their own


class KEEPING:
    """What goes together and what is kept."""

    # of a take to the others, and of them to it
    max_size_ratio: float = 5.0  # physical: people differ by two, units by ten
    considered_frames: int = 4000  # spread over a subject's takes, of which those are chosen; memory


@dataclass(frozen=True, eq=False)
class LabelledTake:
    """One labelled take."""

    name: str  # of its file
    subject: str  # the id of whose it is
    names: tuple[str, ...]  # P, every marker once
    xyz: np.ndarray  # (T, P, 3) m, NaN where missing
    doubts: tuple[str, ...] = ()  # what is doubtful in it, in sentences


def learnable(xyz: np.ndarray, doubtful: np.ndarray, names: Sequence[str]) -> tuple[np.ndarray, tuple[str, ...]]:
    """What is worth learning of markers (T, M, 3) m that were measured, NaN elsewhere, and what to say of the rest.

    A program that learns its own mistakes makes them again, surer than before. So what is `doubtful` (T, M) and nobody
    looked at is left out, and reported; what a person named, or confirmed, is to be no doubt any more. A marker with
    fewer samples than any model is learned from is reported, too, and stays in the set as it was known before.
    """
    seen = np.isfinite(xyz).all(axis=2)
    left_out, doubts = (seen & doubtful).sum(axis=0), []
    if left_out.any():
        who = listed([names[index] for index in np.argsort(-left_out, kind="stable") if left_out[index]])
        many = "frame that nobody looked at was" if left_out.sum() == 1 else "frames that nobody looked at were"
        doubts.append(
            f"{who}: {left_out.sum()} doubtful {many} not learned; correct them or say It Is Right, and learn again"
        )
    counts = (seen & ~doubtful).sum(axis=0)
    few = counts < min(LEARN.min_frames, max(len(xyz), 1))
    never = [name for name, one in zip(names, counts == 0, strict=True) if one]
    hardly = [f"{name} ({count})" for name, count, one in zip(names, counts, few, strict=True) if one and count]
    if never:
        doubts.append(f"{listed(never)}: found in no frame that could be learned, so what was known before stays")
    if hardly:
        doubts.append(f"{listed(hardly)}: found in hardly any frames that could be learned, so little is new of them")
    return np.where((seen & doubtful)[..., None], np.nan, xyz), tuple(doubts)


def odd_size(takes: Sequence[np.ndarray]) -> tuple[int, float] | None:
    """The first of points (T, P, 3) that are far larger or smaller than most of them, and how many times as large."""
    sizes = np.array([_size(points) for points in takes])
    ratios = sizes / float(np.median(sizes))
    odd = np.flatnonzero((ratios <= 1 / KEEPING.max_size_ratio) | (ratios >= KEEPING.max_size_ratio))
    return (int(odd[0]), float(ratios[odd[0]])) if len(odd) else None


def _size(points: np.ndarray) -> float:
    """m, how far the markers of a frame reach."""
    points = points[np.isfinite(points).any(axis=(1, 2))]
    away = points - np.nanmean(points, axis=1, keepdims=True)
    return max(float(np.nanmedian(np.linalg.norm(away, axis=2))), 1e-9)


def gathered(takes: Sequence[LabelledTake], markers: Sequence[str]) -> dict[str, np.ndarray]:
    """The points (T, M, 3) m of every subject, all takes after one another, NaN where missing."""
    parts: dict[str, list[np.ndarray]] = {}
    for take in takes:
        parts.setdefault(take.subject, []).append(_points(take, markers))
    return {subject: np.concatenate(own) for subject, own in parts.items()}


def _points(take: LabelledTake, markers: Sequence[str]) -> np.ndarray:
    """The points (T, M, 3) m of a take in the frames that show any."""
    points = _of_markers(take.xyz, take.names, markers)
    return points[np.isfinite(points).all(axis=2).any(axis=1)]


def _of_markers(points: np.ndarray, names: Sequence[str], markers: Sequence[str]) -> np.ndarray:
    """(T, M, 3) of points (T, P, 3) those that are called as the markers, NaN for names that are not there."""
    columns = np.array([names.index(marker) if marker in names else -1 for marker in markers])
    return np.where((columns >= 0)[:, None], points[:, columns], points.dtype.type(np.nan))


def standing_apart(takes: Sequence[LabelledTake], markers: Sequence[str]) -> tuple[str, ...]:
    """The names among the markers' that are of nothing on the subject: two of their three axes are zero in all frames.

    Programs keep heights and angles in trajectories too, as one number and two zeros. So is what is farther from all
    others than any two of these are from each other, such as one in another unit.
    """
    shown = np.concatenate([_points(take, markers) for take in takes])
    seen = np.isfinite(shown).all(axis=2)
    zero = (np.where(seen[..., None], shown, 0) == 0).all(axis=0).sum(axis=1)
    nothing = ((zero >= 2) | _far_off(shown)) & seen.any(axis=0)
    return tuple(name for name, one in zip(markers, nothing, strict=True) if one)


def _far_off(points: np.ndarray) -> np.ndarray:
    """(M,) True for the markers that in all frames, of points (T, M, 3) m, are farther off than the others are wide."""
    size = points.shape[1]
    nearest, widest = np.full((size, size), np.inf), np.zeros((size, size))
    for frame in points[evenly_spread(len(points), PACKING.spread_out)]:
        apart = pairwise_distances(frame)
        nearest, widest = np.fmin(nearest, apart), np.fmax(widest, apart)
    np.fill_diagonal(nearest, np.inf)
    least = MARKER_LIMITS.limb_m
    others = (np.delete(np.delete(widest, marker, 0), marker, 1).max(initial=least) for marker in range(size))
    nearest = nearest.min(axis=1, initial=np.inf)
    return np.isfinite(nearest) & (nearest > np.fromiter(others, float, size))


def of_markers(
    training_takes: Sequence[TrainingTake], known: Sequence[str], markers: Sequence[str]
) -> list[TrainingTake]:
    """Training takes of the markers `known` as training takes of `markers`: what was not known is missing."""
    return [replace(take, points=_of_markers(take.points, known, markers)) for take in training_takes]


def contradicted(
    takes: Sequence[LabelledTake], markers: Sequence[str], before: Sequence[TrainingTake] = ()
) -> list[str]:
    """Takes whose labels contradict those of the others, or what a model learned `before`, in sentences."""
    whose = [take.name for take in takes]
    points = [_points(take, markers) for take in takes]
    for subject, kept in by_subject(before).items():
        whose.append(f"what is known of {subject}")
        points.append(kept)
    there = [index for index, own in enumerate(points) if len(own)]
    found = contradictions([leads(points[index]) for index in there])
    found_pairs: dict[str, None] = {}
    for index, groups in zip(there, found, strict=True):
        for group in groups:
            names = " and ".join(markers[place] for place in group)
            where = f"{whose[index]}, if the others are right"
            if len(there) == 2:
                # Each contradicts the other, and nobody knows which of them is wrong.
                where = f"one of {whose[there[0]]} and {whose[there[1]]}"
            found_pairs[f"{names} have each other's names in {where}: look at them, and train again if so"] = None
    return list(found_pairs)


def training_takes_of(takes: Sequence[LabelledTake], markers: Sequence[str]) -> list[TrainingTake]:
    """What a model keeps of these takes: of each subject the most different frames, a row a take."""
    kept = []
    for subject in dict.fromkeys(take.subject for take in takes):
        own = [take for take in takes if take.subject == subject]
        parts = [_points(take, markers) for take in own]
        points, ends = np.concatenate(parts), np.cumsum([len(part) for part in parts])
        chosen = most_different(points)
        for take, part, rows in zip(own, parts, np.split(chosen, np.searchsorted(chosen, ends[:-1])), strict=True):
            kept.append(TrainingTake(subject, (take.name,), len(part), points[rows].astype(np.float32)))
    return kept


def most_different(points: np.ndarray, count: int = PACKING.spread_out) -> np.ndarray:
    """Which frames of (T, M, 3), in their order, up to `count`: half of them evenly spread, half the least alike."""
    even = evenly_spread(len(points), KEEPING.considered_frames)
    points = points[even]
    if len(points) <= count:
        return even
    flat = np.nan_to_num(points - np.nanmean(points, axis=1, keepdims=True)).reshape(len(points), -1).astype(np.float32)
    chosen = list(evenly_spread(len(points), count // 2))
    nearest = np.full(len(points), np.inf)
    for index in chosen:
        nearest = np.minimum(nearest, np.square(flat - flat[index]).sum(axis=1))
    while len(chosen) < count:
        index = int(nearest.argmax())
        chosen.append(index)
        nearest = np.minimum(nearest, np.square(flat - flat[index]).sum(axis=1))
    return even[np.sort(chosen)]


def without_replaced(
    before: Sequence[TrainingTake], takes: Sequence[LabelledTake]
) -> tuple[list[TrainingTake], list[TrainingTake], list[str]]:
    """What a model keeps of earlier takes, without those that are given again with other labels: left, gone, doubts.

    A take is given again where its name and subject are the same and its points are, whatever they are called.
    """
    left, gone, doubts = [], [], []
    for kept in before:
        again = [take for take in takes if (take.subject, (take.name,)) == (kept.subject, kept.takes)]
        if any(_same_points(kept.points, take.xyz) for take in again):
            gone.append(kept)
            continue
        left.append(kept)
        if again:
            doubts.append(
                f"{again[0].name} of {kept.subject} is another take than the one that the model knows by that name, "
                "so both are kept"
            )
    return left, gone, doubts


def _same_points(kept: np.ndarray, points: np.ndarray) -> bool:
    """Whether the points of kept frames (F, M, 3) m are those of frames (T, P, 3) m, whatever they are called."""
    shown = kept[np.isfinite(kept).all(axis=2)]
    # A label that was corrected may hide a point or two, and a point may lie at the border of its cell.
    return bool(len(shown)) and bool(np.isin(_cells(shown), _cells(points)).mean() > MAJORITY)


def _cells(points: np.ndarray) -> np.ndarray:
    """(…,) the number of the cell of space that points (…, 3) m lie in, -1 where missing."""
    there = np.isfinite(points).all(axis=-1)
    place = np.floor(np.where(there[..., None], points, 0) / MARKER_LIMITS.noise_m).astype(np.int64) + CELLS_A_SIDE // 2
    return np.where(there, (place[..., 0] * CELLS_A_SIDE + place[..., 1]) * CELLS_A_SIDE + place[..., 2], -1)


def subject_rows(training_takes: Sequence[TrainingTake]) -> list[dict]:
    """What a model was trained on, a row a subject: `subject`, `takes`, `frames`."""
    rows: dict[str, dict] = {}
    for take in training_takes:
        row = rows.setdefault(take.subject, {"subject": take.subject, "takes": [], "frames": 0})
        row["takes"] += take.takes
        row["frames"] += take.frames
    return list(rows.values())
