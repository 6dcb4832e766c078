# SPDX-License-Identifier: GPL-3.0-or-later
"""Labelled frames that nobody recorded: a subject of whom a frame or two are known, in other poses.

A body is laid into the known frame, so that each marker has its place on a segment. Bent as people were recorded to
bend, it shows where the markers are in other poses; with limbs and markers as people have them, it is somebody else.
What is no person bends between neighbours.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import BodyModel
from ..data.markersets import MarkerSet
from ..data.physical import MARKER_LIMITS, possible_height
from ..data.takes import evenly_spread
from ..geometry import rotations
from ..points.likelihood.learn import LEARN
from ..points.likelihood.shape import cloud_radius
from ..points.whole_take.pairs import PAIRING, is_still, moments
from ..posing.posing import fit_points
from .poses import posed_bodies, poses_of, with_mirrored
from .spread import SPREAD, some_of


class IMAGINING:
    """How frames are made up."""

    frames: int = 300  # of each made-up subject; memory: a walk of three seconds
    # that links of what is no person bend; twice as much names 81 % of the hand, four times as much 57 %, nothing wrong
    link_sd_rad: float = 0.1  # measured on a hand and a rat learned from a frame
    people: int = 4  # made-up bodies of who is shown in one pose, or beside few who were recorded; memory
    # times the spread of sizes, limbs and marker places that a body was learned with, whose people show too little
    wider: float = 1.25  # measured on walkers of whom neither body nor model was learned
    joint_sd_m: float = 0.01  # how well a body laid into a frame shows where the joints are; physical: 1 cm


def shows_poses(points: np.ndarray) -> bool:
    """Whether a subject's labelled frames (T, M, 3) m show it in more than one pose."""
    return len(points) >= LEARN.min_frames and not is_still(moments(some_of(points)))


def size_of(points: np.ndarray) -> float:
    """m, root mean square distance of a subject's markers (T, M, 3) m from their middle."""
    shown = points[np.isfinite(points).any(axis=(1, 2))]
    return cloud_radius(shown)


def imagined(markerset: MarkerSet, points: np.ndarray, poses: np.ndarray) -> list[np.ndarray]:
    """Labelled frames (F, M, 3) m of made-up subjects, each a guess at the body of the one of points (T, M, 3) m.

    `poses` (P, J, 3) are those that people take, as `Spread.poses` has them, of the marker set's segments.
    Raises ValueError when no frame shows markers enough.
    """
    rng, model, both = np.random.default_rng(0), BodyModel(markerset), with_mirrored(markerset, poses)
    subject = _body_in(model, points[np.isfinite(points[..., 0]).sum(axis=1).argmax()])
    return [_moved(_guess(subject, rng), both, rng) for _ in range(IMAGINING.people)]


def anybody(markerset: MarkerSet, poses: np.ndarray, count: int, seed: int = 0) -> list[np.ndarray]:
    """Labelled frames (F, M, 3) m of so many made-up people, with size, limbs and marker places as people have them.

    They take the `poses` (P, J, 3), as `Spread.poses` has them.
    """
    rng, model = np.random.default_rng(seed), BodyModel(markerset)
    return [_moved(_stranger(model, rng), poses, rng) for _ in range(count)]


def bent(points: np.ndarray) -> list[np.ndarray]:
    """Labelled frames (F, M, 3) m of made-up subjects of whose body nothing is known but points (T, M, 3) m of a pose.

    Markers are a tree of nearest neighbours, each link of which keeps its length and turns.
    """
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    rng = np.random.default_rng(0)
    frame = points[np.isfinite(points[..., 0]).sum(axis=1).argmax()]
    there = np.flatnonzero(np.isfinite(frame).all(axis=1))
    cloud = frame[there]
    away = np.linalg.norm(cloud[:, None] - cloud, axis=2)
    tree = minimum_spanning_tree(away + np.finfo(float).tiny)  # to SciPy 0 is no link
    order, above = breadth_first_order(tree, int(away.sum(axis=1).argmin()), directed=False)
    made = np.full((IMAGINING.people, IMAGINING.frames, len(frame), 3), np.nan)
    turns = rotations.turn_of(IMAGINING.link_sd_rad * rng.standard_normal((*made.shape[:2], len(cloud), 3)))
    made[:, :, there[order[0]]] = cloud[order[0]]
    for marker in order[1:]:
        turns[:, :, marker] = turns[:, :, above[marker]] @ turns[:, :, marker]
        link = turns[:, :, marker] @ (cloud[marker] - cloud[above[marker]])
        made[:, :, there[marker]] = made[:, :, there[above[marker]]] + link
    return list(made + SPREAD.marker_sd * np.ptp(cloud, axis=0).max() * rng.standard_normal(made.shape))


def moves(points: np.ndarray) -> bool:
    """Whether a subject's labelled frames (T, M, 3) m, if enough, show it in more than one place, or turned."""
    if len(points) < LEARN.min_frames:
        return False
    shown = points[:, np.isfinite(points[..., 0]).any(axis=0)]
    return bool((np.nanstd(shown, axis=0) > PAIRING.min_sway * size_of(points)).any())


def strangers(markerset: MarkerSet, points: np.ndarray, count: int, seed: int = 0) -> list[np.ndarray]:
    """Labelled frames (F, M, 3) m of so many made-up people who move as a subject does in points (T, M, 3) m.

    Their size, limbs and marker places are as people have them. Raises ValueError when no frame shows markers enough.
    """
    poses = poses_of(markerset, points[evenly_spread(len(points), IMAGINING.frames)])
    return anybody(markerset, poses, count, seed)


@dataclass(frozen=True, eq=False)
class _Laid:
    """A body laid into a frame: rotations (J, 3, 3) of its segments, joints (J, 3) and markers (M, 3) m, world."""

    model: BodyModel
    turn: np.ndarray
    joints: np.ndarray
    markers: np.ndarray


def _body_in(model: BodyModel, frame: np.ndarray) -> _Laid:
    """The body in one labelled frame (M, 3) m; markers that are missing there are where the body has them."""
    posed = model.pose(fit_points(model, frame[None]))
    markers = np.where(np.isfinite(frame), frame, posed.markers[0])
    return _Laid(model, posed.rotations[0], posed.joints[0], markers)


def _guess(laid: _Laid, rng: np.random.Generator) -> MarkerSet:
    """The marker set of a body in metres with the markers just where they are, and joints about where they may be."""
    model = laid.model
    joints = laid.joints + IMAGINING.joint_sd_m * rng.standard_normal(laid.joints.shape)
    above = np.maximum(model.parents, 0)
    offsets = np.einsum("jba,jb->ja", laid.turn[above], joints - joints[above])
    own = model.attachment
    places = np.einsum("mba,mb->ma", laid.turn[own], laid.markers - joints[own])
    return _as_metres(model.markerset, offsets, places)


def _stranger(model: BodyModel, rng: np.random.Generator) -> MarkerSet:
    """The marker set of somebody else's body in metres: size, limbs and marker places as people have them."""
    spread = model.markerset.spread
    height = spread.height + spread.height_sd * rng.standard_normal()
    stray = np.tensordot(rng.standard_normal(len(model.modes)), model.modes, axes=1)
    stray[model.joint_count :] += spread.marker_sd[:, None] * rng.standard_normal((model.marker_count, 3))
    offsets = (model.offsets + IMAGINING.wider * stray) * possible_height(height)
    return _as_metres(model.markerset, offsets[: model.joint_count], offsets[model.joint_count :])


def _as_metres(markerset: MarkerSet, joints: np.ndarray, markers: np.ndarray) -> MarkerSet:
    spread = replace(markerset.spread, height=1.0, modes=np.zeros((0, len(joints) + len(markers), 3)))
    return replace(markerset, skeleton=replace(markerset.skeleton, offsets=joints), offsets=markers, spread=spread)


def _moved(body: MarkerSet, poses: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(F, M, 3) m, a body in metres in some of the poses (P, J, 3), which are varied; its markers move on the skin."""
    chosen = poses[rng.choice(len(poses), IMAGINING.frames, replace=len(poses) < IMAGINING.frames)]
    chosen = chosen + SPREAD.bend_sd_rad * rng.standard_normal(chosen.shape)
    model = BodyModel(body)
    markers = model.pose(posed_bodies(model, chosen, 1.0)).markers
    return markers + MARKER_LIMITS.skin_m * rng.standard_normal(markers.shape)
