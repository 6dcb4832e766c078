# SPDX-License-Identifier: GPL-3.0-or-later
"""Anonymous frames made of labelled ones: markers hidden, ghosts added, points shuffled, the truth kept."""

from dataclasses import dataclass

import numpy as np

from .shape import cloud_radius


@dataclass(frozen=True)
class TrialOptions:
    """Where the points of trials lie.

    around_radii     beyond the subject's own box where ghosts still appear; physical: 40 cm, a hand's reach
    beside_sd_radii  standard deviation of where a marker of another set sits about one of this; physical: 20 cm
    max_along        how far along the line through two markers others may sit, in parts of their distance; physical:
                     sets have markers between theirs, and beyond the last of a limb
    """

    around_radii: float = 0.5
    beside_sd_radii: float = 0.25
    max_along: float = 1.5


TRIAL = TrialOptions()


@dataclass(frozen=True, eq=False)
class Trial:
    """Frames with nothing but points.

    points  (F, P, 3) m, NaN where there is none
    truth   (F, P) the marker, -1 for ghosts and where there is no point
    """

    points: np.ndarray
    truth: np.ndarray


def crowded(trial: Trial, labelled: np.ndarray, most: int, rng: np.random.Generator) -> Trial:
    """The trial of labelled clouds (F, M, 3) m with up to `most` points more a frame, as markers that the set lacks.

    Half of them sit beside markers, as on a foot that is marked all over; half anywhere along the line through two, as
    those on a part of the body that the set leaves out.
    """
    frames, markers = labelled.shape[:2]
    radius = cloud_radius(labelled)
    one, other = np.moveaxis(rng.integers(0, markers, (frames, most, 2)), 2, 0)
    rows = np.arange(frames)[:, None]
    part = np.where(np.arange(most) % 2, rng.uniform(1 - TRIAL.max_along, TRIAL.max_along, (frames, most)), 0)
    extra = labelled[rows, one] + part[..., None] * (labelled[rows, other] - labelled[rows, one])
    extra += TRIAL.beside_sd_radii * radius * rng.standard_normal(extra.shape)
    extra[np.arange(most) >= rng.integers(0, most + 1, (frames, 1))] = np.nan
    return Trial(
        np.concatenate([trial.points, extra], axis=1),
        np.concatenate([trial.truth, np.full((frames, most), -1)], axis=1),
    )


def make_trial(
    labelled: np.ndarray, hidden: tuple[int, int], ghosts: tuple[int, int], rng: np.random.Generator
) -> Trial:
    """A trial out of labelled clouds (F, M, 3) m, NaN where missing.

    Of each frame's markers a number within `hidden` (both ends included) is taken away, and a number within `ghosts` of
    points anywhere about the subject is added.
    """
    frames, markers = labelled.shape[:2]
    seen = np.isfinite(labelled[..., 0])
    radius = cloud_radius(labelled)
    gone = rng.integers(hidden[0], hidden[1] + 1, (frames, 1))
    order = np.argsort(np.where(seen, rng.random((frames, markers)), 2), axis=1)
    kept = seen & (np.argsort(order, axis=1) >= gone)
    extra = rng.integers(ghosts[0], ghosts[1] + 1, (frames, 1))
    room = TRIAL.around_radii * radius
    low, high = np.nanmin(labelled, axis=1) - room, np.nanmax(labelled, axis=1) + room
    low[:, 2] = np.maximum(low[:, 2], min(0.0, np.nanmin(labelled[..., 2])))
    spread = low[:, None] + (high - low)[:, None] * rng.random((frames, ghosts[1], 3))
    spread[np.arange(ghosts[1]) >= extra] = np.nan
    cloud = np.concatenate([np.where(kept[..., None], labelled, np.nan), spread], axis=1)
    truth = np.concatenate([np.where(kept, np.arange(markers), -1), np.full((frames, ghosts[1]), -1)], axis=1)
    # Shuffled, with the places that hold no point last.
    shuffle = np.argsort(np.where(np.isfinite(cloud[..., 0]), rng.random(truth.shape), 2), axis=1)
    cloud, truth = np.take_along_axis(cloud, shuffle[..., None], axis=1), np.take_along_axis(truth, shuffle, axis=1)
    width = max(int(np.isfinite(cloud[..., 0]).sum(axis=1).max()), 1)
    return Trial(cloud[:, :width], truth[:, :width])
