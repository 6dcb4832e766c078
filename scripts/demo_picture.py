# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the README's picture: the demo's own, as docs/images/demo.svg.

    python scripts/demo_picture.py

It prints the demo's figures, which are the picture's subtitle.
"""

import shutil
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from addon.cli import main as run_command


def main() -> int:
    """Run the demo, and keep its picture."""
    with tempfile.TemporaryDirectory(prefix="mocap-picture-") as folder:
        status = run_command(["demo", "--out", folder])
        if not status:
            shutil.copy(Path(folder, "walk.svg"), ROOT / "docs" / "images" / "demo.svg")
    return status


if __name__ == "__main__":
    sys.exit(main())
