# SPDX-License-Identifier: GPL-3.0-or-later
"""What the body in the way is asked by, rays or the closed form: python -m tests.accuracy.raycasting.

Whole takes are labelled by the command line with --occlusion bvh and capsules: walks and turns of all recorded people
in a real room, with models that were learned without them; the demo's take; and real blobs. It needs the bpy package.
"""

import argparse
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from addon.blendfile import has_blender, mesh_occlusion
from addon.capturing import truth_path, write_capture
from addon.core.blobs.pipeline import label_take
from addon.core.body.occlusion import OCCLUDING, CapsuleOcclusion
from addon.core.data.markersets import MarkerSet
from addon.demo.take import MODEL, STAGE, TROUBLE, make_performance
from addon.io.blobs import read_blobs, write_blobs
from addon.io.cameras import read_cameras, write_cameras
from addon.io.labels import TruthWriter
from addon.io.markersets import open_markerset, write_markerset

from . import people, real_blobs
from .commands import KEYS, Answer, Files, labelled, rows_of, side_by_side
from .models import left_out_model
from .tables import share, table
from .walking import RATE, walking

WAYS = ("bvh", "capsules")
KINDS = ("gait15", "body26", "demo", "real")
SPEEDS = ("what", "bvh", "bvh, of a core's time with files", "capsules", "capsules, of a core's time with files")
SEED = 1
TAKES = 4  # of each group of two people: a walk and a turn each
COLUMNS = (
    "what",
    "takes",
    "labels, bvh",
    "blobs named differently",
    "bvh right",
    "capsules right",
    "neither, or no truth",
    "wrong, bvh",
    "wrong, capsules",
    "recall, bvh",
    "recall, capsules",
)


class Compared:
    """Adds up takes that were labelled in both ways.

    differ   what differs, by who is right; "unknown" where the truth has no name, which is a ghost only in captures
    """

    def __init__(self, ghosts_known: bool = True):
        self.ghosts_known = ghosts_known
        self.takes = self.blobs = self.present = 0
        self.differ: Counter[str] = Counter()
        self.given: Counter[str] = Counter()
        self.right: Counter[str] = Counter()

    def add(self, take: Files, out: Path, frames: tuple[int, int] | None = None):
        """Labels a take in both ways and compares."""
        rows = {way: rows_of(labelled_by(way, take, out, frames).labels) for way in WAYS}
        self.takes += 1
        truth = rows_of(take.truth, frames)
        for (by_rays, true), (closed, _) in zip(
            side_by_side(rows["bvh"], truth), side_by_side(rows["capsules"], truth), strict=True
        ):
            self._count({"bvh": by_rays["marker"], "capsules": closed["marker"]}, true["marker"])

    def _count(self, named: dict[str, str], truth: str):
        self.blobs += 1
        self.present += bool(truth)
        good = {way: name in truth.split("|") for way, name in named.items()}
        for way in WAYS:
            self.given[way] += bool(named[way])
            self.right[way] += bool(named[way]) and good[way]
        if named["bvh"] == named["capsules"]:
            return
        known = bool(truth) or self.ghosts_known
        sole = [way for way in WAYS if good[way]] if known else []
        self.differ[sole[0] if len(sole) == 1 else "neither"] += 1

    def cells(self, title: str) -> list[str]:
        """The row under `COLUMNS`."""
        wrong = [share(self.given[way] - self.right[way], self.given[way], 3) for way in WAYS]
        recall = [f"{100 * self.right[way] / self.present:.2f} %" for way in WAYS]
        differ = [share(self.differ.total(), self.blobs, 3), *(str(self.differ[w]) for w in (*WAYS, "neither"))]
        return [title, str(self.takes), str(self.given["bvh"]), *differ, *wrong, *recall]


def labelled_by(way: str, take: Files, out: Path, frames: tuple[int, int] | None) -> Answer:
    """A take, or some frames of it, labelled by the command line in one of `WAYS`."""
    part = ("--frames", f"{frames[0]}:{frames[1]}") if frames else ()
    answer = labelled(take, out / way, "--occlusion", way, *part)
    if answer.report["occlusion"] != way:
        raise RuntimeError(f"{answer.report['occlusion']} was used; expected {way}")
    return answer


class Asked:
    """Both ways asked the same questions; the rays' answer is given.

    questions, differ  how many markers and cameras were asked about, and how often the answers differ
    clear              of those, where a capsule 1.5 % thinner would not answer differently
    """

    def __init__(self, markerset: MarkerSet):
        shrink = OCCLUDING.fitted_shrink
        self.rays, self.capsules = mesh_occlusion(markerset), CapsuleOcclusion(markerset, shrink)
        self.thinner = CapsuleOcclusion(markerset, 0.985 * shrink)
        self.questions = self.differ = self.clear = 0

    def hidden(self, *given) -> np.ndarray:
        """See `addon.core.body.occlusion.Occlusion.hidden`."""
        cast, closed, thinner = (one.hidden(*given) for one in (self.rays, self.capsules, self.thinner))
        self.questions += cast.size
        self.differ += int((cast != closed).sum())
        self.clear += int(((cast != closed) & (closed == thinner)).sum())
        return cast


def asked(take: Files, frames: tuple[int, int] | None = None) -> Asked:
    """The answers of both ways to what the labelling of a take asks."""
    markerset, cameras = open_markerset(str(take.model)), read_cameras(take.cameras)
    both = Asked(markerset)
    chunks = (rows.blobs for rows in read_blobs(take.blobs, cameras, frames or (None, None)))
    for _ in label_take(chunks, cameras, markerset, take.rate, None, both):
        pass
    return both


def walks(set_name: str, folder: Path, groups: int) -> Iterator[Files]:
    """Walks and turns of the recorded people as files, each with a model that was learned without its person."""
    for fold in people.folds()[:groups]:
        markerset = left_out_model(set_name, fold)
        model = folder / f"{'-'.join(fold)}.markerset.json"
        write_markerset(model, markerset)
        for number, trial in enumerate(walking(markerset.markers, fold, TAKES, SEED)):
            stem = folder / f"{'-'.join(fold)}-{number}"
            take = Files(Path(f"{stem}.csv"), Path(f"{stem}.truth.csv"), Path(f"{stem}.toml"), model, RATE)
            write_blobs(take.blobs, trial.blobs, trial.cameras)
            write_cameras(take.cameras, trial.cameras)
            with TruthWriter(take.truth) as writer:
                writer.write([",".join(row[key] for key in KEYS) for row in rows_of(take.blobs)], trial.truth)
            yield take


def demo(folder: Path) -> Files:
    """The demo's take as files."""
    made = make_performance(open_markerset(MODEL))
    take = Files(folder / "demo.csv", truth_path(folder / "demo.csv"), folder / "demo.toml", MODEL, STAGE.rate)
    write_cameras(take.cameras, made.cameras)
    for _ in write_capture(made.take, made.cameras, TROUBLE, made.body, take.blobs):
        pass
    return take


def takes_of(
    name: str, folder: Path, groups: int, model: Path | None
) -> tuple[str, Iterable[Files], tuple[int, int] | None]:
    """What a row is called, its takes, and which of their frames."""
    if name == "real":
        take = real_blobs.recorded(folder, model or real_blobs.learn(folder))
        return "real blobs, 35 markers, 11 cameras", [take], real_blobs.TESTED
    if name == "demo":
        return "the demo's take, `body26`, 8 cameras", [demo(folder)], None
    return f"walks and turns, `{name}`, 6 to 8 cameras", walks(name, folder, groups), None


def speed_cells(take: Files, out: Path, frames: tuple[int, int] | None, repeats: int) -> list[str]:
    """Frames a second in both ways, best of `repeats`: by the clock, as the report has it, and of one core's time."""
    cells = []
    for way in WAYS:
        answers = [labelled_by(way, take, out, frames) for _ in range(repeats)]
        clock = max(answer.report["timing"]["frames_per_second"] for answer in answers)
        core = answers[0].report["frames"] / min(answer.seconds for answer in answers)
        cells += [f"{clock:.0f}", f"{core:.0f}"]
    return cells


def main() -> int:
    """Measures and prints."""
    parser = argparse.ArgumentParser(prog="python -m tests.accuracy.raycasting", description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=KINDS, default=KINDS)
    parser.add_argument("--groups", type=int, default=5, help="of two people each")
    parser.add_argument("--speed", type=int, metavar="N", help="the best time of N labellings each, and nothing else")
    parser.add_argument("--model", type=Path, help="of real_blobs, learned before")
    given = parser.parse_args()
    if not (people.available() and real_blobs.available() and has_blender()):
        print("expected the recordings in ../shared/data, and the bpy package", file=sys.stderr)
        return 1
    rows, answers = [], []
    for name in given.only:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            title, takes, frames = takes_of(name, folder, given.groups, given.model)
            if given.speed:
                rows += [[title, *speed_cells(take, folder / "out", frames, given.speed)] for take in takes]
                continue
            compared, questions = Compared(name != "real"), np.zeros(3, dtype=int)
            for take in takes:
                compared.add(take, folder / "out", frames)
                both = asked(take, frames)
                questions += both.questions, both.differ, both.clear
            rows.append(compared.cells(title))
            answers.append([title, *(share(int(n), int(questions[0]), 3) for n in questions[1:])])
    if given.speed:
        load = f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores" if hasattr(os, "getloadavg") else ""
        print(f"### Frames a second, best of {given.speed}, {load}\n\n" + table(SPEEDS, rows))
        return 0
    print("### Whole takes, labelled with --occlusion bvh and capsules\n\n" + table(COLUMNS, rows))
    columns = ("what", "is a marker hidden from a camera: answers that differ", "of them clear ones")
    print("\n### The same questions, asked in both ways\n\n" + table(columns, answers))
    return 0


if __name__ == "__main__":
    sys.exit(main())
