# SPDX-License-Identifier: GPL-3.0-or-later
"""Made-up camera rigs: the first paper's four corners, and rings of any number of cameras around a volume."""

import numpy as np

from ..geometry.cameras import Cameras

PAPER_SIZE_PX = (656, 491)  # the first paper, 5: its images
PAPER_CORNER_M, PAPER_HEIGHT_M = (2.4, 2.15), 2.4  # the same: its cameras, from the middle of the volume and high
VOLUME_RADIUS_M, VOLUME_HEIGHT_M = 0.6, 2.0  # the same: a person with arms out who is as tall as people are is in it
RIG_LENS = (-0.06, 0.03, 0.0004, -0.0003, 0.0)  # k1, k2, p1, p2, k3 of a good 6 mm lens: 3 px of barrel at corners
MARGIN_PX = 6.0  # at the edge of the images that stays free: a marker's image
RING_RADIUS_M = 3.2  # of a ring of cameras, in a room of 7 m
# Of a rig put up by hand: by how much a camera is off its place along the axes, as tripods stand, and aims beside the
# middle, two degrees; and the share of the focal length that is not used, as lenses are set by hand.
OFF_M, OFF_TARGET_M, MAX_SLACK = np.array([0.3, 0.3, 0.2]), 0.1, 0.05


def paper_rig(generator: np.random.Generator | None = None) -> Cameras:
    """The first paper's rig: 4 cameras of 656×491 px in the corners around a volume of 2 × 1.8 × 2 m.

    With a generator the rig is one that somebody put up by hand: cameras up to 0.3 m from their corners, 2.2 to
    2.6 m high, aimed and focused a little differently, the whole rig turned about the vertical.
    """
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    centres = np.column_stack([signs * PAPER_CORNER_M, np.full(4, PAPER_HEIGHT_M)])
    return _rig(centres, PAPER_SIZE_PX, generator)


def ring_rig(
    count: int,
    size: tuple[int, int] = PAPER_SIZE_PX,
    radius: float = RING_RADIUS_M,
    height: float = PAPER_HEIGHT_M,
    volume_radius: float = VOLUME_RADIUS_M,
    generator: np.random.Generator | None = None,
) -> Cameras:
    """`count` cameras of `size` px evenly on a circle of `radius` m, `height` m high, that see a cylinder whole.

    Every image holds the cylinder of `volume_radius` m around the origin from the floor to 2 m. With a generator the
    cameras are shaken as in `paper_rig`. Raises ValueError when the circle is inside the cylinder.
    """
    if radius <= volume_radius:
        raise ValueError(f"cameras at {radius} m cannot see a cylinder of {volume_radius} m from outside")
    # Two cameras that face each other see the same thing, and four in a square come in two such pairs: the quarter
    # step keeps the smallest rigs off the person's own axes without making a difference to the others.
    angle = 2 * np.pi * (np.arange(count) + 0.25) / count if count > 2 else np.pi * (0.25 + 0.5 * np.arange(count))
    centres = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, float(height))])
    return _rig(centres, size, generator, volume_radius)


def _rig(
    centres: np.ndarray,
    size: tuple[int, int],
    generator: np.random.Generator | None,
    volume_radius: float = VOLUME_RADIUS_M,
) -> Cameras:
    """Cameras at centres (C, 3) m that look at the volume's middle through the longest lens that still sees it all."""
    count = len(centres)
    targets = np.tile([0.0, 0.0, VOLUME_HEIGHT_M / 2], (count, 1))
    slack = np.ones(count)
    if generator is not None:
        turn = generator.uniform(0, 2 * np.pi)
        centres = centres + generator.uniform(-1, 1, (count, 3)) * OFF_M
        centres = centres @ [[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
        targets = targets + generator.uniform(-OFF_TARGET_M, OFF_TARGET_M, (count, 3))
        slack = generator.uniform(1 - MAX_SLACK, 1.0, count)
    rotation = np.stack([_look_at(eye, target) for eye, target in zip(centres, targets, strict=True)])
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    rim = np.stack([volume_radius * np.cos(angle), volume_radius * np.sin(angle)], axis=1)
    outline = np.concatenate([np.column_stack([rim, np.full(48, z)]) for z in (0.0, VOLUME_HEIGHT_M)])
    middle = (np.array(size) - 1) / 2
    focal = np.empty(count)
    for index in range(count):
        local = (outline - centres[index]) @ rotation[index].T
        # The barrel only pulls inward, so fitting the pinhole image fits the real one.
        reach = np.abs(local[:, :2] / local[:, 2:]).max(axis=0)
        focal[index] = slack[index] * ((middle - MARGIN_PX) / reach).min()
    matrix = np.zeros((count, 3, 3))
    matrix[:, 0, 0] = matrix[:, 1, 1] = focal
    matrix[:, :2, 2] = middle
    matrix[:, 2, 2] = 1
    return Cameras(
        names=tuple(f"cam{index + 1}" for index in range(count)),
        size=np.tile(size, (count, 1)),
        matrix=matrix,
        distortion=np.tile(RIG_LENS, (count, 1)),
        rotation=rotation,
        translation=-np.einsum("cij,cj->ci", rotation, centres),
    )


def _look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(3, 3) world to camera of a level camera at `eye` that looks at `target`: +z ahead, +y down."""
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])
