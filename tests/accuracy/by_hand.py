# SPDX-License-Identifier: GPL-3.0-or-later
"""One take from raw to clean by hand, in a real Blender's window, in counted clicks and keys.

python -m tests.accuracy.by_hand                     prints what docs/guide/by-hand.md sums up
python -m tests.accuracy.by_hand --pictures DIR      also keeps the pictures, as docs/images

The model is trained on the two labelled takes beside the raw one, which is not in the training. Of the raw take nobody
knows the truth: what has a name, what is empty and what anatomy says of the names is counted instead.
"""

import argparse
import json
import shutil
import sys
import tempfile
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np

from addon.cli import main as command
from addon.core.data.takes import Points
from addon.io.models import open_model
from addon.io.points import read_points
from scripts import build, real_blender

from . import anatomical
from .plates import RAW, TESTED, TRAINED
from .tables import share, table

HERE = Path(__file__).parent
A_HAND, A_LOOK = 1.5, 5.0  # s for a click or a key, and for looking at a trouble before: assumed, not measured
LIMIT = 1200  # s for the window


def main() -> int:
    """Train, walk through the window, judge."""
    parser = argparse.ArgumentParser(prog="python -m tests.accuracy.by_hand", description=__doc__.splitlines()[0])
    parser.add_argument("--model", type=Path, help="a model that was trained so before; else it is trained")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="keep the pictures in this folder")
    given = parser.parse_args()
    if missing := [path for path in (TRAINED, TESTED, RAW) if not path.exists()]:
        print(f"{missing[0].name} is not there; expected it in {missing[0].parent}", file=sys.stderr)
        return 1
    try:
        blender = real_blender.find()
    except LookupError as reason:
        print(reason, file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory(prefix="mocap-by-hand-") as name:
        folder = Path(name)
        model = folder / "plates.markerset.json"
        if given.model:
            shutil.copy(given.model, model)
        else:
            train([TRAINED, TESTED], model)
        shutil.copy(RAW, folder / "take.c3d")
        package = build.build("{}.{}".format(*blender.version), "linux-x64", folder)
        task = {"zip": str(package), "points": str(folder / "take.c3d"), "model": str(model)}
        (folder / "by_hand.json").write_text(json.dumps(task))
        done = blender.window(HERE / "by_hand_steps.py", folder, home=folder / "home", seconds=LIMIT)
        if given.pictures:
            given.pictures.mkdir(parents=True, exist_ok=True)
            for picture in sorted(folder.glob("by-hand-*.png")):
                shutil.copy(picture, given.pictures / picture.name)
        if not (folder / "hand.json").exists():
            print(f"the window closed early\n{done.stdout}{done.stderr}", file=sys.stderr)
            return 1
        print(told(json.loads((folder / "hand.json").read_text()), folder))
    return 0


def train(takes: list[Path], model: Path) -> None:
    """Train as the command line does; RuntimeError if it cannot."""
    with redirect_stdout(StringIO()) as said:
        status = command(["train", *map(str, takes), "--out", str(model)])
    if status:
        raise RuntimeError(f"{takes} could not be trained on: {said.getvalue()}")


def told(hand: dict, folder: Path) -> str:
    """What was done, in how many clicks, keys and seconds, and what came of it, as Markdown."""
    return "\n\n".join([steps_table(hand["steps"]), outcome_table(folder, hand)])


def steps_table(steps: list[dict]) -> str:
    """A row for each trouble, and the sums."""
    rows, sums = [], np.zeros(4)
    for step in steps:
        hands = step["clicks"] + step["keys"]
        seconds = A_HAND * hands + A_LOOK * step["looks"] + step["machine"]
        sums += (step["clicks"], step["keys"], step["machine"], seconds)
        said = (step["clicks"], step["keys"], f"{step['machine']:.1f} s", f"{seconds:.0f} s")
        rows.append((step["what"], step["done"], *said))
    rows.append(("all", "", int(sums[0]), int(sums[1]), f"{sums[2]:.1f} s", f"{sums[3]:.0f} s"))
    return table(("what the list says", "what is done", "clicks", "keys", "machine", "a user needs"), rows)


def outcome_table(folder: Path, hand: dict) -> str:
    """The take as labelled, as corrected, and as filled."""
    names = open_model(str(folder / "plates.markerset.json")).markerset.markers
    raw = read_points(folder / "take.c3d")
    before, after = (placed_by(folder / f"{step}.labels.csv", raw, names) for step in ("before", "after"))
    filled = read_points(folder / "after.c3d").xyz[:, : len(names)]
    there = np.isfinite(raw.xyz[..., 0])
    given = (share(int((named >= 0).sum()), int(there.sum())) for named in (before, after))
    rows = [("points that have a name", *given, "")]
    empty = [~np.isfinite(positions(raw.xyz, named, len(names))[..., 0]) for named in (before, after)]
    empty.append(~np.isfinite(filled[..., 0]))
    rows.append(("marker-frames that are empty", *(share(int(one.sum()), one.size) for one in empty)))
    rows.append(
        ("markers that are never there", *(" ".join(np.array(names)[one.all(axis=0)]) or "none" for one in empty))
    )
    rows.append(("troubles that are open", hand["open"][0], hand["open"][1], ""))
    stages = [*(positions(raw.xyz, named, len(names)) for named in (before, after)), filled]
    told_of = [anatomical.statements(placed, names, raw.rate) for placed in stages]
    rows += [(one[0], *(said[1] for said in (one, *more))) for one, *more in zip(*told_of, strict=True)]
    return table(("", "labelled", "corrected by hand", "and filled"), rows)


def placed_by(path: Path, raw: Points, names: tuple[str, ...]) -> np.ndarray:
    """(T, P) the marker of each point of the raw take, -1 for none, by a labels file of it."""
    index = {name: place for place, name in enumerate(names)}
    named = np.full(raw.xyz.shape[:2], -1)
    with path.open() as file:
        columns = next(file).rstrip("\n").split(",")
        for line in file:
            row = dict(zip(columns, line.rstrip("\n").split(","), strict=True))
            named[int(row["frame"]) - raw.first_frame, int(row[columns[1]])] = index.get(row["marker"], -1)
    return named


def positions(xyz: np.ndarray, named: np.ndarray, markers: int) -> np.ndarray:
    """(T, M, 3) m the markers by the names (T, P) of points (T, P, 3)."""
    placed = np.full((len(xyz), markers, 3), np.nan)
    frame, column = np.nonzero(named >= 0)
    placed[frame, named[frame, column]] = xyz[frame, column]
    return placed


if __name__ == "__main__":
    sys.exit(main())
