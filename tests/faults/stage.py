# SPDX-License-Identifier: GPL-3.0-or-later
"""Short takes of points, batches of them by the command line, and what undisturbed ones make of them."""

import json
import os
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

from addon.cli import workers
from addon.demo.take import MODEL, make_performance
from addon.io.batch import read_table
from addon.io.html.markup import is_page
from addon.io.markersets import open_markerset
from addon.io.points import of_frames, write_c3d
from addon.io.whole import LIST, PART

ROOT = Path(__file__).resolve().parents[2]
TAKES = {"walk": (100, 107), "turn": (160, 167), "reach": (200, 207), "wave": (300, 307)}  # first and last frame
OPTIONS = ("--html", "--summary", "--trc")
ENDINGS = (".labels.csv", ".c3d", ".report.json", ".report.html", ".trc")
TABLE, SUMMARIES = "summary.csv", {"summary.csv", "summary.report.html"}
CHANGING = ("timing", "changed", "changed_in_all")  # of a report: what two batches of the same need not have alike
SECONDS = 120.0  # in which any batch of these ends
# What is seen in the folder of the results: a folder of unfinished files, the list of what is to be renamed, a result.
SEEN = {"part": f"{PART}*", "list": f"{PART}*/{LIST}", "file": "[!.]*"}


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
    output: list[tuple[str, str]] = field(default_factory=list)

    def __post_init__(self):
        self._reader = threading.Thread(target=lambda: self.output.append(self.process.communicate()), daemon=True)
        self._reader.start()

    @property
    def ended(self) -> bool:
        return self.process.poll() is not None

    def said(self) -> Said:
        """What it said, when it and all its processes have ended; TimeoutError where they do not."""
        self._reader.join(SECONDS)
        if not self.output:
            self.kill("all")
            raise TimeoutError(f"a batch does not end within {SECONDS:.0f} s")
        wait_for(lambda: not at_work(self.temporary))
        out, lines = self.output[0][0], tuple(self.output[0][1].splitlines())
        with suppress(ValueError):
            return Said(self.process.returncode, tuple(take["take"] for take in json.loads(out)["takes"]), lines)
        return Said(self.process.returncode, (), lines)

    def kill(self, who: str):
        """Ends with signal 9 the "first" process, "one" of the others, or "all" of them."""
        first, rest = [self.process.pid], [one for one in at_work(self.temporary) if one != self.process.pid]
        for number in {"first": first, "all": first + rest, "one": rest[:1] or first}[who]:
            with suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)


class Stage:
    """Takes in a folder, batches of them, and what they make when nothing disturbs them."""

    def __init__(self, folder: Path):
        self.folder, self.inputs = folder, folder / "takes"
        self.inputs.mkdir(parents=True)
        performance = make_performance(open_markerset(MODEL))
        for name, frames in TAKES.items():
            write_c3d(self.inputs / f"{name}.c3d", of_frames(performance.take, frames))
        begin, out = time.monotonic(), folder / "made"
        said = self.start(self.words(tuple(TAKES), out), folder / "temporary").said()
        self.seconds = time.monotonic() - begin
        if said.status or {path.name for path in out.iterdir()} != files_of(TAKES) | SUMMARIES:
            raise RuntimeError(f"a batch that nothing disturbs fails: {said}")
        self.made = {path.name: content(path) for path in out.iterdir()}
        self.bytes = {path.name: path.stat().st_size + 4096 for path in out.iterdir()}

    def words(self, takes: Sequence[str], out: Path, *more: str, jobs: int = 2, inputs: Path | None = None):
        """The command line of a batch."""
        sources = [str((inputs or self.inputs) / f"{take}.c3d") for take in takes]
        return ["label", *sources, f"--model={MODEL}", f"--out={out}", "--json", *OPTIONS, f"--jobs={jobs}", *more]

    def start(self, words: Sequence[str], temporary: Path, **more) -> Run:
        """Starts a command line in a process of its own."""
        temporary.mkdir(exist_ok=True, parents=True)
        line = [sys.executable, "-c", workers.SCRIPT, str(workers.ROOT), json.dumps(sys.path), *words]
        env = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "TMPDIR": str(temporary)}
        pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        return Run(subprocess.Popen(line, env=env, start_new_session=True, **pipes, **more), temporary)


def files_of(takes: Sequence[str]) -> set[str]:
    """The names of the files that are made of takes, but for those over all of them."""
    return {f"{take}{ending}" for take in takes for ending in ENDINGS}


def content(path: Path) -> object:
    """What a result holds, but for the time that it took; ValueError or another where it is not whole."""
    if path.name == TABLE:
        return {row.take: replace(row, seconds=0.0, state="") for row in read_table(path)}
    if path.name in SUMMARIES:
        if not is_page(path) or not path.read_bytes().rstrip().endswith(b"</html>"):
            raise ValueError(f"{path} is no whole page")
        return "page"
    if path.name.endswith(".json"):
        report = {name: value for name, value in json.loads(path.read_bytes()).items() if name not in CHANGING}
        # The digest of the report is of these too, and takes are as far away as the folder of results is.
        made = report["provenance"] | {"report": None}
        made["input"] = [row | {"file": Path(row["file"]).name} for row in made["input"]]
        return report | {"provenance": made}
    return path.read_bytes()


def at_work(temporary: Path) -> list[int]:
    """The processes that have such a folder for temporary files, as all of a batch do."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if os.fsencode(f"TMPDIR={temporary}") in (process / "environ").read_bytes().split(b"\0"):
                found.append(int(process.name))
    return found


def wait_for(what: Callable[[], object]):
    """Waits until something is so; TimeoutError where it never is."""
    end = time.monotonic() + SECONDS
    while not what():
        if time.monotonic() > end:
            raise TimeoutError(f"what was waited for does not come within {SECONDS:.0f} s")
        time.sleep(0.02)


def wait_for_a_moment(chance: Random, seconds: float, run: Run, out: Path) -> bool:
    """Waits for any moment of a batch; False where it ended before.

    A third of them are at any time of the `seconds` that it takes, the others at what is over in a moment: when one of
    what `SEEN` says is seen in the folder of its results, or a little later.
    """
    kind, number = chance.choice(["time", *SEEN]), chance.randint(1, 4)
    delay = chance.uniform(0.1, 1.0) * seconds if kind == "time" else chance.choice([0.0, chance.uniform(0, 0.03)])
    before, seen = set(out.glob(SEEN.get(kind, "*"))), set()
    while kind != "time" and not run.ended and len(seen) < number:
        with suppress(OSError):
            seen |= set(out.glob(SEEN[kind])) - before
        time.sleep(0.0005)
    end = time.monotonic() + delay
    while not run.ended and time.monotonic() < end:
        time.sleep(0.005)
    return not run.ended
