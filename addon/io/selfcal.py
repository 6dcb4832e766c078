# SPDX-License-Identifier: GPL-3.0-or-later
"""The output folder of a multi-camera self-calibration: a projection matrix and a lens for every camera.

The files are those of the toolbox of Svoboda, Martinec and Pajdla (2005): `camera1.Pmat.cal` with the 3×4 matrix that
projects onto the image without lens, `basename1.rad` with the camera matrix and the lens that were taken out of it,
`Res.dat` with the image sizes, `camera_order.txt` with the cameras' names.
"""

import re
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.geometry.cameras import Cameras, distort
from .rig_cameras import RigCamera, refuse_crowd, rig
from .source import MAX_CALIBRATION_BYTES, numbers, read_text
from .world import z_up

KIND = "a self-calibration folder with *.Pmat.cal, *.rad and Res.dat"

# How far the fitted lens may be from the given one, root mean square over the image, px.
LENS_TOLERANCE_PX = 2.0

RES, NAMES = "Res.dat", "camera_order.txt"

_LENS = ("kc1", "kc2", "kc3", "kc4")


def read_selfcal(path: Path, up: str = "") -> Cameras:
    """The cameras of a folder, or of the folder of a `.Pmat.cal` or `.rad` file, in the order of their numbers."""
    folder = path if path.is_dir() else path.parent
    matrices, lenses = (_numbered(folder, pattern) for pattern in ("*.Pmat.cal", "*.rad"))
    if not matrices:
        raise InputError(f"has no *.Pmat.cal; expected {KIND}", folder)
    missing = [number for number in matrices if number not in lenses]
    if missing:
        raise InputError(f"has no .rad file with the number {missing[0]}; expected {KIND}", folder)
    refuse_crowd(len(matrices), folder)
    order = sorted(matrices)
    sizes = _sizes(folder, len(order))
    names = _names(folder, [matrices[number].name[: -len(".Pmat.cal")] for number in order])
    cameras = [
        _camera(name, matrices[number], lenses[number], size)
        for name, number, size in zip(names, order, sizes, strict=True)
    ]
    return z_up(rig(cameras, folder), up)


def files_of(path: Path) -> list[Path]:
    """The files of a folder, or beside a `.Pmat.cal` or `.rad` file, that are read from it."""
    folder = path if path.is_dir() else path.parent
    return [file for pattern in ("*.Pmat.cal", "*.rad", RES, NAMES) for file in sorted(folder.glob(pattern))]


def _numbered(folder: Path, pattern: str) -> dict[int, Path]:
    """Files by the number in their names."""
    found = {}
    for file in sorted(folder.glob(pattern)):
        number = re.search(r"(\d+)\.", file.name)
        if number:
            found[int(number.group(1))] = file
    return found


def _sizes(folder: Path, count: int) -> np.ndarray:
    sizes = _table(folder / RES, KIND)
    if sizes.shape != (count, 2):
        raise InputError(f"has {len(sizes)} rows; expected width and height of {count} cameras", folder / RES)
    return sizes


def _names(folder: Path, default: list[str]) -> list[str]:
    file = folder / NAMES
    if not file.exists():
        return default
    names = [
        line.strip()
        for line in read_text(file, "the names of the cameras", MAX_CALIBRATION_BYTES).splitlines()
        if line.strip()
    ]
    return names if len(names) == len(default) else default


def _table(path: Path, kind: str) -> np.ndarray:
    """The rows of numbers of a file of Octave, comments left out."""
    lines = enumerate(read_text(path, kind, MAX_CALIBRATION_BYTES).splitlines(), 1)
    rows = [(number, line) for number, line in lines if line.strip() and not line.lstrip().startswith(("#", "%"))]
    if not rows:
        raise InputError(f"has no numbers; expected {kind}", path)
    width = len(rows[0][1].split())
    return np.array([numbers(line, width, "the row", path, number) for number, line in rows])


def _camera(name: str, matrix_file: Path, lens_file: Path, size: np.ndarray) -> RigCamera:
    projection = _table(matrix_file, "a 3×4 projection matrix")
    with np.errstate(all="ignore"):  # of numbers at the limits of what a float holds
        full = projection.shape == (3, 4) and abs(np.linalg.det(projection[:, :3])) >= 1e-12
    if not full:
        raise InputError("is no projection matrix; expected 3×4 numbers of full rank", matrix_file)
    matrix, rotation, translation = decompose(projection)
    calibration, lens = _lens(lens_file)
    return RigCamera(name, size, matrix, _refit(matrix, calibration, lens, size, lens_file), rotation, translation)


def decompose(projection: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Camera matrix (3, 3), rotation (3, 3) and translation (3,) of a projection matrix (3, 4).

    The RQ decomposition by way of QR; Hartley & Zisserman, Multiple View Geometry, section 6.2.4.
    """
    flip = np.eye(3)[::-1]
    orthogonal, upper = np.linalg.qr((flip @ projection[:, :3]).T)
    matrix, rotation = flip @ upper.T @ flip, flip @ orthogonal.T
    signs = np.diag(np.where(np.diag(matrix) < 0, -1.0, 1.0))
    matrix, rotation = matrix @ signs, signs @ rotation
    translation = np.linalg.solve(matrix, projection[:, 3])
    if np.linalg.det(rotation) < 0:
        rotation, translation = -rotation, -translation
    return matrix / matrix[2, 2], rotation, translation


def _lens(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Camera matrix (3, 3) and lens (5,) of a `.rad` file, which is lines of `K11 = 422.2` and `kc1 = -0.28`."""
    values = {}
    for number, line in enumerate(read_text(path, "a .rad lens", MAX_CALIBRATION_BYTES).splitlines(), 1):
        key, equals, value = line.partition("=")
        if equals:
            values[key.strip()] = numbers(value, 1, key.strip()[:20], path, number)[0]
    wanted = [f"K{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)]
    missing = [key for key in (*wanted, *_LENS) if key not in values]
    if missing:
        raise InputError(f"has no {missing[0]}; expected K11 to K33 and kc1 to kc4", path)
    matrix = np.array([values[key] for key in wanted]).reshape(3, 3)
    if min(abs(np.linalg.det(matrix)), abs(np.linalg.det(matrix[:2, :2]))) < 1e-9:
        raise InputError("has a singular matrix; expected K11 to K33 of a camera", path)
    return matrix, np.array([*(values[key] for key in _LENS), values.get("kc5", 0.0)])


def _refit(matrix: np.ndarray, calibration: np.ndarray, lens: np.ndarray, size: np.ndarray, path: Path) -> np.ndarray:
    """The lens (5,) that about `matrix` bends the image as `lens` does about `calibration`.

    The self-calibration finds its own camera matrix, a few pixels from the one whose lens it took out before; a camera
    of ours has one matrix for both. OpenCV's lens is linear in its coefficients, so this is one least squares problem.
    """
    grid = np.stack(np.meshgrid(*(np.linspace(0, length, 25) for length in size)), axis=-1).reshape(-1, 2)
    about_lens, about_matrix = _normalised(grid, calibration), _normalised(grid, matrix)
    bent = _normalised(distort(about_lens, lens) @ calibration[:2, :2].T + calibration[:2, 2], matrix)
    unit = np.array([distort(about_matrix, row) - about_matrix for row in np.eye(5)])
    solution, *_ = np.linalg.lstsq(unit.reshape(5, -1).T, (bent - about_matrix).ravel(), rcond=None)
    error = (distort(about_matrix, solution) - bent) @ matrix[:2, :2].T
    if not np.sqrt((error**2).sum(axis=1).mean()) < LENS_TOLERANCE_PX:
        raise InputError("has a camera matrix far from that of its .Pmat.cal; expected files of one calibration", path)
    return solution


def _normalised(pixels: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return (pixels - matrix[:2, 2]) @ np.linalg.inv(matrix[:2, :2]).T
