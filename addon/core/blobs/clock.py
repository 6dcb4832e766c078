# SPDX-License-Identifier: GPL-3.0-or-later
"""How long each stage of the labelling took."""

from contextlib import contextmanager
from time import perf_counter

STAGES = ("place", "fit", "label")


class Clock:
    """Adds up seconds by stage: `with clock("fit"): ...`."""

    def __init__(self):
        self.seconds = dict.fromkeys(STAGES, 0.0)

    @contextmanager
    def __call__(self, stage: str):
        """A context whose seconds count for `stage`, one of STAGES."""
        begin = perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += perf_counter() - begin

    def take(self) -> dict[str, float]:
        """The seconds since the last call."""
        taken = self.seconds
        self.seconds = dict.fromkeys(STAGES, 0.0)
        return taken
