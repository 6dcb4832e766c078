# SPDX-License-Identifier: GPL-3.0-or-later
"""Goes a way of those beside this file through a real Blender's window."""

import json
import os
import sys
import tempfile
from pathlib import Path

from scripts import build, real_blender


def in_window(way: str, **task) -> dict:
    """What is seen on a way beside this file, window_NAME.py, in a real window; ends where there is none.

    Prints what machine that was.
    """
    with tempfile.TemporaryDirectory(prefix="mocap-window-") as name:
        folder = Path(name)
        try:
            blender = real_blender.find()
            kind = build.for_blender(blender.version, blender.python)
            package = build.build(kind, "linux-x64", folder, compiled=True)
            (folder / "task.json").write_text(json.dumps({"zip": str(package), "way": f"window_{way}", **task}))
            stage = Path(__file__).parents[1] / "package" / "tours" / "stage.py"
            done = blender.window(stage, folder, home=folder / "home", seconds=500)
        except LookupError as reason:
            sys.exit(f"tests.benchmarks: {reason}")
        if not (folder / "seen.json").exists():
            sys.exit(f"tests.benchmarks: the window closed early\n{done.stdout}{done.stderr}")
        seen = json.loads((folder / "seen.json").read_text())
    version = ".".join(map(str, blender.version))
    print(f"Blender {version}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, drawn by software\n")
    return seen
