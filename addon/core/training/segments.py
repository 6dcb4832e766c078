# SPDX-License-Identifier: GPL-3.0-or-later
"""A skeleton for any marker set, found from how its markers move: what keeps its distances is one segment.

For markers of which nothing is known. Segments are groups of markers that move rigidly together; two of them meet in
the point that stays most constant in the axes of both; the likeliest tree of such joints is the skeleton.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..data.markersets import Capsules, MarkerSet, Skeleton, Spread
from ..data.wording import count_of
from ..geometry import rotations
from ..geometry.rigid import MIN_POINTS, centre_of_rotation, in_axes, laid_on, mean_form
from ..points.likelihood.learn import LEARN
from ..points.rigid_bodies.model import distance_tables
from .spread import SPREAD, TAIL_SDS, TAILS, full_frames, some_of


class SEGMENTING:
    """How a skeleton is found from the motion of markers."""

    # of the subject's size: distances that vary less, in the mean over a group, are a segment's
    max_rigid_sd: float = 0.007  # physical: 12 mm of an adult, as skin moves on a bone
    min_flatness: float = 0.05  # of a segment's length; physical: markers nearer to one line do not show how it turns
    # of the highest reach, and of the most markers, has the frame of the rest pose; with 0.9 the joints of a made-up
    # leg are 28 mm off, with 0.98 9 mm, with this 2 mm
    upright: float = 0.95  # measured
    # how strongly a joint is drawn towards the markers of both segments where nothing moves
    joint_pull: float = 0.02  # measured: a quarter of it leaves those joints 8 mm off
    # of the distance from a segment's axis to its markers is body
    body_share: float = 0.8  # physical: they stand off the skin
    min_radius: float = 0.008  # heights, of a capsule; physical: a finger's
    height_sd: float = 0.1  # of the height, that other subjects differ by; physical: adults by 6 %, with children 10 %
    heights_m: tuple[float, float] = (0.3, 3.0)  # of a subject at least and at most; format: of a marker set's file


@dataclass(frozen=True, eq=False)
class Segments:
    """How M markers move in F frames of one or more subjects."""

    # indices of the markers of each of J segments, the root first, parents before children
    members: tuple[tuple[int, ...], ...]
    parents: np.ndarray  # (J,) -1 for the root
    joints: np.ndarray  # (J, 3) where each segment meets its parent in the rest pose; the root's is its middle
    shape: np.ndarray  # (M, 3) the markers in the rest pose
    turns: np.ndarray  # (F, J, 3, 3) rotation of each segment against the rest pose, NaN where too few markers are seen


def segment_markerset(subjects: Sequence[np.ndarray], markers: Sequence[str], name: str) -> MarkerSet:
    """The marker set of labelled frames of each subject, (T, M, 3) m, z up, NaN where missing.

    Raises ValueError when no frame shows three markers.
    """
    scaled, size, height = of_one_size(subjects)
    found = find_segments(scaled)
    joints, shape = found.joints / height, found.shape / height
    sway = _sway(scaled, found) / height
    deviation = max(float(size.std()), SEGMENTING.height_sd * height)
    attachment = np.zeros(len(markers), int)
    for index, group in enumerate(found.members):
        attachment[list(group)] = index
    above = np.where(found.parents[:, None] >= 0, joints[found.parents], 0.0)
    mean, covariance = _bends(found)
    return MarkerSet(
        name=name,
        description=f"{len(markers)} markers on {count_of(len(found.members), 'segment')} found from how they move",
        markers=tuple(markers),
        aliases={},
        skeleton=Skeleton(_names(found, markers), found.parents, joints - above),
        attachment=attachment,
        offsets=shape - joints[attachment],
        capsules=_capsules(found, joints, shape),
        spread=Spread(
            height=height,
            height_sd=deviation,
            modes=np.zeros((0, len(joints) + len(markers), 3)),
            marker_sd=np.maximum(sway, SPREAD.marker_sd),
            pose_mean=mean,
            pose_covariance=covariance,
        ),
        source={},
    )


def of_one_size(subjects: Sequence[np.ndarray]) -> tuple[list[np.ndarray], np.ndarray, float]:
    """Some of the frames of each subject (T, M, 3) m, made as tall as all are in the mean; and how tall, m.

    Of the subjects as they are, (N,), and as they are made. Raises ValueError when no frame shows three markers.
    """
    thinned = [_thinned(points) for points in subjects]
    size = np.array([_height(points) for points in thinned])
    height = float(np.clip(size.mean(), *SEGMENTING.heights_m))
    return [points * (height / one) for points, one in zip(thinned, size, strict=True)], size, height


def find_segments(subjects: Sequence[np.ndarray]) -> Segments:
    """Segments, joints and rest pose from labelled frames of subjects of one size, (T, M, 3) m."""
    clouds = np.concatenate(subjects)
    groups = _groups(subjects)
    rest = _rest_frame(clouds)
    shape = _rest_shape(clouds, groups, rest)
    turns, places = _moves(clouds, groups, shape)
    parents, joints, order = _tree(groups, turns, places, shape)
    members = tuple(tuple(sorted(groups[index])) for index in order)
    middle = np.append(joints[0][:2], shape[:, 2].min())
    return Segments(members, parents, joints - middle, shape - middle, turns[:, order])


def _thinned(points: np.ndarray) -> np.ndarray:
    good = full_frames(points, MIN_POINTS)
    if not len(good):
        raise ValueError("no frame shows three markers or more")
    return some_of(points[good])


def _height(points: np.ndarray) -> float:
    """m, how tall a subject is: as high as its markers reach, or half as far as across where it never stands."""
    reach = np.nanmax(points, axis=1) - np.nanmin(points, axis=1)
    tallest = np.quantile(reach[:, 2], SEGMENTING.upright)  # the highest frame may be a jump's, or a swap's
    return max(float(tallest), float(np.median(np.linalg.norm(reach, axis=1))) / 2, 1e-3)


def _variation(points: np.ndarray) -> np.ndarray:
    """(M, M) m, standard deviation of the distance of each two markers over frames; inf where never seen together."""
    tails = [100 * TAILS, 100 * (1 - TAILS)]
    _, low, high = distance_tables(points, tails, max(min(LEARN.min_frames, len(points)), 1))
    table = np.nan_to_num((high - low) / TAIL_SDS, nan=np.inf)
    np.fill_diagonal(table, 0)
    return table


def _groups(subjects: Sequence[np.ndarray]) -> list[list[int]]:
    """Markers that keep their distances, as lists of indices; each shows how it turns."""
    from scipy.cluster.hierarchy import fcluster, linkage
    from scipy.spatial.distance import squareform

    tables = np.array([_variation(points) for points in subjects])
    seen = np.isfinite(tables)
    worst = float(tables[seen].max(initial=0)) + 1e-9
    table = np.where(seen, tables, 0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    table = np.where(seen.any(axis=0), table, worst)
    table = (table + table.T) / 2
    size = float(np.median([_height(points) for points in subjects]))
    if len(table) < 2 * MIN_POINTS:
        return [list(range(len(table)))]
    found = fcluster(linkage(squareform(table, checks=False), "average"), SEGMENTING.max_rigid_sd * size, "distance")
    groups = [np.flatnonzero(found == number).tolist() for number in np.unique(found)]
    clouds = np.concatenate(subjects)
    whole = [group for group in groups if _shows_turn(clouds, group)]
    if not whole:
        return [list(range(len(table)))]
    for lone in (group for group in groups if group not in whole):
        for marker in lone:
            best = min(whole, key=lambda group: table[marker, group].mean())
            best.append(marker)
    return whole


def _shows_turn(clouds: np.ndarray, group: list[int]) -> bool:
    """Whether a group has markers enough, and off one line."""
    if len(group) < MIN_POINTS:
        return False
    there = clouds[np.isfinite(clouds[:, group]).all(axis=(1, 2))]
    if not len(there):
        return False
    middle = there[len(there) // 2][group]
    spread = np.linalg.svd(middle - middle.mean(axis=0), compute_uv=False)
    return bool(spread[1] > SEGMENTING.min_flatness * spread[0])


def _rest_frame(clouds: np.ndarray) -> int:
    """The most usual frame of those that show most markers and in which they reach highest: the subject stands."""
    seen = np.isfinite(clouds).all(axis=2)
    full = np.flatnonzero(seen.sum(axis=1) >= SEGMENTING.upright * seen.sum(axis=1).max())
    reach = np.nanmax(clouds[full, :, 2], axis=1) - np.nanmin(clouds[full, :, 2], axis=1)
    full = full[reach >= SEGMENTING.upright * reach.max()]
    away = np.linalg.norm(clouds[full] - np.nanmean(clouds[full], axis=1, keepdims=True), axis=2)
    return int(full[np.nansum(np.abs(away - np.nanmedian(away, axis=0)), axis=1).argmin()])


def _rest_shape(clouds: np.ndarray, groups: list[list[int]], rest: int) -> np.ndarray:
    """(M, 3) every group's mean shape, laid where it is in the rest frame."""
    shape = np.full(clouds.shape[1:], np.nan)
    for group in groups:
        own = clouds[:, group]
        seen = np.isfinite(own).all(axis=2).sum(axis=1)
        shape[group] = mean_form(own[rest if seen[rest] >= MIN_POINTS else seen.argmax()], own)
    return shape


def _moves(clouds: np.ndarray, groups, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (F, J, 3, 3) and place (F, J, 3) of every group against the rest pose."""
    parts = [laid_on(shape[group], clouds[:, group]) for group in groups]
    return np.stack([turn for turn, _ in parts], axis=1), np.stack([move for _, move in parts], axis=1)


def _tree(groups, turns: np.ndarray, places: np.ndarray, shape: np.ndarray):
    """Parents, joints (J, 3) and the order of the groups in the likeliest tree."""
    count = len(groups)
    middles = np.array([shape[group].mean(axis=0) for group in groups])
    cost, meet = np.full((count, count), np.inf), np.zeros((count, count, 3))
    for one in range(count):
        for two in range(one + 1, count):
            likely, _ = _nearest(shape[groups[one]], shape[groups[two]])
            point, miss = centre_of_rotation(turns[:, [one, two]], places[:, [one, two]], likely, SEGMENTING.joint_pull)
            away = sum(_nearest(point[None], shape[groups[group]])[1] for group in (one, two))
            cost[one, two] = cost[two, one] = miss + SEGMENTING.joint_pull * away
            meet[one, two] = meet[two, one] = point
    root = _root(groups, cost)
    order, parents, joints = [root], [-1], [middles[root]]
    while len(order) < count:
        open_ = [index for index in range(count) if index not in order]
        parent, child = min(((a, b) for a in order for b in open_), key=lambda pair: cost[pair])
        parents.append(order.index(parent))
        joints.append(meet[parent, child])
        order.append(child)
    return np.array(parents), np.array(joints), order


def _root(groups, cost: np.ndarray) -> int:
    """The group from which the others are fewest joints away, the one with most markers of those."""
    from scipy.sparse.csgraph import minimum_spanning_tree, shortest_path

    # To SciPy neither 0 nor infinity is an edge.
    tree = minimum_spanning_tree(np.clip(cost, np.finfo(float).tiny, np.finfo(float).max))
    farthest = shortest_path(tree, directed=False, unweighted=True).max(axis=1)
    return min(range(len(groups)), key=lambda index: (farthest[index], -len(groups[index])))


def _nearest(one: np.ndarray, two: np.ndarray) -> tuple[np.ndarray, float]:
    """The middle (3,) of the nearest markers of two groups, and how far they are from each other."""
    distance = np.linalg.norm(one[:, None] - two, axis=2)
    first, second = np.unravel_index(distance.argmin(), distance.shape)
    return (one[first] + two[second]) / 2, float(distance.min())


def _sway(subjects: Sequence[np.ndarray], found: Segments) -> np.ndarray:
    """(M,) m, how far subjects' markers sit from the mean's, in the axes of their segments."""
    strays = []
    for points in subjects:
        stray = np.full(found.shape.shape, np.nan)
        for group in map(list, found.members):
            own = in_axes(*laid_on(found.shape[group], points[:, group]), points[:, group])
            stray[group] = np.nanmedian(own, axis=0) - found.shape[group]
        strays.append(stray)
    return np.sqrt(np.nan_to_num(np.nanmean(np.square(strays), axis=0)).mean(axis=1))


def _bends(found: Segments) -> tuple[np.ndarray, np.ndarray]:
    """Mean (J, 3) and covariance (3J, 3J) of the joints' rotation vectors; the root's are zero."""
    above = found.turns[:, np.maximum(found.parents, 0)]
    vectors = rotations.rotation_vector(above.swapaxes(-1, -2) @ found.turns)
    vectors[:, 0] = 0
    flat = vectors.reshape(len(vectors), -1)
    flat = flat[np.isfinite(flat).all(axis=1)]
    joints = len(found.members)
    mean = flat.mean(axis=0) if len(flat) else np.zeros(3 * joints)
    covariance = np.cov(flat.T).reshape(3 * joints, -1) if len(flat) > 1 else np.zeros((3 * joints, 3 * joints))
    covariance[3:, 3:] += SPREAD.bend_sd_rad**2 * np.eye(3 * joints - 3)
    covariance[:3], covariance[:, :3] = 0, 0
    return mean.reshape(-1, 3), covariance


def _capsules(found: Segments, joints: np.ndarray, shape: np.ndarray) -> Capsules:
    """One capsule a segment, from where it begins through its markers to where it ends."""
    start, end, radius = [], [], []
    for index, group in enumerate(found.members):
        own = shape[list(group)]
        children = joints[found.parents == index]
        first = joints[index] if index else own[np.linalg.norm(own - own.mean(axis=0), axis=1).argmax()]
        last = (
            children[np.linalg.norm(children - first, axis=1).argmax()]
            if len(children)
            else (2 * own.mean(axis=0) - first)
        )
        away = distance_to_axis(own, first, last)
        start.append(first - joints[index])
        end.append(last - joints[index])
        radius.append(max(SEGMENTING.body_share * np.median(away), SEGMENTING.min_radius))
    return Capsules(np.arange(len(radius)), np.array(start), np.array(end), np.array(radius))


def distance_to_axis(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(N,) distances of points (N, 3) from the line from start (3,) to end (3,)."""
    line = end - start
    along = np.clip((points - start) @ line / max(line @ line, 1e-12), 0, 1)
    return np.linalg.norm(points - start - along[:, None] * line, axis=1)


def _names(found: Segments, markers: Sequence[str]) -> tuple[str, ...]:
    """A name for each segment, from what its markers' names begin with."""
    names: list[str] = []
    for number, group in enumerate(found.members, 1):
        own = [markers[index] for index in group]
        stem = own[0]
        while not all(name.startswith(stem) for name in own):
            stem = stem[:-1]
        stem = stem.rstrip("_-. 0123456789") if len(own) > 1 else stem
        name = f"{stem} segment" if len(stem) > 1 else f"segment {number}"
        names.append(name if name not in names else f"{name} {number}")
    return tuple(names)
