# SPDX-License-Identifier: GPL-3.0-or-later
"""The recorded people beside the project: their takes as marker arrays, and who is left out of whose training."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from addon.core.data.takes import Blobs
from addon.core.geometry.cameras import Cameras
from scripts.learn_markersets import MISLABELLED, WALKERS

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
MCGILL = DATA / "people" / "mcgill"
# Each person's three files in the order of their numbers.
KINDS = ("standing", "walk", "turn")
GAIT15 = tuple("SACR RASI LASI RTHI LTHI RKNE LKNE RTIB LTIB RANK LANK RHEE LHEE RTOE LTOE".split())  # noqa: SIM905
BODY26 = tuple(
    "LFHD RFHD LBHD RBHD C7 LSHO RSHO LELB RELB LWRA LWRB RWRA RWRB LFIN RFIN "  # noqa: SIM905
    "LASI RASI SACR LKNE RKNE LANK RANK LHEE RHEE LTOE RTOE".split()
)
# Tested as the markers were worn: these takes' labels contradict the same person's other takes, or everybody else's.
EXCHANGED = dict(MISLABELLED)


@dataclass(frozen=True, eq=False)
class Recording:
    """One take of one person: labelled markers (T, P, 3) m, NaN where missing."""

    person: str
    kind: str
    path: Path
    names: tuple[str, ...]
    xyz: np.ndarray
    rate: float

    def pick(self, names) -> np.ndarray:
        """(T, M, 3) m of the markers `names`; NaN for one that the take does not have."""
        picked = np.full((len(self.xyz), len(names), 3), np.nan)
        for index, name in enumerate(names):
            if name in self.names:
                picked[:, index] = self.xyz[:, self.names.index(name)]
        return picked


@dataclass(frozen=True, eq=False)
class Trial:
    """One take to be labelled: blobs with their true names, and what the labelling is not told.

    title    says which capture it is, for people to read
    xyz      (T, M, 3) m where the markers were
    """

    title: str
    cameras: Cameras
    blobs: Blobs
    truth: np.ndarray
    xyz: np.ndarray
    rate: float


def available() -> bool:
    """Whether the recorded people are on this machine."""
    return MCGILL.is_dir()


def everyone() -> tuple[str, ...]:
    """The ids of all recorded people."""
    return WALKERS


def takes(people=None, kind: str | None = None) -> list[Recording]:
    """The recordings of `people` (all when None), of one kind or of all."""
    found = []
    for person in people or everyone():
        for name, path in zip(KINDS, sorted((MCGILL / person).glob("*.c3d")), strict=True):
            if kind in (None, name):
                found.append(_read(path, person, name))
    return found


def folds(count: int = 5) -> list[tuple[str, ...]]:
    """All people once, in `count` groups that are left out of training together."""
    people = everyone()
    return [people[index::count] for index in range(count)]


@cache
def _read(path: Path, person: str, kind: str) -> Recording:
    names, xyz, rate = _read_known(path)
    renamed = EXCHANGED.get(path.stem, {})
    return Recording(person, kind, path, tuple(renamed.get(name, name) for name in names), xyz, rate)


def _read_known(path: Path) -> tuple[tuple[str, ...], np.ndarray, float]:
    """Of a take, the markers that any of our marker sets has."""
    names, xyz, rate = read_c3d(path)
    known = [index for index, name in enumerate(names) if name in {*GAIT15, *BODY26}]
    return tuple(names[index] for index in known), xyz[:, known], rate


def read_c3d(path: Path) -> tuple[tuple[str, ...], np.ndarray, float]:
    """Names, points (T, P, 3) m and rate of a C3D file; by another reader than the project's, on purpose."""
    import ezc3d

    file = ezc3d.c3d(str(path))
    points = file["parameters"]["POINT"]
    names = tuple(label.split(":")[-1] for label in points["LABELS"]["value"])
    xyz = file["data"]["points"][:3].transpose(2, 1, 0)
    unit = {"mm": 0.001, "m": 1.0}[points["UNITS"]["value"][0]]
    missing = np.isnan(xyz).any(axis=-1) | (xyz == 0).all(axis=-1) | (file["data"]["meta_points"]["residuals"][0].T < 0)
    return names, np.where(missing[..., None], np.nan, xyz * unit), float(points["RATE"]["value"][0])
