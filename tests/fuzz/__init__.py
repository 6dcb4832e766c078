# SPDX-License-Identifier: GPL-3.0-or-later
"""Breaks sound files in many ways and reads them: `python -m tests.fuzz [KIND …] --count N --seed S`.

Every reader must give the content or one `InputError` that names the file and says in one sentence what was expected:
within limits of memory and time, without a warning or a file that is left. What was read is written and read again
(every tenth file), or goes through the verb that it is for (every hundredth). A kind is read in a process of its own;
one that dies is told with its case and the rest goes on.
Case I of seed S is always the same file: `python -m tests.fuzz KIND --seed S --case I --keep FOLDER` makes it again.
"""

import argparse
import contextlib
import faulthandler
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from addon import cli
from addon.core.data.errors import InputError

from .kinds import READERS, USES, samples, verb_of
from .wounds import case

try:
    from . import watched
except ImportError:  # Windows has no limits for a process
    watched = None

# Whatever comes is what is looked for.
FAULTS = (Exception, watched.TooSlowError) if watched else Exception
LEAN = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # threads take room by the gigabyte and never use it
LONGEST = 2000  # letters of a sentence that people read
AGAIN_EVERY, VERB_EVERY = 10, 100
STUCK = 60  # s for one file, after which a process that no signal reaches ends itself


def read_within(kind: str, path: Path) -> str:
    """What the reader of a kind says of a file, "read" or its sentence, in a process with the limits of `watched`."""
    command, root = _call(f"tell({kind!r}, {str(path)!r})"), Path(__file__).resolve().parents[2]
    done = subprocess.run(command, cwd=root, env=os.environ | LEAN, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"ended with {done.returncode}: {done.stderr[-1000:]}"
    return done.stdout.strip()


def _call(function: str) -> list[str]:
    """The command that calls a function of this module in a process of its own."""
    return [sys.executable, "-c", f"from tests import fuzz; fuzz.{function}"]


def tell(kind: str, path: str):
    """Prints what the reader of a kind says of a file."""
    watched.limit()
    with watched.in_time():
        try:
            READERS[kind](Path(path))
            print("read")
        except InputError as error:
            print(error)


def answer(read: Callable[[], object]) -> tuple[str | None, object]:
    """What is wrong with how a file is read, and what was read of it.

    Nothing is wrong where it is None, and nothing with a file that is refused in a sentence where it is "refused".
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return None, read()
    except InputError as error:
        return _sentence(error), None
    except MemoryError:
        return f"takes over {watched.MEMORY_MB if watched else ''} MB", None
    except FAULTS as error:
        places = [f"{at.f_code.co_filename}:{line}" for at, line in traceback.walk_tb(error.__traceback__)]
        ours = [one for one in places if f"{os.sep}addon{os.sep}" in one]
        return f"{type(error).__name__}: {error} at {ours[-1] if ours else '?'}", None


def _sentence(error: InputError) -> str:
    said = error.message
    if not error.file:
        return f"names no file: {error}"
    if "; expected" not in said or len(said.splitlines()) != 1 or not said.isprintable():
        return f"is no sentence of what is wrong; expected …: {said[:300]!r}"
    return "refused" if len(said) <= LONGEST else f"says {len(said)} letters: {said[:100]!r}"


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
        tempfile.tempdir = os.environ["TMPDIR"] = str(folder / "tmp")
        self.path.write_bytes(self.contents[kind])
        self.beside = set((folder / "case").iterdir())
        READERS[kind](self.path)  # loads what is loaded late

    def attempt(self, content: bytes, again: bool = True, verb: bool = False) -> str | None:
        """What is wrong with how the reader takes this content, or what is done then; see `answer`."""
        self.path.write_bytes(content)
        seen, sys.unraisablehook = [], lambda lost: seen.append(f"cannot be raised: {lost.exc_value!r}"[:300])
        try:
            with watched.in_time():
                said = self._read(again, verb)
        except watched.TooSlowError as error:  # between two of its parts
            said = str(error)
        left = [one.name for one in (self.folder / "tmp").iterdir()]
        if left:
            seen.append(f"leaves {left[:3]} among temporary files")
        beside = {*(self.folder / "case").iterdir()} - self.beside
        if beside:
            seen.append(f"leaves something beside {self.path.name}")
        for one in (*(self.folder / "tmp").iterdir(), *(self.folder / "out").iterdir(), *beside):
            shutil.rmtree(one) if one.is_dir() else one.unlink()
        return seen[0] if seen else said

    def _read(self, again: bool, verb: bool) -> str | None:
        said, value = answer(lambda: READERS[self.kind](self.path))
        if said is None and again and self.kind in USES:
            said, _ = answer(lambda: USES[self.kind](value, self.folder / "out"))
            said = f"once read, it is {said}" if said else None
        if verb and said in (None, "refused"):
            said = self._verb() or said
        return said

    def _verb(self) -> str | None:
        """Nothing, or what the command line says that is no one sentence."""
        words = verb_of(self.kind, self.path, self.files, self.folder / "out")
        if not words:
            return None
        out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2))
        kinds = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        before = [signal.getsignal(one) for one in kinds]
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            warnings.simplefilter("error")
            status = cli.main(words)
        for one, handler in zip(kinds, before, strict=True):
            signal.signal(one, handler)
        lines = err.buffer.getvalue().decode("utf-8", "replace").splitlines()
        fault = any("a fault of Mocap Autolabel" in line or "the memory is full" in line for line in lines)
        if fault or (status and (len(lines) != 1 or "; expected" not in lines[0])):
            return f"verb: status {status}, and says {lines!r}"[:500]
        return None


def work(kind: str, seed: int, numbers: range):
    """Reads all those cases in this process and tells what became of each as a line, between a first and a last."""
    with tempfile.TemporaryDirectory(dir=watched.quick_folder()) as folder:
        bench = Bench(kind, Path(folder))
        watched.limit()
        print("[]", flush=True)
        for number in numbers:
            faulthandler.dump_traceback_later(STUCK, exit=True)
            content, verb = case(kind, bench.contents, seed, number), number % VERB_EVERY == VERB_EVERY - 1
            print(json.dumps([number, bench.attempt(content, number % AGAIN_EVERY == 0, verb)]), flush=True)
        print("null", flush=True)


def results(kind: str, seed: int, numbers: range) -> Iterator[tuple[int, str | None]]:
    """What became of each case, out of processes that may die."""
    begun = True
    while numbers and begun:
        command = _call(f"work({kind!r}, {seed}, {numbers})")
        begun, number = False, numbers.start - 1
        with subprocess.Popen(command, stdout=subprocess.PIPE, env=os.environ | LEAN) as process:
            for told in map(json.loads, process.stdout):
                if told is None:
                    return
                begun = True
                if told:
                    number, said = told
                    yield number, said
        yield number + 1, f"the process ended with {process.returncode}"
        numbers = range(number + 2, numbers.stop)


def hunt(kinds: list[str], seed: int, numbers: range, keep: Path | None) -> int:
    """Tries all kinds, tells the counts and every sort of fault, and gives the number of faults."""
    faults = 0
    for kind in kinds:
        begin, counts, some = time.perf_counter(), Counter(), {}
        for number, said in results(kind, seed, numbers):
            counts[said if said in (None, "refused") else "fault"] += 1
            sort = re.sub(r"\d+|/\S+|'[^']*'", "…", said or "refused")
            if said not in (None, "refused") and sort not in some:
                some[sort] = number
                print(f"{kind} --seed {seed} --case {number}: {said[:400]}", flush=True)
        faults += counts["fault"]
        print(
            f"{kind}: {counts.total()} files, {counts['refused']} refused, {counts[None]} read, "
            f"{counts['fault']} faults of {len(some)} sorts, {time.perf_counter() - begin:.0f} s",
            flush=True,
        )
        if keep is not None:
            _keep(kind, seed, numbers if len(numbers) == 1 else some.values(), keep)
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
    parser.add_argument("--seed", type=int, default=0, help="of what is broken (default 0)")
    parser.add_argument("--case", type=int, help="this one only")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="write the files that are faults, or --case, here")
    arguments = parser.parse_args(words)
    unknown = sorted(set(arguments.kinds) - set(READERS))
    if unknown:
        parser.error(f"no kind {unknown[0]}; expected some of {', '.join(READERS)}")
    kinds = arguments.kinds or list(READERS)
    numbers = range(arguments.count) if arguments.case is None else range(arguments.case, arguments.case + 1)
    return 1 if hunt(kinds, arguments.seed, numbers, arguments.keep) else 0
