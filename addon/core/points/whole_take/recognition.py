# SPDX-License-Identifier: GPL-3.0-or-later
"""The rigid bodies of a take's own subject: which of its clusters they are, and which marker each point of these is.

Where they are not the model's own, frames on their own say nothing: the names are those that the motion tells.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...data.made import Table
from ...data.physical import MARKER_LIMITS
from ...data.takes import BY_TRAJECTORY, NO_MARKER, NO_POINT, NO_STEP, Labels, Suspect, Verdict
from ...geometry.rigid import MIN_POINTS
from ..refusals import REFUSAL
from ..rigid_bodies.clusters import NO_CLUSTER, Cluster, Matched, Sampled, find_clusters, match_clusters, sampled
from ..rigid_bodies.markers import MARKER_MATCH, Placed, find_single_markers, place_markers
from ..rigid_bodies.model import RigidBodies
from ..rigid_bodies.structure import Structure, unseen_is_nan

MOTION_CONFIDENCE = 0.99  # of a name that only the motion of the whole take gives


@dataclass(frozen=True, eq=False)
class Recognition:
    """What a take itself tells of the rigid bodies in it."""

    cluster: np.ndarray  # (K,) which of its clusters each rigid body surely is, NO_CLUSTER where none or not sure
    placed: Placed  # which point of the clusters each marker is
    sure: np.ndarray  # (M,) True where that is sure
    clusters: tuple[Cluster, ...]  # of the take
    tracklet: np.ndarray  # (T, P) the number of the tracklet of each point, -1 where there is none
    single: np.ndarray  # (N,) for each tracklet the marker on no rigid body that it surely is, -1 for most
    # True where the rigid bodies are the model's own, False where they are others, None where nothing says
    known: bool | None

    @property
    def by_motion(self) -> bool:
        """Whether the names are those that the motion tells: nobody knows the forms of rigid bodies that are others."""
        return self.known is False

    @property
    def marker(self) -> np.ndarray:
        """(T, P) the marker of every point, -1 where it is not surely one."""
        names = self.single.copy()
        for marker in np.flatnonzero(self.sure):
            cluster = self.clusters[self.cluster[self.placed.rigid_body[marker]]]
            names[list(cluster.tracklets[self.placed.point[marker]])] = marker
        return np.append(names, -1)[self.tracklet]

    @property
    def labels(self) -> Labels:
        """(T, P) what the motion tells."""
        marker = self.marker
        given = marker != NO_MARKER
        confidence = np.where(given, MOTION_CONFIDENCE, 0.0)
        return Labels(marker, np.where(given, BY_TRAJECTORY, NO_STEP), confidence, np.zeros(marker.shape))

    def suspects(self, verdict: Verdict, names: Sequence[str], first_frame: int) -> tuple[Suspect, ...]:
        """What a person should look at: what is true of the whole take, and then what the verdict has."""
        words = []
        of_all = f"{int((self.cluster >= 0).sum())} of {len(self.cluster)}"
        if self.by_motion:
            recognised = f"{of_all} were recognised by how they move, and are named by that alone"
            words.append(f"the rigid bodies are not those of the training, or sit elsewhere: {recognised}")
            missing = np.setdiff1d(np.arange(len(names)), verdict.labels.marker)
            if len(missing):
                unnamed = " ".join(names[marker] for marker in missing.tolist())
                words.append(f"not found for sure, so unnamed in the whole take: {unnamed}")
        elif self.known is None:
            words.append(
                f"how the rigid bodies move tells only {of_all}, so names rest on the rigid bodies' forms alone: "
                "look whether each is on its limb"
            )
        last = first_frame + len(self.tracklet) - 1
        return tuple(Suspect(first_frame, last, one) for one in words) + verdict.suspects


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
        sure = (matched.cluster != NO_CLUSTER) & (matched.margin >= MARKER_MATCH.min_lead)
        cluster = np.where(sure, matched.cluster, NO_CLUSTER)
        placed = place_markers(structure, clusters, Matched(cluster, matched.margin))
        named = (placed.point != NO_POINT) & (placed.margin >= MARKER_MATCH.min_lead)
        at = _positions(clusters, cluster, placed, named)
        single = np.full(int(tracklet.max(initial=-1)) + 1, -1)
        free = _free(seen, clusters)
        if len(free) and named.any():
            missing = np.flatnonzero(placed.point == NO_POINT)
            single[seen.number[free]] = find_single_markers(rigid_bodies, at, missing, seen.points[:, free])
        known = _known(structure, clusters, cluster, placed, named)
        return Recognition(cluster, placed, named, tuple(clusters), tracklet, single, known)


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


def _known(
    structure: Structure, clusters: list[Cluster], cluster: np.ndarray, placed: Placed, sure: np.ndarray
) -> bool | None:
    """Whether the forms of the take, by the sure markers of each core, are those of the model but for noise."""
    alike = []
    for rigid_body in np.flatnonzero(cluster != NO_CLUSTER):
        inner, body = structure.inner[rigid_body], clusters[cluster[rigid_body]]
        core = inner.members[: inner.core]
        fine = np.flatnonzero(sure[core] & (placed.rigid_body[core] == rigid_body))
        if len(fine) >= MIN_POINTS:
            point = placed.point[core[fine]]
            off = body.lengths[np.ix_(point, point)] - inner.lengths[np.ix_(fine, fine)]
            alike.append(float(np.sqrt((off**2).mean())) < MARKER_LIMITS.noise_m)
    if 2 * len(alike) < len(structure):
        return None
    return bool(np.mean(alike) >= REFUSAL.min_half)
