# SPDX-License-Identifier: GPL-3.0-or-later
"""The same of naming points by likelihood: see `calls`."""

import math
from ctypes import Structure

import numpy as np

from .library import compiled
from .structures import FLAG, INDEX, SINGLE, call, filled, given, indices, once_each


def softly(model, points, present, ghost, latent, schedule) -> tuple[np.ndarray, ...]:
    """Stands for `starts.softly`."""
    (count, width), markers, size = present.shape, len(model), model.size
    points, latent = np.array(points, float, order="C"), np.array(latent, float, order="C")
    schedule = np.array(schedule, float)
    schedule[:, 1] *= model.radius**2
    kept = (
        given(points, (count, width, 3)),
        given(latent, (count, size)),
        given(present, (count, width), FLAG),
        given(ghost, (count,)),
        given(model.by_modes, (markers,)),
        given(schedule, (len(schedule), 2)),
    )
    share, fitness = np.empty((count, markers, width)), np.empty(count)
    scratch = np.empty(size * size + markers * (width + 4) + 5 * width)
    done = call(compiled.softly, gaussian_arrays(model), count, width, len(schedule), *kept, share, fitness, scratch)
    if not done:
        raise np.linalg.LinAlgError("the precision of a guess is not positive definite")
    return points, latent, share, fitness


def settled(model, constraints, points, naming, worth) -> tuple[np.ndarray, ...]:
    """Stands for `naming.settled`."""
    count, markers, size = len(naming), len(model), model.size
    halves = np.empty((count, markers, 3)), np.empty((count, markers, 3)), np.empty((count, markers, 3, size))
    return *_settled(model, constraints, points, naming, worth, halves), *halves


def score_of(model, constraints, points, worth, naming) -> np.ndarray:
    """Stands for `naming.score_of`."""
    return _settled(model, constraints, points, naming, worth, (None, None, None))[1]


def expected_of(model, points, naming, markers) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stands for `naming.expected_of`."""
    count, every, size = len(naming), len(model), model.size
    halves = np.empty((count, every, 3)), np.empty((count, every, 3)), np.empty((count, every, 3, size))
    points, _, _ = _settled(model, None, points, naming, np.zeros(count), halves)
    half = halves[2][:, markers].reshape(count, -1, size)
    return points, halves[0][:, markers], half @ half.swapaxes(1, 2)


def _settled(model, constraints, points, naming, worth, halves) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    (count, markers), width = naming.shape, points.shape[1]
    points = np.array(points, float, order="C")
    points, naming = given(points, (count, width, 3)), indices(naming, (count, len(model)), width, lowest=-1)
    worth, score, size = given(worth, (count,)), np.empty(count), np.empty(count)
    latent, known = model.size, constraint_arrays(constraints, markers)
    scratch = np.empty(latent * latent + latent + known.count + 3 * markers * (latent + 2))
    made = score, size, *halves, scratch
    done = call(compiled.settled, gaussian_arrays(model), known, count, width, points, naming, worth, *made)
    if not done:
        raise np.linalg.LinAlgError("the precision of a naming is not positive definite")
    return points, score, size


def name_odds(model, constraints, settled) -> np.ndarray:
    """Stands for `naming.name_odds`."""
    return _neighbours(model, constraints, settled, 0.0, None, None)


def neighbours(model, constraints, settled, reach: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stands for `solving.neighbours`."""
    count, markers = settled.naming.shape
    move, swap = np.empty((count, markers, markers)), np.empty((count, markers, markers))
    return _neighbours(model, constraints, settled, reach, move, swap), move, swap


def _neighbours(model, constraints, settled, reach, move, swap) -> np.ndarray:
    (count, markers), width = settled.naming.shape, settled.points.shape[1]
    kept = (
        given(settled.points, (count, width, 3)),
        given(settled.present, (count, width), FLAG),
        indices(settled.naming, (count, len(model)), width, lowest=-1),
        given(settled.worth, (count,)),
        given(settled.size, (count,)),
        given(settled.expected, (count, markers, 3)),
        given(settled.left, (count, markers, 3)),
        given(settled.spread, (count, markers, 3, model.size)),
    )
    odds = np.empty((count, markers, width))
    scratch = np.empty(width * width + markers * width + 18 * markers)
    known = constraint_arrays(constraints, markers)
    made = odds, move, swap, scratch
    call(compiled.neighbours, gaussian_arrays(model), known, count, width, *kept, reach, *made)
    return odds


def of_frames(frame, xyz, placed, own, near, mean, variance, asked, options) -> np.ndarray:
    """Stands for `likeness.of_frames`."""
    (count, samples), (frames, markers), each = frame.shape, placed.shape[:2], near.shape
    frame, own = indices(frame, (count, samples), frames, lowest=-1), indices(own, (count,), markers, lowest=-1)
    near = indices(near, (markers, each[1]), markers, lowest=0)
    xyz, placed = given(xyz, (count, samples, 3), SINGLE), given(placed, (frames, markers, 3), SINGLE)
    mean, variance, asked = given(mean, each), given(variance, each), given(asked, (count, markers), FLAG)
    how = _likeness_arrays(near, mean, variance, options)
    odds, scratch = np.empty((count, markers)), np.empty(markers * (each[1] + 8))
    call(compiled.of_frames, how, count, samples, markers, frame, xyz, placed, own, asked, odds, scratch)
    return odds


def of_ends(frame, then, gap, xyz, placed, own, near, within, rate: float, options) -> np.ndarray:
    """Stands for `likeness.of_ends`."""
    count, (frames, markers), each = len(frame), placed.shape[:2], near.shape
    frame, own = indices(frame, (count,), frames, lowest=0), indices(own, (count,), markers, lowest=-1)
    then, gap = indices(then, (count, markers), frames, lowest=-1), given(gap, (count, markers))
    near, within = indices(near, (markers, each[1]), markers, lowest=0), given(within, each)
    xyz, placed = given(xyz, (count, 3), SINGLE), given(placed, (frames, markers, 3), SINGLE)
    how = _likeness_arrays(near, None, within, options)
    odds, scratch = np.empty((count, markers)), np.empty(2 * each[1] + 7 * markers)
    parts = frame, then, gap, xyz, placed, own, odds, scratch
    call(compiled.of_ends, how, count, markers, options.change_s * rate, options.link_sd_m**2, *parts)
    return odds


def _likeness_arrays(near, mean, variance, options) -> Structure:
    return filled(
        "Likeness", near.shape[1], options.neighbours, options.min_neighbours, near, mean, variance,
        options.independent, options.max_square, options.wide_m,
        1.5 * math.log(2 * math.pi) + math.log(options.ghost_density),
    )  # fmt: skip


def distance_sums(points) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stands for `pairs.distance_sums`."""
    frames, markers = points.shape[:2]
    points, scratch = given(points, (frames, markers, 3)), np.empty(3 * markers)
    sums = np.empty((3, markers, markers))
    call(compiled.distance_sums, frames, markers, points, *sums, scratch)
    return tuple(sums)


def median_volumes(place, quads) -> np.ndarray:
    """Stands for `structure.median_volumes`."""
    (things, _, frames), count = place.shape, len(quads)
    place, quads = given(place, (things, 3, frames)), indices(quads, (count, 4), things, lowest=0)
    medians, scratch = np.empty(count), np.empty(frames)
    call(compiled.median_volumes, count, frames, place, quads, medians, scratch)
    return medians


@once_each
def gaussian_arrays(model) -> Structure:
    """A shape's linear algebra as the library takes it, made once."""
    markers, size = len(model), model.size
    return filled(
        "Gaussian", markers, size,
        given(model.mean, (markers, 3)),
        given(model.noise, (markers,)),
        given(model.columns, (markers, 3, size)),
        given(np.moveaxis(model.columns, 2, 0), (size, markers, 3)),
        given(model.products, (markers, size * size)),
        model.yaw_sd,
    )  # fmt: skip


NO_CONSTRAINTS = filled("Constraints", size_sd=1.0)


def constraint_arrays(constraints, markers: int) -> Structure:
    """Distance constraints between so many markers, always the same of them, as the library takes them, made once.

    None stands for none.
    """
    if constraints is None:
        return NO_CONSTRAINTS
    arrays = _constraint_arrays(constraints, markers)
    if arrays.markers != markers:
        raise ValueError(f"distance constraints of {arrays.markers} markers; expected those of {markers}")
    return arrays


@once_each
def _constraint_arrays(constraints, markers: int) -> Structure:
    count = len(constraints)
    arrays = filled(
        "Constraints", count,
        indices(constraints.pair, (count, 2), markers, lowest=0),
        *(given(part, (count,)) for part in (constraints.length, constraints.sd, constraints.weight)),
        given(constraints.joined(markers), (markers, markers), INDEX),
        constraints.size_sd, *constraints.limits,
    )  # fmt: skip
    arrays.markers = markers
    return arrays
