# SPDX-License-Identifier: GPL-3.0-or-later
"""Two markers that a 3D system merged into one point: it is not given a wrong name, and the others keep theirs."""

from itertools import combinations

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.points.likelihood.frames import label_frames
from addon.core.simulation.virtual import Act, draw_person, perform
from addon.io.models import open_model

TARGET = 0.999
NEAR = 0.12  # m; markers farther apart do not merge
FRAMES = 8


@pytest.mark.parametrize("at", [0.5, 0.0])
def test_a_point_of_two_markers_is_either_of_them_or_nobody(at):
    known = open_model("body26")
    markerset = known.markerset
    model, markers = BodyModel(markerset), np.arange(len(markerset))
    wrong = others = given = 0
    for seed in range(3):
        chance = np.random.default_rng(seed)
        xyz = model.pose(perform(model, draw_person(markerset, chance), [Act(1.0)], rate=60)).markers
        xyz = xyz[:: len(xyz) // FRAMES][:FRAMES] + chance.normal(0, 0.0005, (FRAMES, len(markers), 3))
        distance = np.median(np.linalg.norm(xyz[:, :, None] - xyz[:, None], axis=-1), axis=0)
        for one, two in combinations(markers, 2):
            if distance[one, two] > NEAR:
                continue
            merged = xyz.copy()
            merged[:, one] += at * (xyz[:, two] - xyz[:, one])
            merged[:, two] = np.nan
            [named] = label_frames(known.likelihood, merged)
            sure = named.sure(TARGET)
            wrong += int(((sure[:, one] >= 0) & ~np.isin(sure[:, one], [one, two])).sum())
            rest = np.setdiff1d(markers, [one, two])
            others += int(((sure[:, rest] >= 0) & (sure[:, rest] != rest)).sum())
            given += int((sure[:, rest] >= 0).sum())
    assert given > 1000
    assert wrong == 0
    assert others <= 0.001 * given
