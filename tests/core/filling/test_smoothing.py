# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoothing takes away what is fast, leaves what is slow where it is, and joins nothing over gaps."""

import numpy as np
import pytest

from addon.core.filling.smoothing import count_smoothed, smoothed

RATE = 120.0
TIME = np.arange(720) / RATE


def swing(hertz: float) -> np.ndarray:
    """(T, 1, 3) m, a swing of one metre to each side."""
    return np.repeat(np.sin(2 * np.pi * hertz * TIME)[:, None, None], 3, axis=2)


def amplitude(xyz: np.ndarray) -> float:
    return float(np.abs(xyz[200:-200]).max())


@pytest.mark.parametrize("cutoff", [4.0, 8.0, 15.0])
def test_at_the_cut_off_the_amplitude_is_down_by_3_db(cutoff):
    assert amplitude(smoothed(swing(cutoff), RATE, cutoff)) == pytest.approx(np.sqrt(0.5), abs=0.01)
    assert amplitude(smoothed(swing(cutoff / 5), RATE, cutoff)) == pytest.approx(1, abs=0.01)
    assert amplitude(smoothed(swing(3 * cutoff), RATE, cutoff)) < 0.03


def test_nothing_lags_stretches_stand_alone_and_gaps_stay():
    slow = swing(1.5)
    both = smoothed(slow + 0.1 * swing(40.0), RATE, 6.0)
    shifts = range(-5, 6)
    off = [np.abs(np.roll(both, shift, axis=0) - slow)[200:-200].mean() for shift in shifts]
    assert shifts[int(np.argmin(off))] == 0
    xyz = np.concatenate([swing(2.0), 3 + 0 * swing(1.0)], axis=1)
    xyz[300:310, 0] = xyz[500, 0] = xyz[503, 0] = np.nan
    xyz[350:, 1] = 7
    calm = smoothed(xyz, RATE, 6.0)
    np.testing.assert_array_equal(np.isnan(calm), np.isnan(xyz))
    np.testing.assert_array_equal(calm[501:503, 0], xyz[501:503, 0])
    assert count_smoothed(xyz) == [720 - 12 - 2, 720], "two samples between gaps stay"
    alone = smoothed(xyz[310:500, :1], RATE, 6.0)
    np.testing.assert_allclose(calm[310:500, :1], alone)
    still = smoothed(0 * xyz[:200] + 0.25, RATE, 6.0)
    np.testing.assert_allclose(still, 0.25, atol=1e-12)
