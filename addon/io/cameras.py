# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera calibrations of every format."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from ..core.data.errors import InputError
from ..core.geometry.cameras import Cameras
from .source import root_of_xml
from .world import z_up

EXPECTED = (
    "expected a camera calibration: .toml, Vicon .xcp, Qualisys .qca.txt, .xml or .qtm, Motive .mcal, OpenCV "
    ".yml, or a folder of *.Pmat.cal and .rad"
)

SELFCAL, YML = (".pmat.cal", ".rad"), (".yml", ".yaml")
# The module and function of each kind, by suffix and by the root of its XML: one of them is loaded, when it is read.
_XCP, _MCAL = ("xml_cameras", "read_xcp"), ("xml_cameras", "read_mcal")
_BY_SUFFIX = {".toml": ("toml_cameras", "read_toml"), ".qtm": ("qtm.capture", "read_qtm_cameras")}
_BY_SUFFIX |= {".xcp": _XCP, ".mcal": _MCAL, **dict.fromkeys(YML, ("opencv", "read_yml"))}
_BY_ROOT = {"cameras": _XCP, "calibration": ("xml_cameras", "read_qca"), "calibrationprofile": _MCAL}


def read_cameras(path: Path, read_blend: Callable[[Path], Cameras] | None = None, up: str | None = None) -> Cameras:
    """The cameras of a calibration, known by its suffix and content, in metres with z up.

    `read_blend` reads the cameras of a `.blend` scene where Blender is at hand. `up` is the axis of the file's world
    that points up, one of x y z -x -y -z; without it the file says, or the cameras tell, and `remarks` say which.
    Raises InputError for whatever cannot be used, naming the file and, where known, the line.
    """
    path = Path(path)
    up, suffix = up or "", path.suffix.lower()
    if path.is_dir() or path.name.lower().endswith(SELFCAL):
        return _reader("selfcal", "read_selfcal")(path, up)
    if suffix == ".blend":
        if read_blend is None:
            raise InputError("is a Blender scene, which only Blender can open; expected a calibration file", path)
        return z_up(read_blend(path), up or "z")
    if suffix in _BY_SUFFIX:
        return _reader(*_BY_SUFFIX[suffix])(path, up)
    if suffix in (".xml", ".txt", ".qca"):
        return _read_by_root(path, up)
    if not path.exists():
        raise InputError("there is no such file; expected the path of a camera calibration", path)
    raise InputError(f"is of a kind that is not known ({suffix or 'no suffix'}); {EXPECTED}", path)


def calibration_files(path: Path) -> list[Path]:
    """All files that a calibration is read from; InputError where one of a pair is missing."""
    path = Path(path)
    if path.is_dir() or path.name.lower().endswith(SELFCAL):
        from .selfcal import files_of

        return files_of(path)
    if path.suffix.lower() in YML:
        from .opencv import files_of

        return files_of(path)
    return [path]


def _read_by_root(path: Path, up: str) -> Cameras:
    root = root_of_xml(path, "a camera calibration")
    kind = _BY_ROOT.get(root.lower())
    if kind is None:
        raise InputError(f"has <{root[:40]}> at its root; {EXPECTED}", path)
    return _reader(*kind)(path, up)


def _reader(module: str, name: str) -> Callable[[Path, str], Cameras]:
    return getattr(import_module(f".{module}", __package__), name)


def write_cameras(path: Path, cameras: Cameras):
    """Writes the contract's `.toml`; every number comes back exactly."""
    from .toml_cameras import write_toml

    write_toml(path, cameras)
