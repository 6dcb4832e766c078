# SPDX-License-Identifier: GPL-3.0-or-later
"""How well a set of plates is named: python -m tests.accuracy.plates prints what results/plates.json keeps.

Trained on one take and tested on another of the same subject, whole and cut into tracklets with markers hidden and
ghosts; on other people made of the test take; and on a raw take of which nobody knows the truth, by what anatomy says
of it.
"""

import argparse
import tempfile
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np

from addon.cli import main as command
from addon.core.points.adaptation import Adaptation
from addon.core.points.models import Model
from addon.core.points.rigid_bodies.structure import learn_structure
from addon.core.points.tracklets import cut, vote_tracklets
from addon.io.models import open_model
from addon.io.points import read_points

from . import anatomical, others
from .people import DATA
from .points import TARGET, Counts, labelled_as_product
from .tables import table

TAKES = DATA / "people" / "clouthier"
TRAINED, TESTED, RAW = (TAKES / f"{name}.c3d" for name in ("KneeltoProne01", "PronetoRun01", "S09_KneeltoRun02"))
# Tracklets that the take is cut into, markers hidden at once at most, and ghosts.
CUTS = ((62, 0, 0), (278, 5, 30), (453, 10, 60))
SEED = 1
PEOPLE = 6
HIDDEN_FRAMES = (10, 60)  # that a marker is hidden for
GHOST_FRAMES = 20  # that a ghost lasts at least
MARGIN = 5  # frames at either end that no tracklet is cut in


def trained(takes: list[Path]) -> Model:
    """A model of labelled takes, trained as the command line does."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plates.markerset.json"
        with redirect_stdout(StringIO()) as said:
            status = command(["train", *map(str, takes), "--out", str(path)])
        if status != 0:
            raise RuntimeError(f"{takes} could not be trained on: {said.getvalue()}")
        return open_model(str(path))


def cut_up(
    labelled: np.ndarray, tracklets: int, hidden: int, ghosts: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Anonymous trajectories (T, P, 3) m of a labelled take (T, M, 3), and the marker (P,) of each, -1 for ghosts."""
    frames, markers = labelled.shape[:2]
    cuts = rng.multinomial(max(tracklets - markers, 0), np.full(markers, 1 / markers))
    seen = np.isfinite(labelled[..., 0]) & ~_hidden(frames, markers, hidden, rng)
    columns, truth = [], []
    for marker in range(markers):
        inside = np.sort(rng.choice(np.arange(MARGIN, frames - MARGIN), cuts[marker], replace=False))
        for first, after in zip([0, *inside], [*inside, frames], strict=True):
            here = seen[:, marker] & (np.arange(frames) >= first) & (np.arange(frames) < after)
            if here.any():
                columns.append(np.where(here[:, None], labelled[:, marker], np.nan))
                truth.append(marker)
    columns += [_ghost(labelled, rng) for _ in range(ghosts)]
    truth += [-1] * ghosts
    order = rng.permutation(len(columns))
    return np.stack([columns[index] for index in order], axis=1), np.array(truth)[order]


def _hidden(frames: int, markers: int, most: int, rng: np.random.Generator) -> np.ndarray:
    gone = np.zeros((frames, markers), dtype=bool)
    first = 0
    while most and first < frames:
        length = rng.integers(*HIDDEN_FRAMES)
        many = rng.integers(0, most + 1)
        gone[first : first + length, rng.permutation(markers)[:many]] = True
        first += length
    return gone


def _ghost(labelled: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A point that wanders about near the subject for a while, every other one along with it."""
    frames = len(labelled)
    length = rng.integers(GHOST_FRAMES, frames // 3)
    first = rng.integers(0, frames - length)
    here, middle = slice(first, first + length), first + length // 2
    start = rng.uniform(np.nanmin(labelled[middle], axis=0) - 0.2, np.nanmax(labelled[middle], axis=0) + 0.2)
    path = start + np.cumsum(rng.normal(0, 0.002, (length, 3)), axis=0)
    if rng.random() < 0.5:
        path = path + np.nanmean(labelled[here], axis=1) - np.nanmean(labelled[middle], axis=0)
    column = np.full((frames, 3), np.nan)
    column[here] = path
    return column


def _row(what: str, marker: np.ndarray, truth: np.ndarray, markers: int) -> tuple[str, ...]:
    counts = Counts()
    counts.add(marker, truth, markers)
    right = counts.given - counts.wrong
    return (
        what,
        f"{100 * 2 * right / max(counts.given + counts.there, 1):.2f} %",
        f"{100 * right / max(counts.there, 1):.2f} %",
        f"{counts.wrong} of {counts.given} ({100 * counts.wrong / max(counts.given, 1):.3f} %)",
    )


def same_subject(model: Model) -> str:
    """The test take of the subject that the model was trained on."""
    take = read_points(TESTED)
    rows = []
    for tracklets, hidden, ghosts in CUTS:
        points, column = cut_up(take.xyz, tracklets, hidden, ghosts, np.random.default_rng(SEED))
        truth = np.where(np.isfinite(points[..., 0]), column, -1)
        named, decided, adaptation = labelled_as_product(model, points, take.rate)
        what = (
            "whole trajectories"
            if tracklets == take.xyz.shape[1]
            else f"{tracklets} pieces, ≤ {hidden} hidden, {ghosts} ghosts"
        )
        if adaptation.other_layout:
            what += " (taken for another subject)"
        size = len(model.markerset)
        voted = vote_tracklets(named, cut(points, take.rate), model.markerset.markers).labels
        rows.append(_row(f"{what}: trajectories vote, every name", voted.marker, truth, size))
        rows.append(_row(f"{what}: what the product gives", decided.marker, truth, size))
        rows.append(_row(f"{what}: frames alone, every name", named.marker, truth, size))
        sure = named.sure(TARGET)
        rows.append(_row(f"{what}: frames alone, names that are right {TARGET:.1%}", sure, truth, size))
    return table(("trajectories", "F1", "recall", "wrong labels"), rows)


def other_people(model: Model, count: int) -> str:
    """Other people in other plates, made of the test take, every other one the mirror image."""
    take = read_points(TESTED)
    names = model.markerset.markers
    source = np.stack([take.xyz[:, take.names.index(name)] for name in names], axis=1)
    structure = learn_structure(model.rigid_bodies, [training_take.points for training_take in model.training_takes])
    rows, total, rigid_bodies = [], Counts(), np.zeros(3, int)
    for person in range(count):
        rng = np.random.default_rng(person)
        points = others.other_person(source, structure, rng, others.Differs())
        points = others.mirrored(points, names) if person % 2 else points
        truth = np.where(np.isfinite(points[..., 0]), np.arange(len(names)), -1)
        named, decided, adaptation = labelled_as_product(model, points, take.rate)
        total.add(decided.marker, truth, len(names))
        right, wrong = _plates_found(structure, adaptation)
        rigid_bodies += right, wrong, len(structure)
        who = f"person {person + 1}{', mirrored' if person % 2 else ''}"
        what = f"{who}: {right} of {len(structure)} plates, {wrong} wrong"
        rows.append(_row(what, decided.marker, truth, len(names)))
        rows.append(_row("its frames alone, every name", named.marker, truth, len(names)))
    summary = (
        f"{rigid_bodies[0]} of {rigid_bodies[2]} plates recognised, {rigid_bodies[1]} taken for others; {total.line()}"
    )
    return f"{table(('made of the test take', 'F1', 'recall', 'wrong labels'), rows)}\n\n{summary}"


def _plates_found(structure, adaptation: Adaptation) -> tuple[int, int]:
    """How many plates are the group of their own markers, and how many another; column m is marker m's."""
    person = adaptation.recognition
    right = wrong = 0
    for rigid_body, group in enumerate(person.cluster):
        if group < 0:
            continue
        tracklets = [tracklet for own in person.clusters[group].tracklets for tracklet in own]
        columns = np.unique(np.nonzero(np.isin(person.part, tracklets))[1])
        core = structure.inner[rigid_body].members[: structure.inner[rigid_body].core]
        found = np.isin(columns, core).mean() > 0.5
        right, wrong = right + found, wrong + (not found)
    return right, wrong


def raw_take(model: Model) -> str:
    """The raw take of somebody else: how much got a name, and what anatomy says of the names."""
    take = read_points(RAW)
    _, decided, adaptation = labelled_as_product(model, take.xyz, take.rate)
    names = model.markerset.markers
    placed = np.full((len(take.xyz), len(names), 3), np.nan)
    frame, column = np.nonzero(decided.marker >= 0)
    placed[frame, decided.marker[frame, column]] = take.xyz[frame, column]
    there = np.isfinite(take.xyz[..., 0])
    missing = [name for index, name in enumerate(names) if not np.isfinite(placed[:, index, 0]).any()]
    prop, cluster = adaptation.recognition.prop & there, adaptation.recognition.cluster
    of_subject = there & ~prop
    rows = [
        ("plates recognised", f"{int((cluster >= 0).sum())} of {len(cluster)}"),
        ("least margin of a plate, log odds", f"{adaptation.recognition.margin.min():.1f}"),
        ("trajectories of things that stand about", f"{int(prop.any(axis=0).sum())}"),
        ("other points that are named", f"{100 * (decided.marker >= 0)[of_subject].mean():.1f} %"),
        ("markers that are not found", " ".join(missing) or "none"),
        *anatomical.statements(placed, names, take.rate),
    ]
    return table(("of the raw take", ""), rows)


def main(arguments: list[str] | None = None):
    """Measures and prints."""
    parser = argparse.ArgumentParser(description="Measures the naming of a set of plates.")
    parser.add_argument("--people", type=int, default=PEOPLE, help="how many other people are made")
    parser.add_argument("--only", nargs="*", choices=("same", "others", "raw"), default=("same", "others", "raw"))
    given = parser.parse_args(arguments)
    model = trained([TRAINED]) if {"same", "others"} & set(given.only) else None
    if "same" in given.only:
        print(f"### Trained on {TRAINED.stem}, tested on {TESTED.stem}\n\n{same_subject(model)}\n", flush=True)
    if "others" in given.only:
        print(f"### The same model, tested on other people\n\n{other_people(model, given.people)}\n", flush=True)
    if "raw" in given.only:
        model = trained([TRAINED, TESTED])
        print(f"### Trained on both, {RAW.stem}\n\n{raw_take(model)}", flush=True)


if __name__ == "__main__":
    main()
