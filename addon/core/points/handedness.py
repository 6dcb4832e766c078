# SPDX-License-Identifier: GPL-3.0-or-later
"""Captures one of whose axes is mirrored: left and right are then exchanged, and every name with them.

A body looks the same in a mirror, and so does a marker set that has everything twice. What is lopsided tells: a marker
without its like on the other side. In labelled takes, whose names say which side is which, the whole body does.
"""

from math import log

import numpy as np
from threadpoolctl import threadpool_limits

from ..body.bodies import BodyModel
from ..body.prior import Prior
from ..body.sides import MIRROR, mirror_order
from ..data.errors import ForceableError
from ..data.markersets import MarkerSet, Worn
from ..data.takes import evenly_spread
from ..geometry.rigid import MIN_POINTS, in_axes, laid_on
from ..posing.posing import POSING, fit_subject, labelled_pull
from .naming import USUAL_TARGET
from .refusals import FRAMES_ASKED

# Log odds from which it is said, by as much as names must be sure of. Of 59 takes of all labs, those that have RBAC or
# RBAK are at 11.6 to 24 as they are, and at -11.6 to -24 mirrored.
SURE = log(USUAL_TARGET / (1 - USUAL_TARGET))


HOW_TO_MIRROR = "by label --mirror"  # on the command line; Blender puts words of its sidebar there
# What is expected of points as their file has them, of those that were mirrored as they were read, and of blobs.
MEND_POINTS = f"right-handed axes, so have its 3D points mirrored as they are read, {HOW_TO_MIRROR}"
MEND_MIRRORED = "points whose file is left-handed, so have these read as they are, without mirroring them"
MEND_BLOBS = "images and a calibration of which none is mirrored"


class MirroredError(ForceableError):
    """A take whose points are the mirror image of what was there."""


class Handedness:
    """Hears where the markers of a take are, part by part; says at its end whether all of it is mirrored.

    Of each segment that carries a marker without its like, the markers are laid on the set's in frames spread over the
    take, once as they are, and once in the mirror with the names of the sides exchanged. `expected` is what mends it.
    """

    def __init__(self, worn: Worn, expected: str = MEND_POINTS):
        self.expected = expected
        self.segments: list[_Segment] = []
        first = 0
        for name, markerset in worn.worn:
            self.segments += _lopsided(markerset, first, f"{name}:" if name else "")
            first += len(markerset)

    def add(self, markers: np.ndarray):
        """Adds markers (T, M, 3) m of all who are in the take, NaN where missing."""
        some = markers[evenly_spread(len(markers), FRAMES_ASKED)]
        for segment in self.segments:
            segment.add(some)

    def refuse(self):
        """Raises MirroredError where the take is mirrored for sure."""
        misfits = np.array([segment.misfits() for segment in self.segments]).reshape(-1, 2)
        plain, image = misfits.sum(axis=0)
        # In the mirror all is where the set has it; of wrong names it is nowhere.
        if plain - image > SURE and image < SURE:
            segment = self.segments[int((misfits[:, 0] - misfits[:, 1]).argmax())]
            why = f"{' and '.join(segment.names)} would be on the other side of the body"
            raise mirrored_error(why, self.expected)


def mirrored_error(why: str, expected: str = MEND_POINTS) -> MirroredError:
    """The refusal, and how to mend it."""
    return MirroredError(
        f"is left-handed: one axis is mirrored, as {why}, so left and right are exchanged; expected {expected}"
    )


class _Segment:
    """Markers on one segment, of which some are lopsided.

    names   of these
    source  (2, N) which of the take's markers each of them is, as the take is and in the mirror
    form    (N, 3) where the set has them, heights
    size    m, the mean stature
    judged  (N,) which are lopsided
    """

    def __init__(self, names: list[str], source: np.ndarray, form: np.ndarray, size: float, judged: np.ndarray):
        self.names, self.source, self.form, self.size, self.judged = names, source, form, size, judged
        self.total, self.count = np.zeros((2, *form.shape)), np.zeros(source.shape, int)

    def add(self, markers: np.ndarray):
        """Adds frames of all markers (T, M, 3) m, NaN where missing."""
        for way, axes in enumerate((np.ones(3), MIRROR)):
            points = markers[:, self.source[way]] * axes
            back = in_axes(*laid_on(self.size * self.form, points), points)
            seen = np.isfinite(back).all(axis=2)
            self.total[way] += np.where(seen[..., None], back, 0).sum(axis=0)
            self.count[way] += seen.sum(axis=0)

    def misfits(self) -> tuple[float, float]:
        """Minus the log density of where the lopsided markers are, as the take is, and in the mirror."""
        known = (self.count > 0).all(axis=0)
        if known.sum() <= MIN_POINTS:  # three and their mirror image are one form
            return 0.0, 0.0
        plain, image = (
            self._misfit(total[known] / count[known, None], known)
            for total, count in zip(self.total, self.count, strict=True)
        )
        return plain, image

    def _misfit(self, mean: np.ndarray, known: np.ndarray) -> float:
        form = self.form[known] - self.form[known].mean(axis=0)
        own = in_axes(*laid_on(form, mean[None]), mean[None])[0]
        off = own * (form**2).sum() / (own * form).sum() - form
        return float((off[self.judged[known]] ** 2).sum() / (2 * POSING.own_sd**2))


def _lopsided(markerset: MarkerSet, first: int, prefix: str) -> list[_Segment]:
    """The segments of a set, whose markers begin at `first` in the take, that carry a marker without its like."""
    order = mirror_order(markerset.markers)
    order = np.arange(len(markerset)) if order is None else order
    found = []
    for segment in range(len(markerset.skeleton)):
        own = np.flatnonzero(markerset.attachment == segment)
        alone = order[own] == own
        if alone.any() and len(own) > MIN_POINTS:
            off = np.abs(markerset.rest_markers[own, 1]) > POSING.own_sd  # where a marker of the middle may be
            names = [prefix + markerset.markers[index] for index in own[alone & off]]
            source = first + np.stack([own, order[own]])
            found.append(_Segment(names, source, markerset.offsets[own], markerset.spread.height, alone))
    return found


def refuse_labelled(markerset: MarkerSet, points: np.ndarray):
    """Raises MirroredError where points (T, M, 3) m, NaN where missing, labelled as in the set, are mirrored for sure.

    A body is posed on some frames as they are, and on their mirror image; what is labelled may also have been named by
    us, which `Handedness` tells.
    """
    there = np.isfinite(points[..., 0]).sum(axis=1)
    fullest = np.flatnonzero(there >= max(POSING.min_markers, there.max(initial=0) - 1))
    if not len(fullest):
        return
    some = points[fullest[evenly_spread(len(fullest), FRAMES_ASKED)]]
    model = BodyModel(markerset)
    prior = Prior(model)
    with threadpool_limits(1, user_api="blas"):
        (plain, _), (image, off) = (_posed(model, prior, one) for one in (some, some * MIRROR))
    # Names that are wrong otherwise fit no better in a mirror than by chance.
    if (plain - image) / 2 > SURE and off < POSING.own_sd:
        raise mirrored_error("the body of its labels is the mirror image of one")
    check = Handedness(markerset)
    check.add(points)
    check.refuse()


def _posed(model: BodyModel, prior: Prior, points: np.ndarray) -> tuple[float, float]:
    """Twice minus the log likelihood of the body in the usual one of frames (T, M, 3) m, and how far markers are off.

    The latter root mean square, in heights.
    """
    bodies = fit_subject(model, points, prior)
    markers = model.pose(bodies).markers
    off = np.linalg.norm(markers - points, axis=2) / bodies.scale.mean()
    cost = labelled_pull(points)(markers).cost + prior.terms(bodies)[0]
    return float(np.median(cost)), float(np.sqrt(np.nanmean(off**2)))
