# SPDX-License-Identifier: GPL-3.0-or-later
"""How sure a label is: the blob's own marker against every other marker it could have been, and against a ghost."""

from dataclasses import dataclass

import numpy as np

from ..kernels import frame_calls, stands_for
from ..papers.virtual_occlusions.labelling import TOO_FAR, Naming, Rules, nll_given_names
from .swaps import Swaps


@dataclass(frozen=True)
class ConfidenceOptions:
    """By how many squared deviations a marker that should not be seen is less likely to have made a blob."""

    hidden: float = Rules.min_lead  # a marker that the fitted body hides: bodies are fitted well but not exactly
    shadowed: float = 6.0  # physical: a marker behind another one on the same line, twenty times less likely


CONFIDENCE = ConfidenceOptions()


@stands_for(frame_calls.label_confidences)
def named_confidences(naming: Naming, options: ConfidenceOptions) -> np.ndarray:
    """(C, M) chance that the blob of each name is rightly named, given the placement; NaN where there is none.

    Each blob is shared out among the markers that could have made it in the proportions of their likelihoods. A marker
    that has a blob in that camera claims no other, and a merged blob is rightly named after either of its markers. Two
    rays always meet somewhere, so a marker that only two cameras see is judged by the model as well.
    """
    sure = np.full(naming.slot.shape, np.nan)
    camera, marker = np.nonzero(naming.slot >= 0)
    slot = naming.slot[camera, marker]
    nll = nll_given_names(naming.frame, naming)[camera, :, slot]
    mine = np.take_along_axis(nll, marker[:, None], axis=1)[:, 0]
    by_model = naming.frame.nll[camera, marker, slot]
    few = (naming.rays >= 0).sum(axis=0)[marker] < 3
    mine = np.where(few, np.maximum(mine, by_model), mine)
    mine = np.where(mine < TOO_FAR, mine, naming.frame.rules.max_square)[:, None]
    taken = naming.slot[camera] >= 0
    own = np.arange(nll.shape[1]) == marker[:, None]
    hidden = options.hidden * ~naming.frame.expected.visible[camera]
    shadowed = options.shadowed * naming.frame.in_front[camera, :, marker]
    others = np.where(own | taken, TOO_FAR, nll + hidden + shadowed)
    partner = np.arange(nll.shape[1]) == naming.partner[camera, marker][:, None]
    others = np.where(partner, TOO_FAR, others)
    odds = np.exp(np.clip((mine - others) / 2, -60, 30)).sum(axis=1)
    sure[camera, marker] = 1 / (1 + odds)
    return sure


def swap_doubts(swaps: Swaps, markers: int) -> np.ndarray:
    """(M,) chance that each marker has not changed names with another, by what the exchange would have cost."""
    sure = np.ones(markers)
    chance = 1 / (1 + np.exp(-np.clip(swaps.loss / 2, -60, 60)))
    moved = swaps.orders != np.arange(markers)
    np.minimum.at(sure, np.nonzero(moved)[1], np.repeat(chance, moved.sum(axis=1)))
    return sure
