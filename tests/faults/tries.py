# SPDX-License-Identifier: GPL-3.0-or-later
"""One try of each kind of fault: a batch is begun, disturbed at some moment, and gone on with."""

import os
import resource
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from random import Random

from addon.io.whole import LIST, PART

from .judging import LEFT, Finding, Judge
from .places import WITHOUT_PRIVILEGES, MovedFolder, SmallDisk
from .stage import Moment, Plan, Run, Stage


@dataclass
class Try:
    """What one try has: the stage, its own folder, its chance, what this system can do, and what it finds."""

    stage: Stage
    folder: Path
    chance: Random
    can: dict[str, bool]
    finding: Finding

    @property
    def temporary(self) -> Path:
        return self.folder / "temporary"

    def begin(self, plan: Plan, out: Path, *more: str, inputs: Path | None = None, **process) -> Run:
        """Starts a batch."""
        return self.stage.start(self.stage.words(plan, out, *more, inputs=inputs), self.temporary, **process)

    def moment(self, plan: Plan) -> Moment:
        """When it happens."""
        moment = Moment.drawn(self.chance, self.stage.seconds(plan), len(plan.takes))
        self.finding.about += f", {moment}"
        return moment

    def go_on(self, judge: Judge, out: Path, inputs: Path | None = None):
        """The next run, when all is well again: it must do all that is left and keep all that is done."""
        before = judge.stamps(out)
        # What somebody was killed at while it replaced files of another that are as good is finished now.
        begun = any(out.glob(f"{PART}*/{LIST}"))
        plan = replace(judge.plan, jobs=self.chance.choice([1, 1, 2]))
        said = self.begin(plan, out, "--resume", *again(plan), inputs=inputs).said()
        judge.kept(out, before, same=not begun)
        judge.end(said, out, self.temporary)

    def drawn(self, over: bool | None = None, about: str = "") -> tuple[Plan, Judge]:
        """A plan and who judges what becomes of it."""
        plan = Plan.drawn(self.chance, over, self.stage.quick)
        self.finding.about = f"{about}{', ' * bool(about)}{plan}"
        return plan, Judge(self.stage, plan, self.finding)


def again(plan: Plan) -> tuple[str, ...]:
    """What lets a batch put its results in the place of older ones."""
    return ("--overwrite",) if plan.over else ()


def kill(case: Try):
    """Signal 9 to a batch, its first process or one of the others, once or several times."""
    plan, judge = case.drawn()
    out = case.folder / "out"
    if plan.over:
        case.stage.lay(plan, out)
    for number in range(case.chance.choice([1, 1, 1, 2, 3])):
        who = case.chance.choice(["all", "first", "one"])
        case.finding.about += f", {who}"
        moment = case.moment(plan)
        before = judge.stamps(out)
        run = case.begin(plan, out, *again(plan), *(["--resume"] if number else []))
        case.finding.reached = moment.wait(run, out)
        run.kill(who, case.chance)
        said = run.said()
        judge.whole(out)
        judge.kept(out, before)
        if said.status >= 0:
            judge.words(said)
            judge.claims(said, out)
    case.go_on(judge, out)


def full(case: Try):
    """A disk without room, of bytes or of files, for results, for temporary files, or for both; or files too large."""
    ways = ["results", "temporary files", "both"] if case.can["mounts"] else []
    way = case.chance.choice([*ways, "large files"])
    plan, judge = case.drawn(False, way)
    disk, out = case.folder / "disk", case.folder / "out"
    need = case.stage.size(plan)
    size = int(case.chance.uniform(0.02, 1.1) * (need if way != "temporary files" else 24_000))
    files = case.chance.choice([100_000, 100_000, case.chance.randint(3, 10 + 7 * len(plan.takes))])
    with ExitStack() as stack:
        limited = {}
        if way == "large files":
            size = int(case.chance.uniform(0.02, 0.9) * need / len(plan.takes))
            limited = {"preexec_fn": partial(resource.setrlimit, resource.RLIMIT_FSIZE, (size, size))}
        else:
            small = SmallDisk(disk, size, files)
            stack.callback(small.close)
            out = out if way == "temporary files" else disk / "out"
            if way != "results":
                case = Full(case.stage, case.folder, case.chance, case.can, case.finding)
        case.finding.about += f", {size} bytes, {files} files"
        with suppress(OSError):
            case.temporary.mkdir(exist_ok=True)
        run = case.begin(plan, out, **limited)
        said = run.said()
        case.finding.reached = said.status != 0
        judge.words(said)
        judge.claims(said, out)
        judge.whole(out)
        judge.left(out, case.temporary)
        if way != "large files":
            small.grow()
        case.go_on(judge, out)


class Full(Try):
    """A try whose temporary files are on the small disk."""

    @property
    def temporary(self) -> Path:
        return self.folder / "disk" / "temporary"


def unwritable(case: Try):
    """A folder that cannot be written, from the start or from some moment on."""
    ways = ["a file"]
    ways += ["read only", "read only meanwhile"] if case.can["mounts"] else []
    ways += ["no leave", "no leave meanwhile"] if case.can["leave"] else []
    way = case.chance.choice(ways)
    plan, judge = case.drawn(False if way == "a file" else None, way)
    place = case.folder / "place"
    out = place / "out"
    with ExitStack() as stack:
        disk = None
        if way.startswith("read only"):
            disk = SmallDisk(place, 1 << 26, 100_000)
            stack.callback(disk.close)
        place.mkdir(parents=True, exist_ok=True)
        if way == "a file":
            out.write_text("here")
        elif plan.over:
            case.stage.lay(plan, out)
        else:
            out.mkdir()
        before_it = WITHOUT_PRIVILEGES if way.startswith("no leave") and os.geteuid() == 0 else ()
        before = judge.stamps(out)
        if way.endswith("meanwhile"):
            moment = case.moment(plan)
            run = case.begin(plan, out, *again(plan), before=before_it)
            case.finding.reached = moment.wait(run, out) and _forbid(out, disk)
            before = before or judge.stamps(out)
        else:
            _forbid(out, disk)
            run = case.begin(plan, out, *again(plan), before=before_it)
        said = run.said()
        judge.words(said, failing=not way.endswith("meanwhile"))
        if out.is_dir():
            judge.claims(said, out)
            judge.whole(out)
            judge.kept(out, before)
        _allow(out, disk)
        case.go_on(judge, out)


def _forbid(out: Path, disk: SmallDisk | None) -> bool:
    """Forbids to write to a folder, or takes the place of it as a file does; False where that could not be."""
    if disk is not None:
        return disk.seal(3.0)
    if out.is_dir():
        out.chmod(0o555)
    return True


def _allow(out: Path, disk: SmallDisk | None):
    if disk is not None:
        disk.open()
    elif out.is_dir():
        out.chmod(0o755)
    else:
        out.unlink()


def two(case: Try):
    """Two batches into one folder, of the same takes or of some that are the same, killed or not."""
    plan, judge = case.drawn(False)
    other = plan
    if case.chance.random() < 0.4:
        takes = Plan.drawn(case.chance, False, case.stage.quick).takes
        other = Plan(takes, plan.options, case.chance.choice([1, 2]))
    both = Plan((*plan.takes, *(take for take in other.takes if take not in plan.takes)), plan.options, 2)
    judge = Judge(case.stage, both, case.finding)
    out = case.folder / "out"
    ways = [case.chance.choice([(), (), ("--overwrite",), ("--resume",)]) for _ in range(2)]
    killed = case.chance.choice([(), (), (), (0,), (1,), (0, 1)])
    late = case.chance.choice([0.0, 0.0, case.chance.uniform(0, 1) * case.stage.seconds(plan)])
    case.finding.about += f" | {other} | {ways}, killed {killed}, the second {late:.3f} s later"
    moments = [case.moment(both) for _ in killed]
    runs = [case.begin(plan, out, *ways[0])]
    time.sleep(late)
    runs.append(case.begin(other, out, *ways[1]))
    for number, moment in zip(killed, moments, strict=True):
        case.finding.reached &= moment.wait(runs[number], out)
        # The processes of both have one folder for temporary files.
        runs[number].kill("first")
    for number, run in enumerate(runs):
        said = run.said()
        judge.whole(out)
        if number not in killed:
            judge.words(said)
            if not killed:
                judge.claims(said, out)
    case.go_on(judge, out)


def share(case: Try):
    """A share with takes, or with results, that goes away, and comes back during the batch or after it."""
    way, what = case.chance.choice(["renamed", "replaced"]), case.chance.choice(["takes", "results", "both"])
    plan, judge = case.drawn(None, f"{what} {way}")
    there = MovedFolder(case.folder, way == "replaced")
    inputs, out = case.stage.inputs, case.folder / "out"
    if what != "results":
        inputs = there.place / "takes"
        case.stage.copy_takes(inputs)
    if what != "takes":
        out = there.place / "out"
    if plan.over:
        case.stage.lay(plan, out)
    moment = case.moment(plan)
    run = case.begin(plan, out, *again(plan), inputs=inputs)
    case.finding.reached = moment.wait(run, out)
    before = judge.stamps(out)
    there.go()
    back = case.chance.random() < 0.5
    if back:
        time.sleep(case.chance.uniform(0, 0.5) * case.stage.seconds(plan))
        there.come()
    said = run.said()
    if not back:
        there.come()
    judge.words(said)
    judge.claims(said, out, there.between / "out")
    judge.whole(out)
    judge.kept(out, before)
    case.go_on(judge, out, inputs)
    if what != "results" and {path.name for path in inputs.iterdir()} != case.stage.take_names:
        case.finding.add(LEFT, f"beside the takes: {sorted(path.name for path in inputs.iterdir())}")


TRIES: dict[str, Callable[[Try], None]] = {
    "kill": kill, "full": full, "unwritable": unwritable, "two": two, "share": share,
}  # fmt: skip
