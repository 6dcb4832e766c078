# SPDX-License-Identifier: GPL-3.0-or-later
"""A capture to be labelled."""

from dataclasses import dataclass

import numpy as np

from addon.core.data.takes import Blobs
from addon.core.geometry.cameras import Cameras


@dataclass(frozen=True, eq=False)
class Trial:
    """One take to be labelled: blobs with their true names, and what the labelling is not told.

    title    says which capture it is, for people to read
    xyz      (T, M, 3) m where the markers were
    """

    title: str
    cameras: Cameras
    blobs: Blobs
    truth: np.ndarray
    xyz: np.ndarray
    rate: float
