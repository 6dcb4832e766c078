# SPDX-License-Identifier: GPL-3.0-or-later
"""The rigid bodies of a take's own subject: which of its clusters they are, their forms and their distances.

The model is adapted to them, where they are not its own, and what frames say of single names is held against how
everything moves together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...data.lanes import Lanes, standing_in
from ...data.made import Table
from ...data.physical import MARKER_LIMITS
from ...data.takes import BY_TRAJECTORY, NO_MARKER, NO_POINT, NO_STEP, Labels, Suspect, Verdict
from ...geometry.rigid import MIN_POINTS
from ..models import Model
from ..refusals import REFUSAL
from ..rigid_bodies.clusters import NO_CLUSTER, Cluster, Matched, Sampled, find_clusters, match_clusters, sampled
from ..rigid_bodies.markers import Placed, find_single_markers, place_markers
from ..rigid_bodies.model import RigidBodies
from ..rigid_bodies.structure import STRUCTURE, Structure, unseen_is_nan
from .deciding import once


@dataclass(frozen=True)
class RecognitionOptions:
    """What is sure enough to be taken for known.

    min_body_lead    log odds by which a rigid body's cluster must lead; measured on subjects made of the labelled
                     Clouthier takes, with other limbs and rigid bodies of other forms elsewhere on them
    min_marker_lead  log odds by which a marker's point must lead within the rigid body; measured on the same
    """

    min_body_lead: float = 3.0
    min_marker_lead: float = 5.0


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
    return bool(np.mean(alike) >= REFUSAL.min_half)


def adapted(model: Model, seen: Recognition) -> Model:
    """The model with the rigid bodies of the take, where these are not its own, or sit elsewhere."""
    if model.likelihood is None or seen.known is not False:
        return model
    return replace(model, likelihood=replace(model.likelihood, rigid_bodies=seen.rigid_bodies))


def borne_out(
    verdict: Verdict, seen: Recognition, names: Sequence[str], first_frame: int, lanes: Lanes | None = None
) -> Verdict:
    """The names (T, L) without those that the motion of the whole take does not bear out, and what to say of that."""
    labels = verdict.labels
    if seen.known is not False:
        return Verdict(labels, _of_take(seen, [], first_frame) + verdict.suspects)
    found = _found(seen)
    moving = seen.marker != NO_MARKER
    other = moving & labels.named & (seen.marker != labels.marker)
    kept = np.append(found, True)[labels.marker] & ~other
    # What only moves like a marker has its name from that; a rigid body needs three markers to be known by its form.
    moves = ~labels.named & moving
    sure = np.where(kept, labels.confidence, 0.0) + np.where(moves, MOTION_CONFIDENCE, 0.0)
    marker = np.where(moves, seen.marker, np.where(kept, labels.marker, NO_MARKER))
    marker = once(marker, sure, len(names), lanes)
    step = np.where(marker == labels.marker, labels.step, BY_TRAJECTORY)
    given = marker != NO_MARKER
    checked = Labels(marker, np.where(given, step, NO_STEP), np.where(given, sure, 0.0))
    found[seen.marker[moving]] = True
    missing = [names[marker] for marker in np.flatnonzero(~found).tolist()]
    contradicted = _of_contradictions(seen, np.where(other, labels.marker, NO_MARKER), names, first_frame, lanes)
    return Verdict(checked, _of_take(seen, missing, first_frame) + contradicted + verdict.suspects)


def _found(seen: Recognition) -> np.ndarray:
    """(M,) True for markers that single frames may name: on a rigid body of known form, or in a known place."""
    found = np.zeros(len(seen.sure), dtype=bool)
    found[[marker for group in seen.rigid_bodies.members for marker in group]] = True
    found[seen.single[seen.single != NO_MARKER]] = True
    # Beside a rigid body whose form is known, such as an ankle at its foot.
    for marker in np.flatnonzero(seen.sure):
        mates = seen.sure & (seen.placed.rigid_body == seen.placed.rigid_body[marker])
        found[marker] |= found[mates].any()
    return found


def _of_take(seen: Recognition, missing: list[str], first_frame: int) -> tuple[Suspect, ...]:
    """What is true of the whole take, where these markers are `missing` in it."""
    words = []
    of_all = f"{int((seen.cluster >= 0).sum())} of {len(seen.cluster)}"
    if seen.known is False:
        recognised = f"{of_all} were recognised by how they move, and their forms taken from this take"
        words.append(f"the rigid bodies are not those of the training, or sit elsewhere: {recognised}")
        if missing:
            words.append(f"not found for sure, so unnamed in the whole take: {' '.join(missing)}")
    elif seen.known is None:
        words.append(
            f"how the rigid bodies move tells only {of_all}, so names rest on the rigid bodies' forms alone: "
            "look whether each is on its limb"
        )
    return tuple(Suspect(first_frame, first_frame + len(seen.tracklet) - 1, one) for one in words)


def _of_contradictions(
    seen: Recognition, named: np.ndarray, names, first_frame: int, lanes: Lanes | None
) -> tuple[Suspect, ...]:
    """Trajectories that moved as one marker and were named as another, (T, L) where they lost their names."""
    found, marker = [], seen.marker
    standing = standing_in(lanes, named.shape)
    for _, span, lane in standing.each_alone():
        frames = np.flatnonzero(named[span, lane] != NO_MARKER) + span.start
        if len(frames):
            moves, looks = names[marker[frames[0], lane]], names[named[frames[0], lane]]
            words = f"moves as {moves} and looks like {looks}, so it stays unnamed"
            found.append(Suspect(int(frames[0]) + first_frame, int(frames[-1]) + first_frame, words, lane))
    return tuple(found)
