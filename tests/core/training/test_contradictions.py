# SPDX-License-Identifier: GPL-3.0-or-later
"""Two markers with each other's names in one take are found, whatever they are, and nothing else is."""

import numpy as np
import pytest

from addon.core.simulation.virtual import Act
from addon.core.training.contradictions import contradictions, leads
from addon.io.markersets import open_markerset
from tests import recorded
from tests.core.scenes import walker

MARKERS = open_markerset("body26").markers


def take(seed: int) -> np.ndarray:
    """(T, 26, 3) m: a virtual person who walks."""
    return walker("body26", seed, [Act(1.5)], noise=0.0)


@pytest.fixture(scope="module")
def takes() -> list[np.ndarray]:
    return [take(seed) for seed in range(5)]


def found(takes) -> list[list[tuple[str, ...]]]:
    return [
        [tuple(MARKERS[place] for place in group) for group in groups]
        for groups in contradictions([leads(points) for points in takes])
    ]


def exchanged(points: np.ndarray, *pairs: tuple[str, str]) -> np.ndarray:
    points = points.copy()
    for pair in pairs:
        one, two = map(MARKERS.index, pair)
        points[:, [one, two]] = points[:, [two, one]]
    return points


def test_takes_that_agree_contradict_nobody(takes):
    assert found(takes) == [[]] * 5
    assert found(takes[:2]) == [[], []]
    assert found(takes[:1]) == [[]]


@pytest.mark.parametrize(
    "pairs",
    [
        [("LKNE", "RKNE")],
        [("LANK", "RANK")],
        [("LHEE", "LTOE")],
        [("LWRA", "LWRB")],
        [("LFHD", "RFHD"), ("LBHD", "RBHD")],
    ],
)
def test_an_exchange_is_found_in_its_take_and_in_no_other(takes, pairs):
    wrong = exchanged(takes[2], *pairs)
    assert found([*takes[:2], wrong, *takes[3:]]) == [[], [], pairs, [], []]


def test_missing_markers_are_no_contradiction(takes):
    gaps = takes[1].copy()
    gaps[:, MARKERS.index("LKNE")] = np.nan
    gaps[20:, MARKERS.index("RANK")] = np.nan
    assert found([takes[0], gaps, *takes[2:]]) == [[]] * 5
    only = exchanged(gaps, ("LHEE", "RHEE"))
    assert found([takes[0], only, *takes[2:]])[1] == [("LHEE", "RHEE")]


def test_the_recorded_takes_with_exchanged_names_are_found(shared_data):
    from addon.core.training.takes import contradicted
    from addon.jobs.training_takes import read_takes

    said = contradicted(read_takes(recorded.takes(shared_data, *recorded.MCGILL), ()), MARKERS)
    assert [line.split(", if")[0] for line in said] == [
        "LWRA and LWRB have each other's names in HC030A01.c3d",
        "LWRA and LWRB have each other's names in HC030A05.c3d",
        "LWRA and LWRB have each other's names in HC030A22.c3d",
        "LWRA and LWRB have each other's names in HC038A11.c3d",
        "RWRA and RWRB have each other's names in HC038A11.c3d",
        "LFHD and LBHD have each other's names in HC039A17.c3d",
        "RFHD and RBHD have each other's names in HC039A17.c3d",
        "LFHD and RFHD have each other's names in HC055A34.c3d",
        "LBHD and RBHD have each other's names in HC055A34.c3d",
    ]
