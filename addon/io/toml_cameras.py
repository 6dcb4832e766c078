# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras in the `.toml` that anipose, Pose2Sim and caliscope share; what this project writes itself."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.geometry import inverse_lens
from ..core.geometry.camera_up import AXIS_NAMES, guess_up
from ..core.geometry.cameras import Cameras
from .rig_cameras import RigCamera, lens, numbers_in, refuse_crowd, rig, rotation_of
from .source import toml_document
from .world import z_up

# Ours beside the shared keys: a lens of Vicon's kind, exact, where `distortions` can only come near it.
INVERSE = "vicon_radial"


def read_toml(path: Path, up: str = "") -> Cameras:
    """Every table with a `matrix` is a camera, at the top or inside `[cameras]`; other tables are ignored.

    `up` is the axis that points up where it is known better than from the file or its cameras.
    """
    document = toml_document(path, "a camera calibration")
    tables = [(key, table) for key, table in _tables(document) if table.get("ignore") is not True]
    if not tables:
        raise InputError("has no table with a `matrix`; expected one table a camera", path)
    refuse_crowd(len(tables), path)
    stated = next((str(table["up"]) for _, table in tables if table.get("up") in AXIS_NAMES), "")
    return z_up(rig([_camera(key, table, path) for key, table in tables], path), up or stated)


def _tables(document: dict) -> Iterator[tuple[str, dict]]:
    for key, value in document.items():
        if key == "cameras" and isinstance(value, (dict, list)):
            items = value.items() if isinstance(value, dict) else enumerate(value)
            yield from ((str(name), table) for name, table in items if isinstance(table, dict) and "matrix" in table)
        elif isinstance(value, dict) and "matrix" in value:
            yield key, value


def _camera(key: str, table: dict, path: Path) -> RigCamera:
    name = str(table.get("name", key))
    if table.get("fisheye"):
        raise InputError(f"camera {name} has a fisheye lens; expected one in OpenCV's k1 k2 p1 p2 k3 model", path)
    rotation = numbers_in(table, ("rotation",), name, path, 3, 9)
    exact = table.get(INVERSE) is not None
    distortion = lens(numbers_in(table, ("distortions",), name, path), name, path)
    return RigCamera(
        name=name,
        size=numbers_in(table, ("size",), name, path, 2),
        matrix=numbers_in(table, ("matrix",), name, path, 9).reshape(3, 3),
        distortion=np.zeros(5) if exact else distortion,
        rotation=rotation_of(rotation),
        translation=numbers_in(table, ("translation",), name, path, 3),
        inverse=numbers_in(table, (INVERSE,), name, path, 3) if exact else np.zeros(3),
    )


def write_toml(path: Path, cameras: Cameras):
    """Writes the contract's calibration: one table a camera, every number exact.

    Cameras that look as if another axis pointed up say that it is z.
    """
    up = "" if guess_up(cameras) in ("", "z") else 'up = "z"\n'
    Path(path).write_text(
        "\n".join(_table(cameras, index) + up for index in range(len(cameras))), encoding="utf-8", newline="\n"
    )


def _table(cameras: Cameras, index: int) -> str:
    distortion = cameras.distortion[index]
    inverse = np.zeros(3) if cameras.inverse is None else cameras.inverse[index]
    exact = ""
    if inverse.any():
        half = np.linalg.norm(cameras.size[index]) / 2 / cameras.focal[index]
        distortion = inverse_lens.nearest_forward(inverse, half)
        exact = f"{INVERSE} = {_row(inverse)}\n"
    # TOML's strings are JSON's but for the one control character that JSON leaves as it is.
    name = json.dumps(cameras.names[index], ensure_ascii=False).replace("\x7f", "\\u007F")
    return (
        f"[cam_{index + 1:02d}]\n"
        f"name = {name}\n"
        f"size = {_row(cameras.size[index])}\n"
        f"matrix = [{', '.join(_row(row) for row in cameras.matrix[index])}]\n"
        f"distortions = {_row(distortion)}\n"
        f"{exact}"
        f"rotation = [{', '.join(_row(row) for row in cameras.rotation[index])}]\n"
        f"translation = {_row(cameras.translation[index])}\n"
        "fisheye = false\n"
    )


def _row(values: np.ndarray) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"
