# SPDX-License-Identifier: GPL-3.0-or-later
"""The same of naming the blobs of a frame, and of following a subject from one to the next: see `calls`.

A frame is named in microseconds, so its arrays are cut out of two blocks, and what stays the same is made ready once.
"""

import ctypes
from functools import lru_cache
from math import prod

import numpy as np

from .calls import damping_arrays, fit_scratch, model_arrays, row_length, sight_arrays
from .library import compiled
from .structures import COUNT, FLAG, INDEX, REAL, address, call, filled, given, indices

MOST_CAMERAS = 1024  # as in rays.c


@lru_cache(maxsize=1024)
def frame_parts(cameras: int, markers: int, blobs: int) -> tuple[list[tuple], int]:
    """What is measured and named of a frame: name, kind, shape and start in memory, in bytes; and the end."""
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
    parts: list[tuple[str, np.dtype, tuple[int, ...]]] = [(name, REAL, shape) for name, shape in measured.items()]
    parts += [(name, INDEX, shape) for name, shape in named.items()]
    ends = np.cumsum([0, *(kind.itemsize * prod(shape) for _, kind, shape in parts)]).tolist()
    return [(*part, start) for part, start in zip(parts, ends, strict=False)], ends[-1]


def _new_frame(cameras: int, markers: int, blobs: int) -> tuple[dict[str, np.ndarray], dict[str, int]]:
    """Arrays for what is measured and named of a frame, and their addresses, by name."""
    parts, size = frame_parts(cameras, markers, blobs)
    room = np.empty(size, FLAG)
    begin = address(room)
    made = {name: np.ndarray(shape, kind, room, start) for name, kind, shape, start in parts}
    return made, {name: begin + start for name, _, _, start in parts}


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
    `numbers` the fields of `Following` that are plain numbers. `anchor` (P,) are the weights of a prediction.
    A frame is first fitted and then named.
    """

    def __init__(self, model, sight, prior, capsules, marker_sd, anchor, rules, damping, condition, steps, numbers):
        self.shape = sight.count, model.marker_count
        _check_cameras(sight.count)
        segment, start, axis, radius = capsules or (np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
        count = len(segment)
        low, high = sight.corners
        self.sees = count > 0
        self.arrays = filled(
            "Following", model_arrays(model), sight_arrays(sight), prior.compiled(model), damping_arrays(damping),
            rule_arrays(rules, condition),
            capsules=count,
            segment=indices(segment, (count,), model.joint_count, lowest=0),
            start=given(start, (count, 3)),
            axis=given(axis, (count, 3)),
            radius=given(radius, (count,)),
            low=given(low, (sight.count, 2)),
            high=given(high, (sight.count, 2)),
            centres=given(sight.centres, (sight.count, 3)),
            focal=given(sight.focal, (sight.count,)),
            marker_sd=given(marker_sd, (model.marker_count,)),
            anchor=given(anchor, (model.parameters,)),
            **numbers,
        )  # fmt: skip
        self.steps, self.blobs, self.nobody = steps, 0, np.full(self.shape, -1)
        self.unseen = np.zeros(model.marker_count, INDEX)  # frames before the last one, of which nothing is known
        joints, markers, width, pairs = model.joint_count, model.marker_count, model.parameters, prod(self.shape)
        row, points = row_length(model), (markers, 3)
        track = {"row": row, "own": points, "own_sd": markers, "velocity": width, "lag": points, "pixel": ()}
        fitted = {
            "row": row,
            "rotations": (joints, 3, 3),
            "joints": (joints, 3),
            "markers": points,
            "points": points,
            "covariance": (markers, 3, 3),
        }
        self.track_kind, self.fitted_kind = (
            np.dtype([(name, REAL, shape) for name, shape in parts.items()]) for parts in (track, fitted)
        )
        own = row + 3 * pairs + width * (1 + width + 3 * markers) + numbers["fit_steps"] + 1
        room = max(fit_scratch(model, width), width * (width + 3 * markers), 24 * joints + 6 * markers, 7 * count)
        self.scratch = np.empty(own + room)

    def _make_room(self, blobs: int):
        """Room for frames of up to so many blobs in a camera."""
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

    def fit(self, view, fixed, track, pixel: float, before) -> tuple[np.void, np.ndarray] | None:
        """The first half of `tracking.followed_by_numpy`; None where a fit cannot be solved.

        `track` are the arrays of `track_kind`, one after the other, and `fixed` (C, M) what a person named. Gives the
        body, posed, where markers are expected and how surely, as in `fitted_kind`, and which of them cameras see.
        """
        blobs = view.real.shape[1]
        self.kept = (
            given(view.image, (self.shape[0], blobs, 2)),
            given(view.real, (self.shape[0], blobs), FLAG),
            indices(fixed, self.shape, blobs, lowest=-1),
        )
        if blobs > self.blobs:
            self._make_room(blobs)
        for frame in (self.first, self.last):
            frame.blobs_of_one = blobs
            frame.blobs, frame.real, frame.fixed = map(address, self.kept)
        self.track = given(np.concatenate(track), (self.track_kind.itemsize // REAL.itemsize,))
        self.pixel = pixel
        before = given(before, self.shape, FLAG)
        self.fitted, visible = np.empty(self.fitted_kind.itemsize // REAL.itemsize), np.empty(self.shape, bool)
        done = call(
            compiled.follow_fit, self.arrays, self.first, pixel, self.track, self.unseen, before, self.fitted, visible,
            self.scratch,
        )  # fmt: skip
        return (self.fitted.view(self.fitted_kind)[0], visible) if done else None

    def name(self, visible) -> tuple[dict[str, np.ndarray], np.void, bool]:
        """The other half: the arrays of a naming by name, the track after, and whether that is poor."""
        visible = given(visible, self.shape, FLAG)
        cameras, markers = self.shape
        made, outputs = _new_frame(cameras, markers, self.last.blobs_of_one)
        numbers = np.empty(len(self.track))
        for name, at in outputs.items():
            setattr(self.last, name, at)
        self.last.visible = address(visible)
        poor = call(
            compiled.follow_name, self.arrays, self.last, self.pixel, self.track, self.unseen, self.fitted, numbers,
            np.empty_like(self.unseen),
        )  # fmt: skip
        return made, numbers.view(self.track_kind)[0], bool(poor)
