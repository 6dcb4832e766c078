# SPDX-License-Identifier: GPL-3.0-or-later
"""Marker sets as readable text, `*.markerset.json`: one segment, marker or capsule a line."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.data.markersets import Capsules, MarkerSet, Skeleton, Spread
from .json_text import json_text, rounded, write_json
from .markerset_fields import Reader
from .names import can_be_named
from .source import read_json

SUFFIX = ".markerset.json"
VERSION_KEY = "mocap_autolabel"
VERSION = 1
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
    write_json(path, document_of(markerset))


def markerset_text(markerset: MarkerSet) -> str:
    """The text of a marker set's file."""
    return json_text(document_of(markerset)) + "\n"


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
