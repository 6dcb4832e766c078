# SPDX-License-Identifier: GPL-3.0-or-later
"""Placement quality of a marker set: judged, better places looked for, and what is said of it as JSON."""

from collections.abc import Generator, Sequence

import numpy as np

from ..core.data.markersets import MarkerSet
from ..core.data.progress import Progress
from ..core.placement_quality import ADVICE, Advice, Ambiguity, MarkerLayout, advise, judge, marker_layout, separation
from ..core.placement_quality.judging import TURNED_ROUND
from ..core.points.likelihood.model import Likelihood

CLEAR = 8.0  # standard deviations; pairs better separated are not listed
QUALITY_DIGITS = 2


def quality_report(layout: MarkerLayout, found: Ambiguity, advice: Sequence[Advice], goal: float) -> dict:
    """What was found of the layout of a marker set; separations in standard deviations, lengths in millimetres."""
    markerset = layout.markerset
    return {
        "model": markerset.name,
        "goal": goal,
        "subjects": layout.subjects,
        "markers": {
            name: {
                "separation": _rounded(found.of_markers[index]),
                "rival": found.markers[int(found.hidden[index].argmax())],
            }
            for index, name in enumerate(found.markers)
        },
        "pairs": [
            {
                "markers": [found.markers[one], found.markers[two]],
                "separation": _rounded(found.hidden[one, two]),
                "all_seen": _rounded(found.seen[one, two]),
            }
            for one, two in found.worst()
            if separation(found.hidden[one, two]) < CLEAR
        ],
        "whole": [
            {
                "kind": renaming.kind,
                "turn_deg": round(float(np.degrees(renaming.yaw))) if renaming.kind == TURNED_ROUND else None,
                "markers": [found.markers[index] for index in renaming.moved],
                "separation": _rounded(overlap),
            }
            for renaming, overlap in sorted(zip(found.whole, found.overlaps, strict=True), key=lambda row: -row[1])
        ],
        "advice": [_advice(one, markerset) for one in advice],
    }


def _advice(advice: Advice, markerset: MarkerSet) -> dict:
    return {
        "marker": advice.marker,
        "segment": markerset.skeleton.segments[advice.segment],
        "shift_mm": [round(float(value), 1) for value in 1000 * advice.shift(markerset)],
        "offset": [round(float(value), 6) for value in advice.new],
        "for": list(advice.pair),
        "before": round(advice.before, QUALITY_DIGITS),
        "after": round(advice.after, QUALITY_DIGITS),
        "words": advice.in_words(markerset),
    }


def _rounded(overlap: float) -> float:
    return round(float(separation(np.asarray(overlap))), QUALITY_DIGITS)


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
