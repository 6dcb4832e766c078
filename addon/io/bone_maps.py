# SPDX-License-Identifier: GPL-3.0-or-later
"""Which bones of a rig follow which of another: Auto-Rig Pro's `.bmap` and KeeMap's JSON."""

from pathlib import Path

from ..core.data.errors import InputError
from .source import read_json, read_text

NO_BONE = ("None", "")  # what a .bmap has where a bone of the source moves none


def read_bone_map(path: Path) -> dict[str, str]:
    """The bone of the rig that each bone of the source moves, by the source's; InputError where there is none."""
    if Path(path).suffix.lower() == ".json":
        document = read_json(path, "a bone map")
        rows = document.get("bones") if isinstance(document, dict) else None
        rows = [row for row in rows if isinstance(row, dict)] if isinstance(rows, list) else []
        pairs = [(row.get("SourceBoneName"), row.get("DestinationBoneName")) for row in rows]
    else:
        # A bone is the rig's name with settings behind %, the source's name, two switches and an empty line.
        blocks = read_text(path, "a bone map").replace("\r\n", "\n").split("\n\n")
        lines = [block.strip("\n").split("\n") for block in blocks]
        pairs = [(line[1].strip(), line[0].partition("%")[0].strip()) for line in lines if len(line) > 1]
    found = {source: own for source, own in pairs if isinstance(source, str) and isinstance(own, str)}
    found = {source: own for source, own in found.items() if source not in NO_BONE and own not in NO_BONE}
    if not found:
        raise InputError("maps no bones; expected a .bmap of Auto-Rig Pro or a .json of KeeMap", path)
    return found
