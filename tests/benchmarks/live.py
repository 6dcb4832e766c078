# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints what *Live* shows in a real window while recorded people are streamed: python -m tests.benchmarks.live.

A server in this process plays them at their rate; bodies move, and a rig each.
"""

from collections.abc import Iterator

import numpy as np

from scripts.results import markdown
from tests.accuracy import whole_takes
from tests.accuracy.actors import ACTING_M, acting
from tests.accuracy.known_sets import serve
from tests.accuracy.people import Take
from tests.io.streams.servers import QtmServer, there_and_back

from .in_window import in_window

COLUMNS = (
    "take", "frames a second", "redraws a second", "with a new frame", "ms of the processor a redraw",
    "ms to the picture (50, 99 %)", "named, % of the markers", "dropped",
)  # fmt: skip


def takes() -> Iterator[tuple[str, str, int, Take]]:
    """What is played: its name, the built-in set, how many wear it, and the take."""
    [player] = serve()
    yield "nothing", "body39", 0, player
    yield "tennis serve, `body39`", "body39", 1, player
    yield "`cmu41`, `actor41`", "actor41", 1, whole_takes.actors("cmu41")["bd"]
    yield "two of `cmu41`, `actor41`", "actor41", 2, next(acting(ACTING_M)).together()


def main():
    rows = []
    for name, markerset, many, take in takes():
        with QtmServer(there_and_back(take.xyz, take.rate), take.rate) as server:
            seen = in_window("live", source=server.source, markerset=markerset, many=many)
        row = [f"{seen[what] / seen['seconds']:.0f}" for what in ("frames", "redraws", "shown")]
        row.append(f"{1000 * seen['core'] / seen['redraws']:.0f}")
        delays = np.quantile(seen["delays"], (0.5, 0.99)) if seen["delays"] else ()
        named = 100 * np.mean(seen["named"] or [0]) / np.isfinite(take.xyz[..., 0]).sum(axis=1).mean()
        age = " / ".join(f"{one:.0f}" for one in delays) or "none"
        rows.append([name, *row, age, f"{named:.1f}", str(seen["late"])])
        print(rows[-1], flush=True)
    print(markdown(COLUMNS, rows))


if __name__ == "__main__":
    main()
