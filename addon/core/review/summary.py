# SPDX-License-Identifier: GPL-3.0-or-later
"""What the report says of a labelled take, added up chunk by chunk: memory does not grow with the take."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..data.takes import STEPS, LabelledChunk, Suspect

MM_PER_M = 1000.0


class TakeSummary:
    """Counts and means over all chunks of one take, marker by marker.

    frames, rows, unlabelled   numbers of them so far; rows are blobs or points, unlabelled those without a name
    lost                       frames in which nobody was found
    whole                      frames in which every marker is in space that is found anywhere in the take
    steps                      labels given by each step
    seconds                    time by stage, as the chunks have it
    suspects                   ranges of frames with a reason; those that touch and have the same reason are one
    """

    def __init__(self, markers: Sequence[str]):
        self.markers = tuple(markers)
        self.frames = self.rows = self.unlabelled = self.lost = self.whole = 0
        self.steps = dict.fromkeys(STEPS[1:], 0)
        self.seconds: dict[str, float] = {}
        self.suspects: list[Suspect] = []
        count = len(self.markers)
        self._present = np.zeros(count, np.int64)
        self._gaps = np.zeros(count, np.int64)
        self._longest = np.zeros(count, np.int64)
        self._open = np.zeros(count, np.int64)
        self._conflicts = np.zeros(count, np.int64)
        self._residual = _Means(count)
        self._residual_px = _Means(count)

    def add(self, chunk: LabelledChunk):
        """Adds a chunk, whose labels are row for row, and which follows the last without a break."""
        motion, labels = chunk.motion, chunk.labels
        self.frames += len(motion.frames)
        self.rows += len(labels.marker)
        self.unlabelled += int((~labels.named).sum())
        self.lost += int((motion.confidence == 0).sum())
        for step, count in zip(STEPS[1:], np.bincount(labels.step, minlength=len(STEPS))[1:], strict=True):
            self.steps[step] += int(count)
        present = np.isfinite(motion.markers).all(axis=2)
        self._add_whole(present)
        self._add_gaps(present)
        self._conflicts += motion.conflicts.sum(axis=0, dtype=np.int64)
        self._residual.add(motion.residual)
        self._residual_px.add(motion.residual_px)
        for suspect in chunk.suspects:
            self._add_suspect(suspect)
        for stage, seconds in chunk.seconds.items():
            self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds

    def _add_whole(self, present: np.ndarray):
        """Adds frames (F, M) of who was there; where a marker comes up that never did, no earlier frame was whole."""
        known = (self._present > 0) | present.any(axis=0)
        fresh = known & (self._present == 0)
        since = int(present[:, fresh].argmax(axis=0).max(initial=0))
        whole = present[:, known].all(axis=1) & present.any(axis=1)
        self.whole = int(whole[since:].sum()) + (0 if fresh.any() else self.whole)

    def _add_gaps(self, present: np.ndarray):
        """Adds frames (F, M) of who was there; a gap that is open at the end may go on in the next chunk."""
        self._present += present.sum(axis=0)
        for here in present:
            self._gaps += ~here & (self._open == 0)
            self._open = np.where(here, 0, self._open + 1)
            np.maximum(self._longest, self._open, out=self._longest)

    def _add_suspect(self, suspect: Suspect):
        for index in range(len(self.suspects) - 1, max(len(self.suspects) - 8, 0) - 1, -1):
            last = self.suspects[index]
            if last.reason == suspect.reason and last.first - 1 <= suspect.first <= last.last + 1:
                ends = min(last.first, suspect.first), max(last.last, suspect.last)
                self.suspects[index] = replace(last, first=ends[0], last=ends[1], doubtful=last.frames + suspect.frames)
                return
        self.suspects.append(suspect)

    def of_markers(self) -> dict[str, dict]:
        """For each marker: frames in which it is in space, gaps, the longest of them, mean residuals, conflicts.

        A gap is a run of frames in which the marker is not in space. Residuals are in mm and px, None where there are
        none; conflicts count the marker's blobs that were in conflict.
        """
        residual, residual_px = self._residual.values() * MM_PER_M, self._residual_px.values()
        return {
            name: {
                "labelled_frames": int(self._present[index]),
                "gaps": int(self._gaps[index]),
                "longest_gap": int(self._longest[index]),
                "mean_residual_mm": _number(residual[index]),
                "mean_residual_px": _number(residual_px[index]),
                "conflicts": int(self._conflicts[index]),
            }
            for index, name in enumerate(self.markers)
        }


class _Means:
    """Means over time of values (F, M) that may be missing."""

    def __init__(self, count: int):
        self.sum, self.count = np.zeros(count), np.zeros(count, np.int64)

    def add(self, values: np.ndarray):
        self.sum += np.nansum(values, axis=0)
        self.count += np.isfinite(values).sum(axis=0)

    def values(self) -> np.ndarray:
        return np.where(self.count > 0, self.sum / np.maximum(self.count, 1), np.nan)


def _number(value: float) -> float | None:
    return float(f"{value:.4g}") if np.isfinite(value) else None
