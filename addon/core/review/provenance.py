# SPDX-License-Identifier: GPL-3.0-or-later
"""Where every sample of a labelled take is from: measured, a person's, or filled; and how sure its name is."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ..data.takes import BY_EDIT, Blobs, LabelledChunk, PointRows
from ..edits.kinds import Edits, Place
from .answering import add_ranges

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
        self._hand: dict[str, list[list[int]]] = {name: [] for name in self.names}
        self._filled: dict[str, list[list[int]]] = {name: [] for name in self.names}

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
        add_ranges(self._hand, hand, frames)
        add_ranges(self._filled, brought, frames)

    def of_markers(self, fills: Iterable[Mapping], smoothed: Iterable[int] | None) -> dict[str, dict]:
        """What a report says of each marker, with fills that are no part of the chunks, as rows of a report.

        Samples that are measured, by hand, filled and missing are together all there are; how many of them are
        `smoothed` (M,) is given. `confidence` is that of the names that the program gave. Ranges of frames say what
        neither label files nor the rows of fills say.
        """
        filled = {name: {IN_INPUT: _frames_in(spans)} if spans else {} for name, spans in self._filled.items()}
        for row in fills:
            own, method = filled[row["marker"]], row["method"]
            own[method] = own.get(method, 0) + row["last"] - row["first"] + 1
        counts = zip(self.names, self._measured.tolist(), smoothed or [0] * len(self.names), strict=True)
        origins = {}
        for index, (name, measured, calm) in enumerate(counts):
            hand = _frames_in(self._hand[name])
            missing = self.frames - measured - hand - sum(filled[name].values())
            origins[name] = {
                "measured": measured, "hand": hand, "filled": filled[name], "missing": missing, "smoothed": calm,
                "confidence": self._confidence(index),
            }  # fmt: skip
            ranges = {"hand_frames": self._hand[name], "filled_in_input": self._filled[name]}
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


def _frames_in(spans: Iterable[Sequence[int]]) -> int:
    return sum(last - first + 1 for first, last in spans)
