# SPDX-License-Identifier: GPL-3.0-or-later
"""Placement quality of a marker set: judged, and better places looked for, for both doors."""

from collections.abc import Generator, Sequence

from ..core.data.markersets import MarkerSet
from ..core.placement_quality import GOAL, STEPS, advise, judge
from ..core.placement_quality import layout as worn
from ..io.quality import quality_report
from ..progress import Progress

JUDGED = 0.1  # of the work; the rest is the search


def judge_placement(
    markerset: MarkerSet,
    base: MarkerSet | None = None,
    goal: float = GOAL,
    steps: int = STEPS,
    keep: Sequence[str] = (),
) -> Generator[Progress, None, dict]:
    """The report of a marker set, with up to `steps` pieces of advice; `base` is the set that it was edited from.

    `goal` and `keep` are as in `core.ambiguity.advise`. Raises InputError for a set of too few markers.
    """
    yield Progress(0.0, "judging")
    made = worn(markerset, base)
    found, advice = judge(made), []
    yield Progress(JUDGED, "looking for better places")
    for one, _ in advise(made, goal, steps, keep):
        advice.append(one)
        yield Progress(JUDGED + (1 - JUDGED) * len(advice) / steps, "looking for better places")
    return quality_report(made, found, advice, goal)
