# SPDX-License-Identifier: GPL-3.0-or-later
"""Made-up camera rigs: the first paper's four corners, and rings of any number of cameras around a volume."""

import numpy as np

from ..geometry.cameras import Cameras

PAPER_SIZE = (656, 491)
PAPER_CORNER = (2.4, 2.15)
PAPER_HEIGHT = 2.4
# The paper's volume is 2 m tall; up to this far around its middle a person of 2 m is whole in every image.
VOLUME_RADIUS = 0.6
VOLUME_HEIGHT = 2.0
MARGIN = 6.0
# A good 6 mm lens: about three pixels of barrel at the corners.
LENS = (-0.06, 0.03, 0.0004, -0.0003, 0.0)


def paper_rig(generator: np.random.Generator | None = None) -> Cameras:
    """The first paper's rig: 4 cameras of 656×491 px in the corners around a volume of 2 × 1.8 × 2 m.

    With a generator the rig is one that somebody put up by hand: cameras up to 0.3 m from their corners, 2.2 to
    2.6 m high, aimed and focused a little differently, the whole rig turned about the vertical.
    """
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    centres = np.column_stack([signs * PAPER_CORNER, np.full(4, PAPER_HEIGHT)])
    return _rig(centres, PAPER_SIZE, generator)


def ring_rig(
    count: int,
    size: tuple[int, int] = PAPER_SIZE,
    radius: float = 3.2,
    height: float = PAPER_HEIGHT,
    volume_radius: float = VOLUME_RADIUS,
    generator: np.random.Generator | None = None,
) -> Cameras:
    """`count` cameras of `size` px evenly on a circle of `radius` m, `height` m high, that see a cylinder whole.

    Every image holds the cylinder of `volume_radius` m around the origin from the floor to 2 m. With a generator the
    cameras are shaken as in `paper_rig`. Raises ValueError when the circle is inside the cylinder.
    """
    if radius <= volume_radius:
        raise ValueError(f"cameras at {radius} m cannot see a cylinder of {volume_radius} m from outside")
    # Two cameras that face each other see the same thing, and four in a square come in two such pairs: the quarter
    # step keeps the smallest rigs apart from the person's own axes without making a difference to the others.
    angle = 2 * np.pi * (np.arange(count) + 0.25) / count if count > 2 else np.pi * (0.25 + 0.5 * np.arange(count))
    centres = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, float(height))])
    return _rig(centres, size, generator, volume_radius)


def _rig(
    centres: np.ndarray,
    size: tuple[int, int],
    generator: np.random.Generator | None,
    volume_radius: float = VOLUME_RADIUS,
) -> Cameras:
    """Cameras at centres (C, 3) m that look at the volume's middle through the longest lens that still sees it all."""
    count = len(centres)
    targets = np.tile([0.0, 0.0, VOLUME_HEIGHT / 2], (count, 1))
    slack = np.ones(count)
    if generator is not None:
        turn = generator.uniform(0, 2 * np.pi)
        centres = centres + generator.uniform(-0.3, 0.3, (count, 3)) * [1, 1, 2 / 3]
        centres = centres @ [[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
        targets = targets + generator.uniform(-0.1, 0.1, (count, 3))
        slack = generator.uniform(0.95, 1.0, count)
    rotation = np.stack([_look_at(eye, target) for eye, target in zip(centres, targets, strict=True)])
    lens = np.array(LENS)
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    rim = np.stack([volume_radius * np.cos(angle), volume_radius * np.sin(angle)], axis=1)
    outline = np.concatenate([np.column_stack([rim, np.full(48, z)]) for z in (0.0, VOLUME_HEIGHT)])
    middle = (np.array(size) - 1) / 2
    focal = np.empty(count)
    for index in range(count):
        local = (outline - centres[index]) @ rotation[index].T
        # The barrel only pulls inward, so fitting the pinhole image fits the real one.
        reach = np.abs(local[:, :2] / local[:, 2:]).max(axis=0)
        focal[index] = slack[index] * ((middle - MARGIN) / reach).min()
    matrix = np.zeros((count, 3, 3))
    matrix[:, 0, 0] = matrix[:, 1, 1] = focal
    matrix[:, :2, 2] = middle
    matrix[:, 2, 2] = 1
    return Cameras(
        names=tuple(f"cam{index + 1}" for index in range(count)),
        size=np.tile(size, (count, 1)),
        matrix=matrix,
        distortion=np.tile(lens, (count, 1)),
        rotation=rotation,
        translation=-np.einsum("cij,cj->ci", rotation, centres),
    )


def _look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(3, 3) world to camera of a level camera at `eye` that looks at `target`: +z ahead, +y down."""
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])
