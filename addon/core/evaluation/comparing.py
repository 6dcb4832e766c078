# SPDX-License-Identifier: GPL-3.0-or-later
"""What a training on changed: takes whose names are known, named by the model before and after, and what got worse."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..data.wording import count_of
from ..points.models import CheckedTake
from .relabelling import NameCounts

LISTED_MARKERS = 5  # of a take, the worst: so many fit a line


@dataclass(frozen=True)
class WorseOptions:
    """What a training on may make worse before a person is asked, in shares of the points of markers.

    Every training moves single markers of single takes, to the better and to the worse (results/training_on.json).
    """

    # that right names may fall by in all takes together; measured: right takes move it by 0.23 % at most
    # (see results/training_on.json)
    recall: float = 0.005  # measured
    wrong: float = 0.001  # that wrong names may rise by there; measured: exchanged names of one take in three add more
    # times as much in one take; physical: one marker of sixty is wrong for its whole length at 1.7 %
    of_one_take: float = 10.0  # physical


WORSE = WorseOptions()


@dataclass(frozen=True, eq=False)
class TakeDifference:
    """A take as the model before and the one after name it."""

    name: str  # of its file, or of whose frames they are
    kind: str  # where its names are from: "kept", "taught" or "frames"
    frames: int  # that were labelled again
    before: NameCounts
    after: NameCounts

    @property
    def checked(self) -> CheckedTake:
        """The same as shares."""
        both = self.before, self.after
        recall, wrong = (tuple(round(getattr(one, part), 6) for one in both) for part in ("recall", "wrong_share"))
        return CheckedTake(self.name, recall, wrong)


@dataclass(frozen=True, eq=False)
class Comparison:
    """All takes that were labelled by both models, and those that could not be, each with the reason."""

    markers: tuple[str, ...]  # that were counted, in their order
    takes: tuple[TakeDifference, ...]
    left_out: tuple[tuple[str, str], ...] = ()
    options: WorseOptions = WORSE

    @property
    def together(self) -> CheckedTake:
        """All takes as one."""
        before, after = (
            NameCounts(*(sum(getattr(one, part) for one in counts) for part in ("present", "right", "wrong")))
            for counts in ([take.before for take in self.takes], [take.after for take in self.takes])
        )
        return TakeDifference("", "", 0, before, after).checked

    @property
    def worse(self) -> list[str]:
        """What got worse beyond what it may, in sentences."""
        if not self.takes:
            return []
        options = self.options
        found = _worse("all takes together", self.together, options.recall, options.wrong)
        for take in self.takes:
            most = (options.recall * options.of_one_take, options.wrong * options.of_one_take)
            rows = _worse(take.name, take.checked, *most)
            if rows and take.after.refused:
                rows = [f"{take.name} is refused now: {take.after.refused.partition(';')[0]}"]
            found += rows
        return found

    def markers_worse(self, take: TakeDifference) -> list[dict]:
        """The markers of a take that are named right less often, or wrong more often, the worst first."""
        before, after = take.before, take.after
        there = np.maximum(before.present, 1)
        lost, more = (before.right - after.right) / there, (after.wrong - before.wrong) / there
        order = np.argsort(-(np.maximum(lost, 0) + np.maximum(more, 0)), kind="stable")
        return [
            {
                "marker": self.markers[one],
                "points": int(before.present[one]),
                "right": [int(before.right[one]), int(after.right[one])],
                "wrong": [int(before.wrong[one]), int(after.wrong[one])],
            }
            for one in order.tolist()
            if lost[one] > 0 or more[one] > 0
        ]

    def as_dict(self) -> dict:
        """The comparison for JSON: pairs are of the model before and of the one after."""
        return {
            "worse": self.worse,
            "margins": vars(self.options),
            "all": _row(self.together) if self.takes else None,
            "takes": [
                {
                    "take": take.name,
                    "names": take.kind,
                    "frames": take.frames,
                    "points": int(take.before.present.sum()),
                    **_row(take.checked),
                    "refused": [take.before.refused, take.after.refused],
                    "markers_worse": self.markers_worse(take),
                }
                for take in self.takes
            ],
            "left_out": [{"take": name, "reason": reason} for name, reason in self.left_out],
        }


def _row(checked: CheckedTake) -> dict:
    return {"recall": list(checked.recall), "wrong": list(checked.wrong)}


def _worse(what: str, checked: CheckedTake, recall: float, wrong: float) -> list[str]:
    found = []
    if checked.wrong[1] - checked.wrong[0] > wrong:
        found.append(f"{what}: {share(checked.wrong[1])} wrong names, {share(checked.wrong[0])} before")
    if checked.recall[0] - checked.recall[1] > recall:
        found.append(f"{what}: {share(checked.recall[1])} named right, {share(checked.recall[0])} before")
    return found


def share(value: float) -> str:
    """A share for people: 100 % only where nothing is missing, 0 % only where nothing is there."""
    if value in (0.0, 1.0):
        return f"{value:.0%}".replace("%", " %")
    return f"{100 * min(max(value, 0.0001), 0.9999):.2f} %"


def difference_lines(check: dict) -> list[str]:
    """A comparison, as `as_dict` has it, for people: all takes, then each that changed, with its markers."""
    lines = []
    if check["all"] is not None:
        lines.append(f"{count_of(len(check['takes']), 'take')} labelled again: {_words(check['all'])}")
    lines += [
        f"{take['take']} ({take['names']}): {_words(take)}{_marker_words(take['markers_worse'])}"
        for take in check["takes"]
        if len({*take["recall"]}) > 1 or len({*take["wrong"]}) > 1
    ]
    lines += [f"{row['take']} was not labelled again: {row['reason']}" for row in check["left_out"]]
    if check["all"] is None:
        lines.append("no take was labelled again, so nobody knows what got worse: keep labelled takes for it")
    return lines


def _words(row: dict) -> str:
    (recall, then), (wrong, wrong_then) = (reversed(row[key]) for key in ("recall", "wrong"))
    return f"{share(recall)} named right ({share(then)} before), {share(wrong)} wrong ({share(wrong_then)} before)"


def _marker_words(rows: Sequence[dict]) -> str:
    """The worst markers of a take, each with what became of it."""
    words = []
    for row in rows[:LISTED_MARKERS]:
        points = max(row["points"], 1)
        parts = [
            f"{share(min(now / points, 1.0))} {how} ({share(min(then / points, 1.0))})"
            for how in ("right", "wrong")
            for then, now in [row[how]]
            if (now < then if how == "right" else now > then)
        ]
        words.append(f"{row['marker']} {' and '.join(parts)}")
    more = len(rows) - LISTED_MARKERS
    return f"; worse: {', '.join(words)}{f' and {more} more' if more > 0 else ''}" if words else ""
