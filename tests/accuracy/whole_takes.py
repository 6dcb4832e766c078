# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole takes cut to pieces, of motions and people that training left out.

Every take is one of those beside the project: markers are hidden in bursts, every gap ends a piece, ghosts are added,
and the pieces are shuffled. The cases of clouds have no pieces: frames in random order, and in each the points in
another, with some markers hidden.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from addon.core.data.progress import finished
from addon.core.data.takes import Points
from addon.core.points.models import Model
from addon.core.review.suspects import runs
from addon.core.training.pipeline import TrainingOptions, train
from addon.core.training.takes import LabelledTake
from addon.io.markersets import builtin_markersets, open_markerset
from addon.io.models import open_model

from .. import recorded
from ..core.scenes import anonymous as without_names
from .partial.clouds import Trouble, drawn, placed_differently, spoilt
from .people import BODY26, DATA, GAIT15, OTHERS, WALKERS, Take, files_of, kept, read, worn_as

BURST_FRAMES = 20  # that a marker is hidden
MIN_PIECE_FRAMES = 3
CMU = ("bd", "s135", "s02", "ball")
CLOUDS = 600  # frames of a take, at most, that are tried in random order

# Takes of other labs: each lab's own markers stand in for those of `gait15`, so that people, places of markers and
# motions are all strangers: thigh and shank markers of clusters, the middle between two hip markers for SACR ….
_LEG = ("ASI", "THI", "KNE", "TIB", "ANK", "HEE", "TOE")


def _names_in(sacrum: str, leg: str) -> dict[str, str]:
    """Of each marker of `gait15` the lab's markers whose middle stands in for it; those of a leg without R or L."""
    pairs = list(zip(_LEG, leg.split(","), strict=True))
    legs = {side + name: " ".join(side + one for one in own.split()) for side in "RL" for name, own in pairs}
    return {"SACR": sacrum, **legs}


PLUG_IN_GAIT = _names_in("RPSI LPSI", ",".join(_LEG))
ACTORS41 = _names_in("RBWT LBWT", "FWT,THI,KNE,SHN,ANK,HEE,TOE")
ACTORS53 = _names_in("RBWT LBWT", "FWT,HIP,KNE,SHN,ANK,HEL,TOE")
VICON12 = _names_in("RPSI LPSI", "ASI,THL,FCL,TBC,MALL,CAL,MT1 MT5")
OPENSIM = _names_in("RPSI LPSI", "ASI,TH3,LFC,TB2,LMAL,CAL,MT2")
WALKS = {
    "vicon12": ("rooms/vicon12/walking_1.c3d", VICON12),
    "opensim walking5": ("people/gaps/walking5.c3d", OPENSIM),
    "opensim test_walking": ("people/gaps/test_walking.c3d", OPENSIM),
}
THEIRS = {**dict.fromkeys(("ball", "bd", "s02", "s135"), ACTORS41), **dict.fromkeys(("p1", "p2"), ACTORS53)}
OTHER_MOTIONS = {name: (file, THEIRS.get(name, PLUG_IN_GAIT)) for name, file in OTHERS.items()}


@dataclass(frozen=True)
class Pieces:
    """How a take is cut: up to so many markers hidden at a time, and so many ghosts in all."""

    hidden: int = 5
    ghosts: int = 40


@dataclass(frozen=True, eq=False)
class Case:
    """What is learned from, the takes that are labelled, and the model's markers; `crowd` leaves all others in.

    Without takes of training the model is the built-in one of that name.
    """

    name: str
    training: tuple[Take, ...]
    tested: tuple[Take, ...]
    markers: tuple[str, ...]
    how: Pieces | Trouble = Pieces()
    built_in: str = ""


def anonymous(
    take: Take, markers: Sequence[str], how: Pieces | Trouble | None = Pieces(), seed: int = 0
) -> tuple[Points, np.ndarray]:
    """A take without names, as it is where nothing says how, and the marker's index of every point (T, P), or -1."""
    if how is None:
        index = [markers.index(name) for name in take.markers]
        return without_names(take.xyz, take.rate), np.where(np.isfinite(take.xyz[..., 0]), index, -1)
    if isinstance(how, Pieces):
        points, marker = cut_up(take, markers, how, seed)
        return points, np.where(points.present, marker, -1)
    rng = np.random.default_rng(seed)
    clouds = spoilt(drawn(take.xyz, min(len(take.xyz), CLOUDS), rng), how, rng)
    return without_names(clouds.points, take.rate), clouds.truth


def cut_up(take: Take, markers: Sequence[str], how: Pieces, seed: int = 0) -> tuple[Points, np.ndarray]:
    """Anonymous pieces of a take, and of each the marker's index, -1 for what is none of `markers`."""
    rng = np.random.default_rng(seed)
    xyz = take.xyz.copy()
    for first in range(0, len(xyz), BURST_FRAMES):
        gone = rng.choice(xyz.shape[1], rng.integers(0, how.hidden + 1), replace=False)
        xyz[first : first + BURST_FRAMES, gone] = np.nan
    tracks, truth = [], []
    for index, name in enumerate(take.markers):
        for first, after in runs(np.isfinite(xyz[:, index, 0])):
            if after - first >= MIN_PIECE_FRAMES:
                tracks.append(track(len(xyz), first, xyz[first:after, index]))
                truth.append(markers.index(name) if name in markers else -1)
    for _ in range(how.ghosts):
        first, length = rng.integers(0, max(len(xyz) - 60, 1)), int(rng.integers(20, 60))
        start, length = np.nanmean(xyz[first], axis=0) + rng.normal(0, 0.3, 3), min(length, len(xyz) - first)
        tracks.append(track(len(xyz), first, start + np.cumsum(rng.normal(0, 0.002, (length, 3)), axis=0)))
        truth.append(-1)
    order = rng.permutation(len(tracks))
    return without_names(np.stack(tracks, axis=1)[:, order], take.rate), np.array(truth)[order]


def track(frames: int, first: int, path: np.ndarray) -> np.ndarray:
    """A trajectory (frames, 3) m that has a path (F, 3) from a frame on, and nothing else."""
    found = np.full((frames, 3), np.nan)
    found[first : first + len(path)] = path
    return found


def actors(folder: str) -> dict[str, Take]:
    """The takes of `cmu41` or `actors53`, with the markers in one order."""
    paths = recorded.takes(DATA, *(one for one in recorded.ACTORS if f"/{folder}/" in one))
    first = read(paths[0], "").markers
    return {path.parent.name: read(path, path.parent.name, first) for path in paths}


def walks(persons: Sequence[str]) -> list[Take]:
    """Walks of McGill people, all physical markers that everybody wears."""
    return [read(files_of(person)[1], person, lab59()) for person in persons]


@cache
def lab59() -> tuple[str, ...]:
    """The physical markers that all walks show: Vicon writes a model's outputs in names that end otherwise."""
    taken = [read(files_of(person)[1], person) for person in WALKERS]
    seen = [{name for name in take.markers if np.isfinite(take.of([name]).xyz).any()} for take in taken]
    return tuple(sorted(PHYSICAL.intersection(*seen)))


PHYSICAL = frozenset(
    "LFHD RFHD LBHD RBHD C7 T2 T6 T10 T12 CLAV STRN RBAK LSHO RSHO LELB RELB LWRA LWRB RWRA RWRB LFIN RFIN LASI RASI "  # noqa: SIM905
    "SACR LTHI RTHI LKNE RKNE LKNM RKNM LTUB RTUB LHFB RHFB LTIB RTIB LSHN RSHN LANK RANK LMMA RMMA LHEE RHEE "
    "LSTL RSTL LLCA RLCA LCPG RCPG LP1M RP1M LD1M RD1M LP5M RP5M LD5M RD5M LTOE RTOE LHLX RHLX LNAV RNAV LPCA "
    "RPCA".split()
)


def case_own() -> Iterator[Case]:
    """One person's first part of a take learned, a later part labelled: the same person, another motion."""
    for name, after, last in (("bd", 800, 3800), ("s135", 800, 3800), ("s02", 500, 1854)):
        take = actors("cmu41")[name]
        yield Case(f"own {name}", (take.part(0, after),), (take.part(after, last),), take.markers)


def case_others() -> Iterator[Case]:
    """Everybody else of cmu41 learned, one person labelled: no person and no motion in training."""
    found = actors("cmu41")
    for name in CMU:
        rest = tuple(take for other, take in found.items() if other != name)
        yield Case(f"others {name}", rest, (found[name].part(0, 3000),), found[name].markers)


def case_frame() -> Iterator[Case]:
    """One labelled frame of a person learned, all of that person's take labelled."""
    for name, take in ((name, actors("cmu41")[name]) for name in CMU):
        yield Case(f"frame {name}", (take.part(0, 1),), (take.part(1, 3001),), take.markers)


def case_lab(count: int) -> Iterator[Case]:
    """The walks of so many people learned, six strangers' walks of the same lab labelled, 59 markers."""
    for first in (0, 4):
        own = [WALKERS[(first + step) % len(WALKERS)] for step in range(count)]
        tested = [WALKERS[(first + count + step) % len(WALKERS)] for step in range(6)]
        yield Case(f"lab-{count} {own[0]}", tuple(walks(own)), tuple(walks(tested)), lab59())


def case_few(name: str, markers: tuple[str, ...], crowd: bool) -> Iterator[Case]:
    """A built-in set learned from five people, the walks of the other five labelled; among all markers in a crowd."""
    for first in (0, 1):
        own, tested = WALKERS[first::2], WALKERS[1 - first :: 2]
        training = tuple(
            read(path, person).of(markers)
            for person in own
            for path in files_of(person)[1:]
            if set(markers) <= set(read(path, person).markers)
        )
        takes = tuple(take if crowd else take.of(markers) for take in walks(tested))
        yield Case(f"{'crowd' if crowd else 'pieces'} {name} {first}", training, takes, markers)


def in_gait15(name: str) -> Take:
    """A take of `WALKS` or `OTHER_MOTIONS` in the markers of `gait15`."""
    file, theirs = {**WALKS, **OTHER_MOTIONS}[name]
    return replace(worn_as(file, GAIT15, theirs), subject=name, name=name)


def case_clouds(name: str, files: Sequence[str], trouble: Trouble) -> Iterator[Case]:
    """The built-in `gait15`, and strangers of other labs in it, their frames in random order."""
    takes = tuple(_cloudy(in_gait15(file)) for file in files)
    yield Case(f"clouds {name}", (), takes, GAIT15, trouble, "gait15")


def case_clouds_elsewhere(trouble: Trouble) -> Iterator[Case]:
    """Five people's `gait15`, and the others' walks in a lab that puts two markers elsewhere, in random order."""
    for case in case_few("gait15", GAIT15, False):
        moved = (
            Take(one.subject, one.name, GAIT15, placed_differently(one.xyz, GAIT15), one.rate) for one in case.tested
        )
        name = case.name.replace("pieces gait15", "clouds elsewhere")
        yield Case(name, case.training, tuple(map(_cloudy, moved)), GAIT15, trouble)


def case_clouds_of_actors(trouble: Trouble) -> Iterator[Case]:
    """`gait15` of four actors' lab, who do not walk, and ten strangers' walks, their frames in random order."""
    training = tuple(in_gait15(file) for file in ("ball", "bd", "s02", "s135"))
    tested = tuple(_cloudy(take.of(GAIT15)) for take in walks(WALKERS))
    yield Case("clouds of actors", training, tested, GAIT15, trouble)


def _cloudy(take: Take) -> Take:
    """The frames that show all markers: as many are hidden as the case says."""
    whole = np.isfinite(take.xyz[..., 0]).all(axis=1)
    return replace(take, xyz=take.xyz[whole])


def cases_of_clouds() -> dict[str, Callable[[], Iterator[Case]]]:
    """Frames in random order by name."""
    found: dict[str, Callable[[], Iterator[Case]]] = {}
    for hidden in (0, 2, 4, 6):
        found[f"clouds-{hidden}"] = lambda h=hidden: case_clouds(f"walks, {h} hidden", tuple(WALKS), Trouble(h))
    for ghosts in (1, 3):
        title, trouble = f"walks, 4 hidden, ghosts: {ghosts}", Trouble(4, ghosts)
        found[f"clouds-ghosts-{ghosts}"] = lambda t=title, w=trouble: case_clouds(t, tuple(WALKS), w)
    noisy = Trouble(4, noise=0.005)
    found["clouds-noise-5mm"] = lambda: case_clouds("walks, 4 hidden, off by 5 mm", tuple(WALKS), noisy)
    for file in OTHER_MOTIONS:
        found[f"clouds-{file}"] = lambda f=file: case_clouds(f"{f}, 4 hidden", (f,), Trouble(4))
    found["clouds-elsewhere"] = lambda: case_clouds_elsewhere(Trouble(4))
    found["clouds-of-actors"] = lambda: case_clouds_of_actors(Trouble(4))
    return found


CASES: dict[str, Callable[[], Iterator[Case]]] = {
    "own": case_own,
    "others": case_others,
    "frame": case_frame,
    "lab-1": lambda: case_lab(1),
    "lab-3": lambda: case_lab(3),
    "crowd": lambda: case_few("body26", BODY26, True),
    "pieces-gait15": lambda: case_few("gait15", GAIT15, False),
    "pieces-body26": lambda: case_few("body26", BODY26, False),
    **cases_of_clouds(),
}


def in_parts(case: Case, frames: int) -> Case:
    """The case with every part of its takes that is so long as a take of its own; what is left over is left out.

    A shorter take stays one.
    """
    parts = [
        take.part(first, first + frames)
        for take in case.tested
        for first in range(0, max(len(take.xyz) - frames + 1, 1), frames)
    ]
    return replace(case, name=f"{case.name}, {frames} frames", tested=tuple(parts))


def model_of(case: Case, keep: Path) -> Model:
    """The model that the case's takes teach; read again where it was kept."""
    if case.built_in:
        return open_model(case.built_in)
    takes = [LabelledTake(take.name, take.subject, take.markers, take.xyz) for take in case.training]
    file = keep / f"{case.name.replace(' ', '-')}.markerset.json"
    return kept(file, lambda: learned(case.name, takes, case.markers))


def learned(name: str, takes: list[LabelledTake], markers: tuple[str, ...]) -> Model:
    """The model that labelled takes teach, with the default options but for partial solvers."""
    bodies = [open_markerset(one) for one in builtin_markersets()]
    return finished(train(takes, markers, TrainingOptions(name, search="none"), None, bodies)).model
