# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectories smoothed as biomechanics does it: a Butterworth filter forth and back, by its cut-off in Hz.

Source: D. A. Winter, Biomechanics and Motor Control of Human Movement, chapter on kinematics, for the filter and for
correcting its cut-off.
"""

import numpy as np

from ..data.errors import InputError
from ..review.suspects import runs

FILTER_ORDER = 2  # of the source above; it runs twice, once forth, once back, so that nothing lags


def smoothed(xyz: np.ndarray, rate: float, cutoff: float) -> np.ndarray:
    """Trajectories (T, M, 3) m, NaN where missing, without what is faster than `cutoff`, Hz.

    Each stretch between gaps stands alone. Raises InputError where the rate has no room for such a cut-off.
    """
    from scipy.signal import butter, sosfiltfilt

    if not 0 < cutoff < rate / 2:
        words = f"the cut-off of the smoothing is {cutoff:g} Hz at {rate:g} frames a second"
        raise InputError(f"{words}; expected one above 0 and below {rate / 2:g} Hz, half of that")
    # After both runs the amplitude at the cut-off is down by 3 dB. The filter made of samples bends frequencies by a
    # tangent, and is exact where it was asked to be.
    bent = np.tan(np.pi * cutoff / rate) / (np.sqrt(2) - 1) ** (1 / (2 * FILTER_ORDER))
    sections = butter(FILTER_ORDER, rate / np.pi * np.arctan(bent), fs=rate, output="sos")
    calm, present = xyz.copy(), np.isfinite(xyz).all(axis=2)
    for marker in range(xyz.shape[1]):
        for start, stop in _long_stretches(present[:, marker]):
            # Mirrored at the ends for as long as the filter remembers.
            pad = min(stop - start - 1, int(np.ceil(2 * rate / cutoff)))
            calm[start:stop, marker] = sosfiltfilt(sections, xyz[start:stop, marker], axis=0, padlen=pad)
    return calm


def count_smoothed(xyz: np.ndarray) -> list[int]:
    """How many samples of each of M trajectories (T, M, 3) m, NaN where missing, `smoothed` changes."""
    return [sum(stop - start for start, stop in _long_stretches(one)) for one in np.isfinite(xyz).all(axis=2).T]


def _long_stretches(present: np.ndarray) -> list[tuple[int, int]]:
    """Those of the samples (T,) that are there; a shorter one says nothing of frequencies."""
    return [one for one in runs(present) if one[1] - one[0] > 2 * FILTER_ORDER - 1]
