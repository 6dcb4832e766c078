# SPDX-License-Identifier: GPL-3.0-or-later
"""Breaks sound files in many ways and reads them: `python -m tests.fuzz [KIND …] --count N --seed S`.

Every reader must give the content or one `InputError` that names the file and says in one sentence what was expected:
within limits of memory and time, without a warning, a file written elsewhere, a process or the network. What was read
is written and read again (every tenth file), or goes through the verb that it is for (every hundredth). A kind is read
in a process of its own; one that dies is told with its case and the rest goes on.
Case I of seed S is always the same file: `python -m tests.fuzz KIND --seed S --case I --keep FOLDER` makes it again.
"""

import argparse
import contextlib
import io
import json
import mmap
import os
import re
import selectors
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path

from addon import cli
from addon.core.data.errors import InputError

from .kinds import READERS, USES, Verbs, samples
from .wounds import case, mutated

try:
    from . import watched
except ImportError:  # Windows has no limits for a process
    watched = None

# Whatever comes is what is looked for.
FAULTS = (Exception, watched.TooSlowError) if watched else Exception
COMMAND = [sys.executable, "-m", "tests.fuzz"]
LONGEST = 2000  # letters of a sentence that people read
AGAIN_EVERY, VERB_EVERY = 10, 100
STUCK = 60  # s without a new file, after which a process that no signal reaches is ended
_STATE = struct.Struct("<8q")


@dataclass
class Tally:
    """What a process has done so far; in memory that its parent sees, for it may die.

    number   of the case that it reads
    slowest  µs of the processor; slow_case says of which case
    peak     kB of memory
    spent    µs of the processor, for all
    """

    number: int = -1
    refused: int = 0
    read: int = 0
    verbs: int = 0
    slowest: int = 0
    slow_case: int = -1
    peak: int = 0
    spent: int = 0

    def store(self, shared: mmap.mmap):
        _STATE.pack_into(shared, 0, *(getattr(self, field.name) for field in fields(self)))

    @classmethod
    def load(cls, shared: mmap.mmap) -> "Tally":
        return cls(*_STATE.unpack_from(shared, 0))

    def add(self, other: "Tally"):
        """Takes in what another process has done."""
        for name in ("refused", "read", "verbs", "spent"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        if other.slowest > self.slowest:
            self.slowest, self.slow_case = other.slowest, other.slow_case
        self.peak = max(self.peak, other.peak)


def trouble(reader: Callable[[Path], object], path: Path) -> str | None:
    """What is wrong with how a file is read; None where it is right, and "refused" where it is right to refuse it."""
    return answer(lambda: reader(path), path)[0]


def answer(read: Callable[[], object], path: Path) -> tuple[str | None, object]:
    """The same of a call, and what it gave."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return None, read()
    except InputError as error:
        return _sentence(error, path), None
    except MemoryError:
        return f"takes over {watched.MEMORY_MB if watched else ''} MB", None
    except FAULTS as error:
        return f"{type(error).__name__}: {error}{_where(error)}", None


def _where(error: BaseException) -> str:
    """The last place of our own in which an error arose."""
    place, trace = "", error.__traceback__
    while trace is not None:
        name = trace.tb_frame.f_code.co_filename
        if f"{os.sep}addon{os.sep}" in name:
            place = f" at {name.rpartition(f'{os.sep}addon{os.sep}')[2]}:{trace.tb_lineno}"
        trace = trace.tb_next
    return place


def _sentence(error: InputError, path: Path) -> str:
    if not error.file:
        return f"names no file: {error}"
    said = error.message
    if "; expected" not in said or len(said.splitlines()) != 1:
        return f"is no sentence of what is wrong; expected …: {said[:300]!r}"
    if len(said) > LONGEST:
        return f"says {len(said)} letters: {said[:100]!r}"
    odd = [letter for letter in said if letter < " " or "\x7f" <= letter < "\xa0"]
    if odd:
        return f"says a sign that no terminal should get: {said[:300]!r}"
    return "refused"


class Bench:
    """Where cases of one kind are tried, one after the other: the files, what was broken, and what is looked at."""

    def __init__(self, kind: str, folder: Path):
        self.kind, self.folder = kind, folder
        for name in ("sound", "case", "out", "tmp"):
            (folder / name).mkdir()
        self.files = samples(folder / "sound")
        self.contents = {name: file.read_bytes() for name, file in self.files.items()}
        own = self.files[kind]
        if own.parent.name == "selfcal":
            shutil.copytree(own.parent, folder / "case", dirs_exist_ok=True)
        if kind == "report":
            shutil.copy(own.with_name("taught.c3d"), folder / "case")
        self.path = folder / "case" / own.name
        self.verbs = Verbs(self.files, folder / "out")
        tempfile.tempdir = os.environ["TMPDIR"] = str(folder / "tmp")
        self.sound_ones = len(list((folder / "case").iterdir())) + (not self.path.exists())
        self.watch = watched.Watch([folder / "out", folder / "tmp"], [folder])
        self.path.write_bytes(self.contents[kind])
        READERS[kind](self.path)  # loads what is loaded late

    def attempt(self, content: bytes, again: bool = True, verb: bool = False) -> str | None:
        """What is wrong with how the reader takes this content, or what is done then; see `trouble`."""
        self.path.write_bytes(content)
        with self.watch.around() as seen:
            try:
                with watched.in_time():
                    said = self._read(again, verb)
            except watched.TooSlowError as error:  # between two of its parts
                said = str(error)
        self._tidy(seen)
        return seen[0] if seen else said

    def _read(self, again: bool, verb: bool) -> str | None:
        said, value = answer(lambda: READERS[self.kind](self.path), self.path)
        if said is None and again and self.kind in USES:
            said, _ = answer(lambda: self._use(value), self.path)
        if verb and said in (None, "refused"):
            told = self._verb()
            said = (told and f"verb: {told}") or said
        return said

    def _use(self, value: object):
        try:
            USES[self.kind](value, self.folder / "out")
        except InputError as error:
            raise AssertionError(f"once read, it is refused: {error.message}") from None

    def _verb(self) -> str | None:
        """Nothing, or what the command line says that is no reading and no one sentence."""
        words = self.verbs.of(self.kind, self.path)
        if not words:
            return None
        out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2))
        before = [signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            warnings.simplefilter("error")
            status = cli.main(words)
        for one, handler in zip((signal.SIGINT, signal.SIGTERM, signal.SIGHUP), before, strict=True):
            signal.signal(one, handler)
        lines = err.buffer.getvalue().decode("utf-8", "replace").splitlines()
        if any("a fault of Mocap Autolabel" in line or "the memory is full" in line for line in lines):
            return next(line for line in lines if "a fault" in line or "the memory" in line)
        if status and (len(lines) != 1 or "; expected" not in lines[0]):
            return f"status {status}, and says {lines!r}"[:500]
        return None

    def _tidy(self, seen: list[str]):
        """Nothing may be left beside the file or among temporary ones; results of a case are taken away."""
        left = [one.name for one in os.scandir(self.folder / "tmp")]
        if left:
            seen.append(f"leaves {left[:3]} among temporary files")
            for name in left:
                _take_away(self.folder / "tmp" / name)
        beside = [one.name for one in os.scandir(self.folder / "case")]
        if len(beside) != self.sound_ones:
            seen.append(f"leaves something in {beside}")
        for one in os.scandir(self.folder / "out"):
            _take_away(Path(one.path))


def _take_away(path: Path):
    shutil.rmtree(path) if path.is_dir() else path.unlink()


def work(kind: str, seed: int, numbers: range, until: float, shared: Path):
    """Reads all those cases in this process and tells each fault as a line; the state is in the file `shared`."""
    with shared.open("r+b") as file, tempfile.TemporaryDirectory(dir=watched.quick_folder()) as folder:
        state = mmap.mmap(file.fileno(), _STATE.size)
        bench, tally = Bench(kind, Path(folder)), Tally()
        watched.limit()
        for number in numbers:
            if time.time() > until:
                break
            tally.number = number
            tally.store(state)
            begin, verb = time.process_time(), number % VERB_EVERY == VERB_EVERY - 1
            content = case(kind, bench.contents, seed, number)
            found = bench.attempt(content, number % AGAIN_EVERY == 0, verb)
            took = int(1e6 * (time.process_time() - begin))
            if took > tally.slowest:
                tally.slowest, tally.slow_case, tally.peak = took, number, int(1024 * watched.peak_mb())
            tally.spent += took
            tally.verbs += verb and bool(bench.verbs.of(kind, bench.path))
            if found in (None, "refused"):
                tally.read, tally.refused = tally.read + (found is None), tally.refused + (found is not None)
            else:
                print(json.dumps([number, found]), flush=True)
        tally.peak, tally.number = int(1024 * watched.peak_mb()), -2
        tally.store(state)


def results(kind: str, seed: int, numbers: range, until: float, tally: Tally) -> Iterator[tuple[int, str]]:
    """Each case that is a fault and what it is, out of processes that may die; `tally` gets the rest."""
    lean = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    while numbers and time.time() < until:
        with tempfile.NamedTemporaryFile() as shared:
            shared.write(bytes(_STATE.size))
            shared.flush()
            state = mmap.mmap(shared.fileno(), _STATE.size)
            Tally().store(state)
            span = [str(numbers.start), str(numbers.stop), repr(until), shared.name]
            command = [*COMMAND, kind, "--seed", str(seed), "--work", *span]
            with subprocess.Popen(command, stdout=subprocess.PIPE, env=lean) as process:
                for line in _lines_of(process, state):
                    yield tuple(json.loads(line))
            own = Tally.load(state)
        tally.add(own)
        if own.number == -2:
            return
        yield own.number, f"the process ended with {process.returncode}"
        if own.number < 0:
            return  # it never began
        numbers = range(own.number + 1, numbers.stop)


def _lines_of(process: subprocess.Popen, state: mmap.mmap) -> Iterator[bytes]:
    """The lines that a process writes to its end; one that stands still is ended."""
    rest, last, since = b"", None, time.monotonic()
    with selectors.DefaultSelector() as ready:
        ready.register(process.stdout, selectors.EVENT_READ)
        while True:
            if ready.select(1):
                part = os.read(process.stdout.fileno(), 1 << 16)
                if not part:
                    return
                *lines, rest = (rest + part).split(b"\n")
                yield from lines
            number = Tally.load(state).number
            if number != last or number < 0:  # what has not begun yet may load for long
                last, since = number, time.monotonic()
            elif time.monotonic() - since > STUCK:
                process.kill()


def hunt(kinds: list[str], seed: int, numbers: range, keep: Path | None, seconds: float = float("inf")) -> int:
    """Tries all kinds, tells the counts and every sort of fault, and gives the number of faults."""
    faults = 0
    for kind in kinds:
        begin, seen, tally, some = time.perf_counter(), Counter(), Tally(), {}
        for number, said in results(kind, seed, numbers, time.time() + seconds, tally):
            what = re.sub(r"\d+|/\S+|'[^']*'", "…", said)
            seen[what] += 1
            if seen[what] == 1:
                some[number] = said
                print(f"{kind} --seed {seed} --case {number}: {said[:400]}", flush=True)
        own = sum(seen.values())
        faults += own
        took, files = time.perf_counter() - begin, own + tally.read + tally.refused
        quick = 1e6 * files / max(tally.spent, 1)
        print(
            f"{kind}: {files} files, {tally.refused} refused, {tally.read} read, {tally.verbs} by their verb, "
            f"{own} faults of {len(seen)} sorts, {took:.0f} s, {quick:.0f} a second of the processor, "
            f"slowest {tally.slowest / 1e6:.2f} s (case {tally.slow_case}), peak {tally.peak / 1024:.0f} MB",
            flush=True,
        )
        if keep is not None:
            _keep(kind, seed, numbers if len(numbers) == 1 else some, keep)
    return faults


def _keep(kind: str, seed: int, numbers, folder: Path):
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        files = samples(Path(place))
        contents = {name: file.read_bytes() for name, file in files.items()}
        for number in numbers:
            (folder / f"{seed}-{number}-{files[kind].name}").write_bytes(case(kind, contents, seed, number))


def main(words: list[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.partition("\n")[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"{', '.join(READERS)}; default: all")
    parser.add_argument("--count", type=int, default=100, help="files of each kind (default 100)")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="of each kind, after which it ends")
    parser.add_argument("--seed", type=int, default=0, help="of what is broken (default 0)")
    parser.add_argument("--case", type=int, help="this one only")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="write the files that are faults, or --case, here")
    parser.add_argument("--work", nargs=4, help=argparse.SUPPRESS)
    arguments = parser.parse_args(words)
    unknown = sorted(set(arguments.kinds) - set(READERS))
    if unknown:
        parser.error(f"no kind {unknown[0]}; expected some of {', '.join(READERS)}")
    kinds = arguments.kinds or list(READERS)
    if arguments.work:
        first, last, until, shared = arguments.work
        work(kinds[0], arguments.seed, range(int(first), int(last)), float(until), Path(shared))
        return 0
    numbers = range(arguments.count) if arguments.case is None else range(arguments.case, arguments.case + 1)
    return 1 if hunt(kinds, arguments.seed, numbers, arguments.keep, arguments.seconds) else 0


__all__ = ["READERS", "case", "hunt", "main", "mutated", "results", "samples", "trouble"]
