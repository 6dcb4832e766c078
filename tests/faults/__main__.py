# SPDX-License-Identifier: GPL-3.0-or-later
"""Disturbs batches of the command line hundreds of times: `python -m tests.faults [KIND …] --count N --seed S`.

Kinds: `kill` (signal 9 at any moment), `full` (a disk without room), `unwritable` (a folder that cannot be written),
`two` (batches into one folder), `share` (takes or results that go away and come back). After each fault every file must
be whole or absent and every sentence one; the next run must keep what was done, do the rest as if nothing had been, and
leave nothing else. Case I of seed S is always the same: `python -m tests.faults KIND --seed S --case I`.
"""

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from random import Random

from .judging import KINDS_OF_TROUBLE, WORDS, Finding
from .places import own_mounts, possible
from .stage import ROOT, Stage
from .tries import TRIES, Try

INSIDE = "--inside"  # the word that tells the command that it has its own mounts


def attempt(kind: str, stage: Stage, can: dict[str, bool], seed: int, number: int) -> Finding:
    """Tries a kind once."""
    finding = Finding()
    folder = stage.folder / f"{kind}-{number}"
    folder.mkdir()
    folder.chmod(0o755)
    try:
        TRIES[kind](Try(stage, folder, Random(f"{kind} {seed} {number}"), can, finding))
    except Exception as error:  # noqa: BLE001 a try that goes wrong is told, and the others are made
        finding.add(WORDS, f"{type(error).__name__}: {error}")
    shutil.rmtree(folder, ignore_errors=True)
    return finding


def hunt(kinds: list[str], stage: Stage, can: dict[str, bool], seed: int, numbers: range, details: bool) -> int:
    """Tries all kinds, tells the counts and everything found, and gives how many tries found something."""
    bad = 0
    for name, there in can.items():
        if not there:
            print(f"without {name}, which this system does not have for its user", flush=True)
    for kind in kinds:
        begin, counts, said, reached, wrong = time.perf_counter(), Counter(), Counter(), 0, 0
        for number in numbers:
            finding = attempt(kind, stage, can, seed, number)
            reached += finding.reached
            said += finding.said
            wrong += bool(finding.trouble)
            counts.update(one for one, _ in finding.trouble)
            for one, words in finding.trouble:
                print(f"{kind} --seed {seed} --case {number}: {one}: {words}\n  ({finding.about})", flush=True)
            if details:
                print(f"{kind} {number}: {finding.about}; {dict(finding.said)}", flush=True)
        bad += wrong
        found = ", ".join(f"{counts[one]} {one}" for one in KINDS_OF_TROUBLE)
        print(
            f"{kind}: {len(numbers)} tries, {reached} at work; {found}; {sum(said.values())} sentences; "
            f"{time.perf_counter() - begin:.0f} s"
        )
        for words, count in said.most_common():
            print(f"  {count} x {words}", flush=True)
    return bad


def main(words: list[str] | None = None) -> int:
    """The command."""
    words = sys.argv[1:] if words is None else words
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__.partition("\n")[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"{', '.join(TRIES)}; default: all")
    parser.add_argument("--count", type=int, default=200, help="tries of each kind (default 200)")
    parser.add_argument("--seed", type=int, default=0, help="of what happens when (default 0)")
    parser.add_argument("--case", type=int, help="this one only")
    parser.add_argument("--details", action="store_true", help="tell every try")
    parser.add_argument("--quick", action="store_true", help="batches of points alone, as the tests do")
    parser.add_argument(INSIDE, action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args(words)
    unknown = sorted(set(arguments.kinds) - set(TRIES))
    if unknown:
        parser.error(f"no kind {unknown[0]}; expected some of {', '.join(TRIES)}")
    if not Path("/proc/self/environ").exists():
        parser.error("this system has no /proc to find processes by; expected Linux")
    outside = None if arguments.inside else own_mounts()
    if outside is not None:
        os.chdir(ROOT)
        os.execvp(outside[0], [*outside, sys.executable, "-m", "tests.faults", INSIDE, *words])
    numbers = range(arguments.count) if arguments.case is None else range(arguments.case, arguments.case + 1)
    with tempfile.TemporaryDirectory(prefix="mocap-faults-", ignore_cleanup_errors=True) as folder:
        Path(folder).chmod(0o755)
        can = possible(Path(folder) / "possible")
        if not arguments.inside:  # what it mounts would be left on the machine
            can["mounts"] = False
        stage = Stage(Path(folder) / "stage", arguments.quick)
        kinds = arguments.kinds or list(TRIES)
        return 1 if hunt(kinds, stage, can, arguments.seed, numbers, arguments.details) else 0


if __name__ == "__main__":
    sys.exit(main())
