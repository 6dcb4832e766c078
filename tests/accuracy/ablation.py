# SPDX-License-Identifier: GPL-3.0-or-later
"""What every stage and every hand-set number of naming brings: python -m tests.accuracy.ablation

  --list                           the cases, stages and numbers
  points blobs "strangers still"   cases, or how some begin; all unless said
  --without NAME …                 stages switched off, each alone (`each`: every one)
  --number PATTERN … --factor 0.5 2    numbers varied, each alone
  --seconds 600                    stops after the take at work; the next call goes on from there
  --keep DIR                       for models and what was measured take by take
  --out results/ablation.json      wrong, recall, refused and seconds a case, and how each variant differs from `all`

Nothing is measured twice unless the code of naming has changed. A difference that is smaller than its interval is none:
95 %, by takes, or by seconds where a case has fewer than five.
"""

import argparse
import hashlib
import json
import os
import sys
import tempfile
from fnmatch import fnmatch
from itertools import zip_longest
from pathlib import Path
from time import monotonic

import numpy as np
from threadpoolctl import threadpool_limits

from scripts.results import matters, now

from . import people
from .registry import Outcome, registry
from .switches import STAGES, TOGETHER, numbers, variant

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results" / "ablation.json"
MIN_TAKES = 5
SIGMAS = 1.96  # of a normal distribution, 95 % are within


def version() -> str:
    """A digest of the code that names, and of the sets that it names by."""
    files = [*ROOT.glob("addon/core/**/*.py"), *ROOT.glob("kernels/src/*"), *ROOT.glob("assets/*.json")]
    return people.digest_of(sorted(files))[:12]


class Measured:
    """What was measured of one version of the code, take by take, kept in a file a case and variant."""

    def __init__(self, folder: Path):
        self.folder = folder / version()
        self.folder.mkdir(parents=True, exist_ok=True)

    def file(self, case: str, name: str) -> Path:
        digest = hashlib.sha256(f"{case}\0{name}".encode()).hexdigest()[:16]
        return self.folder / f"{digest}.json"

    def read(self, case: str, name: str) -> dict:
        path = self.file(case, name)
        return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}

    def write(self, case: str, name: str, takes: dict):
        path = self.file(case, name)
        part = path.with_suffix(f".{os.getpid()}")
        part.write_text(json.dumps(takes), encoding="utf-8")
        part.replace(path)


def measure(kept: Measured, case: str, trials, names: list[str], until: float) -> bool:
    """Labels what is not measured yet of a case, variant by variant; whether all of it is."""
    have = {name: kept.read(case, name) for name in names}
    for trial in trials:
        for name in names:
            if trial.take in have[name]:
                continue
            if monotonic() > until:
                return False
            with variant(name), threadpool_limits(1, user_api="blas"):
                have[name][trial.take] = _plain(trial.label())
            kept.write(case, name, have[name])
    return True


def _plain(outcome: Outcome) -> dict:
    counts = {name: getattr(outcome, name).tolist() for name in ("right", "wrong", "there")}
    return {**counts, "refused": outcome.refused, "seconds": round(outcome.seconds, 3)}


def figures(takes: dict) -> dict:
    """A case's row of the results."""
    right, wrong, there = (sum(sum(take[name]) for take in takes.values()) for name in ("right", "wrong", "there"))
    return {
        "takes": len(takes),
        "refused": sum(bool(take["refused"]) for take in takes.values()),
        "there": there,
        "right": right,
        "wrong": wrong,
        "recall": round(100 * right / max(there, 1), 4),
        "wrong_percent": round(100 * wrong / max(right + wrong, 1), 4),
        "seconds": round(sum(take["seconds"] for take in takes.values()), 2),
    }


def difference(before: dict, after: dict) -> dict:
    """How a variant differs from `all` on the takes that both have, in per cent of the markers that are there."""
    some = sorted(before.keys() & after.keys())
    found = {"takes": len(some)}
    for name in ("right", "wrong"):
        units = [np.zeros((0, 3))]
        for take in some:
            columns = after[take][name], before[take][name], before[take]["there"]
            rows = np.array([*zip_longest(*columns, fillvalue=0)], float)
            units.append(rows.sum(axis=0, keepdims=True) if len(some) >= MIN_TAKES else rows)
        new, old, known = np.concatenate(units).T
        change, total, count = new - old, max(known.sum(), 1.0), len(known)
        share = change.sum() / total
        spread = np.sqrt(((change - share * known) ** 2).sum() * count / max(count - 1, 1)) / total
        found[name] = [round(float(100 * part), 4) for part in (share, SIGMAS * spread)]
    seconds = [sum(which[take]["seconds"] for take in some) for which in (before, after)]
    found["seconds"] = [round(part, 2) for part in seconds]
    found["refused"] = [sum(bool(which[take]["refused"]) for take in some) for which in (before, after)]
    return found


def main() -> int:
    """Measures what was asked for, as far as the time goes, and writes the results."""
    parser = argparse.ArgumentParser(prog="python -m tests.accuracy.ablation", description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", help="cases, or how some begin")
    parser.add_argument("--without", nargs="*", default=[], metavar="STAGE")
    parser.add_argument("--number", nargs="*", default=[], metavar="PATTERN")
    parser.add_argument("--factor", nargs="*", type=float, default=[0.5, 2.0])
    parser.add_argument("--seconds", type=float, default=np.inf, help="of the clock")
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "mocap-autolabel-ablation")
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--list", action="store_true")
    given = parser.parse_args()
    people.need_people()
    cases = registry(given.keep)
    if given.list:
        print("\n".join(["cases:", *cases, "\nstages:", *STAGES, *TOGETHER, "\nnumbers:", *numbers()]))
        return 0
    chosen = [name for asked in given.cases or [""] for name in cases if name.startswith(asked)]
    stages = [*STAGES, *TOGETHER] if "each" in given.without else given.without
    varied = [name for name in numbers() if any(fnmatch(name, pattern) for pattern in given.number)]
    names = ["all", *(f"without {name}" for name in stages)]
    names += [f"{name}*{factor:g}" for name in varied for factor in given.factor]
    kept, until, whole = Measured(given.keep), monotonic() + given.seconds, True
    for case in dict.fromkeys(chosen):
        own = [name for name in names if _concerns(case, name)]
        whole = measure(kept, case, cases[case](), own, until) and whole
        _show(kept, case, own)
    write(kept, given.out, list(cases), names)
    print("all of it is measured" if whole else "time is up; the same command goes on from here")
    return 0


def _concerns(case: str, name: str) -> bool:
    """Whether a variant can change a case at all: points never enter the folder of blobs."""
    images = case.startswith(("blobs", "curve", "strangers'"))
    if name.startswith("without blobs"):
        return images and "several" not in case
    if name.startswith(("without points", "without frames")):
        return not images or "several" in case
    return True


def _show(kept: Measured, case: str, names: list[str]):
    before = kept.read(case, "all")
    print(f"{case}: {figures(before)}", flush=True)
    for name in names[1:]:
        after = kept.read(case, name)
        if after:
            found = difference(before, after)
            print(f"  {'*' if matters(found) else ' '} {name}: {found}", flush=True)


def write(kept: Measured, out: Path, cases: list[str], names: list[str]):
    """Writes what is known of the code as it is; other variants that were written of it before stay."""
    old = json.loads(out.read_text(encoding="utf-8")) if out.exists() else {}
    same = old.get("version") == version()
    variants = dict(old.get("variants", {})) if same else {}
    for name in names[1:]:
        rows = dict(variants.get(name, {}))
        for case in cases:
            before, after = kept.read(case, "all"), kept.read(case, name)
            if before and after:
                rows[case] = difference(before, after)
        if rows:
            variants[name] = rows
    measured = {case: figures(takes) for case in cases if (takes := kept.read(case, "all"))}
    result = {
        "command": "python -m tests.accuracy.ablation",
        "version": version(),
        "measured_at": now(),
        "cases": measured,
        "variants": variants,
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(result, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
