# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints what a redraw of the trajectory timeline takes in a real window: python -m tests.benchmarks.timeline.

62 markers and 620 trajectories without a name over 20,000 frames, while time is panned and rows are scrolled.
"""

import argparse
import os
from pathlib import Path

from .room import seen_in_window


def main():
    """Opens the window, and prints the figures."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.timeline", description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=20000)
    given = parser.parse_args()
    script = Path(__file__).resolve().parents[1] / "package" / "tours" / "timeline.py"
    seen, _ = seen_in_window(script, {"frames": given.frames, "timing": True}, 300)
    timing = seen["timing"]
    print(f"{given.frames} frames, {timing['runs']} stretches, load {os.getloadavg()[0]:.1f}\n")
    print("| what | median | least | most |\n| --- | ---: | ---: | ---: |")
    for words in ("by the clock", "of its core", "with the GPU"):
        print(f"| a redraw of rows and names, {words} | {' | '.join(f'{value:.1f} ms' for value in timing[words])} |")
    print(f"\nThe rows are made anew, when a take or its edits change, in {timing['making the rows']:.0f} ms.")
    print(f"The take is shown, keyed and all, in {seen['s to show the take']:.1f} s.")


if __name__ == "__main__":
    main()
