# SPDX-License-Identifier: GPL-3.0-or-later
"""The beginning of the demo's take as files, for window tests and screenshots."""

from dataclasses import replace
from pathlib import Path

from addon import capturing
from addon.demo.take import MODEL, TROUBLE, make_performance
from addon.io.cameras import write_cameras
from addon.io.markersets import open_markerset


def write_virtual_take(folder: Path, frames: int) -> None:
    """Write take.csv, its truth take.csv.truth.csv and cameras.toml to `folder`: the demo's first `frames` frames."""
    made, first = make_performance(open_markerset(MODEL)), slice(0, frames)
    body = replace(made.body, **{name: getattr(made.body, name)[first] for name in ("rotations", "joints", "scale")})
    take = replace(made.take, xyz=made.take.xyz[first])
    for _ in capturing.write_capture(take, made.cameras, TROUBLE, body, folder / "take.csv"):
        pass
    write_cameras(folder / "cameras.toml", made.cameras)
