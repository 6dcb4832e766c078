# SPDX-License-Identifier: GPL-3.0-or-later
"""Where large tables of a take are kept that are gone through some frames at a time: in memory, or where a job says."""

from collections.abc import Callable
from typing import Any

import numpy as np

# Makes a table of zeros of a shape and a kind, which is read and written by its frames, as an array is.
MakeTable = Callable[[tuple[int, ...], Any], Any]
IN_MEMORY: MakeTable = np.zeros
