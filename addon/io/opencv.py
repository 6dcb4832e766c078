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
from .rig import MAX_CAMERA_NUMBER, RigCamera, refuse_crowd, rig, rotation_from_vector
from .source import MAX_CALIBRATION_BYTES, read_text
from .toml_cameras import lens
from .world import z_up

MAX_YAML_DEPTH = 12
YAML = "OpenCV's YAML"

# A text that does not end goes on to the end: looked for again from every quote in it, it would take its square.
_QUOTED = re.compile(r""""(?:[^"\\]|\\.)*"|'[^']*'""")
_PIECE = re.compile(r""""(?:[^"\\]|\\.)*"?|'[^']*'?|[^,\[\]{}]+|[,\[\]{}]""")
_TAGS = re.compile(r"(?:!!\S*\s*)+")


def parse_filestorage(text: str, path: Path) -> dict:
    """The nodes of a file: numbers, texts, lists, dicts, and matrices as arrays (rows, columns).

    Raises InputError with the line where it is anything else.
    """
    lines = _Lines(text, path)
    document = lines.block(0, 0)
    if not isinstance(document, dict):
        raise InputError(f"is a list; expected named nodes of {YAML}", path, 1)
    return document


class _Lines:
    """The lines that say something, each with its number and indentation, and how far they have been read."""

    def __init__(self, text: str, path: Path):
        self.path = path
        self.position = 0
        self.lines: list[tuple[int, int, str]] = []
        for number, line in enumerate(text.splitlines(), 1):
            content = line.strip()
            if content and not content.startswith(("#", "%")) and content not in ("---", "..."):
                self.lines.append((number, len(line) - len(line.lstrip()), content))
        if not self.lines:
            raise InputError(f"has no nodes; expected {YAML}", path)

    def fail(self, message: str) -> InputError:
        index = min(self.position, len(self.lines) - 1)
        return InputError(f"{message}; expected {YAML}", self.path, self.lines[index][0])

    def block(self, indent: int, depth: int) -> object:
        """The node whose lines are indented by `indent` or more: a list when it begins with a dash, else a dict."""
        if depth > MAX_YAML_DEPTH:
            raise self.fail("is nested too deeply")
        indent = self.lines[self.position][1]
        if self.lines[self.position][2].startswith(("- ", "-\t")) or self.lines[self.position][2] == "-":
            return self._list(indent, depth)
        nodes: dict = {}
        while self.position < len(self.lines) and self.lines[self.position][1] >= indent:
            _, here, content = self.lines[self.position]
            entry = _entry(content)
            if here != indent or entry is None:
                raise self.fail(f"has {content[:40]!r} where a node should be")
            self.position += 1
            nodes[_unquoted(entry[0])] = self._value(entry[1], indent, depth)
        return _matrix(nodes, self)

    def _list(self, indent: int, depth: int) -> list:
        items = []
        while self.position < len(self.lines) and self.lines[self.position][1] == indent:
            number, _, content = self.lines[self.position]
            if not content.startswith("-"):
                break
            rest = content[1:].lstrip()
            if _entry(rest) and not rest.startswith(("[", "{")):
                # A dict whose first entry stands beside the dash.
                self.lines[self.position] = (number, indent + len(content) - len(rest), rest)
                items.append(self.block(indent + 1, depth + 1))
            else:
                self.position += 1
                items.append(self._value(rest, indent, depth))
        return items

    def _value(self, text: str, indent: int, depth: int) -> object:
        """What stands behind a name or a dash, on the same line or below it."""
        tags = _TAGS.match(text)
        text = text[tags.end() :] if tags else text
        if text.startswith("#"):
            text = ""
        if not text:
            below = self.position < len(self.lines) and self.lines[self.position]
            deeper = below and (below[1] > indent or (below[1] == indent and below[2].startswith("-")))
            return self.block(indent, depth + 1) if deeper else None
        if text[0] in "[{":
            return self._flow(text)
        return _scalar(text)

    def _flow(self, text: str) -> list:
        """A `[…]` or `{…}` that may go on over several lines, as a flat list of what is in it."""
        parts = [text]
        while parts[-1].count("]") + parts[-1].count("}") == 0 and self.position < len(self.lines):
            parts.append(self.lines[self.position][2])
            self.position += 1
        joined = " ".join(parts)
        if joined[-1] not in "]}":
            raise self.fail("has a list that does not end")
        pieces = (piece.strip() for piece in _PIECE.findall(joined))
        return [_scalar(piece) for piece in pieces if piece and piece not in ",[]{}"]


def _entry(content: str) -> tuple[str, str] | None:
    """A line's name, in its quotes if it has any, and what stands behind the colon; None where it has no name."""
    quoted = _QUOTED.match(content)
    end = quoted.end() if quoted else content.find(":")
    name, colon, value = content[:end], content[end:].lstrip()[:1], content[end:].lstrip()[1:]
    plain = quoted or (name[:1] not in ("", *"#'\"[]{}") and "#" not in name)
    if end <= 0 or not plain or colon != ":" or not (value == "" or value[0].isspace()):
        return None
    return name.strip(), value.strip()


def _matrix(nodes: dict, lines: _Lines) -> object:
    """An array where the nodes are those of a matrix, else the nodes."""
    if not {"rows", "cols", "data"} <= nodes.keys():
        return nodes
    rows, columns, data = nodes["rows"], nodes["cols"], nodes["data"]
    whole = all(isinstance(size, float) and size % 1 == 0 and 0 <= size < 1e6 for size in (rows, columns))
    if not whole or not isinstance(data, list) or not all(isinstance(value, float) for value in data):
        lines.position -= 1
        raise lines.fail("has a matrix that is not rows, cols and numbers")
    if int(rows) * int(columns) != len(data):
        lines.position -= 1
        raise lines.fail(f"has a matrix of {len(data)} numbers for {rows:g}×{columns:g}")
    return np.array(data, dtype=float).reshape(int(rows), int(columns))


def _scalar(text: str) -> float | str:
    """A number where it is one, else a text; `.Nan` and `.Inf` are YAML's."""
    comment = re.search(r"\s#", text) if text[:1] not in "\"'" else None
    text = (text[: comment.start()] if comment else text).strip()
    try:
        return float(text.lower().replace(".nan", "nan").replace(".inf", "inf"))
    except ValueError:
        return _unquoted(text)


def _unquoted(text: str) -> str:
    quoted = len(text) > 1 and text[0] == text[-1] and text[0] in "\"'"
    return text[1:-1] if quoted else text


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
    matrix = _array(parts, MATRIX, name, path, (9,)).reshape(3, 3)
    rotation = _array(parts, ROTATION, name, path, (9, 3))
    given = next((parts[key] for key in LENS if parts.get(key) is not None), None)
    coefficients = np.zeros(5) if given is None else _array(parts, LENS, name, path, tuple(range(15)))
    return RigCamera(
        name=name,
        size=_size(parts, matrix, name, path),
        matrix=matrix,
        distortion=lens(coefficients, name, path),
        rotation=rotation_from_vector(rotation) if rotation.size == 3 else rotation.reshape(3, 3),
        translation=_array(parts, TRANSLATION, name, path, (3,)),
    )


def _size(parts: dict, matrix: np.ndarray, name: str, path: Path) -> np.ndarray:
    if any(parts.get(key) is not None for key in SIZE):
        return _array(parts, SIZE, name, path, (2,))
    if any(parts.get(key) is not None for key in WIDTH) and any(parts.get(key) is not None for key in HEIGHT):
        return np.concatenate([_array(parts, keys, name, path, (1,)) for keys in (WIDTH, HEIGHT)])
    return np.round(2 * np.minimum(matrix[:2, 2], MAX_CAMERA_NUMBER))  # what is larger is refused with the matrix


def _array(parts: dict, keys: tuple[str, ...], name: str, path: Path, counts: tuple[int, ...]) -> np.ndarray:
    value = next((parts[key] for key in keys if parts.get(key) is not None), None)
    if value is None:
        raise InputError(f"camera {name} has no {keys[0]} ({', '.join(keys[1:4])}); expected {KIND}", path)
    try:
        array = np.array(value, dtype=float).ravel()
    except (TypeError, ValueError):
        array = np.array([np.nan])
    if array.size not in counts or not np.isfinite(array).all():
        raise InputError(f"camera {name} has a {keys[0]} that is not {counts[0]} numbers; expected {KIND}", path)
    return array
