# SPDX-License-Identifier: GPL-3.0-or-later
"""Which group of trajectories is which rigid body: the likeliest assignment of all, and how far it leads."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from .steady import Group
from .structure import LEAST_TURN, Structure, find_joints, signed_volumes

NO_GROUP = -1
BEAM = 2000
QUANTILES = np.linspace(2, 98, 9)  # of a distance over the take
FAR_OFF = 8.0  # the most that one tracklet of evidence costs
UNSEEN = -9.0  # log likelihood of a rigid body that the take does not show as a group
TOLD = 3  # distances, and volumes, that say all there is; more say partly the same
FORM_SD = 0.012  # m that sorted distances within a rigid body differ by between people's rigid bodies
ODD_MARKER = 0.7  # what a marker more or fewer costs
WIDEST = 12  # markers of a group that is looked at
MIRRORED = 2.5  # the most that one volume says against: limbs cross over now and then
JOINT_WORTH = 2.0
ARM_SD, ARM_TURN_SD = 0.04, 0.02  # m, and m rad: what is known of a joint's place grows with the turn
MISS_SHARE, MISS_SD = 1.5, 0.01  # of the model's miss, m


@dataclass(frozen=True, eq=False)
class Matched:
    """Which group is which rigid body.

    group   (K,) index of each rigid body's group, NO_GROUP where none is
    margin  (K,) how much less likely all is when the rigid body has another group, log odds
    """

    group: np.ndarray
    margin: np.ndarray


@dataclass(frozen=True, eq=False)
class _Likeness:
    """Log likelihoods: `own` (K, G) of a rigid body being a group, `pair` (K, K, G, G) of two, `volume` (G, G, G, G)."""

    own: np.ndarray
    pair: np.ndarray
    volume: np.ndarray


def match(structure: Structure, groups: Sequence[Group]) -> Matched:
    """The likeliest assignment of groups to rigid bodies, found by a beam search over the rigid bodies, the best linked first."""
    count = len(structure)
    if not len(groups):
        return Matched(np.full(count, NO_GROUP), np.zeros(count))
    states, score = _search(structure, _likeness(structure, groups))
    best = states[0]
    alternatives = np.where(states != best, score[:, None], score.min()).max(axis=0)
    return Matched(best, np.where(best == NO_GROUP, 0.0, score[0] - alternatives))


def _likeness(structure: Structure, groups: Sequence[Group]) -> _Likeness:
    turn, place = (np.stack([getattr(group, name) for group in groups], axis=1) for name in ("turn", "place"))
    own = np.array(
        [[_form_fit(structure, rigid_body, group) for group in groups] for rigid_body in range(len(structure))]
    )
    pair = _distance_fit(structure, place) + _joint_fit(structure, turn, place)
    return _Likeness(own, pair, _volumes(place))


def _form_fit(structure: Structure, rigid_body: int, group: Group) -> float:
    """How well a group's distances could be a rigid body's, whatever marker is which."""
    form = structure.inner[rigid_body].form[: structure.inner[rigid_body].core]
    small, large = sorted((form, group.form), key=len)
    if len(large) > WIDEST:
        return -FAR_OFF
    wanted = _sorted_lengths(small)
    best = min(
        ((_sorted_lengths(large[list(chosen)]) - wanted) ** 2).mean()
        for chosen in combinations(range(len(large)), len(small))
    )
    return -min(0.5 * best / FORM_SD**2, FAR_OFF) - ODD_MARKER * (len(large) - len(small))


def _sorted_lengths(form: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(form[:, None] - form[None], axis=-1)
    return np.sort(lengths[np.triu_indices(len(form), 1)])


def _distance_fit(structure: Structure, place: np.ndarray) -> np.ndarray:
    """(K, K, G, G) what the distances between groups say; 0 where never seen together."""
    distance = np.linalg.norm(place[:, :, None] - place[:, None], axis=-1)
    quantiles = np.nanpercentile(distance, QUANTILES, axis=0)
    low, high, slack = (table[:, :, None, None, None] for table in (structure.low, structure.high, structure.slack))
    breach = np.maximum(np.maximum(low - quantiles, quantiles - high), 0) / slack
    room = np.log(structure.high - structure.low + 2.5 * structure.slack)[:, :, None, None]
    fit = -np.minimum(0.5 * breach**2, FAR_OFF).mean(axis=2) - room
    return np.where(np.isfinite(quantiles).all(axis=0), fit, 0)


def _joint_fit(structure: Structure, turn: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(K, K, G, G) what joints say: rigid bodies that have one need it, where it is in training."""
    seen = find_joints(turn, place)
    known = np.isfinite(seen.miss) & (seen.turn > LEAST_TURN)
    fit = np.zeros((len(structure), len(structure), *seen.miss.shape))
    spread = np.hypot(ARM_SD, ARM_TURN_SD / np.maximum(seen.turn, LEAST_TURN))
    for one, two in np.argwhere(structure.linked):
        off = seen.miss - MISS_SHARE * np.maximum(structure.joints.miss[one, two], MISS_SD)
        cost = np.minimum(0.5 * (np.maximum(off, 0) / MISS_SD) ** 2, FAR_OFF)
        for arm, usual in ((seen.arm, structure.joints.arm[one, two]), (seen.arm.T, structure.joints.arm[two, one])):
            cost = cost + np.minimum(0.5 * ((arm - usual) / spread) ** 2, FAR_OFF / 2)
        fit[one, two] = np.where(known, JOINT_WORTH - cost, 0)
    return fit


def _volumes(place: np.ndarray) -> np.ndarray:
    """(G, G, G, G) median signed volume of every four groups; 0 where never seen together."""
    count = place.shape[1]
    table = np.zeros((count,) * 4)
    quads = np.array(list(combinations(range(count), 4)), int).reshape(-1, 4)
    if not len(quads):
        return table
    volumes = signed_volumes(*(place[:, quads[:, corner]] for corner in range(4)))
    seen = np.isfinite(volumes).any(axis=0)
    quads, middle = quads[seen], np.nanmedian(volumes[:, seen], axis=0)
    for order in permutations(range(4)):
        table[tuple(quads[:, order].T)] = np.linalg.det(np.eye(4)[list(order)]) * middle
    return table


def _order(structure: Structure) -> list[int]:
    """The rigid bodies, each next to one before it."""
    width = structure.high - structure.low + np.where(structure.linked, 0, 1.0)
    np.fill_diagonal(width, np.inf)
    order = [int(np.argmin(np.sort(width, axis=1)[:, :2].sum(axis=1)))]
    while len(order) < len(structure):
        rest = [rigid_body for rigid_body in range(len(structure)) if rigid_body not in order]
        order.append(min(rest, key=lambda rigid_body: width[rigid_body, order].min()))
    return order


def _search(structure: Structure, likeness: _Likeness) -> tuple[np.ndarray, np.ndarray]:
    """Assignments (B, K) and their log likelihoods (B,), the best first."""
    order = _order(structure)
    place = np.argsort(order)
    latest = place[structure.quads].max(axis=1) if len(structure.quads) else np.zeros(0, int)
    states, score = np.full((1, len(order)), NO_GROUP), np.zeros(1)
    groups = likeness.own.shape[1]
    for step, rigid_body in enumerate(order):
        told = _told_by_pairs(likeness, states, rigid_body, order[:step])
        told += _told_by_volumes(structure, likeness, states, rigid_body, np.flatnonzero(latest == step))
        told += likeness.own[rigid_body]
        for other in order[:step]:
            taken = np.flatnonzero(states[:, other] >= 0)
            told[taken, states[taken, other]] = -np.inf
        total = np.concatenate([score[:, None] + told, score[:, None] + UNSEEN], axis=1).ravel()
        kept = np.argsort(-total, kind="stable")[:BEAM]
        kept = kept[np.isfinite(total[kept])]
        states, score = states[kept // (groups + 1)].copy(), total[kept]
        choice = kept % (groups + 1)
        states[:, rigid_body] = np.where(choice < groups, choice, NO_GROUP)
    return states, score


def _told_by_pairs(likeness: _Likeness, states: np.ndarray, rigid_body: int, earlier: list[int]) -> np.ndarray:
    """(B, G) what the groups of earlier rigid bodies say of the groups that the next may be."""
    told = np.zeros((len(states), likeness.own.shape[1]))
    known = np.zeros((len(states), 1))
    for other in earlier:
        there = states[:, other]
        told += np.where((there >= 0)[:, None], likeness.pair[rigid_body, other][:, np.maximum(there, 0)].T, 0)
        known += (there >= 0)[:, None]
    return told * TOLD / np.maximum(known, TOLD)


def _told_by_volumes(
    structure: Structure, likeness: _Likeness, states, rigid_body: int, rows: np.ndarray
) -> np.ndarray:
    """(B, G) log odds against the mirror image, of the quads in `rows`, whose last rigid body is the next."""
    size = len(states), likeness.own.shape[1]
    told, known = np.zeros(size), np.zeros(size)
    for row in rows:
        corners = [
            np.broadcast_to(np.arange(size[1]), size)
            if other == rigid_body
            else np.broadcast_to(states[:, other, None], size)
            for other in structure.quads[row]
        ]
        there = np.all([corner >= 0 for corner in corners], axis=0)
        volume = likeness.volume[tuple(np.maximum(corner, 0) for corner in corners)]
        there &= volume != 0
        odds = np.maximum(mirror_odds(volume, structure.volume[row], structure.volume_sd[row]), -MIRRORED)
        told += np.where(there, odds, 0)
        known += there
    return told * TOLD / np.maximum(known, TOLD)


def mirror_odds(volume: np.ndarray, mean: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Log likelihood of a signed volume, beside that of either it or its mirror image."""
    right = -np.minimum(0.5 * ((volume - mean) / spread) ** 2, FAR_OFF)
    wrong = -np.minimum(0.5 * ((volume + mean) / spread) ** 2, FAR_OFF)
    return right - np.logaddexp(right, wrong) + np.log(2)
