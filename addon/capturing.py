# SPDX-License-Identifier: GPL-3.0-or-later
"""A virtual capture of a labelled take: the body posed on its markers, then seen by cameras, then written to files."""

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .core.body.bodies import BodyModel
from .core.data.errors import InputError, JobError
from .core.data.markersets import MarkerSet
from .core.data.progress import Progress
from .core.data.takes import Points
from .core.geometry.cameras import Cameras
from .core.papers.virtual_occlusions.occlusion import CapsuleOcclusion
from .core.posing.posing import POSING, fit_points
from .core.simulation.simulate import BodiesTogether, CaptureOptions, PosedBody, capture
from .io.blobs import BlobWriter
from .io.labels import TruthWriter
from .io.points import columns_of_set
from .io.whole import whole_files

Bodies = PosedBody | BodiesTogether
MIN_MARKER_SHARE = 0.5  # of a model's markers that a take must have for the model to fit it


@dataclass(frozen=True)
class Captured:
    """What a virtual capture wrote: frames, blobs, and how many of the blobs are ghosts and how many merged."""

    frames: int
    blobs: int
    ghosts: int
    merged: int


def labelled_markers(points: Points) -> Points:
    """The trajectories of a take that have a name."""
    kept = [index for index, name in enumerate(points.names) if name]
    if not kept:
        raise InputError("has no named markers; expected a labelled take")
    return points.picked(kept)


def subjects_in(take: Points) -> tuple[str, ...]:
    """Who is in a take whose markers are called NAME:LASI, in the order of the file."""
    return tuple(dict.fromkeys(name.partition(":")[0] for name in take.names if ":" in name))


def together(parts: Sequence[tuple[str, Points, PosedBody]]) -> tuple[Points, BodiesTogether]:
    """Several subjects by name as one take, NAME:LASI …, and all of their bodies."""
    takes = [one for _, one, _ in parts]
    names = tuple(f"{subject}:{name}" for subject, one, _ in parts for name in one.names)
    xyz, residual = (np.concatenate([getattr(one, name) for one in takes], axis=1) for name in ("xyz", "residual"))
    bodies = BodiesTogether(tuple(body for *_, body in parts), tuple(len(one.names) for one in takes))
    return replace(takes[0], names=names, xyz=xyz, residual=residual), bodies


def of_subject(take: Points, subject: str) -> Points:
    """Only the markers of one of several subjects, those called `subject:LASI` and so on."""
    own = {index: name.removeprefix(f"{subject}:") for index, name in enumerate(take.names)}
    kept = [index for index, name in own.items() if name != take.names[index] and ":" not in name]
    return replace(take.picked(kept), names=tuple(own[index] for index in kept))


def wears(take: Points, markerset: MarkerSet) -> bool:
    """Whether a take has enough of a marker set's markers for its body to be posed."""
    return bool((columns_of_set(take.names, markerset) >= 0).mean() >= MIN_MARKER_SHARE)


def fitting_markerset(take: Points, markersets: Sequence[MarkerSet]) -> MarkerSet:
    """The marker set of the take: the largest that is there whole, or else the one that is there most."""

    def fit(markerset: MarkerSet) -> tuple[bool, float, int]:
        there = int((columns_of_set(take.names, markerset) >= 0).sum())
        whole = there == len(markerset)
        return whole, 0.0 if whole else there / len(markerset), there

    best = max(markersets, key=fit)
    if not wears(take, best):
        raise JobError(
            f"has too few markers of any model ({', '.join(take.names[:6])}, …); expected half of a model's markers"
        )
    return best


def worn_in(take: Points, markerset: MarkerSet) -> tuple[Points, PosedBody]:
    """The marker set's markers that a take has, by the set's own names, and its body posed on them."""
    found = columns_of_set(take.names, markerset)
    there = found >= 0
    model = BodyModel(markerset)
    try:
        bodies = fit_points(model, take.picked(found).xyz)
    except ValueError:
        raise JobError(
            f"has no frame with {POSING.min_markers} markers of {markerset.name}; expected a take that wears it"
        ) from None
    posed = model.pose(bodies)
    names = tuple(name for name, seen in zip(markerset.markers, there, strict=True) if seen)
    attachment = np.asarray(markerset.attachment)[there]
    body = PosedBody(CapsuleOcclusion(markerset), attachment, posed.rotations, posed.joints, bodies.scale)
    return replace(take.picked(found[there]), names=names), body


def room_centre(cameras: Cameras) -> np.ndarray:
    """(3,) m: the point nearest to where all cameras look, in least squares over their axes."""
    ahead = cameras.rotation[:, 2]
    across = np.eye(3) - ahead[:, :, None] * ahead[:, None, :]
    right = np.einsum("cij,cj->i", across, cameras.centres)
    return np.linalg.lstsq(across.sum(axis=0), right, rcond=None)[0]


def centred(take: Points, cameras: Cameras) -> Points:
    """The take moved over the floor so that the middle of its path is the middle of the room."""
    seen = take.xyz[np.isfinite(take.xyz).all(axis=2)]
    if not len(seen):
        raise JobError("has no marker in these frames; expected a labelled take")
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    return replace(take, xyz=take.xyz + (room_centre(cameras) - middle) * [1.0, 1.0, 0.0])


def truth_path(blobs: Path) -> Path:
    """The truth file that belongs to a blob file: its name and `.truth.csv`."""
    return blobs.with_name(blobs.name + ".truth.csv")


def write_capture(
    take: Points,
    cameras: Cameras,
    options: CaptureOptions,
    body: Bodies,
    out: Path,
    overwrite: bool = False,
    read: Iterable[Path] = (),
) -> Generator[Progress, None, Captured]:
    """Captures the take virtually and writes the blobs to `out` and their truth beside it; neither may be in `read`."""
    frames = blobs = ghosts = merged = 0
    given = take.xyz, take.names, cameras
    with whole_files([out, truth_path(out)], overwrite, read) as (blob_file, truth_file):
        with BlobWriter(blob_file, cameras) as writer, TruthWriter(truth_file) as truth:
            for part in capture(*given, options, body, take.first_frame):
                keys = writer.write(part.blobs)
                names = part.truth.tolist()
                truth.write(keys, names)
                frames, blobs = frames + len(part.blobs.frames), blobs + len(names)
                ghosts, merged = ghosts + names.count(""), merged + sum("|" in name for name in names)
                yield Progress(frames / len(take.xyz), f"frame {part.blobs.frames[-1]}")
        if blobs == ghosts:
            if any(part.truth.any() for part in capture(*given, None, body)):
                words = "no marker gives a blob by these options, where some do by the usual ones"
                raise JobError(f"{words}; expected options nearer to those, such as a smaller --dropout")
            raise JobError("the cameras see nothing of this take; expected a take within the room (see --centre)")
    return Captured(frames, blobs, ghosts, merged)
