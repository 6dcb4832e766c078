# SPDX-License-Identifier: GPL-3.0-or-later
"""How good a labelling is, in the contract's figures, when the truth is known."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count

import numpy as np

NOTHING = -1
# A name that is not a marker of the model: right on no blob, and a blob that bears it in truth should stay unnamed.
FOREIGN = -2


@dataclass(frozen=True)
class Counts:
    """Whole numbers behind the figures of a labelling, or of one marker in it."""

    given: int  # labels given
    right: int  # of them, right ones
    present: int  # blobs of real markers
    found: int  # of them, labelled right
    absent: int  # how often a marker got no label in an image, whether it was there or not
    missed: int  # of those, how often it was there, and no label of a merged blob stands for it
    spoilt: int  # frames in which a blob is not right
    frames: int  # all frames

    def as_dict(self) -> dict[str, float | int | None]:
        """The contract's figures by name, None where there is nothing to divide by, and the counts behind them."""
        precision, recall, f1 = _ratio(self.right, self.given), _ratio(self.found, self.present), None
        if precision is not None and recall is not None:
            f1 = 2 * precision * recall / (precision + recall) if precision + recall else 0.0
        return {
            "precision": precision,
            "recall": recall,
            "f1": f1,
            "false_assignments": _ratio(self.given - self.right, self.given),
            "false_occlusions": _ratio(self.missed, self.absent),
            "perfect_frames": _ratio(self.frames - self.spoilt, self.frames),
            "labels": self.given,
            "right": self.right,
            "wrong": self.given - self.right,
            "marker_blobs": self.present,
            "frames": self.frames,
        }


@dataclass
class Figures:
    """Adds up a labelling chunk by chunk and gives the contract's figures.

    markers   the model's; a truth name that is not among them counts as no marker. None: every name counts. NAME:MARKER
              is a marker of its own, of one of several subjects, which is as well one of these
    aliases   other names of a marker, {alias: name}, understood in labels and in the truth
    """

    markers: Sequence[str] | None = None
    aliases: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self):
        self._index: dict[str, int] = {name: index for index, name in enumerate(self.markers or ())}
        self._texts: defaultdict[str, int] = defaultdict(count().__next__)  # numbered as they are first asked for
        self._members: list[tuple[int, ...]] = []
        self._total = np.zeros(5, dtype=np.int64)  # labels, right ones, blobs of markers, frames, frames with errors
        self._views = 0
        self._names = np.zeros((0, 7), dtype=np.int64)
        self._steps: dict[str, list[int]] = {}
        self._swaps: Counter[tuple[int, int]] = Counter()

    def add(
        self,
        frame: Sequence[int],
        camera: Sequence | None,
        labels: Sequence[str],
        truth: Sequence[str],
        step: Sequence[str] | None = None,
    ) -> "Figures":
        """Counts N blobs of whole frames: a frame's blobs must all come in one call. Returns itself.

        frame (N,), camera (N,) numbers or names, None for 3D points; labels (N,) text, empty where unnamed;
        truth (N,) text, empty for a ghost, names joined with `|` for a merged blob; step (N,) text.
        """
        lengths = {len(column) for column in (frame, camera, labels, truth, step) if column is not None}
        if len(lengths) != 1:
            raise ValueError("columns of different lengths; expected one value for every blob")
        known = {name: self._code(name) for name in set(labels)}
        label = np.fromiter(map(known.__getitem__, labels), dtype=np.int64, count=len(labels))
        text = self._text_codes(truth)
        frames, frame_of = np.unique(np.asarray(frame), return_inverse=True)
        views, view = _views(frame_of, camera)
        room = np.zeros((len(self._index) - len(self._names), self._names.shape[1]), dtype=np.int64)
        self._names = np.concatenate([self._names, room])  # for names that were not there before
        rows = _Rows(frame_of, view, label, text, *self._truth_tables())
        self._count(rows, len(frames), views)
        if step is not None:
            self._count_steps(np.asarray(step, dtype=object), rows)
        return self

    @property
    def total(self) -> Counts:
        """The counts over all markers."""
        several = any(":" in name for name in self._index)
        # Where subjects have names, markers of nobody are none that could be there.
        markers = int(self._names.any(axis=1).sum()) if several else len(self._index)
        occluded = self._views * markers - int(self._names[:, 4].sum())
        given, right, present, frames, spoilt = self._total.tolist()
        return Counts(given, right, present, right, occluded, int(self._names[:, 5].sum()), spoilt, frames)

    def marker(self, name: str) -> Counts:
        """The counts of one marker; `spoilt` are the frames in which its name or its blob is in an error."""
        given, right, present, found, seen, missed, spoilt = self._names[self._index[name]].tolist()
        return Counts(given, right, present, found, self._views - seen, missed, spoilt, int(self._total[3]))

    @property
    def swaps(self) -> dict[tuple[str, str], int]:
        """Pairs of markers that had each other's name in the same image, most frequent first."""
        names = list(self._index)
        return {(names[a], names[b]): count for (a, b), count in self._swaps.most_common()}

    def as_dict(self) -> dict:
        """All figures, ready for JSON."""
        figures: dict[str, object] = {**self.total.as_dict()}
        figures["per_marker"] = {name: self.marker(name).as_dict() for name in self._index}
        figures["steps"] = {
            step: {"labels": given, "right": right, "precision": _ratio(right, given)}
            for step, (given, right) in sorted(self._steps.items())
        }
        figures["swaps"] = [{"markers": list(pair), "count": count} for pair, count in self.swaps.items()]
        return figures

    def _code(self, name: str) -> int:
        """The number of one marker's name."""
        if not name:
            return NOTHING
        subject, colon, own = name.rpartition(":")
        name = f"{subject}{colon}{self.aliases.get(own, own)}"
        known = self.markers is None or (subject and self.aliases.get(own, own) in self._index)
        return self._index.setdefault(name, len(self._index)) if known else self._index.get(name, FOREIGN)

    def _text_codes(self, truth: Sequence[str]) -> np.ndarray:
        """(N,) numbers of truth texts; `_members` has the markers that each stands for."""
        codes = np.fromiter(map(self._texts.__getitem__, truth), dtype=np.int64, count=len(truth))
        for text in list(self._texts)[len(self._members) :]:
            codes_of = (self._code(name) for name in text.split("|"))
            self._members.append(tuple(sorted({code for code in codes_of if code >= 0})))
        return codes

    def _truth_tables(self) -> tuple[np.ndarray, np.ndarray]:
        """(texts, markers) whether a text stands for a marker; and the members of the texts, (members, 2) pairs."""
        members = [(text, marker) for text, several in enumerate(self._members) for marker in several]
        pairs = np.array(members, dtype=np.int64).reshape(-1, 2)
        stands_for = np.zeros((len(self._members), len(self._index)), dtype=bool)
        stands_for[pairs[:, 0], pairs[:, 1]] = True
        return stands_for, pairs

    def _count(self, rows: "_Rows", frames: int, views: int):
        count, width = len(self._index), max(len(self._index), 1)
        given, right, real = rows.given, rows.right, rows.real
        wrong = np.where(real, ~right, given)
        self._total += [given.sum(), right.sum(), real.sum(), frames, len(np.unique(rows.frame[wrong]))]
        self._views += views
        named = rows.label >= 0
        row, member = rows.members()
        label_of = np.bincount(rows.label[named], minlength=count)
        right_of = np.bincount(rows.label[right], minlength=count)
        present_of = np.bincount(member, minlength=count)
        found_of = np.bincount(member[right[row]], minlength=count)
        seen = np.unique(rows.view[named] * width + rows.label[named])
        there = np.unique(rows.view[row] * width + member)
        stood_for = np.unique((rows.view[row] * width + member)[right[row]])
        missed = np.setdiff1d(np.setdiff1d(there, seen, assume_unique=True), stood_for, assume_unique=True)
        errors = np.concatenate([rows.frame[row] * width + member, rows.frame[named] * width + rows.label[named]])
        spoilt = np.unique(errors[np.concatenate([wrong[row], wrong[named]])])
        columns = [label_of, right_of, present_of, found_of]
        columns += [np.bincount(pairs % width, minlength=count) for pairs in (seen, missed, spoilt)]
        self._names += np.stack(columns, axis=1)[:count]
        self._count_swaps(rows, row, member, wrong, width)

    def _count_swaps(self, rows: "_Rows", row: np.ndarray, member: np.ndarray, wrong: np.ndarray, width: int):
        mixed = wrong[row] & (rows.label[row] >= 0)
        view, true, called = rows.view[row][mixed], member[mixed], rows.label[row][mixed]
        there = np.unique((view * width + true) * width + called)
        back = (there // width**2 * width + there % width) * width + there // width % width
        both = there[np.isin(there, back, assume_unique=True)]
        first, second = both // width % width, both % width
        pairs = np.stack([first, second], axis=1)[first < second]
        self._swaps.update(map(tuple, pairs.tolist()))

    def _count_steps(self, step: np.ndarray, rows: "_Rows"):
        for name in set(step[rows.given]):
            chosen = rows.given & (step == name)
            before = self._steps.setdefault(str(name), [0, 0])
            before[0] += int(chosen.sum())
            before[1] += int((rows.right & chosen).sum())


class _Rows:
    """The blobs of one call: frame, view and label (N,) as whole numbers, and how label and truth agree."""

    def __init__(self, frame, view, label, text, stands_for, pairs):
        self.frame, self.view, self.label = frame, view, label
        self._text, self._pairs = text, pairs
        self._first = np.searchsorted(pairs[:, 0], np.arange(len(stands_for) + 1))
        self.given = label != NOTHING
        self.real = (np.diff(self._first) > 0)[text]
        self.right = np.zeros(len(label), dtype=bool)
        named = np.flatnonzero(label >= 0)
        self.right[named] = stands_for[text[named], label[named]]

    def members(self) -> tuple[np.ndarray, np.ndarray]:
        """Every pair of a blob and a marker that is in it: row numbers and marker numbers."""
        sizes = np.diff(self._first)[self._text]
        row = np.repeat(np.arange(len(self._text)), sizes)
        within = np.arange(len(row)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        return row, self._pairs[self._first[self._text[row]] + within, 1]


def _views(frame: np.ndarray, camera: Sequence | None) -> tuple[int, np.ndarray]:
    """How many images (a frame of a camera) there are, and the number of each blob's."""
    if camera is None:
        return int(frame.max(initial=-1)) + 1, frame
    cameras, camera_of = np.unique(np.asarray(camera), return_inverse=True)
    views, view = np.unique(frame * max(len(cameras), 1) + camera_of, return_inverse=True)
    return len(views), view


def _ratio(part: int, whole: int) -> float | None:
    return part / whole if whole else None
