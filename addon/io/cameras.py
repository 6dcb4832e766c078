# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera calibrations of every format that is read, and the one that is written."""

from collections.abc import Callable
from pathlib import Path

from ..core.data.errors import InputError
from ..core.geometry.cameras import Cameras
from . import opencv, selfcal
from .motive_cameras import read_mcal
from .opencv import read_yml
from .qualisys import read_qca
from .selfcal import read_selfcal
from .source import read_xml
from .toml_cameras import read_toml, write_toml
from .vicon import read_xcp
from .world import z_up

EXPECTED = (
    "expected a camera calibration: .toml, Vicon .xcp, Qualisys .qca.txt or .xml, Motive .mcal, OpenCV .yml, "
    "or a folder of *.Pmat.cal and .rad"
)

SELFCAL, YML = (".pmat.cal", ".rad"), (".yml", ".yaml")
_BY_ROOT = {"cameras": read_xcp, "calibration": read_qca, "calibrationprofile": read_mcal}


def read_cameras(path: Path, read_blend: Callable[[Path], Cameras] | None = None, up: str | None = None) -> Cameras:
    """The cameras of a calibration, known by its suffix and content, in metres with z up.

    `read_blend` reads the cameras of a `.blend` scene where Blender is at hand. `up` is the axis of the file's world
    that points up, one of x y z -x -y -z; without it the file says, or the cameras tell, and `remarks` say which.
    Raises InputError for whatever cannot be used, naming the file and, where known, the line.
    """
    path = Path(path)
    up, suffix = up or "", path.suffix.lower()
    if path.is_dir() or path.name.lower().endswith(SELFCAL):
        return read_selfcal(path, up)
    if suffix == ".blend":
        if read_blend is None:
            raise InputError("is a Blender scene, which only Blender can open; expected a calibration file", path)
        return z_up(read_blend(path), up or "z")
    readers = {".toml": read_toml, ".xcp": read_xcp, ".mcal": read_mcal, **dict.fromkeys(YML, read_yml)}
    if suffix in readers:
        return readers[suffix](path, up)
    if suffix in (".xml", ".txt", ".qca"):
        return _read_by_root(path, up)
    if not path.exists():
        raise InputError("there is no such file; expected the path of a camera calibration", path)
    raise InputError(f"is of a kind that is not known ({suffix or 'no suffix'}); {EXPECTED}", path)


def calibration_files(path: Path) -> list[Path]:
    """All files that a calibration is read from; InputError where one of a pair is missing."""
    path = Path(path)
    if path.is_dir() or path.name.lower().endswith(SELFCAL):
        return selfcal.files_of(path)
    return opencv.files_of(path) if path.suffix.lower() in YML else [path]


def _read_by_root(path: Path, up: str) -> Cameras:
    root = read_xml(path, "a camera calibration").tag
    reader = _BY_ROOT.get(root.lower())
    if reader is None:
        raise InputError(f"has <{root[:40]}> at its root; {EXPECTED}", path)
    return reader(path, up)


def write_cameras(path: Path, cameras: Cameras):
    """Writes the contract's `.toml`; every number comes back exactly."""
    write_toml(path, cameras)
