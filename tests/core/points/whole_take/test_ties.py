# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker and one that is none, of which nothing tells which is which: asked once, answered once, and left open."""

import numpy as np
import pytest

from addon.core.data.progress import finished
from addon.core.data.takes import Points
from addon.core.edits.kinds import AssignPoint, Edits
from addon.core.points.whole_take.pipeline import PointOptions, label_points
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from addon.io.models import open_model

FRAMES, RATE = 240, 120.0
MARKER, APART_M, CUT = "RTHI", 0.02, 150
WORDS = f"another marker sits where {MARKER} may be: look which of the two it is"


@pytest.fixture(scope="module")
def model():
    return open_model("body39")


@pytest.fixture(scope="module")
def take(model):
    """The virtual person with a marker beside one of the set's, each as far from its place; that is in two pieces."""
    markers = make_performance(open_markerset("body39")).take.xyz[:FRAMES].astype(float)
    own = model.markerset.index(MARKER)
    beside = markers[:, [own]] - [0.0, 0.0, APART_M]
    markers[:, own] += [0.0, 0.0, APART_M]
    late = np.where(np.arange(FRAMES)[:, None, None] >= CUT + 6, markers[:, [own]], np.nan)
    markers[CUT:, own] = np.nan
    xyz = np.concatenate([markers, late, beside], axis=1)
    return Points(("",) * xyz.shape[1], xyz, np.where(np.isfinite(xyz[..., 0]), 0.0005, np.nan), RATE, 1)


def labelled(take, model, *edits):
    return finished(label_points(take, model, PointOptions("likelihood", edits=Edits(edits))))


def test_a_tie_is_one_question_which_its_own_answer_alone_settles(take, model):
    own, found = model.markerset.index(MARKER), labelled(take, model)
    assert not (found.labels.marker == own).any()
    assert [one.words for one in found.suspects].count(WORDS) == 1
    answered = labelled(take, model, AssignPoint(own, MARKER))
    there = np.isfinite(take.xyz[..., 0])
    assert (answered.labels.marker[there[:, own], own] == own).all()
    assert (answered.labels.marker[there[:, -2], -2] == own).all()
    assert (answered.labels.marker[:, -1] != own).all()
    assert WORDS not in [one.words for one in answered.suspects]
    head = model.markerset.index("LFHD")
    found = labelled(take, model, AssignPoint(head, "LFHD"))
    assert not (found.labels.marker == model.markerset.index(MARKER)).any()
    assert [one.words for one in found.suspects].count(WORDS) == 1
