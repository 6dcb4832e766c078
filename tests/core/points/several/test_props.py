# SPDX-License-Identifier: GPL-3.0-or-later
"""A prop in somebody's hand is named by its form, and the person from what it leaves."""

import numpy as np
import pytest

from addon.core.data.errors import JobError
from addon.core.data.progress import finished
from addon.core.geometry.rotations import exponential
from addon.core.points.several.pipeline import is_prop, label_several
from addon.core.points.several.wearers import SeveralOptions, Wearer
from addon.core.points.whole_take.pipeline import PointOptions
from addon.core.training.pipeline import TrainingOptions, train
from addon.core.training.takes import LabelledTake
from addon.io.models import open_model
from tests.core.points.several.test_several import person
from tests.core.scenes import anonymous

NAMES = ("GRIP", "NECK", "LEFT", "TOP", "RIGHT")
FORM = np.array([[0.15, 0, 0], [0.35, 0, 0.02], [0.6, 0.11, 0], [0.68, 0, 0.01], [0.55, -0.13, 0.03]])


def swung(frames, seed, place):
    """(T, 5, 3) m, a racket that is turned about, held where `place` (T, 3) is."""
    turn = np.cumsum(np.random.default_rng(seed).normal(0, 0.05, (frames, 3)), axis=0)
    return place[:, None] + np.einsum("tij,mj->tmi", exponential(turn)[0], FORM)


@pytest.fixture(scope="module")
def racket():
    takes = [LabelledTake("racket", "racket", NAMES, swung(120, 0, np.tile([0.0, 0.0, 1.2], (120, 1))))]
    return finished(train(takes, NAMES, TrainingOptions("racket", search="none"))).model


def test_a_prop_in_the_hand_and_who_holds_it_are_named(racket):
    walker, model = person(1, 1, 0.0), open_model("gait15")
    assert is_prop(racket)
    assert not is_prop(model)
    held = swung(len(walker), 3, walker[:, 0] + [0.1, 0.3, 0.2])
    xyz = np.concatenate([walker, held], axis=1)
    order = np.random.default_rng(5).permutation(20)
    take = anonymous(xyz[:, order])
    asked = SeveralOptions(subjects=(Wearer("racket", racket), Wearer("ann", model)))
    found = finished(label_several(take, asked, PointOptions("likelihood")))
    assert found.worn.markers[:6] == (*(f"racket:{name}" for name in NAMES), "ann:SACR")
    truth = np.broadcast_to(np.where(order >= 15, order - 15, order + 5), xyz.shape[:2])
    assert (found.labels.marker[found.labels.named] == truth[found.labels.named]).all()
    assert found.labels.named.mean() > 0.95


def test_a_prop_that_is_not_there_is_said(racket):
    walker = person(1, 1, 0.0)
    asked = SeveralOptions(subjects=(Wearer("ann", open_model("gait15")), Wearer("bat", racket)))
    with pytest.raises(JobError, match="shows no bat, or not often enough to know it by the form of racket; expected"):
        finished(label_several(anonymous(walker), asked, PointOptions("likelihood")))
