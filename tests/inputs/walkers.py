# SPDX-License-Identifier: GPL-3.0-or-later
"""Two virtual people who walk side by side, 1 m apart: their points without names, the truth, and what cameras see."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from addon.cli import main
from addon.core.data.takes import Points
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.virtual import Act
from addon.io.cameras import write_cameras
from addon.io.labels import POINT_KEYS, TruthWriter
from addon.io.markersets import open_markerset
from addon.io.points import write_c3d
from tests.core.scenes import walker

FRAMES, RATE, FIRST = 40, 50.0, 7
WORN = "gait15"


def write_pair(folder: Path):
    """Writes `pair.c3d` and `truth.csv`, and the same under their names as `named.c3d`."""
    people = [walker(WORN, seed, [Act(FRAMES / RATE)], RATE, noise=0.0)[:FRAMES] for seed in (1, 2)]
    for number, markers in enumerate(people, 1):
        markers[..., :2] += np.array([0.0, float(number)]) - markers[0, :, :2].mean(axis=0)
    xyz = np.concatenate(people, axis=1)
    names = [f"{number}:{name}" for number in (1, 2) for name in open_markerset(WORN).markers]
    order = np.concatenate([[0], 1 + np.random.default_rng(4).permutation(len(names) - 1)])
    residual = np.full((FRAMES, len(names)), 0.0005)
    write_c3d(folder / "pair.c3d", Points(("",) * len(names), xyz[:, order], residual, RATE, FIRST))
    write_c3d(folder / "named.c3d", Points(tuple(names), xyz, residual, RATE, FIRST))
    write_truth(folder / "truth.csv", xyz[:, order], [names[marker] for marker in order], FIRST)


def write_truth(path: Path, xyz: np.ndarray, names: Sequence[str], first: int):
    """Writes which markers the points (T, P, 3) m are that are there, as `evaluate` compares labels with."""
    frame, point = np.nonzero(np.isfinite(xyz[..., 0]))
    with TruthWriter(path, POINT_KEYS) as writer:
        writer.write([f"{first + f},{p}" for f, p in zip(frame, point, strict=True)], [names[p] for p in point])


def write_seen(folder: Path):
    """Writes the pair, what a ring of eight cameras sees of them (`seen.csv` and its truth), and `room.toml`."""
    write_pair(folder)
    write_cameras(folder / "room.toml", ring_rig(8, (1280, 1024), 4.0, 2.2, 1.6))
    words = "--cameras", folder / "room.toml", "--centre", "--out", folder / "seen.csv", "--calibration-mm", "0.3"
    assert main([str(word) for word in ("simulate", folder / "named.c3d", *words)]) == 0
