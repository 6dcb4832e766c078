# SPDX-License-Identifier: GPL-3.0-or-later
"""Movies and image sequences as grey pictures, by Blender's own reading, frame by frame, without a window or a GPU.

A movie's frame is had as an image texture has it: the texture's image user says which one, evaluating the texture at
one place makes Blender decode it, and the image's pixels are that frame's from then on. The tracks of Blender's movie
clips are blobs: a marker's place in a clip is in parts of its picture, (0, 0) the lower left corner, with the lens in
it. Frame 1 of a clip is the scene's frame in which it starts.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import bpy
import numpy as np

from ..core.data.errors import InputError
from ..core.data.takes import Blobs

FIRST_FRAME = 1  # of a movie, as Blender counts
CACHE_MB = 256  # of decoded frames that Blender keeps where nobody looks at them; eight movies are read side by side
EXPECTED = "expected a movie, a folder of numbered pictures or one of these, of a kind that Blender opens"


class Movie:
    """A movie that is read frame by frame.

    size     (width, height) px
    first    number of its first frame, and `last` of its last
    rate     frames a second
    missing  frames between these without a picture
    """

    missing = 0

    def __init__(self, path: Path):
        self.path = path
        clip = _loaded(bpy.data.movieclips, path)
        try:
            self.rate = float(clip.fps)
        finally:
            bpy.data.movieclips.remove(clip)
        self._open()
        self.size = _size(self._image, path)
        self.first, self.last = FIRST_FRAME, FIRST_FRAME + self._image.frame_duration - 1

    def _open(self):
        self._image = _loaded(bpy.data.images, self.path)
        _size(self._image, self.path)
        self._texture = bpy.data.textures.new(self._image.name, "IMAGE")
        self._texture.image = self._image
        self._texture.image_user.frame_duration = self._image.frame_duration

    def grey(self, frame: int) -> np.ndarray | None:
        """A frame as (H, W) brightness from 0 to 1, row 0 at the top; None where there is none."""
        if not self.first <= frame <= self.last:
            return None
        try:
            return self._decoded(frame - self.first + 1)
        except ReferenceError:  # somebody undid something meanwhile, which takes new data away
            self.close()
            self._open()
            return self._decoded(frame - self.first + 1)

    def _decoded(self, number: int) -> np.ndarray:
        self._texture.image_user.frame_current = number
        self._texture.evaluate((0.0, 0.0, 0.0))
        return _grey(self._image)

    def close(self):
        """Lets go of the file."""
        for kind, item in ((bpy.data.textures, self._texture), (bpy.data.images, self._image)):
            with suppress(ReferenceError):  # it is gone already
                kind.remove(item)


class Sequence:
    """Numbered pictures, which are read one by one; a number that is missing is a frame without a picture.

    size     (width, height) px of the first
    first    number of the first, and `last` of the last
    rate     None, as nobody knows
    missing  numbers between these without a picture
    """

    rate = None

    def __init__(self, path: Path, files: dict[int, Path]):
        self.path, self.files = path, files
        self.first, self.last = min(files), max(files)
        self.missing = self.last - self.first + 1 - len(files)
        self.size = None
        self.grey(self.first)

    def grey(self, frame: int) -> np.ndarray | None:
        """See `Movie.grey`."""
        if frame not in self.files:
            return None
        path = self.files[frame]
        image = _loaded(bpy.data.images, path)
        try:
            size = _size(image, path)
            self.size = self.size or size
            if size != self.size:
                words = f"is {size[0]} × {size[1]} px, and the first of its sequence {self.size[0]} × {self.size[1]}"
                raise InputError(f"{words}; expected pictures of one size", path)
            return _grey(image)
        finally:
            bpy.data.images.remove(image)

    def close(self):
        """Nothing is held."""


@contextmanager
def small_cache() -> Iterator[None]:
    """Keeps Blender from filling gigabytes with frames that nobody asks for twice; with a window users say how many."""
    system = bpy.context.preferences.system
    before = system.memory_cache_limit
    if bpy.app.background:
        system.memory_cache_limit = min(before, CACHE_MB)
    try:
        yield
    finally:
        if bpy.app.background:
            system.memory_cache_limit = before


def open_pictures(path: Path) -> Movie | Sequence:
    """A movie or an image sequence, which is to be closed; InputError for what Blender cannot read."""
    path = Path(path)
    if path.is_dir():
        return Sequence(path, _numbered(path))
    if not path.is_file():
        raise InputError(f"there is no such file; {EXPECTED}", path)
    suffix = path.suffix.lower()
    if suffix in bpy.path.extensions_movie:
        return Movie(path)
    if suffix in bpy.path.extensions_image:
        return Sequence(path, _numbered(path.parent, path))
    raise InputError(f"is neither a movie nor a picture by its ending; {EXPECTED}", path)


def _numbered(folder: Path, like: Path | None = None) -> dict[int, Path]:
    """The pictures of a folder by the last number in their names; `like` names one whose sequence is wanted."""
    series: dict[tuple[str, str], dict[int, Path]] = {}
    wanted = None
    for path in sorted(folder.iterdir()):
        digits = re.fullmatch(r"(.*?)(\d{1,9})(\D*)", path.stem, re.ASCII)
        if path.suffix.lower() not in bpy.path.extensions_image or digits is None:
            continue
        key = (digits[1], digits[3] + path.suffix.lower())
        series.setdefault(key, {})[int(digits[2])] = path
        if like is not None and path.name == like.name:
            wanted = key
    if like is not None:
        if wanted is None:
            raise InputError(f"is a picture without a number; {EXPECTED}", like)
        return series[wanted]
    if len(series) != 1:
        what = "no numbered pictures" if not series else f"{len(series)} sequences of pictures"
        raise InputError(f"holds {what}; expected one sequence, numbered by its frames", folder)
    return next(iter(series.values()))


def _loaded(collection, path: Path):
    """A new datablock of a file; InputError where Blender cannot read it."""
    try:
        return collection.load(str(path))
    except RuntimeError as error:
        raise InputError(f"cannot be read by Blender; {EXPECTED}", path) from error


def _size(image: bpy.types.Image, path: Path) -> tuple[int, int]:
    width, height = image.size
    if not width or not height:
        raise InputError(f"cannot be read by Blender; {EXPECTED}", path)
    # So that numbers of more than eight bits come as they are in the file, as those of eight do.
    image.colorspace_settings.is_data = True
    return width, height


def _grey(image: bpy.types.Image) -> np.ndarray:
    """Brightness (H, W) of an image, row 0 at the top: its brightest channel, as lamps of markers may be red."""
    width, height = image.size
    channels = image.channels
    values = np.empty(width * height * channels, np.float32)
    image.pixels.foreach_get(values)
    values = values.reshape(height, width, channels)[::-1]
    return values[..., 0] if channels < 3 else np.maximum(np.maximum(values[..., 0], values[..., 1]), values[..., 2])


SOLVER_CONSTRAINTS = {"CAMERA_SOLVER"}
# Their terms by their names in Blender; without any of them a lens of each kind is none.
OTHER_LENSES = {"DIVISION": ("division_k1", "division_k2"), "NUKE": ("nuke_k1", "nuke_k2", "nuke_p1", "nuke_p2")}
NO_AREA = np.nan  # a track's box is drawn by hand


def clip_of(camera: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.MovieClip | None:
    """The clip that a camera is solved by or shows in its background; None where there is none."""
    solvers = [one for one in camera.constraints if one.type in SOLVER_CONSTRAINTS]
    pictures = [one for one in camera.data.background_images if one.source == "MOVIE_CLIP"]
    clips = [scene.active_clip if one.use_active_clip else one.clip for one in solvers]
    clips += [scene.active_clip if one.use_camera_clip else one.clip for one in pictures]
    return next((clip for clip in clips if clip is not None), None)


def blobs_of_clips(clips: Mapping[int, bpy.types.MovieClip], size: np.ndarray, shift: float) -> Blobs:
    """The tracks of clips, by the index of their camera, in the scene's frames; markers that are muted are none.

    `size` (C, 2) px is that of the cameras' pictures, `shift` px how far their (0, 0) is from the upper left corner of
    the first pixel, 0.5 where it is its middle. InputError where there is no marker at all.
    """
    rows = [row for index, clip in clips.items() for row in _markers(clip, index)]
    if not rows:
        raise InputError("the clips have no tracks with markers; expected some that are tracked and not muted")
    table = np.array(rows)
    frame, camera = table[:, 0].astype(int), table[:, 1].astype(int)
    order = np.lexsort((camera, frame))
    frame, camera, place = frame[order], camera[order], table[order, 2:]
    xy = np.column_stack([place[:, 0], 1 - place[:, 1]]) * size[camera] - shift
    first = int(frame[0])
    return Blobs(np.arange(first, frame[-1] + 1), frame - first, camera, xy, np.full(len(frame), NO_AREA))


def _markers(clip: bpy.types.MovieClip, camera: int) -> list[tuple[int, int, float, float]]:
    """Frame of the scene, camera, and place of each marker that is not muted."""
    tracks = [track for item in clip.tracking.objects for track in item.tracks]
    return [
        (marker.frame + clip.frame_start - 1, camera, marker.co[0] + track.offset[0], marker.co[1] + track.offset[1])
        for track in tracks
        for marker in track.markers
        if not marker.mute
    ]


def lens_of(clip: bpy.types.MovieClip) -> list[float]:
    """k1, k2, p1, p2, k3 of a clip, in OpenCV's sense, which Blender's polynomial has too; InputError for others."""
    lens = clip.tracking.camera
    if lens.distortion_model == "POLYNOMIAL":
        return [lens.k1, lens.k2, 0.0, 0.0, lens.k3]
    if lens.distortion_model == "BROWN" and not (lens.brown_k4 or lens.brown_p1 or lens.brown_p2):
        return [lens.brown_k1, lens.brown_k2, 0.0, 0.0, lens.brown_k3]
    terms = OTHER_LENSES.get(lens.distortion_model, ())
    if terms and not any(getattr(lens, term) for term in terms):
        return [0.0] * 5
    kind = lens.distortion_model.title()
    words = f"clip {clip.name} has a lens of the kind {kind}, or with terms that OpenCV's has not"
    raise InputError(f"{words}; expected Polynomial, or Brown with K1 to K3 only")
