# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs a script beside this one in a real Blender's window."""

import json
import os
import sys
import tempfile
from pathlib import Path

from scripts import build, real_blender


def in_window(script: str, **task) -> dict:
    """What a script beside this one, window_NAME.py, sees in a real window; ends where there is none.

    Prints what machine that was.
    """
    with tempfile.TemporaryDirectory(prefix="mocap-window-") as name:
        folder = Path(name)
        try:
            blender = real_blender.find()
            kind = build.for_blender(blender.version, blender.python)
            package = build.build(kind, "linux-x64", folder, compiled=True)
            (folder / "task.json").write_text(json.dumps({"zip": str(package), **task}))
            script = Path(__file__).with_name(f"window_{script}.py")
            done = blender.window(script, folder, home=folder / "home", seconds=500)
        except LookupError as reason:
            sys.exit(f"tests.benchmarks: {reason}")
        if not (folder / "seen.json").exists():
            sys.exit(f"tests.benchmarks: the window closed early\n{done.stdout}{done.stderr}")
        seen = json.loads((folder / "seen.json").read_text())
    version = ".".join(map(str, blender.version))
    print(f"Blender {version}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, drawn by software\n")
    return seen
