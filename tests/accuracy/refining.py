# SPDX-License-Identifier: GPL-3.0-or-later
"""A real room refined by its own take: python -m tests.accuracy.refining prints what results/refining.json keeps.

The recording of `real_blobs`, two of whose eleven cameras were moved after the calibration. The calibration is refined
by the first half of the take, all by the command line; the second half says what it is worth: the reprojection error of
each camera by the recorder's own names, and the labelling with either calibration. Besides, virtual rooms in which
cameras were moved by known amounts.
"""

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from addon.core.calibration.refining import parts_of, refine_cameras
from addon.core.calibration.sightings import Sightings
from addon.core.data.progress import finished
from addon.core.data.takes import NO_MARKER, Blobs, Labels
from addon.core.geometry.cameras import Cameras
from addon.core.pipelines.blobs import BlobOptions
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import CaptureOptions
from addon.core.simulation.virtual import Act
from addon.io.blobs import read_blobs
from addon.io.cameras import read_cameras
from addon.io.models import open_model
from addon.io.points import read_points
from tests.core.calibration.test_adjusting import moved
from tests.core.scenes import RATE, act, built_in

from .commands import command, rows_of
from .real_blobs import COLUMNS, LEARNED, MOVED, TAKE, TESTED, available, learn, recorded, row_of, run
from .tables import table

EVERY = 5  # frames of the second half, of which the errors are taken
WALK = (Act(3.0, stride=1.0), Act(1.0, stride=0.3, turn=2.0))
VIRTUAL = CaptureOptions(noise=0.3)
# cameras of a room; which of them are moved, by so many degrees and mm
ROOMS = (
    (4, (), 0.0, 0.0),
    (4, (1,), 1.0, 30.0),
    (8, (), 0.0, 0.0),
    (8, (3,), 0.3, 10.0),
    (8, (3,), 2.0, 50.0),
    (8, (3, 6), 1.0, 30.0),
)


def refined(folder: Path, model: Path) -> Path:
    """The calibration that `refine` makes of the first half."""
    out = folder / "refined.toml"
    frames = f"{LEARNED[0]}:{LEARNED[1]}"
    take = TAKE / "run.csv", "--cameras", TAKE / "room.toml", "--model", model, "--rate", 100
    command("refine", *take, "--frames", frames, "--out", out, "--overwrite")
    return out


def truly_named(cameras: Cameras) -> Sightings:
    """The second half's blobs by the recorder's own names; merged ones have the first of theirs."""
    names = read_points(TAKE / "run.c3d").names
    index = {name: number for number, name in enumerate(names)}
    given = [row["marker"].partition("|")[0] for row in rows_of(TAKE / "run.truth.csv", TESTED)]
    marker = np.array([index.get(name, NO_MARKER) for name in given])
    blobs = Blobs.join(part.blobs for part in read_blobs(TAKE / "run.csv", cameras, TESTED))
    marker[blobs.frame % EVERY > 0] = NO_MARKER
    return Sightings.of([(blobs, Labels(marker, 0 * marker, 0.0 * marker))], cameras)


def misses_of_others(seen: Sightings, cameras: Cameras) -> np.ndarray:
    """(C,) px: the error of each camera against the points that the others make."""
    found = []
    for index in range(len(cameras)):
        mine = seen.camera == index
        points = replace(seen, camera=seen.camera[~mine], image=seen.image[~mine], point=seen.point[~mine]).met(cameras)
        there = cameras.select([index]).project(points[seen.point[mine]])[0]
        found.append(np.nanmedian(np.linalg.norm(there - seen.xy[mine], axis=1)))
    return np.array(found)


def by_camera(before: Cameras, after: Cameras) -> str:
    """The errors of each camera with either calibration, and how far it was moved."""
    seen = truly_named(before)
    errors = [given for cameras in (before, after) for given in (seen.errors(cameras), misses_of_others(seen, cameras))]
    moved = 1000 * np.linalg.norm(after.centres - before.centres, axis=1)
    turn = np.einsum("cij,cij->c", after.rotation, before.rotation)
    turned = np.degrees(np.arccos(np.clip((turn - 1) / 2, -1, 1)))
    rows = [
        [
            name + (", moved" if name in MOVED else ""),
            *(f"{error[index]:.2f}" for error in errors),
            f"{moved[index]:.1f} mm, {turned[index]:.2f}°",
        ]
        for index, name in enumerate(before.names)
    ]
    return table(
        ("camera", "before, px", "before, by the others", "after, px", "after, by the others", "moved by"), rows
    )


def world(before: Cameras, after: Cameras) -> str:
    """By how much the markers of the second half are elsewhere with the refined calibration."""
    seen = truly_named(before)
    sound = seen.rows(~np.isin(seen.camera, [before.names.index(name) for name in MOVED]))
    distance = np.linalg.norm(sound.met(before) - sound.met(after), axis=1)
    middle, far = 1000 * np.nanmedian(distance), 1000 * np.nanpercentile(distance, 95)
    return (
        f"The markers are {middle:.2f} mm (median; 95 % within {far:.2f} mm) from where the nine cameras that were not "
        "moved have them by the old calibration."
    )


def labelling(folder: Path, model: Path, after: Path) -> str:
    """The second half labelled with either calibration."""
    take = recorded(folder, model)
    ways = (("as recorded", take), ("refined", replace(take, cameras=after)))
    measured = [run(title, files, folder / title.split()[0], ("--occlusion", "capsules")) for title, files in ways]
    kinds = ("exchanged", "shared", "nameless", "refused")
    cameras = sorted({camera for one in measured for camera, _ in one.mistakes.cameras})
    rows = [
        [
            camera + (", moved" if camera in MOVED else ""),
            *(f"{one.mistakes.cameras[camera, kind]}" for kind in kinds for one in measured),
        ]
        for camera in cameras
    ]
    said = ("clear exchanges", "one blob of two", "on a blob without truth", "refused")
    titles = [f"{what}, {when}" for what in said for when in ("before", "after")]
    return table(COLUMNS, map(row_of, measured)) + "\n\n" + table(("camera", *titles), rows)


def virtual() -> str:
    """A virtual walk in rooms whose cameras were moved by known amounts: how near the refined ones come to them."""
    model, rows = open_model("body26"), []
    for count, which, degrees, millimetres in ROOMS:
        true = ring_rig(count, generator=np.random.default_rng(count))
        scene = act(built_in("body26"), true, WALK, count, VIRTUAL)
        given = moved(true, which, degrees, millimetres, seed=count)
        first, last = scene.blobs.frames[[0, -1]].tolist()
        parts = [scene.blobs.between(*part) for part in parts_of(first, last)]
        found = finished(refine_cameras(parts, given, model, BlobOptions(rate=RATE)))
        distance = [image_distance(cameras, true, scene.points) for cameras in (given, found.cameras)]
        amount = (
            f"{', '.join(true.names[i] for i in which)} by {degrees:g}° and {millimetres:g} mm" if which else "none"
        )
        misplaced = 1000 * np.linalg.norm(found.cameras.centres - true.centres, axis=1).max()
        errors = (f"{np.nanmax(each):.2f}" for each in (found.before, found.after))
        said = f"{found.rounds} rounds" if found.refined else "nothing to refine"
        rows.append([count, amount, *errors, *(f"{each:.2f}" for each in distance), f"{misplaced:.1f}", said])
        print(f"{count} cameras, moved {amount}: done", file=sys.stderr, flush=True)
    off = ("off the truth before, px", "after, px", "places after, mm")
    return table(("cameras", "moved", "worst error before, px", "after, px", *off, "said"), rows)


def image_distance(cameras: Cameras, true: Cameras, points: np.ndarray) -> float:
    """The px by which the worst camera sees points (T, M, 3) m elsewhere than it truly does, median over the points."""
    distance = np.linalg.norm(cameras.project(points) - true.project(points), axis=-1)
    return float(np.nanmedian(distance, axis=(1, 2)).max())


def main() -> int:
    """Measures and prints."""
    parser = argparse.ArgumentParser(prog="python -m tests.accuracy.refining", description=__doc__.splitlines()[0])
    parser.add_argument("--model", type=Path, help="learned before by real_blobs, instead of being learned again")
    parser.add_argument("--refined", type=Path, help="made before, instead of being made again")
    given = parser.parse_args()
    if not available():
        print("the recorded blobs are not here; expected them in ../shared/data/blobs", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = given.model or learn(folder)
        out = given.refined or refined(folder, model)
        before, after = read_cameras(TAKE / "room.toml"), read_cameras(out)
        print(f"### Refined by frames {LEARNED[0]} to {LEARNED[1]}; errors of frames {TESTED[0]} to {TESTED[1]}\n")
        print(f"{by_camera(before, after)}\n\n{world(before, after)}\n")
        print(f"### The labelling of frames {TESTED[0]} to {TESTED[1]}\n\n{labelling(folder, model, out)}\n")
    print(f"### Virtual rooms of 656 × 491 px, `body26` walking for four seconds, noise 0.3 px\n\n{virtual()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
