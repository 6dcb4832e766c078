# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of the markers the reconstruction finds in unnamed blobs, and how much that is not there."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from addon.core.data.takes import Blobs
from addon.core.reconstruction.trajectories import RECONSTRUCTION, Reconstructed, reconstruct_take

from . import people
from .captures import Trial
from .standing import standing
from .tables import table
from .walking import walking

RIGHT = 0.010  # m


@dataclass
class Rebuilt:
    """Counts over takes.

    markers          the names of what is worn
    frames, seconds  reconstructed
    there            markers that two or more cameras see, over all frames; of them `found` within RIGHT
    three            those that three or more cameras see; of them `three_found`
    false            points with no marker within RIGHT
    breaks           times a marker goes on in another trajectory than its last
    swaps            times a trajectory goes on with another marker
    off              mm, distances of the found points from their markers
    """

    markers: tuple[str, ...]
    frames: int = 0
    seconds: float = 0.0
    there: int = 0
    found: int = 0
    three: int = 0
    three_found: int = 0
    false: int = 0
    breaks: int = 0
    swaps: int = 0
    marker_seconds: float = 0.0
    off: list = field(default_factory=list)

    def add(self, trials: Iterable[Trial], chunk: int = 256) -> "Rebuilt":
        """Reconstructs every trial and counts. Returns itself."""
        for trial in trials:
            begin = perf_counter()
            parts = list(reconstruct_take(_chunks(trial.blobs, chunk), trial.cameras, trial.rate))
            self.seconds += perf_counter() - begin
            self._count(trial, parts)
        return self

    def _count(self, trial: Trial, parts: list[Reconstructed]):
        seen = _seen_by(trial, self.markers)
        # What the command leaves out of its file does not count.
        length = np.bincount(np.concatenate([part.trajectory for part in parts]))
        lasting = length >= min(RECONSTRUCTION.min_points, len(seen))
        last_trajectory, last_marker = {}, {}
        index = 0
        for part in parts:
            for frame in range(len(part.frames)):
                mine = (part.frame == frame) & lasting[part.trajectory]
                marker, distance = _matched(part.points[mine], trial.xyz[index])
                right = distance < RIGHT
                found = np.zeros(len(seen[index]), bool)
                found[marker[right]] = True
                self.there += int((seen[index] >= 2).sum())
                self.found += int((found & (seen[index] >= 2)).sum())
                self.three += int((seen[index] >= 3).sum())
                self.three_found += int((found & (seen[index] >= 3)).sum())
                self.false += int((~right).sum())
                self.off.append(distance[right] * 1000)
                for who, trajectory in zip(marker[right].tolist(), part.trajectory[mine][right].tolist(), strict=True):
                    self.breaks += last_trajectory.setdefault(who, trajectory) != trajectory
                    self.swaps += last_marker.setdefault(trajectory, who) != who
                    last_trajectory[who], last_marker[trajectory] = trajectory, who
                index += 1
        self.frames += index
        self.marker_seconds += len(seen[0]) * index / trial.rate

    def cells(self) -> list[str]:
        """The cells under `COLUMNS`."""
        off = np.concatenate(self.off) if self.off else np.zeros(0)
        return [
            f"{100 * self.found / max(self.there, 1):.2f} %",
            f"{100 * self.three_found / max(self.three, 1):.2f} %",
            f"{self.false / max(self.frames, 1):.3f}",
            f"{60 * self.breaks / max(self.marker_seconds, 1e-9):.2f}",
            str(self.swaps),
            f"{np.median(off) if len(off) else float('nan'):.2f}",
            f"{self.frames / max(self.seconds, 1e-9):.0f}",
        ]


COLUMNS = (
    "markers of 2+ cameras found",
    "of 3+",
    "false points a frame",
    "breaks a marker and minute",
    "swaps",
    "median error, mm",
    "frames/s",
)


def _chunks(blobs: Blobs, size: int):
    for first in range(0, len(blobs.frames), size):
        frames = blobs.frames[first : first + size]
        rows = (blobs.frame >= first) & (blobs.frame < first + len(frames))
        yield Blobs(frames, blobs.frame[rows] - first, blobs.camera[rows], blobs.xy[rows], blobs.area[rows])


def _seen_by(trial: Trial, markers) -> np.ndarray:
    """(T, M) how many cameras have a blob of each marker to itself or shared."""
    order = {name: index for index, name in enumerate(markers)}
    seen = np.zeros((len(trial.blobs.frames), len(order)), int)
    for frame, text in zip(trial.blobs.frame.tolist(), trial.truth.tolist(), strict=True):
        for name in text.split("|"):
            if name:
                seen[frame, order[name]] += 1
    return seen


def _matched(points: np.ndarray, markers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each point the marker that it may stand for, one to one, nearest first, and the distance; inf for none."""
    distance = np.nan_to_num(np.linalg.norm(points[:, None] - markers, axis=2), nan=np.inf)
    marker, off = np.zeros(len(points), int), np.full(len(points), np.inf)
    for _ in range(min(distance.shape, default=0)):
        point, who = np.unravel_index(distance.argmin(), distance.shape)
        if not distance[point, who] < RIGHT:
            break
        marker[point], off[point] = who, distance[point, who]
        distance[point], distance[:, who] = np.inf, np.inf
    return marker, off


def run_rebuilding(plan):
    """Points from unnamed blobs: standing in the paper's rig, and walks in rings of four and in the real room."""
    rows = []
    everyone = people.everyone()
    takes = max(plan.count // 10, 1)
    for name, markers in (("gait15", people.GAIT15), ("body26", people.BODY26)):
        if name not in plan.sets:
            continue
        runs = {
            "standing, the paper's 4 cameras": standing(markers, everyone, plan.count, plan.seed),
            "walks, ring of 4": walking(markers, everyone, takes, plan.seed, room="ring", cameras=(4, 4)),
            "walks, vicon12, 6 to 8": walking(markers, everyone, takes, plan.seed),
            "walks, vicon12, all 12": walking(markers, everyone, takes, plan.seed, cameras=(12, 12)),
        }
        for title, trials in runs.items():
            rebuilt = Rebuilt(markers).add(trials)
            rows.append([name, title, str(rebuilt.frames), *rebuilt.cells()])
    print(f"\n### Points from unnamed blobs ({plan.count} frames, {takes} walks, seed {plan.seed})\n")
    print(table(("set", "capture", "frames", *COLUMNS), rows))
