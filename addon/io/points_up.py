# SPDX-License-Identifier: GPL-3.0-or-later
"""Which axis of a take points up: by what its file says and, where that is doubtful, by what it holds.

A file's word is believed unless several things that do not depend on each other speak against it: force plates lie in
the floor; what falls, falls down; feet that carry somebody stand still on the floor; people are mostly upright, on a
floor at nought, with their feet below. Nobody's pose alone decides, for people also lie and stand on their hands.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..core.data.lanes import Lanes, blocks, standing_in

SIGNED_AXES = ("+Z", "+Y", "+X", "-Z", "-Y", "-X")

# As text: takes without names need none of it, and compiling it takes as long as reading one.
_HEADS = r"[LR]?[FBT]HD\d?|[LR]?_?HD[FB]?|.*HEAD.*|ARIEL|C7|CV7|[LR]?_?SHO(ULDER)?|.*ACROM.*|CLAV|SNJ"
_HIPS = r".*([LR]ASI|[LR]PSI|ASIS|PSIS|SACR).*|[LR]_I[AP]S|VSAC"
_FEET = r".*(ANK|HEE|TOE|FOOT|CALC|MALL).*|[LR]_?(MT[15]|FCC|FM[125]|FAL|TAM|CAL|MET)"


@dataclass(frozen=True)
class WordOptions:
    """What a file's word weighs against its witnesses, and these among each other; reckoned.

    word             against another axis, and
    word_opposite    against its own opposite, which nobody confuses by lying down
    habit            the same where the word is there by habit, or not at all,
    habit_opposite   and against the opposite
    plates           force plates lie in the floor
    falls            what falls, falls down
    still_feet       feet that carry somebody stand still
    standing         the points stand, longer than wide
    feet_to_head     named feet are below named heads
    """

    word: float = 2.5
    word_opposite: float = 1.5
    habit: float = 0.9
    habit_opposite: float = 1.1
    plates: float = 2.0
    falls: float = 2.0
    still_feet: float = 2.0
    standing: float = 1.0
    feet_to_head: float = 0.8


@dataclass(frozen=True)
class LookOptions:
    """How much of a take the witnesses look at; reckoned.

    frames         evenly spread, for how points stand
    window_frames  in a row, for what moves, and
    windows        how many such rows
    step_s         over which speeds and accelerations are taken
    max_cells      times trajectories, that a take of few frames may have to be looked at in one row of them; by memory
    """

    frames: int = 400
    window_frames: int = 500
    windows: int = 8
    step_s: float = 0.04
    max_cells: int = 5_000_000


@dataclass(frozen=True)
class StandingOptions:
    """How a standing person's points lie; reckoned.

    floor_m        from here to there above nought the lowest marker is
    min_height_m   that the markers reach up from it
    min_longer     times as long as wide, the points of one frame can only stand that way
    max_wander     of the height, how far the lowest point of a standing person goes up and down
    min_cosine     of feet to head and the axis, in
    min_often      so large a share of the frames
    """

    floor_m: tuple[float, float] = (-0.3, 0.4)
    min_height_m: float = 0.5
    min_longer: float = 1.3
    max_wander: float = 0.25
    min_cosine: float = 0.8
    min_often: float = 0.7


@dataclass(frozen=True)
class PlateOptions:
    """Force plates that tell where the floor is; reckoned.

    area_m2      from the least to the largest that a plate can have
    min_level    cosine of a plate's normal and the axis
    max_below_m  how far under a plate a point may be
    min_above    share of the points that are above the plates
    """

    area_m2: tuple[float, float] = (0.01, 20.0)
    min_level: float = 0.95
    max_below_m: float = 0.1
    min_above: float = 0.9


@dataclass(frozen=True)
class FallOptions:
    """What is a free fall; reckoned.

    gravity     m/s²
    max_error   m/s², that the points' mean acceleration may differ from it
    min_s       that it lasts
    min_points  in a frame
    """

    gravity: float = 9.81
    max_error: float = 1.5
    min_s: float = 0.15
    min_points: int = 4


@dataclass(frozen=True)
class StillOptions:
    """Which points are feet that carry somebody; reckoned.

    max_speed     m/s of what stands still, while the others are faster than
    min_moving    m/s
    min_always    share of its time in which what never moves, and so is no foot, stands still
    min_samples   of points that stand still
    max_low       part of the height that is low, and
    min_share_low of the still points that are there
    max_spread_m  between the quartiles of their heights
    """

    max_speed: float = 0.12
    min_moving: float = 0.4
    min_always: float = 0.95
    min_samples: int = 30
    max_low: float = 0.25
    min_share_low: float = 0.8
    max_spread_m: float = 0.15


WEIGHING = WordOptions()
LOOK = LookOptions()
STANDING = StandingOptions()
PLATES = PlateOptions()
FALLS = FallOptions()
STILL = StillOptions()


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
    lanes: Lanes | None = None,
) -> Upright:
    """The axis that points up in points (T, L, 3) m with `names` at `rate` frames a second.

    said    the axis that the file says, empty where it says none
    plates  (N, 4, 3) m, corners of force plates, where there are any
    usual   what is likely where the file says nothing that can be believed
    maker   who wrote the file
    lanes   which of the names stands where; None where each has a lane of its own
    """
    base, doubtful = _word(said, usual, maker)
    standing = standing_in(lanes, xyz.shape)
    seen = _Seen(xyz, standing, _largest_subject(names))
    votes = dict.fromkeys(SIGNED_AXES, 0.0)
    reasons: dict[str, list[str]] = {axis: [] for axis in SIGNED_AXES}
    heard = (
        ("the force plates", WEIGHING.plates, _level_with(plates, seen) if plates is not None else ""),
        ("free falls", WEIGHING.falls, _falls(seen, rate)),
        ("the feet that stand still", WEIGHING.still_feet, _stood_on(seen, rate)),
        ("how the points stand", WEIGHING.standing, _stands(seen, base)),
        ("the feet under the head", WEIGHING.feet_to_head, _feet_to_head(seen, names)),
    )
    for reason, weight, axis in heard:
        if axis:
            votes[axis] += weight
            reasons[axis].append(reason)
    best = max(SIGNED_AXES, key=votes.get)
    needed = (WEIGHING.habit, WEIGHING.habit_opposite) if doubtful else (WEIGHING.word, WEIGHING.word_opposite)
    up = best if votes[best] - votes[base] > needed[best[1] == base[1]] else base
    return Upright(up, _note(said, up, usual, reasons[up]))


def _largest_subject(names: Sequence[str]) -> np.ndarray:
    """(P,) True for the subject that has most of the names: two people together are as wide as they are tall."""
    owners = [name.rpartition(":")[0] for name in names]
    most = max(dict.fromkeys(owners), key=owners.count)
    return np.array([owner == most for owner in owners], bool)


class _Seen:
    """The points of one subject in a take: (T, L, 3) m by lanes, of which the trajectories `own` (P,) are looked at."""

    def __init__(self, xyz: np.ndarray, lanes: Lanes, own: np.ndarray):
        self.xyz, self.lanes = xyz, lanes
        # A trajectory that is left out is as if it were nowhere.
        self.own = Lanes(lanes.lane, lanes.first, np.where(own, lanes.last, -1))

    @cached_property
    def frames(self) -> np.ndarray:
        """Numbers of the frames that have any points, evenly spread."""
        there = np.zeros(len(self.xyz), bool)
        for part in blocks(*self.xyz.shape[:2]):
            there[part] = (np.isfinite(self.xyz[part]).any(axis=2) & (self.own.table(part) >= 0)).any(axis=1)
        found = np.flatnonzero(there)
        return found[:: max(1, len(found) // LOOK.frames)]

    @cached_property
    def some(self) -> np.ndarray:
        """(F, L, 3) m, those frames."""
        stand = np.zeros((len(self.frames), self.xyz.shape[1]), bool)
        row, one = np.nonzero(self._there(np.arange(len(self.own))))
        stand[row, self.own.lane[one]] = True
        return np.where(stand[..., None], self.xyz[self.frames], np.nan)

    def _there(self, spans: np.ndarray) -> np.ndarray:
        """(F, N) whether some trajectories are in those frames."""
        return (self.own.first[spans] <= self.frames[:, None]) & (self.frames[:, None] <= self.own.last[spans])

    def of(self, trajectories: Sequence[int]) -> np.ndarray:
        """(F, N, 3) m, some trajectories in those frames."""
        spans = np.asarray(trajectories, int)
        return np.where(self._there(spans)[..., None], self.xyz[self.frames[:, None], self.own.lane[spans]], np.nan)

    def windows(self, least: int) -> Iterator[np.ndarray]:
        """Runs of frames in a row, evenly spread over the take, each at least so long; one that is empty else.

        Each is (F, N, 3) m, a column for each trajectory that is there.
        """
        count, found = len(self.xyz), False
        whole = count <= LOOK.window_frames * LOOK.windows and count * len(self.own) <= LOOK.max_cells
        starts = np.linspace(0, max(count - LOOK.window_frames, 0), LOOK.windows).astype(int)
        for start in [0] if whole else np.unique(starts).tolist():
            part = self._in_columns(slice(start, count if whole else min(start + LOOK.window_frames, count)))
            if len(part) >= least:
                found = True
                yield part
        if not found:
            yield np.full((least, *self.xyz.shape[1:]), np.nan)

    def _in_columns(self, part: slice) -> np.ndarray:
        """(F, N, 3) m, frames from start to stop with a column for each trajectory that is there."""
        here = np.flatnonzero((self.own.last >= part.start) & (self.own.first < part.stop))
        if len(here) == self.xyz.shape[1] and self.lanes.count == len(self.lanes):
            return self.xyz[part]  # each has a lane of its own
        found = np.full((part.stop - part.start, len(here), 3), np.nan)
        for column, one in enumerate(here.tolist()):
            own = slice(max(int(self.own.first[one]), part.start), min(int(self.own.last[one]) + 1, part.stop))
            found[own.start - part.start : own.stop - part.start, column] = self.xyz[own, self.own.lane[one]]
        return found


def _word(said: str, usual: str, maker: str) -> tuple[str, bool]:
    """What a file says of the up axis, and whether by habit only."""
    if "qualisys" in maker.lower() and said == "-Z":
        return "+Z", True  # Qualisys writes it of worlds that have z up
    if said not in SIGNED_AXES:
        return usual, True  # nothing, or nothing that is an axis
    return said, said == "+Y"  # many programs write that without meaning it, and nobody writes +Z by mistake


def _note(said: str, up: str, usual: str, reasons: Sequence[str]) -> tuple[str, ...]:
    if up == (said if said in SIGNED_AXES else usual):
        return ()
    word = f"says that {said} is up, but" if said in SIGNED_AXES else "does not say which axis is up, and"
    why = " and ".join(reasons) or "what is known of the program that wrote it"
    return (f"the file {word} {up} was taken by {why} (an up axis that is given overrules this)",)


def _level_with(plates: np.ndarray, seen: _Seen) -> str:
    """The axis across the floor that all force plates lie in, on the side where the points are; else empty."""
    normals = np.cross(plates[:, 2] - plates[:, 0], plates[:, 3] - plates[:, 1])
    area = np.linalg.norm(normals, axis=1) / 2
    good = np.isfinite(area) & (area > PLATES.area_m2[0]) & (area < PLATES.area_m2[1])
    if not good.any():
        return ""
    normals = np.abs(normals[good]) / (2 * area[good, None])
    index = int(normals[0].argmax())
    if (normals[:, index] < PLATES.min_level).any():
        return ""
    above = _heights(seen, index) - plates[good][..., index].mean()
    sides = [float((sign * above > -PLATES.max_below_m).mean()) > PLATES.min_above for sign in (1, -1)]
    return "" if sides[0] == sides[1] else f"{'+' if sides[0] else '-'}{'XYZ'[index]}"


def _heights(seen: _Seen, index: int) -> np.ndarray:
    """All coordinates of some frames along an axis."""
    values = seen.some[..., index]
    return values[np.isfinite(values)]


def _falls(seen: _Seen, rate: float) -> str:
    """The axis against which all points together fall freely; else empty."""
    half = max(round(LOOK.step_s * rate), 1)
    longest = dict.fromkeys(SIGNED_AXES, 0)
    for part in seen.windows(2 * half + 1):
        change = part[2 * half :] - 2 * part[half:-half] + part[: -2 * half]
        there = np.isfinite(change).all(axis=2)
        mean = np.where(there[..., None], change, 0).sum(axis=1) / np.maximum(there.sum(axis=1), 1)[:, None]
        mean = np.where((there.sum(axis=1) >= FALLS.min_points)[:, None], mean * (rate / half) ** 2, 0)
        for axis in SIGNED_AXES:
            falling = np.linalg.norm(mean + FALLS.gravity * _direction(axis), axis=1) < FALLS.max_error
            longest[axis] = max(longest[axis], _longest_run(falling))
    first, second = sorted(SIGNED_AXES, key=longest.get, reverse=True)[:2]
    return first if longest[first] >= max(FALLS.min_s * rate, 3, 2 * longest[second]) else ""


def _longest_run(flags: np.ndarray) -> int:
    """How many of `flags` (T,) in a row are true at most."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _stood_on(seen: _Seen, rate: float) -> str:
    """The axis at whose low end the points stand still while the others move; else empty."""
    half = max(round(LOOK.step_s * rate), 1)
    places, spans = [], []
    for part in seen.windows(2 * half + 1):
        speed = np.linalg.norm(part[2 * half :] - part[: -2 * half], axis=2) * (rate / (2 * half))
        now = part[half:-half]
        known = np.isfinite(speed) & np.isfinite(now).all(axis=2)
        middle = _medians(speed, known)
        always = (speed < STILL.max_speed).sum(axis=0) > STILL.min_always * np.maximum(known.sum(axis=0), 1)
        still = known & (speed < STILL.max_speed) & (middle > STILL.min_moving)[:, None] & ~always
        frame, point = np.nonzero(still)
        places.append(now[frame, point])
        spans.append(_ends(np.where((known & ~always)[..., None], now, np.nan))[:, frame])
    place, (low, high) = np.concatenate(places), np.concatenate(spans, axis=1)
    if len(place) < STILL.min_samples:
        return ""
    found = []
    for index, name in enumerate("XYZ"):
        reach = high[:, index] - low[:, index]
        if (
            np.median(reach) < STANDING.min_height_m
            or np.ptp(np.percentile(place[:, index], [25, 75])) > STILL.max_spread_m
        ):
            continue
        part = (place[:, index] - low[:, index]) / np.maximum(reach, 1e-9)
        level = np.median(place[:, index])
        found += [f"+{name}"] * bool((part < STILL.max_low).mean() > STILL.min_share_low and _on_floor(level))
        found += [f"-{name}"] * bool((part > 1 - STILL.max_low).mean() > STILL.min_share_low and _on_floor(-level))
    return found[0] if len(found) == 1 else ""


def _medians(values: np.ndarray, there: np.ndarray) -> np.ndarray:
    """(F,) the median of each row of `values` (F, N) where it is `there`; 0 where it is nowhere."""
    order = np.sort(np.pad(np.where(there, values, np.inf), ((0, 0), (0, 1)), constant_values=np.inf), axis=1)
    count, row = there.sum(axis=1), np.arange(len(order))
    middle = order[row, np.maximum(count - 1, 0) // 2] / 2 + order[row, count // 2] / 2
    return np.where(count > 0, middle, 0)


def _on_floor(height: float) -> bool:
    """Whether a height, m, is one where the lowest marker of somebody who stands may be."""
    return STANDING.floor_m[0] < height < STANDING.floor_m[1]


def _stands(seen: _Seen, base: str) -> str:
    """The axis along which the points stand, longer than wide, on a floor at nought; else empty.

    Only of axes that files mean: that which they say and its opposite, y and z.
    """
    frames = seen.some
    if not len(frames):
        return ""
    low, high = _ends(frames)
    reach = np.median(high - low, axis=0)
    indices = sorted({1, 2, "XYZ".index(base[1])})
    longest = max(indices, key=lambda index: reach[index])
    others = [index for index in indices if index != longest]
    if reach[longest] < STANDING.min_height_m or reach[longest] <= STANDING.min_longer * reach[others].max():
        return ""
    found = [
        sign + "XYZ"[longest]
        for sign, ground in (("+", low[:, longest]), ("-", -high[:, longest]))
        if (sign == "+" or base[1] == "XYZ"[longest])
        and _on_floor(np.percentile(ground, 10))
        and np.ptp(np.percentile(ground, [10, 90])) < STANDING.max_wander * reach[longest]
    ]
    return found[0] if len(found) == 1 else ""


def _feet_to_head(seen: _Seen, names: Sequence[str]) -> str:
    """The axis along which named feet are below named heads or shoulders, or hips where there are none; else empty."""
    bare = [name.rpartition(":")[2].upper() for name in names]
    if not any(bare):
        return ""
    tops = [index for index, name in enumerate(bare) if re.fullmatch(_HEADS, name)]
    tops = tops or [index for index, name in enumerate(bare) if re.fullmatch(_HIPS, name)]
    feet = [index for index, name in enumerate(bare) if re.fullmatch(_FEET, name) and index not in tops]
    if not tops or not feet:
        return ""
    rise = _middle(seen.of(tops)) - _middle(seen.of(feet))
    length = np.linalg.norm(rise, axis=1)
    rise = (rise[length > 0] / length[length > 0, None])[:, :3]
    if not len(rise):
        return ""
    return next(
        (axis for axis in SIGNED_AXES if (rise @ _direction(axis) > STANDING.min_cosine).mean() > STANDING.min_often),
        "",
    )


def _middle(points: np.ndarray) -> np.ndarray:
    """(T, 3) the mean of the points (T, P, 3) that are there; NaN where there are none."""
    there = np.isfinite(points).all(axis=2)
    count = there.sum(axis=1)[:, None]
    return np.where(count > 0, np.where(there[..., None], points, 0).sum(axis=1) / np.maximum(count, 1), np.nan)


def _direction(axis: str) -> np.ndarray:
    """(3,) the unit vector of an axis."""
    return np.eye(3)["XYZ".index(axis[1])] * (1.0 if axis[0] == "+" else -1.0)


def _ends(frames: np.ndarray) -> np.ndarray:
    """(2, T, 3) the least and largest coordinates of the points that are there in frames that have any."""
    low, high = np.where(np.isfinite(frames), frames, np.inf), np.where(np.isfinite(frames), frames, -np.inf)
    return np.stack([low.min(axis=1, initial=np.inf), high.max(axis=1, initial=-np.inf)])
