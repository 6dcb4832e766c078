# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracks of Blender's movie clips as blobs, and the lens that a clip was solved with as its camera's.

A marker's place in a clip is in parts of its picture, (0, 0) the lower left corner, with the lens still in it. Frame 1
of a clip is the scene's frame in which it starts.
"""

from collections.abc import Mapping

import bpy
import numpy as np

from ..core.data.errors import InputError
from ..core.data.takes import Blobs
from .cameras import DISTORTION

SOLVER_CONSTRAINTS = {"CAMERA_SOLVER"}
# Their terms by their names in Blender; without any of them a lens of each kind is none.
OTHER_LENSES = {"DIVISION": ("division_k1", "division_k2"), "NUKE": ("nuke_k1", "nuke_k2", "nuke_p1", "nuke_p2")}
NO_AREA = np.nan  # a track's box is drawn by hand


def clip_of(camera: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.MovieClip | None:
    """The clip that a camera is solved by or shows in its background; None where there is none."""
    for constraint in camera.constraints:
        if constraint.type in SOLVER_CONSTRAINTS:
            clip = scene.active_clip if constraint.use_active_clip else constraint.clip
            if clip is not None:
                return clip
    for picture in camera.data.background_images:
        if picture.source == "MOVIE_CLIP":
            clip = scene.active_clip if picture.use_camera_clip else picture.clip
            if clip is not None:
                return clip
    return None


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


def keep_lens(camera: bpy.types.Object, clip: bpy.types.MovieClip):
    """Gives a camera that has no lens that of its clip; InputError for one that is of another kind than OpenCV's."""
    if not any(camera.data.get(DISTORTION, ())):
        camera.data[DISTORTION] = lens_of(clip)


def lens_of(clip: bpy.types.MovieClip) -> list[float]:
    """k1, k2, p1, p2, k3 of a clip, in OpenCV's sense, which Blender's polynomial has too."""
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
