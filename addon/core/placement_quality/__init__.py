# SPDX-License-Identifier: GPL-3.0-or-later
"""Which markers of a marker set are easily taken for each other, and where one should sit so that they are not."""

from .advice import GOAL, STEPS, Advice, advise
from .judging import Ambiguity, judge, separation
from .layout import Worn, worn

__all__ = ["GOAL", "STEPS", "Advice", "Ambiguity", "Worn", "advise", "judge", "separation", "worn"]
