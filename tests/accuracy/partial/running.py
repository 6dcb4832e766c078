# SPDX-License-Identifier: GPL-3.0-or-later
"""Goes through methods, people and studies, and keeps every result in a file of its own, so that parts can be run at
different times and nothing that was measured is measured again unless asked."""

import json
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from addon.core.papers.partial_solvers.training import Training

from .. import people
from . import solvers, speed
from .methods import FAITHFUL, Takes, learn
from .studies import STUDIES, Test

SETS = {"gait15": people.GAIT15, "body26": people.BODY26}
SAME = "same"
SPEED = "speed.json"
OTHERS = ("solvers", "optimal", "speed")  # of the paper's solvers, of that of all markers, of the built-in models


@dataclass(frozen=True)
class Plan:
    """What to measure.

    methods  of `methods.METHODS`
    studies  of `studies.STUDIES`, and those of `OTHERS`
    groups   in how many groups people are left out: {method: count}
    most     how many of those groups are tested
    frames   test clouds for each cell of the paper's tables, over all people
    again    measure also what is there already
    """

    results: Path
    methods: tuple[str, ...]
    studies: tuple[str, ...]
    targets: tuple[float, ...]
    groups: dict[str, int]
    most: int
    frames: int
    options: Training
    again: bool = False


def takes_of(names: tuple[str, ...], persons=None) -> Takes:
    """Frames and owner of every take of some people, or of all."""
    return [(recording.pick(names), recording.person) for recording in people.takes(persons)]


def splits(plan: Plan, method: str) -> Iterator[tuple[str, list[str], list[str]]]:
    """Of each training its name, whom it learns from and who is tested."""
    everyone = list(people.everyone())
    yield SAME, everyone, everyone
    for group in people.folds(plan.groups[method])[: plan.most]:
        yield "+".join(group), [person for person in everyone if person not in group], list(group)


def run(plan: Plan):
    """Measures everything in the plan that is not there yet."""
    plan.results.mkdir(parents=True, exist_ok=True)
    order = [(at, method, split) for method in plan.methods for at, split in enumerate(splits(plan, method))]
    # All methods' first training, then all their second: what is there after an hour can be compared.
    for _, method, split in sorted(order, key=lambda item: item[0]):
        measure(plan, method, *split)
    if "speed" in plan.studies and (plan.again or not (plan.results / SPEED).exists()):
        keep(plan.results / SPEED, {"rows": speed.timed(), "load": os.getloadavg()[0]})


def applies(study: str, method: str, split: str) -> bool:
    """Whether a study says anything of a method and those who are tested."""
    if study in ("solvers", "cover", "optimal"):
        return split == SAME and method != "ours"
    return study in STUDIES


def measure(plan: Plan, method: str, split: str, learned: list[str], tested: list[str]):
    """All studies of a method on some people that are not there yet; trains at most once."""
    path = plan.results / f"{method}.{split}.json"
    found = read(path)
    missing = [study for study in plan.studies if applies(study, method, split) and (plan.again or study not in found)]
    trained = None
    for study in missing:
        if study == "optimal":
            found[study] = _optimal(replace(plan.options, functions=FAITHFUL[method]))
        else:
            trained = trained or learn(method, takes_of(people.GAIT15, learned), people.GAIT15, plan.options)
            ask = solvers.claims if study == "solvers" else STUDIES[study]
            found[study] = ask(trained, _test(plan, tested))
            found["facts"] = merged(found.get("facts", {}), trained.facts)
        keep(path, found)
        print(f"{method}, {split}: {study}", file=sys.stderr, flush=True)


def merged(before: dict, now: dict) -> dict:
    """What was known of a training and what is known now, of all ensembles."""
    return {**before, **now, "ensembles": {**before.get("ensembles", {}), **now.get("ensembles", {})}}


def _optimal(options: Training) -> dict[str, list[int]]:
    frames = {name: np.concatenate([part for part, _ in takes_of(names)]) for name, names in SETS.items()}
    return {name: solvers.optimal(every, options) for name, every in frames.items()}


def _test(plan: Plan, tested: list[str]) -> Test:
    everyone = people.everyone()
    frames = np.concatenate([frames for frames, _ in takes_of(people.GAIT15, tested)])
    count = int(np.ceil(plan.frames * len(tested) / len(everyone)))
    return Test(frames, people.GAIT15, count, plan.targets, everyone.index(tested[0]))


def read(path: Path) -> dict:
    """The results in a file; none when it is not there."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def keep(path: Path, found: dict):
    """Writes the file whole."""
    beside = path.with_suffix(".part")
    beside.write_text(json.dumps(found), encoding="utf-8")
    beside.replace(path)
