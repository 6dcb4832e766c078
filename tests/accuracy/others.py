# SPDX-License-Identifier: GPL-3.0-or-later
"""Another person made of a labelled take of plates: other limbs, and plates of other forms elsewhere on them.

The motion is the recorded one; everything that people and their plates differ by is drawn anew.
"""

from dataclasses import dataclass

import numpy as np

from addon.core.geometry.rigid import laid_on
from addon.core.points.rigid_bodies.structure import Structure, find_joints

MIRROR = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Differs:
    """Standard deviations of how people and their plates differ.

    limb   part of the length of a limb, and size, part of the whole
    form   m that markers sit elsewhere on their plate
    place  m that a plate sits elsewhere on its limb, and turn, rad
    """

    limb: float = 0.06
    size: float = 0.05
    form: float = 0.005
    place: float = 0.015
    turn: float = 0.2


def other_person(points: np.ndarray, structure: Structure, rng: np.random.Generator, differs: Differs) -> np.ndarray:
    """The take (T, M, 3) m, NaN where missing, as another person in other plates would have moved in it."""
    cores = [inner.members[: inner.core] for inner in structure.inner]
    forms = [inner.form[: inner.core] for inner in structure.inner]
    poses = [laid_on(form, points[:, core]) for form, core in zip(forms, cores, strict=True)]
    turn, place = (np.stack(part, axis=1) for part in zip(*poses, strict=True))
    moved = _other_limbs(turn, place, rng, differs.limb)
    size = 1 + np.clip(rng.normal(0, differs.size), -2 * differs.size, 2 * differs.size)
    made = np.full(points.shape, np.nan)
    middles = np.where(np.isfinite(place).all(axis=2, keepdims=True), place, np.inf)
    for marker in range(points.shape[1]):
        # A marker on no plate goes with the one that it moves with most.
        rigid_body = next((index for index, core in enumerate(cores) if marker in core), None)
        if rigid_body is None:
            distance = np.linalg.norm(points[:, marker, None] - middles, axis=2)
            rigid_body = int(np.nanargmin(np.nanmean(np.where(np.isfinite(distance), distance, np.nan), axis=0)))
        local = np.einsum("tji,tj->ti", turn[:, rigid_body], points[:, marker] - place[:, rigid_body])
        made[:, marker] = np.einsum("tij,tj->ti", turn[:, rigid_body], local) + moved[:, rigid_body]
    for rigid_body, (core, form) in enumerate(zip(cores, forms, strict=True)):
        other = _other_plate(form, rng, differs)
        seen = np.isfinite(points[:, core, :1])
        made[:, core] = np.where(
            seen, np.einsum("tij,nj->tni", turn[:, rigid_body], other) + moved[:, rigid_body, None], np.nan
        )
    return made * size


def mirrored(points: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """The take as its mirror image, left and right named anew."""
    return points[:, [_other_side(index, names) for index in range(len(names))]] * MIRROR


def _other_side(index: int, names: tuple[str, ...]) -> int:
    """The marker whose name has an R for an L of this one's, or the other way round, wherever it is; itself if none."""
    name = names[index]
    for place, letter in enumerate(name):
        other = name[:place] + {"L": "R", "R": "L"}.get(letter, letter) + name[place + 1 :]
        if other != name and other in names:
            return names.index(other)
    return index


def _other_plate(form: np.ndarray, rng: np.random.Generator, differs: Differs) -> np.ndarray:
    """The markers (n, 3) of a plate of another form, put on elsewhere and turned in its plane."""
    _, _, axes = np.linalg.svd(form, full_matrices=True)
    flat = form @ axes.T
    flat[:, :2] += rng.normal(0, differs.form, (len(form), 2))
    angle = rng.normal(0, differs.turn)
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    flat[:, :2] = flat[:, :2] @ turned + rng.normal(0, differs.place, 2)
    return flat @ axes


def _other_limbs(turn: np.ndarray, place: np.ndarray, rng: np.random.Generator, limb: float) -> np.ndarray:
    """Where the plates are (T, K, 3) when every limb has another length: out from one plate, joint by joint."""
    joints = find_joints(turn, place)
    moved = place.copy()
    miss = np.where(np.isfinite(joints.miss), joints.miss, np.inf)
    done = [int(np.argmin(np.sort(miss, axis=1)[:, :3].sum(axis=1)))]
    longer = 1 + np.clip(rng.normal(0, limb, len(miss)), -2 * limb, 2 * limb)
    while len(done) < len(miss):
        rest = [rigid_body for rigid_body in range(len(miss)) if rigid_body not in done]
        rigid_body = min(rest, key=lambda index: miss[index, done].min())
        parent = done[int(np.argmin(miss[rigid_body, done]))]
        here, there = longer[parent] * joints.at[parent, rigid_body], longer[rigid_body] * joints.at[rigid_body, parent]
        at = np.einsum("tij,j->ti", turn[:, parent], joints.at[parent, rigid_body]) + place[:, parent]
        own = np.einsum("tij,j->ti", turn[:, rigid_body], joints.at[rigid_body, parent]) + place[:, rigid_body]
        joint = np.einsum("tij,j->ti", turn[:, parent], here) + moved[:, parent]
        # How the two ends of the recorded joint part, as joints of flesh do, stays as it was.
        moved[:, rigid_body] = joint + (own - at) - np.einsum("tij,j->ti", turn[:, rigid_body], there)
        moved[:, rigid_body] = np.where(np.isfinite(moved[:, rigid_body]), moved[:, rigid_body], place[:, rigid_body])
        done.append(rigid_body)
    return moved
