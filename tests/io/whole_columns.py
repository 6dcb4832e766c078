# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of points as whole tables, every column with all of its frames: what lanes are compared with."""

from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from addon.io.c3d.reading import open_c3d
from addon.io.samples import Samples


def dense(frames: int, count: int, parts: Iterable[Samples]) -> tuple[np.ndarray, np.ndarray]:
    """(T, P, 3) and (T, P), NaN where missing."""
    xyz, residual = np.full((frames, count, 3), np.nan), np.full((frames, count), np.nan)
    for part in parts:
        xyz[part.frame, part.column], residual[part.frame, part.column] = part.xyz, part.residual
    return xyz, residual


def read_c3d(path: Path, rate: float | None = None) -> SimpleNamespace:
    """What a C3D file says of its points, with `xyz` (T, P, 3) and `residual` (T, P) in the file's units."""
    with open_c3d(path, rate, everything=True) as head:
        xyz, residual = dense(head.frames, head.count, head.parts())
        return SimpleNamespace(**vars(head), xyz=xyz * head.scale[0], residual=residual * head.scale[1])
