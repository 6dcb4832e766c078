# SPDX-License-Identifier: GPL-3.0-or-later
"""Learning a marker set from labelled takes of people: the mean body, its markers, and how people and poses spread.

Every person is fitted with a body of their own, each joint and marker free to sit anywhere near the mean; the mean is
then taken anew, and so on. Sides are made alike by adding everybody's mirror image.
"""

from dataclasses import dataclass, replace

import numpy as np

from . import rotations
from .anatomy import LOWER_SEGMENTS, MARKERS, SETS, WHOLE_SEGMENTS, other_side
from .body import Bodies, BodyModel
from .fit import fit_body
from .markersets import Capsules, MarkerSet, Skeleton, Spread
from .posing import aligned, baked, descend_subject, point_pull
from .prior import Prior

ROUNDS = 3
NOISE = 0.005  # m; smaller than when posing, so that people's own offsets are hardly drawn to the mean
MARKER_SD = 0.03  # heights, how freely a person's markers may sit
POSE_SD = 0.6  # rad, while learning nothing is known of poses
MOST_MODES = 8
LEAST_MARKER_SD = 0.006  # heights
FEW_PEOPLE = 1.2  # spreads seen on a handful of people are smaller than the truth
POSE_SHRINKAGE = 0.1  # of the pose covariance towards its own diagonal
LEAST_HEIGHT_SD = 0.2  # m; people are 1.1 to 2.0 m tall, whoever was recorded
MIRROR = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Person:
    """What was recorded of one person.

    name      for the record
    names     P point names, markers and joint centres, without the subject's prefix
    points    (T, P, 3) m, z up, floor at 0; NaN where missing
    standing  (T,) True where the person stands still, facing anywhere
    stature   m, or None where it was not measured
    """

    name: str
    names: tuple[str, ...]
    points: np.ndarray
    standing: np.ndarray
    stature: float | None = None

    def of(self, names) -> np.ndarray:
        """(T, len(names), 3) the points of these names, NaN where the person has none."""
        found = np.full((len(self.points), len(names), 3), np.nan)
        for index, name in enumerate(names):
            if name in self.names:
                found[:, index] = self.points[:, self.names.index(name)]
        return found


@dataclass(frozen=True, eq=False)
class Study:
    """People fitted with bodies of one skeleton, on all markers that are known of.

    segments   the table's rows; markers the M marker rows
    people     N
    stature    (N,) m
    bodies     per person, the posed frames
    offsets    (N, J + M, 3) of joints then markers, each person's own, heights, axes of the shared rest pose
    has        (N, J + M) False where a person's takes do not show the marker
    bends      per person (T, J, 3) rotation vectors against the rest pose
    residual   (N, M, 3) root mean square of what the person's own body leaves, m; NaN where not shown
    """

    segments: tuple
    markers: tuple
    people: tuple[Person, ...]
    stature: np.ndarray
    offsets: np.ndarray
    has: np.ndarray
    bends: list
    residual: np.ndarray


def learn(people: list[Person], set_name: str) -> MarkerSet:
    """The built-in marker set `set_name`, learned from these people.

    Raises ValueError when they lack what it takes: a standing take with joint centres, every marker in somebody's take.
    """
    return markerset_of(study(people, whole_body=SETS[set_name].whole_body), set_name)


def study(people: list[Person], whole_body: bool) -> Study:
    """Fits everybody with a body of their own; about half a second a person and round for 40 frames each."""
    segments = WHOLE_SEGMENTS if whole_body else LOWER_SEGMENTS
    carried = {site.name for site in segments}
    markers = tuple(site for site in MARKERS if site.segment in carried)
    mean = _template(people, segments, markers)
    names = [site.name for site in markers]
    data = [person.of(names) for person in people]
    has = np.array([[True] * len(segments) + list(np.isfinite(points[..., 0]).any(axis=0)) for points in data])
    has[:, len(segments) :] |= ~has[:, len(segments) :].any(axis=0)
    fits: list[Bodies | None] = [None] * len(people)
    for _ in range(ROUNDS):
        model = _free_model(segments, markers, mean)
        fits = [_fit_person(model, mean, *row) for row in zip(data, people, fits, strict=True)]
        offsets = np.array([_settled(model, fit) for fit in fits])
        mean = _symmetric_mean(offsets, has, segments, markers)
        fits = [_rebased(model, fit, mean) for fit in fits]
    return _in_rest_pose(_free_model(segments, markers, mean), people, data, fits, offsets, has, segments, markers)


def _template(people, segments, markers) -> np.ndarray:
    """(J + M, 3) a first mean body, from where markers and joint centres are while people stand."""
    names = [name for site in segments for name in site.landmarks] + [site.name for site in markers]
    clouds = [cloud for person in people if (cloud := _standing_cloud(person, names)) is not None]
    if not clouds:
        raise ValueError("nobody stands still in these takes; a standing take with both ASIS markers was expected")
    mirrored = [cloud[[names.index(other_side(name)) for name in names]] * MIRROR for cloud in clouds]
    where = {name: _mean_known([cloud[index] for cloud in clouds + mirrored]) for index, name in enumerate(names)}
    for site in markers:
        if site.mix and not np.isfinite(where[site.name]).all():
            where[site.name] = _mixed(site, where)
    places = {}
    for site in segments:
        places[site.name] = where[site.landmarks[0]] if site.landmarks else _mixed(site, where)
    joints = np.array([places[site.name] for site in segments])
    joints[0, :2] = 0
    positions = np.array([where[site.name] for site in markers])
    missing = [site.name for site, ok in zip((*segments, *markers), np.isfinite([*joints, *positions]).all(axis=1), strict=True) if not ok]
    if missing:
        raise ValueError(f"no standing take shows {' '.join(missing)}")
    parents, attachment = _tree(segments, markers)
    return np.concatenate([joints - np.where(parents[:, None] >= 0, joints[parents], 0), positions - joints[attachment]])


def _standing_cloud(person: Person, names) -> np.ndarray | None:
    """(P, 3) mean of the standing frames in model axes about the hips, heights; None when there is nothing to go by."""
    frames = person.of([*names, "LASI", "RASI"])[person.standing]
    stature = person.stature or _guessed_stature(person)
    if not len(frames) or not np.isfinite(frames[:, -2:]).all(axis=(1, 2)).any() or stature is None:
        return None
    cloud = np.nanmedian(frames, axis=0) / stature
    left = cloud[-2] - cloud[-1]
    yaw = np.arctan2(-left[0], left[1])
    turned = cloud @ rotations.quaternion_to_matrix(rotations.about_z(-yaw)).T
    hips = [index for index, name in enumerate(names) if name in {"LHJC", "RHJC"}]
    middle = turned[hips].mean(axis=0) if hips else turned[-2:].mean(axis=0)
    return turned[:-2] - [middle[0], middle[1], 0]


def _guessed_stature(person: Person) -> float | None:
    """Stature from the head markers while standing: they sit at 0.941 of it (ten people of known stature)."""
    heads = person.of(["LFHD", "RFHD", "LBHD", "RBHD"])[person.standing][..., 2]
    return float(np.nanmedian(heads)) / 0.941 if np.isfinite(heads).any() else None


def _mixed(site, where) -> np.ndarray:
    lift = np.array(site.lift)
    if site.name.endswith(".R") or (site.name[0] == "R" and site.name not in {"RBAK"}):
        lift = lift * MIRROR
    return sum(share * where[name] for name, share in site.mix) + lift


def _mean_known(values) -> np.ndarray:
    known = [value for value in values if np.isfinite(value).all()]
    return np.mean(known, axis=0) if known else np.full(3, np.nan)


def _tree(segments, markers) -> tuple[np.ndarray, np.ndarray]:
    names = [site.name for site in segments]
    parents = np.array([-1 if site.parent is None else names.index(site.parent) for site in segments])
    return parents, np.array([names.index(site.segment) for site in markers])


def _mirror_order(segments, markers) -> np.ndarray:
    """(J + M,) where each joint's and marker's mirror image is."""
    names = [site.name for site in (*segments, *markers)]
    return np.array([names.index(other_side(name)) for name in names])


def _free_model(segments, markers, mean: np.ndarray) -> BodyModel:
    """A body whose every joint and marker may move on its own, a mode an axis; the root's joint may not."""
    parents, attachment = _tree(segments, markers)
    joints = len(segments)
    sd = np.array([site.sd for site in segments[1:]] + [MARKER_SD] * len(markers))
    modes = np.zeros((3 * len(sd), len(mean), 3))
    item, axis = np.divmod(np.arange(3 * len(sd)), 3)
    modes[np.arange(len(modes)), item + 1, axis] = sd[item]
    covariance = np.kron(np.diag([0.0] + [1.0] * (joints - 1)), np.eye(3)) * POSE_SD**2
    spread = Spread(1.6, 0.2, modes, np.full(len(markers), 0.01), np.zeros((joints, 3)), covariance)
    return BodyModel(
        MarkerSet(
            name="free",
            description="",
            markers=tuple(site.name for site in markers),
            aliases={},
            skeleton=Skeleton(tuple(site.name for site in segments), parents, mean[:joints]),
            attachment=attachment,
            offsets=mean[joints:],
            capsules=Capsules(np.zeros(0, dtype=int), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)),
            spread=spread,
            source={},
        )
    )


def _mode_sd(model: BodyModel) -> np.ndarray:
    """(J + M - 1,) the standard deviations that `_free_model` gave."""
    return model.modes.sum(axis=0)[1:, 0]


def _fit_person(model: BodyModel, points: np.ndarray, person: Person, before: Bodies | None) -> Bodies:
    """The person's own body, posed in every frame, with the measured stature or else a free one."""
    stature = person.stature or _guessed_stature(person)
    known = {"height": stature, "height_sd": 0.005} if stature else {"height": 1.7, "height_sd": 0.15}
    loose = {"bend_floor": 0.1, "stretch_sd": 1e-3, **known}
    prior = Prior(model, **loose)
    if before is not None:
        return descend_subject(model, before, points, prior, 4, NOISE)
    mean = BodyModel(baked(model, model.rest()))
    start = fit_body(mean, aligned(mean, points, prior), point_pull(points), 12, Prior(mean, **loose)).bodies
    scale = np.full_like(start.scale, np.median(start.scale))
    start = replace(start, scale=scale, shape=np.zeros((len(points), len(model.modes))))
    return descend_subject(model, start, points, prior, 6, NOISE)


def _settled(model: BodyModel, fit: Bodies, person: Person) -> tuple[np.ndarray, float]:
    """The person's own offsets (J + M, 3), heights, and the stature, m."""
    size = float(fit.scale[0].mean())
    stature = person.stature or _guessed_stature(person) or size
    return model.shaped_offsets(fit.pick(slice(0, 1)))[0] * (size / stature), stature


def _rebased(model: BodyModel, fit: Bodies, offsets: np.ndarray, stature: float, mean: np.ndarray) -> Bodies:
    """The same body told against a new mean."""
    shape = ((offsets - mean)[1:] / _mode_sd(model)[:, None]).ravel()
    return replace(fit, shape=np.tile(shape, (len(fit), 1)), scale=np.full_like(fit.scale, stature))


def _symmetric_mean(offsets: np.ndarray, has: np.ndarray, order: np.ndarray) -> np.ndarray:
    """(J + M, 3) mean over people and their mirror images, each item over those who show it."""
    both = np.concatenate([offsets, offsets[:, order] * MIRROR])
    shown = np.concatenate([has, has[:, order]])
    alone = order == np.arange(len(order))
    return np.where(shown[..., None], both, 0).sum(axis=0) / shown.sum(axis=0)[:, None] * np.where(alone, 1, 1)[:, None]
