# SPDX-License-Identifier: GPL-3.0-or-later
"""Trains the partial solvers of the built-in models: python scripts/learn_partial_solvers.py --data PEOPLE.

PEOPLE is laid out as for learn_markersets.py, which comes first. Takes minutes a model.
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

from threadpoolctl import threadpool_limits

from addon.core.data.progress import finished
from addon.core.papers.partial_solvers.model import FUNCTIONS
from addon.core.papers.partial_solvers.training import Training, training
from addon.io.markersets import SUFFIX
from addon.io.models import read_model, write_model
from scripts import anatomy
from scripts.learn_markersets import read_takes

HIT_RATE = 0.9999
MANY = 30  # markers from which a search is made smaller, so that it ends within half an hour
SMALLER = {"survey_frames": 64, "max_features": 20_000, "max_solvers": 8}


def main(arguments: list[str] | None = None):
    """Trains the ensembles that were asked for and writes them into the models' files."""
    parser = argparse.ArgumentParser(description="Trains the partial solvers of the built-in models.")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data" / "people")
    parser.add_argument("--out", type=Path, default=ROOT / "assets")
    parser.add_argument("--sets", nargs="*", default=list(anatomy.SETS), choices=list(anatomy.SETS))
    given = parser.parse_args(arguments)
    for name in given.sets:
        began = time.perf_counter()
        path = given.out / f"{name}{SUFFIX}"
        model = read_model(path)
        points = np.concatenate([points for points, _ in read_takes(given.data, model.markerset.markers)])
        options = Training(functions=FUNCTIONS, **SMALLER if len(model.markerset) >= MANY else {})
        with threadpool_limits(1, user_api="blas"):
            partial_solvers = finished(training(points, model.markerset.markers, HIT_RATE, options))
        write_model(path, replace(model, partial_solvers=partial_solvers))
        print(f"{name}: {len(partial_solvers)} partial solvers, {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
