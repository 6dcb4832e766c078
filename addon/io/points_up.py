# SPDX-License-Identifier: GPL-3.0-or-later
"""Which axis of a take points up: by what its file says and, where that is doubtful, by what it holds.

A file's word is believed unless several things that do not depend on each other speak against it: force plates lie in
the floor; what falls, falls down; feet that carry somebody stand still on the floor; people are mostly upright, on a
floor at nought, with their feet below. Nobody's pose alone decides, for people also lie and stand on their hands.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SIGNED_AXES = ("+Z", "+Y", "+X", "-Z", "-Y", "-X")

# What a file's word weighs against another axis, and against its own opposite, which nobody confuses by lying down; the
# same where the word is there by habit, or not at all.
WORD_WEIGHT, WORD_OPPOSITE = 2.5, 1.5
HABIT, HABIT_OPPOSITE = 0.9, 1.1
WEIGHTS = {
    "the force plates": 2.0,
    "free falls": 2.0,
    "the feet that stand still": 2.0,
    "how the points stand": 1.0,
    "the feet under the head": 0.8,
}

# A standing person's markers reach from the floor, or a little off it, at least this far up, m.
FLOOR = (-0.3, 0.4)
LEAST_HEIGHT = 0.5
# How much longer than wide the points of one frame are when they can only stand that way.
UPRIGHT = 1.3
STEADY = 0.25  # of the height, how far the lowest point of a standing person goes up and down

LOOKED_AT = 400  # frames
WINDOW, WINDOWS = 500, 8  # frames in a row, and how many such rows, for what moves

PLATE_AREA = (0.01, 20.0)  # m²
LEVEL_FLOOR = 0.95  # cosine of a plate's normal and the axis
BELOW = 0.1  # m, how far under a plate a point may be
ABOVE = 0.9  # share of the points that are above the plates

STEP = 0.04  # s, over which speeds and accelerations are taken
GRAVITY, GRAVITY_ERROR = 9.81, 1.5  # m/s²
FALL = 0.15  # s
LEAST_POINTS = 4

STILL, MOVING = 0.12, 0.4  # m/s
LEAST_STILL = 30  # samples
LOW, LOWS = 0.25, 0.8  # part of the height that is low, and the share of the still points that are there
GATHERED = 0.15  # m, between the quartiles of their heights

ALONG, OFTEN = 0.8, 0.7  # cosine of feet to head and the axis, and the share of frames in which it is so
_HEADS = re.compile(r"[LR]?[FBT]HD\d?|[LR]?_?HD[FB]?|.*HEAD.*|ARIEL|C7|CV7|[LR]?_?SHO(ULDER)?|.*ACROM.*|CLAV|SNJ")
_HIPS = re.compile(r".*([LR]ASI|[LR]PSI|ASIS|PSIS|SACR).*|[LR]_I[AP]S|VSAC")
_FEET = re.compile(r".*(ANK|HEE|TOE|FOOT|CALC|MALL).*|[LR]_?(MT[15]|FCC|FM[125]|FAL|TAM|CAL|MET)")


@dataclass(frozen=True)
class Upright:
    """The axis that points up, such as "+Z", and what to say of it: a sentence where the file says otherwise."""

    axis: str
    notes: tuple[str, ...] = ()


def find_up(
    said: str,
    xyz: np.ndarray,
    names: Sequence[str],
    rate: float,
    plates: np.ndarray | None = None,
    usual: str = "+Z",
    maker: str = "",
) -> Upright:
    """The axis that points up in points (T, P, 3) m with `names` at `rate` frames a second.

    said    the axis that the file says, empty where it says none
    plates  (N, 4, 3) m, corners of force plates, where there are any
    usual   what is likely where the file says nothing that can be believed
    maker   who wrote the file
    """
    base, doubtful = _word(said, usual, maker)
    xyz, names = _largest_subject(xyz, names)
    votes = dict.fromkeys(SIGNED_AXES, 0.0)
    reasons: dict[str, list[str]] = {axis: [] for axis in SIGNED_AXES}
    heard = (
        ("the force plates", _level_with(plates, xyz) if plates is not None else ""),
        ("free falls", _falls(xyz, rate)),
        ("the feet that stand still", _stood_on(xyz, rate)),
        ("how the points stand", _stands(xyz, base)),
        ("the feet under the head", _feet_to_head(xyz, names)),
    )
    for reason, axis in heard:
        if axis:
            votes[axis] += WEIGHTS[reason]
            reasons[axis].append(reason)
    best = max(SIGNED_AXES, key=votes.get)
    weight = (HABIT, HABIT_OPPOSITE) if doubtful else (WORD_WEIGHT, WORD_OPPOSITE)
    needed = weight[best[1] == base[1]]
    up = best if votes[best] - votes[base] > needed else base
    return Upright(up, _told(said, up, usual, reasons[up]))


def _largest_subject(xyz: np.ndarray, names: Sequence[str]) -> tuple[np.ndarray, list[str]]:
    """The points and names of the subject that has most of them: two people together are as wide as they are tall."""
    owners = [name.rpartition(":")[0] for name in names]
    most = max(dict.fromkeys(owners), key=owners.count)
    kept = [index for index, owner in enumerate(owners) if owner == most]
    return xyz[:, kept], [names[index] for index in kept]


def _word(said: str, usual: str, maker: str) -> tuple[str, bool]:
    """What a file says of the up axis, and whether by habit only."""
    if "qualisys" in maker.lower() and said == "-Z":
        return "+Z", True  # Qualisys writes it of worlds that have z up
    if said not in SIGNED_AXES:
        return usual, True  # nothing, or nothing that is an axis
    return said, said == "+Y"  # many programs write that without meaning it, and nobody writes +Z by mistake


def _told(said: str, up: str, usual: str, reasons: Sequence[str]) -> tuple[str, ...]:
    if up == (said if said in SIGNED_AXES else usual):
        return ()
    word = f"says that {said} is up, but" if said in SIGNED_AXES else "does not say which axis is up, and"
    why = " and ".join(reasons) or "what is known of the program that wrote it"
    return (f"the file {word} {up} was taken by {why} (an up axis that is given overrules this)",)


def _level_with(plates: np.ndarray, xyz: np.ndarray) -> str:
    """The axis across the floor that all force plates lie in, on the side where the points are; else empty."""
    normals = np.cross(plates[:, 2] - plates[:, 0], plates[:, 3] - plates[:, 1])
    area = np.linalg.norm(normals, axis=1) / 2
    good = np.isfinite(area) & (area > PLATE_AREA[0]) & (area < PLATE_AREA[1])
    if not good.any():
        return ""
    normals = np.abs(normals[good]) / (2 * area[good, None])
    index = int(normals[0].argmax())
    if (normals[:, index] < LEVEL_FLOOR).any():
        return ""
    above = _heights(xyz, index) - plates[good][..., index].mean()
    sides = [float((sign * above > -BELOW).mean()) > ABOVE for sign in (1, -1)]
    return "" if sides[0] == sides[1] else f"{'+' if sides[0] else '-'}{'XYZ'[index]}"


def _heights(xyz: np.ndarray, index: int) -> np.ndarray:
    """All coordinates of some frames along an axis."""
    values = _some(xyz)[..., index]
    return values[np.isfinite(values)]


def _falls(xyz: np.ndarray, rate: float) -> str:
    """The axis against which all points together fall freely; else empty."""
    half = max(round(STEP * rate), 1)
    longest = dict.fromkeys(SIGNED_AXES, 0)
    for part in _windows(xyz, 2 * half + 1):
        change = part[2 * half :] - 2 * part[half:-half] + part[: -2 * half]
        there = np.isfinite(change).all(axis=2)
        mean = np.where(there[..., None], change, 0).sum(axis=1) / np.maximum(there.sum(axis=1), 1)[:, None]
        mean = np.where((there.sum(axis=1) >= LEAST_POINTS)[:, None], mean * (rate / half) ** 2, 0)
        for axis in SIGNED_AXES:
            falling = np.linalg.norm(mean + GRAVITY * _direction(axis), axis=1) < GRAVITY_ERROR
            longest[axis] = max(longest[axis], _longest_run(falling))
    first, second = sorted(SIGNED_AXES, key=longest.get, reverse=True)[:2]
    return first if longest[first] >= max(FALL * rate, 3, 2 * longest[second]) else ""


def _longest_run(flags: np.ndarray) -> int:
    """How many of `flags` (T,) in a row are true at most."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _stood_on(xyz: np.ndarray, rate: float) -> str:
    """The axis at whose low end the points stand still while the others move; else empty."""
    half = max(round(STEP * rate), 1)
    places, spans = [], []
    for part in _windows(xyz, 2 * half + 1):
        speed = np.linalg.norm(part[2 * half :] - part[: -2 * half], axis=2) * (rate / (2 * half))
        now = part[half:-half]
        known = np.isfinite(speed) & np.isfinite(now).all(axis=2)
        middle = np.array([np.median(row[here]) if here.any() else 0 for row, here in zip(speed, known, strict=True)])
        always = (speed < STILL).sum(axis=0) > 0.95 * np.maximum(known.sum(axis=0), 1)
        still = known & (speed < STILL) & (middle > MOVING)[:, None] & ~always
        frame, point = np.nonzero(still)
        places.append(now[frame, point])
        moving = np.where((known & ~always)[..., None], now, np.nan)[frame]
        spans.append(_ends(moving))
    place, (low, high) = np.concatenate(places), np.concatenate(spans, axis=1)
    if len(place) < LEAST_STILL:
        return ""
    found = []
    for index, name in enumerate("XYZ"):
        reach = high[:, index] - low[:, index]
        if np.median(reach) < LEAST_HEIGHT or np.ptp(np.percentile(place[:, index], [25, 75])) > GATHERED:
            continue
        part = (place[:, index] - low[:, index]) / np.maximum(reach, 1e-9)
        level = np.median(place[:, index])
        found += [f"+{name}"] * bool((part < LOW).mean() > LOWS and FLOOR[0] < level < FLOOR[1])
        found += [f"-{name}"] * bool((part > 1 - LOW).mean() > LOWS and FLOOR[0] < -level < FLOOR[1])
    return found[0] if len(found) == 1 else ""


def _stands(xyz: np.ndarray, base: str) -> str:
    """The axis along which the points stand, longer than wide, on a floor at nought; else empty.

    Only of axes that files mean: that which they say and its opposite, y and z.
    """
    frames = _some(xyz)
    if not len(frames):
        return ""
    low, high = _ends(frames)
    reach = np.median(high - low, axis=0)
    indices = sorted({1, 2, "XYZ".index(base[1])})
    longest = max(indices, key=lambda index: reach[index])
    others = [index for index in indices if index != longest]
    if reach[longest] < LEAST_HEIGHT or reach[longest] <= UPRIGHT * reach[others].max():
        return ""
    found = [
        sign + "XYZ"[longest]
        for sign, ground in (("+", low[:, longest]), ("-", -high[:, longest]))
        if (sign == "+" or base[1] == "XYZ"[longest])
        and FLOOR[0] < np.percentile(ground, 10) < FLOOR[1]
        and np.ptp(np.percentile(ground, [10, 90])) < STEADY * reach[longest]
    ]
    return found[0] if len(found) == 1 else ""


def _feet_to_head(xyz: np.ndarray, names: Sequence[str]) -> str:
    """The axis along which named feet are below named heads or shoulders, or hips where there are none; else empty."""
    bare = [name.rpartition(":")[2].upper() for name in names]
    tops = [index for index, name in enumerate(bare) if _HEADS.fullmatch(name)]
    tops = tops or [index for index, name in enumerate(bare) if _HIPS.fullmatch(name)]
    feet = [index for index, name in enumerate(bare) if _FEET.fullmatch(name) and index not in tops]
    if not tops or not feet:
        return ""
    frames = _some(xyz)
    rise = _middle(frames[:, tops]) - _middle(frames[:, feet])
    length = np.linalg.norm(rise, axis=1)
    rise = (rise[length > 0] / length[length > 0, None])[:, :3]
    if not len(rise):
        return ""
    return next((axis for axis in SIGNED_AXES if (rise @ _direction(axis) > ALONG).mean() > OFTEN), "")


def _middle(points: np.ndarray) -> np.ndarray:
    """(T, 3) the mean of the points (T, P, 3) that are there; NaN where there are none."""
    there = np.isfinite(points).all(axis=2)
    count = there.sum(axis=1)[:, None]
    return np.where(count > 0, np.where(there[..., None], points, 0).sum(axis=1) / np.maximum(count, 1), np.nan)


def _direction(axis: str) -> np.ndarray:
    """(3,) the unit vector of an axis."""
    return np.eye(3)["XYZ".index(axis[1])] * (1.0 if axis[0] == "+" else -1.0)


def _some(xyz: np.ndarray) -> np.ndarray:
    """Frames that have any points, evenly spread."""
    frames = xyz[np.isfinite(xyz).any(axis=(1, 2))]
    return frames[:: max(1, len(frames) // LOOKED_AT)]


def _ends(frames: np.ndarray) -> np.ndarray:
    """(2, T, 3) the least and largest coordinates of the points that are there in frames that have any."""
    low, high = np.where(np.isfinite(frames), frames, np.inf), np.where(np.isfinite(frames), frames, -np.inf)
    return np.stack([low.min(axis=1, initial=np.inf), high.max(axis=1, initial=-np.inf)])


def _windows(xyz: np.ndarray, least: int) -> list[np.ndarray]:
    """Runs of frames in a row, evenly spread over the take, each at least so long; one that is empty else."""
    if len(xyz) <= WINDOW * WINDOWS:
        parts = [xyz]
    else:
        starts = np.linspace(0, len(xyz) - WINDOW, WINDOWS).astype(int)
        parts = [xyz[start : start + WINDOW] for start in starts]
    return [part for part in parts if len(part) >= least] or [np.full((least, *xyz.shape[1:]), np.nan)]
