# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints how many frames of playback are lost while a long take is labelled: python -m tests.benchmarks.playback."""

import os

from scripts.virtual_take import write_virtual_points

from .room import walked

FRAMES = 20_000


def main():
    """Prints the figures."""
    seen, version = walked("window_playback.py", lambda folder: write_virtual_points(folder, FRAMES))
    print(f"Blender {version}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, drawn by software\n")
    print("| while | frames at 60 a second that were not shown |\n| --- | ---: |")
    for what, shown in seen.items():
        print(f"| {what} | {1 - shown:.1%} |")


if __name__ == "__main__":
    main()
