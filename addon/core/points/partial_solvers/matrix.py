# SPDX-License-Identifier: GPL-3.0-or-later
"""The labelling matrix: what becomes of the suggestions of many solvers (the paper's section 4.3)."""

import numpy as np

from ...data.takes import NO_MARKER


def resolve(suggested: np.ndarray) -> np.ndarray:
    """The marker of each point (T, P), NO_MARKER where none, from suggestions (T, P, M): some solver says so.

    A column without a suggestion is an occluded marker. A column with several is ambiguous and counts as occluded. A
    point with several markers leaves all of them occluded. What is alone in its row and in its column is a label.
    """
    alone = (suggested.sum(axis=1, keepdims=True) == 1) & (suggested.sum(axis=2, keepdims=True) == 1) & suggested
    return np.where(alone.any(axis=2), alone.argmax(axis=2), NO_MARKER)
