# SPDX-License-Identifier: GPL-3.0-or-later
"""The rigid bodies of a take's own subject: which of its clusters they are, their forms and their distances."""

from dataclasses import dataclass

import numpy as np

from ...data.made import Table
from ...data.physical import MARKER_LIMITS
from ...data.takes import NO_POINT
from ...geometry.rigid import MIN_POINTS
from .cluster_matching import NO_CLUSTER, Matched, match_clusters
from .clustering import Cluster, Sampled, find_clusters, sampled
from .marker_matching import Placed, place_markers
from .model import RigidBodies
from .single_markers import find_single_markers
from .structure import STRUCTURE, Structure, unseen_is_nan


@dataclass(frozen=True)
class RecognitionOptions:
    """What is sure enough to be taken for known.

    min_body_lead    log odds by which a rigid body's cluster must lead; measured on subjects made of the labelled
                     Clouthier takes, with other limbs and rigid bodies of other forms elsewhere on them
    min_marker_lead  log odds by which a marker's point must lead within the rigid body; measured on the same
    min_most         measured: part of the sure rigid bodies that must be the model's own for the take to be of somebody
                     it knows; half and twice of it name plates alike
    """

    min_body_lead: float = 3.0
    min_marker_lead: float = 5.0
    min_most: float = 0.8


RECOGNITION = RecognitionOptions()
MOTION_CONFIDENCE = 0.99  # of a name that only the motion of the whole take gives: a lead of 5 is 0.993


@dataclass(frozen=True, eq=False)
class Recognition:
    """What a take itself tells of the rigid bodies in it.

    cluster   (K,) which of its clusters each rigid body surely is, NO_CLUSTER where none or not sure
    placed    which point of the clusters each marker is
    sure      (M,) True where that is sure
    clusters  of the take
    tracklet  (T, P) the number of the tracklet of each point, -1 where there is none
    single    (N,) for each tracklet the marker on no rigid body that it surely is, -1 for most
    rigid_bodies  the model's with the forms and distances of this subject; those that are not sure are left out
    known     True where the rigid bodies are the model's own, False where they are others, None where nothing says
    """

    cluster: np.ndarray
    placed: Placed
    sure: np.ndarray
    clusters: tuple[Cluster, ...]
    tracklet: np.ndarray
    single: np.ndarray
    rigid_bodies: RigidBodies
    known: bool | None

    @property
    def marker(self) -> np.ndarray:
        """(T, P) the marker of every point, -1 where it is not surely one."""
        names = self.single.copy()
        for marker in np.flatnonzero(self.sure):
            cluster = self.clusters[self.cluster[self.placed.rigid_body[marker]]]
            names[list(cluster.tracklets[self.placed.point[marker]])] = marker
        return np.append(names, -1)[self.tracklet]


def recognise(
    structure: Structure, rigid_bodies: RigidBodies, points: Table, tracklet: np.ndarray, rate: float
) -> Recognition:
    """Which marker is where in a take of points (T, P, 3) m, with the number of the tracklet of each (T, P).

    `structure` and `rigid_bodies` are the model's.
    """
    with unseen_is_nan():
        seen = sampled(points, tracklet, rate)
        clusters = find_clusters(seen)
        matched = match_clusters(structure, clusters)
        sure = (matched.cluster != NO_CLUSTER) & (matched.margin >= RECOGNITION.min_body_lead)
        cluster = np.where(sure, matched.cluster, NO_CLUSTER)
        placed = place_markers(structure, clusters, Matched(cluster, matched.margin))
        named = (placed.point != NO_POINT) & (placed.margin >= RECOGNITION.min_marker_lead)
        at = _positions(clusters, cluster, placed, named)
        forms = _own_forms(structure, clusters, cluster, placed, named)
        own = _own_rigid_bodies(rigid_bodies, forms)
        single = np.full(int(tracklet.max(initial=-1)) + 1, -1)
        free = _free(seen, clusters)
        if len(free) and named.any():
            missing = np.flatnonzero(placed.point == NO_POINT)
            single[seen.number[free]] = find_single_markers(own, at, missing, seen.points[:, free])
        known = _known(forms, len(structure))
        return Recognition(cluster, placed, named, tuple(clusters), tracklet, single, own, known)


def _positions(clusters: list[Cluster], cluster: np.ndarray, placed: Placed, sure: np.ndarray) -> np.ndarray:
    """(F, M, 3) m, where each sure marker is by its rigid body, its own trajectory seen or not; NaN for others."""
    at = np.full((len(clusters[0].place) if clusters else 0, len(sure), 3), np.nan)
    whole = [one.markers for one in clusters]
    for marker in np.flatnonzero(sure):
        at[:, marker] = whole[cluster[placed.rigid_body[marker]]][:, placed.point[marker]]
    return at


def _free(seen: Sampled, clusters: list[Cluster]) -> np.ndarray:
    """Indices of the tracklets that are in no cluster."""
    taken = {tracklet for cluster in clusters for tracklets in cluster.tracklets for tracklet in tracklets}
    return np.flatnonzero([number not in taken for number in seen.number.tolist()])


def _own_forms(
    structure: Structure, clusters: list[Cluster], cluster: np.ndarray, placed: Placed, sure: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Of each sure rigid body the sure markers (n,) of its core, three or more, with their form (n, 3) m.

    And how far its lengths are from the model's, root mean square, m.
    """
    forms = []
    for rigid_body in np.flatnonzero(cluster != NO_CLUSTER):
        inner, body = structure.inner[rigid_body], clusters[cluster[rigid_body]]
        core = inner.members[: inner.core]
        fine = np.flatnonzero(sure[core] & (placed.rigid_body[core] == rigid_body))
        if len(fine) >= MIN_POINTS:
            own, point = core[fine], placed.point[core[fine]]
            off = body.lengths[np.ix_(point, point)] - inner.lengths[np.ix_(fine, fine)]
            forms.append((own, body.form[point], float(np.sqrt((off**2).mean()))))
    return forms


def _own_rigid_bodies(rigid_bodies: RigidBodies, forms) -> RigidBodies:
    """The rigid bodies with the subject's own forms, and distances within what subjects differ by."""
    form = np.zeros_like(rigid_bodies.form)
    for own, shape, _ in forms:
        form[own] = shape
    wider = STRUCTURE.between_subjects((rigid_bodies.low + rigid_bodies.high) / 2)
    low, high = np.maximum(rigid_bodies.low - wider, 0), rigid_bodies.high + wider
    return RigidBodies(tuple(own for own, *_ in forms), form, low, high)


def _known(forms, count: int) -> bool | None:
    """Whether the forms of the take, of `count` rigid bodies in all, are those of the model but for noise."""
    alike = [off < MARKER_LIMITS.noise_m for *_, off in forms]
    if 2 * len(alike) < count:
        return None
    return bool(np.mean(alike) >= RECOGNITION.min_most)
