# SPDX-License-Identifier: GPL-3.0-or-later
"""A body with more joints than its markers were named by: what markers or the floor show of trunk, toes and fingers.

At rest it is the same body, and people differ as they did. What bent at the trunk's one joint bends at two, as far from
that joint as the pelvis is, half each; and shoulders, with what is on them, move about the inner ends of clavicles.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..body.sides import BODY_SIDES
from ..data.markersets import MarkerSet, Skeleton
from .character import SHOULDER
from .ends import STILL_RAD, with_ends

LEAST_MARKERS = 3  # physical: that say how a part is turned


def finer(markerset: MarkerSet) -> MarkerSet:
    """The set with the joints that its markers or the floor can show; itself where they show no more than it has."""
    return with_ends(_with_trunk(markerset))


def _with_trunk(markerset: MarkerSet) -> MarkerSet:
    segments, shoulders = markerset.skeleton.segments, _on_shoulders(markerset)
    on = dict(zip(segments, np.bincount(markerset.attachment, minlength=len(segments)), strict=True))
    if not shoulders or min(on["thorax"] - len(shoulders), on["pelvis"]) < LEAST_MARKERS:
        return markerset
    rows = list(_segments(markerset, set(shoulders.values())))
    names = tuple(name for name, *_ in rows)
    parents = np.array([names.index(above) if above else -1 for _, above, *_ in rows])
    places, bends = (np.array([row[part] for row in rows]) for part in (2, 3))
    carriers = [segments[one] for one in markerset.attachment]
    attachment = np.array([names.index(shoulders.get(at, one)) for at, one in enumerate(carriers)])

    def moved(joints: np.ndarray, markers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Joints (…, J, 3) from those above them and markers (…, M, 3) from their joints, by places of both."""
        own = places @ joints
        above = np.where(parents[:, None] < 0, 0.0, own[..., parents, :])
        return own - above, markers - own[..., attachment, :]

    rest = markerset.skeleton.rest_joints
    offsets, of_markers = moved(rest, markerset.rest_markers)
    spread, capsules, count = markerset.spread, markerset.capsules, len(segments)
    modes = spread.modes.copy()
    for index, parent in enumerate(markerset.skeleton.parents):
        modes[:, index] += modes[:, parent] if parent >= 0 else 0.0
    modes[:, count:] += modes[:, markerset.attachment]
    whole = np.kron(bends, np.eye(3))
    segment = np.array([names.index(segments[one]) for one in capsules.segment], int)
    shift = (rest[capsules.segment] - (places @ rest)[segment]).reshape(-1, 3)
    return replace(
        markerset,
        skeleton=Skeleton(names, parents, offsets),
        attachment=attachment,
        offsets=of_markers,
        capsules=replace(capsules, segment=segment, start=capsules.start + shift, end=capsules.end + shift),
        spread=replace(
            spread,
            modes=np.concatenate(moved(modes[:, :count], modes[:, count:]), axis=1),
            pose_mean=bends @ spread.pose_mean,
            pose_covariance=whole @ spread.pose_covariance @ whole.T,
            poses=np.zeros((0, 0, 3)),
            stiffness=_stiffness(names, offsets),
        ),
    )


def without(markerset: MarkerSet, marker: int) -> MarkerSet:
    """The finer set for frames in which a marker is missing: a clavicle that carries no other one keeps still."""
    at = int(markerset.attachment[marker])
    stiffness = markerset.spread.stiffness
    if stiffness is None or not markerset.skeleton.segments[at].startswith("clavicle"):
        return markerset
    if np.count_nonzero(markerset.attachment == at) > 1:
        return markerset
    stiffness, own = stiffness.copy(), slice(3 * at, 3 * at + 3)
    stiffness[own, own] = np.eye(3) / STILL_RAD**2
    return replace(markerset, spread=replace(markerset.spread, stiffness=stiffness))


def _stiffness(names: tuple[str, ...], offsets: np.ndarray) -> np.ndarray:
    """(3J, 3J) 1/rad² that keeps clavicles from turning about themselves; offsets (J, 3) of joints from those above."""
    found = np.zeros((3 * len(names), 3 * len(names)))
    for at in (number for number, name in enumerate(names) if name.startswith("clavicle")):
        along = offsets[at + 1] / np.linalg.norm(offsets[at + 1])  # to the arm, which comes next
        found[3 * at : 3 * at + 3, 3 * at : 3 * at + 3] = np.outer(along, along) / STILL_RAD**2
    return found


def _on_shoulders(markerset: MarkerSet) -> dict[int, str]:
    """The clavicle of each marker of the thorax that is nearer to a shoulder's joint than to the body's middle."""
    segments, rest, places = markerset.skeleton.segments, markerset.skeleton.rest_joints, markerset.rest_markers
    arms = {side: f"upper_arm.{side}" for side in BODY_SIDES}
    if not {"pelvis", "thorax", "head", *arms.values()} <= set(segments):
        return {}
    above = dict(zip(segments, (segments[at] for at in markerset.skeleton.parents), strict=True))
    if above["thorax"] != "pelvis" or {above[arm] for arm in arms.values()} != {"thorax"}:
        return {}
    found = {}
    for marker in np.flatnonzero(markerset.attachment == segments.index("thorax")).tolist():
        for side, arm in arms.items():
            if np.linalg.norm(places[marker] - rest[segments.index(arm)]) < abs(places[marker, 1]):
                found[marker] = f"clavicle.{side}"
    return found


def _segments(markerset: MarkerSet, clavicles: set[str]) -> Iterator[tuple[str, str | None, np.ndarray, np.ndarray]]:
    """Each segment with the one above it, and its joint's place and its bend as parts (J,) of those that there were."""
    skeleton = markerset.skeleton
    own = dict(zip(skeleton.segments, np.eye(len(skeleton)), strict=True))
    for name, parent in zip(skeleton.segments, skeleton.parents, strict=True):
        above = skeleton.segments[parent] if parent >= 0 else None
        clavicle = f"clavicle.{name[-1]}"
        if name == "thorax":
            half = (own["thorax"] - own["pelvis"]) / 2
            yield "lumbar", above, own[name] - half, own[name] / 2
            yield name, "lumbar", own[name] + half, own[name] / 2
        elif name.startswith("upper_arm") and clavicle in clavicles:
            yield clavicle, above, (1 - SHOULDER) * own["head"] + SHOULDER * own[name], 0 * own[name]
            yield name, clavicle, own[name], own[name]
        else:
            yield name, above, own[name], own[name]
