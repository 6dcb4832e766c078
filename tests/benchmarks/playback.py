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
    alone, labelling = seen["alone"], seen["labelling"]
    print("| of playback at 60 frames a second | |\n| --- | ---: |")
    print(f"| frames not shown, nothing else going on | {alone['lost']:.1%} |")
    print(f"| the same while a take of {FRAMES:,} frames is labelled | {labelling['lost']:.1%} |")
    print(f"| of the time, the window is held by the add-on | {labelling['held']:.2%} |")
    print(f"| at once, at most | {1000 * labelling['longest']:.1f} ms |")


if __name__ == "__main__":
    main()
