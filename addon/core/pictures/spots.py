# SPDX-License-Identifier: GPL-3.0-or-later
"""Bright round spots in a grey picture: what a camera with a ring of light, or a lit marker, shows of a take.

Pixels brighter than a threshold that touch each other are a spot; its place is their mean, weighted by how much
brighter than the background they are. (x, y) of the middle of the first pixel, upper left, is (0, 0).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..data.takes import MEDIAN_SD

PIXEL_VARIANCE = 1 / 12  # px²: of an evenly bright pixel about its middle


@dataclass(frozen=True)
class SpotOptions:
    """What is a spot. Measured on discs drawn in noise, and on the demo's markers as Blender renders them."""

    # a pixel of a spot is brighter than this, 0 to 1; None where the pictures are to show it
    threshold: float | None = None
    # of the way from the background to the brightest, where the threshold lies then; measured: above lit walls and
    # below small spots, which movies blur to less than half
    peak_share: float = 0.3  # measured
    # standard deviations of the noise that it lies above the background at least; physical: one pixel in a billion
    noises: float = 6.0  # physical
    # brightness above the background at least; measured: movies have blocks that are not quite black
    min_contrast: float = 0.06  # measured
    min_area: float = 2.0  # px²; physical: less is noise, or a marker so far off that its middle says little
    max_area: float = 600.0  # px²; physical: more is a lamp or a window
    # shortest over longest diameter; physical: less is an edge, or the light of something long
    min_roundness: float = 0.4  # physical
    # spots below it are looked at for two peaks; physical: two that touch are half as wide as long
    split_roundness: float = 0.8  # physical
    # and spots this many times larger than half of them; physical: two that touch are twice as large
    split_size: float = 1.6  # physical
    # px of blur for a spot 1 px in half its width; measured: a flat top has its peak in its middle then
    split_blur: float = 0.4  # measured
    # of the lower of two peaks, below which it is dark between two spots; measured on discs that touch
    split_dip: float = 0.95  # measured


@dataclass(frozen=True)
class Brightness:
    """What is dark and what is bright in a camera's pictures, 0 to 1."""

    background: float  # of most of the picture
    threshold: float  # a pixel of a spot is brighter


@dataclass(frozen=True, eq=False)
class Spots:
    """N spots of a picture, from the top down."""

    xy: np.ndarray  # (N, 2) px
    area: np.ndarray  # (N,) px², as of an evenly bright spot with the same brightest pixel
    roundness: np.ndarray  # (N,) shortest over longest diameter, 0 to 1

    def __len__(self) -> int:
        return len(self.area)


def brightness_of(pictures: Sequence[np.ndarray], options: SpotOptions) -> Brightness:
    """Background and threshold of a camera by some of its pictures (H, W), from 0 to 1."""
    middles = [float(np.median(picture)) for picture in pictures]
    noises = [MEDIAN_SD * float(np.median(np.abs(one - own))) for one, own in zip(pictures, middles, strict=True)]
    background = float(np.median(middles))
    if options.threshold is not None:
        return Brightness(min(background, options.threshold), options.threshold)
    above = max(
        options.peak_share * (float(np.median([float(picture.max()) for picture in pictures])) - background),
        options.noises * float(np.median(noises)),
        options.min_contrast,
    )
    return Brightness(background, background + above)


def find_spots(picture: np.ndarray, brightness: Brightness, options: SpotOptions) -> Spots:
    """The spots of a grey picture (H, W), row 0 at the top, 0 to 1.

    What touches the picture's edge is left out, as nobody knows where its middle is.
    """
    from scipy import ndimage

    part, count = ndimage.label(picture > brightness.threshold, np.ones((3, 3)))
    if not count:
        return Spots(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    pixels = _with_rim(part, picture, brightness.background)
    found = _measured(pixels, count)
    cut = np.zeros(count, bool)
    last = np.array(picture.shape[::-1]) - 1
    cut[pixels.owner[((pixels.xy == 0) | (pixels.xy == last)).any(axis=1)]] = True
    pixels, parts = _split(pixels, found, cut, options)
    if parts > count:
        found, cut = _measured(pixels, parts), np.append(cut, np.zeros(parts - count, bool))
    kept = ~cut & (found.area >= options.min_area) & (found.area <= options.max_area)
    kept &= found.roundness >= options.min_roundness
    chosen = np.flatnonzero(kept)
    chosen = chosen[np.lexsort((found.xy[chosen, 0], found.xy[chosen, 1]))]
    return Spots(found.xy[chosen], found.area[chosen], found.roundness[chosen])


@dataclass(frozen=True, eq=False)
class _Pixels:
    """The P pixels of all spots: whose they are (P,), where (P,), and how much brighter than the background (P,)."""

    owner: np.ndarray
    row: np.ndarray
    column: np.ndarray
    weight: np.ndarray

    @property
    def xy(self) -> np.ndarray:
        return np.column_stack([self.column, self.row]).astype(float)


def _with_rim(part: np.ndarray, picture: np.ndarray, background: float) -> _Pixels:
    """The pixels of spots (H, W), 1 to N, with the darker ones around them, without which middles lean to the grid.

    A pixel between two spots goes to the one whose pixel beside it is brighter.
    """
    row, column = np.nonzero(part)
    steps = np.array([(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1)])
    rows, columns = (row[:, None] + steps[:, 0]).ravel(), (column[:, None] + steps[:, 1]).ravel()
    owner = np.repeat(part[row, column], len(steps))
    own = np.tile((steps == 0).all(axis=1), len(row))
    bright = np.where(own, np.inf, np.repeat(picture[row, column].astype(float), len(steps)))
    there = (rows >= 0) & (rows < part.shape[0]) & (columns >= 0) & (columns < part.shape[1])
    rows, columns, owner, bright = rows[there], columns[there], owner[there], bright[there]
    place = rows * part.shape[1] + columns
    order = np.lexsort((-bright, place))
    place, first = np.unique(place[order], return_index=True)
    row, column = np.divmod(place, part.shape[1])
    weight = np.maximum(picture[row, column].astype(float) - background, 0.0)
    return _Pixels(owner[order][first] - 1, row, column, weight)


def _measured(pixels: _Pixels, count: int) -> Spots:
    """Place, area and roundness of each of `count` spots."""
    owner, weight, xy = pixels.owner, pixels.weight, pixels.xy
    total = np.maximum(np.bincount(owner, weight, count), np.finfo(float).tiny)
    middle = np.column_stack([np.bincount(owner, weight * along, count) for along in xy.T]) / total[:, None]
    brightest = np.full(count, np.finfo(float).tiny)
    np.maximum.at(brightest, owner, weight)
    x, y = (xy - middle[owner]).T
    xx, yy, xy2 = (np.bincount(owner, weight * term, count) / total for term in (x * x, y * y, x * y))
    half, lean = (xx + yy) / 2 + PIXEL_VARIANCE, np.hypot((xx - yy) / 2, xy2)
    roundness = np.sqrt(np.maximum(half - lean, 0.0) / (half + lean))
    return Spots(middle, total / brightest, roundness)


def _split(pixels: _Pixels, found: Spots, cut: np.ndarray, options: SpotOptions) -> tuple[_Pixels, int]:
    """The pixels with a number for each part of the spots that show several peaks, and how many parts there are."""
    count, owner = len(found), pixels.owner.copy()
    usual = float(np.median(found.area[found.area >= options.min_area], axis=None)) if len(found) else 0.0
    odd = (found.roundness < options.split_roundness) | (found.area > options.split_size * usual)
    odd &= ~cut & (found.area >= 2 * options.min_area) & (found.area <= 4 * options.max_area)
    order = np.argsort(owner, kind="stable")
    ends = np.searchsorted(owner[order], np.arange(count + 1))
    for spot in np.flatnonzero(odd):
        own = order[ends[spot] : ends[spot + 1]]
        width = np.sqrt(min(found.area[spot] * found.roundness[spot], usual) / np.pi)
        which = _parts(pixels.xy[own], pixels.weight[own], options.split_blur * width, options.split_dip)
        owner[own[which > 0]] = count + which[which > 0] - 1
        count += int(which.max())
    return replace(pixels, owner=owner), count


def _parts(xy: np.ndarray, weight: np.ndarray, blur: float, dip: float) -> np.ndarray:
    """(P,) which peak each pixel (P, 2) of a spot belongs to, from 0; all 0 where there is one."""
    from scipy import ndimage

    low = xy.min(axis=0).astype(int) - 2
    column, row = (xy.astype(int) - low).T
    bright = np.zeros((row.max() + 3, column.max() + 3))
    bright[row, column] = weight
    bright = ndimage.gaussian_filter(bright, blur, mode="constant")
    # A hair of slope, so that of two neighbours equally bright one is the peak.
    bright += 1e-9 * bright.max() * np.arange(bright.size).reshape(bright.shape) / bright.size
    peaks = np.argwhere((bright == ndimage.maximum_filter(bright, 3)) & (bright > dip * bright.max() / 3))
    peaks = peaks[np.argsort(-bright[tuple(peaks.T)])]
    kept: list[np.ndarray] = []
    for peak in peaks:
        if all(_darkest(bright, peak, other) < dip * bright[tuple(peak)] for other in kept):
            kept.append(peak)
    middles = np.array(kept)[:, ::-1] + low
    for _ in range(3):  # from the peaks to the middles of what is nearest to each
        which = np.argmin(((xy[:, None] - middles) ** 2).sum(axis=2), axis=1)
        total = np.maximum(np.bincount(which, weight, len(middles)), np.finfo(float).tiny)
        middles = np.column_stack([np.bincount(which, weight * along, len(middles)) for along in xy.T]) / total[:, None]
    return which


def _darkest(bright: np.ndarray, one: np.ndarray, other: np.ndarray) -> float:
    """The least brightness on the line between two pixels (row, column)."""
    from scipy import ndimage

    steps = 2 * int(np.abs(one - other).max()) + 1
    line = np.linspace(one, other, steps)
    return float(ndimage.map_coordinates(bright, line.T, order=1).min())
