# SPDX-License-Identifier: GPL-3.0-or-later
"""What a laboratory records beside points: events, and the force of force plates and where it acts."""

from dataclasses import dataclass

import numpy as np

MIN_FORCE = 20.0  # N; physical: of less a plate's noise makes any place


@dataclass(frozen=True, eq=False)
class ForcePlate:
    """A force plate, and the force with which it pushes back, over the F frames of its file."""

    corners: np.ndarray  # (4, 3) m
    force: np.ndarray  # (F, 3) N
    place: np.ndarray  # (F, 3) m, NaN where hardly any force says where it acts


@dataclass(frozen=True, eq=False)
class LabRecords:
    """Events, each a name and a frame of the source, and force plates, whose frames begin at `first`."""

    first: int
    events: tuple[tuple[str, float], ...] = ()
    plates: tuple[ForcePlate, ...] = ()


NO_LAB = LabRecords(0)


def force_on_plate(
    kind: int, corners: np.ndarray, origin: np.ndarray, channels: np.ndarray, matrix: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The force (F, 3) N of a plate of the kinds 1 to 4, and where on its surface it acts (F, 3), NaN where unknown.

    All lengths are in one unit, also those in moments. corners (4, 3); origin (3,) from the sensors to the middle of
    the surface, in the plate's axes, or the other way round, as many programs write it; channels (F, 6), of kind 3
    (F, 8); matrix (6, 6) by whose columns the channels of kind 4 are multiplied.
    Source: C3D user guide, FORCE_PLATFORM:TYPE, CORNERS, ORIGIN and CAL_MATRIX.
    """
    along, across = corners[0] - corners[1], corners[0] - corners[3]
    down = np.cross(along, across)
    axes = np.stack([along, np.cross(down, along), down])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    if kind == 3:
        one, two, depth = *abs(origin[:2]), -abs(origin[2])
        x12, x34, y14, y23, z1, z2, z3, z4 = channels.T
        force = np.stack([x12 + x34, y14 + y23, z1 + z2 + z3 + z4], axis=1)
        turning = np.stack([two * (z1 + z2 - z3 - z4), one * (z2 + z3 - z1 - z4)], axis=1)
        origins = [np.array([0, 0, depth])]
    else:
        wrench = channels @ matrix if kind == 4 else channels
        force, turning = wrench[:, :3], wrench[:, 3:5]
        # The sensors are below the surface: where z says nothing, the force is nearer to the plate.
        origins = [origin if origin[2] <= 0 else -origin, *([-origin] if origin[2] == 0 else [])]
    pushing = np.abs(force[:, 2]) >= MIN_FORCE
    found = []
    for own in origins:
        local = np.zeros_like(force)
        if kind == 1:
            local[:, :2] = turning
        else:
            moment = turning + np.cross(force, own)[:, :2]
            with np.errstate(divide="ignore", invalid="ignore"):
                local[:, :2] = np.stack([-moment[:, 1], moment[:, 0]], axis=1) / force[:, 2:]
        local[~pushing] = np.nan
        found.append(local)
    off = [np.linalg.norm(local[pushing], axis=1).sum() for local in found]
    return force @ axes, found[int(np.argmin(off))] @ axes + corners.mean(axis=0)
