# SPDX-License-Identifier: GPL-3.0-or-later
"""The types and functions of kernels/src/kernels.h as Python sees them, and arrays made ready for them."""

import ctypes
from collections.abc import Callable
from typing import Any, TypeVar, overload
from weakref import WeakKeyDictionary

import numpy as np

from .library import compiled

ADDRESS, COUNT, NUMBER = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double
INDEX = np.dtype(np.int64)
REAL = np.dtype(np.float64)
FLAG = np.dtype(np.uint8)
SINGLE = np.dtype(np.float32)


class ModelArrays(ctypes.Structure):
    """`Model` of kernels.h."""

    _fields_ = [(name, COUNT) for name in ("joints", "markers", "modes")] + [
        (name, ADDRESS) for name in ("parents", "attachment", "offsets", "shape_modes", "carries")
    ]


class BodyArrays(ctypes.Structure):
    """`BodyArrays` of kernels.h."""

    _fields_ = [("count", COUNT)] + [
        (name, ADDRESS) for name in ("translation", "quaternion", "scale", "bends", "shape", "own")
    ]


class SightArrays(ctypes.Structure):
    """`SightArrays` of kernels.h."""

    _fields_ = [("count", COUNT), ("rotation", ADDRESS), ("translation", ADDRESS), ("min_depth", NUMBER)]


class PriorArrays(ctypes.Structure):
    """`PriorArrays` of kernels.h."""

    _fields_ = [(name, NUMBER) for name in ("strength", "height", "upright")] + [
        (name, ADDRESS) for name in ("bend_mean", "bend_precision", "scale_precision", "hessian", "predicted", "weight")
    ]


class PullArrays(ctypes.Structure):
    """`PullArrays` of kernels.h."""

    _fields_ = [
        *((name, COUNT) for name in ("kind", "sets", "size")),
        *((name, ADDRESS) for name in ("places", "weights", "real", "visible")),
        *((name, NUMBER) for name in ("softness", "reach")),
    ]


class DampingArrays(ctypes.Structure):
    """`DampingArrays` of kernels.h."""

    _fields_ = [(name, NUMBER) for name in ("first", "smaller", "larger", "lowest", "highest", "ridge")]


class RuleArrays(ctypes.Structure):
    """`RuleArrays` of kernels.h."""

    _fields_ = [
        (name, NUMBER)
        for name in (
            *("pixel", "slack", "max_distance", "max_square", "min_lead", "max_miss", "max_off_point", "max_on_point"),
            *("max_off_model", "overlap", "merged", "min_behind", "ridge", "max_condition"),
        )
    ]


class GaussianArrays(ctypes.Structure):
    """`Gaussian` of kernels.h."""

    _fields_ = [
        *((name, COUNT) for name in ("markers", "size")),
        *((name, ADDRESS) for name in ("mean", "noise", "columns", "across", "products")),
        ("yaw_sd", NUMBER),
    ]


class ConstraintArrays(ctypes.Structure):
    """`Constraints` of kernels.h."""

    _fields_ = [
        ("count", COUNT),
        *((name, ADDRESS) for name in ("pair", "length", "sd", "weight", "joined")),
        *((name, NUMBER) for name in ("size_sd", "max_cost", "max_size_ratio")),
    ]


class LikenessArrays(ctypes.Structure):
    """`Likeness` of kernels.h."""

    _fields_ = [
        *((name, COUNT) for name in ("near_count", "neighbours", "min_neighbours")),
        *((name, ADDRESS) for name in ("near", "mean", "variance")),
        *((name, NUMBER) for name in ("independent", "max_square", "wide", "constant")),
    ]


class FrameArrays(ctypes.Structure):
    """`Frame` of kernels.h."""

    _fields_ = [
        *((name, COUNT) for name in ("cameras", "markers", "blobs_of_one", "pairs")),
        *((name, ADDRESS) for name in ("sight", "rules")),
        ("behind", NUMBER),
        ("steps", COUNT * 4),
        *((name, ADDRESS) for name in ("centres", "focal", "blobs", "points", "covariance")),
        *((name, ADDRESS) for name in ("real", "visible", "fixed")),
        *((name, ADDRESS) for name in ("image", "slope", "depth", "metres", "nll", "direction", "across", "anchor")),
        *((name, ADDRESS) for name in ("slot", "step", "owner", "partner", "conflicts")),
        *((name, ADDRESS) for name in ("met", "residual", "miss", "reprojection")),
        *((name, ADDRESS) for name in ("given", "cost", "claims", "open", "stale", "unclear")),
        *((name, ADDRESS) for name in ("closest", "ray", "order")),
    ]


class FollowingArrays(ctypes.Structure):
    """`Following` of kernels.h."""

    _fields_ = [
        *((name, ADDRESS) for name in ("model", "sight", "prior", "damping", "rules")),
        *((name, COUNT) for name in ("capsules", "fit_steps", "min_due", "min_meetings")),
        *((name, ADDRESS) for name in ("segment", "start", "axis", "radius")),
        *((name, ADDRESS) for name in ("low", "high", "centres", "focal", "marker_sd", "anchor")),
        *((name, NUMBER) for name in ("behind", "ridge", "standoff", "min_side_share", "velocity_kept")),
        *((name, NUMBER) for name in ("velocity_rate", "sd", "sd_growth", "max_sd", "lag_kept", "own_rate")),
        *((name, NUMBER) for name in ("noise_rate", "min_named_share", "skin", "max_own", "min_noise", "max_noise")),
        *((name, NUMBER) for name in ("kept_share", "trimmed_scale")),
    ]


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


Made = TypeVar("Made", bound=ctypes.Structure)
_made: WeakKeyDictionary[object, Any] = WeakKeyDictionary()


def made_once(owner: object, make: Callable[[], Made]) -> Made:
    """What the library takes an object as, made when it is first asked for and kept as long as the object is."""
    structure = _made.get(owner)
    if structure is None:
        structure = _made[owner] = make()
    return structure


def keeping(structure: Made, kept: object) -> Made:
    """The structure, which keeps the arrays that it has the addresses of for as long as it is there itself."""
    structure.kept = kept
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


@overload
def address(array: None) -> None: ...
@overload
def address(array: np.ndarray) -> int: ...
@overload
def address(array: np.ndarray | None) -> int | None: ...


def address(array: np.ndarray | None) -> int | None:
    """Where an array begins; the caller keeps it as long as the library looks at it.

    An array says so itself (`ctypes.data`), but takes ten times as long.
    """
    if array is None:
        return None
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(array))
    except (TypeError, ValueError):  # it is not to be written to, or empty
        return array.ctypes.data
