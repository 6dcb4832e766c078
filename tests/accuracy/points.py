# SPDX-License-Identifier: GPL-3.0-or-later
"""How well anonymous 3D points of people in no training set are named: python -m tests.accuracy.points.

Every person is left out of the training once. Prints, for each number of hidden markers and ghosts and each target rate
of right labels, false assignments, false occlusions, recall and F1 as the contract defines them.
"""

import argparse
import time
from dataclasses import dataclass

import numpy as np

from addon.core.evidence import Evidence, label_frames, learn_evidence
from addon.core.evidence.trials import make_trial

from . import people

SETS = {"gait15": people.GAIT15, "body26": people.BODY26}
TARGETS = (0.0, 0.99, 0.998, 0.999, 0.9995, 0.9999)
SEED = 5


@dataclass
class Counts:
    """Labels given, wrong ones, markers that were there, and all places for markers."""

    given: int = 0
    wrong: int = 0
    there: int = 0
    places: int = 0

    def add(self, marker: np.ndarray, truth: np.ndarray, markers: int):
        """Counts frames' markers (F, P), -1 where unnamed, against the truth (F, P)."""
        self.given += int((marker >= 0).sum())
        self.wrong += int(((marker >= 0) & (marker != truth)).sum())
        self.there += int((truth >= 0).sum())
        self.places += markers * len(truth)

    def line(self) -> str:
        """The figures, false occlusions over all markers declared occluded."""
        right = self.given - self.wrong
        missed = (self.there - right) / max(self.places - self.given, 1)
        return (
            f"FA {100 * self.wrong / max(self.given, 1):.3f} %  FO {100 * missed:.2f} %  "
            f"recall {right / max(self.there, 1):.4f}  F1 {2 * right / max(self.given + self.there, 1):.4f}"
        )


def worn_differently(clouds: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """The same people in a lab that puts the tibia marker 6 % of the leg lower and the heel 2 % nearer to the toe."""
    moved = clouds.copy()
    for side in "LR":
        knee, ankle, heel, toe = (clouds[:, names.index(side + part)] for part in ("KNE", "ANK", "HEE", "TOE"))
        leg = 2 * np.linalg.norm(knee - ankle, axis=1, keepdims=True)
        if side + "TIB" in names:
            moved[:, names.index(side + "TIB")] += 0.06 * leg * (ankle - knee) / (leg / 2)
        forward = (toe - heel) / np.linalg.norm(toe - heel, axis=1, keepdims=True)
        moved[:, names.index(side + "HEE")] += 0.02 * leg * forward
    return moved


def named(evidence: Evidence, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Markers and rates (F, P) of all frames."""
    chunks = list(label_frames(evidence, points))
    return np.concatenate([chunk.marker for chunk in chunks]), np.concatenate([chunk.rate for chunk in chunks])


def main(arguments: list[str] | None = None):
    """Measures what was asked for and prints it."""
    parser = argparse.ArgumentParser(description="Measures the naming of 3D points on people left out of training.")
    parser.add_argument("--set", choices=SETS, default="gait15")
    parser.add_argument("--hidden", nargs="*", default=["1:1", "4:4", "5:5"], metavar="LEAST:MOST")
    parser.add_argument("--ghosts", type=int, default=0)
    parser.add_argument("--frames", type=int, default=300, help="frames of each person")
    parser.add_argument("--every", type=int, default=1, help="test only every so manieth person")
    parser.add_argument("--other-lab", action="store_true", help="move the tibia and heel markers of the people tested")
    given = parser.parse_args(arguments)
    names = SETS[given.set]
    takes = [(recording.pick(names), recording.person) for recording in people.takes()]
    counts = {(hidden, target): Counts() for hidden in given.hidden for target in TARGETS}
    seconds = frames = 0
    for person in people.everyone()[:: given.every]:
        began = time.perf_counter()
        evidence = learn_evidence([take for take in takes if take[1] != person], names)
        print(f"without {person}: trained in {time.perf_counter() - began:.1f} s", flush=True)
        clouds = np.concatenate([points for points, owner in takes if owner == person])
        for hidden in given.hidden:
            rng = np.random.default_rng(SEED)
            chosen = clouds[rng.permutation(len(clouds))[: given.frames]]
            chosen = worn_differently(chosen, names) if given.other_lab else chosen
            least, most = map(int, hidden.split(":"))
            trial = make_trial(chosen, (least, most), (0, given.ghosts), rng)
            began = time.perf_counter()
            marker, rate = named(evidence, trial.points)
            seconds, frames = seconds + time.perf_counter() - began, frames + len(chosen)
            for target in TARGETS:
                counts[hidden, target].add(np.where(rate >= target, marker, -1), trial.truth, len(names))
    for (hidden, target), figures in counts.items():
        print(f"{hidden} hidden, 0:{given.ghosts} ghosts, target {target:.4f}: {figures.line()}")
    print(f"{frames / seconds:.0f} frames a second")


if __name__ == "__main__":
    main()
