# SPDX-License-Identifier: GPL-3.0-or-later
"""Disturbs batches of the command line hundreds of times: `python -m tests.faults [KIND …] --count N --seed S`.

Kinds: `kill` (signal 9 at any moment), `full` (a disk without room), `unwritable` (a folder that cannot be written),
`two` (batches into one folder), `share` (takes or results that go away and come back). After each fault every file must
be whole or absent and every sentence one; the next run must keep what was done, do the rest as if nothing had been, and
leave nothing else. Case I of seed S is always the same: `python -m tests.faults KIND --seed S --case I`.
Disks are mounted in a mount namespace of this process's own, so none is left and nobody else sees one.
"""

import argparse
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from random import Random

from addon.io.whole import LIST, PART, TURN

from .stage import ROOT, SUMMARIES, TABLE, TAKES, Run, Said, Stage, content, files_of, wait_for_a_moment

SENTENCE = re.compile(r"mocap-autolabel: .+; expected .+")
HALF, LOST, LEFT, UNTOLD, WORDS = "half files", "lost takes", "left-overs", "claims", "sentences that are none"
INSIDE = "--inside"  # the word that tells the command that it has its own mounts


class Judge:
    """Looks at the folder of a batch's results and at what it said; `trouble` is what is wrong, by its kind."""

    def __init__(self, takes: Sequence[str], made: dict[str, object]):
        self.takes, self.made, self.trouble = tuple(takes), made, []

    def words(self, said: Said, failing: bool = False):
        """What a batch said that ended by itself: one sentence for each take that failed, and no other word."""
        odd = [line for line in said.lines if not SENTENCE.fullmatch(line) or "fault of Mocap" in line]
        self.trouble += [(WORDS, f"no sentence: {line}") for line in odd]
        if bool(said.status) != bool(said.lines) or (failing and not said.status) or len(said.lines) > len(TAKES) + 1:
            self.trouble.append((WORDS, f"status {said.status} with {len(said.lines)} lines: {said.lines[-1:]}"))

    def claims(self, said: Said, *outs: Path):
        """Takes that a batch says are done must be so, in one of the folders."""
        lost = [take for take in said.done if not any(self.finished(take, out) for out in outs)]
        self.trouble += [(UNTOLD, f"{take} is said to be done, and is not") for take in lost]

    def whole(self, out: Path):
        """Every file that is there must be whole."""
        for path in out.iterdir() if out.is_dir() else ():
            if path.name.startswith((PART, TURN)):  # of which the next run takes care
                continue
            if path.name not in self.names:
                self.trouble.append((LEFT, f"{path.name} is there"))
            elif not self._is(path, path.name in SUMMARIES):
                self.trouble.append((HALF, f"{path.name} of {path.stat().st_size} bytes"))

    @property
    def names(self) -> set[str]:
        return files_of(self.takes) | SUMMARIES

    def finished(self, take: str, out: Path) -> bool:
        """Whether all files of a take are there as they are to be."""
        return all(self._is(out / name) for name in files_of([take]))

    def _is(self, path: Path, any_content: bool = False) -> bool:
        try:
            return content(path) == self.made[path.name] or any_content
        except Exception:  # noqa: BLE001 whatever it is, the file is not whole
            return False

    def stamps(self, out: Path) -> dict[str, set[tuple]]:
        """What tells the files of finished takes from any others, by their takes."""
        done = [take for take in self.takes if self.finished(take, out)]
        each = {take: [(out / name).stat() for name in sorted(files_of([take]))] for take in done}
        return {take: [(one.st_ino, one.st_mtime_ns, one.st_size) for one in files] for take, files in each.items()}

    def kept(self, out: Path, before: dict[str, set[tuple]], same: bool = True):
        """Finished takes of before must still be so, and with `same` be the very files."""
        now = self.stamps(out)
        for take, files in before.items():
            if take not in now or (same and now[take] != files):
                self.trouble.append((LOST, f"{take} was finished, and is {'made again' if take in now else 'not'}"))

    def end(self, said: Said, out: Path, temporary: Path):
        """After the run that goes on with it: all is there, as an undisturbed batch makes it, and nothing else."""
        if said.status or said.lines:
            self.trouble.append((LOST, f"cannot be gone on with: {' / '.join(said.lines)}"))
        lost = [take for take in self.takes if not self.finished(take, out)]
        self.trouble += [(LOST, f"in the end {take} is not as it should be") for take in lost]
        rows = {take: row for take, row in self.made[TABLE].items() if take in self.takes}
        if not Judge((), {TABLE: rows})._is(out / TABLE):
            self.trouble.append((LOST, "in the end the table is another"))
        self.left(out, temporary)

    def left(self, out: Path, temporary: Path):
        """Nothing but results may lie there."""
        here, there = ({one.name for one in place.iterdir()} if place.is_dir() else set() for place in (out, temporary))
        self.trouble += [(LEFT, name) for name in sorted((here - self.names) | there)]


class Try:
    """One try: a batch is begun, disturbed at some moment, and gone on with."""

    def __init__(self, stage: Stage, folder: Path, chance: Random, mounts: bool):
        self.stage, self.folder, self.chance, self.mounts = stage, folder, chance, mounts
        self.temporary, self.out, self.inputs = folder / "temporary", folder / "out", stage.inputs
        self.judge = Judge(chance.sample(list(TAKES), chance.choice([2, 3, 4])), stage.made)
        self.at_work = True  # whether the fault met a batch at work

    def begin(self, *more: str, takes: Sequence[str] = (), **process) -> Run:
        jobs = self.chance.choice([1, 2])
        words = self.stage.words(takes or self.judge.takes, self.out, *more, jobs=jobs, inputs=self.inputs)
        return self.stage.start(words, self.temporary, **process)

    def wait(self, run: Run):
        self.at_work &= wait_for_a_moment(self.chance, self.stage.seconds, run, self.out)

    def go_on(self):
        """The next run, when all is well again: it must do all that is left and keep all that is done."""
        before = self.judge.stamps(self.out)
        # What somebody was killed at while it replaced files of another that are as good is finished now.
        begun = any(self.out.glob(f"{PART}*/{LIST}"))
        said = self.begin("--resume").said()
        self.judge.kept(self.out, before, same=not begun)
        self.judge.end(said, self.out, self.temporary)

    def kill(self):
        """Signal 9 to a batch, its first process or one of the others, once or several times."""
        for number in range(self.chance.choice([1, 1, 2, 3])):
            before = self.judge.stamps(self.out)
            run = self.begin(*(["--resume"] if number else []))
            self.wait(run)
            run.kill(self.chance.choice(["all", "first", "one"]))
            said = run.said()
            self.judge.whole(self.out)
            self.judge.kept(self.out, before)
            if said.status >= 0:
                self.judge.words(said)
                self.judge.claims(said, self.out)

    def full(self):
        """A disk without room, of bytes or of files, for results, temporary files or both; or files too large."""
        way = self.chance.choice(["results", "temporary", "both"] if self.mounts else ["large files"])
        need = sum(self.stage.bytes[name] for name in self.judge.names)
        size = int(self.chance.uniform(0.02, 1.1) * (need if way != "temporary" else 24_000))
        limited, disk = {}, self.folder / "disk"
        if way == "large files":
            size //= len(self.judge.takes)
            limited = {"preexec_fn": partial(resource.setrlimit, resource.RLIMIT_FSIZE, (size, size))}
        else:
            files = self.chance.choice([100_000, self.chance.randint(3, 40)])
            mount("-t", "tmpfs", "-o", f"size={max(size // 4096, 1) * 4096},nr_inodes={files}", "tmpfs", disk)
            self.out = self.out if way == "temporary" else disk / "out"
            self.temporary = self.temporary if way == "results" else disk / "temporary"
        with suppress(OSError):
            self.temporary.mkdir(exist_ok=True)
        said = self.begin(**limited).said()
        self.at_work = said.status != 0
        self.judge.words(said)
        self.judge.claims(said, self.out)
        self.judge.whole(self.out)
        self.judge.left(self.out, self.temporary)
        if not limited:
            mount("-o", "remount,size=64m,nr_inodes=100000", disk)

    def unwritable(self):
        """A folder that cannot be written, because it is a file, or on a disk that is read only, or from now on."""
        way = self.chance.choice(["at first", "meanwhile"] if self.mounts else ["a file"])
        disk, before = self.folder / "disk", {}
        if way == "a file":
            self.out.write_text("here")
        else:
            mount("-t", "tmpfs", "tmpfs", disk)
            self.out = disk / "out"
            self.out.mkdir()
        if way == "at first":
            mount("-o", "remount,ro", disk)
        run = self.begin()
        if way == "meanwhile":
            self.wait(run)
            while not run.ended and not mount("-o", "remount,ro", disk):  # somebody writes just now
                pass
            before = self.judge.stamps(self.out)
        said = run.said()
        self.judge.words(said, failing=way != "meanwhile")
        if way == "a file":
            self.out.unlink()
            return
        self.judge.claims(said, self.out)
        self.judge.whole(self.out)
        self.judge.kept(self.out, before)
        mount("-o", "remount,rw", disk)

    def two(self):
        """Two batches into one folder, of the same takes or of some that are the same, killed or not."""
        mine, others = self.judge.takes, self.chance.sample(list(TAKES), 2)
        self.judge = Judge(dict.fromkeys((*mine, *others)), self.stage.made)
        ways = [self.chance.choice([(), (), ("--overwrite",), ("--resume",)]) for _ in range(2)]
        killed = self.chance.choice([(), (), (0,), (1,), (0, 1)])
        runs = [self.begin(*ways[0], takes=mine)]
        time.sleep(self.chance.choice([0.0, self.chance.uniform(0, 1) * self.stage.seconds]))
        runs.append(self.begin(*ways[1], takes=others))
        for number in killed:
            self.wait(runs[number])
            runs[number].kill("first")  # the processes of both have one folder for temporary files
        for number, run in enumerate(runs):
            said = run.said()
            self.judge.whole(self.out)
            if number not in killed:
                self.judge.words(said)
            if not killed:
                self.judge.claims(said, self.out)

    def share(self):
        """A share with takes, or with results, that goes away, and comes back during the batch or after it."""
        there, away, between = (self.folder / name for name in ("share", "away", "between"))
        there.mkdir()
        if self.chance.random() < 0.5:
            self.inputs = there / "takes"
            shutil.copytree(self.stage.inputs, self.inputs)
        else:
            self.out = there / "out"
        run = self.begin()
        self.wait(run)
        before = self.judge.stamps(self.out)
        there.rename(away)
        if self.chance.random() < 0.5:
            there.mkdir()
        if self.chance.random() < 0.5:
            time.sleep(self.chance.uniform(0, 0.5) * self.stage.seconds)
            come_back(there, away, between)
        said = run.said()
        come_back(there, away, between)
        self.judge.words(said)
        self.judge.claims(said, self.out, between / "out")
        self.judge.whole(self.out)
        self.judge.kept(self.out, before)


KINDS = {"kill": Try.kill, "full": Try.full, "unwritable": Try.unwritable, "two": Try.two, "share": Try.share}


def come_back(there: Path, away: Path, between: Path):
    """Calls a folder as before, and what was made in its place meanwhile otherwise."""
    while away.exists():
        with suppress(FileNotFoundError):
            there.rename(between)
        try:
            away.rename(there)
        except OSError:  # a batch made another just then
            shutil.rmtree(between, ignore_errors=True)


def mount(*words: object) -> bool:
    """Whether a mount could be made or changed."""
    Path(words[-1]).mkdir(exist_ok=True)
    return not subprocess.run(["mount", *map(str, words)], capture_output=True, check=False).returncode


def own_mounts() -> list[str] | None:
    """The words that start a command in a mount namespace of its own; None where this system has none for its user."""
    for words in (["unshare", "--mount"], ["unshare", "--user", "--map-root-user", "--mount"]):
        with suppress(OSError):
            if not subprocess.run([*words, "true"], capture_output=True, check=False).returncode:
                return words
    return None


def hunt(kinds: list[str], stage: Stage, mounts: bool, seed: int, numbers: range) -> int:
    """Tries all kinds, tells the counts and everything found, and gives how many tries found something."""
    bad = 0
    for kind in kinds:
        begin, counts, at_work = time.perf_counter(), Counter(), 0
        for number in numbers:
            folder = stage.folder / f"{kind}-{number}"
            folder.mkdir()
            one = Try(stage, folder, Random(f"{kind} {seed} {number}"), mounts)
            try:
                KINDS[kind](one)
                one.go_on()
            except Exception as error:  # noqa: BLE001 a try that goes wrong is told, and the others are made
                one.judge.trouble.append((WORDS, f"{type(error).__name__}: {error}"))
            subprocess.run(["umount", "--lazy", folder / "disk"], capture_output=True, check=False)
            shutil.rmtree(folder, ignore_errors=True)
            at_work += one.at_work
            bad += bool(one.judge.trouble)
            counts.update(sort for sort, _ in one.judge.trouble)
            for sort, words in one.judge.trouble:
                print(f"{kind} --seed {seed} --case {number}: {sort}: {words}", flush=True)
        found = ", ".join(f"{counts[sort]} {sort}" for sort in (HALF, LOST, LEFT, UNTOLD, WORDS))
        took = time.perf_counter() - begin
        print(f"{kind}: {len(numbers)} tries, {at_work} at work; {found}; {took:.0f} s", flush=True)
    return bad


def main(words: list[str]) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__.partition("\n")[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"{', '.join(KINDS)}; default: all")
    parser.add_argument("--count", type=int, default=200, help="tries of each kind (default 200)")
    parser.add_argument("--seed", type=int, default=0, help="of what happens when (default 0)")
    parser.add_argument("--case", type=int, help="this one only")
    parser.add_argument(INSIDE, action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args(words)
    unknown = sorted(set(arguments.kinds) - set(KINDS))
    if unknown:
        parser.error(f"no kind {unknown[0]}; expected some of {', '.join(KINDS)}")
    if not Path("/proc/self/environ").exists():
        parser.error("this system has no /proc to find processes by; expected Linux")
    outside = None if arguments.inside else own_mounts()
    if outside is not None:
        os.chdir(ROOT)
        os.execvp(outside[0], [*outside, sys.executable, "-m", "tests.faults", INSIDE, *words])
    numbers = range(arguments.count) if arguments.case is None else range(arguments.case, arguments.case + 1)
    with tempfile.TemporaryDirectory(prefix="mocap-faults-", ignore_cleanup_errors=True) as folder:
        # Outside of a namespace what it mounts would be left on the machine.
        mounts = arguments.inside and mount("-t", "tmpfs", "tmpfs", Path(folder) / "possible")
        kinds = arguments.kinds or list(KINDS)
        return 1 if hunt(kinds, Stage(Path(folder) / "stage"), mounts, arguments.seed, numbers) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
