# SPDX-License-Identifier: GPL-3.0-or-later
"""The layout of a marker set on a body: what its cloud looks like, also when a marker is moved or added.

A marker that sits elsewhere on its segment is its old place plus the segment's rotation times a fixed vector. How the
segments turn follows, linearly, from where the markers are; so the moved marker is a Gaussian like all the others.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import BodyModel
from ..data.errors import InputError
from ..data.markersets import MarkerSet
from ..geometry.rigid import MIN_POINTS
from ..geometry.upright import best_yaw, turned
from ..points.likelihood.model import Likelihood
from ..points.likelihood.shape import Shape, learn_shape
from ..simulation.virtual import draw_person

DRAWN_PEOPLE, DRAWN_POSES = 16, 50  # drawn from a marker set's spread, and of each of them
TURN_RIDGE_M = 0.01  # no segment's turn is read off finer differences than this, as markers move on skin


@dataclass(frozen=True, eq=False)
class Turns:
    """How J segments are turned, as linear functions of the shape's modes, in the frame of the shape's mean.

    mean (J, 3, 3), modes (J, 3, 3, K) for one standard deviation, left (J, 9, 9) covariance of what the modes leave
    """

    mean: np.ndarray
    modes: np.ndarray
    left: np.ndarray

    def carry(self, segment: int, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Mean (3,), modes (3, K) and left variance of an offset (3,) m that turns with a segment."""
        spread = np.kron(np.eye(3), offset)
        left = float(np.trace(spread @ self.left[segment] @ spread.T) / 3)
        return self.mean[segment] @ offset, np.einsum("abk,b->ak", self.modes[segment], offset), left


@dataclass(frozen=True, eq=False)
class MarkerLayout:
    """A marker set, the shape of its cloud, and how its segments turn."""

    markerset: MarkerSet
    shape: Shape
    turns: Turns
    subjects: int | None = None  # how many the shape is learned from; None where it is drawn from the set's own spread

    def moved(self, marker: int, offset: np.ndarray) -> "MarkerLayout":
        """The same with a marker at another offset (3,) of its segment, heights."""
        old, shape = self.markerset, self.shape
        away = (offset - old.offsets[marker]) * old.spread.height
        carried = self.turns.carry(int(old.attachment[marker]), away)
        parts = shape.mean.copy(), shape.modes.copy(), shape.noise.copy()
        for part, more in zip(parts, carried, strict=True):
            part[marker] += more
        offsets = old.offsets.copy()
        offsets[marker] = offset
        return replace(self, markerset=replace(old, offsets=offsets), shape=Shape(*parts))

    def added(self, name: str, segment: int, offset: np.ndarray) -> "MarkerLayout":
        """The same with one more marker on a segment that has one already; InputError where it has none."""
        near = self.anchor(segment, offset)
        old, spread = self.markerset, self.markerset.spread
        shape = self.shape
        wider = replace(
            old,
            markers=(*old.markers, name),
            attachment=np.append(old.attachment, segment),
            offsets=np.concatenate([old.offsets, old.offsets[near][None]]),
            spread=replace(
                spread,
                modes=np.concatenate([spread.modes, spread.modes[:, [len(old.skeleton) + near]]], axis=1),
                marker_sd=np.append(spread.marker_sd, np.median(spread.marker_sd)),
            ),
        )
        noise = np.append(shape.noise, max(shape.noise[near], float(np.median(shape.noise))))
        twin = Shape(
            np.append(shape.mean, shape.mean[[near]], 0), np.append(shape.modes, shape.modes[[near]], 0), noise
        )
        return replace(self, markerset=wider, shape=twin).moved(len(old), offset)

    def anchor(self, segment: int, offset: np.ndarray) -> int:
        """The marker of a segment that is nearest to an offset (3,), heights."""
        here = np.flatnonzero(self.markerset.attachment == segment)
        if not len(here):
            name = self.markerset.skeleton.segments[segment]
            raise InputError(f"nothing is known of how {name} moves; expected a marker on it")
        return int(here[np.linalg.norm(self.markerset.offsets[here] - offset, axis=1).argmin()])


def marker_layout(
    markerset: MarkerSet, base: MarkerSet | None = None, learned: Likelihood | None = None, seed: int = 0
) -> MarkerLayout:
    """A marker set with the shape of its cloud: as `learned` from takes, else drawn from the set's own spread.

    With `base` the set is one that was edited: markers of `base` that were moved, added or taken away since; what was
    learned is then of the base.
    Raises InputError for a set of fewer than three markers.
    """
    if len(markerset) < MIN_POINTS:
        raise InputError(f"{markerset.name} has {len(markerset)} markers; expected {MIN_POINTS} or more to compare")
    source = markerset if base is None else base
    if learned is not None and (learned.markers != source.markers or not _follows(markerset, source)):
        learned = None
    known = markerset if learned is None else source
    clouds, rotations = _drawn(known, seed)
    shape = learn_shape(list(clouds), seed) if learned is None else learned.shape
    subjects = None if learned is None else learned.subjects
    found = MarkerLayout(known, shape, _turns(shape, clouds, rotations), subjects)
    return found if known is markerset else _edited(found, markerset)


def _follows(markerset: MarkerSet, base: MarkerSet) -> bool:
    """Whether every marker of an edited set sits on a segment where the base has one."""
    same = markerset.skeleton.segments == base.skeleton.segments
    return same and set(markerset.attachment.tolist()) <= set(np.asarray(base.attachment).tolist())


def _edited(found: MarkerLayout, markerset: MarkerSet) -> MarkerLayout:
    """The base's shape with every marker where the edited set has it."""
    base, rows = found.markerset, []
    for index, name in enumerate(markerset.markers):
        segment, offset = int(markerset.attachment[index]), markerset.offsets[index]
        known = base.markers.index(name) if name in base.markers else -1
        if known < 0 or base.attachment[known] != segment:
            rows.append(len(found.markerset))
            found = found.added(name, segment, offset)
            continue
        rows.append(known)
        if not np.allclose(offset, base.offsets[known]):
            found = found.moved(known, offset)
    shape = Shape(found.shape.mean[rows], found.shape.modes[rows], found.shape.noise[rows])
    return MarkerLayout(markerset, shape, found.turns, found.subjects)


def _drawn(markerset: MarkerSet, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Markers (P, F, M, 3) m of people drawn from the spread in poses drawn from it, and rotations (P, F, J, 3, 3)."""
    generator, model, spread = np.random.default_rng(seed), BodyModel(markerset), markerset.spread
    joints = len(markerset.skeleton)
    values, vectors = np.linalg.eigh(spread.pose_covariance)
    root = vectors * np.sqrt(np.maximum(values, 0))
    clouds, rotations = [], []
    for _ in range(DRAWN_PEOPLE):
        person = draw_person(markerset, generator).pick(np.zeros(DRAWN_POSES, dtype=int))
        drawn = (generator.standard_normal((DRAWN_POSES, 3 * joints)) @ root.T).reshape(-1, joints, 3)
        posed = model.pose(replace(person, bends=spread.pose_mean + drawn))
        clouds.append(posed.markers)
        rotations.append(posed.rotations)
    return np.array(clouds), np.array(rotations)


def _turns(shape: Shape, clouds: np.ndarray, rotations: np.ndarray) -> Turns:
    """How segments turn, by ridge regression on the markers of drawn people."""
    markers = clouds.reshape(-1, *clouds.shape[2:])
    rotations = rotations.reshape(len(markers), -1, 3, 3)
    own, goal = markers - markers.mean(axis=1, keepdims=True), shape.mean - shape.mean.mean(axis=0)
    yaw = best_yaw(own, goal)
    flat = turned(own, yaw).reshape(len(own), -1)
    turn = turned(rotations.swapaxes(-1, -2), yaw[:, None].repeat(rotations.shape[1], axis=1)).swapaxes(-1, -2)
    target = turn.reshape(len(turn), rotations.shape[1], 9)
    middle, mean = flat.mean(axis=0), target.mean(axis=0)
    centred, aims = flat - middle, (target - mean).reshape(len(flat), -1)
    normal = centred.T @ centred / len(flat) + TURN_RIDGE_M**2 * np.eye(flat.shape[1])
    slope = np.linalg.solve(normal, centred.T @ aims / len(flat))
    rest = (aims - centred @ slope).reshape(len(flat), -1, 9)
    modes = shape.modes.reshape(len(slope), -1).T @ slope
    joints = rotations.shape[1]
    return Turns(
        mean.reshape(joints, 3, 3),
        np.moveaxis(modes.reshape(-1, joints, 3, 3), 0, -1),
        np.einsum("nja,njb->jab", rest, rest) / len(flat),
    )
