# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known of people before the data: how far each parameter of a body strays from the marker set's mean.

The fit adds these terms to its squared residuals, so that whatever the data does not carry stays plausible.
"""

import numpy as np

from ..geometry import rotations
from ..kernels import calls
from .bodies import PLACEMENT, Bodies, BodyModel


class PRIOR:
    """What people may do beyond the recordings that a marker set was learned from."""

    # added to the standard deviation of every bend, people do what nobody did when recorded
    bend_floor_rad: float = 0.12  # physical
    # least standard deviation of a height, nobody's is known better than to a millimetre
    height_floor_m: float = 0.001  # physical
    # parts of the height by which the scale along one axis strays from the mean of the three
    stretch_sd: float = 0.03  # physical


class Prior:
    """Negative log-likelihood of bodies, times two: squares in standard deviations, as whitened residuals are.

    height      mean stature, m; the marker set's by default
    height_sd   its standard deviation, m; the marker set's by default, a few cm when a height was measured
    bend_floor  rad, added in quadrature to every recorded standard deviation of a bend
    stretch_sd  how far the scale along one axis strays from the mean of the three, parts of the height
    upright_sd  how far the root's vertical strays from the world's, rad; None holds nothing
    """

    def __init__(
        self,
        model: BodyModel,
        *,
        height: float | None = None,
        height_sd: float | None = None,
        bend_floor: float = PRIOR.bend_floor_rad,
        stretch_sd: float = PRIOR.stretch_sd,
        upright_sd: float | None = None,
    ):
        spread = model.markerset.spread
        self.height = spread.height if height is None else float(height)
        self.height_sd = max(spread.height_sd if height_sd is None else float(height_sd), PRIOR.height_floor_m)
        self.bend_mean = np.asarray(spread.pose_mean, dtype=float)[1:].ravel()
        covariance = np.asarray(spread.pose_covariance, dtype=float)[3:, 3:]
        self.bend_precision = np.linalg.inv(covariance + bend_floor**2 * np.eye(len(covariance)))
        if spread.stiffness is not None:
            self.bend_precision += spread.stiffness[3:, 3:]
        # Of S, 1/m²: its mean about the height, each axis about that mean.
        around = np.eye(3) - np.full((3, 3), 1 / 3)
        stretch = (stretch_sd * self.height) ** 2
        self.scale_precision = np.full((3, 3), 1 / 9) / self.height_sd**2 + around / stretch
        self.upright = 0.0 if upright_sd is None else upright_sd**-2
        self.hessian = self._hessian(model.parameters)
        self.hessian.setflags(write=False)

    def terms(self, bodies: Bodies) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cost (B,), half its gradient (B, P) and half its second derivative (P, P), columns as in `Bodies.moved`.

        A Gauss-Newton step over residuals r with Jacobian J is then -(JᵀJ + hessian)⁻¹ (Jᵀr + gradient). The hessian is
        exact but for the upright term, where it is the bound that holds for a body standing straight.
        """
        bends = bodies.bends[:, 1:].reshape(len(bodies), -1) - self.bend_mean
        bend_slope = bends @ self.bend_precision
        cost, slope, _ = self.placement_terms(bodies)
        cost = cost + np.einsum("bi,bi->b", bends, bend_slope)
        cost += np.einsum("bi,bi->b", bodies.shape, bodies.shape)
        return cost, np.concatenate([slope, bend_slope, bodies.shape], axis=1), self.hessian

    def compiled(self, model: BodyModel):
        """As the compiled fit takes it."""
        return calls.prior_arrays(self, model)

    def placement_terms(self, bodies: Bodies) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same for the nine parameters of a placement alone: (B,), (B, 9) and (9, 9)."""
        scale = bodies.scale - self.height
        gradient = np.zeros((len(bodies), PLACEMENT))
        gradient[:, 6:] = scale_slope = scale @ self.scale_precision
        cost = np.einsum("bi,bi->b", scale, scale_slope)
        if self.upright:
            up = rotations.quaternion_to_matrix(bodies.quaternion)[:, :, 2]
            lean = self.upright * up[:, :2]
            gradient[:, 3] = -lean[:, 1] * up[:, 2]
            gradient[:, 4] = lean[:, 0] * up[:, 2]
            cost += np.einsum("bi,bi->b", lean, up[:, :2])
        return cost, gradient, self.hessian[:PLACEMENT, :PLACEMENT]

    def _hessian(self, parameters: int) -> np.ndarray:
        hessian = np.zeros((parameters, parameters))
        hessian[3:5, 3:5] = self.upright * np.eye(2)
        hessian[6:PLACEMENT, 6:PLACEMENT] = self.scale_precision
        bends_end = PLACEMENT + len(self.bend_mean)
        hessian[PLACEMENT:bends_end, PLACEMENT:bends_end] = self.bend_precision
        hessian[bends_end:, bends_end:] = np.eye(parameters - bends_end)
        return hessian
