# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras in `.yml` files that OpenCV's FileStorage wrote, and the part of YAML that it writes.

Intrinsics and extrinsics are in one file or in two. Nodes go by indentation; there are `[…]` rows and matrices.
"""

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.geometry.cameras import Cameras
from .rig_cameras import MAX_CAMERA_NUMBER, RigCamera, lens, numbers_in, refuse_crowd, rig, rotation_of
from .source import MAX_CALIBRATION_BYTES, read_text
from .world import z_up

YAML = "OpenCV's YAML"
# A text that does not end goes on to the end: looked for again from every quote in it, it would take its square.
_QUOTED = re.compile(r""""(?:[^"\\]|\\.)*"|'[^']*'""")
_TAGS = re.compile(r"(?:!!\S*\s*)+")
_PIECE = re.compile(r""""(?:[^"\\]|\\.)*"?|'[^']*'?|[^,\[\]{}\s][^,\[\]{}]*""")


def parse_filestorage(text: str, path: Path) -> dict:
    """The nodes of a file: numbers, texts, lists in a pair of brackets, dicts, and matrices as arrays (rows, columns).

    Items behind dashes are passed over: nothing of a camera is in them. InputError with the line for anything else.
    """
    lines = [(number, line, line.strip()) for number, line in enumerate(text.splitlines(), 1)]
    rest = iter([one for one in lines if one[2] and one[2][0] not in "#%" and one[2] not in ("---", "...")])
    root: dict = {}
    open_nodes: list[tuple[int, dict, dict, str]] = [(-1, root, {}, "")]  # with the indentation, and whose they are

    def close(indent: int, number: int):
        while open_nodes[-1][0] >= indent:
            _, node, owner, name = open_nodes.pop()
            if {"rows", "cols", "data"} <= node.keys():
                owner[name] = _matrix(node, path, number)

    for number, line, content in rest:
        indent = len(line) - len(line.lstrip())
        close(indent, number - 1)
        if content[0] == "-":
            open_nodes.append((indent, {}, {}, ""))
            continue
        name, value = _entry(content, path, number)
        owner = open_nodes[-1][1]
        if value[:1] in ("", "#"):
            owner[name] = {}
            open_nodes.append((indent, owner[name], owner, name))
            continue
        parts = [value]
        while value[0] in "[{" and not {"]", "}"} & set(parts[-1]) and (more := next(rest, None)):
            parts.append(more[2])
        if value[0] in "[{" and parts[-1][-1] not in "]}":
            raise InputError(f"has a list that does not end; expected {YAML}", path, number)
        listed = [_scalar(piece) for piece in _PIECE.findall(" ".join(parts))] if value[0] in "[{" else []
        owner[name] = listed if value[0] in "[{" else _scalar(value)
    close(0, len(lines))
    if not root:
        raise InputError(f"has no nodes; expected {YAML}", path)
    return root


def _entry(content: str, path: Path, number: int) -> tuple[str, str]:
    """A line's name, without its quotes if it has any, and what stands behind the colon, without its tags."""
    quoted = _QUOTED.match(content)
    end = quoted.end() if quoted else content.find(":")
    name, rest = content[:end].strip(), content[end:].lstrip()
    plain = quoted or (name and name[0] not in "*#'\"[]{}" and "#" not in name)
    if end <= 0 or not plain or rest[:1] != ":" or rest[1:2].strip():
        raise InputError(f"has {content[:40]!r} where a node should be; expected {YAML}", path, number)
    value = rest[1:].strip()
    tags = _TAGS.match(value)
    return name.strip("\"'"), value[tags.end() :] if tags else value


def _matrix(nodes: dict, path: Path, line: int) -> np.ndarray:
    rows, columns, data = nodes["rows"], nodes["cols"], nodes["data"]
    whole = all(isinstance(size, float) and size % 1 == 0 and 0 <= size < 1e6 for size in (rows, columns))
    if not whole or not isinstance(data, list) or not all(isinstance(value, float) for value in data):
        raise InputError(f"has a matrix that is not rows, cols and numbers; expected {YAML}", path, line)
    if int(rows) * int(columns) != len(data):
        words = f"has a matrix of {len(data)} numbers for {rows:g}×{columns:g}"
        raise InputError(f"{words}; expected {YAML}", path, line)
    return np.array(data, dtype=float).reshape(int(rows), int(columns))


def _scalar(text: str) -> float | str:
    """A number where it is one, else a text; `.Nan` and `.Inf` are YAML's."""
    text = text.strip()
    if text[:1] in ('"', "'"):
        return text.strip(text[0])
    if "#" in text:
        text = re.split(r"\s#", text, maxsplit=1)[0].strip()
    try:
        return float(text if text[-1:].isdigit() else text.lower().replace(".nan", "nan").replace(".inf", "inf"))
    except ValueError:
        return text


KIND = "an OpenCV .yml calibration with intrinsics and extrinsics"

# Pairs of files, intrinsics and extrinsics; either may be named.
PAIRS = (("intri", "extri"), ("intrinsics", "extrinsics"), ("intrinsic", "extrinsic"))

# What the parts of a camera are called; the first name that is there counts.
MATRIX = ("K", "camera_matrix", "cameraMatrix", "M", "intrinsic_matrix", "intrinsics", "matrix")
LENS = ("dist", "D", "distortion_coefficients", "dist_coeffs", "distCoeffs", "distortion", "distortions")
ROTATION = ("Rot", "R", "rotation", "rotation_matrix", "rvec")
TRANSLATION = ("T", "t", "translation", "translation_vector", "tvec")
WIDTH, HEIGHT = ("W", "width", "image_width"), ("H", "height", "image_height")
SIZE = ("size", "image_size", "imageSize", "resolution")


# What is no calibration in metres; physical, and memory.
MAX_KEY = 100  # letters: longer is no name of a matrix and its camera
MAX_DISTANCE_M = 200.0  # of a camera from the origin: if one is farther off, the file is in millimetres
# of a file: beside its cameras it may hold the points that they were calibrated with
MAX_YML_BYTES = 4 * MAX_CALIBRATION_BYTES


def read_yml(path: Path, up: str = "") -> Cameras:
    """The cameras of a file, or of the pair that it belongs to (`intri.yml` beside `extri.yml`).

    Understood are parts with the camera's name behind (`K_01`, `dist_01`, `R_01`, `T_01`, as EasyMocap writes; also
    `M1`, `D1`), a node a camera, and one camera alone. `R` may be a Rodrigues vector. Where no image size is given, it
    is twice the principal point. Metres, or millimetres where metres cannot be.
    """
    document = {}
    for file in files_of(path):
        nodes = parse_filestorage(read_text(file, KIND, MAX_YML_BYTES), file)
        document.update({key: value for key, value in nodes.items() if key not in document or value is not None})
    cameras = list(_cameras(document, path))
    if not cameras:
        raise InputError(f"has no camera with a matrix; expected {KIND}", path)
    if any(math.hypot(*camera.translation) > MAX_DISTANCE_M for camera in cameras):
        cameras = [RigCamera(c.name, c.size, c.matrix, c.distortion, c.rotation, c.translation / 1000) for c in cameras]
    return z_up(rig(cameras, path), up)


def files_of(path: Path) -> list[Path]:
    """The file and the other one of its pair; InputError where that is missing."""
    for pair in PAIRS:
        if path.stem.lower() in pair:
            others = [path.with_name(name + path.suffix) for name in pair if name != path.stem.lower()]
            missing = next((other for other in others if not other.exists()), None)
            if missing is not None:
                raise InputError(f"needs {missing.name} beside it; expected intrinsics and extrinsics", path)
            return [path, *others]
    return [path]


def _cameras(document: dict, path: Path) -> Iterator[RigCamera]:
    for name, parts in _parts(document, path).items():
        label = name.strip("_")
        first_of_pair = label == "1" and not any(key in parts for key in (*ROTATION, *TRANSLATION)) and "M2" in document
        if first_of_pair:
            parts = {**parts, "R": np.eye(3), "T": np.zeros(3)}
        elif label == "2" and "M1" in document:
            parts = {**{key: document[key] for key in ("R", "T") if key in document}, **parts}
        yield _camera(label, {**_shared_size(document), **parts}, path)
    dicts = [(name, node) for name, node in document.items() if isinstance(node, dict)]
    nodes = [(name, node) for name, node in dicts if not node.keys().isdisjoint(MATRIX)]
    refuse_crowd(len(nodes), path)
    for name, node in nodes:
        yield _camera(str(node.get("name", name)), {**_shared_size(document), **node}, path)
    if any(key in document for key in MATRIX if not isinstance(document.get(key), dict)):
        yield _camera(path.stem, document, path)


def _parts(document: dict, path: Path) -> dict[str, dict]:
    """What belongs to each camera, by what stands behind its names, such as `_01` or `1`, in one go over all nodes."""
    parts: dict[str, dict] = {name: {} for name in _suffixes(document)}
    refuse_crowd(len(parts), path)
    lengths = sorted({len(name) for name in parts})
    for key, value in document.items():
        for length in lengths:
            if key[-length:] in parts:
                parts[key[-length:]][key[:-length].rstrip("_")] = value
    return parts


def _suffixes(document: dict) -> list[str]:
    """What stands behind `K`, `M` or `camera_matrix` in the names of matrices, such as `_01` or `1`."""
    found: dict[str, None] = {}
    for key, value in document.items():
        if len(key) > MAX_KEY or not isinstance(value, np.ndarray) or value.size != 9:
            continue
        for stem in MATRIX:
            rest = key[len(stem) :]
            if key.startswith(stem) and (rest[:1] == "_" or rest.isdigit()) and rest.strip("_"):
                found[rest] = None
    return list(found)


def _shared_size(document: dict) -> dict:
    return {key: document[key] for key in (*SIZE, *WIDTH, *HEIGHT) if key in document}


def _camera(name: str, parts: dict, path: Path) -> RigCamera:
    matrix = numbers_in(parts, MATRIX, name, path, 9).reshape(3, 3)
    rotation = numbers_in(parts, ROTATION, name, path, 9, 3)
    given = next((parts[key] for key in LENS if parts.get(key) is not None), None)
    coefficients = np.zeros(5) if given is None else numbers_in(parts, LENS, name, path, *range(15))
    return RigCamera(
        name=name,
        size=_size(parts, matrix, name, path),
        matrix=matrix,
        distortion=lens(coefficients, name, path),
        rotation=rotation_of(rotation),
        translation=numbers_in(parts, TRANSLATION, name, path, 3),
    )


def _size(parts: dict, matrix: np.ndarray, name: str, path: Path) -> np.ndarray:
    if any(parts.get(key) is not None for key in SIZE):
        return numbers_in(parts, SIZE, name, path, 2)
    if any(parts.get(key) is not None for key in WIDTH) and any(parts.get(key) is not None for key in HEIGHT):
        return np.concatenate([numbers_in(parts, keys, name, path, 1) for keys in (WIDTH, HEIGHT)])
    return np.round(2 * np.minimum(matrix[:2, 2], MAX_CAMERA_NUMBER))  # what is larger is refused with the matrix
