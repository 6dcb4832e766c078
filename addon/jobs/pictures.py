# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs from movies and image sequences of calibrated cameras, from files to a file; memory does not grow with them."""

import re
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

import numpy as np

from ..blendfile import opened_pictures
from ..core.data.errors import InputError, JobError
from ..core.data.progress import Progress
from ..core.data.takes import Blobs, evenly_spread
from ..core.data.wording import words_of_frames
from ..core.geometry.cameras import Cameras
from ..core.pictures.spots import Brightness, SpotOptions, brightness_of, find_spots
from ..io.blobs import BlobWriter
from ..io.whole import whole_file
from .job import RoomJob

# Where (0, 0) of a calibration's pixels is, and how far that is from the middle of the first pixel.
CENTRE, CORNER = "centre", "corner"
FIRST_PIXEL = {CENTRE: 0.0, CORNER: 0.5}


# How pictures of a take are read; assumed.
LOOKED_AT = 12  # frames of each camera, spread over the take, that say what is dark and what is bright
MOST_SPOTS = 2000  # of a picture; more of them are no markers, and the threshold is in the noise or the room is lit
SAME_RATE = 0.01  # how far rates of movies may differ, parts of them: some write 29.97 as 30
# numbers without a picture between the first and the last; a folder with more has some other numbers
MAX_MISSING = 100_000
SAME_SIZE_PX = 0.6  # how far a picture's sides may be from the calibration's, px: some keep half pixels


@dataclass(frozen=True, kw_only=True)
class PicturesJob(RoomJob):
    """Which pictures to make a file of blobs of."""

    # a movie, a folder of numbered pictures or one of these for each camera, by the camera's name
    pictures: Mapping[str, Path]
    # where (0, 0) of the calibration's pixels is, CENTRE or CORNER of the first; None for what its kind says
    first_pixel: str | None = None
    spots: SpotOptions = field(default_factory=SpotOptions)


def blobs_of_pictures(job: PicturesJob) -> Generator[Progress, None, dict]:
    """Writes the blobs and returns what there is to say; Blender is used between two steps only.

    Raises InputError for what cannot be used, and JobError where no picture shows a spot; with the file where it can
    be told.
    """
    begin = perf_counter()
    cameras, files = job.opened()
    used = {name: index_of(name, cameras.names) for name in job.pictures}
    shift = FIRST_PIXEL[job.first_pixel or first_pixel_of(job.cameras)]
    read = [path for path in job.pictures.values() if path.is_file()]
    with (
        whole_file(job.out, job.overwrite, [*files, *read]) as target,
        opened_pictures(job.pictures.values()) as opened,
    ):
        views = dict(zip(used.values(), opened, strict=True))
        for index, view in views.items():
            check_size(view.size, cameras, index, view.path)
        rate, (first, last) = _rate(opened), _frames(opened, job)
        yield Progress(0.0, "what is bright")
        brightness = yield from _brightness(views, cameras, job.spots, first, last)
        counts = dict.fromkeys(views, 0)
        with BlobWriter(target, cameras) as writer:
            for frame in range(first, last + 1):
                blobs = _of_frame(frame, views, brightness, job.spots, shift)
                writer.write(blobs)
                for index in counts:
                    counts[index] += int((blobs.camera == index).sum())
                share = (frame - first + 1) / (last - first + 1)
                yield Progress(0.05 + 0.95 * share, f"frame {frame}")
        if not sum(counts.values()):
            raise JobError(
                "no picture shows a bright round spot; expected markers that are lit, or another --threshold"
            )
    return {
        "out": str(job.out),
        "frames": last - first + 1,
        "first_frame": first,
        "rate": rate,
        "blobs": sum(counts.values()),
        "first_pixel": job.first_pixel or first_pixel_of(job.cameras),
        "cameras": {
            cameras.names[index]: {
                "pictures": str(views[index].path),
                "blobs": counts[index],
                "threshold": round(brightness[index].threshold, 4),
            }
            for index in sorted(views)
        },
        "notes": [*_notes(views, cameras, first, last)],
        **({"calibration": list(cameras.remarks)} if cameras.remarks else {}),
        "seconds": round(perf_counter() - begin, 3),
    }


def pictures_by_camera(paths: Sequence[tuple[str | None, Path]], names: Sequence[str]) -> dict[str, Path]:
    """Pictures by the cameras that took them: the one that was said, else the one that the file's name has in it.

    Raises InputError where a camera is not among `names`, cannot be told, or is there twice.
    """
    found: dict[str, Path] = {}
    for given, path in paths:
        name = camera_in(path, names) if given is None else names[index_of(given, names)]
        if name in found:
            words = f"is of camera {name}, and so is {found[name].name}"
            raise InputError(f"{words}; expected each camera once, see CAMERA=PICTURES", path)
        found[name] = path
    return found


def camera_in(path: Path, names: Sequence[str]) -> str:
    """The camera whose name the file's has in it, or its folder's where it is a numbered picture's; the longest."""
    stem = path.name if path.is_dir() else path.stem
    for text in (stem, path.parent.name):
        own = [name for name in names if re.search(rf"(?<![^\W_]){re.escape(name)}(?![^\W_])", text, re.IGNORECASE)]
        longest = [name for name in own if len(name) == max(map(len, own))]
        if len(longest) == 1:
            return longest[0]
    raise InputError(
        f"has no camera's name in its own; expected one of {', '.join(names[:12])}, or CAMERA=PICTURES", path
    )


def index_of(name: str, names: Sequence[str]) -> int:
    """The index of a camera; InputError where the calibration has none of that name."""
    if name not in names:
        raise InputError(f"the calibration has no camera {name}; expected one of {', '.join(names[:12])}")
    return list(names).index(name)


def first_pixel_of(cameras: Path | Cameras) -> str:
    """Where (0, 0) is where nobody says it: Blender's pictures begin at a corner, OpenCV's pixels at a middle."""
    return CORNER if isinstance(cameras, Path) and cameras.suffix.lower() == ".blend" else CENTRE


def check_size(size: Sequence[float], cameras: Cameras, index: int, path: Path | str = ""):
    """Raises InputError where pictures (width, height) px are not of the size that a camera was calibrated for."""
    wanted = cameras.size[index]
    if not (wanted > 0).all():  # some calibrations do not say it
        return
    if np.abs(wanted - size).max() > SAME_SIZE_PX:
        words = f"is {size[0]:g} × {size[1]:g} px, and camera {cameras.names[index]} {wanted[0]:g} × {wanted[1]:g}"
        raise InputError(f"{words}; expected pictures as large as those that were calibrated", path)


def _rate(opened: Sequence) -> float | None:
    """Frames a second of all movies, None where there is none; InputError where they differ."""
    told = [view for view in opened if view.rate]
    for view in told[1:]:
        if abs(view.rate - told[0].rate) > SAME_RATE * told[0].rate:
            words = f"has {view.rate:g} frames a second, and {told[0].path.name} {told[0].rate:g}"
            raise InputError(f"{words}; expected cameras that ran together", view.path)
    return round(told[0].rate, 4) if told else None


def _frames(opened: Sequence, job: PicturesJob) -> tuple[int, int]:
    first, last = min(view.first for view in opened), max(view.last for view in opened)
    wanted = job.frames or (None, None)
    begin = first if wanted[0] is None else max(first, wanted[0])
    end = last if wanted[1] is None else min(last, wanted[1])
    for view in opened:
        if view.missing > MAX_MISSING:
            words = f"has no picture for {view.missing} numbers between {view.first} and {view.last}"
            raise InputError(f"{words}; expected pictures that are numbered by their frames", view.path)
    if begin > end:
        raise InputError(f"the pictures are of {words_of_frames(first, last)}; expected --frames among these")
    return begin, end


def _brightness(
    views: Mapping, cameras: Cameras, options: SpotOptions, first: int, last: int
) -> Generator[Progress, None, dict[int, Brightness]]:
    """What is dark and what is bright for each camera, by some of its pictures."""
    found = {}
    for number, (index, view) in enumerate(views.items()):
        frames = np.arange(max(first, view.first), min(last, view.last) + 1)
        pictures = []
        for frame in frames[evenly_spread(len(frames), LOOKED_AT)] if len(frames) else ():
            picture = view.grey(int(frame))
            if picture is not None:
                pictures.append(picture)
            yield Progress(0.05 * number / len(views), f"what is bright for {cameras.names[index]}")
        if not pictures:
            raise InputError(
                f"has no picture in {words_of_frames(first, last)}; expected some of each camera", view.path
            )
        found[index] = brightness_of(pictures, options)
    return found


def _of_frame(
    frame: int, views: Mapping, brightness: Mapping[int, Brightness], options: SpotOptions, shift: float
) -> Blobs:
    """The blobs of all cameras in one frame; InputError where a picture shows more than any room has markers."""
    camera, xy, area = [np.zeros(0, int)], [np.zeros((0, 2))], [np.zeros(0)]
    for index, view in sorted(views.items()):
        picture = view.grey(frame)
        if picture is None:
            continue
        spots = find_spots(picture, brightness[index], options)
        if len(spots) > MOST_SPOTS:
            words = f"shows {len(spots)} bright spots in frame {frame}"
            raise InputError(f"{words}; expected markers in a dark room, or another --threshold", view.path)
        camera.append(np.full(len(spots), index))
        xy.append(spots.xy + shift)
        area.append(spots.area)
    rows = np.concatenate(camera)
    return Blobs(np.array([frame]), np.zeros(len(rows), int), rows, np.concatenate(xy), np.concatenate(area))


def _notes(views: Mapping, cameras: Cameras, first: int, last: int) -> list[str]:
    """What a person should know of cameras that lack some frames, or all."""
    notes = []
    for index, view in sorted(views.items()):
        if view.first > first or view.last < last:
            notes.append(f"{cameras.names[index]} has pictures of {words_of_frames(view.first, view.last)} only")
    missing = [name for index, name in enumerate(cameras.names) if index not in views]
    if missing:
        notes.append(f"no pictures of {', '.join(missing)}")
    return notes
