# SPDX-License-Identifier: GPL-3.0-or-later
"""A gap filled by the model's body, posed on the markers that are there."""

from dataclasses import dataclass

import numpy as np

from ..body.bodies import Bodies, BodyModel
from ..body.prior import Prior
from ..data.markersets import MarkerSet
from ..data.takes import evenly_spread
from ..posing.posing import POSING, fit_subject, pose_subject
from .gaps import Gap, KnownMarkers


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
        model = BodyModel(markerset)
        points = _of_model(take.xyz, columns)
        count = np.isfinite(points[..., 0]).sum(axis=1)
        enough = np.flatnonzero(count >= max(POSING.min_markers, count.max() // 2))
        if not len(enough):
            return None
        prior = Prior(model)
        subject = fit_subject(model, points[enough[evenly_spread(len(enough), POSING.subject_frames)]], prior)
        return cls(model, subject.pick(slice(0, 1)), prior, columns)

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
        posed = self.model.pose(pose_subject(self.model, self.subject, points, self.prior))
        path, turn = posed.markers[:, found[0]], posed.rotations[:, self.model.attachment[found[0]]]
        off = [turn[end - part.start].T @ (take.xyz[end, gap.marker] - path[end - part.start]) for end in ends]
        inner = slice(gap.start - part.start, gap.stop - part.start)
        carried = np.broadcast_to(gap.led(off), (len(gap), 3))
        return path[inner] + np.einsum("fij,fj->fi", turn[inner], carried)


def _of_model(xyz: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Markers (T, M of the model, 3) in the model's order; NaN where the take has none."""
    return np.where((columns >= 0)[:, None], xyz[:, columns], np.nan)
