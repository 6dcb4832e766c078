# SPDX-License-Identifier: GPL-3.0-or-later
"""What anatomy says of the names of markers where nobody knows the truth: a runner's left is left, toes are in front.

Written for the plates of the take beside the project; it knows nothing of the models and of how names were found.
"""

from itertools import pairwise

import numpy as np

RUNNING = 1.5  # m/s of the pelvis
PLATE = ("PA", "PP", "DP", "DA")


class _Run:
    """Positions of the markers by name, (F, 3) in the axes of a run: forward, left, up."""

    def __init__(self, placed: np.ndarray, names, rate: float):
        back = np.stack([placed[:, names.index(name)] for name in ("PVUL", "PVLL", "PVUR", "PVLR")], axis=1)
        middle = back.mean(axis=1)
        step = max(int(rate / 10), 1)
        speed = np.full(middle.shape, np.nan)
        speed[step:-step] = (middle[2 * step :] - middle[: -2 * step]) * rate / (2 * step)
        speed[:, 2] = 0
        self.frames = np.linalg.norm(speed, axis=1) > RUNNING
        forward = speed[self.frames] / np.linalg.norm(speed[self.frames], axis=1, keepdims=True)
        left = np.stack([-forward[:, 1], forward[:, 0], np.zeros(len(forward))], axis=1)
        self.axes = np.stack([forward, left, np.broadcast_to((0.0, 0.0, 1.0), forward.shape)], axis=1)
        self.placed, self.names = placed[self.frames] - middle[self.frames, None], names

    def __getitem__(self, name: str) -> np.ndarray:
        return np.einsum("fij,fj->fi", self.axes, self.placed[:, self.names.index(name)])

    def of(self, part: str) -> np.ndarray:
        """The mean of all markers whose names begin so."""
        own = np.stack([self[name] for name in self.names if name.startswith(part)])
        seen = np.isfinite(own).sum(axis=0)
        return np.where(seen > 0, np.nansum(own, axis=0) / np.maximum(seen, 1), np.nan)


def statements(placed: np.ndarray, names, rate: float) -> list[tuple[str, str]]:
    """What should hold of markers (T, M, 3) m named `names`, and of how many of them it does."""
    run = _Run(placed, names, rate)
    return [
        ("frames of the run", str(int(run.frames.sum()))),
        ("left markers to the left of their right ones", _count(_sides(run))),
        ("head above back above pelvis above thighs above shanks above feet", _count(_heights(run))),
        ("toes farther from the shank's back than heels, ankles outside", _count(_feet(run))),
        ("plates of the legs: proximal markers nearer to the hip end, anterior ones in front", _count(_legs(run))),
        ("plates of the arms: proximal markers nearer to the shoulder end", _count(_arms(run))),
    ]


def _count(held: list[bool | None]) -> str:
    known = [one for one in held if one is not None]
    return f"{sum(known)} of {len(known)}"


def _mean(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else None


def _above(value: float | None) -> bool | None:
    return None if value is None else value > 0


def _sides(run: _Run) -> list[bool | None]:
    pairs = [(name, "R" + name[1:]) for name in run.names if name.startswith("L") and "R" + name[1:] in run.names]
    pairs += [(f"{rigid_body}{row}L", f"{rigid_body}{row}R") for rigid_body in ("LB", "PV") for row in "UL"]
    return [_above(_mean(run[left][:, 1] - run[right][:, 1])) for left, right in pairs]


def _heights(run: _Run) -> list[bool | None]:
    parts = [run["FHD"], run.of("LB"), run.of("PV")]
    held = [_above(_mean(upper[:, 2] - lower[:, 2])) for upper, lower in pairwise(parts)]
    for side in "LR":
        leg = [run.of("PV"), run.of(side + "TH"), run.of(side + "SH"), run[side + "FTM"]]
        held += [_above(_mean(upper[:, 2] - lower[:, 2])) for upper, lower in pairwise(leg)]
    return held


def _feet(run: _Run) -> list[bool | None]:
    held = []
    for side, outward in (("L", 1), ("R", -1)):
        heel, ankle, shank = run[side + "HEE"], run[side + "ANL"], run.of(side + "SH")
        up = shank - ankle
        for toe in ("FTB", "FTM", "FTF"):
            # Forward where the shank is upright, and square to it where it is not.
            ahead = np.cross(np.broadcast_to((0.0, 1.0, 0.0), up.shape), up)
            held.append(_above(_mean(((run[side + toe] - heel) * ahead).sum(axis=1))))
        held.append(_above(_mean(outward * (ankle - heel)[:, 1])))
    return held


def _legs(run: _Run) -> list[bool | None]:
    held = []
    for side in "LR":
        ends = {"TH": (run.of("PV"), run.of(side + "SH")), "SH": (run.of(side + "TH"), run[side + "ANL"])}
        for part, (hip, foot) in ends.items():
            along = foot - hip
            ahead = np.cross(np.broadcast_to((0.0, 1.0, 0.0), along.shape), -along)
            corner = {name: run[side + part + name] for name in PLATE}
            for near, far in (("PA", "DA"), ("PP", "DP")):
                held.append(_above(_mean(((corner[far] - corner[near]) * along).sum(axis=1))))
            for front, behind in (("PA", "PP"), ("DA", "DP")):
                held.append(_above(_mean(((corner[front] - corner[behind]) * ahead).sum(axis=1))))
    return held


def _arms(run: _Run) -> list[bool | None]:
    held = []
    for side in "LR":
        for part, hand in (("UA", run.of(side + "FA")), ("FA", run[side + "HAND"])):
            corner = {name: run[side + part + name] for name in PLATE}
            for near, far in (("PA", "DA"), ("PP", "DP")):
                away = np.linalg.norm(corner[near] - hand, axis=1) - np.linalg.norm(corner[far] - hand, axis=1)
                held.append(_above(_mean(away)))
    return held
