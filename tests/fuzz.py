# SPDX-License-Identifier: GPL-3.0-or-later
"""Breaks sound files in thousands of ways and reads them: `python -m tests.fuzz [KIND …] --count N --seed S`.

Every reader must give the content or one `InputError` that names the file and says what was expected, within limits of
memory and time. A kind is read in a process of its own; one that dies is told with its case and the rest goes on.
Case I of seed S is always the same file: `python -m tests.fuzz KIND --seed S --case I --keep FOLDER` makes it again.
"""

import argparse
import json
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from addon.core.data.errors import InputError
from addon.core.edits.kinds import Edits, Place, Swap
from addon.io.blobs import read_blobs
from addon.io.cameras import read_cameras
from addon.io.edits import read_edits, write_edits
from addon.io.labels import LabelFile
from addon.io.markersets import read_markerset, write_markerset
from addon.io.models import read_model, write_model
from addon.io.points import read_points
from tests.core.toybody import toy_markerset
from tests.io.samples import ring, toy_model, write_all

MEMORY_MB, SECONDS = 1024, 5  # that reading one file may take
PATIENCE = 6  # times as long, on the wall's clock
COMMAND = [sys.executable, "-m", "tests.fuzz"]

TOKENS = [
    b"nan", b"inf", b"-1e999", b"1e308", b"0", b"-1", b"999999999999", b"", b",", b"\n", b'"', b"'", b"\0", b"\xff\xfe",
    b"[", b"]", b"{", b"}", b"<", b">", b"/>", b":", b"- ", b"  ", b"\t", b"\r", b"\xe2\x82\xac", b"true", b"null",
    b"65536", b"\x7f", b"_", b"1_0", b"1e400", b"&amp;", b"!!opencv-matrix", b"#", b"%", b"=", b"\\ud800", b"\\u0000",
    b"\xe2\x80\xa8", b"4294967296", b"1e-320", b"-0", b"\xd9\xa3",
]  # fmt: skip
VALUES = [None, True, -1, 0, 1e308, -1e-308, 10**30, float("nan"), float("inf"), "", "x", "a\ud800", "a\0", [], {}]
WORDS = [0, 1, 2, 0x7F, 0x80, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFE, 0xFFFF]
LETTERS = 20_000_000  # that a part may have that is there many times


def _times(letters: int, chance: random.Random) -> int:
    """How many more times a part of that many letters is there."""
    return chance.choice([1, 1, 3, 20_000]) if letters * 20_000 < LETTERS else 1


def _blobs(path: Path):
    return sum(len(rows.blobs) for rows in read_blobs(path, ring()))


def _labels(path: Path):
    with LabelFile(path) as file:
        return sum(1 for _ in file.rows())


def _truth(path: Path):
    with LabelFile(path, "truth") as file:
        return sum(1 for _ in file.rows())


def _take(path: Path):
    read_points(path, everything=True)
    return read_points(path)


READERS: dict[str, Callable[[Path], object]] = {
    "toml": read_cameras, "xcp": read_cameras, "qca": read_cameras, "mcal": read_cameras, "yml": read_cameras,
    "pmat": read_cameras, "rad": read_cameras, "res": lambda path: read_cameras(path.parent), "blobs": _blobs,
    "labels": _labels, "truth": _truth, "c3d": _take, "dec": _take, "mips": _take, "trc": _take, "motive": _take,
    "markerset": read_markerset, "model": read_model, "edits": read_edits,
}  # fmt: skip


def samples(folder: Path) -> dict[str, Path]:
    """A sound file of every kind."""
    files = write_all(folder)
    files["truth"] = folder / "take.csv.truth.csv"
    files["truth"].write_text('frame,point,marker\n1,0,LASI\n1,3,"LASI|RASI"\n2,0,\n')
    files["markerset"], files["model"] = folder / "toy.markerset.json", folder / "model.markerset.json"
    write_markerset(files["markerset"], toy_markerset())
    write_model(files["model"], toy_model())
    files["edits"] = folder / "take.edits.json"
    write_edits(files["edits"], Edits((Swap(("LKNE", "RKNE"), frames=(1, 9)), Place("C7", 3, (0.1, 0.2, 1.4)))))
    return files


def mutated(content: bytes, chance: random.Random) -> bytes:
    """`content` with one to four wounds: cuts, changed bits, doubled parts, tokens that readers stumble over."""
    changed = bytearray(content)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(changed) + 1)
        kind = chance.randrange(7)
        if kind == 0:
            del changed[at:]
        elif kind == 1 and changed:
            changed[at % len(changed)] = chance.randrange(256)
        elif kind == 2:
            changed[at:at] = chance.choice(TOKENS)
        elif kind == 3:
            changed[at : at + chance.randint(1, 12)] = chance.choice(TOKENS)
        elif kind == 4:
            del changed[at : at + chance.randint(1, 40)]
        elif kind == 5:
            other = chance.randrange(len(changed) + 1)
            changed[at:at] = changed[other : other + chance.randint(1, 60)]
        else:
            lines = bytes(changed).split(b"\n")
            moved = lines.pop(chance.randrange(len(lines))) if len(lines) > 1 else b""
            lines.insert(chance.randrange(len(lines)), moved)
            changed = bytearray(b"\n".join(lines))
    return bytes(changed)


def rebuilt(kind: str, content: bytes, chance: random.Random) -> bytes:
    """`content` with one to three changes of its structure: values, fields, rows, elements or words of a header."""
    for _ in range(chance.randint(1, 3)):
        if kind in ("markerset", "model", "edits"):
            content = _other_json(content, chance)
        elif kind in ("c3d", "dec", "mips"):
            content = _other_words(content, chance)
        else:
            content = _other_fields(content, chance)
    return content


def _other_json(content: bytes, chance: random.Random) -> bytes:
    document = json.loads(content)
    holder, key = None, None
    node = document
    for _ in range(chance.randint(1, 6)):
        if not isinstance(node, (dict, list)) or not node:
            break
        holder, key = node, chance.choice(list(node) if isinstance(node, dict) else range(len(node)))
        node = holder[key]
    way = chance.randrange(4)
    if holder is None:
        document = chance.choice(VALUES)
    elif way == 0:
        del holder[key]
    elif way == 1 and isinstance(holder, list):
        holder[key:key] = [node] * _times(len(json.dumps(node)), chance)
    elif way == 2 and isinstance(holder, dict):
        holder[chance.choice(list(holder))] = node
    else:
        holder[key] = chance.choice(VALUES)
    return json.dumps(document).encode()


def _other_words(content: bytes, chance: random.Random) -> bytes:
    """A C3D file with another word in its header or its parameters."""
    changed = bytearray(content)
    at = 2 * chance.randrange(min(20 if chance.random() < 0.4 else 1024, len(changed) // 2 - 1))
    if chance.random() < 0.5:
        changed[at : at + 2] = chance.choice(WORDS).to_bytes(2, chance.choice(["little", "big"]))
    else:
        changed[at + chance.randrange(2)] = chance.choice(WORDS) & 0xFF
    return bytes(changed)


def _other_fields(content: bytes, chance: random.Random) -> bytes:
    """A text with another word, or with a part between separators gone, doubled or there many times."""
    wide = content[:2] == b"\xff\xfe"
    text = content.decode("utf-16" if wide else "latin-1", "replace")
    separator = chance.choice(["\n", "\n", ",", "\t", " ", ">", "]", '"', "="])
    parts = text.split(separator)
    at = chance.randrange(len(parts))
    way = chance.randrange(5)
    if way == 0:
        del parts[at]
    elif way == 1:
        parts[at:at] = [parts[at]] * _times(len(parts[at]), chance)
    elif way == 2:
        other = chance.randrange(len(parts))
        parts[at], parts[other] = parts[other], parts[at]
    else:
        words = list(re.finditer(r"[\w.+-]+", parts[at]))
        if words:
            word, token = chance.choice(words), chance.choice(TOKENS).decode("utf-8", "replace")
            parts[at] = parts[at][: word.start()] + token + parts[at][word.end() :]
    text = separator.join(parts)
    return text.encode("utf-16") if wide else text.encode("latin-1", "replace")


def case(kind: str, content: bytes, seed: int, number: int) -> bytes:
    """The broken file of that number."""
    chance = random.Random(f"{kind} {seed} {number}")
    return mutated(content, chance) if chance.random() < 0.5 else rebuilt(kind, content, chance)


def trouble(reader: Callable[[Path], object], path: Path) -> str | None:
    """What is wrong with how a file is read; None where it is right, and "refused" where it is right to refuse it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            reader(path)
    except InputError as error:
        if not error.file:
            return f"names no file: {error}"
        if "; expected" not in error.message or "\n" in error.message:
            return f"is no sentence of what is wrong; expected …: {error}"
        return "refused"
    except MemoryError:
        return f"takes over {MEMORY_MB} MB"
    except Exception as error:  # noqa: BLE001 whatever comes is what is looked for
        return f"{type(error).__name__}: {error}"
    return None


def work(kind: str, seed: int, numbers: range):
    """Reads all those cases in this process, and tells each as a line `NUMBER WHAT`; before each, its number."""
    import resource

    for late in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(late, _too_slow)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_MB << 20, MEMORY_MB << 20))
    with tempfile.TemporaryDirectory() as folder:
        path = samples(Path(folder))[kind]
        content = path.read_bytes()
        READERS[kind](path)
        for number in numbers:
            print(number, end=" ", flush=True)
            path.write_bytes(case(kind, content, seed, number))
            # Of the processor's time, because others may work on this machine; what waits for ever uses none.
            signal.setitimer(signal.ITIMER_PROF, SECONDS)
            signal.setitimer(signal.ITIMER_REAL, PATIENCE * SECONDS)
            found = trouble(READERS[kind], path)
            for timer in (signal.ITIMER_PROF, signal.ITIMER_REAL):
                signal.setitimer(timer, 0)
            print(json.dumps(found), flush=True)


def _too_slow(*_):
    raise TimeoutError(f"takes over {SECONDS} s")


def results(kind: str, seed: int, numbers: range) -> Iterator[tuple[int, str | None]]:
    """Each case and what `trouble` says of it, out of processes that may die."""
    lean = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    while numbers:
        command = [*COMMAND, kind, "--seed", str(seed), "--work", str(numbers.start), str(numbers.stop)]
        done = 0
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=lean) as process:
            for line in process.stdout:
                number, _, said = line.partition(" ")
                if not said.endswith("\n"):
                    break
                done += 1
                yield int(number), json.loads(said)
        numbers = numbers[done:]
        if numbers:
            yield numbers.start, f"the process ended with {process.returncode}"
            numbers = numbers[1:]


def hunt(kinds: list[str], seed: int, numbers: range, keep: Path | None) -> int:
    """Tries all kinds, tells the counts and every fault, and gives the number of faults."""
    faults = 0
    for kind in kinds:
        begin, counts, seen = time.perf_counter(), Counter(), Counter()
        for number, said in results(kind, seed, numbers):
            counts[said or "read"] += said in (None, "refused")
            if said in (None, "refused"):
                continue
            counts["fault"] += 1
            what = re.sub(r"\d+|/\S+", "…", said)
            seen[what] += 1
            if seen[what] == 1:
                print(f"{kind} --seed {seed} --case {number}: {said[:300]}", flush=True)
        faults += counts["fault"]
        print(
            f"{kind}: {len(numbers)} files, {counts['refused']} refused, {counts['read']} read, "
            f"{counts['fault']} faults, {time.perf_counter() - begin:.0f} s",
            flush=True,
        )
    if keep is not None:
        _keep(kinds, seed, numbers, keep)
    return faults


def _keep(kinds: list[str], seed: int, numbers: range, folder: Path):
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        files = samples(Path(place))
        for kind in kinds:
            content = files[kind].read_bytes()
            for number in numbers:
                (folder / f"{seed}-{number}-{files[kind].name}").write_bytes(case(kind, content, seed, number))


def main(words: list[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.partition("\n")[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"{', '.join(READERS)}; default: all")
    parser.add_argument("--count", type=int, default=100, help="files of each kind (default 100)")
    parser.add_argument("--seed", type=int, default=0, help="of what is broken (default 0)")
    parser.add_argument("--case", type=int, help="this one only")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="write the broken files here")
    parser.add_argument("--work", type=int, nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args(words)
    unknown = sorted(set(arguments.kinds) - set(READERS))
    if unknown:
        parser.error(f"no kind {unknown[0]}; expected some of {', '.join(READERS)}")
    kinds = arguments.kinds or list(READERS)
    if arguments.work:
        work(kinds[0], arguments.seed, range(*arguments.work))
        return 0
    numbers = range(arguments.count) if arguments.case is None else range(arguments.case, arguments.case + 1)
    return 1 if hunt(kinds, arguments.seed, numbers, arguments.keep) else 0


if __name__ == "__main__":
    sys.exit(main())
