# SPDX-License-Identifier: GPL-3.0-or-later
"""Vicon's lens: radial, and given the other way round, from the image that was seen to the one without a lens.

With r the distance from the principal point in the image that was seen, straight = seen · (1 + a r² + b r⁴ + c r⁶).
Taking the lens out is this formula; putting it in is the solution of one equation a point.
"""

import numpy as np

TERMS = 3  # a, b and c


SEEN_STEPS = 200  # of Newton's method at most, far more than points in front of a camera take
SEEN_ERROR = 1e-14  # of the distance from the principal point, or absolute below 1: what double precision can tell


def straighten(image: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Lens-free image coordinates (..., 2) of those seen (..., 2) through lenses (..., 3); NaN beyond the fold."""
    square = np.einsum("...i,...i->...", image, image)
    with np.errstate(invalid="ignore", over="ignore"):
        straight = image * _growth(square, lens)[..., None]
        return np.where((square < turning_point(lens) ** 2)[..., None], straight, np.nan)


def bend(image: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """The inverse of `straighten`, exact to rounding; NaN where the lens lets no light through."""
    radius = np.sqrt(np.einsum("...i,...i->...", image, image))
    lens = np.broadcast_to(lens, (*radius.shape, TERMS))
    seen = np.full(radius.shape, np.nan)
    within = np.isfinite(radius) & (radius < reach(lens))
    seen[within] = _solve(radius[within], lens[within])
    with np.errstate(invalid="ignore"):
        return image * np.where(radius > 0, seen / np.where(radius > 0, radius, 1.0), seen + 1.0)[..., None]


def turning_point(radial: np.ndarray) -> np.ndarray:
    """The radius (...) up to which r (1 + a r² + b r⁴ + c r⁶) rises, `radial` (..., 3) being a, b, c; inf if always.

    With w = 1/r² the turning points are the roots of w³ + 3 a w² + 5 b w + 7 c.
    """
    radial = np.asarray(radial, dtype=float)
    companion = np.zeros((*radial.shape[:-1], 3, 3))
    companion[..., 0, :] = -radial * [3.0, 5.0, 7.0]
    companion[..., 1, 0] = companion[..., 2, 1] = 1
    roots = np.linalg.eigvals(companion)
    first = np.where(np.abs(roots.imag) < 1e-12, roots.real, 0).max(axis=-1)
    with np.errstate(divide="ignore"):
        return 1 / np.sqrt(np.maximum(first, 0) + 0.0)


def reach(lens: np.ndarray) -> np.ndarray:
    """(...) the radius without the lens that is seen at the fold: farther off no light comes through; or inf."""
    end = turning_point(lens)
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(end), end * _growth(end**2, np.asarray(lens)), np.inf)


def nearest_forward(lens: np.ndarray, radius: float) -> np.ndarray:
    """OpenCV's k1 k2 p1 p2 k3 (5,) nearest to a lens (3,) over seen radii up to `radius` (or its fold), least squares.

    For programs that know OpenCV's lens only; a strong lens is beyond three radial terms.
    """
    seen = np.linspace(0, min(radius, 0.999 * float(turning_point(lens))), 200)[1:]
    straight = seen * _growth(seen**2, lens)
    # Scaled by the largest, the columns are near one in size and the solution keeps all its digits.
    largest = straight[-1]
    columns = (straight[:, None] / largest) ** (3, 5, 7)
    solution, *_ = np.linalg.lstsq(columns, (seen - straight) / largest, rcond=None)
    k1, k2, k3 = solution / largest ** np.array([2, 4, 6])
    return np.array([k1, k2, 0, 0, k3])


def _growth(square: np.ndarray, lens: np.ndarray) -> np.ndarray:
    a, b, c = np.moveaxis(lens, -1, 0)
    return 1 + square * (a + square * (b + square * c))


def _slope(square: np.ndarray, lens: np.ndarray) -> np.ndarray:
    a, b, c = np.moveaxis(lens, -1, 0)
    return 1 + square * (3 * a + square * (5 * b + square * 7 * c))


def _solve(straight: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Seen radii (N,) of lens-free radii (N,) below the reach: Newton's method kept within what encloses the root."""
    low, high = np.zeros(len(straight)), turning_point(lens)
    rises = np.isinf(high)
    high[rises] = np.maximum(straight[rises], 1.0)
    with np.errstate(over="ignore"):
        while len(short := rises & (high * _growth(high**2, lens) < straight)) and short.any():
            high[short] *= 2
        seen = np.minimum(straight, high)
        for _ in range(SEEN_STEPS):
            error = seen * _growth(seen**2, lens) - straight
            if np.abs(error / np.maximum(straight, 1)).max(initial=0) < SEEN_ERROR:
                break
            low, high = np.where(error < 0, seen, low), np.where(error > 0, seen, high)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = seen - error / _slope(seen**2, lens)
            seen = np.where((step > low) & (step < high), step, (low + high) / 2)
    return seen
