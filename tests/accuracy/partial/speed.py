# SPDX-License-Identifier: GPL-3.0-or-later
"""How fast the built-in models, and one of 62 markers on plates, name clouds on one core."""

from time import perf_counter

import numpy as np

from addon.core.data.takes import Labels
from addon.core.papers.partial_solvers.frames import SolversNamer
from addon.core.points.likelihood.frames import LikelihoodNamer
from addon.core.points.likelihood.learn import learn_likelihood
from addon.core.points.naming import Namer
from addon.io.models import open_model
from addon.io.points import read_points

from .. import people
from .clouds import Trouble, drawn, spoilt

CASES = (Trouble(), Trouble(4), Trouble(5, 3), Trouble(10), Trouble(0, 10), Trouble(10, 10))
FRAMES = 640  # named in one go, for the rate
ALONE = 120  # named one by one, for the delay
ANY_RATE = 100.0  # frames a second; to both methods each frame is alone
PLATES = people.DATA / "people" / "clouthier"


def timed() -> list[list]:
    """Method, markers, hidden, ghosts, frames a second, median and 99th percentile of the delay of one frame, ms."""
    rows = []
    for name, names in (("gait15", people.GAIT15), ("body26", people.BODY26)):
        frames = np.concatenate([recording.pick(names) for recording in people.takes()])
        model = open_model(name)
        rows += [["ours", name, *row] for row in _rows(LikelihoodNamer(model.likelihood), frames)]
        if model.partial_solvers is not None:
            rows += [["ensemble", name, *row] for row in _rows(SolversNamer(model.partial_solvers), frames)]
    if PLATES.is_dir():
        (learned, names), (tested, _) = _rigid_bodies("KneeltoProne01"), _rigid_bodies("PronetoRun01")
        likelihood = learn_likelihood([(learned, "one")], names)
        rows += [["ours", f"{len(names)} on plates", *row] for row in _rows(LikelihoodNamer(likelihood), tested)]
    return rows


def _rigid_bodies(stem: str) -> tuple[np.ndarray, tuple[str, ...]]:
    take = read_points(PLATES / f"{stem}.c3d")
    return take.xyz, take.names


def _rows(namer: Namer, frames: np.ndarray) -> list[list]:
    rows = []
    Labels.join(namer.name(frames[:64], ANY_RATE))
    for at, trouble in enumerate(CASES):
        generator = np.random.default_rng([8, at])
        clouds = spoilt(drawn(frames, FRAMES, generator), trouble, generator).points
        began = perf_counter()
        Labels.join(namer.name(clouds, ANY_RATE))
        rate = len(clouds) / (perf_counter() - began)
        delays = np.empty(ALONE)
        for frame in range(ALONE):
            began = perf_counter()
            Labels.join(namer.name(clouds[frame : frame + 1], ANY_RATE))
            delays[frame] = perf_counter() - began
        rows.append(
            [
                trouble.hide,
                trouble.ghosts,
                rate,
                1000 * float(np.median(delays)),
                1000 * float(np.quantile(delays, 0.99)),
            ]
        )
    return rows
