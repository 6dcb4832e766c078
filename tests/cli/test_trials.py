# SPDX-License-Identifier: GPL-3.0-or-later
"""Trials of a training in processes side by side: the same outcomes in the same order, or one sentence."""

from contextlib import nullcontext

import numpy as np
import pytest

from addon.cli import train
from addon.core.data.errors import JobError
from addon.core.points.likelihood.trials import make_trial
from addon.core.points.likelihood.trying import TrialWork, in_turn
from addon.io.models import open_model


@pytest.fixture(scope="module")
def works():
    """Three trials of a few made-up frames of a built-in set."""
    known, rng = open_model("gait15").likelihood, np.random.default_rng(5)
    found = []
    for _ in range(3):
        modes = rng.standard_normal((6, known.shape.modes.shape[2]))
        clouds = known.shape.mean + np.einsum("mck,fk->fmc", known.shape.modes, modes) + [0.0, 0.0, 0.8]
        trial = make_trial(clouds, (0, 4), (0, 3), rng)
        found.append(TrialWork(known.markers, known.shape, known.constraints, known.rigid_bodies, trial, True))
    return found


def test_in_two_processes_they_are_the_same_to_the_bit(works):
    alone, beside = (list(way(works)) for way in (in_turn, train.trying(2)))
    assert sum(len(outcome.right) for outcome in alone) > 100
    for one, other in zip(alone, beside, strict=True):
        assert one.described.tobytes() == other.described.tobytes()
        assert one.right.tobytes() == other.right.tobytes()


def test_few_are_not_worth_a_process(works, monkeypatch):
    monkeypatch.setattr(train, "crew", None)
    assert len(list(train.trying(None)(works))) == len(list(train.trying(1)(works))) == 3


def test_one_that_cannot_be_made_is_said(works, monkeypatch):
    killed = JobError("its process was killed; expected it to finish", "1.trial")
    monkeypatch.setattr(train, "crew", lambda _: nullcontext(lambda _: iter([(1, killed)])))
    with pytest.raises(JobError, match=r"^a trial could not be made: its process was killed; expected it to finish$"):
        list(train.trying(2)(works))
