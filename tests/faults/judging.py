# SPDX-License-Identifier: GPL-3.0-or-later
"""What is wrong after a fault: half files, finished takes that are lost, left-overs, words that are no sentence."""

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from addon.io.whole import PART, TURN

from .stage import PAGE, TABLE, Plan, Said, Stage, content, read_whole

SENTENCE = re.compile(r"mocap-autolabel: .+; expected .+")
HALF, LOST, LEFT, UNTOLD, WORDS = "half files", "lost takes", "left-overs", "claims", "sentences that are none"
KINDS_OF_TROUBLE = (HALF, LOST, LEFT, UNTOLD, WORDS)


@dataclass
class Finding:
    """What one try found: trouble by its kind, what it was about, and sentences that were said."""

    about: str = ""
    reached: bool = True  # whether the fault met a batch at work
    trouble: list[tuple[str, str]] = field(default_factory=list)
    said: Counter = field(default_factory=Counter)

    def add(self, kind: str, words: str):
        """Notes trouble."""
        self.trouble.append((kind, words))


class Judge:
    """Looks at the folder of a batch's results and at what it said."""

    def __init__(self, stage: Stage, plan: Plan, finding: Finding):
        self.stage, self.plan, self.finding = stage, plan, finding
        self.wanted = stage.made(plan)
        self.older = stage.made(plan, older=True) if plan.over else {}

    def words(self, said: Said, failing: bool = False):
        """What a batch said that ended by itself: one sentence for each take that failed, and no other word.

        `failing` is whether it must have failed.
        """
        for line in said.lines:
            if not SENTENCE.fullmatch(line):
                self.finding.add(WORDS, f"no sentence: {line}")
            self.finding.said[plain(line)] += 1
        if any(re.search("fault of Mocap|Traceback", line) for line in said.lines):
            self.finding.add(WORDS, " / ".join(said.lines)[-300:])
        if said.status not in (0, 1, 2) or bool(said.status) != bool(said.lines) or (failing and not said.status):
            self.finding.add(WORDS, f"status {said.status} with {len(said.lines)} lines: {said.lines[-1:]}")
        if len(said.lines) > len(self.plan.takes) + 1:
            self.finding.add(WORDS, f"{len(said.lines)} sentences of {len(self.plan.takes)} takes")

    def claims(self, said: Said, *outs: Path):
        """Takes that a batch says are done must be so, in one of the folders."""
        for take in said.done:
            if not any(self.finished(take, out) for out in outs):
                self.finding.add(UNTOLD, f"{take} is said to be done, and is not")

    def whole(self, out: Path):
        """Every file that is there must be whole, an older one or a new one."""
        for path in out.iterdir() if out.is_dir() else ():
            if path.name.startswith((PART, TURN)):  # of which the next run takes care
                continue
            if path.name not in self.plan.names:
                self.finding.add(LEFT, f"{path.name} is there")
            elif not self._is_whole(path):
                self.finding.add(HALF, f"{path.name} of {path.stat().st_size} bytes")

    def finished(self, take: str, out: Path, older: bool = False) -> bool:
        """Whether all files of a take are there as they are to be, or as older ones are."""
        wanted = self.older if older else self.wanted
        return all(_same(out / name, wanted[name], self.plan.over) for name in self.plan.files(take))

    def stamps(self, out: Path) -> dict[str, dict[str, tuple]]:
        """What tells the files of finished takes from any others, by their takes."""
        found = {}
        for take in self.plan.takes:
            if self.finished(take, out):
                each = {name: (out / name).stat() for name in self.plan.files(take)}
                found[take] = {name: (one.st_ino, one.st_mtime_ns, one.st_size) for name, one in each.items()}
        return found

    def kept(self, out: Path, before: dict[str, dict[str, tuple]], same: bool = True):
        """Finished takes of before must still be so, and with `same` be the very files."""
        now = self.stamps(out)
        for take, files in before.items():
            if take not in now:
                self.finding.add(LOST, f"{take} was finished, and is not")
            elif same and now[take] != files:
                self.finding.add(LOST, f"{take} was finished, and is made again")

    def end(self, said: Said, out: Path, temporary: Path):
        """After the run that goes on with it: all is there, as an undisturbed batch makes it, and nothing else."""
        if said.status or said.lines:
            self.finding.add(LOST, f"cannot be gone on with: {' / '.join(said.lines)}")
        for take in self.plan.takes:
            if not self.finished(take, out):
                other = [
                    name
                    for name in sorted(self.plan.files(take))
                    if not _same(out / name, self.wanted[name], self.plan.over)
                ]
                self.finding.add(LOST, f"in the end {take} is not as it should be: {', '.join(other)}")
        if self.plan.summaries:
            rows = {take: row for take, row in self.wanted[TABLE].items() if take in self.plan.takes}
            if not _same(out / TABLE, rows, False):
                self.finding.add(LOST, "in the end the table is another")
        self.left(out, temporary)

    def left(self, out: Path, temporary: Path):
        """Nothing but results may lie there."""
        here = {path.name for path in out.iterdir()} if out.is_dir() else set()
        there = {path.name for path in temporary.iterdir()} if temporary.is_dir() else set()
        for name in sorted((here - self.plan.names) | there):
            self.finding.add(LEFT, name)

    def _is_whole(self, path: Path) -> bool:
        if path.name in self.plan.summaries:
            try:
                read_whole(path)
            except Exception:  # noqa: BLE001 whatever it is, the file is not whole
                return False
            return True
        wanted = self.wanted[path.name], self.older.get(path.name)
        return any(one is not None and _same(path, one, self.plan.over) for one in wanted)


def _same(path: Path, wanted: object, over: bool) -> bool:
    """Whether a file holds what is wanted; `over` older results a page tells what is otherwise now."""
    try:
        if over and path.name.endswith(PAGE):
            read_whole(path)
            return True
        return content(path) == wanted
    except Exception:  # noqa: BLE001 whatever it is, the file is not whole
        return False


def plain(line: str) -> str:
    """A sentence without the names and numbers of one case."""
    words = re.sub(r"\S*/\S+", "…", line.removeprefix("mocap-autolabel: "))
    return re.sub(r"\b(walk|turn|reach|wave)\.(csv|c3d)\b", "…", re.sub(r"\d+", "…", words))
