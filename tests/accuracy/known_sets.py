# SPDX-License-Identifier: GPL-3.0-or-later
"""How often the marker set of a take is found among those that are known: python -m tests.accuracy.known_sets.

Known are the built-in sets and, of takes in somebody's own set, that; of the same takes without it, "unknown", none is
right. Prints the table of results/known_sets.json.
"""

import argparse
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from time import process_time

import numpy as np

from addon.core.data.progress import finished
from addon.core.data.takes import Points
from addon.core.pipelines.known_sets import set_worn
from addon.core.points.models import Model
from addon.io.markersets import builtin_markersets
from addon.io.models import open_model
from addon.io.points import read_points
from scripts.results import markdown

from . import people, registry, strangers, whole_takes
from .whole_takes import Pieces, cut_up, without_names

PIECES, LONGEST = Pieces(), 3000  # frames of a take that is cut to pieces
Worn = tuple[Points, Model | None]  # a take, and the set that is worn in it
FEET = "pigsimple_normal1"  # who wears RMT5 and LMT5, too


def in_set(name: str, takes: Iterable[people.Take]) -> Iterator[Worn]:
    """Takes in a built-in set, as recorded and cut to pieces."""
    model = open_model(name)
    for take in takes:
        yield without_names(take.xyz, take.rate), model
        yield cut_up(take.part(0, LONGEST), take.markers, PIECES)[0], model


def walkers(markers: tuple[str, ...]) -> Iterator[people.Take]:
    """Five people who stand, walk and turn in such markers."""
    return (take.of(markers) for take in people.takes(people.WALKERS[::2]) if set(markers) <= set(take.markers))


def serve() -> Iterator[people.Take]:
    """A tennis serve in `body39`."""
    take = people.read(people.DATA / people.OTHERS["serve"], "serve")
    yield take.of(open_model("body39").markerset.markers)


def other_labs(keep: Path, *kinds: str) -> Iterator[Worn]:
    """Takes of other labs, by what the first of their kind taught or `body39`, or `actor41` with two markers more."""
    for kind in kinds:
        list(registry.of_other_labs(kind, keep))  # makes what is not there
        own = None
        for place in sorted(one for one in (keep / "strangers" / kind).iterdir() if one.is_dir()):
            model = place / "own.markerset.json"
            own = open_model(str(model)) if model.exists() else own
            built_in = open_model("actor41" if place.name == FEET else "body39")
            yield read_points(place / "cloud.c3d"), built_in if kind == "plugin_gait" else own


def groups(keep: Path) -> dict[str, Callable[[], Iterator[Worn]]]:
    """What is tried."""
    own, runner = ("still", "plates", "animal_hand"), read_points(people.DATA / "blobs" / "qualisys_run" / "run.c3d")
    return {
        "`gait15`": lambda: in_set("gait15", walkers(people.GAIT15)),
        "`gait15`, other labs": lambda: in_set(
            "gait15", map(whole_takes.in_gait15, [*whole_takes.WALKS, *whole_takes.OTHER_MOTIONS])
        ),
        "`body26`": lambda: in_set("body26", walkers(people.BODY26)),
        "`body26`, other labs": lambda: in_set("body26", strangers.in_body26()),
        "`body39`, a serve": lambda: in_set("body39", serve()),
        "`body39`, other labs": lambda: other_labs(keep, "plugin_gait"),
        "`actor41`": lambda: in_set("actor41", whole_takes.actors("cmu41").values()),
        "`actor53`": lambda: in_set("actor53", whole_takes.actors("actors53").values()),
        "own sets, other labs": lambda: other_labs(keep, *own),
        "unknown: other labs": lambda: ((points, None) for points, _ in other_labs(keep, *own)),
        "unknown: a runner": lambda: iter([(without_names(runner.xyz[:], runner.rate), None)]),
    }


def outcome(points: Points, model: Model | None) -> str:
    """What comes of a take."""
    known = {frozenset(one.markerset.markers): one for one in map(open_model, builtin_markersets())}
    own = [] if model is None or frozenset(model.markerset.markers) in known else [model]
    worn, likely = finished(set_worn(points, [*known.values(), *own]))
    if worn is None:
        return "asked" if likely else "none"
    right = model is not None and set(worn.markerset.markers) == set(model.markerset.markers)
    return "right" if right else "wrong"


def main():
    """Prints what came of each group of takes."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--keep", type=Path, required=True, help="where models and cases are kept")
    given, rows, every = parser.parse_args(), [], []
    kinds = "right", "asked", "none", "wrong"
    for title, takes in groups(given.keep).items():
        found: Counter[str] = Counter()
        seconds = []
        for points, model in takes():
            begin = process_time()
            found[outcome(points, model)] += 1
            seconds.append(process_time() - begin)
        every += seconds
        rows.append([title, len(seconds), *(found[kind] for kind in kinds), *_seconds(seconds)])
        print(rows[-1], flush=True)
    totals = [sum(row[column] for row in rows) for column in range(1, 6)]
    rows.append(["all", *totals, *_seconds(every)])
    head = ["takes in", "takes", *kinds, "core seconds", "most"]
    print(markdown(head, rows))


def _seconds(each: list[float]) -> list[float]:
    return [round(float(np.median(each)), 1), round(max(each), 1)]


if __name__ == "__main__":
    main()
