# SPDX-License-Identifier: GPL-3.0-or-later
"""A posed body that stands on the floor: planted feet hold still, and no foot is in the ground.

A body that is posed frame by frame wavers by millimetres, as skin and markers do, and most of all one sees feet that
slide or sink in. So trajectories are looked at as a whole. Where heel and ball are slow and low they stay in one place,
and the correction fades before and after; the legs follow by inverse kinematics of two bones, and the hips go half of
the way. Toes bend up from the floor where the heel lifts. All else stays as it was posed, and no length changes.
"""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..body.sides import BODY_SIDES
from ..geometry import rotations
from ..posing.character import BALL, toes_axis
from ..review.suspects import runs
from .smoothing import smoothed


class ON_GROUND:
    """When a foot is planted, and how it gets there."""

    # of the frames in which feet rest that are on the floor at least, and not on a step
    lowest_part: float = 0.1  # physical
    slow_m_s: float = 0.15  # physical: a part of a foot that is slower may be planted; walking it swings at 4 m/s
    span_s: float = 0.1  # physical: of that, of the shortest plant, as when running, and in which a correction fades
    # how high above where it rests a planted part may be; a kick is higher; so near to z = 0 is the floor
    low_m: float = 0.06  # physical
    # how far from its place a planted part may be posed, as skin moves; farther it is elsewhere
    reach_m: float = 0.03  # physical
    # what is farther below the floor is on a step or in a pit, and not posed a little too low
    deepest_m: float = 0.1  # physical
    # cosine of how far resting feet lean in the middle; farther there is no floor, or not below
    upright: float = 0.87  # physical
    tilt_rad: float = 0.35  # physical: how far a foot is turned out of the ground at most; then it is lifted
    # that toes are bent up from the sole at most, as on tiptoe, and down, as they curl
    bent_rad: tuple[float, float] = (-0.7, 1.57)  # physical
    # part of its length that a leg is stretched to at most; a straight knee has no direction
    straight: float = 0.9995  # physical


# paper: the heel's end, of the way from the ankle to the toes' tip: 0.039 of 0.152 of the height (Winter, after
# Drillis and Contini)
HEEL = -0.35
LEG = "thigh", "shank", "foot"
Plant = tuple[int, int, np.ndarray]  # first frame, end, and place (3,) m


def settled(
    joints: np.ndarray,
    rotated: np.ndarray,
    segments: Sequence[str],
    parents: Sequence[int],
    ends: np.ndarray,
    rate: float,
    cutoff: float | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Joints (F, J, 3) m and rotations (F, J, 3, 3) of a body as armatures show it, smoothed and with planted feet.

    As they were posed they are given, NaN where nobody was found; `ends` (J, 3) m is the far end of each segment from
    its joint in its axes, and `cutoff`, Hz, is None for not smoothed. A body without a person's legs is not put on the
    ground. Raises InputError where the rate has no room for the cut-off.
    """
    found = np.isfinite(joints).all(axis=(1, 2))
    if not found.any():
        return joints, rotated
    offsets = np.concatenate([np.zeros((1, 3)), offsets_of(joints[found], rotated[found], parents)])
    root = joints[:, :1]
    if cutoff is not None:
        root, rotated = smoothed(root, rate, cutoff), _calmed(rotated, rate, cutoff)
    index = {name: at for at, name in enumerate(segments)}
    legs = [[index[f"{part}.{side}"] for part in LEG] for side in BODY_SIDES if index.keys() >= _leg(side)]
    joints = _chained(root, rotated, parents, offsets)
    if not legs:
        return joints, rotated
    rotated = rotated.swapaxes(0, 1).copy().swapaxes(0, 1)  # in memory segment by segment, as it is used
    thigh, shank, foot = np.array(legs).T
    toes = [index[f"toes.{segments[one][-1]}"] for one in foot if f"toes.{segments[one][-1]}" in index]
    toes = toes if len(toes) == len(foot) else []
    ball = offsets[toes] if toes else BALL * ends[foot]
    tip = ball if toes else ends[foot]
    ankle, turn, held, floor = _feet_on_ground(joints[:, foot], rotated[:, foot], ball, tip, rate)
    upper, lower = np.linalg.norm(offsets[shank], axis=1), np.linalg.norm(offsets[foot], axis=1)
    most = ON_GROUND.straight * (upper + lower)
    # The hips go with the straighter leg, whose knee would have to turn the most for it.
    room = most**2 - ((joints[:, foot] - joints[:, thigh]) ** 2).sum(axis=2)
    ease = 1 / np.maximum(room, (1 - ON_GROUND.straight) * most**2)[..., None]
    shift = ((ankle - joints[:, foot]) * ease).sum(axis=1, keepdims=True) / ease.sum(axis=1, keepdims=True)
    way = ankle - joints[:, thigh] - shift
    far = np.linalg.norm(way, axis=2)
    lack = _envelope(far - most, round(ON_GROUND.span_s * rate))
    shift = shift + (lack[..., None] * way / far[..., None]).sum(axis=1, keepdims=True)
    hip, knee = joints[:, thigh] + shift, joints[:, shank] + shift
    bent = _knees(hip, knee, ankle, rotated[:, thigh][..., 0], upper, lower, most)
    rotated[:, thigh] = rotations.least_turn(knee - hip, bent - hip) @ rotated[:, thigh]
    rotated[:, shank] = rotations.least_turn(joints[:, foot] + shift - knee, ankle - bent) @ rotated[:, shank]
    if toes:
        before = rotated[:, foot].swapaxes(2, 3) @ rotated[:, toes]
        height = ankle[..., 2] + rotations.carried(turn, ball)[..., 2] - floor
        rotated[:, toes] = turn @ toes_bent(turn, before, ends[toes], held, height)
    rotated[:, foot] = turn
    return _chained(root + shift, rotated, parents, offsets), rotated


def offsets_of(joints: np.ndarray, rotated: np.ndarray, parents: Sequence[int]) -> np.ndarray:
    """(J - 1, 3) m the median of where each joint but the root's is in the axes of the one above it."""
    above = np.asarray(parents)[1:]
    way = joints[:, 1:] - joints[:, above]
    return np.median((way[..., None, :] @ rotated[:, above])[..., 0, :], axis=0)


def _leg(side: str) -> set[str]:
    return {f"{part}.{side}" for part in LEG}


def _chained(root: np.ndarray, rotated: np.ndarray, parents: Sequence[int], offsets: np.ndarray) -> np.ndarray:
    """The joints (F, J, 3) m from the root's (F, 1, 3), the rotations, and each one's place in its parent's axes."""
    joints = np.repeat(root, len(offsets), axis=1)
    for at, above in enumerate(parents):
        if above >= 0:
            joints[:, at] = joints[:, above] + rotated[:, above] @ offsets[at]
    return joints


def _calmed(rotated: np.ndarray, rate: float, cutoff: float) -> np.ndarray:
    """Rotations (F, J, 3, 3) without what is faster than the cut-off, Hz."""
    turns = np.full((*rotated.shape[:2], 4), np.nan)
    found = np.isfinite(rotated).all(axis=(1, 2, 3))
    known = rotations.matrix_to_quaternion(rotated[found])
    along = np.einsum("fji,fji->fj", known[1:], known[:-1])
    known[1:] *= np.cumprod(np.where(along < 0, -1.0, 1.0), axis=0)[..., None]
    turns[found] = known
    turns = smoothed(turns, rate, cutoff)
    return rotations.quaternion_to_matrix(turns / np.linalg.norm(turns, axis=2, keepdims=True))


def _envelope(values: np.ndarray, frames: int) -> np.ndarray:
    """A smooth curve, nowhere below values (F, S) or 0, that comes and goes within so many frames; NaN counts as 0."""
    half = max(frames // 2, 1)
    around = np.pad(np.maximum(np.nan_to_num(values), 0.0), ((2 * half, 2 * half), (0, 0)))
    return eased(sliding_window_view(around, 4 * half + 1, axis=0).max(axis=-1), half)


def eased(values: np.ndarray, half: int) -> np.ndarray:
    """Values (F, ...) as a smooth curve: the mean of so many frames to either side, and that of those means."""
    whole = 2 * half + 1
    for _ in range(2):  # SciPy's filters take 0.3 s to import, for which a window waits
        around = np.repeat(values[:1], half + 1, axis=0), values, np.repeat(values[-1:], half, axis=0)
        sums = np.cumsum(np.concatenate(around), axis=0)
        values = (sums[whole:] - sums[:-whole]) / whole
    return values


def _feet_on_ground(
    ankle: np.ndarray, turn: np.ndarray, ball: np.ndarray, tip: np.ndarray, rate: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Ankles (F, S, 3) m and feet's rotations (F, S, 3, 3) on the ground.

    How far balls of feet are planted (F, S), 0 to 1, and how high m the floor is, -inf for none.
    `ball` (S, 3) m is that of the feet, and `tip` where what is rigid of them ends.
    """
    foot = ball / BALL
    parts = np.stack([foot * [HEEL, HEEL, 1.0], ball, 0.0 * ball], axis=1)  # of each foot: heel, ball, and ankle
    fade, span = (max(round(part * rate), 1) for part in (ON_GROUND.span_s, ON_GROUND.span_s / 2))
    places = ankle[:, :, None] + rotations.carried(turn[:, :, None], parts)
    if len(places) <= 2 * span:
        return ankle, turn, np.zeros(ankle.shape[:2]), -np.inf
    gone = np.linalg.norm(places[2 * span :] - places[: -2 * span], axis=3)
    turned = rotations.rotation_vector(turn[2 * span :].swapaxes(2, 3) @ turn[: -2 * span])
    # A forefoot is as slow as the slowest of what is as near to the ball as the foot's end.
    gone[:, :, 1] -= np.linalg.norm(turned, axis=2) * np.linalg.norm(foot - ball, axis=1)
    gone = np.pad(gone, ((span, span), (0, 0), (0, 0)), "edge")
    slow = (gone < ON_GROUND.slow_m_s * 2 * span / rate) & np.isfinite(places).all(axis=3)
    if not slow.any():
        return ankle, turn, np.zeros(ankle.shape[:2]), -np.inf
    rests = [
        np.quantile(places[:, :, part, 2][slow[:, :, part]], ON_GROUND.lowest_part) if slow[:, :, part].any() else 0.0
        for part in range(3)
    ]
    low = np.minimum(ankle[..., 2], (ankle + rotations.carried(turn, tip))[..., 2])
    floor = float(np.quantile(low[slow.any(axis=2)], ON_GROUND.lowest_part))
    floor = 0.0 if abs(floor) < ON_GROUND.low_m else floor
    if np.median(turn[..., 2, 2][slow.any(axis=2)]) < ON_GROUND.upright:
        floor = -np.inf
    turn = _turned_up(ankle[..., 2] - floor, turn, tip, fade)
    places = ankle[:, :, None] + rotations.carried(turn[:, :, None], parts)
    slow &= (places[..., 2] < np.array(rests) + ON_GROUND.low_m) | _carrying(slow, ankle[..., 2])
    moved, held = _held_in_place(places, slow, parts, 2 * span, fade, bool(np.isfinite(floor)))
    goal = places + moved
    along = goal[:, :, 1] - goal[:, :, 0]
    turn = rotations.least_turn(places[:, :, 1] - places[:, :, 0], along) @ turn
    # About the line from heel to ball the foot turns until the ankle is on its side of it.
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    aside = np.cross(along, -rotations.carried(turn, parts[:, 0])), np.cross(along, goal[:, :, 2] - goal[:, :, 0])
    roll = np.arctan2((np.cross(*aside) * along).sum(axis=2), (aside[0] * aside[1]).sum(axis=2))
    turn = rotations.turn_of(along * roll[..., None]) @ turn
    share = ((held + 1e-3) / (1 + 1e-3 - held))[..., :2]  # what is planted is where it should be, what fades follows
    share = share / share.sum(axis=2, keepdims=True)
    ankle = np.einsum("fsp,fspi->fsi", share, (goal - rotations.carried(turn[:, :, None], parts))[:, :, :2])
    low = np.minimum(ankle[..., 2], (ankle + rotations.carried(turn, tip))[..., 2])
    ankle[..., 2] += _envelope(np.where(floor - low < ON_GROUND.deepest_m, floor - low, 0.0), fade)
    return ankle, turn, held[:, :, 1] * np.isfinite(floor), floor


def toes_bent(
    foot: np.ndarray, before: np.ndarray, toes: np.ndarray, held: np.ndarray | float, height: np.ndarray
) -> np.ndarray:
    """How toes (S, 3) m bend in feet (F, S, 3, 3), so that they do not go into the floor: (F, S, 3, 3).

    They bend as they did `before`, within limits, and upwards about the ball of the foot until they are level, as far
    as it is `held` (F, S) on the floor. When it leaves they straighten, but not into what is `height` (F, S) m below.
    """
    axis = toes_axis(toes)
    bent = (rotations.rotation_vector(before) * axis).sum(axis=2)
    upright, lying = foot[..., 2, 2], rotations.carried(foot, np.cross([0.0, 0, 1], axis))[..., 2]
    level = np.arctan2(-lying, upright)
    reach = np.maximum(np.hypot(lying, upright), rotations.NO_TURN) * np.linalg.norm(toes, axis=1)
    room = np.maximum(height, -height - ON_GROUND.deepest_m)  # far below the floor there is none
    clear = np.where(room < reach, level - np.arcsin(np.clip(room / reach, 0, 1)), bent)
    on_sole = np.clip(1 + 2 * upright, 0, 1)  # one on its back does not stand on its sole
    need = np.maximum(np.maximum(held * (level - bent), clear - bent), 0)
    return rotations.turn_of(axis * np.clip(bent + on_sole * need, *ON_GROUND.bent_rad)[..., None])


def _turned_up(height: np.ndarray, turn: np.ndarray, tip: np.ndarray, fade: int) -> np.ndarray:
    """Feet (F, S, 3, 3) about ankles at such a height (F, S) m, turned so that their tips are not in the ground."""
    way = rotations.carried(turn, tip)
    long, level = np.linalg.norm(way, axis=2), np.linalg.norm(way[..., :2], axis=2)
    near = np.minimum(height, height + way[..., 2]) > -ON_GROUND.deepest_m
    need = np.arcsin(np.clip(-height / long, -1, 1)) - np.arctan2(way[..., 2], level)
    lack = _envelope(np.where(near, np.minimum(need, ON_GROUND.tilt_rad), 0.0), fade)
    # A foot that stands on its tip has no direction: the less level, the less it is turned.
    axis = np.stack([way[..., 1], -way[..., 0], np.zeros_like(level)], axis=2) / np.maximum(level, long / 2)[..., None]
    return rotations.turn_of(axis * lack[..., None]) @ turn


def _carrying(slow: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Which parts of feet that are slow (F, S, P) carry somebody, on a step as well: meanwhile another foot goes on.

    It does so for most of that time, and above the one that stands, by their ankles' height (F, S) m. While a foot is
    held up, the other may go on, too, but below.
    """
    carrying = np.zeros_like(slow)
    for side in range(slow.shape[1]):
        goes = ~np.delete(slow, side, axis=1).any(axis=2).all(axis=1)
        above = goes & (np.delete(height, side, axis=1) > height[:, [side]]).any(axis=1)
        for part in range(slow.shape[2]):
            for start, stop in runs(slow[:, side, part], 1):
                carrying[start:stop, side, part] = goes[start:stop].mean() > 0.5 and above[start:stop].any()
    return carrying


def _held_in_place(
    places: np.ndarray, slow: np.ndarray, parts: np.ndarray, least: int, fade: int, on_floor: bool
) -> tuple[np.ndarray, np.ndarray]:
    """How places (F, S, 3, 3) m of heels, balls and ankles are moved to stay where they are planted, and how far held.

    They may be planted where they are slow (F, S, 3); `parts` (S, 3, 3) m is where a foot has them.
    """
    tilt = np.zeros_like(places[..., 2])
    if on_floor:
        tilt[:, :, 1] = places[:, :, 0, 2] - places[:, :, 1, 2]
    plants = [
        [
            _plants(places[:, side, part], slow[:, side, part], tilt[:, side, part], least, fade)
            for side in range(places.shape[1])
        ]
        for part in range(3)
    ]
    if on_floor:
        _level(plants[1])
    for heels, balls, way in zip(*plants[:2], parts[:, 1] - parts[:, 0], strict=True):
        _set_apart(heels, balls, float(np.linalg.norm(way)))
    moved, held = np.zeros_like(places), np.zeros(places.shape[:3])
    for part, feet in enumerate(plants):
        for side, own in enumerate(feet):
            moved[:, side, part], held[:, side, part] = _holding(places[:, side, part], own, fade)
    return moved, held


def _plants(path: np.ndarray, slow: np.ndarray, tilt: np.ndarray, least: int, fade: int) -> list[Plant]:
    """Where a part of a foot on a path (F, 3) m is planted; it may rise by as much as `tilt` (F,) m does."""
    found, left, both = [], runs(slow, fade), np.column_stack([path, tilt])
    while left:
        start, stop = left.pop()
        if stop - start <= least:
            continue
        here = both[start:stop]
        middle = np.median(here[np.isfinite(here).all(axis=1)], axis=0)  # nanmedian takes five times as long
        place, apart = middle[:3], np.nan_to_num(here - middle)
        off, more = apart[:, :3], apart[:, 3]
        off[:, 2] -= np.clip(off[:, 2], np.minimum(more, 0), np.maximum(more, 0))
        if np.linalg.norm(off, axis=1).max() <= ON_GROUND.reach_m:
            found.append((start, stop, place))
            continue
        # It creeps: two plants that part it best, with time between to get from one to the other.
        before = np.arange(1, stop - start)
        sums = np.cumsum(off - off.mean(axis=0), axis=0)[:-1]
        cut = start + int(np.argmax((sums**2).sum(axis=1) / (before * before[::-1])))
        left += [(start, cut - fade // 2), (cut + 1 + fade // 2, stop)]
    return sorted(found, key=lambda plant: plant[0])


def _level(plants: list[list[Plant]]):
    """Changes the places of plants of each foot, so that they are equally high; those on a step stay as they are."""
    feet = [plant for foot in plants for plant in foot]
    if feet:
        height = np.median(np.concatenate([np.full(stop - start, place[2]) for start, stop, place in feet]))
        for _, _, place in feet:
            place[2] = height if abs(place[2] - height) < ON_GROUND.reach_m else place[2]


def _set_apart(heels: list[Plant], balls: list[Plant], length: float):
    """Changes where heel and ball of one foot are planted: one that comes down beside the other is `length` m off."""
    both = [(plant, balls) for plant in heels] + [(plant, heels) for plant in balls]
    for (start, _, place), others in sorted(both, key=lambda one: one[0][0]):
        for first, stop, other in others:
            if first <= start < stop:
                way = place - other
                level = np.sqrt(max(length**2 - way[2] ** 2, 0.0))
                place[:2] = other[:2] + way[:2] * level / max(np.linalg.norm(way[:2]), 1e-9)


def _holding(path: np.ndarray, plants: list[Plant], fade: int) -> tuple[np.ndarray, np.ndarray]:
    """How a path (F, 3) m is moved so that it stays in its plants, and how far (F,) it is held, 0 to 1."""
    moved, held = np.zeros_like(path), np.zeros(len(path))
    before = [0, *(stop for _, stop, _ in plants)]
    after = [*(start for start, _, _ in plants), len(path)]
    for number, (start, stop, place) in enumerate(plants):
        moved[start:stop], held[start:stop] = place - path[start:stop], 1.0
        for frames, edge in (
            (np.arange(max(start - fade, before[number]), start), start),
            (np.arange(stop, min(stop + fade, after[number + 1]))[::-1], stop - 1),
        ):
            way = np.arange(1, len(frames) + 1) / (len(frames) + 1)
            part = way * way * (3 - 2 * way)
            moved[frames] += part[:, None] * moved[edge]
            held[frames] += part
    return moved, held


def _knees(
    hip: np.ndarray,
    knee: np.ndarray,
    ankle: np.ndarray,
    forward: np.ndarray,
    upper: np.ndarray,
    lower: np.ndarray,
    most: np.ndarray,
) -> np.ndarray:
    """Knees (F, S, 3) m between hips and ankles that are elsewhere now; they move `forward`, or back, never sideways.

    No knee bends farther backwards than it was. Legs are `upper` and `lower` (S,) m long, stretched at `most` so far.
    """
    way = ankle - hip
    far = np.linalg.norm(way, axis=2)
    way = way / far[..., None]
    far = np.minimum(far, most)
    along = (upper**2 - lower**2 + far**2) / (2 * far)
    aside = knee - hip
    aside = aside - (aside * way).sum(axis=2, keepdims=True) * way
    forward = forward - (forward * way).sum(axis=2, keepdims=True) * way
    forward = forward / np.linalg.norm(forward, axis=2, keepdims=True)
    before = (aside * forward).sum(axis=2)
    sideways = aside - before[..., None] * forward
    room = np.maximum(upper**2 - along**2, 0.0)
    sideways *= np.minimum(1.0, np.sqrt(room) / np.maximum(np.linalg.norm(sideways, axis=2), 1e-9))[..., None]
    ahead = np.sqrt(np.maximum(room - (sideways**2).sum(axis=2), 0.0))
    # One that was bent backwards gives way first, by a millimetre or two of its leg's length.
    ahead = np.where(before < 0, np.maximum(ahead + 2 * before, -ahead), ahead)
    return hip + along[..., None] * way + sideways + ahead[..., None] * forward
