# SPDX-License-Identifier: GPL-3.0-or-later
"""What a take teaches of its subject, and how far each frame's names strain it.

A frame is named with what was known of the subject up to it. In the end all frames show how tall the subject is and
where the markers sit; names that were wrong for a while do not suit that body, however it bends.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import Bodies
from ..geometry.views import View
from ..papers.virtual_occlusions.cost import RayPull
from ..papers.virtual_occlusions.fit import fit_body
from ..papers.virtual_occlusions.labelling import Naming
from .subject import SUBJECT, Setup, Subject
from .tracking import FrameResult

# Iterations of the fits to the names, from the fits as they were: these are near.
JUDGING_STEPS = 3


@dataclass(frozen=True, eq=False)
class KnownSubject:
    """The subject of a take as all frames show it.

    subject  its body is in the pose of no frame in particular
    known    (M,) which markers' places the take showed
    """

    subject: Subject
    known: np.ndarray

    def bodies(self, poses: Bodies) -> Bodies:
        """The subject in the places and poses of B bodies."""
        return _same(self.subject.bodies, poses)


def known_subject_of(
    results: Sequence[FrameResult],
    setup: Setup,
    before: KnownSubject | None,
    min_frames: int,
) -> KnownSubject:
    """The subject that labelled frames show: medians over all of them, so that a part with wrong names does not count.

    A marker sits where it mostly was found, in `min_frames` or more, unless nobody wears it there; one that was hardly
    found sits where it did `before`.
    """
    poses = Bodies.join([result.bodies for result in results])
    scale, shape = (np.median(part, axis=0)[None] for part in (poses.scale, poses.shape))
    points = np.array([result.naming.meeting.points for result in results])
    pixel = float(np.median([result.naming.frame.rules.pixel for result in results]))
    anywhere = setup.marker_sd * float(scale.mean())
    own, sd = np.zeros_like(poses.own[0]), anywhere.copy()
    plain = replace(poses.pick([0]), scale=scale, shape=shape, own=own[None])
    frames = np.isfinite(points[..., 0]).sum(axis=0)
    known = frames >= min_frames
    if known.any():
        posed = setup.model.pose(_same(plain, poses))
        turn = posed.rotations[:, setup.model.attachment].swapaxes(-1, -2)
        local = (turn @ (points - posed.markers)[..., None])[..., 0][:, known] / scale
        own[known] = np.nanmedian(local, axis=0)
        off = np.linalg.norm((local - own[known]) * scale, axis=2)
        sd[known] = np.clip(np.nanmedian(off, axis=0), SUBJECT.skin_m, anywhere[known])
        # A marker that is found farther off is another one.
        known &= np.linalg.norm(own, axis=1) < np.sqrt(setup.rules.max_square) * setup.marker_sd
    if before is not None:
        earlier = ~known & before.known
        own[earlier], sd[earlier] = before.subject.bodies.own[0, earlier], before.subject.own_sd[earlier]
        known = known | earlier
    subject = Subject(replace(plain, own=np.where(known[:, None], own, 0)[None]), np.where(known, sd, anywhere), pixel)
    return KnownSubject(subject, known)


def _same(subject: Bodies, poses: Bodies) -> Bodies:
    """One subject in the places and poses of B bodies."""
    mine = {name: np.repeat(getattr(subject, name), len(poses), axis=0) for name in ("scale", "shape", "own")}
    return replace(poses, **mine)


def judged(
    views: Sequence[View],
    results: Sequence[FrameResult],
    known: KnownSubject,
    setup: Setup,
) -> tuple[np.ndarray, np.ndarray]:
    """How badly the subject's own body, fitted to the names of F frames, explains them: all frames are one batch.

    (F,) the costs of the fits, and (F, M) the squared deviations by which named markers are off, see `strain`.
    """
    own_sd = known.subject.own_sd
    image = np.array([_images(view, result.naming) for view, result in zip(views, results, strict=True)])
    deviation = np.array([_deviations(result.naming, own_sd) for result in results])
    poses = known.bodies(Bodies.join([result.bodies for result in results]))
    pull = RayPull(image, deviation, setup.sight)
    fit = fit_body(setup.model, poses, pull, JUDGING_STEPS, setup.prior)
    return fit.cost, _strain(fit.state.posed.markers, image, deviation, setup)


def strain(view: View, naming: Naming, known: KnownSubject, markers: np.ndarray, setup: Setup) -> np.ndarray:
    """(M,) squared deviations by which the blobs of each name are off a body's markers (M, 3) m; 0 where none is named.

    However many rays a marker has, they share how far it may be off its place.
    """
    deviation = _deviations(naming, known.subject.own_sd)
    return _strain(markers[None], _images(view, naming)[None], deviation[None], setup)[0]


def _strain(markers: np.ndarray, image: np.ndarray, deviation: np.ndarray, setup: Setup) -> np.ndarray:
    found, _, depth = setup.sight.looked_at(markers)
    off = (depth / deviation.swapaxes(1, 2))[..., None] * (image.swapaxes(1, 2) - found)
    return np.einsum("fmci,fmci->fm", off, off)


def _images(view: View, naming: Naming) -> np.ndarray:
    """(C, M, 2) the normalised images of the named blobs."""
    return view.image[np.arange(len(view.image))[:, None], np.maximum(naming.rays, 0)]


def _deviations(naming: Naming, own_sd: np.ndarray) -> np.ndarray:
    """(C, M) m, standard deviations of the named blobs at their markers' depth; infinite where none."""
    seen = naming.rays >= 0
    count = np.maximum(seen.sum(axis=0), 1)
    return np.where(seen, np.sqrt(naming.frame.metres**2 + count * own_sd**2), np.inf)
