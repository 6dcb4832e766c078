# SPDX-License-Identifier: GPL-3.0-or-later
"""Real blobs of real cameras: python -m tests.accuracy.real_blobs prints what results/real_blobs.json keeps.

A person stands and moves the arms; eleven cameras see it for ten seconds. A model is learned from the first half of the
recorded markers, and the second half's blobs are named with it, all by the command line. The truth is the recorder's
own labelling, projected: a blob within 8 px of it has a name, so that some blobs of the body have none.
"""

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from addon.core.data.takes import Points
from addon.core.evaluation.figures import Figures
from addon.core.geometry.cameras import Cameras
from addon.io.cameras import read_cameras, write_cameras
from addon.io.points import read_points, write_c3d
from addon.scoring import compare

from .commands import Files, command, labelled, rows_of, side_by_side
from .people import DATA
from .tables import share, table

TAKE = DATA / "blobs" / "qualisys_run"
LEARNED, TESTED = (1, 500), (501, 1000)  # frames
TRUTH_PX = 8.0  # how far from its blob a projected marker may be to name it
MOVED = ("15343", "15344")
UNMOVED = ("15169", "15482")  # two others, for comparison
LARGEST = 8  # rows of what is most often wrong


def available() -> bool:
    """Whether the recording is on this machine."""
    return TAKE.is_dir()


def learn(folder: Path, *words) -> Path:
    """The model that `train` makes of the first half, with the options `words`."""
    take = read_points(TAKE / "run.c3d")
    part = slice(LEARNED[0] - take.first_frame, LEARNED[1] - take.first_frame + 1)
    half, model = folder / "half.c3d", folder / "run.markerset.json"
    write_c3d(half, Points(take.names, take.xyz[part], take.residual[part], take.rate, LEARNED[0]))
    command("train", half, "--out", model, *words)
    return model


def recorded(folder: Path, model: Path, without: tuple[str, ...] = ()) -> Files:
    """The recording's blobs, truth and calibration, less some cameras."""
    rate = read_points(TAKE / "run.c3d").rate
    files = Files(TAKE / "run.csv", TAKE / "run.truth.csv", TAKE / "room.toml", model, rate)
    if not without:
        return files
    cameras = read_cameras(files.cameras)
    folder.mkdir(exist_ok=True)
    fewer = Files(folder / "fewer.csv", folder / "fewer.truth.csv", folder / "fewer.toml", model, rate)
    write_cameras(fewer.cameras, cameras.select([i for i, name in enumerate(cameras.names) if name not in without]))
    for whole, part in ((files.blobs, fewer.blobs), (files.truth, fewer.truth)):
        lines = whole.read_text(encoding="utf-8").splitlines(keepends=True)
        part.write_text("".join(line for line in lines if line.split(",")[1] not in without), encoding="utf-8")
    return fewer


@dataclass
class Mistakes:
    """What is not right, by kind; blobs.

    shared     called after a marker that is within 8 px of the blob, as the one is that the truth names it after
    exchanged  called after a marker that is farther off, where the truth has another; with its own blob in the image
               or without
    nameless   called something, and the truth has no name for it
    refused    left without a name, and the truth has one
    cameras    (camera, kind) of them all, and `markers` (marker, kind): the one given, or of refused ones the true one
    """

    shared: int = 0
    exchanged: int = 0
    nameless: int = 0
    refused: int = 0
    own_blob_seen: int = 0
    cameras: Counter = field(default_factory=Counter)
    markers: Counter = field(default_factory=Counter)

    def add(self, camera: str, given: str, true: str, offset_px: float, seen: bool):
        """One blob that is not right; `offset_px` from where the given marker is, `seen` with a blob of its own."""
        if not given:
            kind = "refused"
        elif not true:
            kind = "nameless"
        else:
            kind = "shared" if offset_px <= TRUTH_PX else "exchanged"
        self.own_blob_seen += kind == "exchanged" and seen
        setattr(self, kind, getattr(self, kind) + 1)
        self.cameras[camera, kind] += 1
        self.markers[given or true, kind] += 1


def mistakes_in(
    labels: list[dict], truth: list[dict], pixels: dict[str, np.ndarray], names: tuple[str, ...]
) -> Mistakes:
    """Sorts what is not right in labels; pixels (T, M, 2) px of the markers `names` in each camera, from frame 1 on."""
    own = {(row["frame"], row["camera"], row["marker"]) for row in truth}
    found = Mistakes()
    for row, true in side_by_side(labels, truth):
        given = row["marker"]
        if given == true["marker"]:
            continue
        offset = np.inf
        if given:
            where = pixels[row["camera"]][int(row["frame"]) - 1, names.index(given)]
            offset = float(np.hypot(*(where - [float(row["x"]), float(row["y"])])))
        key = (row["frame"], row["camera"], given)
        found.add(row["camera"], given, true["marker"], offset, key in own)
    return found


def projected(cameras: Cameras) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Where the recorded markers are in each camera's image (T, M, 2) px, and their names."""
    take = read_points(TAKE / "run.c3d")
    return dict(zip(cameras.names, cameras.project(take.xyz), strict=True)), take.names


@dataclass(frozen=True)
class Run:
    """One labelling of the second half: what it is called, its figures, its mistakes, and the folder of its files."""

    title: str
    figures: dict
    mistakes: Mistakes
    out: Path


def run(title: str, take: Files, out: Path, words: tuple[str, ...]) -> Run:
    """Labels the second half and compares it with the truth."""
    answer = labelled(take, out, "--frames", f"{TESTED[0]}:{TESTED[1]}", *words)
    agreement = compare(answer.labels, take.truth, Figures(), TESTED)
    pixels, names = projected(read_cameras(take.cameras))
    found = mistakes_in(rows_of(answer.labels), rows_of(take.truth, TESTED), pixels, names)
    return Run(title, agreement.figures.as_dict(), found, out)


def runs(folder: Path, model: Path) -> Iterator[Run]:
    """Every way in which it is measured."""
    whole = recorded(folder, model)
    fewer, others = (
        recorded(place, model, without) for place, without in ((folder, MOVED), (folder / "others", UNMOVED))
    )
    ways = (
        ("`fit`, the default in Blender: rays cast at the body (`bvh`)", whole, ("--occlusion", "bvh")),
        ("`fit`, `--occlusion capsules`", whole, ("--occlusion", "capsules")),
        ("`likelihood`", whole, ("--method", "likelihood")),
        ("`ensemble`", whole, ("--method", "ensemble")),
        ("`fit`, without the two moved cameras", fewer, ("--occlusion", "bvh")),
        ("`likelihood`, without the two moved cameras", fewer, ("--method", "likelihood")),
        (f"`fit`, without two others ({' and '.join(UNMOVED)})", others, ("--occlusion", "bvh")),
    )
    for number, (title, take, words) in enumerate(ways):
        yield run(title, take, folder / f"out{number}", words)


def row_of(measured: Run) -> list[str]:
    """The cells of one labelling."""
    figures, found = measured.figures, measured.mistakes
    rates = [f"{100 * figures[name]:.2f} %" for name in ("precision", "recall", "f1")]
    perfect = round(figures["frames"] * figures["perfect_frames"])
    of_kinds = [found.exchanged, found.own_blob_seen, found.shared, found.nameless, found.refused]
    given = f"{figures['wrong']} of {figures['labels']}"
    return [
        measured.title,
        given,
        *rates,
        *map(str, of_kinds),
        share(perfect, figures["frames"]),
    ]


COLUMNS = (
    "method",
    "labels that are not the truth's",
    "precision",
    "recall",
    "F1",
    "clear exchanges",
    "of them, own blob in the image",
    "one blob of two markers",
    "on a blob without truth",
    "refused",
    "perfect frames",
)


def by_camera(measured: Run) -> str:
    """What is not right in each camera's images."""
    report = rows_of(measured.out / "run.labels.csv")
    named = Counter(row["camera"] for row in report if row["marker"])
    kinds = ("exchanged", "shared", "nameless", "refused")
    rows = [
        [
            camera + (", moved" if camera in MOVED else ""),
            named[camera],
            *(measured.mistakes.cameras[camera, k] for k in kinds),
        ]
        for camera in sorted(named)
    ]
    return table(("camera", "labels", "clear exchanges", "one blob of two", "on a blob without truth", "refused"), rows)


def by_marker(measured: Run) -> str:
    """The markers that are least often right."""
    kinds = {"exchanged": "clear exchange", "shared": "one blob of two", "nameless": "on a blob without truth"}
    rows = [
        [marker, kinds.get(kind, kind), count]
        for (marker, kind), count in measured.mistakes.markers.most_common(LARGEST)
    ]
    return table(("marker", "what", "times"), rows)


def filled_marker(measured: Run, name: str = "L_IAS") -> str:
    """Of a marker that the recorder filled in: where our blobs of it meet, beside where the recording has it."""
    took, own = read_points(TAKE / "run.c3d"), read_points(measured.out / "run.c3d")
    truth = rows_of(TAKE / "run.truth.csv", TESTED)
    labels = rows_of(measured.out / "run.labels.csv")
    frames = {
        int(row["frame"]) for row, true in side_by_side(labels, truth) if row["marker"] == name and not true["marker"]
    }
    at = np.array(sorted(frames)) - TESTED[0]
    ours, theirs = own.xyz[at, own.names.index(name)], took.xyz[at + TESTED[0] - 1, took.names.index(name)]
    miss = 1000 * own.residual[at, own.names.index(name)]
    distance = 1000 * np.linalg.norm(ours - theirs, axis=-1)
    return (
        f"{name}: in {len(frames)} frames a blob without truth bears its name. Its blobs of two cameras and more "
        f"meet there to {np.nanmedian(miss):.1f} mm (median), {np.nanmedian(distance):.0f} mm from where the recording "
        "has the marker."
    )


def main() -> int:
    """Measures and prints."""
    parser = argparse.ArgumentParser(prog="python -m tests.accuracy.real_blobs", description=__doc__.splitlines()[0])
    parser.add_argument("--model", type=Path, help="learned before by --keep, instead of being learned again")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="where the model and the labels stay")
    given = parser.parse_args()
    if not available():
        print("the recorded blobs are not here; expected them in ../shared/data/blobs", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as name:
        folder = given.keep or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        model = given.model or learn(folder)
        measured = []
        print(f"### Learned from frames {LEARNED[0]} to {LEARNED[1]}, frames {TESTED[0]} to {TESTED[1]} labelled\n")
        for one in runs(folder, model):
            measured.append(one)
            print(f"{one.title}: done", file=sys.stderr, flush=True)
        print(table(COLUMNS, map(row_of, measured)))
        print(f"\n### By camera, {measured[0].title}\n\n{by_camera(measured[0])}")
        print(f"\n### What is most often not right, {measured[0].title}\n\n{by_marker(measured[0])}")
        print(f"\n{filled_marker(measured[0])}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
