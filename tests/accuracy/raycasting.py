# SPDX-License-Identifier: GPL-3.0-or-later
"""What the body in the way is asked by, rays or the closed form: python -m tests.accuracy.raycasting.

Whole takes are labelled with the closed form, with rays cast at the meshes of the same capsules, and with rays cast at
a character's own mesh: walks and turns of all recorded people in a real room, with models that were learned without
them; the demo's take; and real blobs. It needs the bpy package.
"""

import argparse
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from time import process_time

import numpy as np

from addon.blendfile import has_blender, mesh_occlusion, start_blender
from addon.capturing import truth_path, write_capture
from addon.core.blobs.pipeline import label_take
from addon.core.data.markersets import MarkerSet
from addon.core.data.progress import finished
from addon.core.papers.virtual_occlusions.occlusion import OCCLUDING, CapsuleOcclusion, Occlusion
from addon.demo.take import MODEL, STAGE, TROUBLE, make_performance
from addon.io.blobs import read_blobs, write_blobs
from addon.io.cameras import read_cameras, write_cameras
from addon.io.labels import TruthWriter
from addon.io.markersets import open_markerset, write_markerset
from addon.jobs import LabelJob, label_file

from . import people, real_blobs
from .commands import KEYS, Answer, Files, labelled, rows_of, side_by_side
from .models import left_out_model
from .tables import share, table
from .walking import RATE, walking

WAYS = ("capsules", "bvh", "own")
BODIES = {"capsules": "closed form", "bvh": "meshes of the capsules", "own": "a character's own mesh"}
KINDS = ("gait15", "body26", "demo", "real")
SPEEDS = ("what", "body in the way", "frames a second", "in a second of a core's time, with files")
CAMERAS = (8, 8)
SEED = 1
TAKES = 4  # of each group of two people: a walk and a turn each
COLUMNS = (
    "what",
    "takes",
    "body in the way",
    "labels",
    "wrong",
    "recall",
    "blobs named differently from the closed form",
    "right here only",
    "right with the closed form only",
    "neither, or no truth",
)
ANSWERS = (
    "what",
    "body in the way",
    "is a marker hidden from a camera: answers that differ from the closed form's",
    "hidden here only",
    "hidden by the closed form only",
    "of all that differ, clear ones",
)


class Compared:
    """Adds up takes that were labelled in all ways, each beside the closed form.

    differ   what differs, by who is right; "neither" where the truth has no name, which is a ghost only in captures
    """

    def __init__(self, ghosts_known: bool = True):
        self.ghosts_known = ghosts_known
        self.takes = self.blobs = self.present = 0
        self.differ: dict[str, Counter[str]] = {way: Counter() for way in WAYS}
        self.given: Counter[str] = Counter()
        self.right: Counter[str] = Counter()

    def add(self, take: Files, out: Path, frames: tuple[int, int] | None, own: Occlusion):
        """Labels a take in all ways and compares."""
        rows = {way: rows_of(labelled_by(way, take, out, frames, own).labels) for way in WAYS}
        self.takes += 1
        truth = rows_of(take.truth, frames)
        pairs = zip(*(side_by_side(rows[way], truth) for way in WAYS), strict=True)
        for both in pairs:
            named = {way: given["marker"] for way, (given, _) in zip(WAYS, both, strict=True)}
            self._count(named, both[0][1]["marker"])

    def _count(self, named: dict[str, str], truth: str):
        self.blobs += 1
        self.present += bool(truth)
        good = {way: name in truth.split("|") for way, name in named.items()}
        known = bool(truth) or self.ghosts_known
        for way in WAYS:
            self.given[way] += bool(named[way])
            self.right[way] += bool(named[way]) and good[way]
            if named[way] != named["capsules"]:
                sole = [one for one in (way, "capsules") if good[one]] if known else []
                self.differ[way][sole[0] if len(sole) == 1 else "neither"] += 1

    def cells(self, title: str) -> list[list[str]]:
        """The rows under `COLUMNS`."""
        return [self._row(title, way) for way in WAYS]

    def _row(self, title: str, way: str) -> list[str]:
        given, right, differ = self.given[way], self.right[way], self.differ[way]
        figures = [str(given), share(given - right, given, 3), f"{100 * right / self.present:.2f} %"]
        others = [share(differ.total(), self.blobs, 3), *(str(differ[who]) for who in (way, "capsules", "neither"))]
        return [title, str(self.takes), BODIES[way], *figures, *(others if way != "capsules" else [""] * len(others))]


def labelled_by(way: str, take: Files, out: Path, frames: tuple[int, int] | None, own: Occlusion) -> Answer:
    """A take, or some frames of it, labelled in one of `WAYS`.

    The command line does it, but for a character's own mesh, which only a scene can have: that goes through the job of
    the sidebar.
    """
    if way == "own":
        return _labelled_with(own, take, out / way, frames)
    part = ("--frames", f"{frames[0]}:{frames[1]}") if frames else ()
    answer = labelled(take, out / way, "--occlusion", way, *part)
    if answer.report["occlusion"] != way:
        raise RuntimeError(f"{answer.report['occlusion']} was used; expected {way}")
    return answer


def _labelled_with(own: Occlusion, take: Files, out: Path, frames: tuple[int, int] | None) -> Answer:
    job = LabelJob(
        source=take.blobs,
        cameras=take.cameras,
        model=str(take.model),
        out=out,
        frames=frames,
        rate=take.rate,
        occlusion="bvh",
        body=own,
        overwrite=True,
    )
    begin = process_time()
    report = finished(label_file(job)).report
    return Answer(report, job.path(".labels.csv"), process_time() - begin)


class Asked:
    """All ways asked the same questions; the answer of the capsules' meshes is given.

    questions  how many markers and cameras were asked about
    counts     of each way but the closed form: hidden by it only, hidden by the closed form only, and how many of
               these a capsule 1.5 % thinner would not answer differently
    """

    def __init__(self, markerset: MarkerSet, own: Occlusion):
        shrink = OCCLUDING.fitted_shrink
        self.capsules, self.thinner = (CapsuleOcclusion(markerset, part * shrink) for part in (1.0, 0.985))
        self.meshes = {"bvh": mesh_occlusion(markerset), "own": own}
        self.questions, self.counts = 0, {way: np.zeros(3, dtype=int) for way in self.meshes}

    def hidden(self, *given) -> np.ndarray:
        """See `addon.core.papers.virtual_occlusions.occlusion.Occlusion.hidden`."""
        closed, thinner = self.capsules.hidden(*given), self.thinner.hidden(*given)
        found = {way: meshes.hidden(*given) for way, meshes in self.meshes.items()}
        self.questions += closed.size
        for way, cast in found.items():
            parts = (cast & ~closed, closed & ~cast, (cast != closed) & (closed == thinner))
            self.counts[way] += [int(part.sum()) for part in parts]
        return found["bvh"]


def asked(take: Files, frames: tuple[int, int] | None, own: Occlusion) -> Asked:
    """The answers of all ways to what the labelling of a take asks."""
    markerset, cameras = open_markerset(str(take.model)), read_cameras(take.cameras)
    ways = Asked(markerset, own)
    chunks = (rows.blobs for rows in read_blobs(take.blobs, cameras, frames or (None, None)))
    for _ in label_take(chunks, cameras, markerset, take.rate, None, ways):
        pass
    return ways


class Answers:
    """Adds up what was answered."""

    def __init__(self):
        self.questions, self.counts = 0, Counter()

    def add(self, ways: Asked):
        """Those of one take more."""
        self.questions += ways.questions
        self.counts.update(
            {(way, part): int(n) for way, counts in ways.counts.items() for part, n in enumerate(counts)}
        )

    def cells(self, title: str) -> list[list[str]]:
        """The rows under `ANSWERS`."""
        rows = []
        for way in WAYS[1:]:
            more, less, clear = (self.counts[way, part] for part in range(3))
            shares = [share(n, self.questions, 3) for n in (more + less, more, less, clear)]
            rows.append([title, BODIES[way], *shares])
        return rows


def walks(set_name: str, folder: Path, groups: int) -> Iterator[Files]:
    """Walks and turns of the recorded people as files, each with a model that was learned without its person."""
    for fold in people.folds()[:groups]:
        markerset = left_out_model(set_name, fold)
        model = folder / f"{'-'.join(fold)}.markerset.json"
        write_markerset(model, markerset)
        for number, trial in enumerate(walking(markerset.markers, fold, TAKES, SEED, cameras=CAMERAS)):
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
    return f"walks and turns, `{name}`, {CAMERAS[0]} cameras", walks(name, folder, groups), None


class Characters:
    """A character's own mesh for each model, made once."""

    def __init__(self):
        self._made: dict[str, Occlusion] = {}

    def wearing(self, model: Path | str) -> Occlusion:
        """The character on the skeleton of a model."""
        start_blender()
        from .characters import character_occlusion

        name = str(model)
        if name not in self._made:
            self._made[name] = character_occlusion(open_markerset(name))
        return self._made[name]


def speed_rows(
    title: str, take: Files, out: Path, frames: tuple[int, int] | None, own: Occlusion, repeats: int
) -> list[list[str]]:
    """Frames a second in all ways, best of `repeats`: by the clock, as the report has it, and of one core's time."""
    rows = []
    for way in WAYS:
        answers = [labelled_by(way, take, out, frames, own) for _ in range(repeats)]
        clock = max(answer.report["timing"]["frames_per_second"] for answer in answers)
        core = answers[0].report["frames"] / min(answer.seconds for answer in answers)
        rows.append([title, BODIES[way], f"{clock:.0f}", f"{core:.0f}"])
    return rows


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
            folder, characters = Path(temporary), Characters()
            title, takes, frames = takes_of(name, folder, given.groups, given.model)
            compared, answered = Compared(name != "real"), Answers()
            for take in takes:
                own = characters.wearing(take.model)
                if given.speed:
                    rows += speed_rows(title, take, folder / "out", frames, own, given.speed)
                else:
                    compared.add(take, folder / "out", frames, own)
                    answered.add(asked(take, frames, own))
            if not given.speed:
                rows += compared.cells(title)
                answers += answered.cells(title)
    if given.speed:
        load = f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores" if hasattr(os, "getloadavg") else ""
        print(f"### Frames a second, best of {given.speed}, {load}\n\n" + table(SPEEDS, rows))
        return 0
    print("### Whole takes, labelled with each body in the way\n\n" + table(COLUMNS, rows))
    print("\n### The same questions, asked of each\n\n" + table(ANSWERS, answers))
    return 0


if __name__ == "__main__":
    sys.exit(main())
