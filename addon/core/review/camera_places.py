# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera that was moved, found again: where it has to stand so that its blobs fit the points of the others.

Markers are projected where the camera stood, and every difference between a blob and a projection of the same frame
is a vote for a turn; most differences are of blobs of other markers and vote for nothing in particular. From the turn
with the most votes the nearest blobs say the rest.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.cameras import Cameras
from ..geometry.rotations import exponential
from .camera_order import near_image


@dataclass(frozen=True)
class FindAgainOptions:
    """How a camera that was moved is looked for; reckoned, tried on virtual rooms.

    reach_rad      how far a camera may be turned
    roll_rad       about its own axis, and
    roll_step_rad  the steps in which that is tried: less than what makes a body's own image too wide for a bin
    bin_rad        width of a bin of the votes, of which three side by side count together
    nearest_rad    how far from its projection a marker's blob is looked for, one round after the other
    steps          of Gauss and Newton in each round
    shift_sd_m     standard deviation of a camera's shift, and
    turn_sd_rad    of its turn, where the blobs do not tell one from the other
    noise_rad      standard deviation of blobs
    min_points     markers in the image, over all frames, to find a camera by
    min_gain       times as many markers have a blob where the camera is found, and
    min_share      this part of them
    """

    reach_rad: float = 0.10
    roll_rad: float = 0.06
    roll_step_rad: float = 0.01
    bin_rad: float = 0.004
    nearest_rad: tuple[float, ...] = (0.015, 0.008, 0.005, 0.003, 0.003)
    steps: int = 4
    shift_sd_m: float = 0.05
    turn_sd_rad: float = 0.05
    noise_rad: float = 3e-4
    min_points: int = 100
    min_gain: float = 1.3
    min_share: float = 0.3


FINDING_AGAIN = FindAgainOptions()


@dataclass(frozen=True, eq=False)
class Place:
    """Where a camera was found: rotation (3, 3) and translation (3,) m from world to camera.

    turned  rad from where it stood by its calibration
    shifted m between where it was and is
    """

    rotation: np.ndarray
    translation: np.ndarray
    turned: float
    shifted: float


def find_again(camera: Cameras, points: np.ndarray, blobs: list[np.ndarray]) -> Place | None:
    """Where a camera stands by points (F, M, 3) m, NaN where unknown, and its blobs, (N, 2) px for each of F frames.

    `camera` is that one alone. None where it cannot be told, or it is where its calibration says.
    """
    image = _padded([camera.undistort(xy, np.zeros(len(xy), int)) for xy in blobs])
    local = points @ camera.rotation[0].T + camera.translation[0]
    with np.errstate(invalid="ignore"):
        inside = _inside(camera, points) & (local[..., 2] > 0)
    frame, marker = np.nonzero(inside)
    if len(frame) < FINDING_AGAIN.min_points or image.shape[1] == 0:
        return None
    seen, image = local[frame, marker], image[frame]
    near = float(near_image(camera)[0])
    turn, shift = _refined(seen, image, _voted_turn(seen, image))
    before, after = _share(seen, image, near), _share(seen @ turn.T + shift, image, near)
    if after < max(FINDING_AGAIN.min_gain * before, FINDING_AGAIN.min_share):
        return None
    rotation, translation = turn @ camera.rotation[0], turn @ camera.translation[0] + shift
    angle = np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))
    moved = np.linalg.norm(rotation.T @ translation + camera.centres[0])
    return Place(rotation, translation, float(angle), float(moved))


def _inside(camera: Cameras, points: np.ndarray) -> np.ndarray:
    """(F, M) True where a point may be in the image, also of a camera that was turned a little."""
    pixels = camera.project(points)[0]
    margin = FINDING_AGAIN.reach_rad * camera.focal[0] / 2
    ideal = camera.normalised(points)[0]
    with np.errstate(invalid="ignore"):
        inside = ((pixels > -margin) & (pixels < camera.size[0] + margin)).all(axis=-1)
        return inside & (np.einsum("fmi,fmi->fm", ideal, ideal) < camera.reach[0] ** 2)


def _padded(rows: list[np.ndarray]) -> np.ndarray:
    """(F, K, 2) of lists of (N, 2), NaN where there is nothing."""
    table = np.full((len(rows), max(map(len, rows), default=0), 2), np.nan)
    for index, part in enumerate(rows):
        table[index, : len(part)] = part
    return table


def _voted_turn(seen: np.ndarray, image: np.ndarray) -> np.ndarray:
    """(3, 3) the turn that most blobs vote for; seen (N, 3) m in camera axes, image (N, K, 2) of the same frames."""
    best, turn = -1.0, np.eye(3)
    count = int(np.ceil(FINDING_AGAIN.roll_rad / FINDING_AGAIN.roll_step_rad))
    side = 2 * int(np.ceil(FINDING_AGAIN.reach_rad / FINDING_AGAIN.bin_rad)) + 1
    for roll in np.arange(-count, count + 1) * FINDING_AGAIN.roll_step_rad:
        rolled = exponential(np.array([0.0, 0.0, roll]))[0]
        turned = seen @ rolled.T
        away = image - (turned[:, :2] / turned[:, 2:])[:, None]
        away = away[np.isfinite(away).all(axis=-1)]
        cell = np.round(away / FINDING_AGAIN.bin_rad).astype(int) + side // 2
        cell = cell[((cell >= 0) & (cell < side)).all(axis=1)]
        votes = np.bincount(cell[:, 0] * side + cell[:, 1], minlength=side * side).reshape(side, side)
        wide = np.pad(votes, 1)
        total = sum(wide[i : i + side, j : j + side] for i in range(3) for j in range(3))
        at = np.unravel_index(np.argmax(total), total.shape)
        if total[at] > best:
            best = float(total[at])
            x, y = (np.array(at) - side // 2) * FINDING_AGAIN.bin_rad
            turn = exponential(np.array([-y, x, 0.0]))[0] @ rolled
    return turn


def _refined(seen: np.ndarray, image: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The turn (3, 3) and shift (3,) m that put points (N, 3) on the blobs (N, K, 2) nearest to them."""
    shift = np.zeros(3)
    held = np.diag(1 / np.repeat([FINDING_AGAIN.turn_sd_rad, FINDING_AGAIN.shift_sd_m], 3) ** 2)
    first = turn
    for reach in FINDING_AGAIN.nearest_rad:
        for _ in range(FINDING_AGAIN.steps):
            at = seen @ turn.T + shift
            off, found = _nearest_blobs(at, image)
            near = found < reach
            if near.sum() < len(held):
                return turn, shift
            slope = _slopes(at[near])
            weight = 1 / (FINDING_AGAIN.noise_rad * np.maximum(found[near], FINDING_AGAIN.noise_rad))
            normal = np.einsum("nai,naj,n->ij", slope, slope, weight) + held
            # What has been turned and shifted so far is held back too, from where the votes left the camera.
            so_far = np.concatenate([_vector(turn @ first.T), shift])
            step = np.linalg.solve(normal, np.einsum("nai,na,n->i", slope, off[near], weight) - held @ so_far)
            small = exponential(step[:3])[0]
            turn, shift = small @ turn, small @ shift + step[3:]
    return turn, shift


def _vector(turn: np.ndarray) -> np.ndarray:
    """(3,) the rotation vector of a small turn (3, 3)."""
    return np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2


def _nearest_blobs(at: np.ndarray, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2) from the image of each point (N, 3) to the blob nearest to it, and how far that is; inf without one."""
    away = image - (at[:, :2] / at[:, 2:])[:, None]
    length = np.linalg.norm(away, axis=-1)
    length[~np.isfinite(length)] = np.inf
    nearest = np.argmin(length, axis=1)
    rows = np.arange(len(at))
    return away[rows, nearest], length[rows, nearest]


def _slopes(at: np.ndarray) -> np.ndarray:
    """(N, 2, 6) how images of points (N, 3) move with a small turn and a shift of the camera."""
    x, y, z = at.T
    slope = np.zeros((len(at), 2, 3))
    slope[:, 0, 0] = slope[:, 1, 1] = 1 / z
    slope[:, 0, 2], slope[:, 1, 2] = -x / z**2, -y / z**2
    around = np.zeros((len(at), 3, 3))
    around[:, 0, 1], around[:, 0, 2], around[:, 1, 2] = z, -y, x
    around -= around.transpose(0, 2, 1)
    return np.concatenate([slope @ around, slope], axis=2)


def _share(at: np.ndarray, image: np.ndarray, near: float) -> float:
    """Part of points (N, 3) with a blob where they are seen."""
    return float((_nearest_blobs(at, image)[1] < near).mean())
