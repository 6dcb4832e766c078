# SPDX-License-Identifier: GPL-3.0-or-later
"""What a model knows of others that has seen one person, or two: python -m tests.accuracy.few.

With --serve, what the built-in model knows of a tennis serve in another lab, which has no SACR.

One person's model is learned from one take. All takes of three other people are named, frame by frame and as the
product does, which solves takes as a whole; each marker is hidden twice for a while.
"""

import argparse
from collections.abc import Iterator

import numpy as np

from addon.core.data.markersets import MarkerSet
from addon.core.points.likelihood.learn import learn_likelihood
from addon.core.points.models import Model
from addon.io.models import open_model

from . import people
from .points import SEED, TARGET, Counts, labelled_as_product
from .tables import share, table

RATE = 100.0  # a second
EVERY = 3  # one of so many people is trained on,
OTHERS = (1, 4, 6)  # and those so far behind are tested
GAPS, GAP_FRAMES = 2, (5, 40)  # of each marker, and how long they are


def trained(markerset: MarkerSet, persons: list[str]) -> Model:
    """The built-in model as it would be had only these people been recorded; a single one in a single take."""
    takes = [(take.pick(markerset.markers), take.person) for take in people.takes() if take.person in persons]
    if len(persons) == 1:
        whole = [take for take in takes if np.isfinite(take[0][..., 0]).any(axis=0).all()]
        takes = [max(whole, key=lambda take: len(take[0]))]
    likelihood = learn_likelihood(takes, markerset.markers)
    return Model(markerset, likelihood)


def tested(markerset: MarkerSet, persons: list[str]) -> Iterator[np.ndarray]:
    """Takes (T, M, 3) m of these people, with gaps."""
    for take in people.takes():
        if take.person in persons:
            rng = np.random.default_rng(SEED)
            points = take.pick(markerset.markers)
            for marker in np.repeat(np.arange(points.shape[1]), GAPS):
                first = rng.integers(0, len(points))
                points[first : first + rng.integers(*GAP_FRAMES), marker] = np.nan
            yield points


def rows(name: str, count: int) -> list[list[str]]:
    """Of a set learned from `count` people, what comes of others."""
    everyone, markerset = people.everyone(), open_model(name).markerset
    frames, product = Counts(), Counts()
    for first in range(0, len(everyone), EVERY):
        own = [everyone[(first + place) % len(everyone)] for place in range(count)]
        others = [everyone[(first + count - 1 + place) % len(everyone)] for place in OTHERS]
        model = trained(markerset, own)
        for points in tested(markerset, others):
            truth = np.where(np.isfinite(points[..., 0]), np.arange(points.shape[1]), -1)
            found, decided, _ = labelled_as_product(model, points, RATE)
            frames.add(np.where(found.rate >= TARGET, found.marker, -1), truth, len(markerset))
            product.add(decided.marker, truth, len(markerset))
    return cells(name, "one, in one take" if count == 1 else str(count), frames, product)


def serve_rows(name: str) -> list[list[str]]:
    """Of a built-in set, what comes of the player of another lab."""
    model, rate = open_model(name), people.SERVE_RATE
    points = people.other_lab(model.markerset.markers)
    truth = np.where(np.isfinite(points[..., 0]), np.arange(points.shape[1]), -1)
    frames, product = Counts(), Counts()
    found, decided, _ = labelled_as_product(model, points, rate)
    frames.add(np.where(found.rate >= TARGET, found.marker, -1), truth, len(model.markerset))
    product.add(decided.marker, truth, len(model.markerset))
    return cells(name, "all ten, of another lab", frames, product)


def cells(name: str, learned: str, frames: Counts, product: Counts) -> list[list[str]]:
    """A set's lines of the table."""
    return [
        [
            name,
            learned,
            how,
            share(counts.wrong, counts.given, 3),
            f"{100 * (counts.given - counts.wrong) / counts.there:.1f} %",
        ]
        for how, counts in (("frames alone", frames), ("the whole take", product))
    ]


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", nargs="*", default=["gait15", "body26"])
    parser.add_argument("--serve", action="store_true", help="the tennis serve instead")
    given = parser.parse_args()
    if given.serve:
        found = [row for name in given.sets for row in serve_rows(name)]
    else:
        found = [row for name in given.sets for count in (1, 2) for row in rows(name, count)]
    print(table(["set", "people learned from", "of others", "wrong labels", "recall"], found))


if __name__ == "__main__":
    main()
