# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints how many frames of playback are lost while a long take is labelled: python -m tests.benchmarks.playback."""

import tempfile
from pathlib import Path

import numpy as np

from scripts.virtual_take import write_virtual_points

from .in_window import in_window

FRAMES = 20_000


def main():
    """Prints the figures."""
    with tempfile.TemporaryDirectory(prefix="mocap-playback-") as folder:
        write_virtual_points(Path(folder), FRAMES)
        seen = in_window("playback", points=str(Path(folder) / "walk.c3d"))
    alone, beside = (np.array(seen[what]) for what in ("alone", "beside"))
    print("| of playback | measured |\n| --- | ---: |")
    print(f"| frames a second, nothing else going on | {np.median(alone[:, 0]):.1f} |")
    print(f"| the same while a take of {FRAMES:,} frames is labelled | {np.median(beside[:, 0]):.1f} |")
    print(f"| frames that are not shown for it | {100 - 100 * np.median(beside[:, 0] / alone[:, 0]):.1f} % |")
    print(f"| of the time, the window is held by the add-on | {100 * beside[:, 1].mean():.2f} % |")
    print(f"| at once, at most | {1000 * beside[:, 2].max():.1f} ms |")


if __name__ == "__main__":
    main()
