# SPDX-License-Identifier: GPL-3.0-or-later
"""Made-up people in plates: a jointed body of ten plates of four markers, a hand and an ankle, that walks about."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

RATE = 100.0
FRAMES = 400
# name, parent, joint in the parent's axes, middle of the plate in its own, outward, how far it swings about y and x
SEGMENTS = (
    ("PV", None, (0, 0, 0.95), (-0.10, 0.0, 0.03), (-1, 0, 0), 0.15, 0.1),
    ("BK", "PV", (0, 0, 0.10), (-0.12, 0.0, 0.22), (-1, 0, 0), 0.25, 0.2),
    ("HD", "BK", (0, 0, 0.45), (0.02, 0.0, 0.20), (0, 0, 1), 0.4, 0.3),
    ("LUA", "BK", (0, 0.18, 0.38), (0.0, 0.05, -0.14), (0, 1, 0), 0.7, 0.3),
    ("RUA", "BK", (0, -0.18, 0.38), (0.0, -0.05, -0.14), (0, -1, 0), 0.7, 0.3),
    ("LTH", "PV", (0, 0.09, -0.05), (0.03, 0.08, -0.20), (0, 1, 0), 0.6, 0.15),
    ("RTH", "PV", (0, -0.09, -0.05), (0.03, -0.08, -0.20), (0, -1, 0), 0.6, 0.15),
    ("LSH", "LTH", (0, 0, -0.42), (0.0, 0.06, -0.17), (0, 1, 0), 0.6, 0.05),
    ("RSH", "RTH", (0, 0, -0.42), (0.0, -0.06, -0.17), (0, -1, 0), 0.6, 0.05),
    ("LFT", "LSH", (0, 0, -0.42), (0.08, 0.02, -0.05), (0, 0, 1), 0.4, 0.1),
    ("RFT", "RSH", (0, 0, -0.42), (0.08, -0.02, -0.05), (0, 0, 1), 0.4, 0.1),
)
CORNERS = ((0.04, 0.035), (-0.04, 0.03), (-0.035, -0.04), (0.045, -0.035))
LONE = (("LHAND", "LUA", (0.02, 0.0, -0.32)), ("RHAND", "RUA", (0.02, 0.0, -0.32)))
NAMES = (*(f"{part[0]}{corner}" for part in SEGMENTS for corner in "1234"), *(lone[0] for lone in LONE))


@dataclass(frozen=True)
class Body:
    """A person: how long limbs are, where the markers are on each segment."""

    longer: np.ndarray
    markers: tuple[np.ndarray, ...]
    lone: np.ndarray


def body(seed: int = 0, limb: float = 0.0, form: float = 0.0, place: float = 0.0) -> Body:
    """A person; limbs, the forms of plates and their places differ from the first one's by such deviations."""
    rng = np.random.default_rng(seed)
    markers = []
    for index, (_, _, _, middle, outward, _, _) in enumerate(SEGMENTS):
        # Every plate has a form of its own, and the same on every first person.
        own = np.array(CORNERS) + np.random.default_rng(index).normal(0, 0.008, (4, 2)) + rng.normal(0, form, (4, 2))
        across, along = _plane(np.array(outward, float))
        at = np.array(middle) + rng.normal(0, place, 3) * (1 - np.abs(outward))
        markers.append(at + own[:, :1] * across + own[:, 1:] * along)
    longer = 1 + np.clip(rng.normal(0, limb, len(SEGMENTS)), -2 * limb, 2 * limb)
    return Body(longer, tuple(markers), np.array([at for _, _, at in LONE]) * longer[3])


def _plane(outward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forward (or left, where that is outward) and up (or forward) as seen from outside."""
    forward, left, up = np.eye(3)
    if abs(outward[2]) > 0.5:
        return forward, left
    return (forward if abs(outward[1]) > 0.5 else left), up


def walk(person: Body, seed: int = 0, frames: int = FRAMES, liveliness: float = 1.0) -> np.ndarray:
    """(T, M, 3) m: the person's markers while it goes about, each seed another way."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames) / RATE
    turns, joints, clouds = {}, {}, []
    for index, (name, parent, joint, _, _, swing, sway) in enumerate(SEGMENTS):
        angles = [
            liveliness * reach * np.sin(2 * np.pi * rng.uniform(0.3, 0.9) * time + rng.uniform(0, 6))
            for reach in (sway, swing, 0.5 * sway)
        ]
        own = Rotation.from_euler("xyz", np.stack(angles, axis=1)).as_matrix()
        if parent is None:
            heading = Rotation.from_euler("z", (liveliness * 0.8 * np.sin(0.5 * time))[:, None]).as_matrix()
            turns[name] = heading @ own
            along = liveliness * np.stack([np.cos(0.4 * time) * time, np.sin(0.4 * time) * time], axis=1)
            joints[name] = np.concatenate([along, np.full((frames, 1), joint[2])], axis=1)
        else:
            place = np.array(joint) * person.longer[[part[0] for part in SEGMENTS].index(parent)]
            turns[name] = turns[parent] @ own
            joints[name] = joints[parent] + turns[parent] @ place
        clouds.append(np.einsum("tij,nj->tni", turns[name], person.markers[index]) + joints[name][:, None])
    for (_, segment, _), at in zip(LONE, person.lone, strict=True):
        # A hand turns a little about the wrist, so it is on no plate.
        bend = 0.03 * np.sin(2 * np.pi * 0.7 * time[:, None] + np.arange(3)) * liveliness
        clouds.append((np.einsum("tij,tj->ti", turns[segment], at + bend) + joints[segment])[:, None])
    return np.concatenate(clouds, axis=1) + rng.normal(0, 0.0003, (frames, len(NAMES), 3))
