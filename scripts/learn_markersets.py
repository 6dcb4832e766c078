# SPDX-License-Identifier: GPL-3.0-or-later
"""Learns the built-in marker sets from recorded people: python scripts/learn_markersets.py --data PEOPLE --out assets.

PEOPLE holds `mcgill/ID/*.c3d` (the first file of each person is a standing take) and `tennis/*.c3d`.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from addon.core.body import anatomy
from addon.core.data.markersets import MarkerSet
from addon.core.points.likelihood import learn_likelihood
from addon.core.points.models import Model
from addon.core.training import learning
from addon.io.markersets import SUFFIX
from addon.io.models import write_model

STANDING_FRAMES, MOVING_FRAMES = 12, 14
EVERY = 2  # frames of a take for each that the likelihood of points is learned from
# One player: the second one in the take of two has the first one's body to the millimetre.
TENNIS, PLAYER = "kinematics_tennis_serve.c3d", "Derrick"
HEAD_TURNED = {"LFHD": "LBHD", "LBHD": "LFHD", "RFHD": "RBHD", "RBHD": "RFHD"}
HEAD_MIRRORED = {"LFHD": "RFHD", "RFHD": "LFHD", "LBHD": "RBHD", "RBHD": "LBHD"}
LEFT_WRIST, RIGHT_WRIST = {"LWRA": "LWRB", "LWRB": "LWRA"}, {"RWRA": "RWRB", "RWRB": "RWRA"}
# Labels that contradict the same person's other takes, or everybody else's: what each name in the file really is.
MISLABELLED = {
    "HC030A01": LEFT_WRIST,
    "HC030A05": LEFT_WRIST,
    "HC030A22": LEFT_WRIST,
    "HC038A11": LEFT_WRIST | RIGHT_WRIST,
    "HC039A17": HEAD_TURNED,
    "HC055A34": HEAD_MIRRORED,
}
SOURCE = {
    "learned": "2026-11-21 by scripts/learn_markersets.py",
    "walkers": "HC…: mcgillmotionlab/biomechzoo at 7daadbc, MIT licence; each standing, walking straight and turning",
    "player": "Derrick: kineticstoolkit at 169a99d, Apache-2.0 licence; a tennis serve",
}


def read_people(data: Path, leave_out=()) -> list[learning.Person]:
    """Everybody in `data` but those left out, a few dozen frames each."""
    people = [read_walker(folder) for folder in sorted((data / "mcgill").glob("HC*")) if folder.name not in leave_out]
    return people + [player for player in read_players(data / "tennis" / TENNIS) if player.name not in leave_out]


def read_walker(folder: Path) -> learning.Person:
    """One of the mcgill people: standing, walking straight and turning."""
    wanted = _wanted()
    parts, standing, stature = [], [], None
    for index, file in enumerate(sorted(folder.glob("*.c3d"))):
        names, points, stated = read_c3d(file)
        stature = stature or stated
        frames = _thinned(points, names, STANDING_FRAMES if index == 0 else MOVING_FRAMES)
        whole = np.full((len(frames), len(wanted), 3), np.nan)
        for place, name in enumerate(wanted):
            if name in names:
                whole[:, place] = points[frames, names.index(name)]
        parts.append(whole)
        standing += [index == 0] * len(frames)
    return learning.Person(folder.name, tuple(wanted), np.concatenate(parts), np.array(standing), stature)


def read_takes(data: Path, markers, leave_out=()) -> list[tuple[np.ndarray, str]]:
    """Every walker's takes whole: points (T, M, 3) m of `markers`, NaN where a take has none, and who it is.

    And the player's, where he wears all of them.
    """
    takes = []
    for folder in sorted((data / "mcgill").glob("HC*")):
        for file in sorted(folder.glob("*.c3d")) if folder.name not in leave_out else ():
            names, points, _ = read_c3d(file)
            worn = [names.index(name) if name in names else -1 for name in markers]
            picked = np.where(np.array(worn)[None, :, None] >= 0, points[:, worn], np.nan)
            takes.append((picked[np.isfinite(picked).any(axis=(1, 2))][::EVERY], folder.name))
    names, points, _ = read_c3d(data / "tennis" / TENNIS, prefixes=True)
    worn = [f"{PLAYER}:{name}" for name in markers]
    if PLAYER not in leave_out and set(worn) <= set(names):
        takes.append((points[::EVERY, [names.index(name) for name in worn]], PLAYER))
    return takes


def read_players(file: Path) -> list[learning.Person]:
    """The tennis players, each with a prefix of their own, who serve and do not stand still."""
    names, points, _ = read_c3d(file, prefixes=True)
    people = []
    for prefix in sorted({name.split(":")[0] for name in names if ":" in name}):
        own = [index for index, name in enumerate(names) if name.startswith(prefix + ":")]
        bare = [names[index].split(":")[1] for index in own]
        frames = _thinned(points[:, own], bare, STANDING_FRAMES + 2 * MOVING_FRAMES)
        chosen = points[np.ix_(frames, own)]
        people.append(learning.Person(prefix, tuple(bare), chosen, np.zeros(len(frames), dtype=bool)))
    return people


def read_c3d(file: Path, prefixes: bool = False) -> tuple[list[str], np.ndarray, float | None]:
    """Names, points (T, P, 3) m and the subject's stature, m, if the file states it."""
    import ezc3d

    take = ezc3d.c3d(str(file))
    group = take["parameters"]["POINT"]
    names = [name for key in ("LABELS", "LABELS2", "LABELS3") if key in group for name in group[key]["value"]]
    if not prefixes:
        names = [true_name(file.stem, name.split(":")[-1]) for name in names]
    unit = {"mm": 0.001, "cm": 0.01}.get("".join(group["UNITS"]["value"]), 1.0)
    points = take["data"]["points"][:3].transpose(2, 1, 0)
    points = np.where((points == 0).all(axis=2, keepdims=True), np.nan, points) * unit
    stated = take["parameters"].get("PROCESSING", {}).get("Height", {}).get("value", [0])[0]
    return names[: points.shape[1]], points, float(stated) / 1000 or None


def true_name(take: str, label: str) -> str:
    """The marker that a take (its file's name without the suffix) labels so."""
    return MISLABELLED.get(take, {}).get(label, label)


def _wanted() -> list[str]:
    landmarks = [name for site in anatomy.WHOLE_SEGMENTS for name in site.landmarks]
    return [site.name for site in anatomy.MARKERS] + landmarks


def _thinned(points: np.ndarray, names: list[str], count: int) -> np.ndarray:
    """Frames spread over the take in which the feet and the pelvis are seen."""
    core = [names.index(name) for name in ("LASI", "RASI", "LTOE", "RTOE", "LHEE", "RHEE")]
    good = np.flatnonzero(np.isfinite(points[:, core]).all(axis=(1, 2)))
    return good[np.unique(np.linspace(0, len(good) - 1, count).round().astype(int))]


def main(arguments: list[str] | None = None):
    """Learns and writes the marker sets that were asked for."""
    parser = argparse.ArgumentParser(description="Learns the built-in marker sets from recorded people.")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data" / "people")
    parser.add_argument("--out", type=Path, default=ROOT / "assets")
    parser.add_argument("--leave-out", nargs="*", default=[], metavar="ID")
    parser.add_argument("--sets", nargs="*", default=list(anatomy.SETS), choices=list(anatomy.SETS))
    given = parser.parse_args(arguments)
    people = read_people(given.data, given.leave_out)
    given.out.mkdir(parents=True, exist_ok=True)
    for name in given.sets:
        began = time.perf_counter()
        markerset = learn_set(people, name)
        likelihood = learn_likelihood(read_takes(given.data, markerset.markers, given.leave_out), markerset.markers)
        write_model(given.out / f"{name}{SUFFIX}", Model(markerset, likelihood))
        print(f"{name}: {len(markerset)} markers, {time.perf_counter() - began:.1f} s")


def learn_set(people: list[learning.Person], name: str) -> MarkerSet:
    """A built-in marker set from these people, with a note of where its numbers come from."""
    markerset = learning.learn(people, name)
    return replace(markerset, source={**markerset.source, **SOURCE})


if __name__ == "__main__":
    main()
