# SPDX-License-Identifier: GPL-3.0-or-later
"""Labelled frames that nobody recorded: a subject of whom a frame or two are known, in the poses that people take.

A body is laid into the known frame, so that each marker has its place on a segment. Bent as people were recorded to
bend, it shows where the markers are in other poses; with limbs and markers as people have them, it is somebody else.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import BodyModel
from ..data.markersets import MarkerSet
from ..data.takes import evenly_spread
from ..geometry.rigid import pairwise_distances
from ..points.likelihood.shape import cloud_radius
from ..posing.posing import fit_points
from .laying import LAYING
from .poses import mirrored_poses, posed_bodies, poses_of


@dataclass(frozen=True)
class ImaginingOptions:
    """How frames are made up.

    min_frames   a subject with fewer shows no poses; reckoned
    min_sway     parts of the subject's size by which its distances, all but the steadiest tenths, must vary for its
                 frames to show poses: who stands still sways by a hundredth; reckoned
    steadiest    part of the distances that are left out of that
    frames       of each made-up subject; reckoned
    guesses      how many bodies are laid into what is known, each with its joints a little elsewhere; reckoned
    strangers    how many other people are made up beside few who were recorded; reckoned
    max_known    subjects who were recorded, beyond which they show themselves how people differ; reckoned
    stranger_spread       times the spread of sizes, limbs and marker places that a body was learned with: its people
                          show less than there is; chosen on walkers of whom neither body nor model was learned
    stranger_bend_sd_rad  as bend_sd_rad, where the poses are a recorded take's; reckoned
    joint_sd_m   how well a body laid into a frame shows where the joints are; reckoned
    skin_sd_m    how far a marker moves against its bone; as the markers of recorded actors do against a fitted body
    bend_sd_rad  by which a pose is varied, joint by joint: people do what nobody did in the recordings; chosen on four
                 actors, the body of each learned from the others
    """

    min_frames: int = 30
    min_sway: float = 0.03
    steadiest: float = 0.9
    frames: int = 300
    guesses: int = 4
    strangers: int = 4
    max_known: int = 2
    stranger_spread: float = 1.25
    stranger_bend_sd_rad: float = 0.1
    joint_sd_m: float = 0.01
    skin_sd_m: float = 0.006
    bend_sd_rad: float = 0.2


IMAGINING = ImaginingOptions()


def shows_poses(points: np.ndarray, options: ImaginingOptions = IMAGINING) -> bool:
    """Whether a subject's labelled frames (T, M, 3) m show it in more than one pose."""
    if len(points) < options.min_frames:
        return False
    some = points[evenly_spread(len(points), options.frames)]
    distance = pairwise_distances(some)
    known = np.isfinite(distance).sum(axis=0) > 1
    if not known.any():
        return False
    sway = np.quantile(np.nanstd(distance[:, known], axis=0), options.steadiest)
    return bool(sway > options.min_sway * size_of(some))


def size_of(points: np.ndarray) -> float:
    """m, root mean square distance of a subject's markers (T, M, 3) m from their middle."""
    shown = points[np.isfinite(points).any(axis=(1, 2))]
    return cloud_radius(shown)


def imagined(
    markerset: MarkerSet, points: np.ndarray, poses: np.ndarray, seed: int = 0, options: ImaginingOptions = IMAGINING
) -> list[np.ndarray]:
    """Labelled frames (F, M, 3) m of made-up subjects, each a guess at the body of the one of points (T, M, 3) m.

    `poses` (P, J, 3) are those that people take, as `Spread.poses` has them, of the marker set's segments.
    Raises ValueError when no frame shows markers enough.
    """
    rng = np.random.default_rng(seed)
    model = BodyModel(markerset)
    best = np.isfinite(points[..., 0]).sum(axis=1).argmax()
    subject = _body_in(model, points[best])
    both = np.concatenate([poses, mirrored_poses(poses, markerset.skeleton.segments)])
    return [
        _moved(_guess(subject, rng, options), both, rng, options.bend_sd_rad, options) for _ in range(options.guesses)
    ]


def strangers(
    markerset: MarkerSet, points: np.ndarray, count: int, seed: int = 0, options: ImaginingOptions = IMAGINING
) -> list[np.ndarray]:
    """Labelled frames (F, M, 3) m of so many made-up people who move as a subject does in points (T, M, 3) m.

    Their size, limbs and marker places are as people have them. Raises ValueError when no frame shows markers enough.
    """
    rng = np.random.default_rng(seed)
    model = BodyModel(markerset)
    poses = poses_of(markerset, points[evenly_spread(len(points), options.frames)])
    bend_sd = options.stranger_bend_sd_rad
    return [_moved(_stranger(model, rng, options), poses, rng, bend_sd, options) for _ in range(count)]


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


def _guess(laid: _Laid, rng: np.random.Generator, options: ImaginingOptions) -> MarkerSet:
    """The marker set of a body in metres with the markers just where they are, and joints about where they may be."""
    model = laid.model
    joints = laid.joints + options.joint_sd_m * rng.standard_normal(laid.joints.shape)
    above = np.maximum(model.parents, 0)
    offsets = np.einsum("jba,jb->ja", laid.turn[above], joints - joints[above])
    own = model.attachment
    places = np.einsum("mba,mb->ma", laid.turn[own], laid.markers - joints[own])
    return _as_metres(model.markerset, offsets, places)


def _stranger(model: BodyModel, rng: np.random.Generator, options: ImaginingOptions) -> MarkerSet:
    """The marker set of somebody else's body in metres: size, limbs and marker places as people have them."""
    spread = model.markerset.spread
    height = spread.height + spread.height_sd * rng.standard_normal()
    stray = np.tensordot(rng.standard_normal(len(model.modes)), model.modes, axes=1)
    stray[model.joint_count :] += spread.marker_sd[:, None] * rng.standard_normal((model.marker_count, 3))
    offsets = (model.offsets + options.stranger_spread * stray) * np.clip(height, *LAYING.heights_m)
    return _as_metres(model.markerset, offsets[: model.joint_count], offsets[model.joint_count :])


def _as_metres(markerset: MarkerSet, joints: np.ndarray, markers: np.ndarray) -> MarkerSet:
    spread = replace(markerset.spread, height=1.0, modes=np.zeros((0, len(joints) + len(markers), 3)))
    return replace(markerset, skeleton=replace(markerset.skeleton, offsets=joints), offsets=markers, spread=spread)


def _moved(
    body: MarkerSet, poses: np.ndarray, rng: np.random.Generator, bend_sd: float, options: ImaginingOptions
) -> np.ndarray:
    """(F, M, 3) m, a body in metres in some of the poses (P, J, 3), which are varied by bend_sd, rad.

    Its markers move on the skin.
    """
    chosen = poses[rng.choice(len(poses), options.frames, replace=len(poses) < options.frames)]
    chosen = chosen + bend_sd * rng.standard_normal(chosen.shape)
    model = BodyModel(body)
    markers = model.pose(posed_bodies(model, chosen, 1.0)).markers
    return markers + options.skin_sd_m * rng.standard_normal(markers.shape)
