# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes cases of points as the programs of ../shared/tools/peers take them.

python -m tests.accuracy.written DIR CASE …
"""

import argparse
from pathlib import Path

import numpy as np

from addon.core.data.takes import Points
from addon.io.points import write_c3d

from .whole_takes import CASES, Case, anonymous


def write(case: Case, folder: Path):
    """Writes each test of a case: `cloud.c3d`, `truth.csv`, and `train/SUBJECT/*.c3d`."""
    for seed, take in enumerate(case.tested):
        points, marker = anonymous(take, case, seed)
        place = folder / f"{case.name} {take.subject}".replace(" ", "-")
        place.mkdir(parents=True, exist_ok=True)
        write_c3d(place / "cloud.c3d", points)
        known = zip(*np.nonzero(marker >= 0), strict=True)
        rows = [f"{frame + 1},{point},{case.markers[marker[frame, point]]}" for frame, point in known]
        (place / "truth.csv").write_text("\n".join(["frame,point,marker", *rows]) + "\n", encoding="utf-8")
        for learned in case.training:
            own = place / "train" / learned.subject
            own.mkdir(parents=True, exist_ok=True)
            named = learned.of(case.markers)
            residual = np.where(np.isfinite(named.xyz[..., 0]), 0.0005, np.nan)
            shown = Points(named.markers, named.xyz, residual, named.rate, 1)
            write_c3d(own / f"{learned.name.partition('.')[0]}.c3d", shown)


def main():
    """Writes the cases."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("cases", nargs="+", choices=list(CASES), metavar="CASE", help=f"of {' '.join(CASES)}")
    given = parser.parse_args()
    for name in given.cases:
        for case in CASES[name]():
            write(case, given.folder)


if __name__ == "__main__":
    main()
