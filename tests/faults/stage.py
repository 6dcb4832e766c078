# SPDX-License-Identifier: GPL-3.0-or-later
"""Short takes of blobs and of points, batches of them by the command line, and what undisturbed ones make of them."""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random

import numpy as np

from addon.capturing import cut, write_capture
from addon.cli import workers
from addon.core.data.takes import Points
from addon.demo.take import MODEL, STAGE_RATE, TROUBLE, make_performance
from addon.io.batch import read_table
from addon.io.cameras import write_cameras
from addon.io.html.markup import is_page
from addon.io.labels import LabelFile
from addon.io.markersets import open_markerset
from addon.io.points import read_points, write_c3d
from addon.io.whole import LIST, PART

ROOT = Path(__file__).resolve().parents[2]
BLOBS = {"walk": (100, 102), "turn": (160, 162)}  # takes and their first and last frame
POINTS = {"reach": (200, 207), "wave": (300, 307)}
OPTIONS = (("--trc",), ("--html", "--summary"), ("--html", "--summary", "--fill", "--trc"))
OLDER = ("--target", "0.9", "--height", "1.9")  # of results that are there already, and are to be replaced
ENDINGS = (".labels.csv", ".c3d", ".report.json")
PAGE, TRC, TABLE = ".report.html", ".trc", "summary.csv"
SECONDS = 120.0  # in which any batch of these ends


@dataclass(frozen=True)
class Plan:
    """A batch: its takes, what is asked for, how many side by side, and whether older results are to be replaced."""

    takes: tuple[str, ...]
    options: tuple[str, ...]
    jobs: int
    over: bool = False

    @classmethod
    def drawn(cls, chance: Random, over: bool | None = None, quick: bool = False) -> "Plan":
        """Any of them; a `quick` one of few points."""
        if quick:
            return cls(tuple(POINTS), OPTIONS[0], chance.choice([1, 2]))
        takes = chance.sample([*BLOBS, *POINTS], chance.choice([2, 2, 3, 4]))
        over = chance.random() < 0.25 if over is None else over
        return cls(tuple(takes), chance.choice(OPTIONS), chance.choice([1, 2]), over)

    def __str__(self) -> str:
        return f"{' '.join(self.takes)} --jobs {self.jobs} {' '.join(self.options)}{' over older' * self.over}"

    @property
    def endings(self) -> tuple[str, ...]:
        """Those of the files of each take."""
        return (
            *ENDINGS,
            *((PAGE,) if "--html" in self.options else ()),
            *((TRC,) if "--trc" in self.options else ()),
        )

    @property
    def summaries(self) -> set[str]:
        """The files over all takes."""
        return {TABLE, "summary" + PAGE} if "--summary" in self.options else set()

    def files(self, take: str) -> set[str]:
        """Those of one take."""
        return {take + ending for ending in self.endings}

    @property
    def names(self) -> set[str]:
        """Those of all files that the batch makes."""
        return {name for take in self.takes for name in self.files(take)} | self.summaries


@dataclass(frozen=True)
class Said:
    """How a batch ended: exit status, takes that it says are done, and its lines on standard error."""

    status: int
    done: tuple[str, ...]
    lines: tuple[str, ...]


@dataclass(eq=False)
class Run:
    """A batch at work in processes of its own, which have `temporary` for their temporary files."""

    process: subprocess.Popen
    temporary: Path
    heard: list[tuple[str, str]] = field(default_factory=list)

    def __post_init__(self):
        self._listener = threading.Thread(target=lambda: self.heard.append(self.process.communicate()), daemon=True)
        self._listener.start()

    @property
    def ended(self) -> bool:
        return self.process.poll() is not None

    @property
    def workers(self) -> list[int]:
        """Its processes beside the first."""
        return [number for number in at_work(self.temporary) if number != self.process.pid]

    def said(self) -> Said:
        """What it said, when it and all its processes have ended; TimeoutError where they do not."""
        self._listener.join(SECONDS)
        if not self.heard:
            self.kill("all")
            raise TimeoutError(f"a batch does not end within {SECONDS:.0f} s")
        wait_for(lambda: not at_work(self.temporary))
        out, lines = self.heard[0][0], self.heard[0][1].splitlines()
        with suppress(ValueError):
            return Said(self.process.returncode, tuple(take["take"] for take in json.loads(out)["takes"]), tuple(lines))
        return Said(self.process.returncode, (), tuple(lines))

    def kill(self, who: str, chance: Random | None = None):
        """Ends with signal 9 the first process, one of the others, or all of them."""
        first, rest = [self.process.pid], self.workers
        numbers = {"first": first, "all": first + rest, "one": [chance.choice(rest)] if rest and chance else first}[who]
        for number in numbers:
            with suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)


class Stage:
    """Takes and their room in a folder, batches of them, and what they make when nothing disturbs them."""

    def __init__(self, folder: Path, quick: bool = False):
        self.folder, self.inputs, self.quick = folder, folder / "takes", quick
        self.inputs.mkdir(parents=True)
        self.cameras = folder / "room.toml"
        self._write()
        self._made: dict[tuple, dict[str, object]] = {}
        self.took: dict[tuple, float] = {}

    def _write(self):
        performance = make_performance(open_markerset(MODEL))
        write_cameras(self.cameras, performance.cameras)
        for name, frames in (BLOBS | POINTS).items():
            take, body, part = cut(performance.take, frames), performance.body, slice(frames[0] - 1, frames[1])
            if name in POINTS:
                residual = np.zeros(take.xyz.shape[:2])
                points = Points(take.names, take.xyz, residual, STAGE_RATE, take.first_frame)
                write_c3d(self.inputs / f"{name}.c3d", points)
                continue
            body = replace(body, rotations=body.rotations[part], joints=body.joints[part], scale=body.scale[part])
            for _ in write_capture(take, performance.cameras, TROUBLE, body, self.inputs / f"{name}.csv"):
                pass

    def words(self, plan: Plan, out: Path, *more: str, inputs: Path | None = None) -> list[str]:
        """The command line of a batch."""
        takes = [str((inputs or self.inputs) / f"{take}{'.csv' if take in BLOBS else '.c3d'}") for take in plan.takes]
        where = [f"--model={MODEL}", f"--cameras={self.cameras}", f"--out={out}", "--json"]
        return ["label", *takes, *where, *plan.options, "--jobs", str(plan.jobs), *more]

    def start(self, words: Sequence[str], temporary: Path, before: Sequence[str] = (), **more) -> Run:
        """Starts a command line in a process of its own, behind words that have a say in what that may do."""
        temporary.mkdir(exist_ok=True, parents=True)
        line = [*before, sys.executable, "-c", workers.SCRIPT, str(workers.ROOT), json.dumps(sys.path), *words]
        lean = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        env = os.environ | lean | {"TMPDIR": str(temporary)}
        return Run(subprocess.Popen(line, env=env, start_new_session=True, **pipes, **more), temporary)

    def copy_takes(self, folder: Path):
        """Puts all takes into a folder."""
        shutil.copytree(self.inputs, folder)

    @property
    def take_names(self) -> set[str]:
        """The names of all files among the takes."""
        return {path.name for path in self.inputs.iterdir()}

    def size(self, plan: Plan) -> int:
        """Bytes of all results of a batch, as a disk counts them."""
        self.made(plan)
        place = self._place(plan.options, False)
        return sum((place / name).stat().st_size + 4096 for name in plan.names)

    def made(self, plan: Plan, older: bool = False) -> dict[str, object]:
        """What an undisturbed batch of all takes makes, or one of older results; by the names of its files."""
        return self._reference(plan.options, older)

    def _reference(self, options: tuple[str, ...], older: bool) -> dict[str, object]:
        key = options, older
        if key not in self._made:
            out = self._place(options, older)
            plan = Plan((*(() if self.quick else BLOBS), *POINTS), options, 2)
            begin = time.monotonic()
            said = self.start(self.words(plan, out, *(OLDER if older else ())), self.folder / "temporary").said()
            self.took[options] = time.monotonic() - begin
            if said.status:
                raise RuntimeError(f"a batch that nothing disturbs fails: {said}")
            names = {path.name for path in out.iterdir()}
            if names != plan.names:
                raise RuntimeError(f"a batch that nothing disturbs makes {sorted(names)}")
            for path in out.iterdir():
                read_whole(path)
            self._made[key] = {path.name: content(path) for path in out.iterdir()}
        return self._made[key]

    def _place(self, options: tuple[str, ...], older: bool) -> Path:
        return self.folder / "made" / f"{OPTIONS.index(options)}-{older}"

    def lay(self, plan: Plan, out: Path):
        """Puts older results of the takes of a plan there."""
        self.made(plan, older=True)
        out.mkdir(parents=True)
        for name in plan.names - plan.summaries:
            shutil.copy2(self._place(plan.options, True) / name, out / name)

    def seconds(self, plan: Plan) -> float:
        """About how long a batch takes."""
        self.made(plan)
        return self.took[plan.options] * (0.6 + 0.1 * len(plan.takes))


def read_whole(path: Path):
    """Reads a result by the reader of its kind; raises where it is not whole."""
    name = path.name
    if name == TABLE:
        read_table(path)
    elif name.endswith(PAGE):
        if not is_page(path) or not path.read_bytes().rstrip().endswith(b"</html>"):
            raise ValueError(f"{name} is no whole page")
    elif name.endswith(".labels.csv"):
        with LabelFile(path) as file:
            for _ in file.rows():
                pass
    elif name.endswith(".report.json"):
        json.loads(path.read_bytes())["made_of"]
    else:
        read_points(path)


def content(path: Path) -> object:
    """What a result holds, but for what two batches of the same need not have alike: the time that it took."""
    held = path.read_bytes()
    if path.name == TABLE:
        return {row.take: replace(row, seconds=0.0, state="") for row in read_table(path)}
    if path.name == "summary" + PAGE:
        return "page"
    if path.name.endswith(".report.json"):
        report = {name: value for name, value in json.loads(held).items() if name not in CHANGING}
        report["made_of"] = report["made_of"] | {"results": {**report["made_of"]["results"], PAGE: None}}
        return report
    return held


CHANGING = ("timing", "changed", "changed_in_all")


def at_work(temporary: Path) -> list[int]:
    """The processes that have such a folder for temporary files, as all of a batch do."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "environ").read_bytes().split(b"\0")
        except OSError:
            continue
        if os.fsencode(f"TMPDIR={temporary}") in words:
            found.append(int(process.name))
    return found


def wait_for(what: Callable[[], object], seconds: float = SECONDS):
    """Waits until something is so; TimeoutError where it never is."""
    end = time.monotonic() + seconds
    while not what():
        if time.monotonic() > end:
            raise TimeoutError(f"what was waited for does not come within {seconds:.0f} s")
        time.sleep(0.02)


@dataclass(frozen=True)
class Moment:
    """When something happens to a batch.

    kind    "time", after a part of what it takes; else when the number-th of these is seen in the folder of its
            results: "part" a folder of unfinished files, "list" the list of what is to be renamed, "file" a result
    number  counted from 1
    delay   s after that
    """

    kind: str
    number: int
    delay: float

    @classmethod
    def drawn(cls, chance: Random, seconds: float, takes: int) -> "Moment":
        """Any: half of them at any time, the others at what is over in a moment."""
        kind = chance.choice(["time", "time", "time", "part", "list", "list", "file", "file"])
        if kind == "time":
            return cls(kind, 0, chance.uniform(0.1, 1.0) * seconds)
        number = chance.randint(1, takes) if kind != "file" else chance.randint(1, 4 * takes)
        return cls(kind, number, chance.choice([0.0, chance.uniform(0, 0.005), chance.uniform(0, 0.03)]))

    def wait(self, run: Run, out: Path) -> bool:
        """Waits for it; False where the batch ended before."""
        before, seen = set(_files(out)), set()
        while self.kind != "time" and not run.ended:
            seen |= self._seen(out, before)
            if len(seen) >= self.number:
                break
            time.sleep(0.0005)
        end = time.monotonic() + self.delay
        while not run.ended and time.monotonic() < end:
            time.sleep(min(0.005, max(end - time.monotonic(), 0)))
        return not run.ended

    def _seen(self, out: Path, before: set[tuple]) -> set:
        if self.kind == "file":
            return set(_files(out)) - before
        pattern = f"{PART}*" if self.kind == "part" else f"{PART}*/{LIST}"
        with suppress(OSError):
            return set(out.glob(pattern))
        return set()


def _files(out: Path) -> list[tuple]:
    """Name and identity of every result in a folder."""
    found = []
    with suppress(OSError), os.scandir(out) as entries:
        for entry in entries:
            with suppress(OSError):
                if entry.is_file(follow_symlinks=False):
                    found.append((entry.name, entry.inode(), entry.stat().st_mtime_ns))
    return found
