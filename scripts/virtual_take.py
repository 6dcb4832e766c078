# SPDX-License-Identifier: GPL-3.0-or-later
"""The beginning of the demo's take as files, for window tests and screenshots."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from addon import capturing
from addon.core.data.takes import Points
from addon.demo.take import MODEL, TROUBLE, make_performance
from addon.io.cameras import write_cameras
from addon.io.markersets import open_markerset
from addon.io.points import write_c3d

RATE, GHOSTS, GAP = 60.0, 3, 20


def write_virtual_take(folder: Path, frames: int) -> None:
    """Write take.csv, its truth take.csv.truth.csv and cameras.toml to `folder`: the demo's first `frames` frames."""
    made, first = make_performance(open_markerset(MODEL)), slice(0, frames)
    body = replace(made.body, **{name: getattr(made.body, name)[first] for name in ("rotations", "joints", "scale")})
    take = replace(made.take, xyz=made.take.xyz[first])
    for _ in capturing.write_capture(take, made.cameras, TROUBLE, body, folder / "take.csv"):
        pass
    write_cameras(folder / "cameras.toml", made.cameras)


def write_virtual_points(folder: Path, frames: int) -> None:
    """Write walk.c3d to `folder`: the same as 3D points without names, in any order, with gaps and ghosts."""
    rng = np.random.default_rng(7)
    take = make_performance(open_markerset(MODEL)).take
    ghosts = np.tile(rng.uniform((-2, -2, 0), (2, 2, 2), (GHOSTS, 3)), (frames, 1, 1))
    xyz = np.concatenate([take.xyz[:frames], ghosts], axis=1)
    for trajectory in range(0, xyz.shape[1], 3):
        first = rng.integers(frames - GAP)
        xyz[first : first + GAP, trajectory] = np.nan
    xyz = xyz[:, rng.permutation(xyz.shape[1])]
    residual = np.where(np.isfinite(xyz[..., 0]), 0.0, np.nan)
    write_c3d(folder / "walk.c3d", Points(("",) * xyz.shape[1], xyz, residual, RATE, take.first_frame))
