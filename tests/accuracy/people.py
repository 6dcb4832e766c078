# SPDX-License-Identifier: GPL-3.0-or-later
"""The recorded people beside the project: their takes as marker arrays, who is left out of whose training, and how."""

import hashlib
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from addon.core.data.markersets import MarkerSet
from addon.core.data.takes import Blobs
from addon.core.geometry.cameras import Cameras
from addon.core.points.models import Model
from addon.io.models import open_model, write_model
from addon.io.points import read_points
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
    """One take to be labelled: which capture it is, for people to read, and blobs with their true names."""

    title: str
    cameras: Cameras
    blobs: Blobs
    truth: np.ndarray
    rate: float


def need_people():
    """Ends a command where the recorded people are not on this machine."""
    if not MCGILL.is_dir():
        sys.exit("the recorded people are not here; expected them in ../shared/data/people")


def files_of(person: str) -> list[Path]:
    """One person's files, in the order of `KINDS`."""
    return sorted((MCGILL / person).glob("*.c3d"))


def takes(people=None, *kinds: str) -> list[Take]:
    """What was recorded of `people` (all when None), of some kinds or of all, in the markers of our sets."""
    parts = [(one, *pair) for one in people or WALKERS for pair in zip(KINDS, files_of(one), strict=True)]
    return [_known_markers(path, person, kind) for person, kind, path in parts if not kinds or kind in kinds]


def folds(count: int = 5) -> list[tuple[str, ...]]:
    """All people once, in `count` groups that are left out of training together."""
    return [WALKERS[index::count] for index in range(count)]


@cache
def _known_markers(path: Path, person: str, kind: str) -> Take:
    take = replace(read(path, person), name=f"{path.stem}, {kind}")
    return take.of([name for name in take.markers if name in {*GAIT15, *BODY26}])


def read(path: Path, subject: str, markers: Sequence[str] | None = None) -> Take:
    """A take of a file, z up, markers as they were worn: the labels of some contradict the same person's other takes.

    Files of `actors53` have y up and do not say so: that is found as for everybody who opens them.
    """
    take = read_points(path, everything=True)
    bare = (name.rpartition(":")[2] for name in take.names)
    names = tuple(MISLABELLED.get(path.stem, {}).get(name, name) for name in bare)
    kept = [index for index, name in enumerate(names) if not name.startswith("*")]
    xyz = true_places(path.stem, names, take.xyz[:])[:, kept]
    whole = Take(subject, path.name, tuple(names[index] for index in kept), xyz, take.rate)
    return whole if markers is None else whole.of(markers)


def worn_as(file: str, markers: Sequence[str], theirs: Mapping[str, str]) -> Take:
    """A take of another lab in our markers, z up: the middle of those of its own that `theirs` says stands for one."""
    take = read(DATA / file, Path(file).parent.name)
    middles = [take.of(theirs.get(marker, marker).split()).xyz.mean(axis=1) for marker in markers]
    return replace(take, markers=tuple(markers), xyz=np.stack(middles, axis=1))


CACHE = Path(tempfile.gettempdir()) / "mocap-autolabel-accuracy"
LEARNED_BY = (
    "scripts/anatomy.py",
    "scripts/people_study.py",
    "addon/core/posing/posing.py",
    "scripts/learn_markersets.py",
)


def left_out_model(set_name: str, left_out: tuple[str, ...]) -> MarkerSet:
    """The built-in marker set learned without the people `left_out`; kept for the next run."""
    version = digest_of([Path(__file__).resolve().parents[2] / name for name in LEARNED_BY])[:10]

    def learn() -> Model:
        return Model(learn_markersets.learn_set(learn_markersets.read_people(PEOPLE, left_out), set_name))

    return kept(CACHE / f"{set_name}-without-{'-'.join(left_out)}-{version}.json", learn).markerset


def kept(file: Path, make: Callable[[], Model]) -> Model:
    """A model that is made once."""
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        write_model(file, make())
    return open_model(str(file))


def digest_of(files: Iterable[Path]) -> str:
    """A digest of what files hold."""
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
