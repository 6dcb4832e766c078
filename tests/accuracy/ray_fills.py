# SPDX-License-Identifier: GPL-3.0-or-later
"""Fills with and without the ray of the camera that still sees the marker: python -m tests.accuracy.ray_fills.

Recorded takes are captured in virtual rooms of a few cameras, with the body in the way. Where one camera alone sees a
marker its gap is filled as always, and held by the ray; the truth is the recorded marker. Blobs have their true names,
or those that `label` gives to a person who is not in the marker set's training. Errors are means over frames, mm.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from addon.capturing import cut, labelled_markers, moved, posed_body, to_centre
from addon.core.blobs.pipeline import label_take
from addon.core.data.progress import finished
from addon.core.data.takes import NO_MARKER, Blobs, Labels
from addon.core.filling.filling import FilledTake, FillOptions, fill_take
from addon.core.filling.rays import NO_RAYS, MarkerRays, rays_of
from addon.core.geometry.cameras import Cameras
from addon.core.geometry.measuring import measured_points
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import CaptureOptions, capture
from addon.io.markersets import open_markerset
from addon.io.points import read_points

from .filling import CHOSEN_ON, PEOPLE, TAKES
from .tables import table

LEFT_OUT = ("bd",)  # whom the marker set has not seen
ROOM = {"size": (1280, 1024), "radius": 5.0, "volume_radius": 2.0, "height": 2.4}
TROUBLE = CaptureOptions(calibration_mm=0.5, calibration_mrad=0.2)


def markerset_of(name: str):
    """The built-in set that a take wears."""
    return open_markerset("actor53" if TAKES[name].startswith("actors53") else "actor41")


def captured(name: str, cameras: Cameras, seconds: float):
    """A part of a take as the cameras see it: blobs, the true marker of each, where the markers are, and the rate."""
    points = read_points(PEOPLE / TAKES[name])
    take, markerset = labelled_markers(points), markerset_of(name)
    columns = [take.names.index(marker) if marker in take.names else -1 for marker in markerset.markers]
    if min(columns) < 0:
        bare = [each.rpartition(":")[2] for each in take.names]
        columns = [bare.index(marker) for marker in markerset.markers]
    take = replace(take, names=markerset.markers, xyz=take.xyz[:, columns])
    count, first = round(seconds * points.rate), take.first_frame + len(take.xyz) // 4
    take = cut(take, (first, first + count - 1))
    body = posed_body(take, markerset, range(len(take.names)))
    take, body = moved(take, body, to_centre(take, cameras))
    parts = list(capture(take.xyz, take.names, cameras, TROUBLE, body, take.first_frame))
    truth = np.concatenate([part.truth for part in parts])
    number = {marker: index for index, marker in enumerate(markerset.markers)}
    marker = np.array([number.get(one, NO_MARKER) for one in truth])  # of merged blobs nobody knows
    return Blobs.join(part.blobs for part in parts), marker, take.xyz, points.rate


def measured(blobs: Blobs, labels: Labels, cameras: Cameras, markers: int) -> np.ndarray:
    """(T, M, 3) m, where the markers' blobs meet."""
    found = np.full((len(blobs.frames), markers, 3), np.nan)
    where = np.ones(found.shape[:2], bool)
    found[where] = measured_points(blobs, labels, cameras, where)[0]
    return found


def compared(xyz: np.ndarray, truth: np.ndarray, rays: MarkerRays, rate: float) -> dict[str, float]:
    """Mean errors, mm, of the frames that both fills have: where a ray is, and in the rest of gaps that have some."""
    without, held = (_filled(xyz, rate, own) for own in (NO_RAYS, rays))
    there = without.filled & held.filled & np.isfinite(truth).all(axis=2)
    ray = np.zeros(there.shape, bool)
    ray[rays.frame, rays.marker] = True
    beside = np.zeros(there.shape, bool)
    for one in held.gaps:
        if one.method.endswith("+ray"):
            beside[one.gap.start : one.gap.stop, one.gap.marker] = True
    beside &= ~ray & there
    ray &= there
    told = {"frames": int(ray.sum()), "beside": int(beside.sum())}
    for key, fill in (("without", without), ("held", held)):
        off = 1000 * np.linalg.norm(fill.xyz - truth, axis=2)
        told[key] = float(off[ray].mean()) if ray.any() else np.nan
        told[f"{key} worst"] = float(np.quantile(off[ray], 0.95)) if ray.any() else np.nan
        told[f"{key} beside"] = float(off[beside].mean()) if beside.any() else np.nan
    more = held.filled & ~without.filled & np.isfinite(truth).all(axis=2)
    told["more"] = int(more.sum())
    told["more off"] = float(1000 * np.linalg.norm(held.xyz - truth, axis=2)[more].mean()) if more.any() else np.nan
    return told


def _filled(xyz: np.ndarray, rate: float, rays: MarkerRays) -> FilledTake:
    return finished(fill_take(xyz, rate, FillOptions(), rays=rays))


def told_of(name: str, count: int, seconds: float, named: str) -> dict[str, float]:
    """What comes of one take in a room of `count` cameras, with the blobs `named` truly or by `label`."""
    cameras = ring_rig(count, **ROOM)
    blobs, marker, truth, rate = captured(name, cameras, seconds)
    sure = np.ones(len(marker))
    labels = Labels(marker, np.ones(len(marker), int), sure)
    if named == "label":
        parts = [blobs.between(first, first + 255) for first in range(int(blobs.frames[0]), int(blobs.frames[-1]), 256)]
        labels = Labels.join(chunk.labels for chunk in label_take(parts, cameras, markerset_of(name), rate))
    xyz = measured(blobs, labels, cameras, truth.shape[1])
    missing = ~np.isfinite(xyz[..., 0])
    return compared(xyz, truth, rays_of(blobs, labels, cameras, missing), rate)


def main() -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.accuracy.ray_fills", description=__doc__.splitlines()[0])
    parser.add_argument("--takes", nargs="*", choices=list(TAKES), default=list(TAKES))
    parser.add_argument("--cameras", nargs="*", type=int, default=[4, 6])
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--named", nargs="*", choices=("truly", "label"), default=["truly", "label"])
    given = parser.parse_args()
    if not Path(PEOPLE).exists():
        print("the recorded people are not here; expected them in ../shared/data/people", file=sys.stderr)
        return 1
    begin, rows = perf_counter(), []
    with threadpool_limits(1, user_api="blas"):
        for named in given.named:
            for count in given.cameras:
                for name in given.takes if named == "truly" else [one for one in given.takes if one in LEFT_OUT]:
                    rows.append(_row(name, count, named, told_of(name, count, given.seconds, named)))
                    print(rows[-1], file=sys.stderr)
    columns = ("take", "cameras", "names", "frames with one ray", "without the ray", "held by it")
    columns += ("95 %: without, held", "frames beside: without, held", "filled only with the ray")
    print(table(columns, rows))
    print(f"\n{perf_counter() - begin:.0f} s")
    return 0


def _row(name: str, count: int, named: str, told: dict[str, float]) -> list[str]:
    chosen = " (chosen on)" if name in CHOSEN_ON else ""
    return [
        f"{name}{chosen}",
        str(count),
        {"truly": "true", "label": "by `label`"}[named],
        str(told["frames"]),
        f"{told['without']:.2f}",
        f"{told['held']:.2f}",
        f"{told['without worst']:.1f}, {told['held worst']:.1f}",
        f"{told['beside']}: {told['without beside']:.2f}, {told['held beside']:.2f}",
        f"{told['more']}: {told['more off']:.2f}",
    ]


if __name__ == "__main__":
    sys.exit(main())
