# SPDX-License-Identifier: GPL-3.0-or-later
"""Marker sets as readable text, `*.markerset.json`: one segment, marker or capsule a line."""

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.data.markersets import Capsules, MarkerSet, Skeleton, Spread
from .markerset_fields import Reader, finite
from .names import can_be_named
from .source import read_json

SUFFIX = ".markerset.json"
VERSION_KEY = "mocap_autolabel"
VERSION = 1
DIGITS = 6
POSE_DECIMALS = 3  # of a recorded pose, rad: half a millimetre at the end of a limb

ASSETS = Path(__file__).resolve().parents[2] / "assets"


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
        if not can_be_named(name):
            reader.fail(
                f'marker {name!r} has a sign that label files need; expected a name without | , " or a '
                "leading *, and without blanks around it"
            )
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
    named = [reader.row(row, 3 * joints, f"pose {number}") for number, row in enumerate(rows, 1)]
    return np.array(named).reshape(-1, joints, 3) if rows else np.zeros((0, 0, 3))


def write_markerset(path: Path, markerset: MarkerSet):
    """Writes a marker set; numbers keep six significant digits, and reading and writing again changes nothing."""
    Path(path).write_text(markerset_text(markerset), encoding="utf-8", newline="\n")


def markerset_text(markerset: MarkerSet) -> str:
    """The text of a marker set's file."""
    segments, spread = markerset.skeleton.segments, markerset.spread
    joints = len(segments)
    parts = {
        VERSION_KEY: str(VERSION),
        "name": _text(markerset.name),
        "description": _text(markerset.description),
        "source": _block("{}", (f"{_text(key)}: {_text(value)}" for key, value in markerset.source.items())),
        "segments": _block("[]", _segment_rows(markerset.skeleton)),
        "markers": _block("[]", _marker_rows(markerset)),
        "capsules": _block("[]", _capsule_rows(markerset)),
        "height": f'{{"mean": {_number(spread.height)}, "sd": {_number(spread.height_sd)}}}',
        "modes": _block(
            "[]",
            (
                _object(joints=_named(segments, mode[:joints], 6), markers=_named(markerset.markers, mode[joints:], 6))
                for mode in spread.modes
            ),
        ),
        "pose": _object(
            mean=_named(segments, spread.pose_mean, 4),
            covariance=_triangle(spread.pose_covariance),
            **_recorded(spread),
        ),
    }
    return "{\n" + ",\n".join(f"  {_text(key)}: {value}" for key, value in parts.items()) + "\n}\n"


def _segment_rows(skeleton: Skeleton) -> Iterable[str]:
    for name, parent, offset in zip(skeleton.segments, skeleton.parents, skeleton.offsets, strict=True):
        above = "null" if parent < 0 else _text(skeleton.segments[parent])
        yield f'{{"name": {_text(name)}, "parent": {above}, "offset": {_row(offset)}}}'


def _marker_rows(markerset: MarkerSet) -> Iterable[str]:
    for index, name in enumerate(markerset.markers):
        aliases = [alias for alias, meant in markerset.aliases.items() if meant == name]
        also = f', "aliases": [{", ".join(map(_text, aliases))}]' if aliases else ""
        yield (
            f'{{"name": {_text(name)}, "segment": {_text(markerset.skeleton.segments[markerset.attachment[index]])}, '
            f'"offset": {_row(markerset.offsets[index])}, "sd": {_number(markerset.spread.marker_sd[index])}{also}}}'
        )


def _capsule_rows(markerset: MarkerSet) -> Iterable[str]:
    capsules = markerset.capsules
    for segment, start, end, radius in zip(
        capsules.segment, capsules.start, capsules.end, capsules.radius, strict=True
    ):
        name = _text(markerset.skeleton.segments[segment])
        yield f'{{"segment": {name}, "start": {_row(start)}, "end": {_row(end)}, "radius": {_number(radius)}}}'


def _block(brackets: str, rows: Iterable[str], indent: int = 2) -> str:
    lines = [" " * (indent + 2) + row for row in rows]
    return brackets if not lines else f"{brackets[0]}\n" + ",\n".join(lines) + f"\n{' ' * indent}{brackets[1]}"


def _named(names: Iterable[str], rows: np.ndarray, indent: int) -> str:
    return _block("{}", (f"{_text(name)}: {_row(row)}" for name, row in zip(names, rows, strict=True)), indent)


def _object(**parts: str) -> str:
    return "{" + ", ".join(f'"{key}": {value}' for key, value in parts.items()) + "}"


def _recorded(spread: Spread) -> dict[str, str]:
    """The text of the poses that were recorded, a pose a line; nothing where none are kept."""
    rows = [_row(np.round(pose, POSE_DECIMALS).ravel()) for pose in spread.poses]
    return {"recorded": _block("[]", rows, 4)} if rows else {}


def _triangle(matrix: np.ndarray) -> str:
    """The lower triangle, a row a line: a symmetric matrix stays one whatever is rounded."""
    return _block("[]", (_row(row[: index + 1]) for index, row in enumerate(matrix)), 4)


def _row(values: np.ndarray) -> str:
    return f"[{', '.join(_number(value) for value in values)}]"


def _number(value: float) -> str:
    return json.dumps(finite(float(f"{value:.{DIGITS}g}")) + 0.0).removesuffix(".0")


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)
