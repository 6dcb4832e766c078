# SPDX-License-Identifier: GPL-3.0-or-later
"""All names of one frame at once: which sets of blobs that meet in a point are which markers, over all cameras.

The three steps of algorithm 1 decide camera by camera, and what is decided stays. Here every set of blobs whose rays
meet, every pair of them and every single blob may be any marker near it. What each says of the frame is a likelihood:
how far the point is from where the body has the marker, how well the rays meet, which cameras should have seen it and
did not, and that a blob without a name is a ghost. The best choice in which nothing is used twice is the naming.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..data.takes import REMAINING
from ..geometry.triangulation import passing
from ..geometry.views import View
from ..papers.virtual_occlusions.cloud import FEW_CAMERAS, PARTNERS, nearest_blobs, partners
from ..papers.virtual_occlusions.labelling import Expectation, Frame, Naming

# Of a marker, the best, that are chosen from, and more for each camera beyond those whose rays are all met: a point is
# tried without each of its rays. Without, 4 % of the blobs of sixteen cameras and 22 % of those of twenty-four went
# without a name.
HYPOTHESES, MORE_HYPOTHESES = 40, 15


@dataclass(frozen=True)
class AtOnceOptions:
    """What is likely in a frame that is named at once."""

    # chance that a camera has a blob of a marker which the body does not hide from it, and
    seen: float = 0.93  # physical
    seen_hidden: float = 0.25  # physical: of one that it should hide, as nobody's body is exactly the model's
    # chance that a subject has a marker elsewhere than the set has it. On `s02`, `p1` and `p2` of
    # `tests.accuracy.strangers` one marker in ten is 4 to 8 cm from where the fitted body has it
    elsewhere: float = 0.1  # measured
    # by so much, standard deviation along each axis, on the same; no marker is farther off than four of them
    elsewhere_m: float = 0.05  # measured
    # chance that a camera has a blob of a marker behind a nearer one on the same line, and
    seen_behind: float = 0.1  # physical
    seen_before: float = 0.99  # physical: of the nearer one, if it has one of either, as nothing else is in the way

    @property
    def max_distance_m(self) -> float:
        """Of a marker from where the body has it."""
        return 4 * self.elsewhere_m


JOINTLY = AtOnceOptions()


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """H possible names of sets of blobs: marker (H,), slot (H, C), -1 where no camera, and gain (H,).

    The gain is by how much the name is likelier than that all its blobs are ghosts, and the marker unseen; as squared
    deviations are counted. elsewhere (H,) says whether it takes the marker for placed elsewhere.
    """

    marker: np.ndarray
    slot: np.ndarray
    gain: np.ndarray
    elsewhere: np.ndarray


def name_jointly(frame: Frame) -> tuple[Naming, np.ndarray]:
    """The likeliest names of a frame's blobs, and which markers (M,) are placed elsewhere by them."""
    found = hypotheses_of(frame)
    chosen = _shaded(found, _best(found, frame.view), frame)
    naming = Naming.empty(frame)
    for index in chosen:
        camera = np.flatnonzero(found.slot[index] >= 0)
        marker = np.full(len(camera), found.marker[index])
        naming.give(camera, marker, found.slot[index, camera], REMAINING)
    elsewhere = np.zeros(len(frame.markers), bool)
    elsewhere[found.marker[chosen]] = found.elsewhere[chosen]
    return naming, elsewhere


def hypotheses_of(frame: Frame) -> Hypotheses:
    """Everything that may be worth a name."""
    sight, expected = frame.sight, frame.expected
    sets = _sets(frame)
    met = frame.rays.meet(sets.T)
    fine = np.isfinite(met.points[:, 0])
    sets, points, miss = sets[fine], met.points[fine], met.miss.T[fine]
    seen = sets >= 0
    arm = points[:, None] - sight.centres
    depth = np.linalg.norm(arm, axis=2)
    noise = frame.rules.pixel / sight.focal * depth + frame.rules.slack_m
    meets = (miss < frame.rules.max_miss * noise).all(axis=1)
    sets, points, miss, seen, depth, noise = (part[meets] for part in (sets, points, miss, seen, depth, noise))
    near = np.linalg.norm(points[:, None] - expected.points, axis=2) < JOINTLY.max_distance_m
    which, marker = np.nonzero(near)
    ghost = _ghost_density(frame)
    across = frame.rays.across[np.arange(len(sight.centres)), np.maximum(sets, 0)]
    information = np.einsum("qc,qcij->qij", seen / noise**2, across)
    spread = np.linalg.inv(information)
    rays = -((miss / noise) ** 2 * seen).sum(axis=1)
    rays -= (seen * 2 * np.log(2 * np.pi * noise**2)).sum(axis=1)
    rays -= (seen * 2 * (np.log(ghost) + 2 * np.log(sight.focal / depth))).sum(axis=1)
    rays += np.linalg.slogdet(2 * np.pi * spread)[1]
    off = points[which] - expected.points[marker]
    place, elsewhere = _placed(off, expected.covariance[marker] + spread[which])
    gain = rays[which] + place + _detections(expected, seen[which], marker)
    many = Hypotheses(marker, sets[which], gain, elsewhere)
    return _pruned(many, _singles(frame, expected, ghost), frame)


def _placed(off: np.ndarray, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(H,) twice the log density of offsets (H, D) of spread (H, D, D), placed as in the set or elsewhere."""
    usual = _normal(off, spread) + 2 * np.log(1 - JOINTLY.elsewhere)
    wide = spread + JOINTLY.elsewhere_m**2 * np.eye(off.shape[1])
    other = _normal(off, wide) + 2 * np.log(JOINTLY.elsewhere)
    return np.maximum(usual, other), other > usual


def _normal(off: np.ndarray, spread: np.ndarray) -> np.ndarray:
    square = np.einsum("hi,hi->h", off, np.linalg.solve(spread, off[..., None])[..., 0])
    return -square - np.linalg.slogdet(2 * np.pi * spread)[1]


def _detections(expected: Expectation, seen: np.ndarray, marker: np.ndarray) -> np.ndarray:
    """(H,) what it says that the cameras `seen` (H, C) have a blob of the marker, and the others do not."""
    chance = np.where(expected.visible, JOINTLY.seen, JOINTLY.seen_hidden)
    odds = 2 * (np.log(chance) - np.log(1 - chance)).T[marker]
    return (seen * odds).sum(axis=1)


def _ghost_density(frame: Frame) -> np.ndarray:
    """(C,) ghosts a square pixel: blobs beyond the markers that a camera should see, and one more."""
    low, high = frame.sight.corners
    area = (high - low).prod(axis=1) * frame.sight.focal**2
    more = np.maximum(frame.view.real.sum(axis=1) - frame.expected.visible.sum(axis=1), 0)
    return (1 + more) / area


def _singles(frame: Frame, expected: Expectation, ghost: np.ndarray) -> Hypotheses:
    """Single blobs as markers that no other camera sees."""
    off = frame.view.image[:, None] - frame.image[:, :, None]
    near = np.linalg.norm(off, axis=3) * frame.depth[..., None] < JOINTLY.max_distance_m
    camera, marker, blob = np.nonzero(near & frame.view.real[:, None])
    depth, noise = frame.depth[camera, marker], frame.metres[camera, marker]
    slope = frame.slope[camera, marker] * depth[:, None, None]
    spread = slope @ expected.covariance[marker] @ slope.swapaxes(1, 2) + noise[:, None, None] ** 2 * np.eye(2)
    off = off[camera, marker, blob] * depth[:, None]
    place, elsewhere = _placed(off, spread)
    gain = place - 2 * (np.log(ghost[camera]) + 2 * np.log(frame.sight.focal[camera] / depth))
    slot = np.full((len(camera), len(frame.cameras)), -1)
    slot[np.arange(len(camera)), camera] = blob
    gain = gain + _detections(expected, slot >= 0, marker)
    return Hypotheses(marker, slot, gain, elsewhere)


def _sets(frame: Frame) -> np.ndarray:
    """(Q, C) slots of blobs whose rays meet near a marker: pairs, what other cameras add to them, and subsets."""
    view, sight, rules = frame.view, frame.sight, frame.rules
    off = view.image[:, None] - frame.image[:, :, None]
    near = (np.linalg.norm(off, axis=3) * frame.depth[..., None] < JOINTLY.max_distance_m).any(axis=1) & view.real
    camera, slot = np.nonzero(near)
    direction, origin = frame.rays.direction[camera, slot], sight.centres[camera]
    first, second = np.triu_indices(len(camera), 1)
    met = np.eye(sight.count) == 0
    if sight.count > PARTNERS + 1:
        met = partners(sight.centres, PARTNERS)
    met = met[camera[first], camera[second]]
    first, second = first[met], second[met]
    here, there, between, fixed = passing(direction, origin, first, second)
    noise = rules.pixel * (here / sight.focal[camera[first]] + there / sight.focal[camera[second]]) + 2 * rules.slack_m
    meets = fixed & (np.linalg.norm(between, axis=0) < rules.max_miss * noise)
    first, second, here = first[meets], second[meets], here[meets]
    middle = origin[first] + here[:, None] * direction[first]
    closest = (np.linalg.norm(middle[:, None] - frame.expected.points, axis=2) < JOINTLY.max_distance_m).any(axis=1)
    first, second, middle = first[closest], second[closest], middle[closest]
    members = np.full((len(first), sight.count), -1)
    each = np.arange(len(first))
    members[each, camera[first]], members[each, camera[second]] = slot[first], slot[second]
    if not len(first):
        return members
    # All pairs of a marker's rays make the same whole set.
    whole = _completed(members, middle, frame)
    if sight.count > PARTNERS + 1:
        members = members[(whole >= 0).sum(axis=1) <= 3]
    whole = np.unique(whole, axis=0)
    parts = [members, whole]
    cameras = np.arange(sight.count)
    count = (whole >= 0).sum(axis=1)
    for one in cameras:
        fewer = whole.copy()
        fewer[:, one] = -1
        parts.append(fewer[count > 2])
    for two in combinations(range(sight.count), 2) if sight.count <= FEW_CAMERAS else ():
        fewer = whole.copy()
        fewer[:, list(two)] = -1
        parts.append(fewer[(fewer >= 0).sum(axis=1) >= 2])
    sets = np.unique(np.concatenate(parts), axis=0)
    return sets[(sets >= 0).sum(axis=1) >= 2]


def _completed(members: np.ndarray, points: np.ndarray, frame: Frame) -> np.ndarray:
    """(Q, C) the sets with the blobs of the other cameras that lie on their points."""
    nearest, off, depth = nearest_blobs(points, frame.view, frame.sight)
    noise = frame.rules.pixel / frame.sight.focal[:, None] * depth + frame.rules.slack_m
    return np.where(members >= 0, members, np.where(off < frame.rules.max_off_point * noise, nearest, -1).T)


def _pruned(many: Hypotheses, singles: Hypotheses, frame: Frame) -> Hypotheses:
    """The best of each marker, without those that contradict what a person named."""
    marker, slot, gain, elsewhere = (
        np.concatenate([getattr(many, name), getattr(singles, name)]) for name in Hypotheses.__dataclass_fields__
    )
    fixed = np.zeros(frame.view.real.shape, bool)
    camera, named = np.nonzero(frame.fixed >= 0)
    fixed[camera, frame.fixed[camera, named]] = True
    used = fixed[frame.cameras, np.maximum(slot, 0)] | (frame.fixed[:, marker].T >= 0)
    gain = np.where((used & (slot >= 0)).any(axis=1), 0, gain)
    most = HYPOTHESES + MORE_HYPOTHESES * max(len(frame.cameras) - PARTNERS - 1, 0)
    order = np.lexsort((-gain, marker))
    rank = np.arange(len(order)) - np.searchsorted(marker[order], marker[order])
    kept = order[(rank < most) & (gain[order] > 0)]
    return Hypotheses(marker[kept], slot[kept], gain[kept], elsewhere[kept])


def _best(found: Hypotheses, view: View) -> np.ndarray:
    """Indices of the hypotheses that together gain most, each marker and each blob used once."""
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import coo_array

    if not len(found.gain):
        return np.zeros(0, int)
    which, camera = np.nonzero(found.slot >= 0)
    row = camera * view.real.shape[1] + found.slot[which, camera]
    markers = found.marker.max() + 1
    rows = np.concatenate([found.marker, markers + row])
    columns = np.concatenate([np.arange(len(found.gain)), which])
    shape = (int(rows.max()) + 1, len(found.gain))
    once = LinearConstraint(coo_array((np.ones(len(rows)), (rows, columns)), shape=shape).tocsc(), ub=np.ones(shape[0]))
    answer = milp(-found.gain, integrality=np.ones(shape[1]), bounds=Bounds(0, 1), constraints=once)
    return np.flatnonzero(answer.x > 0.5) if answer.x is not None else np.zeros(0, int)


def _shaded(found: Hypotheses, chosen: np.ndarray, frame: Frame) -> np.ndarray:
    """The choice with blobs given to the nearer of two markers on one line where that is likelier.

    Each name on its own takes it for odd that a camera which should see its marker has no blob of it. Behind a nearer
    marker it is not: the blob is then the nearer one's. The best such change is made, and so on.
    """
    chosen = chosen.copy()
    chance = np.where(frame.expected.visible, JOINTLY.seen, JOINTLY.seen_hidden)
    behind = 2 * (np.log(1 - JOINTLY.seen_behind) - np.log(1 - chance))
    before = 2 * (np.log(1 - chance) - np.log(1 - JOINTLY.seen_before))
    for _ in range(len(chosen)):
        less, more, camera = _handed_over(found, chosen)
        at = np.full(len(frame.markers), -1)
        at[found.marker[chosen]] = np.arange(len(chosen))
        giver, taker = at[found.marker[less]], at[found.marker[more]]
        gain = found.gain[less] + found.gain[more] - found.gain[chosen[giver]] - found.gain[chosen[taker]]
        gain = gain + behind[camera, found.marker[less]] + before[camera, found.marker[more]]
        points = [frame.rays.meet(found.slot[of].T).points for of in (chosen[giver], more)]
        away, nearer = (np.linalg.norm(each - frame.sight.centres[camera], axis=1) for each in points)
        gain = np.where(nearer < away - frame.rules.min_behind_m, gain, 0)
        if not (gain > 0).any():
            break
        best = int(gain.argmax())
        chosen[giver[best]], chosen[taker[best]] = less[best], more[best]
    return chosen


def _handed_over(found: Hypotheses, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the choice, every blob that one marker may give to another which its camera lacks.

    What the giver is then, what the taker is then (N,), both in `found`, and the camera (N,).
    """
    own = np.full(found.marker.max(initial=-1) + 1, -1)
    own[found.marker[chosen]] = chosen
    mine = own[found.marker]
    slot = np.where((mine >= 0)[:, None], found.slot[mine], found.slot)
    other = found.slot != slot
    one = other.sum(axis=1) == 1
    camera = other.argmax(axis=1)
    now, then = (part[np.arange(len(camera)), camera] for part in (slot, found.slot))
    less, more = np.flatnonzero(one & (then < 0)), np.flatnonzero(one & (now < 0))
    same = (camera[less][:, None] == camera[more]) & (now[less][:, None] == then[more])
    giver, taker = np.nonzero(same)
    return less[giver], more[taker], camera[less[giver]]
