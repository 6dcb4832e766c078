# SPDX-License-Identifier: GPL-3.0-or-later
"""What the report says of a labelled take, added up chunk by chunk: figures, and where every sample is from."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..data.takes import BY_EDIT, STEPS, Blobs, LabelledChunk, PointRows, Suspect
from ..edits.kinds import Edits, Place
from .suspects import Ranges

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
        self._latest: dict[str, int] = {}  # by what is said, where the last that says it stands among them
        count = len(self.markers)
        self._present, self._conflicts = np.zeros((2, count), np.int64)
        self._gaps = Ranges(count)
        self._residual, self._residual_px = _Means(count), _Means(count)

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
        self._present += present.sum(axis=0)
        self._gaps.add(motion.frames, ~present.T)
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

    def _add_suspect(self, suspect: Suspect):
        if (index := self._latest.get(suspect.reason)) is not None:
            last = self.suspects[index]
            if last.first - 1 <= suspect.first <= last.last + 1:
                ends = min(last.first, suspect.first), max(last.last, suspect.last)
                self.suspects[index] = replace(last, first=ends[0], last=ends[1], doubtful=last.frames + suspect.frames)
                return
        self._latest[suspect.reason] = len(self.suspects)
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
                "gaps": len(self._gaps.of[index]),
                "longest_gap": max(self._gaps.lengths(index), default=0),
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


WELL_SURE = 0.999  # format: of a name's confidence, the last step of label files below certainty
IN_INPUT = "input"  # what stands for the method of a fill that the input brought along


def by_hand(rows: Blobs | PointRows, chunk: LabelledChunk, edits: Edits, words: Mapping[str, int]) -> np.ndarray:
    """(F, M) True for the samples of a chunk that a person named or placed; words as `SampleOrigins` has them."""
    motion, labels = chunk.motion, chunk.labels
    given = np.zeros(motion.residual.shape, bool)
    edited = labels.named & (labels.step == BY_EDIT)
    given[rows.frame[edited], labels.marker[edited]] = True
    first = int(motion.frames[0])
    for edit in edits:
        if isinstance(edit, Place) and first <= edit.frame < first + len(given):
            given[edit.frame - first, words[edit.marker]] = True
    return given & np.isfinite(motion.markers).all(axis=2)


class SampleOrigins:
    """Counts where the samples of each marker are from, chunk by chunk.

    names are the M markers'; edits what a person said; words the index of each marker by all that edits may call it.
    """

    def __init__(self, names: Sequence[str], edits: Edits, words: Mapping[str, int]):
        self.names, self.edits, self.words = tuple(names), edits, words
        self.frames, count = 0, len(self.names)
        self._measured, self._names, self._sure = np.zeros((3, count), np.int64)
        self._sum, self._lowest = np.zeros(count), np.ones(count)
        self._hand, self._filled = Ranges(count), Ranges(count)

    def add(self, rows: Blobs | PointRows, chunk: LabelledChunk):
        """Adds a chunk, whose labels are row for row, and which follows the last without a break."""
        motion, labels, count = chunk.motion, chunk.labels, len(self.names)
        hand = by_hand(rows, chunk, self.edits, self.words)
        self.add_samples(motion.frames, np.isfinite(motion.markers).all(axis=2), motion.residual, hand)
        own = labels.named & (labels.step != BY_EDIT)
        marker, confidence = labels.marker[own], labels.confidence[own]
        self._names += np.bincount(marker, minlength=count)
        self._sum += np.bincount(marker, confidence, count)
        self._sure += np.bincount(marker, confidence >= WELL_SURE, count).astype(np.int64)
        np.minimum.at(self._lowest, marker, confidence)

    def add_samples(self, frames: np.ndarray, there: np.ndarray, residual: np.ndarray, hand: np.ndarray):
        """Adds frames (F,) of which is known what is `there`, its residual, m, and what is by `hand`, each (F, M)."""
        self.frames += len(frames)
        found = there & ~hand
        brought = found & (residual == 0)
        self._measured += (found & ~brought).sum(axis=0)
        self._hand.add(frames, hand.T)
        self._filled.add(frames, brought.T)

    def of_markers(self, fills: Iterable[Mapping], smoothed: Iterable[int] | None) -> dict[str, dict]:
        """What a report says of each marker, with fills that are no part of the chunks, as rows of a report.

        Samples that are measured, by hand, filled and missing are together all there are; how many of them are
        `smoothed` (M,) is given. `confidence` is that of the names that the program gave. Ranges of frames say what
        neither label files nor the rows of fills say.
        """
        brought = [sum(self._filled.lengths(index)) for index in range(len(self.names))]
        filled = {name: {IN_INPUT: one} if one else {} for name, one in zip(self.names, brought, strict=True)}
        for row in fills:
            own, method = filled[row["marker"]], row["method"]
            own[method] = own.get(method, 0) + row["last"] - row["first"] + 1
        counts = zip(self.names, self._measured.tolist(), smoothed or [0] * len(self.names), strict=True)
        origins = {}
        for index, (name, measured, calm) in enumerate(counts):
            hand = sum(self._hand.lengths(index))
            missing = self.frames - measured - hand - sum(filled[name].values())
            origins[name] = {
                "measured": measured, "hand": hand, "filled": filled[name], "missing": missing, "smoothed": calm,
                "confidence": self._confidence(index),
            }  # fmt: skip
            ranges = {"hand_frames": self._hand.spans(index), "filled_in_input": self._filled.spans(index)}
            origins[name] |= {what: spans for what, spans in ranges.items() if spans}
        return origins

    def _confidence(self, index: int) -> dict | None:
        """Of the names that the program gave a marker: how many, the lowest and mean, and what part is `WELL_SURE`."""
        names = int(self._names[index])
        if not names:
            return None
        lowest, mean, sure = self._lowest[index], self._sum[index] / names, self._sure[index] / names
        return {"names": names} | {
            what: round(float(value), 4) for what, value in (("lowest", lowest), ("mean", mean), ("sure", sure))
        }
