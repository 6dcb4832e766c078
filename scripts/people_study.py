# SPDX-License-Identifier: GPL-3.0-or-later
"""Learning a marker set from labelled takes of people: the mean body, its markers, and how people and poses spread.

Every person is fitted with a body of their own, each joint and marker free to sit anywhere near the mean; the mean is
then taken anew, and so on. Sides are made alike by adding everybody's mirror image.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from addon.core.body.bodies import Bodies, BodyModel
from addon.core.body.prior import Prior
from addon.core.body.sides import MIRROR, UNPAIRED, is_right, other_side
from addon.core.data.markersets import Capsules, MarkerSet, Skeleton, Spread
from addon.core.geometry import rotations
from addon.core.geometry.rigid import best_turns
from addon.core.papers.virtual_occlusions.fit import fit_body
from addon.core.posing.posing import aligned, baked, descend_subject, labelled_pull
from addon.core.training.poses import mirrored_poses, posed_bodies
from addon.core.training.segments import distance_to_axis
from addon.core.training.takes import most_different
from scripts.anatomy import (
    LOWER_CAPSULES,
    LOWER_SEGMENTS,
    MARKERS,
    SETS,
    WHOLE_CAPSULES,
    WHOLE_SEGMENTS,
    CapsuleSite,
    MarkerSite,
    SegmentSite,
)


@dataclass(frozen=True)
class StudyOptions:
    """How people are fitted with bodies of their own, and how far others may be from them.

    rounds             of fits and a new mean
    marker_sd_m        how far a marker is off its body; smaller than when posing, so that people's own offsets are
                       hardly drawn to the mean
    own_marker_sd      heights, how freely a person's markers may sit
    free_pose_sd_rad   while learning nothing is known of poses
    bend_floor_rad, stretch_sd  of the prior while learning: people's sizes are no stretch
    height_m, height_sd_m  of people of whom it is not known
    known_height_sd_m  of a stature that was measured, or guessed from
    head_share         of the stature is how high head markers sit; measured on the ten people of the McGill recordings
    start_steps, first_steps, more_steps  of the fit with the mean body, of the first free one, of each further one
    max_modes          in which people differ
    min_marker_sd      heights
    few_people_factor  spreads seen on a handful of people are smaller than the truth
    pose_shrinkage     of the pose covariance towards its own diagonal
    min_height_sd_m    people are 1.1 to 2.0 m tall, whoever was recorded
    marker_standoff    heights, from the skin to a marker's centre
    """

    rounds: int = 3
    marker_sd_m: float = 0.005
    own_marker_sd: float = 0.03
    free_pose_sd_rad: float = 0.6
    bend_floor_rad: float = 0.1
    stretch_sd: float = 1e-3
    height_m: float = 1.7
    height_sd_m: float = 0.15
    known_height_sd_m: float = 0.005
    head_share: float = 0.941
    start_steps: int = 12
    first_steps: int = 6
    more_steps: int = 4
    max_modes: int = 8
    min_marker_sd: float = 0.004
    few_people_factor: float = 1.2
    pose_shrinkage: float = 0.1
    min_height_sd_m: float = 0.2
    marker_standoff: float = 0.004


STUDY = StudyOptions()


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


class Layout:
    """The skeleton and markers that a study is about, as arrays.

    names       J segments then M markers
    parents     (J,), attachment (M,) as in `Skeleton` and `MarkerSet`
    mirror      (J + M,) where each item's mirror image is
    has_mirror  (J + M,) False for a marker that sits on one side only
    sd          (J + M - 1,) how freely each item but the root's joint may sit while learning, heights
    """

    def __init__(self, segments: tuple[SegmentSite, ...], markers: tuple[MarkerSite, ...]):
        self.segments, self.markers = segments, markers
        self.joints = len(segments)
        self.names = [site.name for site in (*segments, *markers)]
        self.parents = np.array([-1 if site.parent is None else self.names.index(site.parent) for site in segments])
        self.attachment = np.array([self.names.index(site.segment) for site in markers])
        self.mirror = np.array([self.names.index(other_side(name)) for name in self.names])
        self.has_mirror = np.array([name not in UNPAIRED for name in self.names])
        self.sd = np.array([site.sd for site in segments[1:]] + [STUDY.own_marker_sd] * len(markers))

    @property
    def marker_names(self) -> list[str]:
        """The M markers' names."""
        return self.names[self.joints :]

    @property
    def above(self) -> np.ndarray:
        """(J + M,) the segment in whose axes each offset is; the root's joint is in the model's own."""
        return np.concatenate([np.maximum(self.parents, 0), self.attachment])


@dataclass(frozen=True, eq=False)
class FittedPeople:
    """N people fitted with bodies of one skeleton.

    mean      (J + M, 3) offsets of joints then markers of the mean body in the rest pose, heights
    strays    (N, J + M, 3) how far each person's are from it; has (N, J + M) False where their takes do not show one
    stature   (N,) m
    bends     per person (T, J, 3) rotation vectors against the rest pose
    residual  (N, M, 3) root mean square of what a person's own body leaves, segment axes, m; NaN where not shown
    """

    layout: Layout
    people: tuple[Person, ...]
    mean: np.ndarray
    strays: np.ndarray
    has: np.ndarray
    stature: np.ndarray
    bends: list[np.ndarray]
    residual: np.ndarray


def learn(people: Sequence[Person], set_name: str) -> MarkerSet:
    """The built-in marker set `set_name`, learned from these people in some seconds a person.

    Raises ValueError when nobody stands still, or a marker is in nobody's takes.
    """
    return markerset_of(study(people, whole_body=SETS[set_name].whole_body), set_name)


def study(people: Sequence[Person], whole_body: bool) -> FittedPeople:
    """Fits everybody with a body of their own. Raises ValueError as `learn` does."""
    segments = WHOLE_SEGMENTS if whole_body else LOWER_SEGMENTS
    carried, shown = {site.name for site in segments}, _shown(people)
    layout = Layout(segments, tuple(site for site in MARKERS if site.segment in carried and site.name in shown))
    mean = _template(people, layout)
    data = [person.of(layout.marker_names) for person in people]
    has = np.array([np.isfinite(points[..., 0]).any(axis=0) for points in data])
    has = np.concatenate([np.ones((len(data), layout.joints), dtype=bool), has], axis=1)
    fits: list[Bodies | None] = [None] * len(data)
    for _ in range(STUDY.rounds):
        model = _free_model(layout, mean)
        fits = [_fit_person(model, *row) for row in zip(data, people, fits, strict=True)]
        settled = [_settled(model, *row) for row in zip(fits, people, strict=True)]
        offsets, stature = np.array([row[0] for row in settled]), np.array([row[1] for row in settled])
        mean = _symmetric_mean(offsets, has, mean, layout)
        fits = [_rebased(layout, fit, *row, mean) for fit, row in zip(fits, settled, strict=True)]
    return _in_rest_pose(layout, tuple(people), data, fits, mean, offsets, has, stature)


def _shown(people: Sequence[Person]) -> set[str]:
    """Names of all points that are in anybody's takes, and of their mirror images."""
    shown: set[str] = set()
    for person in people:
        there = np.isfinite(person.points).all(axis=2).any(axis=0)
        shown.update(name for name, is_there in zip(person.names, there, strict=True) if is_there)
    return shown | {other_side(name) for name in shown}


def _template(people: Sequence[Person], layout: Layout) -> np.ndarray:
    """(J + M, 3) a first mean body, from where markers and joint centres are while people stand, heights."""
    landmarks = [name for site in layout.segments for name in site.landmarks]
    names = list(dict.fromkeys([*landmarks, *layout.marker_names, "LHJC", "RHJC"]))
    clouds = [cloud for person in people if (cloud := _standing_cloud(person, names)) is not None]
    if not clouds:
        raise ValueError("nobody stands still in these takes; a standing take with both ASIS markers was expected")
    swapped = [names.index(other_side(name)) for name in names]
    clouds += [cloud[swapped] * MIRROR for cloud in clouds]
    where = {name: _mean_known([cloud[index] for cloud in clouds]) for index, name in enumerate(names)}
    for site in (*layout.segments, *layout.markers):
        if site.name not in where or not np.isfinite(where[site.name]).all():
            known = site.landmarks if isinstance(site, SegmentSite) else ()
            where[site.name] = where[known[0]] if known else _mixed(site, where)
    positions = np.array([where[name] for name in layout.names])
    positions[0, :2] = 0
    missing = [name for name, place in zip(layout.names, positions, strict=True) if not np.isfinite(place).all()]
    if missing:
        raise ValueError(f"no standing take shows {' '.join(missing)} or what stands in for it")
    offsets = positions - positions[layout.above]
    offsets[0] = positions[0]
    return offsets


def _standing_cloud(person: Person, names) -> np.ndarray | None:
    """(P, 3) mean of the standing frames in model axes about the hips, heights; None when there is nothing to go by."""
    frames = person.of([*names, "LASI", "RASI"])[person.standing]
    stature = person.stature or _guessed_stature(person)
    if not len(frames) or not np.isfinite(frames[:, -2:]).all(axis=(1, 2)).any() or stature is None:
        return None
    shown = np.isfinite(frames[..., 0]).any(axis=0)
    cloud = np.full(frames.shape[1:], np.nan)
    cloud[shown] = np.nanmedian(frames[:, shown], axis=0) / stature
    left = cloud[-2] - cloud[-1]
    yaw = np.arctan2(-left[0], left[1])
    turned = cloud @ rotations.quaternion_to_matrix(rotations.about_z(-yaw)).T
    hips = [index for index, name in enumerate(names) if name in {"LHJC", "RHJC"}]
    middle = turned[hips].mean(axis=0) if hips else turned[-2:].mean(axis=0)
    return turned[:-2] - [middle[0], middle[1], 0]


def _guessed_stature(person: Person) -> float | None:
    """Stature from the head markers while standing."""
    heads = person.of(["LFHD", "RFHD", "LBHD", "RBHD"])[person.standing][..., 2]
    return float(np.nanmedian(heads)) / STUDY.head_share if np.isfinite(heads).any() else None


def _mixed(site: SegmentSite | MarkerSite, where: dict[str, np.ndarray]) -> np.ndarray:
    """The point that stands in for a joint or a marker that no take shows; NaN where that is not known either."""
    lift = np.array(site.lift) * (MIRROR if is_right(site.name) else 1)
    if not site.mix:
        return np.full(3, np.nan)
    unknown = np.full(3, np.nan)
    return sum((share * where.get(name, unknown) for name, share in site.mix), np.zeros(3)) + lift


def _mean_known(values) -> np.ndarray:
    known = [value for value in values if np.isfinite(value).all()]
    return np.mean(known, axis=0) if known else np.full(3, np.nan)


def _free_model(layout: Layout, mean: np.ndarray) -> BodyModel:
    """A body whose every joint and marker may move on its own, a mode an axis; the root's joint may not."""
    joints = layout.joints
    modes = np.zeros((3 * len(layout.sd), len(mean), 3))
    item, axis = np.divmod(np.arange(len(modes)), 3)
    modes[np.arange(len(modes)), item + 1, axis] = layout.sd[item]
    covariance = np.kron(np.diag([0.0] + [1.0] * (joints - 1)), np.eye(3)) * STUDY.free_pose_sd_rad**2
    markerset = MarkerSet(
        name="free",
        description="",
        markers=tuple(layout.marker_names),
        aliases={},
        skeleton=Skeleton(tuple(layout.names[:joints]), layout.parents, mean[:joints]),
        attachment=layout.attachment,
        offsets=mean[joints:],
        capsules=Capsules(np.zeros(0, dtype=int), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)),
        spread=Spread(1.6, 0.2, modes, np.zeros(len(layout.markers)), np.zeros((joints, 3)), covariance),
        source={},
    )
    return BodyModel(markerset)


def _fit_person(model: BodyModel, points: np.ndarray, person: Person, before: Bodies | None) -> Bodies:
    """The person's own body, posed in every frame, with the measured stature or else a free one."""
    stature = person.stature or _guessed_stature(person)
    height = stature or STUDY.height_m
    height_sd = STUDY.known_height_sd_m if stature else STUDY.height_sd_m
    loose = {
        "bend_floor": STUDY.bend_floor_rad,
        "stretch_sd": STUDY.stretch_sd,
        "height": height,
        "height_sd": height_sd,
    }
    prior = Prior(model, **loose)
    if before is not None:
        return descend_subject(model, before, points, prior, STUDY.more_steps, STUDY.marker_sd_m)
    mean = BodyModel(baked(model, model.rest()))
    start = fit_body(
        mean, aligned(mean, points, prior), labelled_pull(points), STUDY.start_steps, Prior(mean, **loose)
    ).bodies
    scale = np.full_like(start.scale, np.median(start.scale))
    start = replace(start, scale=scale, shape=np.zeros((len(points), len(model.modes))))
    return descend_subject(model, start, points, prior, STUDY.first_steps, STUDY.marker_sd_m)


def _settled(model: BodyModel, fit: Bodies, person: Person) -> tuple[np.ndarray, float]:
    """The person's own offsets (J + M, 3), heights, and the stature, m."""
    size = float(fit.scale[0].mean())
    stature = person.stature or _guessed_stature(person) or size
    return model.shaped_offsets(fit.pick(slice(0, 1)))[0] * (size / stature), stature


def _rebased(layout: Layout, fit: Bodies, offsets: np.ndarray, stature: float, mean: np.ndarray) -> Bodies:
    """The same body against a new mean."""
    shape = ((offsets - mean)[1:] / layout.sd[:, None]).ravel()
    return replace(fit, shape=np.tile(shape, (len(fit), 1)), scale=np.full_like(fit.scale, stature))


def _with_mirrored(values: np.ndarray, has: np.ndarray, layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """People's (N, J + M, 3) values followed by their mirror images', and which of them are known (2N, J + M)."""
    both = np.concatenate([values, values[:, layout.mirror] * MIRROR])
    return both, np.concatenate([has, has[:, layout.mirror] & layout.has_mirror])


def _symmetric_mean(offsets: np.ndarray, has: np.ndarray, before: np.ndarray, layout: Layout) -> np.ndarray:
    """(J + M, 3) mean over people and their mirror images, each item over those who show it, else as before."""
    both, known = _with_mirrored(offsets, has, layout)
    count = known.sum(axis=0)[:, None]
    return np.where(count > 0, np.where(known[..., None], both, 0).sum(axis=0) / np.maximum(count, 1), before)


def _in_rest_pose(layout, people, data, fits, mean, offsets, has, stature) -> FittedPeople:
    """Everything in axes in which the mean standing pose is the rest pose."""
    model = _free_model(layout, mean)
    posed = [model.pose(fit) for fit in fits]
    rest = _standing_rotations(layout, people, posed)
    turn = rest[layout.above]
    resting = (turn @ mean[..., None])[..., 0]
    resting[0] = [0, 0, _hip_height(people, posed, stature)]
    strays = (turn @ (offsets - mean)[..., None])[..., 0]
    strays[:, 0] = 0
    strays[~has] = 0
    bends, residual = [], []
    for points, one in zip(data, posed, strict=True):
        world = one.rotations @ rest.swapaxes(-1, -2)
        above = world[:, np.maximum(layout.parents, 0)].copy()
        above[:, 0] = world[:, 0]
        bends.append(rotations.rotation_vector(above.swapaxes(-1, -2) @ world))
        left = (world[:, layout.attachment].swapaxes(-1, -2) @ (points - one.markers)[..., None])[..., 0]
        count = np.isfinite(left).sum(axis=0)
        residual.append(np.sqrt(np.where(count, np.nansum(left**2, axis=0) / np.maximum(count, 1), np.nan)))
    return FittedPeople(layout, people, resting, strays, has, stature, bends, np.array(residual))


def _standing_rotations(layout: Layout, people, posed) -> np.ndarray:
    """(J, 3, 3) mean rotation of each segment against the heading while people and their mirror images stand."""
    left, right = (layout.marker_names.index(name) for name in ("LASI", "RASI"))
    total = np.zeros((layout.joints, 3, 3))
    for person, one in zip(people, posed, strict=True):
        if person.standing.any():
            across = (one.markers[:, left] - one.markers[:, right])[person.standing]
            heading = rotations.quaternion_to_matrix(rotations.about_z(-np.arctan2(-across[:, 0], across[:, 1])))
            turned = (heading[:, None] @ one.rotations[person.standing]).mean(axis=0)
            total += turned + turned[layout.mirror[: layout.joints]] * np.outer(MIRROR, MIRROR)
    return best_turns(total)[0]


def _hip_height(people, posed, stature) -> float:
    """Height of the root's joint above the floor while people stand, heights."""
    heights = [
        one.joints[person.standing, 0, 2].mean() / size
        for person, one, size in zip(people, posed, stature, strict=True)
        if person.standing.any()
    ]
    return float(np.mean(heights))


def markerset_of(found: FittedPeople, set_name: str) -> MarkerSet:
    """The built-in marker set `set_name` out of a study. Raises ValueError for a marker that is in nobody's takes."""
    layout, site = found.layout, SETS[set_name]
    joints = layout.joints
    known = {name for name, has in zip(layout.names, found.has.any(axis=0), strict=True) if has}
    absent = [name for name in site.markers if name not in known and other_side(name) not in known]
    if absent:
        raise ValueError(f"no take shows {' '.join(absent)}")
    chosen = np.array([layout.names.index(name) for name in site.markers])
    kept = np.concatenate([np.arange(joints), chosen])
    modes, marker_sd = _shape_spread(found, kept, joints)
    pose_mean, pose_covariance = _pose_spread(found)
    spread = Spread(
        height=float(found.stature.mean()),
        height_sd=float(max(found.stature.std(ddof=1) if len(found.people) > 1 else 0, STUDY.min_height_sd_m)),
        modes=modes,
        marker_sd=marker_sd,
        pose_mean=pose_mean,
        pose_covariance=pose_covariance,
    )
    return MarkerSet(
        name=site.name,
        description=site.description,
        markers=site.markers,
        aliases=dict(site.aliases),
        skeleton=Skeleton(tuple(layout.names[:joints]), layout.parents, found.mean[:joints]),
        attachment=layout.attachment[chosen - joints],
        offsets=found.mean[chosen],
        capsules=_capsules(found, WHOLE_CAPSULES if site.whole_body else LOWER_CAPSULES),
        spread=spread,
        source={
            "people": " ".join(person.name for person in found.people),
            "frames": str(sum(len(person.points) for person in found.people)),
        },
    )


def _shape_spread(found: FittedPeople, kept: np.ndarray, joints: int) -> tuple[np.ndarray, np.ndarray]:
    """Modes (K, J + M, 3) and what they leave over (M,), heights.

    What is left over is measured on people left out of the modes, and the soft tissue's own wobble is added to it.
    """
    both, known = _with_mirrored(found.strays, found.has, found.layout)
    both, known = both[:, kept], known[:, kept]
    both = np.where(known[..., None], both, 0)
    people = len(found.people)
    left = np.zeros((people, len(kept), 3))
    for person in range(people):
        others = np.delete(np.arange(2 * people), [person, person + people])
        left[person] = _beyond(_modes(both[others]), both[person]) if len(others) else both[person]
    shown = known[:people, joints:, None]
    count = np.maximum(3 * shown.sum(axis=(0, 2)), 1)
    over = np.sqrt((np.where(shown, left[:, joints:], 0) ** 2).sum(axis=(0, 2)) / count)
    wobble = np.nanmean(found.residual[:, kept[joints:] - joints] / found.stature[:, None, None], axis=(0, 2))
    return _modes(both), np.maximum(np.hypot(over, wobble), STUDY.min_marker_sd)


def _modes(strays: np.ndarray) -> np.ndarray:
    """(K, J + M, 3) the main modes in which bodies (N, J + M, 3) differ, one standard deviation each."""
    flat = strays.reshape(len(strays), -1)
    _, values, directions = np.linalg.svd(flat, full_matrices=False)
    count = min(STUDY.max_modes, len(flat) // 2)
    sd = values[:count] / np.sqrt(len(flat)) * STUDY.few_people_factor
    return (sd[:, None] * directions[:count]).reshape(count, *strays.shape[1:])


def _beyond(modes: np.ndarray, stray: np.ndarray) -> np.ndarray:
    """What modes (K, J + M, 3) leave of one body's strays (J + M, 3), amounts held to plausible ones."""
    flat = modes.reshape(len(modes), -1)
    amount = np.linalg.solve(flat @ flat.T + STUDY.min_marker_sd**2 * np.eye(len(flat)), flat @ stray.ravel())
    return stray - np.tensordot(amount, modes, axes=1)


def _pose_spread(found: FittedPeople) -> tuple[np.ndarray, np.ndarray]:
    """Mean (J, 3) and covariance (3J, 3J) of the bends of people and their mirror images, standing and moving alike."""
    mirror = found.layout.mirror[: found.layout.joints]
    frames, weights = [], []
    for person, bends in zip(found.people, found.bends, strict=True):
        weight = np.zeros(len(bends))
        for kind in (person.standing, ~person.standing):
            weight[kind] = 1 / max(kind.sum(), 1)
        for one in (bends, bends[:, mirror] * [-1, 1, -1]):
            frames.append(one.reshape(len(one), -1))
            weights.append(weight / weight.sum())
    rows, weight = np.concatenate(frames), np.concatenate(weights) / len(weights)
    mean = weight @ rows
    around = rows - mean
    covariance = (around * weight[:, None]).T @ around
    covariance = (1 - STUDY.pose_shrinkage) * covariance + STUDY.pose_shrinkage * np.diag(np.diag(covariance))
    return mean.reshape(-1, 3), covariance * STUDY.few_people_factor**2


def _capsules(found: FittedPeople, table: tuple[CapsuleSite, ...]) -> Capsules:
    """The table's capsules on the mean body; one that would swallow a marker beside it on its segment is thinned."""
    layout = found.layout
    places = found.mean.copy()
    for index, above in enumerate(layout.above[1:], start=1):
        places[index] += places[above]
    where = dict(zip(layout.names, places, strict=True))
    segment = np.array([layout.names.index(site.segment) for site in table])
    start = np.array([_capsule_end(site.start, site.segment, where) for site in table])
    end = np.array([_capsule_end(site.end, site.segment, where) for site in table])
    radius = np.array([site.radius for site in table])
    for index, site in enumerate(table):
        own = (layout.attachment == segment[index]) & found.has[:, layout.joints :].any(axis=0)
        away = distance_to_axis(found.mean[layout.joints :][own], start[index], end[index])
        beside = away[away > site.radius / 2]
        radius[index] = min(site.radius, beside.min(initial=np.inf) - STUDY.marker_standoff)
    return Capsules(segment, start, end, radius)


def _capsule_end(end, segment: str, where: dict[str, np.ndarray]) -> np.ndarray:
    """One end in the segment's axes from its joint."""
    mix, lift = end
    place = sum(share * where[name] for name, share in mix) + np.array(lift) * (MIRROR if is_right(segment) else 1)
    return place - where[segment]


def with_poses(markerset: MarkerSet, people: Sequence[np.ndarray], count: int) -> MarkerSet:
    """The marker set with the poses (F, J, 3) of these people: their spread, and up to `count` of the most different.

    Everybody counts the same in the spread, and so do their mirror images.
    """
    segments = markerset.skeleton.segments
    everyone = [np.concatenate([one, mirrored_poses(one, segments)]) for one in people]
    rows = np.concatenate(everyone).reshape(-1, 3 * len(segments))
    weight = np.concatenate([np.full(len(one), 1 / len(one)) for one in everyone]) / len(everyone)
    mean = weight @ rows
    covariance = ((rows - mean) * weight[:, None]).T @ (rows - mean)
    mean[:3], covariance[:3], covariance[:, :3] = 0, 0, 0
    pool, model = np.concatenate(people), BodyModel(markerset)
    chosen = pool[most_different(model.pose(posed_bodies(model, pool, markerset.spread.height)).markers, count)]
    spread = replace(markerset.spread, pose_mean=mean.reshape(-1, 3), pose_covariance=covariance, poses=chosen)
    return replace(markerset, spread=spread)
