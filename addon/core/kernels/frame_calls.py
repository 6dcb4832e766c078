# SPDX-License-Identifier: GPL-3.0-or-later
"""The same of naming the blobs of a frame, and of following a subject from one to the next: see `calls`.

A frame is named in microseconds, so its arrays are cut out of two blocks, and what stays the same is made ready once.
"""

import ctypes
from functools import lru_cache
from math import prod
from typing import NamedTuple

import numpy as np

from .calls import damping_arrays, fit_scratch, model_arrays, row_length, sight_arrays
from .library import compiled
from .structures import COUNT, FLAG, INDEX, REAL, address, call, filled, given, indices

MOST_CAMERAS = 1024  # as in rays.c


class FrameLayout(NamedTuple):
    """Where the arrays that a frame keeps lie: (name, start, stop, shape) of each, in a block of numbers or indices."""

    numbers: tuple
    indices: tuple
    size: tuple[int, int]


@lru_cache(maxsize=1024)
def frame_layout(cameras: int, markers: int, blobs: int) -> FrameLayout:
    """Of what is measured and named of a frame; what is soon made again is not kept."""
    pairs, images = (cameras, markers), (cameras, blobs)
    measured = {
        "image": (*pairs, 2),
        "slope": (*pairs, 2, 3),
        "depth": pairs,
        "metres": pairs,
        "nll": (*pairs, blobs),
        "met": (markers, 3),
        "residual": (markers,),
        "miss": pairs,
    }
    named = {"slot": pairs, "step": pairs, "owner": images, "partner": pairs, "conflicts": (markers,)}
    numbers, many = _cut(measured)
    whole, count = _cut(named)
    return FrameLayout(numbers, whole, (many, count))


def _cut(shapes: dict[str, tuple[int, ...]]) -> tuple[tuple, int]:
    ends = np.cumsum([0, *(prod(shape) for shape in shapes.values())]).tolist()
    return tuple(zip(shapes, ends, ends[1:], shapes.values(), strict=False)), ends[-1]


def _in_turn(*shapes: tuple[int, ...]) -> tuple[tuple[int, int, tuple[int, ...]], ...]:
    """Start, stop and shape of arrays that lie in a block one after the other."""
    return tuple(part[1:] for part in _cut({str(index): shape for index, shape in enumerate(shapes)})[0])


def _new_frame(cameras: int, markers: int, blobs: int) -> tuple[dict[str, np.ndarray], dict[str, int]]:
    """Arrays for what is measured and named of a frame, and their addresses, by name."""
    layout = frame_layout(cameras, markers, blobs)
    numbers, whole = np.empty(layout.size[0]), np.empty(layout.size[1], INDEX)
    made, places = {}, {}
    for block, parts in ((numbers, layout.numbers), (whole, layout.indices)):
        begin = address(block)
        for name, start, stop, shape in parts:
            made[name], places[name] = block[start:stop].reshape(shape), begin + 8 * start
    return made, places


def _new_room(cameras: int, markers: int, blobs: int) -> dict[str, np.ndarray]:
    """Room to work on a frame in, by name."""
    images, every, pairs = cameras * blobs, cameras * markers * blobs, cameras * markers * markers
    numbers = {"direction": 3 * images, "across": 9 * images, "anchor": 3 * images, "reprojection": every}
    numbers |= {"given": (markers + 1) * blobs, "cost": every, "order": max(2 * every, 7 * pairs)}
    flags = {"claims": every, "open": every, "stale": markers, "unclear": blobs}
    whole = {"closest": blobs, "ray": cameras}
    kinds = ((numbers, REAL), (flags, FLAG), (whole, INDEX))
    return {name: np.empty(count, kind) for counts, kind in kinds for name, count in counts.items()}


def name_markers(view, sight, expected, rules, fixed, condition: tuple, behind: float, steps, step1_only: bool) -> dict:
    """Stands for `labelling.name_markers`: the arrays of `Frame`, `Naming` and `Meeting`, by name.

    `steps` are what a label says of how it was given: by the three steps, or by a person.
    """
    (cameras, blobs), count = view.real.shape, len(expected.points)
    _check_cameras(cameras)
    shape = (cameras, count)
    frame = {
        "centres": given(sight.centres, (cameras, 3)),
        "focal": given(sight.focal, (cameras,)),
        "blobs": given(view.image, (cameras, blobs, 2)),
        "points": given(expected.points, (count, 3)),
        "covariance": given(expected.covariance, (count, 3, 3)),
        "real": given(view.real, (cameras, blobs), FLAG),
        "visible": given(expected.visible, shape, FLAG),
        "fixed": np.full(shape, -1) if fixed is None else indices(fixed, shape, blobs, lowest=-1),
    }
    made, outputs = _new_frame(cameras, count, blobs)
    arrays = filled(
        "Frame", cameras, count, blobs, cameras * count * count, sight_arrays(sight), rule_arrays(rules, condition),
        behind, (COUNT * 4)(*steps), **frame, **outputs, **_new_room(cameras, count, blobs),
    )  # fmt: skip
    call(compiled.name_markers, arrays, step1_only)
    return made


def _check_cameras(cameras: int):
    if cameras > MOST_CAMERAS:
        raise ValueError(f"{cameras} cameras; expected at most {MOST_CAMERAS}")


def label_confidences(naming, options) -> np.ndarray:
    """Stands for `confidence.named_confidences`."""
    frame, met = naming.frame, naming.meeting
    (cameras, blobs), count = frame.view.real.shape, len(frame.expected.points)
    shape = (cameras, count)
    parts = {
        "sight": sight_arrays(frame.sight),
        "rules": rule_arrays(frame.rules, (0.0, 0.0)),
        "blobs": given(frame.view.image, (cameras, blobs, 2)),
        "covariance": given(frame.expected.covariance, (count, 3, 3)),
        "real": given(frame.view.real, (cameras, blobs), FLAG),
        "visible": given(frame.expected.visible, shape, FLAG),
        "image": given(frame.image, (*shape, 2)),
        "slope": given(frame.slope, (*shape, 2, 3)),
        "depth": given(frame.depth, shape),
        "metres": given(frame.metres, shape),
        "nll": given(frame.nll, (*shape, blobs)),
        "slot": indices(naming.slot, shape, blobs, lowest=-1),
        "partner": given(naming.partner, shape, INDEX),
        "met": given(met.points, (count, 3)),
        "given": np.empty((count + 1, blobs)),
    }
    arrays = filled("Frame", cameras, count, blobs, behind=frame.sight.nowhere, **parts)
    sure = np.empty(shape)
    call(compiled.label_confidences, arrays, options.hidden, options.shadowed, sure)
    return sure


def link_blobs(before, view, speed, depth, reaches, clear) -> tuple[np.ndarray, np.ndarray]:
    """Stands for `image_tracklets.link_blobs`."""
    (cameras, blobs), earlier = view.real.shape, before.real.shape[1]
    kept = (
        given(before.image, (cameras, earlier, 2)),
        given(before.real, (cameras, earlier), FLAG),
        given(speed, (cameras, earlier, 2)),
        given(view.image, (cameras, blobs, 2)),
        given(view.real, (cameras, blobs), FLAG),
        given(depth, (cameras,)),
    )
    link, ahead, there = np.empty((cameras, blobs), INDEX), np.empty((cameras, blobs, 2)), np.empty(2 * earlier)
    call(compiled.link_blobs, cameras, earlier, blobs, *kept, *reaches, *clear, link, ahead, there)
    return link, ahead


def rule_arrays(rules, condition: tuple) -> ctypes.Structure:
    """The rules of naming, and how rays meet, as the library takes them."""
    return filled(
        "RuleArrays", rules.pixel, rules.slack_m, rules.max_distance_m, rules.max_square, rules.min_lead,
        rules.max_miss, rules.max_off_point, rules.max_on_point, rules.max_square, rules.merged_m, rules.merged_m,
        rules.min_behind_m, *condition,
    )  # fmt: skip


class Follower:
    """What following a subject takes that stays the same through a take, and room to work on a frame in.

    `capsules` are segment (N,), start and axis (N, 3) and radius (N,), None where another volume is in the way;
    `numbers` the fields of `FollowingArrays` that are plain numbers. `anchor` (P,) are the weights of a prediction.
    """

    def __init__(self, model, sight, prior, capsules, marker_sd, anchor, rules, damping, condition, steps, numbers):
        self.model, self.shape = model, (sight.count, model.marker_count)
        _check_cameras(sight.count)
        segment, *body = capsules or (np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
        count, shapes = len(segment), ((-1, 3), (-1, 3), (-1,))
        self.sees = count > 0
        names = ("segment", "start", "axis", "radius", "low", "high", "centres", "focal", "marker_sd", "anchor")
        arrays = (
            indices(segment, (count,), model.joint_count, lowest=0),
            *(given(part, (count, *shape[1:])) for part, shape in zip(body, shapes, strict=True)),
            *(given(part, (sight.count, 2)) for part in sight.corners),
            given(sight.centres, (sight.count, 3)),
            given(sight.focal, (sight.count,)),
            given(marker_sd, (model.marker_count,)),
            given(anchor, (model.parameters,)),
        )
        known = model_arrays(model), sight_arrays(sight), prior.compiled(model)
        rule = damping_arrays(damping), rule_arrays(rules, condition)
        parts = dict(zip(names, arrays, strict=True))
        self.arrays = filled("Following", *known, *rule, capsules=count, **parts, **numbers)
        self.nobody = np.full(self.shape, -1)
        self.steps = steps
        joints, markers, width, pairs = model.joint_count, model.marker_count, model.parameters, prod(self.shape)
        row, points = (row_length(model),), (markers, 3)
        self.track_parts = _in_turn(row, points, (markers,), (width,), points, (1,))
        self.fitted_parts = _in_turn(row, (joints, 3, 3), (joints, 3), points, points, (markers, 3, 3))
        own = row[0] + 3 * pairs + width * (1 + width + 3 * markers) + numbers["fit_steps"] + 1
        room = max(
            fit_scratch(model, width),
            width * (width + 3 * markers),
            12 * joints + 3 * markers + 12 * joints + 3 * markers,
            7 * count,
        )
        self.scratch = np.empty(own + room)
        self.blobs = 0

    def frame(self, view, fixed) -> "FollowedFrame":
        """A frame that is to be followed, of which a person named `fixed` (C, M), None for nothing."""
        if view.real.shape[1] > self.blobs:
            self._make_room(view.real.shape[1])
        return FollowedFrame(self, view, fixed)

    def _make_room(self, blobs: int):
        cameras, markers = self.shape
        self.blobs = blobs
        of, room = self.arrays, _new_room(cameras, markers, blobs)
        self.made, outputs = _new_frame(cameras, markers, blobs)
        self.first, self.last = (
            filled(
                "Frame", cameras, markers, blobs, cameras * markers * markers, of.sight, of.rules, of.behind,
                (COUNT * 4)(*self.steps), of.centres, of.focal, **outputs, **room,
            )
            for _ in range(2)
        )  # fmt: skip


class FollowedFrame:
    """One frame, first fitted and then named."""

    def __init__(self, follower: Follower, view, fixed):
        self.follower = follower
        cameras, blobs = len(view.real), view.real.shape[1]
        self.kept = (
            given(view.image, (follower.shape[0], blobs, 2)),
            given(view.real, (follower.shape[0], blobs), FLAG),
            follower.nobody if fixed is None else indices(fixed, follower.shape, blobs, lowest=-1),
        )
        self.shape = cameras, follower.shape[1], blobs
        self.places = tuple(map(address, self.kept))

    def _filled(self, arrays: ctypes.Structure) -> ctypes.Structure:
        arrays.blobs_of_one = self.shape[2]
        arrays.blobs, arrays.real, arrays.fixed = self.places
        return arrays

    def fit(self, numbers, pixel: float, unseen, before) -> tuple[np.ndarray, np.ndarray] | None:
        """The first half of `tracking.followed_by_numpy`; None where a fit cannot be solved.

        `numbers` are those of a track: body, offsets, how sure these are, velocity, lag. Gives those of the fit (body,
        posed, where markers are expected and how surely) in one block, and which of them cameras see.
        """
        follower = self.follower
        self.track = given(np.concatenate(numbers), (follower.track_parts[-1][0],))
        self.unseen, self.pixel = given(unseen, (follower.shape[1],), INDEX), pixel
        before = given(before, follower.shape, FLAG)
        fitted, visible = np.empty(follower.fitted_parts[-1][1]), np.empty(follower.shape, bool)
        done = call(
            compiled.follow_fit, follower.arrays, self._filled(follower.first), pixel, self.track, self.unseen, before,
            fitted, visible, follower.scratch,
        )  # fmt: skip
        self.fitted = fitted
        return (fitted, visible) if done else None

    def name(self, visible) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, bool]:
        """The other half: the arrays of a naming by name, the track's numbers in one block, unseen, whether poor."""
        follower = self.follower
        visible = given(visible, follower.shape, FLAG)
        made, outputs = _new_frame(*self.shape)
        numbers, unseen = np.empty(follower.track_parts[-1][1]), np.empty(follower.shape[1], INDEX)
        for name, at in outputs.items():
            setattr(follower.last, name, at)
        follower.last.visible = address(visible)
        poor = call(
            compiled.follow_name, follower.arrays, self._filled(follower.last), self.pixel, self.track, self.unseen,
            self.fitted, numbers, unseen,
        )  # fmt: skip
        return made, numbers, unseen, bool(poor)
