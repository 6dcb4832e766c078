# SPDX-License-Identifier: GPL-3.0-or-later
"""Which tracklets are on the same body: those that stay near each other and keep their distance, over all of the take.

Before anything is named. Two markers of one person are never far from each other, and most distances on a body keep;
between people they do not keep unless both stand still, and then there is room between them: in frames in which bodies
are apart they are groups of points on the floor. From the frame in which they are farthest from each other they are
followed, as long as nobody can have become another body, or a thing, between two frames that are looked at. A tracklet
goes with those of the strongest affinity while it is there; these live on when it ends, so people are followed through
contact. How many bodies a take may show is said by groups of points that are apart, and by how many go together at all.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ...data.lanes import blocks
from ...data.made import Table
from ...data.physical import MARKER_LIMITS
from ...data.takes import evenly_spread
from ..refusals import far_groups
from .affinity import AFFINE_TRACKLETS, Affinity
from .wearers import MAX_SUBJECTS


class PARTING_PEOPLE:
    """What a body shows of itself, how bodies are told apart by where they are, and tracklets parted into bodies."""

    # part of the usual affinity of a tracklet to others, below which it is a ghost
    firm: float = 0.2  # measured: half or twice names eight meetings alike
    often: float = 0.05  # part of the frames in which so many are apart; measured: as firm
    # part of the points that are not farther out than where another body is looked for, as ghosts are; 0.8 and 0.97
    # part 20 kinds of meetings worse, by 0.3 and 0.1 % of the points
    outer: float = 0.9  # measured
    # frames in a row without somebody, after which nobody is followed any more; where they are followed on, 1 % more of
    # the points of meetings are on the wrong body
    missed: int = 4  # measured
    # part of the tracklets that were one body's, beyond which nobody is followed any more where they are another's, on
    # `lying` of tests/accuracy/actors.py: who lies has feet where somebody else may stand
    gone_over: float = 0.03  # measured
    # times the affinity to any other body that a tracklet's affinity to one must be, to be that one's alone; in 20
    # kinds of meetings 1.3 has a tenth more points on the wrong body alone, 2.2 twice as many on several
    clear: float = 1.6  # measured
    # part of a tracklet's strongest affinity, below which it is not on a body
    on_body: float = 0.5  # measured of 0.3 to 0.8 on `returning` and `returning-acting` of tests/accuracy/actors.py


NO_BODY = -1
FRAMES_COUNTED = 80  # that are looked at
PLACES_TRIED = 60  # frames in which bodies are looked for first, spread over the take; by time
GROUPING_ROUNDS = 20  # in which such a frame's points find their bodies; it is still before
POINTS_OF_BODY = 4  # of a body in a frame
GIVEN_TOGETHER = 0.5  # part of the clearest lead from which on tracklets are given to bodies together; by time
MAX_PRESENCES = 24  # of all together; by time
# A direction on the floor between an axis of the room and a diagonal: few stand level with each other along it.
ASKEW = np.array([np.cos(np.pi / 8), np.sin(np.pi / 8)])


def count_bodies(points: Table, tracklet: np.ndarray, affinity: Affinity, markers: int) -> tuple[int, int]:
    """How many bodies with so many markers are apart at some time, and the most that there may be.

    In points (T, L, 3) m of tracklets (T, L), -1 where there is none.
    """
    firm = np.append(firm_tracklets(affinity), False)[tracklet]
    frames = evenly_spread(len(points), FRAMES_COUNTED)
    sizes, present = [], []
    for frame in frames.tolist():
        own = points[frame][firm[frame]]
        present.append(len(own))
        sizes.append(len(far_groups(own, MARKER_LIMITS.limb_m, most_of(markers))))
    groups = np.sort(sizes)[::-1]
    apart = int(groups[int(PARTING_PEOPLE.often * len(groups))])
    most = round(float(np.quantile(present, 1 - PARTING_PEOPLE.often)) / markers)
    return apart, min(max(most, 1), MAX_SUBJECTS)


def firm_tracklets(affinity: Affinity) -> np.ndarray:
    """(N,) True for the tracklets whose affinity to others is that of markers on a body."""
    strength = affinity.best()
    usual = np.median(strength[strength > 0]) if (strength > 0).any() else 0.0
    return strength >= PARTING_PEOPLE.firm * usual


def is_whole(there: np.ndarray, markers: int) -> bool:
    """Whether a body is one, and no half, of a set of so many markers, by the points (T, L) of it that are there."""
    return usual_count(there.sum(axis=1)) > markers / 2  # which is no whole number


def most_of(markers: int) -> int:
    """The fewest points that are more than half of so many markers: of who is parted one side at most has them."""
    return markers // 2 + 1


def usual_count(counts: np.ndarray) -> float:
    """How many there are where most are there: the upper quartile of counts (T,), but for those of 0."""
    counts = counts[counts > 0]
    return float(np.quantile(counts, 0.75)) if len(counts) else 0.0


def along_the_line(points: Table, body: Table, markers: Sequence[int]) -> list[int] | None:
    """The bodies in the order in which they stand along a line on the floor, in the first frame that shows them all.

    Of points (T, L, 3) m of bodies (T, L), NO_BODY for nobody's. A body is shown by most of the so many markers that it
    wears. None where no frame shows them all.
    """
    for part in blocks(*body.shape):
        own = body[part]
        shown = [(own == one).sum(axis=1) >= most_of(worn) for one, worn in enumerate(markers)]
        if frames := np.flatnonzero(np.all(shown, axis=0)).tolist():
            along, whose = points[part.start + frames[0]][:, :2] @ ASKEW, own[frames[0]]
            return np.argsort([np.median(along[whose == one]) for one in range(len(markers))]).tolist()
    return None


def bodies_by_place(points: Table, tracklet: np.ndarray, frames: np.ndarray, every: int, count: int) -> np.ndarray:
    """(N,) the body of each of `every` tracklet to begin with, NO_BODY where its place does not say it.

    Of points (T, L, 3) m of tracklets (T, L) in the frames (F,) that are looked at, for so many bodies.
    """
    best, chosen = -1.0, None
    for place in evenly_spread(len(frames), PLACES_TRIED).tolist():
        own = tracklet[frames[place]] >= 0
        group, apart = grouped(points[frames[place]][own], count)
        if group is not None and apart > best:
            best, chosen = apart, (place, own, group)
    body = np.full(every, NO_BODY)
    if chosen is None:
        return body
    place, own, group = chosen
    flat = points[frames[place], own, :2]
    centres = _middles(flat, group, count)
    fewest = np.bincount(group, minlength=count) / 2
    votes = np.zeros((every, count), int)
    for way in (frames[place:], frames[place::-1]):
        _follow(points, tracklet, way.tolist(), centres, fewest, votes)
    clear = (votes > 0).sum(axis=1) == 1
    body[clear] = votes[clear].argmax(axis=1)
    sure = _are_inside(flat, group, centres)
    body[tracklet[frames[place], own][sure]] = group[sure]
    return body


def _follow(
    points: Table,
    tracklet: np.ndarray,
    frames: Iterable[int],
    centres: np.ndarray,
    fewest: np.ndarray,
    votes: np.ndarray,
):
    """Adds to votes (N, K) whose each tracklet is by frames from that with centres (K, 2) on, while all are apart.

    A body of fewer than the `fewest` (K,) points is not there.
    """
    missed, count = 0, len(centres)
    for frame in frames:
        own = tracklet[frame] >= 0
        flat = points[frame, own, :2]
        group = _away(flat, centres).argmin(axis=1)
        if (np.bincount(group, minlength=count) < fewest).any():
            missed += 1
            if missed > PARTING_PEOPLE.missed:
                return
            continue
        missed, centres = 0, _middles(flat, group, count)
        if _between(centres).min() < MARKER_LIMITS.trunk_m:
            return
        sure = _are_inside(flat, group, centres)
        own, group = tracklet[frame, own][sure], group[sure]
        known = votes[own].any(axis=1)
        gone_over = known & (votes[own].argmax(axis=1) != group)
        if gone_over.sum() > PARTING_PEOPLE.gone_over * known.sum():
            return
        votes[own, group] += 1


def grouped(points: Table, count: int) -> tuple[np.ndarray | None, float]:
    """Points (P, 3) m in `count` groups on the floor (P,), and how far these are from each other, for their widths."""
    if len(points) < 2 * count:
        return None, 0.0
    flat, options = points[:, :2], PARTING_PEOPLE
    far = int(options.outer * len(flat))
    centres = _middle(flat)[None]
    for place in range(count):
        away = _away(flat, centres).min(axis=1)
        centres = np.concatenate([centres[:place], flat[away.argsort()[far]][None]])
    group = np.zeros(0, int)
    for _ in range(GROUPING_ROUNDS):
        before, group = group, _away(flat, centres).argmin(axis=1)
        if np.array_equal(before, group):
            break
        if np.bincount(group, minlength=count).min() < POINTS_OF_BODY:
            return None, 0.0
        centres = _middles(flat, group, count)
    size = np.bincount(group, minlength=count)
    # The usual lead of a point's own group, where groups are of like size.
    usual = np.quantile(_leads(_away(flat, centres), group), 1 - options.outer)
    return group, float(usual * size.min() / size.max())


def _between(centres: np.ndarray) -> np.ndarray:
    """(K,) how far each of centres (K, 2) is from the next."""
    between = _away(centres, centres)
    np.fill_diagonal(between, np.inf)
    return between.min(axis=1)


def _are_inside(flat: np.ndarray, group: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """(P,) True for points (P, 2) nearer to the middle of their group (P,) than half-way to the next."""
    return _leads(_away(flat, centres), group) >= _between(centres)[group] / 2


def _leads(away: np.ndarray, group: np.ndarray) -> np.ndarray:
    """(P,) by how much points, away (P, K) from centres, are nearer to that of their group (P,) than to any other."""
    own = np.take_along_axis(away, group[:, None], axis=1)[:, 0]
    return np.where(np.arange(away.shape[1]) == group[:, None], np.inf, away).min(axis=1) - own


def _middles(flat: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """(K, 2) those of so many groups (P,) of points (P, 2)."""
    return np.array([_middle(flat[group == one]) for one in range(count)])


def _middle(flat: np.ndarray) -> np.ndarray:
    """(2,) the median of each column of (P, 2): NumPy's takes longer over few points than all else here."""
    order = np.sort(flat, axis=0)
    return (order[(len(order) - 1) // 2] + order[len(order) // 2]) / 2


def _away(flat: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """(P, K) how far points (P, 2) are from centres (K, 2)."""
    off = flat[:, None] - centres
    return np.sqrt(off[..., 0] ** 2 + off[..., 1] ** 2)


@dataclass(frozen=True, eq=False)
class PartedBodies:
    """N tracklets parted among K bodies, or presences of bodies."""

    body: np.ndarray  # (N,) that of the strongest affinity, NO_BODY where there is none
    may: np.ndarray  # (N, K) True for the bodies that it may be on: one where that is clear, else several

    def joined(self, whose: np.ndarray, count: int) -> "PartedBodies":
        """The same of so many bodies, where each of the K is a presence (K,) of one; of NO_BODY, nobody's."""
        own = whose[:, None] == np.arange(count)
        body = np.where(self.body == NO_BODY, NO_BODY, whose[self.body])
        return PartedBodies(body, (self.may[:, :, None] & own).any(axis=1))


def parted(points: Table, tracklet: np.ndarray, affinity: Affinity, count: int, markers: int) -> PartedBodies:
    """Tracklets (T, L) of points (T, L, 3) m parted among so many bodies; of one they are all.

    Whoever leaves and comes back has no tracklet of before: where so many `markers` as a set has are on none of the
    bodies, they are a presence that comes after the bodies that are seen together.
    """
    if count == 1:
        return PartedBodies(np.zeros(len(affinity), int), np.ones((len(affinity), 1), bool))
    begun = bodies_by_place(points, tracklet, affinity.frames, len(affinity), count)
    body = _with_presences(points, tracklet, affinity, begun, count, markers)
    count = max(count, int(body.max(initial=-1)) + 1)
    strength_to = affinity.on(_grown(affinity, body, count), count)
    most = strength_to.max(axis=1, keepdims=True)
    body = np.where(most[:, 0] > 0, strength_to.argmax(axis=1), NO_BODY)
    return PartedBodies(body, (strength_to * PARTING_PEOPLE.clear >= most) & (most > 0))


def _with_presences(
    points: Table, tracklet: np.ndarray, affinity: Affinity, body: np.ndarray, count: int, markers: int
) -> np.ndarray:
    """(N,) bodies of tracklets, from those known on; presences of whoever comes, or comes back, are further ones."""
    best, firm = affinity.best(), firm_tracklets(affinity)
    while count < MAX_PRESENCES:
        body = _grown(affinity, body, count, PARTING_PEOPLE.on_body * best)
        left = np.append((body == NO_BODY) & firm, False)
        groups = _coming(points, tracklet, affinity, left, markers)
        if not groups:
            break
        for group in groups:
            body[group] = count
            count += 1
    return body


def _coming(
    points: Table, tracklet: np.ndarray, affinity: Affinity, left: np.ndarray, markers: int
) -> list[np.ndarray]:
    """The tracklets of each who is there in the frame that shows best how many of `markers` are on no body yet.

    left (N + 1,) are those that are on none; the last is no tracklet.
    """
    alone = left[tracklet[affinity.frames]].sum(axis=1)
    frame, most = affinity.frames[alone.argmax()], alone.max()
    if most < most_of(markers):
        return []
    people = max(round(most / markers), 1)
    if people > 1:
        full = affinity.frames[alone >= most_of(people * markers)]
        best = -np.inf
        for at in full[evenly_spread(len(full), PLACES_TRIED)].tolist():
            own = np.flatnonzero(left[tracklet[at]])
            group, apart = grouped(points[at, own], people)
            if group is not None and apart > best:
                best, found = apart, [tracklet[at, own[group == one]] for one in range(people)]
        if best > -np.inf:
            return [some for some in found if len(some) >= most_of(markers)]
    own = np.flatnonzero(left[tracklet[frame]])
    groups = far_groups(points[frame, own], MARKER_LIMITS.limb_m, most_of(markers))
    return [tracklet[frame, own[group]] for group in groups]


def _grown(affinity: Affinity, body: np.ndarray, count: int, least: np.ndarray | float = 0.0) -> np.ndarray:
    """(N,) bodies of all tracklets, from those known on: always the one next whose affinity to a body is clearest.

    Without those whose affinity to none is `least` (N,).
    """
    body = body.copy()
    top = np.zeros((len(body), count, AFFINE_TRACKLETS))
    for index in np.flatnonzero(body != NO_BODY).tolist():
        _add_to_best(top, *affinity.of_tracklet(index), body[index])
    left = body == NO_BODY
    while left.any():
        strength_to = top.mean(axis=2)
        order = np.sort(strength_to, axis=1)
        lead = (order[:, -1] - order[:, -2]) * (left & (order[:, -1] >= least))
        if lead.max() <= 0:
            break
        some = np.flatnonzero(left & (lead >= GIVEN_TOGETHER * lead.max()))
        for index in some.tolist():
            body[index] = strength_to[index].argmax()
            left[index] = False
            _add_to_best(top, *affinity.of_tracklet(index), body[index])
    return body


def _add_to_best(top: np.ndarray, others: np.ndarray, strength: np.ndarray, body: int):
    """Puts the affinities (K,) of others to one more tracklet of a body among the strongest to it, top (N, B, H)."""
    own = top[others, body]
    rows, least = np.arange(len(own)), own.argmin(axis=1)
    own[rows, least] = np.maximum(own[rows, least], strength)
    top[others, body] = own
