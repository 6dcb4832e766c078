# SPDX-License-Identifier: GPL-3.0-or-later
"""A virtual capture: the blobs that cameras would see of markers on a body, with everything that goes wrong in a room.

Chunk by chunk, so that memory does not grow with the take. Every chunk draws from a generator of its own, seeded by
the take's seed and the chunk's number: the same options give the same blobs.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..data.takes import Blobs
from ..geometry import rotations
from ..geometry.cameras import Cameras
from ..papers.virtual_occlusions.occlusion import Occlusion

# Random numbers of the take as a whole come from a stream that no chunk uses.
TAKE_STREAM = 2**32


AREA_NOISE = 0.05  # standard deviation of a marker's area, parts of it, as its light varies
GHOST_AREA = 2.0, 14.0  # px², least and greatest of a ghost, as of markers near and far in a room
CHUNK_FRAMES = 256  # captured at once, so that memory does not grow; each draws from a generator of its own


@dataclass(frozen=True)
class CaptureOptions:
    """What goes wrong in a virtual capture, and how much of it."""

    seed: int = 0  # of everything that is random; format: any whole number
    noise: float = 0.3  # standard deviation of a blob's centre, px, in x and in y; physical: of 10 px² and more
    # probability that a visible marker gives no blob in a camera and frame; physical: a scratch, a hair
    dropout: float = 0.002  # physical
    marker_radius: float = 0.007  # m; gives the blobs' areas; physical: a ball of 14 mm, the usual one
    # blobs whose edges come nearer than this are one blob, px; physical: half a pixel between them is not dark; a
    # negative gap lets them overlap
    merge_gap: float = 0.5  # physical
    min_area: float = 0.5  # smaller blobs are not detected, px²; physical: less is no whole pixel
    reflections: int = 2  # fixed ghosts in every camera; physical: a lamp, a screw
    # probability that a fixed ghost shows in a frame; physical: the subject stands before it at times
    reflection_on: float = 0.8  # physical
    flicker: float = 0.2  # mean number of ghosts a camera and frame at random places; physical: one in five frames
    # how far the cameras really stand from where their calibration says, mm; physical: not at all
    calibration_mm: float = 0.0  # physical
    calibration_mrad: float = 0.0  # how far they are really turned from it, mrad; physical: not at all
    # markers sit up to this far from where they should, each in a fixed direction, m; physical: none
    marker_offset: float = 0.0  # physical


@dataclass(frozen=True, eq=False)
class PosedBody:
    """A marker set's body over T frames: rotations (T, J, 3, 3), joints (T, J, 3) m, scale (T, 3), attachment (M,)."""

    occlusion: Occlusion
    attachment: np.ndarray
    rotations: np.ndarray
    joints: np.ndarray
    scale: np.ndarray

    def hidden(self, frames: slice, markers: np.ndarray, centres: np.ndarray) -> np.ndarray:
        """(F, C, M) True where the body in these frames hides markers (F, M, 3) m from cameras at centres (C, 3) m."""
        pose = (self.rotations[frames], self.joints[frames], self.scale[frames])
        return self.occlusion.hidden(*pose, markers, centres)

    def carry(self, frames: slice, offsets: np.ndarray) -> np.ndarray:
        """(F, M, 3) world directions of offsets (M, 3) m that are fixed to what carries each marker."""
        return (self.rotations[frames][:, self.attachment] @ offsets[..., None])[..., 0]


@dataclass(frozen=True, eq=False)
class BodiesTogether:
    """Several bodies, the markers of one after those of the other, each in the way of all: sizes are their counts."""

    bodies: tuple[PosedBody, ...]
    sizes: tuple[int, ...]

    def hidden(self, frames: slice, markers: np.ndarray, centres: np.ndarray) -> np.ndarray:
        """See `PosedBody.hidden`."""
        return np.any([body.hidden(frames, markers, centres) for body in self.bodies], axis=0)

    def carry(self, frames: slice, offsets: np.ndarray) -> np.ndarray:
        """See `PosedBody.carry`."""
        own = np.split(offsets, np.cumsum(self.sizes)[:-1])
        carried = [body.carry(frames, part) for body, part in zip(self.bodies, own, strict=True)]
        return np.concatenate(carried, axis=1)


@dataclass(frozen=True, eq=False)
class Capture:
    """A chunk of a virtual capture: blobs, and for each the names that are right, joined with `|`; "" for a ghost."""

    blobs: Blobs
    truth: np.ndarray


def capture(
    markers: np.ndarray,
    names: Sequence[str],
    cameras: Cameras,
    options: CaptureOptions | None = None,
    body: PosedBody | BodiesTogether | None = None,
    first_frame: int = 1,
) -> Iterator[Capture]:
    """What `cameras` see of markers (T, M, 3) m, NaN where there is none, chunk by chunk.

    A marker is seen where `body` does not hide it and its image is within the camera's. `names` are the M markers'.
    """
    options = options or CaptureOptions()
    markers = np.asarray(markers, dtype=float)
    if markers.ndim != 3 or markers.shape[1:] != (len(names), 3):
        raise ValueError(f"markers have shape {markers.shape}; expected (T, {len(names)}, 3)")
    generator = np.random.default_rng([options.seed, TAKE_STREAM])
    real = disturbed(cameras, options.calibration_mm, options.calibration_mrad, generator)
    away = _directions(generator, len(names))  # evenly in direction and length
    offsets = away * generator.uniform(0, 1, (len(names), 1)) * options.marker_offset
    size = cameras.size[:, None]
    ghosts = generator.uniform(0, 1, (len(cameras), options.reflections, 2)) * size
    ghost_area = generator.uniform(*GHOST_AREA, (len(cameras), options.reflections))
    for number, start in enumerate(range(0, len(markers), CHUNK_FRAMES)):
        part = slice(start, min(start + CHUNK_FRAMES, len(markers)))
        there = markers[part]
        there = there + (offsets if body is None else body.carry(part, offsets))
        hidden = None if body is None else body.hidden(part, there, real.centres)
        chunk_generator = np.random.default_rng([options.seed, number])
        seen = _marker_images(there, real, hidden, options, chunk_generator)
        false = _ghost_images(ghosts, ghost_area, len(there), cameras.size, options, chunk_generator)
        images = _Images(*(np.concatenate(pair, axis=2) for pair in zip(seen, false, strict=True)))
        frames = first_frame + np.arange(part.start, part.stop)
        yield _read_out(images, names, frames, cameras.size, options, chunk_generator)


def disturbed(cameras: Cameras, millimetres: float, milliradians: float, generator: np.random.Generator) -> Cameras:
    """The cameras moved by exactly `millimetres` and turned by exactly `milliradians`, each in a random direction."""
    shift = _directions(generator, len(cameras)) * millimetres / 1000
    turn = rotations.turn_of(_directions(generator, len(cameras)) * milliradians / 1000)
    rotation = turn @ cameras.rotation
    translation = -np.einsum("cij,cj->ci", rotation, cameras.centres + shift)
    return replace(cameras, rotation=rotation, translation=translation)


class _Images(NamedTuple):
    """Possible blobs of F frames, C cameras and N sources: centre (F, C, N, 2) px, area (F, C, N) px², there or not."""

    xy: np.ndarray
    area: np.ndarray
    there: np.ndarray


def _marker_images(
    markers: np.ndarray,
    cameras: Cameras,
    hidden: np.ndarray | None,
    options: CaptureOptions,
    generator: np.random.Generator,
) -> _Images:
    """The markers (F, M, 3) m as the cameras see them."""
    ideal = cameras.normalised(markers)
    xy = np.moveaxis(cameras.project(markers), 0, 1)
    depth = np.moveaxis(np.einsum("cx,fmx->cfm", cameras.rotation[:, 2], markers), 0, 1)
    depth = depth + cameras.translation[:, 2][:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        area = np.pi * (cameras.focal[:, None] * options.marker_radius / depth) ** 2
    area = area * (1 + AREA_NOISE * generator.standard_normal(area.shape))
    # Beyond where the lens polynomial turns back it would show inside the image what no lens shows there.
    with np.errstate(invalid="ignore"):
        through = np.einsum("cfmi,cfmi->cfm", ideal, ideal) < cameras.reach[:, None, None] ** 2
    there = _in_image(xy, cameras.size[:, None]) & np.moveaxis(through, 0, 1)
    there &= generator.random(there.shape) >= options.dropout
    if hidden is not None:
        there &= ~hidden
    return _Images(xy, area, there)


def _ghost_images(
    places: np.ndarray,
    areas: np.ndarray,
    frames: int,
    size: np.ndarray,
    options: CaptureOptions,
    generator: np.random.Generator,
) -> _Images:
    """Fixed reflections at places (C, G, 2) px that come and go, and random flicker, in every frame and camera."""
    cameras = len(places)
    slots = int(np.ceil(4 * options.flicker))
    xy = np.broadcast_to(places, (frames, *places.shape))
    area = np.broadcast_to(areas, (frames, *areas.shape))
    fixed = generator.random(area.shape) < options.reflection_on
    anywhere = generator.random((frames, cameras, slots, 2)) * size[:, None]
    flicker_area = generator.uniform(*GHOST_AREA, (frames, cameras, slots))
    sudden = generator.random((frames, cameras, slots)) < options.flicker / max(slots, 1)
    return _Images(
        np.concatenate([xy, anywhere], axis=2),
        np.concatenate([area, flicker_area], axis=2),
        np.concatenate([fixed, sudden], axis=2),
    )


def _read_out(
    images: _Images,
    names: Sequence[str],
    frames: np.ndarray,
    size: np.ndarray,
    options: CaptureOptions,
    generator: np.random.Generator,
) -> Capture:
    """Melts overlapping images into blobs, adds noise, and writes the blobs down in no particular order."""
    frame, camera, source = np.nonzero(images.there)
    xy, area = images.xy[frame, camera, source], images.area[frame, camera, source]
    blob = _melted(frame, camera, xy, area, options.merge_gap)
    count = blob.max(initial=-1) + 1
    total = np.bincount(blob, area, count)
    centre = np.stack([np.bincount(blob, area * xy[:, axis], count) for axis in (0, 1)], axis=1) / total[:, None]
    first = np.zeros(count, dtype=int)
    first[blob[::-1]] = np.arange(len(blob))[::-1]
    frame, camera = frame[first], camera[first]
    centre = centre + options.noise * generator.standard_normal(centre.shape)
    truth = _true_names(blob, source, count, names)
    found = np.flatnonzero((total >= options.min_area) & _in_image(centre, size[camera]))
    order = found[np.lexsort([generator.random(len(found)), frame[found]])]
    return Capture(Blobs(frames, frame[order], camera[order], centre[order], total[order]), truth[order])


def _melted(frame: np.ndarray, camera: np.ndarray, xy: np.ndarray, area: np.ndarray, gap: float) -> np.ndarray:
    """(N,) the number of the blob that each image is part of; images that touch, directly or in a chain, are one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    count = len(xy)
    if count == 0:
        return np.zeros(0, dtype=int)
    radius = np.sqrt(area / np.pi)
    reach = max(2 * radius.max() + gap, 0.0)
    # One tree for all images of the chunk: every frame and camera gets a depth of its own that nothing reaches across.
    image = frame * (camera.max() + 1) + camera
    tree = cKDTree(np.column_stack([xy, image * (2 * reach + 1)]))
    near = tree.query_pairs(reach, output_type="ndarray")
    distance = np.linalg.norm(xy[near[:, 0]] - xy[near[:, 1]], axis=1)
    near = near[distance < radius[near[:, 0]] + radius[near[:, 1]] + gap]
    touching = coo_array((np.ones(len(near), dtype=np.int8), (near[:, 0], near[:, 1])), shape=(count, count))
    return connected_components(touching, directed=False)[1].astype(int)


def _true_names(blob: np.ndarray, source: np.ndarray, count: int, names: Sequence[str]) -> np.ndarray:
    """(count,) text: the names in each blob, in the markers' order, joined with `|`; ghosts add none."""
    rows = np.flatnonzero(source < len(names))
    rows = rows[np.lexsort([source[rows], blob[rows]])]
    markers_in = np.bincount(blob[rows], minlength=count)
    truth = np.full(count, "", dtype=object)
    single = rows[markers_in[blob[rows]] == 1]
    truth[blob[single]] = np.asarray(names, dtype=object)[source[single]]
    starts = np.concatenate([[0], np.cumsum(markers_in)])
    for several in np.flatnonzero(markers_in > 1):
        members = source[rows[starts[several] : starts[several + 1]]]
        truth[several] = "|".join(names[index] for index in members)
    return truth


def _in_image(xy: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Whether pixels (..., 2) are within images of `size` (..., 2), pixel centres being whole numbers."""
    with np.errstate(invalid="ignore"):
        return ((xy >= -0.5) & (xy <= size - 0.5)).all(axis=-1)


def _directions(generator: np.random.Generator, count: int) -> np.ndarray:
    """(count, 3) unit vectors, evenly over the sphere."""
    vector = generator.standard_normal((count, 3))
    return vector / np.linalg.norm(vector, axis=1, keepdims=True)
