# SPDX-License-Identifier: GPL-3.0-or-later
"""The same captures through the door that people use: the built zip in a real Blender, files in and files out."""

import csv
import tempfile
from pathlib import Path

import numpy as np

from addon.core.data.markersets import MarkerSet
from addon.core.data.takes import Blobs
from addon.core.geometry.cameras import Cameras
from addon.io.blobs import write_blobs
from addon.io.cameras import write_cameras
from addon.io.markersets import write_markerset
from scripts import build, real_blender

from .models import left_out_model
from .runs import SCORE_COLUMNS, Plan, Score, score_cells
from .standing import standing
from .tables import table
from .walking import RATE, walking

PLATFORM = "linux-x64"


class Door:
    """Labels takes as `blender --background --command mocap_autolabel label` does."""

    def __init__(self, markerset: MarkerSet, blender: real_blender.RealBlender, folder: Path, rate: float):
        self.blender, self.folder, self.rate = blender, folder, rate
        self.model = folder / f"{markerset.name}.markerset.json"
        write_markerset(self.model, markerset)
        self.done = 0

    def __call__(self, blobs: Blobs, cameras: Cameras) -> tuple[np.ndarray, np.ndarray]:
        """The marker's name and the step of every blob, in the blobs' order."""
        self.done += 1
        take, room, out = self.folder / f"take{self.done}.csv", self.folder / "room.toml", self.folder / "out"
        write_blobs(take, blobs, cameras)
        write_cameras(room, cameras)
        words = ["label", take, "--model", self.model, "--cameras", room, "--rate", self.rate, "--out", out]
        ended = self.blender.run(
            "--background", "--command", "mocap_autolabel", *map(str, words), home=self.folder / "home"
        )
        if ended.returncode:
            raise RuntimeError(ended.stdout + ended.stderr)
        with (out / f"take{self.done}.labels.csv").open(encoding="utf-8") as file:
            rows = [(row["marker"], row["step"]) for row in csv.DictReader(file)]
        names, steps = np.array(rows, dtype=object).reshape(-1, 2).T
        return names, steps


def run_door(plan: Plan):
    """Standing frames in the paper's rig and walks in the recorded room, by the command line of a real Blender."""
    blender = real_blender.find()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _install(blender, folder)
        for set_name in plan.sets:
            for kind, trials_of, rate, count in (
                ("standing, paper's rig", standing, 100.0, max(plan.count // 4, 2)),
                ("walks and turns, vicon12", walking, RATE, max(plan.count // 20, 1)),
            ):
                score = None
                for number, fold in enumerate(plan.folds):
                    markerset = left_out_model(set_name, fold)
                    score = score or Score(markerset.markers)
                    place = folder / f"{set_name}-{rate:.0f}-{number}"
                    place.mkdir()
                    (place / "home").symlink_to(folder / "home")
                    door = Door(markerset, blender, place, rate)
                    score.add(trials_of(markerset.markers, fold, count, plan.seed), door)
                rows.append([set_name, kind, *score_cells(score.counts)])
    print(f"\n### Through the command line of a real Blender, ghosts ({plan.people()})\n")
    print(table(("set", "captures", *SCORE_COLUMNS), rows))


def _install(blender: real_blender.RealBlender, folder: Path):
    """Builds the zip for this Blender and installs it among settings of its own."""
    package = build.build("{}.{}".format(*blender.version[:2]), PLATFORM, folder, None)
    (folder / "home").mkdir()
    words = ("install-file", "--repo", "user_default", "--enable", str(package))
    ended = blender.run("--background", "--command", "extension", *words, home=folder / "home")
    if ended.returncode:
        raise RuntimeError(ended.stdout + ended.stderr)
