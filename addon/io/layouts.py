# SPDX-License-Identifier: GPL-3.0-or-later
"""Marker sets in words, as TOML: which marker sits where on which segment. Published ones ship in `assets/layouts`.

name = "ours"
description = "Lower body with wands"
source = "who has published it"

[markers]
SACR = { segment = "pelvis", at = "sacrum" }
"*ASI" = { segment = "pelvis", at = "ASIS" }                  # LASI and RASI
"*THI" = { segment = "thigh", at = "outer", along = 0.5, off_mm = 80 }
"""

from pathlib import Path

from ..core.data.errors import InputError
from ..core.data.markersets import Layout, Site
from .markersets import LAYOUT_SUFFIX, LAYOUTS, Reader
from .source import toml_document

SIDE_WORDS = {"L": "left ", "R": "right "}
MAX_OFF_MM = 300  # physical: no wand is longer
SITE_KEYS = {"segment", "at", "along", "off_mm"}


def shipped_layouts() -> dict[str, Path]:
    """The published sets by name."""
    return {path.stem: path for path in sorted(LAYOUTS.glob(f"*{LAYOUT_SUFFIX}"))}


def open_layout(name: str | Path) -> Layout:
    """The layout of a file, or a published one by name; InputError where there is none, or it is broken."""
    shipped = shipped_layouts()
    if str(name) in shipped:
        return read_layout(shipped[str(name)])
    if not str(name).endswith(LAYOUT_SUFFIX):
        raise InputError(
            f"is no layout; expected a file that ends in {LAYOUT_SUFFIX}, or one of {', '.join(shipped)}", name
        )
    return read_layout(Path(name))


def read_layout(path: Path) -> Layout:
    """The layout of a file; InputError that names the marker where it cannot be."""
    top = toml_document(path, "a marker set in words")
    reader = Reader(path)
    rows = reader.mapping(top.get("markers"), "[markers]")
    if not rows:
        reader.fail("[markers] is empty; expected a line for each marker")
    found = [one for name, row in rows.items() for one in _sites(reader, name, row)]
    for marker, _ in found:
        reader.marker(marker)
    reader.unique([marker for marker, _ in found], "markers")
    name = reader.text(top, "name", "the layout")
    return Layout(name, reader.prose(top, "description"), reader.prose(top, "source"), dict(found))


def _sites(reader: Reader, name: str, row: object) -> list[tuple[str, Site]]:
    """The markers of a line: two where `*` stands for the sides."""
    where = f"marker {name!r}"
    row = reader.mapping(row, where)
    unknown = next((key for key in row if key not in SITE_KEYS), None)
    if unknown is not None:
        reader.fail(f"{where} has {unknown!r}; expected {', '.join(sorted(SITE_KEYS))} alone")
    segment, place = reader.text(row, "segment", where), reader.text(row, "at", where)
    along = reader.number(row, "along", where, 0, 1) if "along" in row else None
    off = reader.number(row, "off_mm", where, 0, MAX_OFF_MM) / 1000 if "off_mm" in row else 0.0
    if "*" not in name:
        side = next((side for side, word in SIDE_WORDS.items() if along is None and place.startswith(word)), "")
        return [(name, Site(segment, place.removeprefix(SIDE_WORDS.get(side, "")), along, side, off))]
    sided = segment not in ("pelvis", "thorax", "head")
    return [
        (name.replace("*", side), Site(f"{segment}.{side}" if sided else segment, place, along, side, off))
        for side in SIDE_WORDS
    ]
