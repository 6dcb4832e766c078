# SPDX-License-Identifier: GPL-3.0-or-later
"""Placement quality of a marker set: judged, and better places looked for, for both doors."""

from collections.abc import Generator, Sequence

from ..core.data.markersets import MarkerSet
from ..core.data.progress import Progress
from ..core.placement_quality import ADVICE, advise, judge, marker_layout
from ..core.points.likelihood.model import Likelihood
from ..io.quality import quality_report

JUDGED_SHARE = 0.1  # of the work; the rest is the search


def judge_placement(
    markerset: MarkerSet,
    base: MarkerSet | None = None,
    learned: Likelihood | None = None,
    goal: float = ADVICE.goal,
    steps: int = ADVICE.steps,
    keep: Sequence[str] = (),
) -> Generator[Progress, None, dict]:
    """The report of a marker set, with up to `steps` pieces of advice.

    `base` is the set that it was edited from, `learned` what its model, or that of `base`, has learned.

    `goal` and `keep` are as in `core.placement_quality.advise`. Raises InputError for a set of too few markers.
    """
    yield Progress(0.0, "judging")
    made = marker_layout(markerset, base, learned)
    found, advice = judge(made), []
    yield Progress(JUDGED_SHARE, "looking for better places")
    for one, _ in advise(made, goal, steps, keep):
        advice.append(one)
        yield Progress(JUDGED_SHARE + (1 - JUDGED_SHARE) * len(advice) / steps, "looking for better places")
    return quality_report(made, found, advice, goal)
