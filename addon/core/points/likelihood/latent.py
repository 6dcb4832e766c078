# SPDX-License-Identifier: GPL-3.0-or-later
"""The linear algebra of a shape with place and yaw added: weighted marker positions in, best latent vector out."""

from dataclasses import dataclass

import numpy as np

from ...geometry.upright import turned
from .shape import Shape

PLACE, YAW, FIRST_MODE = slice(0, 3), 3, 4  # columns of a latent vector


@dataclass(frozen=True)
class LatentOptions:
    """How freely a shape is placed.

    place_sd_radii  where the subject stands is as good as unknown; physical: a room is six times as wide as a person
    yaw_sd_rad      of one step; physical: the linear yaw is good for no larger one
    """

    place_sd_radii: float = 6.0
    yaw_sd_rad: float = 0.5


LATENT = LatentOptions()


class Latent:
    """Positions of M markers as a linear function of L latent numbers: translation, a small yaw, then K modes.

    columns (M, 3, L) m for one standard deviation of each; mean (M, 3) m; noise (M,) m²; by_modes (M,) m², the
    variance that the modes make.
    With `modes` given, only so many are kept and the rest counts as noise.
    """

    def __init__(self, shape: Shape, modes: int | None = None):
        kept, left = shape.modes[..., :modes], shape.modes[..., modes:] if modes is not None else shape.modes[..., :0]
        self.mean, self.radius = shape.mean, shape.radius
        self.noise = shape.noise + (left**2).sum(axis=(1, 2)) / 3
        self.by_modes = (kept**2).sum(axis=(1, 2)) / 3
        place = np.broadcast_to(np.eye(3) * LATENT.place_sd_radii * shape.radius, (len(shape.mean), 3, 3))
        turn = np.stack([-shape.mean[:, 1], shape.mean[:, 0], np.zeros(len(shape.mean))], axis=-1) * LATENT.yaw_sd_rad
        self.columns = np.concatenate([place, turn[..., None], kept], axis=2)
        self.size = self.columns.shape[2]
        self.flat = np.ascontiguousarray(self.columns.reshape(-1, self.size))
        self.products = np.einsum("mil,mik->mlk", self.columns, self.columns).reshape(len(shape.mean), -1)
        self.yaw_sd = LATENT.yaw_sd_rad

    def __len__(self) -> int:
        return len(self.mean)

    def normal(self, weight: np.ndarray) -> np.ndarray:
        """(N, L, L) precision of the latent vectors when markers are known with weights (N, M), 1/m²."""
        normal = (weight @ self.products).reshape(-1, self.size, self.size)
        diagonal = np.arange(self.size)
        normal[:, diagonal, diagonal] += 1
        return normal

    def right_side(self, weighted: np.ndarray) -> np.ndarray:
        """(N, L) of weighted offsets from the mean (N, M, 3), 1/m."""
        return weighted.reshape(len(weighted), -1) @ self.flat

    def positions(self, latent: np.ndarray) -> np.ndarray:
        """(N, M, 3) m."""
        return self.mean + (latent @ self.flat.T).reshape(len(latent), -1, 3)


def yaw_absorbed(points: np.ndarray, latent: np.ndarray, sd: float) -> tuple[np.ndarray, np.ndarray]:
    """The yaw of latent vectors (N, L) put into the points (N, P, 3) instead: both turned back, the latent yaw at 0.

    A latent yaw of one is `sd` rad, and no more is taken at once.
    """
    back = -np.clip(latent[:, YAW] * sd, -sd, sd)
    place = turned(latent[:, None, PLACE], back)[:, 0]
    still = np.zeros((len(latent), 1))
    return turned(points, back), np.concatenate([place, still, latent[:, FIRST_MODE:]], axis=1)
