# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds what is the matter with a labelled take, the worst first: while it is labelled, or of all of it at once.

Of each camera's blobs it is counted how many have a name, how many beside a marker have none, and how far off they are.
"""

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from ..data.lanes import blocks
from ..data.takes import NO_MARKER, Blobs, Labels, Motion, PointRows, Suspect
from ..edits.kinds import NO_EDITS, Accepted, Edits
from ..geometry.cameras import NO_CAMERAS, Cameras
from .answering import PAIR, accepted_in, markers_meant, right_in, settled_in
from .suspects import FAR_OFF, MAX_BREAK_FRAMES, MAX_OFF_BODY_M, MOMENT_S, OF_ROOM, Ranges, cameras_in
from .trouble import (
    Leftover,
    Trouble,
    extras,
    find_leftovers,
    in_doubt,
    is_which,
    joined_leftovers,
    left_over,
    missing,
    never_found,
    nobody,
    of_cameras,
    off_body,
)

# Edges of the classes that errors, px, are counted in, which grow by 6 %: as well is their median known.
ERROR_EDGES = np.geomspace(1e-3, 1e4, 281)


class CameraBlobs:
    """Counts over the chunks of a take of blobs."""

    def __init__(self, cameras: Cameras):
        self.cameras, self.names = cameras, cameras.names
        count = len(cameras.names)
        self.blobs, self._named, self._beside = (np.zeros(count, np.int64) for _ in range(3))
        self._errors = np.zeros((count, len(ERROR_EDGES) - 1), np.int64)

    def add(self, blobs: Blobs, labels: Labels, motion: Motion):
        """Adds a chunk."""
        for frames in blocks(len(blobs.frames), len(self.names) * motion.markers.shape[1]):
            rows = slice(*np.searchsorted(blobs.frame, [frames.start, frames.stop]).tolist())
            frame = blobs.frame[rows] - frames.start
            self._add(frame, blobs.camera[rows], blobs.xy[rows], labels.marker[rows], motion, frames)

    def _add(self, frame, camera, xy, marker, motion: Motion, frames: slice):
        count = len(self.names)
        named = marker != NO_MARKER
        self.blobs += np.bincount(camera, minlength=count)
        self._named += np.bincount(camera[named], minlength=count)
        own = camera[named], frame[named], marker[named]
        error = np.linalg.norm(self.cameras.project(motion.markers[frames])[own] - xy[named], axis=1)
        known = error > 0
        np.add.at(self._errors, (own[0][known], np.searchsorted(ERROR_EDGES[1:-1], error[known], side="right")), 1)
        given = np.zeros((count, *motion.expected[frames].shape[:2]), bool)
        given[own] = True
        where = self.cameras.project(motion.expected[frames])
        where[given] = np.nan
        ahead = np.einsum("ci,fmi->cfm", self.cameras.rotation[:, 2], motion.expected[frames])
        ahead += self.cameras.translation[:, 2, None, None]
        left = camera[~named], frame[~named]
        with np.errstate(invalid="ignore", divide="ignore"):
            away = np.linalg.norm(where[left] - xy[~named][:, None], axis=2)
            near = (away < MAX_OFF_BODY_M * self.cameras.focal[left[0], None] / ahead[left]).any(axis=1)
        self._beside += np.bincount(left[0][near], minlength=count)

    def figures(self) -> dict[str, dict]:
        """What a report says of each camera.

        How many blobs it has, how many of these have a name, and how many have none beside where the body has a marker
        that has no blob in the image; and how far, px, a blob is from where its marker is in the image, median.
        """
        found = {}
        for index, name in enumerate(self.names):
            upto = np.cumsum(self._errors[index])
            place = int(np.searchsorted(upto, upto[-1] / 2))
            error = float(f"{np.sqrt(ERROR_EDGES[place] * ERROR_EDGES[place + 1]):.3g}")
            found[name] = {
                "blobs": int(self.blobs[index]),
                "named_blobs": int(self._named[index]),
                "unnamed_beside_markers": int(self._beside[index]),
                "reprojection_px": error if upto[-1] else None,
            }
        return found


class TakeTrouble:
    """Looks at a take chunk by chunk; `found` gives the list.

    names are the M markers'; edits what a person said, which answers some of it; words the index of each marker by all
    that edits may call it, its name alone unless they are given; rate in frames a second.
    """

    def __init__(
        self,
        names: Sequence[str],
        rate: float,
        edits: Edits = NO_EDITS,
        cameras: Cameras = NO_CAMERAS,
        words: Mapping[str, int] | None = None,
    ):
        self.names, self.rate, self.edits = tuple(names), rate, edits
        self.words = words or {name: index for index, name in enumerate(self.names)}
        self.by_camera = CameraBlobs(cameras)
        self.first = self.last = self.frames = self.subject_frames = 0
        count = len(self.names)
        self._missing, self._excused, self._off, self._accepted = (Ranges(count) for _ in range(4))
        self._nobody = Ranges(1)
        self._filled: dict[str, list[tuple[int, int]]] = {}
        self._left: tuple[Leftover, ...] = ()

    def add(self, rows: Blobs | PointRows, labels: Labels, motion: Motion):
        """Adds a chunk, which follows the last."""
        frames = motion.frames
        present = np.isfinite(motion.markers).all(axis=2).T
        off = np.linalg.norm(motion.markers - motion.expected, axis=2).T
        self.first = self.first if self.frames else int(frames[0])
        self.frames, self.last = self.frames + len(frames), int(frames[-1])
        here = (motion.confidence > 0) | present.any(axis=0)
        self.subject_frames += int(here.sum())
        if isinstance(rows, PointRows):
            self._left = joined_leftovers(self._left, find_leftovers(rows, labels, motion, self.rate))
        else:
            self.by_camera.add(rows, labels, motion)
        lacking = here & ~present
        with np.errstate(invalid="ignore"):
            far = off > MAX_OFF_BODY_M
        right = right_in(self.edits, self.words, frames).T
        self._nobody.add(frames, ~here[None])
        self._excused.add(frames, lacking & right)
        self._accepted.add(frames, far & right, off)
        self._missing.add(frames, lacking & ~right)
        self._off.add(frames, far & ~right, off)

    def fill(self, marker: str, first: int, last: int):
        """Notes that a marker's gap from frame `first` to `last`, by the source's numbers, was filled: no trouble."""
        self._filled.setdefault(marker, []).append((first, last))

    def found(self, suspects: Iterable[Suspect] = (), answered: Iterable[Suspect] = ()) -> tuple[Trouble, ...]:
        """All trouble, the worst first and what is answered last; suspects are the doubts, open and answered."""
        suspects, answered = tuple(suspects), tuple(answered)
        doubts, over = ([self._doubt(one) for one in some if FAR_OFF not in one.words] for some in (suspects, answered))
        found = [nobody(first, last, len(self.names)) for first, last, _, _ in self._nobody.of[0]]
        left = (Suspect(self.first, self.last, edit.doubt) for edit in self.edits if isinstance(edit, Accepted))
        alike = (markers_meant(one, self.words) for one in (*suspects, *answered, *left) if is_which(one))
        lacking = [self._judged(one) for one in self._of_missing(set(chain(*alike)))]
        found += [*lacking, *self._of_leftovers(lacking), *self._of_body(), *doubts]
        found = [self._judged(one) for one in found]
        return tuple(sorted([*found, *map(_answered, over)], key=lambda one: (one.answered, -one.stake, one.first)))

    def _judged(self, one: Trouble) -> Trouble:
        return _answered(one) if self._is_accepted(one) else one

    def _is_accepted(self, one: Trouble) -> bool:
        """Whether a person accepted what it says in all of its frames."""
        if not any(isinstance(edit, Accepted) for edit in self.edits):
            return False
        return all(accepted_in(self.edits, one.topic, np.arange(a, b + 1)).all() for a, b in one.spans)

    def _of_missing(self, alike: Container[int]) -> Iterator[Trouble]:
        """What is missing, but markers that are `alike` and so have no name: another line asks about these."""
        nowhere: list[str] = []
        for index, name in enumerate(self.names):
            beside = [one for one in self._left if one.beside == index]
            filled = self._filled.get(name, ())
            gaps = [one[:2] for one in self._missing.of[index]]
            gaps = [one for one in gaps if not any(a <= one[0] and one[1] <= b for a, b in filled)]
            lost = sum(last - first + 1 for first, last in gaps)
            if lost > MAX_BREAK_FRAMES and (beside or index not in alike):
                found = missing(name, tuple(gaps), self.subject_frames, beside)
                if lost == self.subject_frames and not beside and not self._is_accepted(found):
                    nowhere.append(name)
                else:
                    yield found
            if excused := self._excused.of[index]:
                yield _answered(missing(name, tuple(one[:2] for one in excused), self.subject_frames, beside))
        if nowhere:
            ranges = self._missing.of[self.names.index(nowhere[0])]
            yield never_found(nowhere, tuple(one[:2] for one in ranges))

    def _of_leftovers(self, lacking: Iterable[Trouble]) -> Iterator[Trouble]:
        """What is left over, but for what the line of a missing marker is about; what lacks is asked about once."""
        asked = {name for one in lacking if not one.answered for name in one.markers}
        said = {name for one in lacking if one.answered for name in one.markers} - asked
        extra = []
        for one in self._left:
            marker = "" if one.beside is None else self.names[one.beside]
            if settled_in(self.edits, one.trajectory, one.first, one.last):
                yield _answered(left_over(one, marker))
            elif not marker or marker in said:
                extra.append(one)
            elif marker not in asked:
                yield left_over(one, marker)
        if extra:
            yield extras(extra)

    def _of_body(self) -> Iterator[Trouble]:
        for off, as_found in ((self._off, lambda one: one), (self._accepted, _answered)):
            for name, ranges in zip(self.names, off.of, strict=True):
                if ranges:
                    spans, worst = tuple(one[:2] for one in ranges), int(np.argmax([one[2] for one in ranges]))
                    mean = sum(total for *_, total in ranges) / sum(last - first + 1 for first, last in spans)
                    yield as_found(off_body(name, spans, worst, ranges[worst][2], mean))

    def _doubt(self, one: Suspect) -> Trouble:
        """A doubt, with the marker-frames at stake in it."""
        if one.words.startswith(OF_ROOM):
            return of_cameras(one, (), float(one.frames * len(self.names)))  # no name can be relied on
        if cameras := cameras_in(one.words, self.by_camera.names):
            blobs = sum(int(self.by_camera.blobs[self.by_camera.names.index(name)]) for name in cameras)
            return of_cameras(one, cameras, blobs / max(len(self.by_camera.names), 1))
        frames = float(one.frames)
        if one.trajectory is not None and len(one.markers) == PAIR:  # a change of names; in the gap there is none
            frames = min(frames, MOMENT_S * self.rate)
        on_body = any(
            left.trajectory == one.trajectory and left.first <= one.last and one.first <= left.last
            for left in self._left
        )
        return in_doubt(one, on_body, frames * max(len(one.markers), 1))


def _answered(one: Trouble) -> Trouble:
    return replace(one, stake=0.0, answered=True)
