# SPDX-License-Identifier: GPL-3.0-or-later
"""Learns the built-in marker sets from recorded people: python scripts/learn_markersets.py --data PEOPLE --out assets.

PEOPLE holds `mcgill/ID/*.c3d` (the first file of each person is a standing take), `tennis/*.c3d`, and for the sets of
actors `cmu41/ID/*.c3d` and `actors53/ID/*.c3d`.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from addon.core.data.markersets import MarkerSet
from addon.core.points.likelihood.learn import learn_likelihood
from addon.core.points.models import Model
from addon.core.training.poses import poses_of
from addon.core.training.transfer import transferred
from addon.io.markersets import SUFFIX, read_markerset
from addon.io.models import write_model
from addon.io.points import read_points
from scripts import anatomy, people_study

STANDING_FRAMES, MOVING_FRAMES = 12, 14
EVERY = 2  # frames of a take for each that the likelihood of points is learned from
# One player: the second one in the take of two has the first one's body to the millimetre.
TENNIS, PLAYER = "kinematics_tennis_serve.c3d", "Derrick"
WALKERS = (
    "HC002D", "HC030A", "HC031A", "HC032A", "HC033A", "HC036A", "HC038A", "HC039A", "HC044A", "HC055A",
)  # fmt: skip
HEAD_TURNED = {"LFHD": "LBHD", "LBHD": "LFHD", "RFHD": "RBHD", "RBHD": "RFHD"}
HEAD_MIRRORED = {"LFHD": "RFHD", "RFHD": "LFHD", "LBHD": "RBHD", "RBHD": "LBHD"}
LEFT_WRIST, RIGHT_WRIST = {"LWRA": "LWRB", "LWRB": "LWRA"}, {"RWRA": "RWRB", "RWRB": "RWRA"}
PLATE = ("R_LL_PROX_ANT", "R_LL_PROX_POST", "R_LL_DIST_ANT", "R_LL_DIST_POST")
PLATE_TURNED = dict(zip(PLATE, (PLATE[1], PLATE[0], PLATE[3], PLATE[2]), strict=True))
# Labels that contradict the same person's other takes, or everybody else's: what each name in the file really is.
MISLABELLED = {
    "HC030A01": LEFT_WRIST,
    "HC030A05": LEFT_WRIST,
    "HC030A22": LEFT_WRIST,
    "HC038A11": LEFT_WRIST | RIGHT_WRIST,
    "HC039A17": HEAD_TURNED,
    "HC055A34": HEAD_MIRRORED,
    "freeform": {"LFSH": "LBSH", "LBSH": "LFSH", "RFSH": "RBSH", "RBSH": "RFSH"},
    "squat": {"LMT1": "LMT5", "LMT5": "LMT1", "RMT1": "RMT5", "RMT5": "RMT1"},
    "amputee_a01_standing": PLATE_TURNED,
}
# Takes in a part of which, of frames from one until another, two markers have each other's labels: the distances to all
# beside them say so.
EXCHANGED: dict[str, tuple[tuple[int, int | None, str, str], ...]] = {
    "freeform": ((0, 200, "LIWR", "LOHAND"), (970, None, "RIWR", "RTOE")),
}
# Who wears the actors' sets. Of cmu41 `bd` is left out always: its licence asks to share alike.
ACTORS = {"actor41": ("cmu41", ("ball", "s02", "s135")), "actor53": ("actors53", ("p1", "p2"))}
POSE_EVERY, POSES = 4, 400  # frames of a take for each that poses are read off, and how many of them are kept
ACTOR_SOURCE = {
    "actor41": "ball, s02, s135: mocap.cs.cmu.edu, free for all uses, by keenon/nimblephysics at c405b05; basketball, "
    "punches and strikes, karate",
    "actor53": "p1, p2: keenon/nimblephysics at c405b05, BSD-2 licence; freeform and squats",
}
SOURCE = {
    "learned": "2026-11-30 by scripts/learn_markersets.py",
    "walkers": "HC…: mcgillmotionlab/biomechzoo at 7daadbc, MIT licence; each standing, walking straight and turning",
    "player": "Derrick: kineticstoolkit at 169a99d, Apache-2.0 licence; a tennis serve",
}


def read_people(data: Path, leave_out=()) -> list[people_study.Person]:
    """Everybody in `data` but those left out, a few dozen frames each."""
    people = [read_walker(data / "mcgill" / name) for name in WALKERS if name not in leave_out]
    return people + [player for player in read_players(data / "tennis" / TENNIS) if player.name not in leave_out]


def read_walker(folder: Path) -> people_study.Person:
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
    return people_study.Person(folder.name, tuple(wanted), np.concatenate(parts), np.array(standing), stature)


def read_takes(data: Path, markers, leave_out=()) -> list[tuple[np.ndarray, str]]:
    """Every walker's takes whole: points (T, M, 3) m of `markers`, NaN where a take has none, and who it is.

    And the player's, where he wears all of them.
    """
    takes = []
    for person in (one for one in WALKERS if one not in leave_out):
        for file in sorted((data / "mcgill" / person).glob("*.c3d")):
            names, points, _ = read_c3d(file)
            worn = [names.index(name) if name in names else -1 for name in markers]
            picked = np.where(np.array(worn)[None, :, None] >= 0, points[:, worn], np.nan)
            takes.append((picked[np.isfinite(picked).any(axis=(1, 2))][::EVERY], person))
    names, points, _ = read_c3d(data / "tennis" / TENNIS, prefixes=True)
    worn = [f"{PLAYER}:{name}" for name in markers]
    if PLAYER not in leave_out and set(worn) <= set(names):
        takes.append((points[::EVERY, [names.index(name) for name in worn]], PLAYER))
    return takes


def read_players(file: Path) -> list[people_study.Person]:
    """The tennis players, each with a prefix of their own, who serve and do not stand still."""
    names, points, _ = read_c3d(file, prefixes=True)
    people = []
    for prefix in sorted({name.split(":")[0] for name in names if ":" in name}):
        own = [index for index, name in enumerate(names) if name.startswith(prefix + ":")]
        bare = [names[index].split(":")[1] for index in own]
        frames = _thinned(points[:, own], bare, STANDING_FRAMES + 2 * MOVING_FRAMES)
        chosen = points[np.ix_(frames, own)]
        people.append(people_study.Person(prefix, tuple(bare), chosen, np.zeros(len(frames), dtype=bool)))
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


def true_places(take: str, names: Sequence[str], points: np.ndarray) -> np.ndarray:
    """Points (T, P, 3) m of a take's labels where they are really, also where the file has two of them exchanged."""
    points = points.copy()
    for first, after, one, other in EXCHANGED.get(take, ()):
        pair = [names.index(one), names.index(other)]
        points[first:after, pair] = points[first:after, pair[::-1]]
    return points


def read_actors(data: Path, name: str, leave_out=()) -> dict[str, np.ndarray]:
    """Whole takes (T, M, 3) m, z up, of everybody who wears an actors' set."""
    folder, people = ACTORS[name]
    markers, found = anatomy.ACTOR_SETS[name].markers, {}
    for person in (one for one in people if one not in leave_out):
        for file in sorted((data / folder / person).glob("*.c3d")):
            take = read_points(file)
            worn = [true_name(file.stem, label.rpartition(":")[2]) for label in take.names]
            points = true_places(file.stem, worn, take.xyz)
            found[person] = points[:, [worn.index(marker) for marker in markers]]
    return found


def takes_on(body: MarkerSet, data: Path, leave_out=()) -> list[tuple[np.ndarray, str]]:
    """The takes (T, M, 3) m of actors whose set is laid on a body, and who each is; NaN of markers that they lack.

    Walkers hold their arms down: without actors the wrists of somebody in a T-pose stay questions.
    """
    takes = []
    for site in _laid_on(body.name):
        worn = [dict(site.sites).get(marker, marker) for marker in site.markers]
        place = [worn.index(marker) if marker in worn else -1 for marker in body.markers]
        for person, points in read_actors(data, site.name, leave_out).items():
            picked = np.where(np.array(place)[None, :, None] >= 0, points[:, place], np.nan)
            takes.append((picked[::EVERY], person))
    return takes


def learn_actor_set(
    name: str, sets: Path, takes: dict[str, np.ndarray], people: list[people_study.Person]
) -> MarkerSet:
    """An actors' set on the body of another one in the folder `sets`, from takes of its wearers.

    With the poses that everybody was recorded in.
    """
    site = anatomy.ACTOR_SETS[name]
    body = read_markerset(sets / f"{site.body}{SUFFIX}")
    known = dict(site.sites)
    there = [known.get(marker, marker) for marker in site.markers]
    laid = transferred(body, list(takes.values()), there, name)
    meant = dict(zip(there, site.markers, strict=True))
    aliases = {old: new for old, new in meant.items() if old not in site.markers}
    aliases |= {alias: meant[old] for alias, old in laid.aliases.items() if alias not in site.markers}
    source = {
        "people": " ".join(takes),
        "frames": str(sum(map(len, takes.values()))),
        "actors": ACTOR_SOURCE[name],
        "body and poses": f"{body.name}, and {' '.join(person.name for person in people)}",
        **SOURCE,
    }
    laid = replace(laid, description=site.description, markers=site.markers, aliases=aliases, source=source)
    poses = [poses_of(laid, points[::POSE_EVERY]) for points in takes.values()]
    others = [body.spread.poses] if len(body.spread.poses) else [poses_of(body, p.of(body.markers)) for p in people]
    return people_study.with_poses(laid, [*poses, *others], POSES)


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
    every = [*anatomy.SETS, *anatomy.ACTOR_SETS]
    parser.add_argument("--sets", nargs="*", default=every, choices=every)
    given = parser.parse_args(arguments)
    people = read_people(given.data, given.leave_out)
    given.out.mkdir(parents=True, exist_ok=True)
    for name in given.sets:
        began, acted = time.perf_counter(), []
        if name in anatomy.SETS:
            markerset = learn_set(people, name)
            takes = read_takes(given.data, markerset.markers, given.leave_out)
            acted = takes_on(markerset, given.data, given.leave_out)
        else:
            actors = read_actors(given.data, name, given.leave_out)
            markerset = learn_actor_set(name, given.out, actors, people)
            takes = [(points[::EVERY], person) for person, points in actors.items()]
        with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
            likelihood = learn_likelihood(takes + acted, markerset.markers)
            # People who stand and walk are more alike: among them one leg alone is known.
            second = learn_likelihood(takes, markerset.markers) if acted else None
        write_model(given.out / f"{name}{SUFFIX}", Model(markerset, likelihood, second=second))
        print(f"{name}: {len(markerset)} markers, {time.perf_counter() - began:.1f} s")


def learn_set(people: list[people_study.Person], name: str) -> MarkerSet:
    """A built-in marker set from these people, with a note of where its numbers come from."""
    markerset = people_study.learn(people, name)
    source = {**markerset.source, **SOURCE}
    for site in _laid_on(name):
        source |= {"actors": ACTOR_SOURCE[site.name], "second evidence": "without actors"}
    return replace(markerset, source=source)


def _laid_on(body: str) -> list[anatomy.ActorSet]:
    return [site for site in anatomy.ACTOR_SETS.values() if site.body == body]


if __name__ == "__main__":
    main()
