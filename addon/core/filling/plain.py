# SPDX-License-Identifier: GPL-3.0-or-later
"""The usual ways to fill a gap: spline, pattern of a neighbour, rigid body of the segment, PCA of the take, the body.

Each but the last is a function of the markers, the gap, the neighbours (markers known all through it, those that move
most like it first) and `own`, the frames (T,) whose samples of the marker may be looked at. It gives positions (L, 3),
m, or None where it cannot say any. A gap at the start or end of the take has one end only.
"""

from dataclasses import dataclass

import numpy as np

from ..body.bodies import Bodies, BodyModel
from ..body.prior import Prior
from ..data.lanes import PACKING
from ..data.markersets import MarkerSet
from ..data.takes import evenly_spread
from ..geometry.rigid import MIN_POINTS, laid_on
from ..posing.finer import finer, without
from ..posing.posing import POSING, pose_subject, subject_of
from .gaps import LEARNED_BY, Gap, KnownMarkers

SPLINE_SIDE = 8  # measured: frames at either side of a gap that a spline goes through; 4 err as much
PCA_SHARE = 0.9999  # measured: of the variance that components are kept for; 0.999 errs as much
SLOPE = 2  # frames at either side that a cubic spline has its slopes from; of fewer the shape is kept


def spline(take: KnownMarkers, gap: Gap, _: np.ndarray, own: np.ndarray) -> np.ndarray | None:
    """A cubic spline through the frames around; shape-preserving where they are too few. Never beyond them."""
    from scipy.interpolate import CubicSpline, PchipInterpolator

    before = np.flatnonzero(own[: gap.start])[-SPLINE_SIDE:]
    after = gap.stop + np.flatnonzero(own[gap.stop :])[:SPLINE_SIDE]
    if not len(before) or not len(after):
        return None
    at = np.r_[before, after]
    cubic = min(len(before), len(after)) >= SLOPE
    curve = (CubicSpline if cubic else PchipInterpolator)(at, take.xyz[at, gap.marker])
    return curve(gap.frames)


def pattern(take: KnownMarkers, gap: Gap, neighbours: np.ndarray, own: np.ndarray) -> np.ndarray | None:
    """The path of the neighbour that moves most like the marker, led to both ends."""
    if not len(neighbours):
        return None
    return _joined(take.xyz[take.window(gap), neighbours[0]], take, gap, own)


def rigid(take: KnownMarkers, gap: Gap, neighbours: np.ndarray, own: np.ndarray) -> np.ndarray | None:
    """Carried by the neighbours as by a rigid body (Kabsch), from either end; the two are blended."""
    group = neighbours[: LEARNED_BY.of_axes]
    if len(group) < MIN_POINTS:
        return None
    part = take.window(gap)
    around, inner = take.xyz[part][:, group], slice(gap.start - part.start, gap.stop - part.start)
    carried = []
    for end in gap.ends(own):
        turn, place = laid_on(take.xyz[end, group], around)
        carried.append((turn @ take.xyz[end, gap.marker] + place)[inner])
    return gap.led(carried) if carried else None


def pca(take: KnownMarkers, gap: Gap, neighbours: np.ndarray, own: np.ndarray) -> np.ndarray | None:
    """The principal components of the marker and its neighbours, found in each frame by these; ends joined.

    (Federolf, A novel approach to solve the "missing marker problem" in marker-based motion analysis that exploits the
    segment coordination patterns, 2013; Gløersen and Federolf 2016.)
    """
    part = take.window(gap)
    # In a trial there may be others missing than in the gap that it stands for.
    neighbours = neighbours[np.isfinite(take.xyz[part][:, neighbours, 0]).all(axis=0)]
    rows = np.flatnonzero(own & np.isfinite(take.xyz[:, neighbours, 0]).all(axis=1))
    if len(rows) < LEARNED_BY.min_frames or len(neighbours) < MIN_POINTS:
        return None
    rows = rows[evenly_spread(len(rows), PACKING.spread_out)]
    seen, middle = _about_middle(take.xyz[rows][:, neighbours])
    whole = np.concatenate([seen, take.xyz[rows, gap.marker] - middle], axis=1)
    mean = whole.mean(axis=0)
    values, axes = np.linalg.eigh((whole - mean).T @ (whole - mean))
    values = np.maximum(values[::-1], 0)
    kept = 1 + int(np.searchsorted(np.cumsum(values), PCA_SHARE * values.sum()))
    axes = axes[:, ::-1][:, :kept]
    around, middle = _about_middle(take.xyz[part][:, neighbours])
    weights = np.linalg.lstsq(axes[:-3], (around - mean[:-3]).T, rcond=None)[0]
    return _joined((axes[-3:] @ weights).T + mean[-3:] + middle, take, gap, own)


def _about_middle(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (T, N, 3) about their middle as rows (T, 3 N), and the middle (T, 3)."""
    middle = points.mean(axis=1)
    return (points - middle[:, None]).reshape(len(points), -1), middle


def _joined(path: np.ndarray, take: KnownMarkers, gap: Gap, own: np.ndarray) -> np.ndarray | None:
    """A path (W, 3) over the gap's window moved so that it meets the marker at the ends, in between linearly."""
    part, ends = take.window(gap), gap.ends(own)
    if not ends:
        return None
    off = [take.xyz[end, gap.marker] - path[end - part.start] for end in ends]
    return path[gap.start - part.start : gap.stop - part.start] + gap.led(off)


@dataclass(frozen=True, eq=False)
class FittedSubject:
    """The subject of a take as a body of the model.

    columns (M of the model,) the take's index of each of the model's markers, -1 where it has none
    """

    model: BodyModel
    subject: Bodies
    prior: Prior
    columns: np.ndarray

    @classmethod
    def of(cls, markerset: MarkerSet, columns: np.ndarray, take: KnownMarkers) -> "FittedSubject | None":
        """The body that fits a take best; None where no frame has enough of the model's markers."""
        model = BodyModel(finer(markerset))
        prior = Prior(model)
        try:
            return cls(model, subject_of(model, _of_model(take.xyz, columns), prior), prior, columns)
        except ValueError:
            return None

    def fill(self, take: KnownMarkers, gap: Gap, own: np.ndarray) -> np.ndarray | None:
        """Positions (L, 3) m where the body carries the marker, led to the ends in the axes of its segment.

        The body is posed without the marker in all of the gap and its ends. None where the model has no such marker, a
        frame too few others, or the gap no end.
        """
        found = np.flatnonzero(self.columns == gap.marker)
        part = take.window(gap)
        ends = gap.ends(own)
        if not len(found) or not ends:
            return None
        points = _of_model(take.xyz[part], self.columns)
        points[:, found[0]] = np.nan
        if np.isfinite(points[..., 0]).sum(axis=1).min() < POSING.min_markers:
            return None
        markerset = without(self.model.markerset, found[0])
        model = self.model if markerset is self.model.markerset else BodyModel(markerset)
        posed = model.pose(pose_subject(model, self.subject, points, self.prior))
        path, turn = posed.markers[:, found[0]], posed.rotations[:, self.model.attachment[found[0]]]
        off = [turn[end - part.start].T @ (take.xyz[end, gap.marker] - path[end - part.start]) for end in ends]
        inner = slice(gap.start - part.start, gap.stop - part.start)
        carried = np.broadcast_to(gap.led(off), (len(gap), 3))
        return path[inner] + np.einsum("fij,fj->fi", turn[inner], carried)


def _of_model(xyz: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Markers (T, M of the model, 3) in the model's order; NaN where the take has none."""
    return np.where((columns >= 0)[:, None], xyz[:, columns], np.nan)
