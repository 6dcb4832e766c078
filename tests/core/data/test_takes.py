# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels are taken apart, put together and given up, with nothing left of what was given up; points become rows."""

import numpy as np
import pytest

from addon.core.data.takes import (
    BY_FIT,
    BY_LIKELIHOOD,
    BY_TRAJECTORY,
    NO_MARKER,
    NO_STEP,
    Labels,
    PointRows,
    Points,
)


@pytest.fixture
def labels() -> Labels:
    """Two frames of three points, the last of which has no name."""
    return Labels(
        np.array([[4, 2, NO_MARKER], [2, 4, NO_MARKER]]),
        np.array([[BY_LIKELIHOOD, BY_TRAJECTORY, NO_STEP], [BY_LIKELIHOOD, BY_LIKELIHOOD, NO_STEP]]),
        np.array([[0.9, 0.8, 0.0], [0.7, 0.6, 0.0]]),
        np.array([[0.999, 0.99, 0.0], [1.0, 0.9, 0.0]]),
    )


def without_rates(labels: Labels) -> Labels:
    return Labels(labels.marker, labels.step, labels.confidence)


def test_parts_come_one_after_the_other(labels):
    whole = Labels.join([labels, labels[:1]])
    for name in ("marker", "step", "confidence", "rate"):
        column = getattr(labels, name)
        np.testing.assert_array_equal(getattr(whole, name), np.concatenate([column, column[:1]]))
    assert Labels.join(part for part in (labels, without_rates(labels))).rate is None, "not all of them were measured"


def test_what_is_not_kept_leaves_nothing_behind(labels):
    before = labels.marker.copy()
    kept = labels.kept(np.array([[True, False, True], [False, True, True]]))
    assert kept.marker.tolist() == [[4, NO_MARKER, NO_MARKER], [NO_MARKER, 4, NO_MARKER]]
    assert kept.step.tolist() == [[BY_LIKELIHOOD, NO_STEP, NO_STEP], [NO_STEP, BY_LIKELIHOOD, NO_STEP]]
    assert kept.confidence.tolist() == [[0.9, 0, 0], [0, 0.6, 0]]
    assert kept.rate.tolist() == [[0.999, 0, 0], [0, 0.9, 0]]
    np.testing.assert_array_equal(labels.marker, before)
    assert without_rates(labels).kept(labels.named).rate is None


def test_others_take_the_place_of_some(labels):
    other = Labels(np.full((2, 3), 7), np.full((2, 3), BY_FIT), np.full((2, 3), 0.5))
    where = np.array([[False, True, True], [False, False, False]])
    made = labels.replaced(where, other)
    assert made.marker.tolist() == [[4, 7, 7], [2, 4, NO_MARKER]]
    assert made.step.tolist() == [[BY_LIKELIHOOD, BY_FIT, BY_FIT], [BY_LIKELIHOOD, BY_LIKELIHOOD, NO_STEP]]
    assert made.confidence.tolist() == [[0.9, 0.5, 0.5], [0.7, 0.6, 0.0]]
    assert made.rate is None, "the rates were not those of both"


def test_sure_are_those_that_are_right_often_enough(labels):
    assert labels.sure(0.99).tolist() == [[4, 2, NO_MARKER], [2, NO_MARKER, NO_MARKER]]
    assert labels.sure(0.999).tolist() == [[4, NO_MARKER, NO_MARKER], [2, NO_MARKER, NO_MARKER]]


def test_points_become_rows_that_call_trajectories_as_their_file_does():
    xyz = np.arange(18.0).reshape(2, 3, 3)
    xyz[0, 1, 2] = np.nan
    residual = np.arange(6.0).reshape(2, 3)
    rows = PointRows.of(Points(("",) * 3, xyz, residual, 100.0, 41, np.array([0, 5, 9])))
    assert rows.frames.tolist() == [41, 42]
    assert rows.frame.tolist() == [0, 0, 1, 1, 1]
    assert rows.trajectory.tolist() == [0, 9, 0, 5, 9]
    np.testing.assert_array_equal(rows.xyz, xyz[[0, 0, 1, 1, 1], [0, 2, 0, 1, 2]])
    assert rows.residual.tolist() == [0, 2, 3, 4, 5]
    assert len(rows) == 5
    assert PointRows.of(Points(("",) * 3, xyz, residual, 100.0, 41)).trajectory.tolist() == [0, 2, 0, 1, 2]
