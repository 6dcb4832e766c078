# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes the user guide's screenshots in a real Blender's window, into docs/images/.

    python scripts/screenshots.py

Run it in an environment with `bpy` (`.venv` of run.py), where a real Blender can be found (see real_blender.py) on
Linux. The take in the pictures is the demo's, so they can be made anew whenever the panels change.
"""

import argparse
import json
import shutil
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from addon.cli import main as command
from addon.io.cameras import read_cameras
from scripts import build, real_blender
from scripts.movies import write_virtual_movies
from scripts.virtual_take import write_virtual_pair, write_virtual_points, write_virtual_take

FRAMES, MOVIE_FRAMES = 240, 24


def main() -> int:
    """Build the zip, make the take, open the window, and keep the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=build.ROOT / "docs" / "images", help="folder (docs/images)")
    out = parser.parse_args().out
    try:
        blender = real_blender.find()
    except LookupError as reason:
        sys.exit(f"screenshots.py: {reason}")
    with tempfile.TemporaryDirectory(prefix="mocap-screenshots-") as name:
        folder = Path(name)
        write_virtual_take(folder, FRAMES)
        write_virtual_points(folder, FRAMES)
        write_virtual_pair(folder, FRAMES)
        write_virtual_movies(folder / "movies", read_cameras(folder / "cameras.toml"), MOVIE_FRAMES)
        takes(folder)
        people = [train(folder / name) for name in ("ann.c3d", "bob.c3d")]
        package = build.build(build.for_blender(blender.version, blender.python), "linux-x64", folder, compiled=True)
        files = {"cameras": "cameras.toml", "blobs": "take.csv", "points": "walk.c3d", "duet": "duet.c3d"}
        files |= {"movies": "movies", "takes": "takes"}
        task = {"zip": str(package), "people": people, **{what: str(folder / name) for what, name in files.items()}}
        (folder / "task.json").write_text(json.dumps(task), encoding="utf-8")
        steps = Path(__file__).with_name("screenshot_steps.py")
        done = blender.window(steps, folder, home=folder / "home", seconds=600)
        pictures = sorted(folder.glob("*.png"))
        if not (folder / "done").exists():
            sys.exit(f"screenshots.py: the window closed early\n{done.stdout}{done.stderr}")
        out.mkdir(parents=True, exist_ok=True)
        for picture in pictures:
            print(shutil.copy(picture, out / picture.name))
    return 0


def takes(folder: Path) -> None:
    """Fill the folder `takes` in a folder with takes: of points, of blobs, and one that holds nothing."""
    out = folder / "takes"
    out.mkdir()
    shutil.copy(folder / "walk.c3d", out / "morning.c3d")
    shutil.copy(folder / "take.csv", out / "noon.csv")
    (out / "evening.csv").write_text("frame,camera,x,y\n", encoding="utf-8")


def train(take: Path) -> str:
    """Learn a marker set from somebody's own take, and give its path."""
    model = take.with_suffix(".markerset.json")
    if command(["train", str(take), "--out", str(model), "--name", take.stem, "--search", "none"]):
        sys.exit(f"screenshots.py: nothing was learned from {take.name}")
    return str(model)


if __name__ == "__main__":
    sys.exit(main())
