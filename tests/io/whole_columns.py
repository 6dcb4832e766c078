# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of points as whole tables, every column with all of its frames: what lanes are compared with."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from addon.io.c3d.reading import C3dHead, open_c3d
from addon.io.samples import Samples


def dense(frames: int, count: int, parts: Iterable[Samples]) -> tuple[np.ndarray, np.ndarray]:
    """(T, P, 3) and (T, P), NaN where missing."""
    xyz, residual = np.full((frames, count, 3), np.nan), np.full((frames, count), np.nan)
    for part in parts:
        xyz[part.frame, part.column], residual[part.frame, part.column] = part.xyz, part.residual
    return xyz, residual


@dataclass(frozen=True, eq=False)
class WholeC3d(C3dHead):
    """What a C3D file's head says, `xyz` (T, P, 3) and `residual` (T, P) in the file's units."""

    xyz: np.ndarray
    residual: np.ndarray


def read_c3d(path: Path, rate: float | None = None) -> WholeC3d:
    """A whole C3D file."""
    with open_c3d(path, rate) as (head, parts):
        xyz, residual = dense(head.frames, len(head.labels), parts())
        return WholeC3d(**vars(head), xyz=xyz * head.scales[0], residual=residual * head.scales[1])
