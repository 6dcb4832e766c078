# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints what a redraw of the trajectory timeline takes in a real window: python -m tests.benchmarks.timeline.

62 markers and 620 trajectories without a name over 20,000 frames, while time is panned and rows are scrolled.
"""

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

from scripts import build, real_blender


def main() -> int:
    """Opens the window, and prints the figures."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.timeline", description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=20000)
    given = parser.parse_args()
    script = Path(__file__).resolve().parents[1] / "package" / "tours" / "timeline.py"
    with tempfile.TemporaryDirectory(prefix="mocap-timeline-") as name:
        folder = Path(name)
        try:
            blender = real_blender.find()
            package = build.build("{}.{}".format(*blender.version), "linux-x64", folder)
            (folder / "task.json").write_text(json.dumps({"zip": str(package), "frames": given.frames, "timing": True}))
            done = blender.window(script, folder, home=folder / "home", seconds=300)
        except LookupError as reason:
            sys.exit(f"tests.benchmarks.timeline: {reason}")
        if not (folder / "seen.json").exists():
            sys.exit(f"tests.benchmarks.timeline: the window closed early\n{done.stdout}{done.stderr}")
        seen = json.loads((folder / "seen.json").read_text())
    timing = seen["timing"]
    print(f"{given.frames} frames, {timing['runs']} stretches, load {os.getloadavg()[0]:.1f}\n")
    print("| what | median | least | most |\n| --- | ---: | ---: | ---: |")
    for words in ("by the clock", "of its core", "with the GPU"):
        print(f"| a redraw of rows and names, {words} | {' | '.join(f'{value:.1f} ms' for value in timing[words])} |")
    print(f"\nThe rows are made anew, when a take or its edits change, in {timing['making the rows']:.0f} ms.")
    print(f"The take is shown, keyed and all, in {seen['s to show the take']:.1f} s.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
