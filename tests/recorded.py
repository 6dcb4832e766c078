# SPDX-License-Identifier: GPL-3.0-or-later
"""The folders of recorded takes that tests go through, by name: what is put beside them changes no test."""

from pathlib import Path

from scripts.learn_markersets import WALKERS

MCGILL = tuple(f"people/mcgill/{name}" for name in WALKERS)
ACTORS = (
    *(f"people/cmu41/{name}" for name in ("ball", "bd", "s02", "s135")),
    "people/actors53/p1",
    "people/actors53/p2",
)
PLATES, TENNIS, GAPS = "people/clouthier", "people/tennis", "people/gaps"
IN_ROOMS = ("rooms/vicon12", "blobs/qualisys_run")


def takes(data: Path, *folders: str, kinds: tuple[str, ...] = (".c3d", ".trc")) -> list[Path]:
    """The files of takes in these folders of the recorded data; LookupError where a folder has none."""
    found = [sorted(path for path in (data / folder).iterdir() if path.suffix.lower() in kinds) for folder in folders]
    if not all(found):
        raise LookupError(f"no takes in {folders[found.index([])]}")
    return [path for paths in found for path in paths]
