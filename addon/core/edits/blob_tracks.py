# SPDX-License-Identifier: GPL-3.0-or-later
"""The track of a blob in its camera: which blob of the frame after is the same, for as long as that is plain.

What a person says of one blob holds for its track, so a track ends where it is not plain: where the blob is not seen,
where another one comes near, or where the next may be another's. A track that ends too soon costs one more click; one
that goes over to a neighbour gives a wrong name.

`blobs.image_tracklets` asks the same while a take is labelled, in metres: there the lens is out and the subject's depth
known. Here nothing is but pixels, and no label is made yet that could tell a wrong link.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..data.takes import Blobs
from .kinds import BLOB_RADIUS_PX, BlobEdit, Edits

# When two blobs of frames that follow each other are plainly one. Measured on the second half of a recording of real
# blobs, 11 cameras of 4096 px: of 400 tracks a mean of 327 of 500 frames is followed, and 0.16 % of their blobs are
# another marker's.
TRACK_REACH_PX = 20.0  # physical: px from where its velocity leads: a hand's change of speed in a frame at 60 to 200 Hz
TRACK_APART = 3.0  # measured: times as far as the nearest blob the second must be; 2 is wrong 1.7 times as often
TRACK_APART_PX = 8.0  # measured: this far at least, as nearer ones merge and part; half of it is wrong thrice as often


@dataclass(frozen=True, eq=False)
class BlobsOfCamera:
    """The N blobs of one camera in F frames that follow each other."""

    first: int  # the source's number of the first frame
    rows: np.ndarray  # (N,) which of the take's they are, in the order of the frames
    starts: np.ndarray  # (F + 1,) where the blobs of each frame begin
    xy: np.ndarray  # (N, 2) px

    @classmethod
    def of(cls, blobs: Blobs, camera: int) -> "BlobsOfCamera":
        """Those of a camera, by its index."""
        rows = np.flatnonzero(blobs.camera == camera)
        starts = np.searchsorted(blobs.frame[rows], np.arange(len(blobs.frames) + 1))
        return cls(int(blobs.frames[0]) if len(blobs.frames) else 0, rows, starts, blobs.xy[rows])

    def at(self, frame: int, x: float, y: float) -> int | None:
        """The blob nearest to a place in a frame by its number, as an index into these; None without one so near."""
        part = self._in(frame - self.first)
        off = np.hypot(*(self.xy[part] - (x, y)).T)
        return part.start + int(off.argmin()) if len(off) and off.min() <= BLOB_RADIUS_PX else None

    def track(self, frame: int, found: int, frames: tuple[int, int]) -> np.ndarray:
        """(K,) the blobs, as indices into these, of the track of `found` in `frame` through frames around it."""
        before = self._followed(frame, found, frames[0], -1)
        return np.array([*before[::-1], found, *self._followed(frame, found, frames[1], 1)], dtype=int)

    def _followed(self, frame: int, found: int, last: int, step: int) -> list[int]:
        """The blobs that follow one, frame by frame up to the last, forwards or backwards in time."""
        at, place, velocity, track = frame - self.first, self.xy[found], None, []
        end = min(max(last - self.first, 0), len(self.starts) - 2)
        while at != end:
            here, after = self._in(at), self._in(at + step)
            next_one = _same(self.xy[here], found - here.start, self.xy[after], velocity)
            if next_one is None:
                break
            at, found = at + step, after.start + next_one
            moved = self.xy[found] - place
            velocity = moved if velocity is None else (velocity + moved) / 2
            place = self.xy[found]
            track.append(found)
        return track

    def _in(self, index: int) -> slice:
        """The blobs of frame `index`; none outside of the take."""
        if not 0 <= index < len(self.starts) - 1:
            return slice(0, 0)
        return slice(int(self.starts[index]), int(self.starts[index + 1]))


def _same(here: np.ndarray, found: int, after: np.ndarray, velocity: np.ndarray | None) -> int | None:
    """Which blob of those `after` (L, 2) px plainly is the one of those `here` (K, 2); None where none is."""
    if not len(after):
        return None
    led = here[found] if velocity is None else here[found] + velocity
    off = np.hypot(*(after - led).T)
    nearest = int(off.argmin())
    if off[nearest] > TRACK_REACH_PX:
        return None
    clear = max(TRACK_APART * off[nearest], TRACK_APART_PX)
    if len(after) > 1 and np.partition(off, 1)[1] < clear:
        return None
    # Another blob may be nearer to it, whose it is then: this one is not seen any more.
    others = np.hypot(*(here - after[nearest]).T)
    others[found] = np.inf
    return None if others.min() < max(off[nearest], TRACK_APART_PX) else nearest


class BlobTracks:
    """The tracks of a take's blobs, each followed once."""

    def __init__(self, blobs: Blobs, cameras: tuple[str, ...]):
        self.blobs, self.cameras = blobs, cameras
        self._of: dict[int, BlobsOfCamera] = {}
        self._trails: dict[tuple, np.ndarray] = {}

    def camera(self, camera: int) -> BlobsOfCamera:
        """The blobs of a camera, by its index."""
        if camera not in self._of:
            self._of[camera] = BlobsOfCamera.of(self.blobs, camera)
        return self._of[camera]

    def rows(self, row: int) -> np.ndarray:
        """(K,) the rows of the track of a row's blob, in all frames."""
        key = ("row", row)
        if key not in self._trails:
            own = self.camera(int(self.blobs.camera[row]))
            frame = int(self.blobs.frames[self.blobs.frame[row]])
            span = int(self.blobs.frames[0]), int(self.blobs.frames[-1])
            track = own.track(frame, int(np.searchsorted(own.rows, row)), span)
            self._trails[key] = own.rows[track]
        return self._trails[key]

    def followed(self, edits: Edits) -> Edits:
        """The edits, of which those of blobs in some frames know the blobs of their tracks there."""
        return edits.of(
            self._with_trail(edit) if isinstance(edit, BlobEdit) and edit.frames else edit for edit in edits
        )

    def _with_trail(self, edit: BlobEdit) -> BlobEdit:
        key = (edit.camera, edit.frame, edit.x, edit.y, edit.frames)
        if key not in self._trails:
            own = self.camera(self.cameras.index(edit.camera))
            found = own.at(edit.frame, edit.x, edit.y)
            track = np.zeros(0, int) if found is None else own.track(edit.frame, found, edit.span)
            number = self.blobs.frames[self.blobs.frame[own.rows[track]]]
            self._trails[key] = np.column_stack([number, own.xy[track]]).astype(float)
        return replace(edit, trail=self._trails[key])


def followed(edits: Edits, read: Callable[[tuple[int, int]], Iterable[Blobs]], cameras: tuple[str, ...]) -> Edits:
    """The edits of a take that is read chunk by chunk, of which those of tracks know the blobs of these.

    `read` gives the chunks of some frames, first and last. Keeps the blobs of the cameras that tracks are of and
    nothing else; reads nothing where there are none.
    """
    tracked = [edit for edit in edits if isinstance(edit, BlobEdit) and edit.frames]
    if not tracked:
        return edits
    some = [cameras.index(name) for name in {edit.camera for edit in tracked}]
    parts = []
    for chunk in read((min(edit.span[0] for edit in tracked), max(edit.span[1] for edit in tracked))):
        kept = np.isin(chunk.camera, some)
        parts.append(replace(chunk, **{name: getattr(chunk, name)[kept] for name in ("frame", "camera", "xy", "area")}))
    return BlobTracks(Blobs.join(parts), cameras).followed(edits)
