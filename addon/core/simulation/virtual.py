# SPDX-License-Identifier: GPL-3.0-or-later
"""Virtual people moving: bodies drawn from a marker set's spread, that stand, walk, turn and raise their arms.

No recorded motion is in here. Joint angles of a stride are a few key values on a closed curve, rounded from what any
textbook on gait draws; where the person goes follows from the feet, which stay where they are put down.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import Bodies, BodyModel
from ..data.markersets import MarkerSet
from ..geometry import rotations

# Degrees over one stride of that leg, the thigh against the upright: (share of the stride, angle); 0 is heel strike.
HIP_FLEXION = ((0.0, 21), (0.12, 17), (0.5, -18), (0.6, -11), (0.84, 23))
KNEE_FLEXION = ((0.0, 5), (0.13, 16), (0.38, 5), (0.5, 14), (0.6, 42), (0.71, 62), (0.95, 4))
ANKLE_FLEXION = ((0.0, 1), (0.07, -5), (0.3, 6), (0.45, 9), (0.6, -12), (0.72, 0), (0.85, 3))

# Radians to either side with every stride, as the curves above; then of an elbow in the middle of its swing, and least.
PELVIS_LIST, PELVIS_TURN, THORAX_TURN, THORAX_LEAN, HEAD_TURN, ARM_SWING = np.radians((3.0, 4.0, 7.0, 2.0, 4.0, 20.0))
ELBOW_SWING, LEAST_ELBOW = np.radians((14.0, 8.0))
MAX_SPREAD = 2.0  # standard deviations: beyond them bodies stop looking like people
HARMONICS = 5  # that a curve is rounded to: gait is described by five or six (Winter, Biomechanics, 2.2)
STRIDES_PER_S, STATURE_M = 0.92, 1.7  # 110 steps a minute, of an adult; shorter legs swing faster
ACT_EASE_S = 0.6  # over which one act flows into the next: a step's time
STEP_EASE_S = 0.12  # over which the weight goes from foot to foot: the time on both feet
STANCE_SHARE = 0.58  # of its stride, from heel strike, through which a foot carries; people's 58 to 62 %
STANCE_EASE = 0.06  # of a stride, within which it lets go: half the time on both feet
MIN_STRIDE = 0.15  # below it both feet carry all the time: steps of 10 cm are none
SOLE_SOFTNESS_M = 0.004  # how far above the lowest point of the soles the floor still holds a foot: a shoe's
ARMS_UP_RAD = 2.6  # of an arm that is raised: 150 degrees
SWAY_RAD, SWAY_HZ = 0.02, (0.1, 0.6)  # how far waist, arms and head wander, and how fast: nobody stands quite still


@dataclass(frozen=True)
class Act:
    """A part of a performance."""

    seconds: float  # how long it lasts
    stride: float = 0.0  # format: length of the steps, 0 (standing) to 1 (a brisk walk)
    turn: float = 0.0  # physical: rad, how far the person turns to the left meanwhile
    left: float = 0.0  # format: how far the left arm is raised, 0 (hanging) to 1 (up)
    right: float = 0.0  # format: the same of the right arm


# Twelve seconds that stay within a square of three metres.
DEMO = (
    Act(1.0),
    Act(2.2, stride=0.9),
    Act(2.2, stride=0.35, turn=np.pi),
    Act(1.6, stride=0.9),
    Act(0.8),
    Act(1.6, left=0.8, right=0.8),
    Act(1.4, right=1.0, turn=np.pi / 3),
    Act(1.2),
)


def draw_person(markerset: MarkerSet, generator: np.random.Generator) -> Bodies:
    """One body in the rest pose, its stature, build and marker placement drawn from the marker set's spread."""
    model, spread = BodyModel(markerset), markerset.spread
    height = spread.height + spread.height_sd * _within(generator, ())
    own = _within(generator, (1, len(markerset), 3)) * spread.marker_sd[None, :, None] / np.sqrt(3)
    return replace(model.rest(1, float(height)), shape=_within(generator, (1, len(spread.modes))), own=own)


def perform(
    model: BodyModel, person: Bodies, acts: Sequence[Act] = DEMO, rate: float = 60.0, seed: int = 0, facing: float = 0.0
) -> Bodies:
    """The person (a batch of one) over the frames of the acts, with the middle of the way at the world's origin.

    `rate` is frames a second and `facing` the direction that the person faces first, rad. Soles touch the floor and
    stay where they touch it. Segments go by the names of the built-in marker sets; those that a set lacks stay still.
    """
    generator = np.random.default_rng(seed)
    stature = float(person.scale.mean())
    time, stride, heading, arms = _plan(acts, rate)
    pace = STRIDES_PER_S * np.sqrt(STATURE_M / stature) / rate
    cycles = np.cumsum(np.full(len(time), pace)) + generator.random()
    bends, tilt = _bends(model.markerset, time, cycles, stride, arms, generator)
    turn = rotations.about_z(heading + facing)
    along = rotations.quaternion_to_matrix(turn) @ tilt[..., None]
    bodies = replace(
        person.pick(np.zeros(len(time), dtype=int)),
        translation=np.zeros((len(time), 3)),
        quaternion=rotations.turned(turn, along[..., 0]),
        bends=person.bends + bends,
    )
    way = _way(*_soles(model, bodies, cycles, stride), rate)
    way[:, :2] -= (way[:, :2].max(axis=0) + way[:, :2].min(axis=0)) / 2
    return replace(bodies, translation=way)


def _within(generator: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Standard normal numbers, none beyond MAX_SPREAD."""
    return np.clip(generator.standard_normal(shape), -MAX_SPREAD, MAX_SPREAD)


def _plan(acts: Sequence[Act], rate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Time (T,) s, stride (T,), heading (T,) rad and arms (T, 2) of left and right: acts that flow into one another."""
    ends = np.cumsum([act.seconds for act in acts])
    time = np.arange(round(ends[-1] * rate)) / rate
    which = np.minimum(np.searchsorted(ends, time, side="right"), len(acts) - 1)
    rows = np.array([(act.stride, act.turn / act.seconds, act.left, act.right) for act in acts])[which]
    smooth = _smoothed(rows, ACT_EASE_S * rate)
    return time, smooth[:, 0], np.cumsum(smooth[:, 1]) / rate, smooth[:, 2:]


def _smoothed(rows: np.ndarray, width: float) -> np.ndarray:
    """Columns (T, N) under a bell of `width` frames."""
    window = np.hanning(max(int(width), 1) + 2)[1:-1]
    padded = np.pad(rows, ((len(window) // 2, (len(window) - 1) // 2), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, window / window.sum(), mode="valid") for column in padded.T], axis=1)


def _cycle(keys: tuple[tuple[float, float], ...], phase: np.ndarray) -> np.ndarray:
    """Radians at `phase` (strides) of a closed curve through angles (share of a stride, degrees), without corners."""
    at = np.linspace(0, 1, 100, endpoint=False)
    share, angle = np.array(keys).T
    spectrum = np.fft.rfft(np.interp(at, share, np.radians(angle), period=1))[: HARMONICS + 1] / len(at)
    turns = np.exp(2j * np.pi * np.outer(phase, np.arange(HARMONICS + 1)))
    return (turns * spectrum * np.where(np.arange(HARMONICS + 1) == 0, 1, 2)).real.sum(axis=1)


def _bends(
    markerset: MarkerSet,
    time: np.ndarray,
    cycles: np.ndarray,
    stride: np.ndarray,
    arms: np.ndarray,
    generator: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation vectors of the joints (T, J, 3) and of the pelvis against its heading (T, 3), rad.

    About y: a leg, arm or head swings back, a knee bends, a toe points down; about x: the left side comes up.
    """
    segments = {name: index for index, name in enumerate(markerset.skeleton.segments)}
    bends = np.zeros((len(time), len(segments), 3))

    def bend(name: str, axis: int, angle: np.ndarray):
        if name in segments:
            bends[:, segments[name], axis] += angle

    swing = 2 * np.pi * cycles
    listing = PELVIS_LIST * stride * np.sin(swing)
    for side, sign, lag, raised in (("L", 1, 0.0, arms[:, 0]), ("R", -1, 0.5, arms[:, 1])):
        phase = cycles + lag
        bend(f"thigh.{side}", 1, -stride * _cycle(HIP_FLEXION, phase))
        bend(f"thigh.{side}", 0, -listing)
        bend(f"shank.{side}", 1, stride * _cycle(KNEE_FLEXION, phase))
        bend(f"foot.{side}", 1, -stride * _cycle(ANKLE_FLEXION, phase))
        away = stride * (1 - np.clip(raised, 0, 1))
        bend(f"upper_arm.{side}", 1, away * ARM_SWING * np.cos(2 * np.pi * phase))
        bend(f"upper_arm.{side}", 0, sign * ARMS_UP_RAD * raised)
        bend(f"forearm.{side}", 1, -LEAST_ELBOW - away * ELBOW_SWING * (1 - np.cos(2 * np.pi * phase)) / 2)
    bend("thorax", 2, THORAX_TURN * stride * np.cos(swing))
    bend("thorax", 1, THORAX_LEAN * stride)
    bend("head", 2, -HEAD_TURN * stride * np.cos(swing))
    for name in ("thorax", "head", "upper_arm.L", "upper_arm.R", "forearm.L", "forearm.R"):
        for axis in range(3):
            bend(name, axis, _sway(time, generator))
    zero = np.zeros_like(time)
    return bends, np.stack([listing, zero, -PELVIS_TURN * stride * np.cos(swing)], axis=1)


def _sway(time: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """A slow wander, rad: nobody stands quite still."""
    speed, phase = generator.uniform(*SWAY_HZ, 3), generator.uniform(0, 2 * np.pi, 3)
    size = SWAY_RAD * generator.uniform(0.2, 1.0, 3)
    return (size * np.sin(2 * np.pi * speed * time[:, None] + phase)).sum(axis=1)


def _soles(model: BodyModel, bodies: Bodies, cycles: np.ndarray, stride: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T, P, 3) the lowest points of the feet's capsules, m, and how much each foot carries (T, P), 0 to 1.

    Marker sets without feet stand on the ends of their shanks.
    """
    capsules, names = model.markerset.capsules, model.markerset.skeleton.segments
    part = next((part for part in ("foot", "shank") if f"{part}.L" in names and f"{part}.R" in names), None)
    if part is None:
        raise ValueError(f"marker set {model.markerset.name} has no segments foot.L and foot.R to stand on")
    points, carries, posed = [], [], model.pose(bodies)
    for side, lag in (("L", 0.0), ("R", 0.5)):
        index = names.index(f"{part}.{side}")
        chosen = np.flatnonzero(capsules.segment == index)
        local = np.concatenate([capsules.start[chosen], capsules.end[chosen]])
        turned = (local * bodies.scale[:, None]) @ posed.rotations[:, index].transpose(0, 2, 1)
        below = np.tile(capsules.radius[chosen], 2) * bodies.scale.mean(axis=1)[:, None]
        points.append(posed.joints[:, index, None] + turned - below[..., None] * [0, 0, 1])
        since = (cycles + lag + STANCE_EASE / 2) % 1
        stands = np.clip(np.minimum(since, STANCE_SHARE + STANCE_EASE - since) / STANCE_EASE, 0, 1)
        carried = 1 - np.minimum(stride / MIN_STRIDE, 1) * (1 - stands)
        carries.append(np.repeat(carried[:, None], len(local), axis=1))
    return np.concatenate(points, axis=1), np.concatenate(carries, axis=1)


def _way(soles: np.ndarray, carries: np.ndarray, rate: float) -> np.ndarray:
    """(T, 3) the way of a body on soles (T, P, 3) that are given as if the body stood on the spot.

    What carries stays: the body moves by what its soles on the floor would have moved the other way.
    """
    height = soles[..., 2]
    weight = carries * np.exp(-(height - height.min(axis=1, keepdims=True)) / SOLE_SOFTNESS_M) + 1e-12
    weight /= weight.sum(axis=1, keepdims=True)
    between = (weight[1:] + weight[:-1]) / 2
    steps = -(between[..., None] * np.diff(soles, axis=0)).sum(axis=1)[:, :2]
    way = np.zeros((len(soles), 3))
    way[1:, :2] = np.cumsum(_smoothed(steps, STEP_EASE_S * rate), axis=0)
    lift = -(weight * height).sum(axis=1)
    # A toe that swings too low lifts the person a little instead of going through the floor.
    sunk = np.maximum(-(height.min(axis=1) + lift), 0)
    way[:, 2] = _smoothed((lift + sunk)[:, None], STEP_EASE_S * rate)[:, 0]
    return way
