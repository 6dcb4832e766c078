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
from addon.io.points import of_frames, write_c3d

RATE, GHOSTS, GAP = 60.0, 3, 20
BEHIND, TALLER, BESIDE, SKIN = 40, 1.08, (0.0, 1.2, 0.0), 0.006  # frames, times, m, m


def write_virtual_take(
    folder: Path, last: int, first: int = 1, blobs: str = "take.csv", cameras: str = "cameras.toml"
) -> Points:
    """Write blobs of some frames of the demo, their truth beside them, and the cameras; gives the markers."""
    made, part = make_performance(open_markerset(MODEL)), slice(first - 1, last)
    body = replace(made.body, **{name: getattr(made.body, name)[part] for name in ("rotations", "joints", "scale")})
    take = of_frames(made.take, (first, last))
    for _ in capturing.write_capture(take, made.cameras, TROUBLE, body, folder / blobs):
        pass
    write_cameras(folder / cameras, made.cameras)
    return take


def write_virtual_points(folder: Path, frames: int) -> None:
    """Write walk.c3d to `folder`: the same as 3D points without names, in any order, with gaps and ghosts.

    A take that is longer than the demo's goes back the way it came, and so on.
    """
    rng = np.random.default_rng(7)
    take = make_performance(open_markerset(MODEL)).take
    last = len(take.xyz) - 1
    there_and_back = last - np.abs(last - np.arange(frames) % (2 * last))
    ghosts = np.tile(rng.uniform((-2, -2, 0), (2, 2, 2), (GHOSTS, 3)), (frames, 1, 1))
    xyz = np.concatenate([take.xyz[there_and_back], ghosts], axis=1)
    for trajectory in range(0, xyz.shape[1], 3):
        first = rng.integers(frames - GAP)
        xyz[first : first + GAP, trajectory] = np.nan
    xyz = xyz[:, rng.permutation(xyz.shape[1])]
    residual = np.where(np.isfinite(xyz[..., 0]), 0.0, np.nan)
    write_c3d(folder / "walk.c3d", Points(("",) * xyz.shape[1], xyz, residual, RATE, take.first_frame))


def write_virtual_pair(folder: Path, frames: int) -> None:
    """Write duet.c3d to `folder`, two people of the demo's take beside each other, the one taller and a while behind.

    Beside it are ann.c3d and bob.c3d, the take of each alone with names.
    """
    take = make_performance(open_markerset(MODEL)).take
    later = np.minimum(np.arange(frames) + BEHIND, len(take.xyz) - 1)
    people = {"ann": take.xyz[:frames], "bob": TALLER * take.xyz[later] + np.array(BESIDE)}
    # Skin moves on bones: without it the markers of each segment would be taken for a plate.
    rng = np.random.default_rng(8)
    for name, xyz in people.items():
        waves = rng.uniform(1, 2, xyz.shape[1:]), rng.uniform(0, 6, xyz.shape[1:])
        time = np.arange(frames)[:, None, None] / RATE
        people[name] = xyz + SKIN * np.sin(2 * np.pi * time * waves[0] + waves[1])
    for name, xyz in people.items():
        write_c3d(folder / f"{name}.c3d", Points(take.names, xyz, np.zeros(xyz.shape[:2]), RATE, take.first_frame))
    xyz = np.concatenate(list(people.values()), axis=1)
    xyz = xyz[:, np.random.default_rng(7).permutation(xyz.shape[1])]
    nobody = ("",) * xyz.shape[1]
    write_c3d(folder / "duet.c3d", Points(nobody, xyz, np.zeros(xyz.shape[:2]), RATE, take.first_frame))
