# SPDX-License-Identifier: GPL-3.0-or-later
"""The types and functions of kernels/src/kernels.h as Python sees them, and arrays made ready for them."""

import ctypes
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from .library import compiled

ADDRESS, COUNT, NUMBER = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double
INDEX = np.dtype(np.int64)
REAL = np.dtype(np.float64)
FLAG = np.dtype(np.uint8)
SINGLE = np.dtype(np.float32)
Made = TypeVar("Made")


# The structures of kernels.h: the names of their fields, kind after kind.
STRUCTURES = {
    name: type(name, (ctypes.Structure,), {"_fields_": [(one, kind) for kind, names in parts for one in names.split()]})
    for name, parts in {
        "Model": ((COUNT, "joints markers modes"), (ADDRESS, "parents attachment offsets shape_modes carries")),
        "BodyArrays": ((COUNT, "count"), (ADDRESS, "translation quaternion scale bends shape own")),
        "SightArrays": ((COUNT, "count"), (ADDRESS, "rotation translation"), (NUMBER, "min_depth")),
        "PriorArrays": (
            (NUMBER, "strength height upright"),
            (ADDRESS, "bend_mean bend_precision scale_precision hessian predicted weight"),
        ),
        "PullArrays": (
            (COUNT, "kind sets size"),
            (ADDRESS, "places weights real visible"),
            (NUMBER, "softness reach"),
        ),
        "DampingArrays": ((NUMBER, "first smaller larger lowest highest ridge"),),
        "RuleArrays": (
            (NUMBER, "pixel slack max_distance max_square min_lead max_miss max_off_point max_on_point max_off_model"),
            (NUMBER, "overlap merged min_behind ridge max_condition"),
        ),
        "Gaussian": (
            (COUNT, "markers size"),
            (ADDRESS, "mean noise columns across products"),
            (NUMBER, "yaw_sd"),
        ),
        "Constraints": (
            (COUNT, "count"),
            (ADDRESS, "pair length sd weight joined"),
            (NUMBER, "size_sd max_cost max_size_ratio"),
        ),
        "Likeness": (
            (COUNT, "near_count neighbours min_neighbours"),
            (ADDRESS, "near mean variance"),
            (NUMBER, "independent max_square wide constant"),
        ),
        "Frame": (
            (COUNT, "cameras markers blobs_of_one pairs"),
            (ADDRESS, "sight rules"),
            (NUMBER, "behind"),
            (COUNT * 4, "steps"),
            (ADDRESS, "centres focal blobs points covariance real visible fixed"),
            (ADDRESS, "image slope depth metres nll direction across anchor"),
            (ADDRESS, "slot step owner partner conflicts met residual miss reprojection"),
            (ADDRESS, "given cost claims open stale unclear closest ray order"),
        ),
        "Following": (
            (ADDRESS, "model sight prior damping rules"),
            (COUNT, "capsules fit_steps min_due min_meetings"),
            (ADDRESS, "segment start axis radius low high centres focal marker_sd anchor"),
            (NUMBER, "behind ridge standoff min_side_share velocity_kept velocity_rate sd sd_growth max_sd lag_kept"),
            (NUMBER, "own_rate noise_rate min_named_share skin max_own min_noise max_noise kept_share trimmed_scale"),
        ),
    }.items()
}
# What says whether it could do it; of `follow_name` whether too little was named.
ANSWERING = ("fit_body", "fit_until_still", "covariance", "settled", "softly", "follow_fit", "follow_name")
SIGNATURES = {
    "pose": [ADDRESS] * 6,
    "derivatives": [ADDRESS] * 7,
    "pull": [ADDRESS, ADDRESS, COUNT, COUNT, *[ADDRESS] * 5],
    "fit_body": [*[ADDRESS] * 5, *[COUNT] * 3, *[ADDRESS] * 10],
    "fit_until_still": [*[ADDRESS] * 5, *[COUNT] * 4, NUMBER, *[ADDRESS] * 3],
    "covariance": [*[COUNT] * 3, *[ADDRESS] * 2, NUMBER, *[ADDRESS] * 2],
    "capsules_hide": [*[COUNT] * 4, *[ADDRESS] * 6, NUMBER, ADDRESS],
    "blob_rays": [COUNT, COUNT, *[ADDRESS] * 6],
    "meet": [*[COUNT] * 3, *[ADDRESS] * 5, NUMBER, NUMBER, *[ADDRESS] * 4],
    "name_markers": [ADDRESS, COUNT],
    "label_confidences": [ADDRESS, NUMBER, NUMBER, ADDRESS],
    "follow_fit": [ADDRESS, ADDRESS, NUMBER, *[ADDRESS] * 6],
    "follow_name": [ADDRESS, ADDRESS, NUMBER, *[ADDRESS] * 5],
    "straightened": [COUNT, *[ADDRESS] * 3, COUNT, *[NUMBER] * 3, ADDRESS],
    "link_blobs": [*[COUNT] * 3, *[ADDRESS] * 6, *[NUMBER] * 4, *[ADDRESS] * 3],
    "softly": [ADDRESS, *[COUNT] * 3, *[ADDRESS] * 9],
    "settled": [ADDRESS, ADDRESS, COUNT, COUNT, *[ADDRESS] * 9],
    "of_frames": [ADDRESS, *[COUNT] * 3, *[ADDRESS] * 7],
    "of_ends": [ADDRESS, *[COUNT] * 2, *[NUMBER] * 2, *[ADDRESS] * 8],
    "distance_sums": [COUNT, COUNT, *[ADDRESS] * 5],
    "median_volumes": [COUNT, COUNT, *[ADDRESS] * 4],
    "neighbours": [ADDRESS, ADDRESS, COUNT, COUNT, *[ADDRESS] * 8, NUMBER, *[ADDRESS] * 4],
}
if compiled is not None:
    for _name, _types in SIGNATURES.items():
        getattr(compiled, _name).argtypes = _types
        getattr(compiled, _name).restype = ctypes.c_int if _name in ANSWERING else None


def once_each(make: Callable[..., Made]) -> Callable[..., Made]:
    """Makes of an object what is asked for once, and keeps it as long as the object is there."""
    made: WeakKeyDictionary[object, Made] = WeakKeyDictionary()

    @wraps(make)
    def made_once(owner: object, *more: object) -> Made:
        found = made.get(owner)
        if found is None:
            found = made[owner] = make(owner, *more)
        return found

    return made_once


def filled(name: str, *values: object, **named: object) -> ctypes.Structure:
    """A structure of kernels.h of numbers and of the addresses of arrays and structures, which are kept with it."""
    fields = {field: _as_given(value) for field, value in named.items()}
    structure = STRUCTURES[name](*map(_as_given, values), **fields)
    structure.kept = values, named
    return structure


def given(array: np.ndarray, shape: tuple[int, ...], kind: np.dtype = REAL) -> np.ndarray:
    """An array as the library takes it, of a kind and as it lies in memory; ValueError where it has another shape."""
    array = np.ascontiguousarray(array, kind)
    if array.shape != shape:
        raise ValueError(f"an array has the shape {array.shape}; expected {shape}")
    return array


def indices(array: np.ndarray, shape: tuple[int, ...], count: int, lowest: int) -> np.ndarray:
    """The same of indices of so many things, none below `lowest`; ValueError where one is of none of them."""
    array = given(array, shape, INDEX)
    if array.size and not lowest <= array.min() <= array.max() < count:
        raise ValueError(f"indices lie from {array.min()} to {array.max()}; expected {lowest} to {count - 1}")
    return array


def call(function: Callable, *arguments: object) -> Any:
    """What a function of the library answers; it is given the addresses of arrays and structures, and numbers."""
    return function(*map(_as_given, arguments))


def _as_given(argument: Any) -> Any:
    if isinstance(argument, np.ndarray):
        return address(argument)
    return ctypes.addressof(argument) if isinstance(argument, ctypes.Structure) else argument


def address(array: np.ndarray) -> int:
    """Where an array begins; the caller keeps it as long as the library looks at it.

    An array says so itself (`ctypes.data`), but takes ten times as long.
    """
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(array))
    except (TypeError, ValueError):  # it is not to be written to, or empty
        return array.ctypes.data
