# SPDX-License-Identifier: GPL-3.0-or-later
"""What gaps are filled with, against the truth, as a Markdown table: python -m tests.accuracy.filling.

Gaps of four lengths are cut at random into recorded takes, into one marker or into a marker and those nearest to it at
once, and filled by the usual methods and by the product's `auto`, which says what error to expect. Errors are means
over the frames of a gap, then the gaps of a take, then the takes, mm.

The constants of the filling were chosen on the takes of CHOSEN_ON; what the others show is printed beside it.
"""

import sys
from collections.abc import Iterator
from time import perf_counter, process_time

import numpy as np
from scipy.sparse import block_diag, csc_array, diags_array, kron
from scipy.sparse.linalg import spsolve
from threadpoolctl import threadpool_limits

from addon.core.data.progress import finished
from addon.core.filling import plain
from addon.core.filling.filling import FillOptions, fill_take
from addon.core.filling.gaps import Gap, KnownMarkers
from addon.core.filling.regression import neighbours_of
from addon.io.points import read_points
from scripts.results import markdown

from .people import DATA, OTHERS, need_people

TAKES = ("s02", "ball", "s135", "bd", "p1", "p2")
CHOSEN_ON = ("s02", "ball", "p1")
GROUPS = {
    "CMU and HDM05 (`cmu41`)": ("s02", "ball", "s135", "bd"),
    "`actors53`": ("p1", "p2"),
    "of all, those that nothing was chosen on": tuple(name for name in TAKES if name not in CHOSEN_ON),
}
SECONDS = (0.1, 0.5, 1.0, 2.0)
AT_ONCE = {1: 12, 2: 6, 4: 4}  # markers missing at once, and how many gaps are cut of them a take and length
SEED = 0
MARGIN = 10  # frames on either side of a gap in which the marker is known
LEAST_SEEN = 0.2  # of a take; a marker that is seen less has no room for gaps


def take_of(name: str) -> tuple[np.ndarray, float]:
    """Named markers (T, M, 3) m that are seen for a good part of a take, and its rate."""
    take = read_points(DATA / OTHERS[name])
    kept = np.array([bool(marker) for marker in take.names]) & (take.present.mean(axis=0) > LEAST_SEEN)
    return take.xyz[:, kept], take.rate


def cuts(xyz: np.ndarray, length: int, count: int, at_once: int) -> Iterator[tuple[list[int], slice]]:
    """Markers and frames of gaps at random where the markers are known, also a little before and after."""
    rng = np.random.default_rng([SEED, length, at_once])
    known = np.isfinite(xyz[..., 0])
    distance = np.nanmean(np.linalg.norm(xyz[::20, :, None] - xyz[::20, None], axis=-1), axis=0)
    while count:
        marker, start = rng.integers(xyz.shape[1]), rng.integers(MARGIN, len(xyz) - length - MARGIN)
        there = known[start - MARGIN : start + length + MARGIN].all(axis=0)
        near = [int(other) for other in np.argsort(distance[marker]) if there[other]]
        if there[marker] and len(near) >= at_once:
            count -= 1
            yield near[:at_once], slice(int(start), int(start) + length)


def kalman(take: KnownMarkers, gap: Gap, *_) -> np.ndarray:
    """Low-rank Kalman smoothing (Burke and Lasenby 2016): weights of components walk at random; (L, 3) m."""
    side = 60
    part = slice(max(gap.start - side, 0), gap.stop + side)
    around = take.xyz[part]
    use = np.isfinite(around[..., 0]).all(axis=0)
    use[gap.marker] = False
    rows = take.xyz[np.isfinite(take.xyz[:, use, 0]).all(axis=1) & np.isfinite(take.xyz[:, gap.marker, 0])]
    others = np.flatnonzero(use)
    middle = rows[:, others].mean(axis=1)
    whole = np.concatenate([rows[:, others], rows[:, gap.marker][:, None]], axis=1) - middle[:, None]
    whole = whole.reshape(len(whole), -1)
    mean = whole.mean(axis=0)
    values, axes = np.linalg.eigh((whole - mean).T @ (whole - mean) / len(whole))
    kept = max(1, int(np.searchsorted(np.cumsum(values[::-1]), 0.999 * values.sum()) + 1))
    axes, noise = axes[:, ::-1][:, :kept], max(values[::-1][kept:].sum() / len(mean), 1e-10)
    walk = np.diff((whole - mean) @ axes, axis=0).var(axis=0) + 1e-12
    middle = around[:, others].mean(axis=1)
    seen = np.concatenate([around[:, others], around[:, gap.marker][:, None]], axis=1) - middle[:, None]
    seen = seen.reshape(len(seen), -1) - mean
    there, frames = np.isfinite(seen), len(seen)
    # The smoothed weights are what is likeliest of all frames: one system, with the walk beside its diagonal.
    steps = diags_array([np.ones(frames - 1), -np.ones(frames - 1)], offsets=[1, 0], shape=(frames - 1, frames))
    begins = block_diag([np.diag(1 / values[::-1][:kept]), csc_array(((frames - 1) * kept,) * 2)])
    looks = block_diag([axes[own].T @ axes[own] / noise for own in there])
    system = kron(steps.T @ steps, np.diag(1 / walk)) + begins + looks
    told = spsolve(csc_array(system), (np.where(there, seen, 0) @ axes / noise).ravel()).reshape(frames, kept)
    told = told @ axes[-3:].T + mean[-3:] + middle
    return told[gap.start - part.start : gap.stop - part.start]


PEERS = {
    "cubic spline": plain.spline, "rigid, 4 neighbours": plain.rigid, "PCA, joined ends": plain.pca,
    "low-rank Kalman": kalman,
}  # fmt: skip


def errors(xyz: np.ndarray, rate: float, columns: list[int], part: slice) -> dict[str, float]:
    """Mean error of each method, and the one that `auto` expected, of markers that are hidden for a while, mm."""
    hidden = xyz.copy()
    hidden[part, columns] = np.nan
    truth, found = xyz[part], {name: [] for name in (*PEERS, "auto", "expected")}
    take = KnownMarkers(hidden)
    for marker in columns:
        gap, own = Gap(part.start, part.stop, marker), take.known[:, marker]
        near = neighbours_of(take, gap, own)
        for name, peer in PEERS.items():
            path = peer(take, gap, near, own)
            found[name].append(np.nan if path is None else _off(path, truth[:, marker]))
    # The error is asked for whatever is to be expected, and the take's own gaps in other markers stay.
    options = FillOptions(markers=tuple(columns), max_gap=len(truth), max_off_m=np.inf)
    filled = finished(fill_take(hidden, rate, options))
    for marker in columns:
        found["auto"].append(_off(filled.xyz[part, marker], truth[:, marker]))
        told = next(one for one in filled.gaps if one.gap == Gap(part.start, part.stop, marker))
        found["expected"].append(1000 * told.expected)
    return {name: float(np.mean(values)) for name, values in found.items()}


def _off(path: np.ndarray, truth: np.ndarray) -> float:
    return 1000 * float(np.linalg.norm(path - truth, axis=1).mean())


def main() -> int:
    """Prints the tables."""
    need_people()
    begin, takes = perf_counter(), {name: take_of(name) for name in TAKES}
    with threadpool_limits(1, user_api="blas"):
        for at_once in AT_ONCE:
            print(f"\n{at_once} missing at once, mean error in mm\n")
            rows = [row for seconds in SECONDS for row in _rows(takes, seconds, at_once)]
            print(markdown(["gap", "takes", *PEERS, "auto", "auto expected", "by take"], rows), flush=True)
    print(f"\n{perf_counter() - begin:.0f} s, {process_time():.0f} s of a core")
    return 0


def _rows(takes: dict, seconds: float, at_once: int) -> list[list[str]]:
    means = {}
    for name, (xyz, rate) in takes.items():
        found = [errors(xyz, rate, *cut) for cut in cuts(xyz, round(seconds * rate), AT_ONCE[at_once], at_once)]
        means[name] = {key: float(np.mean([one[key] for one in found])) for key in found[0]}
    rows = []
    for label, names in GROUPS.items():
        whole = {key: np.mean([means[name][key] for name in names]) for key in means[names[0]]}
        each = ", ".join(f"{name} {means[name]['auto']:.2g}" for name in names)
        rows.append([f"{seconds:g} s", label, *(f"{value:.2f}" for value in whole.values()), each])
    return rows


if __name__ == "__main__":
    sys.exit(main())
