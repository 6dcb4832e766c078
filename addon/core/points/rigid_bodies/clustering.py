# SPDX-License-Identifier: GPL-3.0-or-later
"""Rigid groups of trajectories in an unlabelled take, found from the steadiness of their distances."""

from dataclasses import dataclass

import numpy as np

from ...geometry.rigid import FEWEST, laid_on

MOST_FRAMES = 500  # that a take is looked at in
SHORTEST = 0.1  # s, of a tracklet that is looked at
GAP = 0.02  # s without a point after which a trajectory may go on with another marker
REACH = 0.4  # m, the widest that a rigid body is
STEADY = 0.006  # m that distances within a group vary by, in the mean
# What is taken for granted of two tracklets that were hardly seen together, m and frames.
DOUBT, DOUBTFUL_FRAMES = 0.02, 10
ROUNDS = 6
FITS = 0.01  # m, root mean square, that a tracklet may be off its place in the group
SAME = 0.012  # m between places of tracklets that are one marker's
SHARED = 0.05  # part of its frames that a tracklet may share with another of the same marker
OFTEN = 0.1  # part of a group's frames that a marker of it must be seen in
STILL = 0.02  # m that what stands about in the room moves by
MOVES = 0.1  # m that half of the groups must move by before others are said to stand still


@dataclass(frozen=True, eq=False)
class Group:
    """n markers that move as one in F frames.

    form          (n, 3) m, the markers in the group's own axes, their middle at 0
    tracklets        for each marker, the tracklets that are its
    turn, place   (F, 3, 3) and (F, 3) m, a marker is at turn @ form + place; NaN where too few are seen
    """

    form: np.ndarray
    tracklets: tuple[tuple[int, ...], ...]
    turn: np.ndarray
    place: np.ndarray

    @property
    def markers(self) -> np.ndarray:
        """(F, n, 3) m, where the group has its markers, seen or not."""
        return np.einsum("fij,nj->fni", self.turn, self.form) + self.place[:, None]


@dataclass(frozen=True, eq=False)
class Sampled:
    """Tracklets of trajectories in some of the take's frames.

    frames  (F,) which, 0-based
    number  (N,) the tracklets' numbers
    points  (F, N, 3) m, NaN where a tracklet is not there
    """

    frames: np.ndarray
    number: np.ndarray
    points: np.ndarray


def unbroken(tracklet: np.ndarray, rate: float) -> np.ndarray:
    """(T, P) tracklets (T, P), -1 where there is no point, cut again at every gap."""
    parts = np.full(tracklet.shape, -1)
    count = 0
    for column in range(tracklet.shape[1]):
        frames = np.flatnonzero(tracklet[:, column] >= 0)
        if not len(frames):
            continue
        ends = (np.diff(frames) > max(GAP * rate, 1)) | (np.diff(tracklet[frames, column]) != 0)
        parts[frames, column] = count + np.concatenate([[0], np.cumsum(ends)])
        count = int(parts[frames[-1], column]) + 1
    return parts


def sampled(points: np.ndarray, tracklet: np.ndarray, rate: float) -> Sampled:
    """The longer tracklets of a take: points (T, P, 3) m with the number of the tracklet of each (T, P), -1 for none."""
    frame, column = np.nonzero(tracklet >= 0)
    number, place, count = np.unique(tracklet[frame, column], return_inverse=True, return_counts=True)
    long = count >= SHORTEST * rate
    frames = np.unique(np.linspace(0, len(points) - 1, min(MOST_FRAMES, len(points))).round().astype(int))
    row = np.full(len(points), -1)
    row[frames] = np.arange(len(frames))
    new = np.cumsum(long) - 1
    kept = long[place] & (row[frame] >= 0)
    xyz = np.full((len(frames), int(long.sum()), 3), np.nan)
    xyz[row[frame[kept]], new[place[kept]]] = points[frame[kept], column[kept]]
    return Sampled(frames, number[long], xyz)


def find_groups(seen: Sampled) -> tuple[list[Group], list[Group]]:
    """Groups of three markers or more that move with the subject, and those that stand about in the room."""
    spread, weight, mean = _steadiness(seen.points)
    found = [_laid(seen, np.array(cluster), mean) for cluster in _clusters(spread, weight)]
    groups = [group for group in found if group is not None]
    still = _stand_still(groups)
    return (
        [group for group, stands in zip(groups, still, strict=True) if not stands],
        [group for group, stands in zip(groups, still, strict=True) if stands],
    )


def _stand_still(groups: list[Group]) -> list[bool]:
    """Of each group, whether it stands still in frames in which most others move."""
    still = []
    for group in groups:
        seen = np.isfinite(group.place[:, 0])
        moved = [_extent(other.place[seen]) for other in groups]
        still.append(bool(_extent(group.place[seen]) < STILL and np.median(moved) > MOVES))
    return still


def _extent(place: np.ndarray) -> float:
    """How far, m, a place (F, 3) moves."""
    known = place[np.isfinite(place[:, 0])]
    return float(known.std(axis=0).max()) if len(known) else 0.0


def _steadiness(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N, N) m mean absolute deviation of every distance, (N, N) how many frames tell it, and (N, N) m its mean."""
    count = points.shape[1]
    spread, weight, usual = np.zeros((3, count, count))
    for one in range(count):
        distance = np.linalg.norm(points - points[:, one : one + 1], axis=-1)
        known = np.isfinite(distance)
        frames = known.sum(axis=0)
        distance = np.where(known, distance, 0)
        mean = distance.sum(axis=0) / np.maximum(frames, 1)
        off = np.where(known, np.abs(distance - mean), 0).sum(axis=0)
        spread[one] = (off + DOUBT * DOUBTFUL_FRAMES) / (frames + DOUBTFUL_FRAMES)
        spread[one, mean > REACH] = 1.0
        weight[one] = frames
        usual[one] = np.where(frames > 0, mean, np.nan)
    np.fill_diagonal(weight, 0)
    return spread, weight, usual


def _clusters(spread: np.ndarray, weight: np.ndarray) -> list[list[int]]:
    """Tracklets grown together by mean linkage over the pairs that were seen together."""
    total, known = spread * weight, weight.copy()
    members = [[index] for index in range(len(spread))]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(known > 0, total / known, np.inf)
    while len(mean) and mean.min() < STEADY:
        one, two = np.unravel_index(mean.argmin(), mean.shape)
        members[one] += members[two]
        members[two] = []
        for table in (total, known):
            table[one] += table[two]
            table[:, one] = table[one]
            table[two], table[:, two] = 0, 0
            table[one, one] = 0
        row = np.where(known[one] > 0, total[one] / np.maximum(known[one], 1), np.inf)
        mean[one], mean[:, one] = row, row
        mean[two], mean[:, two] = np.inf, np.inf
    return [cluster for cluster in members if len(cluster) >= FEWEST]


def _strung(points: np.ndarray, distance: np.ndarray) -> list[list[int]]:
    """Tracklets (F, n, 3) of a group, with their mean distances (n, n), strung to markers: one leaves off, one begins.

    Known by being equally far from two markers or more that both were seen with.
    """
    there = np.isfinite(points[..., 0])
    frames = there.sum(axis=0)
    strings: list[list[int]] = []
    for index in np.argsort(-frames, kind="stable"):
        best, nearest = None, SAME / 2
        for one in strings:
            both = (there[:, one].any(axis=1) & there[:, index]).sum()
            off = np.abs(distance[one] - distance[index])
            off = off[:, np.isfinite(off).any(axis=0)]
            if both <= SHARED * frames[index] and off.shape[1] >= FEWEST - 1 and np.nanmax(off) < nearest:
                best, nearest = one, float(np.nanmax(off))
        if best is None:
            strings.append([int(index)])
        else:
            best.append(int(index))
    return strings


def _first_seen(points: np.ndarray) -> np.ndarray:
    """(F, 3) in each frame the first of points (F, n, 3) that is there; NaN where none is."""
    place = np.isfinite(points[..., 0]).argmax(axis=1)
    return points[np.arange(len(points)), place]


def _laid(seen: Sampled, cluster: np.ndarray, distance: np.ndarray) -> Group | None:
    """The group that a cluster of tracklets makes; None where fewer than three markers hold together."""
    strings = _strung(seen.points[:, cluster], distance[np.ix_(cluster, cluster)])
    points = np.stack([_first_seen(seen.points[:, cluster[one]]) for one in strings], axis=1)
    form = points[np.isfinite(points[..., 0]).sum(axis=1).argmax()]
    for _ in range(ROUNDS):
        turn, place = laid_on(form, points)
        local = np.einsum("fji,fnj->fni", turn, points - place[:, None])
        known = np.isfinite(local[..., 0])
        count = np.maximum(known.sum(axis=0), 1)
        mean = np.where(known[..., None], local, 0).sum(axis=0) / count[:, None]
        off = np.sqrt((np.where(known[..., None], local - mean, 0) ** 2).sum(axis=(0, 2)) / count)
        form = np.where((known.any(axis=0) & (off < FITS))[:, None], mean, np.nan)
        if np.isfinite(form[:, 0]).sum() < FEWEST:
            return None
    fine = np.flatnonzero(np.isfinite(form[:, 0]))
    there = np.isfinite(points[:, fine, 0])
    often = OFTEN * np.isfinite(place[:, 0]).sum()
    # What is there only for moments may move with the group by chance, while nothing moves.
    merged = [one for one in _merged(form[fine], there) if there[:, one].any(axis=1).sum() >= often]
    if len(merged) < FEWEST:
        return None
    middle = np.array([form[fine[one]].mean(axis=0) for one in merged])
    centre = middle.mean(axis=0)
    tracklets = tuple(
        tuple(int(seen.number[cluster[tracklet]]) for index in one for tracklet in strings[fine[index]])
        for one in merged
    )
    return Group(middle - centre, tracklets, turn, place + turn @ centre)


def _merged(form: np.ndarray, there: np.ndarray) -> list[list[int]]:
    """Tracklets (n, 3) in one place at different times, (F, n) where each is there, are one marker's."""
    made: list[list[int]] = []
    frames = there.sum(axis=0)
    for index in np.argsort(-frames):
        for one in made:
            both = (there[:, one].any(axis=1) & there[:, index]).sum()
            if np.linalg.norm(form[one].mean(axis=0) - form[index]) < SAME and both <= SHARED * frames[index]:
                one.append(int(index))
                break
        else:
            made.append([int(index)])
    return made
