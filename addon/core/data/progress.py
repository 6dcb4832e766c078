# SPDX-License-Identifier: GPL-3.0-or-later
"""What long work says while it goes on."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """How far the work is, 0 to 1, and what it is doing, for a person to read."""

    fraction: float
    note: str
