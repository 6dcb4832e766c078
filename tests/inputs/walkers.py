# SPDX-License-Identifier: GPL-3.0-or-later
"""Two virtual people who walk side by side, 1 m apart: their points without names, the truth, and what cameras see."""

from pathlib import Path

import numpy as np

from addon.cli import main
from addon.core.body.bodies import BodyModel
from addon.core.data.takes import Points
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.virtual import Act, draw_person, perform
from addon.io.cameras import write_cameras
from addon.io.labels import POINT_KEYS, TruthWriter
from addon.io.markersets import open_markerset
from addon.io.points import write_c3d

FRAMES, RATE, FIRST = 40, 50.0, 7
WORN = "gait15"


def write_pair(folder: Path):
    """Writes `pair.c3d` and `truth.csv`, and the same under their names as `named.c3d`."""
    markerset = open_markerset(WORN)
    model, people = BodyModel(markerset), []
    for seed in (1, 2):
        generator = np.random.default_rng(seed)
        bodies = perform(model, draw_person(markerset, generator), [Act(FRAMES / RATE)], rate=RATE)
        markers = model.pose(bodies).markers[:FRAMES]
        markers[..., :2] += np.array([0.0, float(seed)]) - markers[0, :, :2].mean(axis=0)
        people.append(markers)
    xyz = np.concatenate(people, axis=1)
    names = [f"{number}:{name}" for number in (1, 2) for name in markerset.markers]
    order = np.concatenate([[0], 1 + np.random.default_rng(4).permutation(len(names) - 1)])
    residual = np.full((FRAMES, len(names)), 0.0005)
    write_c3d(folder / "pair.c3d", Points(("",) * len(names), xyz[:, order], residual, RATE, FIRST))
    write_c3d(folder / "named.c3d", Points(tuple(names), xyz, residual, RATE, FIRST))
    with TruthWriter(folder / "truth.csv", POINT_KEYS) as writer:
        keys = [(frame, point) for frame in range(FRAMES) for point in range(len(names))]
        writer.write([f"{FIRST + frame},{point}" for frame, point in keys], [names[order[point]] for _, point in keys])


def write_seen(folder: Path):
    """Writes the pair, what a ring of eight cameras sees of them (`seen.csv` and its truth), and `room.toml`."""
    write_pair(folder)
    write_cameras(folder / "room.toml", ring_rig(8, (1280, 1024), 4.0, 2.2, 1.6))
    words = "--cameras", folder / "room.toml", "--centre", "--out", folder / "seen.csv", "--calibration-mm", "0.3"
    assert main([str(word) for word in ("simulate", folder / "named.c3d", *words)]) == 0
