# SPDX-License-Identifier: GPL-3.0-or-later
"""Marker sets as readable text, `*.markerset.json`: a segment, marker or capsule a line, checked when it is read."""

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from ..core.data.errors import InputError
from ..core.data.markersets import Capsules, MarkerSet, Skeleton, Spread
from .source import read_json
from .text import EXPECTED, can_be_named, can_be_written, is_unicode, rounded

# What no marker set holds; physical.
MAX_NUMBER = 1e3  # heights, metres and square radians of a body are all far below it
MARKERSET_ROWS = 1000  # of a table: a subject has a hundred markers at most and fewer joints


class Reader:
    """Takes parts out of a parsed file; each method raises InputError naming the part, where it is not as expected."""

    def __init__(self, path: Path):
        self.path = path

    def fail(self, message: str) -> NoReturn:
        """Raises the error."""
        raise InputError(message, self.path)

    def mapping(self, value: object, where: str) -> dict:
        """`value` as an object."""
        if not isinstance(value, dict):
            self.fail(f"{where} is missing or not an object; expected a marker set's {{…}}")
        return value

    def rows(self, top: dict, key: str, empty: bool = False) -> list[tuple[str, dict]]:
        """The objects of the list `key`, each with words for where it stands."""
        value = top.get(key)
        if not isinstance(value, list) or not (value or empty):
            self.fail(f'"{key}" is missing or empty; expected a list')
        if len(value) > MARKERSET_ROWS:
            self.fail(f'"{key}" has {len(value)} rows; expected at most {MARKERSET_ROWS}')
        words = [f"{key}[{index}]" for index in range(len(value))]
        return [(where, self.mapping(row, where)) for where, row in zip(words, value, strict=True)]

    def text(self, row: dict, key: str, where: str) -> str:
        """The name under `key`."""
        value = row.get(key)
        if not isinstance(value, str) or not value.strip():
            self.fail(f'{where} has no "{key}"; expected a text')
        return self._writable(value, f'{where} "{key}"')

    def prose(self, top: dict, key: str) -> str:
        """The text of any length under `key`, empty where there is none."""
        value = top.get(key, "")
        if not isinstance(value, str) or not is_unicode(value):
            self.fail(f'"{key}" is no text; expected one in Unicode')
        return value

    def _writable(self, name: str, where: str) -> str:
        if not can_be_written(name):
            self.fail(f"{where} is {name!r}; {EXPECTED}")
        return name

    def texts(self, value: object, where: str) -> dict[str, str]:
        """An object of texts."""
        if not isinstance(value, dict) or not all(
            isinstance(text, str) and is_unicode(text) for pair in value.items() for text in pair
        ):
            self.fail(f'"{where}" is not an object of texts; expected {{"people": "…"}}')
        return value

    def names(self, value: object, where: str) -> list[str]:
        """A list of names."""
        if not isinstance(value, list) or not all(isinstance(name, str) and name.strip() for name in value):
            self.fail(f"{where} are not a list of names; expected texts")
        return [self._writable(name, where) for name in value]

    def marker(self, name: str):
        """Checks that label files can hold a marker's name."""
        if not can_be_named(name):
            self.fail(
                f'marker {name!r} has a sign that label files need; expected a name without | , " or a '
                "leading *, and without blanks around it"
            )

    def unique(self, names: Sequence[str], key: str):
        """Checks that no name is there twice."""
        doubled = next((name for name, count in Counter(names).items() if count > 1), None)
        if doubled is not None:
            self.fail(f'"{key}" has {doubled!r} twice; expected every name once')

    def on_segments(self, rows: Sequence[tuple[str, dict]], segments: Sequence[str]) -> np.ndarray:
        """(N,) the indices of the segments that N rows are on."""
        place, found = {name: index for index, name in enumerate(segments)}, []
        for where, row in rows:
            name = self.text(row, "segment", where)
            if name not in place:
                self.fail(f"{where} is on {name!r}, which is no segment; expected one of {', '.join(segments[:8])}")
            found.append(place[name])
        return np.array(found, dtype=int)

    def number(self, row: dict, key: str, where: str, low: float = -MAX_NUMBER, high: float = MAX_NUMBER) -> float:
        """The number under `key`, within bounds."""
        value = row.get(key)
        if value is None or not _is_number(value) or not low <= value <= high:
            self.fail(f'{where} has no "{key}" from {low:g} to {high:g}; expected a number')
        return float(value)

    def vector(self, row: dict, key: str, where: str) -> np.ndarray:
        """The three numbers under `key`."""
        return self.array(row.get(key), (3,), f'{where} "{key}"')

    def array(self, value: object, shape: tuple[int | None, ...], where: str, most: float = MAX_NUMBER) -> np.ndarray:
        """The numbers of a list, or of a list of lists, of a shape in which None is any length."""
        count, *rest = shape
        if (
            not isinstance(value, list)
            or len(value) != (len(value) if count is None else count)
            or not (rest or all(_is_number(one, most) for one in value))
        ):
            what = "rows of numbers" if rest else "finite numbers"
            self.fail(f"{where} is not {count or 'a list of'} {what}; expected a list of them")
        if rest:
            value = [self.array(row, tuple(rest), where, most) for row in value]
        return np.array(value, dtype=float).reshape(-1, *rest)

    def triangle(self, value: object, size: int, where: str, most: float = MAX_NUMBER) -> np.ndarray:
        """(size, size) the symmetric matrix whose lower triangle this is."""
        if not isinstance(value, list) or len(value) != size:
            self.fail(f"{where} is missing or not {size} rows; expected the lower triangle of a matrix")
        matrix = np.zeros((size, size))
        for index, row in enumerate(value):
            matrix[index, : index + 1] = self.array(row, (index + 1,), f"{where} row {index}", most)
        return matrix + np.tril(matrix, -1).T

    def vectors(self, value: object, names: Sequence[str], where: str) -> np.ndarray:
        """(N, 3) of an object that holds one vector for every name."""
        table = self.mapping(value, where)
        missing = next((name for name in names if name not in table), None)
        if missing is not None:
            self.fail(f"{where} has no {missing!r}; expected three numbers for each")
        return np.array([self.array(table[name], (3,), f"{where} {name!r}") for name in names]).reshape(-1, 3)

    def covariance(self, value: object, size: int) -> np.ndarray:
        """(size, size) out of its lower triangle; it must be one of real motion, so never negative in any direction."""
        where = "pose covariance"
        matrix = self.triangle(value, size, where)
        eigenvalues = np.linalg.eigvalsh(matrix)
        if eigenvalues[0] < -1e-4 * max(eigenvalues[-1], 1e-9):
            self.fail(f"{where} is negative in some direction; expected a covariance")
        return matrix


def _is_number(value: object, most: float = MAX_NUMBER) -> bool:
    """True for a finite JSON number of a size that a body can have; True and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -most <= value <= most


SUFFIX = ".markerset.json"
VERSION_KEY = "mocap_autolabel"
VERSION = 1
POSE_DECIMALS = 3  # of a recorded pose, rad: half a millimetre at the end of a limb

AUTO_MODEL = "auto"  # in place of a model's name: the one that a take shows

ASSETS = Path(__file__).resolve().parents[2] / "assets"
LAYOUTS, LAYOUT_SUFFIX = ASSETS / "layouts", ".toml"  # published sets in words


def builtin_markersets() -> dict[str, Path]:
    """The marker sets that come with the add-on: file by name, in the order of the names."""
    return {path.name.removesuffix(SUFFIX): path for path in sorted(ASSETS.glob(f"*{SUFFIX}"))}


def markerset_file(name: str | Path) -> Path:
    """The file of a built-in marker set or model, or the path that `name` is."""
    return builtin_markersets().get(str(name), Path(name))


def open_markerset(name: str | Path) -> MarkerSet:
    """A built-in marker set by name, or any by the path of its file; InputError where it is neither."""
    builtin, path = builtin_markersets(), markerset_file(name)
    if not path.suffix and not path.exists():
        if (LAYOUTS / f"{name}{LAYOUT_SUFFIX}").exists():
            made = f"train --set {name} --out {name}{SUFFIX}"
            raise InputError(f"{name} is a marker set in words; expected the model that {made} makes of it")
        raise InputError(f"there is no marker set {name}; expected {', '.join(builtin)} or the path of a {SUFFIX} file")
    return read_markerset(path)


def read_markerset(path: Path) -> MarkerSet:
    """A marker set, checked in every part; unknown keys are let be. Raises InputError that names the part."""
    return markerset_in(*open_document(path))


def open_document(path: Path) -> tuple[Reader, dict]:
    """The JSON of a marker set's or a model's file, of a version that is known; InputError where it is none."""
    document = read_json(path, "a marker set")
    reader = Reader(path)
    top = reader.mapping(document, "the file")
    version = top.get(VERSION_KEY)
    if isinstance(version, int) and version > VERSION:
        raise InputError(
            f"is a marker set of version {version}; expected {VERSION}, so a newer Mocap Autolabel is needed", path
        )
    if version != VERSION:
        raise InputError(f'has no "{VERSION_KEY}": {VERSION}; expected a marker set of that version', path)
    return reader, top


def markerset_in(reader: Reader, top: dict) -> MarkerSet:
    """The marker set of a file's JSON, checked in every part. Raises InputError that names the part."""
    skeleton = _skeleton(reader, top)
    markers, aliases, attachment, offsets, marker_sd = _markers(reader, top, skeleton)
    return MarkerSet(
        name=reader.text(top, "name", "the file"),
        description=reader.prose(top, "description"),
        markers=markers,
        aliases=aliases,
        skeleton=skeleton,
        attachment=attachment,
        offsets=offsets,
        capsules=_capsules(reader, top, skeleton),
        spread=_spread(reader, top, skeleton, markers, marker_sd),
        source=reader.texts(top.get("source", {}), "source"),
    )


def _skeleton(reader: Reader, top: dict) -> Skeleton:
    rows = reader.rows(top, "segments")
    names = [reader.text(row, "name", where) for where, row in rows]
    reader.unique(names, "segments")
    place = {name: index for index, name in enumerate(names)}
    parents = []
    for index, (where, row) in enumerate(rows):
        parent = row.get("parent")
        if parent is None:
            parents.append(-1)
        elif not isinstance(parent, str) or parent not in place:
            reader.fail(f"{where} has the parent {parent!r}, which is no segment; expected the name of a segment")
        else:
            parents.append(place[parent])
        if (parents[-1] < 0) != (index == 0):
            reader.fail(f"{where} {'has no parent' if index else 'has a parent'}; expected one root, the first segment")
        if parents[-1] >= index:
            reader.fail(f"{where} comes before its parent {parent!r}, or they go in a circle; expected parents first")
    offsets = [reader.vector(row, "offset", where) for where, row in rows]
    return Skeleton(tuple(names), np.array(parents), np.array(offsets))


def _markers(reader: Reader, top: dict, skeleton: Skeleton) -> tuple:
    rows = reader.rows(top, "markers")
    names = [reader.text(row, "name", where) for where, row in rows]
    reader.unique(names, "markers")
    for name in names:
        reader.marker(name)
    taken, aliases = set(names), {}
    for (where, row), name in zip(rows, names, strict=True):
        for alias in reader.names(row.get("aliases", []), f"{where} aliases"):
            if alias in taken:
                reader.fail(f"alias {alias!r} of {name} is taken already; expected every name once")
            taken.add(alias)
            aliases[alias] = name
    attachment = reader.on_segments(rows, skeleton.segments)
    offsets = np.array([reader.vector(row, "offset", where) for where, row in rows])
    spread = np.array([reader.number(row, "sd", where, low=0) for where, row in rows])
    return tuple(names), aliases, attachment, offsets, spread


def _capsules(reader: Reader, top: dict, skeleton: Skeleton) -> Capsules:
    rows = reader.rows(top, "capsules", empty=True)
    return Capsules(
        segment=reader.on_segments(rows, skeleton.segments),
        start=np.array([reader.vector(row, "start", where) for where, row in rows]).reshape(-1, 3),
        end=np.array([reader.vector(row, "end", where) for where, row in rows]).reshape(-1, 3),
        radius=np.array([reader.number(row, "radius", where, low=1e-9) for where, row in rows]),
    )


def _spread(reader: Reader, top: dict, skeleton: Skeleton, markers: tuple[str, ...], marker_sd: np.ndarray) -> Spread:
    height = reader.mapping(top.get("height"), "height")
    modes = []
    for where, mode in reader.rows(top, "modes", empty=True):
        joints = reader.vectors(mode.get("joints"), skeleton.segments, f"{where} joints")
        modes.append(np.concatenate([joints, reader.vectors(mode.get("markers"), markers, f"{where} markers")]))
    pose = reader.mapping(top.get("pose"), "pose")
    return Spread(
        height=reader.number(height, "mean", "height", low=0.3, high=3),
        height_sd=reader.number(height, "sd", "height", low=0),
        modes=np.array(modes).reshape(-1, len(skeleton) + len(markers), 3),
        marker_sd=marker_sd,
        pose_mean=reader.vectors(pose.get("mean"), skeleton.segments, "pose mean"),
        pose_covariance=reader.covariance(pose.get("covariance"), 3 * len(skeleton)),
        poses=_poses(reader, pose, len(skeleton)),
    )


def _poses(reader: Reader, pose: dict, joints: int) -> np.ndarray:
    """(P, J, 3) the poses that were recorded; none in files that keep none."""
    rows = pose.get("recorded", [])
    if not isinstance(rows, list):
        reader.fail('pose "recorded" is no list; expected a list of poses')
    named = [reader.array(row, (3 * joints,), f"pose {number}") for number, row in enumerate(rows, 1)]
    return np.array(named).reshape(-1, joints, 3) if rows else np.zeros((0, 0, 3))


def document_of(markerset: MarkerSet) -> dict:
    """A marker set as JSON has it; ValueError where a number is not finite."""
    skeleton, capsules, spread = markerset.skeleton, markerset.capsules, markerset.spread
    segments, joints = skeleton.segments, len(skeleton.segments)
    pose = {
        "mean": _named(segments, spread.pose_mean),
        # A symmetric matrix stays one whatever is rounded.
        "covariance": [rounded(row[: index + 1]) for index, row in enumerate(spread.pose_covariance)],
    }
    if len(spread.poses):
        pose["recorded"] = [rounded(np.round(one, POSE_DECIMALS).ravel()) for one in spread.poses]
    return {
        VERSION_KEY: VERSION,
        "name": markerset.name,
        "description": markerset.description,
        "source": dict(markerset.source),
        "segments": [
            {"name": name, "parent": None if parent < 0 else segments[parent], "offset": rounded(offset)}
            for name, parent, offset in zip(segments, skeleton.parents, skeleton.offsets, strict=True)
        ],
        "markers": [_marker(markerset, index) for index in range(len(markerset.markers))],
        "capsules": [
            {"segment": segments[segment], "start": rounded(start), "end": rounded(end), "radius": rounded(radius)}
            for segment, start, end, radius in zip(
                capsules.segment, capsules.start, capsules.end, capsules.radius, strict=True
            )
        ],
        "height": {"mean": rounded(spread.height), "sd": rounded(spread.height_sd)},
        "modes": [
            {"joints": _named(segments, mode[:joints]), "markers": _named(markerset.markers, mode[joints:])}
            for mode in spread.modes
        ],
        "pose": pose,
    }


def _marker(markerset: MarkerSet, index: int) -> dict:
    name = markerset.markers[index]
    aliases = [alias for alias, meant in markerset.aliases.items() if meant == name]
    row = {
        "name": name,
        "segment": markerset.skeleton.segments[markerset.attachment[index]],
        "offset": rounded(markerset.offsets[index]),
        "sd": rounded(markerset.spread.marker_sd[index]),
    }
    return row | ({"aliases": aliases} if aliases else {})


def _named(names: Iterable[str], rows: np.ndarray) -> dict[str, list]:
    return {name: rounded(row) for name, row in zip(names, rows, strict=True)}
