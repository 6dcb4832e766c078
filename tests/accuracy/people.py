# SPDX-License-Identifier: GPL-3.0-or-later
"""The recorded people beside the project: their takes as marker arrays, who is left out of whose training, and how."""

import hashlib
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from addon.core.blobs.pipeline import label_take
from addon.core.data.markersets import MarkerSet
from addon.core.data.takes import Blobs
from addon.core.geometry.cameras import Cameras
from addon.core.points.models import Model
from addon.io.markersets import read_markerset
from addon.io.models import write_model
from scripts import learn_markersets
from scripts.learn_markersets import MISLABELLED, WALKERS, true_places

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
PEOPLE = DATA / "people"
MCGILL = PEOPLE / "mcgill"
# Each person's three files in the order of their numbers.
KINDS = ("standing", "walk", "turn")
GAIT15 = tuple("SACR RASI LASI RTHI LTHI RKNE LKNE RTIB LTIB RANK LANK RHEE LHEE RTOE LTOE".split())  # noqa: SIM905
BODY26 = tuple(
    "LFHD RFHD LBHD RBHD C7 LSHO RSHO LELB RELB LWRA LWRB RWRA RWRB LFIN RFIN "  # noqa: SIM905
    "LASI RASI SACR LKNE RKNE LANK RANK LHEE RHEE LTOE RTOE".split()
)
# One take each of others: of people whose markers and motions are not McGill's.
OTHERS = {
    "serve": "people/tennis/kinematics_tennis_serve.c3d",
    "ball": "people/cmu41/ball/basketball.c3d",
    "bd": "people/cmu41/bd/HDM_bd_05-01_01_120.c3d",
    "s02": "people/cmu41/s02/02_05.c3d",
    "s135": "people/cmu41/s135/135_02.c3d",
    "p1": "people/actors53/p1/freeform.c3d",
    "p2": "people/actors53/p2/squat.c3d",
}


@dataclass(frozen=True, eq=False)
class Take:
    """Labelled points (T, M, 3) m of one subject, NaN where missing."""

    subject: str
    name: str
    markers: tuple[str, ...]
    xyz: np.ndarray
    rate: float

    def part(self, first: int, after: int) -> "Take":
        """Some of its frames."""
        return replace(self, name=f"{self.name} {first}:{after}", xyz=self.xyz[first:after])

    def of(self, markers: Sequence[str]) -> "Take":
        """Some of its markers, in this order."""
        place = [self.markers.index(name) for name in markers]
        return replace(self, markers=tuple(markers), xyz=self.xyz[:, place])

    def pick(self, names: Sequence[str]) -> np.ndarray:
        """(T, M, 3) m of the markers `names`; NaN for one that the take does not have."""
        picked = np.full((len(self.xyz), len(names), 3), np.nan)
        for index, name in enumerate(names):
            if name in self.markers:
                picked[:, index] = self.xyz[:, self.markers.index(name)]
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


def need_people():
    """Ends a command where the recorded people are not on this machine."""
    if not MCGILL.is_dir():
        sys.exit("the recorded people are not here; expected them in ../shared/data/people")


def everyone() -> tuple[str, ...]:
    """The ids of all recorded people."""
    return WALKERS


def files_of(person: str) -> list[Path]:
    """One person's files, in the order of `KINDS`."""
    return sorted((MCGILL / person).glob("*.c3d"))


def takes(people=None, *kinds: str) -> list[Take]:
    """What was recorded of `people` (all when None), of some kinds or of all, in the markers of our sets."""
    found = zip(people or everyone(), map(files_of, people or everyone()), strict=True)
    parts = [(person, *pair) for person, files in found for pair in zip(KINDS, files, strict=True)]
    return [_known_markers(path, person, kind) for person, kind, path in parts if not kinds or kind in kinds]


def folds(count: int = 5) -> list[tuple[str, ...]]:
    """All people once, in `count` groups that are left out of training together."""
    people = everyone()
    return [people[index::count] for index in range(count)]


@cache
def _known_markers(path: Path, person: str, kind: str) -> Take:
    take = replace(read(path, person), name=f"{path.stem}, {kind}")
    return take.of([name for name in take.markers if name in {*GAIT15, *BODY26}])


def read(path: Path, subject: str, markers: Sequence[str] | None = None) -> Take:
    """A take of a file, markers as they were worn: the labels of some contradict the same person's other takes."""
    names, xyz, rate = read_c3d(path)
    names = tuple(MISLABELLED.get(path.stem, {}).get(name, name) for name in names)
    kept = [index for index, name in enumerate(names) if not name.startswith("*")]
    xyz = true_places(path.stem, names, xyz)
    take = Take(subject, path.name, tuple(names[index] for index in kept), xyz[:, kept], rate)
    return take if markers is None else take.of(markers)


def worn_as(file: str, markers: Sequence[str], theirs: Mapping[str, str]) -> Take:
    """A take of another lab in our markers, z up: the middle of those of its own that `theirs` says stands for one."""
    names, xyz, rate = read_c3d(DATA / file)
    if "/actors53/" in file:
        xyz = xyz[..., [0, 2, 1]] * [1.0, -1.0, 1.0]
    xyz = true_places(Path(file).stem, names, xyz)
    own = [[names.index(one) for one in theirs.get(marker, marker).split()] for marker in markers]
    xyz = np.stack([xyz[:, some].mean(axis=1) for some in own], axis=1)
    return Take(Path(file).parent.name, Path(file).name, tuple(markers), xyz, rate)


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


CACHE = Path(tempfile.gettempdir()) / "mocap-autolabel-accuracy"
LEARNED_BY = (
    "scripts/anatomy.py",
    "scripts/people_study.py",
    "addon/core/posing/posing.py",
    "scripts/learn_markersets.py",
)


def left_out_model(set_name: str, left_out: tuple[str, ...]) -> MarkerSet:
    """The built-in marker set learned without the people `left_out`; kept for the next run."""
    path = CACHE / f"{set_name}-without-{'-'.join(left_out)}-{_learning_version()}.json"
    if not path.exists():
        learned = learn_markersets.learn_set(learn_markersets.read_people(DATA / "people", left_out), set_name)
        CACHE.mkdir(parents=True, exist_ok=True)
        write_model(path, Model(learned))
    return read_markerset(path)


@cache
def _learning_version() -> str:
    root = Path(__file__).resolve().parents[2]
    return hashlib.sha256(b"".join((root / name).read_bytes() for name in LEARNED_BY)).hexdigest()[:10]


def labelled(markerset: MarkerSet, trial: Trial) -> np.ndarray:
    """(N,) the names that the product gives to a capture's blobs without any hint, "" for none."""
    (chunk,) = label_take([trial.blobs], trial.cameras, markerset, trial.rate)
    return np.array([*markerset.markers, ""], object)[chunk.labels.marker]
