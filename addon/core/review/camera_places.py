# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera that was moved, found again: where it has to stand so that its blobs fit the points of the others.

Markers are projected where the camera stood, and every difference between a blob and a projection of the same frame
is a vote for a turn; most differences are of blobs of other markers and vote for nothing in particular. From the turn
with the most votes the nearest blobs say the rest.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.cameras import Cameras
from ..geometry.rotations import turn_of
from .camera_order import CAMERA_HEALTH, near_image

TURN_SD_RAD = 0.05  # physical: rad, of a camera's turn about an axis by somebody who knocks against it; 3°
SHIFT_SD_M = 0.05  # physical: m, of how far it is shifted
TURN_REACH_RAD = 2 * TURN_SD_RAD  # how far it is looked for: beyond two standard deviations it was put elsewhere
# measured: rad, width of a bin of the votes, of which three side by side count together; as wide as a body's own image
# is blurred by the turns that are tried.
TURN_BIN_RAD = 0.004  # measured


@dataclass(frozen=True, eq=False)
class CameraPlace:
    """Where a camera was found: rotation (3, 3) and translation (3,) m from world to camera."""

    rotation: np.ndarray
    translation: np.ndarray
    turned: float  # rad from where it stood by its calibration
    shifted: float  # m between where it was and is


def find_again(camera: Cameras, points: np.ndarray, blobs: list[np.ndarray], least: float) -> CameraPlace | None:
    """Where a camera stands by points (F, M, 3) m, NaN where unknown, and its blobs, (N, 2) px for each of F frames.

    `camera` is that one alone. None unless it has a blob for the share `least` of the points where it is found, and for
    fewer where its calibration says.
    """
    rays = [camera.undistort(xy, np.zeros(len(xy), int)) for xy in blobs]
    image = np.full((len(rays), max(map(len, rays), default=0), 2), np.nan)
    for index, part in enumerate(rays):
        image[index, : len(part)] = part
    local = points @ camera.rotation[0].T + camera.translation[0]
    with np.errstate(invalid="ignore"):
        frame, marker = np.nonzero(_inside(camera, points) & (local[..., 2] > 0))
    if len(frame) < CAMERA_HEALTH.enough or image.shape[1] == 0:
        return None
    seen, image = local[frame, marker], image[frame]
    near = float(near_image(camera)[0])
    turn, shift = _refined(seen, image, _voted_turn(seen, image), near)
    before, after = ((_nearest_blobs(at, image)[1] < near).mean() for at in (seen, seen @ turn.T + shift))
    if not before < least <= after:
        return None
    rotation, translation = turn @ camera.rotation[0], turn @ camera.translation[0] + shift
    angle = np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))
    moved = np.linalg.norm(rotation.T @ translation + camera.centres[0])
    return CameraPlace(rotation, translation, float(angle), float(moved))


def _inside(camera: Cameras, points: np.ndarray) -> np.ndarray:
    """(F, M) True where a point may be in the image, also of a camera that was turned a little."""
    pixels = camera.project(points)[0]
    margin = TURN_REACH_RAD * camera.focal[0] / 2
    ideal = camera.normalised(points)[0]
    with np.errstate(invalid="ignore"):
        inside = ((pixels > -margin) & (pixels < camera.size[0] + margin)).all(axis=-1)
        return inside & (np.einsum("fmi,fmi->fm", ideal, ideal) < camera.reach[0] ** 2)


def _voted_turn(seen: np.ndarray, image: np.ndarray) -> np.ndarray:
    """(3, 3) the turn that most blobs vote for; seen (N, 3) m in camera axes, image (N, K, 2) of the same frames."""
    from scipy.ndimage import uniform_filter

    best, turn = -1.0, np.eye(3)
    edges = np.arange(-TURN_REACH_RAD, TURN_REACH_RAD + TURN_BIN_RAD, TURN_BIN_RAD)
    # About its own axis in steps that move the edge of what it sees by a bin.
    step = TURN_BIN_RAD / np.abs(seen[:, :2] / seen[:, 2:]).max()
    for roll in np.arange(-TURN_REACH_RAD, TURN_REACH_RAD, step):
        rolled = turn_of(np.array([0.0, 0.0, roll]))
        turned = seen @ rolled.T
        away = image - (turned[:, :2] / turned[:, 2:])[:, None]
        across, down = away[np.isfinite(away).all(axis=-1)].T
        votes, _, _ = np.histogram2d(across, down, bins=[edges, edges])
        total = uniform_filter(votes, 3, mode="constant")
        at = np.unravel_index(np.argmax(total), total.shape)
        if total[at] > best:
            best = float(total[at])
            x, y = edges[list(at)] + TURN_BIN_RAD / 2
            turn = turn_of(np.array([-y, x, 0.0])) @ rolled
    return turn


def _refined(seen: np.ndarray, image: np.ndarray, turn: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
    """The turn (3, 3) and shift (3,) m that put points (N, 3) on the blobs (N, K, 2) nearest to them."""
    from scipy.optimize import least_squares

    unknown = np.zeros(6)
    sd = np.repeat([TURN_SD_RAD, SHIFT_SD_M], 3)
    seen = seen @ turn.T

    def placed(unknown: np.ndarray) -> np.ndarray:
        return seen @ turn_of(unknown[:3]).T + unknown[3:]

    # Blobs are looked for near and nearer, each time from where the last ones left the camera.
    for reach in np.geomspace(max(4 * TURN_BIN_RAD, near), near, 8):
        off, found = _nearest_blobs(placed(unknown), image)
        close = found < reach
        if close.sum() < len(unknown):
            break
        goal = _imaged(placed(unknown)[close]) + off[close]

        def misses(given: np.ndarray, close=close, goal=goal) -> np.ndarray:
            return np.concatenate([((_imaged(placed(given)[close]) - goal) / near).ravel(), given / sd])

        unknown = least_squares(misses, unknown, loss="soft_l1").x
    small = turn_of(unknown[:3])
    return small @ turn, unknown[3:]


def _imaged(at: np.ndarray) -> np.ndarray:
    """(N, 2) normalised image of points (N, 3) in camera axes."""
    return at[:, :2] / at[:, 2:]


def _nearest_blobs(at: np.ndarray, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2) from the image of each point (N, 3) to the blob nearest to it, and how far that is; inf without one."""
    away = image - _imaged(at)[:, None]
    length = np.nan_to_num(np.linalg.norm(away, axis=-1), nan=np.inf)
    nearest = np.argmin(length, axis=1)
    rows = np.arange(len(at))
    return away[rows, nearest], length[rows, nearest]
