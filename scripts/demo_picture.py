# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the README's picture: the demo's own, kept small, as docs/images/demo.jpg.

    python scripts/demo_picture.py

Run it in an environment with `bpy` and Pillow, which matplotlib brings (`.venv` of run.py after its tests). It prints
the demo's figures, which are the picture's subtitle.
"""

import argparse
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from PIL import Image

from addon.cli import main as run_command

QUALITY = 88


def main() -> int:
    """Run the demo, and keep its picture."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images" / "demo.jpg", help="docs/images/demo.jpg")
    out = parser.parse_args().out.resolve()
    with tempfile.TemporaryDirectory(prefix="mocap-picture-") as folder:
        status = run_command(["demo", "--out", folder])
        if status:
            return status
        out.parent.mkdir(parents=True, exist_ok=True)
        with Image.open(Path(folder, "walk.png")) as picture:
            picture.convert("RGB").save(out, quality=QUALITY, optimize=True)
    print(f"{out}: {out.stat().st_size // 1024} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
