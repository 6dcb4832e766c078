# SPDX-License-Identifier: GPL-3.0-or-later
"""Which markers of a marker set are easily taken for each other, and where one should sit so that they are not."""

from .advice import ADVICE, Advice, advise
from .judging import Ambiguity, judge, separation
from .layout import MarkerLayout, marker_layout

__all__ = ["ADVICE", "Advice", "Ambiguity", "MarkerLayout", "advise", "judge", "marker_layout", "separation"]
