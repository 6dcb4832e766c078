# SPDX-License-Identifier: GPL-3.0-or-later
"""How sure a label is: the blob's own marker against every other marker it could have been, and against a ghost."""

import numpy as np

from .labelling import FAR, GATE, Naming


def label_confidences(naming: Naming, camera: np.ndarray, marker: np.ndarray) -> np.ndarray:
    """(N,) chance that the blobs named by `camera` and `marker` (N,) are rightly named, given the placement.

    Each blob is shared out among the markers that could have made it in the proportions of their likelihoods. A marker
    that has a better blob in that camera claims no other.
    """
    slot = naming.slot[camera, marker]
    misfit = naming.misfit[camera, :, slot]
    mine = np.take_along_axis(misfit, marker[:, None], axis=1)
    mine = np.where(mine < FAR, mine, GATE)
    elsewhere = naming.slot[camera] >= 0
    own = np.arange(misfit.shape[1]) == marker[:, None]
    rivals = np.where(own | elsewhere, FAR, misfit)
    odds = np.exp(np.clip((mine - rivals) / 2, -60, 30)).sum(axis=1)
    return 1 / (1 + odds)
