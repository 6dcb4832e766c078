# SPDX-License-Identifier: GPL-3.0-or-later
"""A model from words alone: which marker sits where on which segment, and no recording of anybody who wears them.

Where a landmark is on people is known from the built-in marker sets; anywhere else is a way along a segment and a side
of it. What the markers do is shown by made-up people, who differ and move as recorded people do.
"""

from collections.abc import Generator, Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from ..body.sides import other_side
from ..data.errors import InputError
from ..data.markersets import Layout, MarkerSet, Site
from ..data.progress import Progress, within
from ..points.likelihood.learn import Trying, in_turn, learning
from ..points.models import Model
from .imagining import anybody
from .poses import known_poses, with_mirrored
from .segments import distance_to_axis

# Landmarks by segment, and the built-in sets' markers that sit there, each with its share; `*` is the side, and a
# negative share leads beyond. One that is `inside` is its reflection at the middle of its segment.
LANDMARKS: dict[str, dict[str, dict[str, float]]] = {
    "head": {
        "front": {"*FHD": 1},
        "back": {"*BHD": 1},
        "forehead": {"LFHD": 0.5, "RFHD": 0.5},
        "temple": {"*FHD": 0.5, "*BHD": 0.5},
        "top": {"ARIEL": 1},
    },
    "thorax": {
        "C7": {"C7": 1},
        "T2": {"C7": 0.8, "T10": 0.2},
        "T10": {"T10": 1},
        "T12": {"C7": -0.2, "T10": 1.2},
        "jugular notch": {"CLAV": 1},
        "sternum": {"CLAV": 0.65, "STRN": 0.35},
        "xiphoid process": {"STRN": 1},
        "shoulder blade": {"*BAK": 1},
        "below the shoulder blade": {"*BAK": 1, "T10": 0.35, "C7": -0.35},
        "acromion": {"*SHO": 1},
        "back of the shoulder": {"*BSH": 1},
        "front of the shoulder": {"*FSH": 1},
    },
    "upper_arm": {"outside": {"*UPA": 1}, "lateral epicondyle": {"*ELB": 1}, "medial epicondyle": {"inside *ELB": 1}},
    "forearm": {"outside": {"*FRM": 1}, "radial styloid": {"*WRA": 1}, "ulnar styloid": {"*WRB": 1}},
    "hand": {"second knuckle": {"*FIN": 1}, "fifth knuckle": {"*OHAND": 1}},
    "pelvis": {
        "ASIS": {"*ASI": 1},
        "PSIS": {"*PSI": 1},
        "sacrum": {"SACR": 1},
        "iliac crest": {"*MWT": 1},
    },
    "thigh": {"outside": {"*THI": 1}, "lateral epicondyle": {"*KNE": 1}, "medial epicondyle": {"inside *KNE": 1}},
    "shank": {"outside": {"*TIB": 1}, "lateral malleolus": {"*ANK": 1}, "medial malleolus": {"inside *ANK": 1}},
    "foot": {
        "heel": {"*HEE": 1},
        "second metatarsal head": {"*TOE": 1},
        # The second is a quarter of the way to the fifth. Of *MT1 four shoes are known, 26 to 53 mm beside *TOE.
        "first metatarsal head": {"*TOE": 1.35, "*MT5": -0.35},
        "fifth metatarsal head": {"*MT5": 1},
        "toe tip": {"*TOE": 1.35, "*HEE": -0.35},
    },
}
INSIDE = "inside "
# Sides of a segment in the rest pose, x ahead, y to the left, z up; outside and inside are by the segment's own side.
OFF_AXIS = {
    "front": (1, 0, 0), "back": (-1, 0, 0), "left": (0, 1, 0), "right": (0, -1, 0), "top": (0, 0, 1),
    "bottom": (0, 0, -1), "outer": (0, 1, 0), "inner": (0, -1, 0),
}  # fmt: skip


class DESCRIBING:
    """How a described set is learned."""

    # made-up people whose frames are learned from
    people: int = 12  # measured: 24 name strangers in Plug-in Gait as 12 do
    # heights, by which a landmark is missed at least
    landmark_sd: float = 0.004  # measured: ankles between labs are 6 to 8 mm apart
    # heights, the same of a place between landmarks
    anywhere_sd: float = 0.017  # measured: thighs, shanks and forearms 23 to 36 mm


def described(layout: Layout, bodies: Sequence[MarkerSet]) -> MarkerSet:
    """The marker set of a layout on one of the known bodies: the one with fewest segments that has all it needs.

    Raises InputError, naming the marker, where a word is none of those that are known.
    """
    needed = {site.segment for site in layout.sites.values()}
    fitting = [body for body in bodies if needed <= set(body.skeleton.segments)]
    if not fitting:
        known = max(bodies, key=lambda body: len(body.skeleton)).skeleton.segments
        name, site = next((name, site) for name, site in layout.sites.items() if site.segment not in known)
        raise InputError(f"{name} is on {site.segment!r}, which is no segment; expected one of {', '.join(known)}")
    # Sets that keep poses were laid on the body of one that was learned for itself.
    body = min(fitting, key=lambda one: (len(one.skeleton), len(one.spread.poses), -len(one)))
    found = [_placed(name, site, body, bodies) for name, site in layout.sites.items()]
    carrier = np.array([body.skeleton.segments.index(site.segment) for site in layout.sites.values()])
    offsets, modes, sd = (np.stack([one[part] for one in found]) for part in range(3))
    joints = len(body.skeleton)
    spread = replace(
        body.spread,
        modes=np.concatenate([body.spread.modes[:, :joints], modes.swapaxes(0, 1)], axis=1),
        marker_sd=sd,
    )
    return replace(
        body,
        name=layout.name,
        description=layout.description,
        markers=tuple(layout.sites),
        aliases={},
        attachment=carrier,
        offsets=offsets,
        spread=spread,
        source={"layout": layout.source, "body": body.name},
    )


def learned(
    markerset: MarkerSet, bodies: Sequence[MarkerSet], try_all: Trying = in_turn
) -> Generator[Progress, None, tuple[Model, dict[str, float]]]:
    """The model of a described marker set, learned from made-up people; and the seconds that each part took."""
    begin = perf_counter()
    with threadpool_limits(1, user_api="blas"):
        yield Progress(0.0, "make up people")
        poses = with_mirrored(markerset, known_poses(markerset, bodies))
        people = anybody(markerset, poses, DESCRIBING.people)
        shown = [(points, f"made up {number}") for number, points in enumerate(people, 1)]
        made = perf_counter()
        likelihood = yield from within(learning(shown, markerset.markers, try_all=try_all), 0.1, 1.0)
    return Model(markerset, likelihood), {"body": made - begin, "evidence": perf_counter() - made}


# Where a marker sits on its segment (3,), how that goes with the body's modes (K, 3), and how far it strays; heights.
Place = tuple[np.ndarray, np.ndarray, float]


def _placed(name: str, site: Site, body: MarkerSet, bodies: Sequence[MarkerSet]) -> Place:
    """Where the marker of a site sits."""
    kind, _, own = site.segment.partition(".")
    side, landmarks, axis = site.side or own, LANDMARKS.get(kind, {}), _axis(body, site.segment)
    if site.along is None and site.place in landmarks:
        shares = landmarks[site.place]
        if not side and any("*" in marker for marker in shares):
            raise InputError(f"{name} is at {site.place!r}, which is on both sides; expected left or right before it")
        parts = [_known(marker.replace("*", side), site.segment, body, bodies) for marker in shares]
        offset, modes = (np.tensordot(list(shares.values()), [part[of] for part in parts], 1) for of in range(2))
        sd = max(DESCRIBING.landmark_sd, *(part[2] for part in parts))
        way = _across(offset - axis[0], axis)
    elif site.along is not None and all(word in OFF_AXIS for word in site.place.split()):
        way = _across(_direction(site.place, side), axis)
        middle = axis[0] + site.along * (axis[1] - axis[0])
        offset = middle + _skin(body, site.segment, middle, way) * way
        modes, sd = np.zeros((len(body.spread.modes), 3)), DESCRIBING.anywhere_sd
    else:
        raise InputError(
            f"{name} is at {site.place!r}, which is no place of {site.segment}; expected one of "
            f"{', '.join(landmarks)}, or with along one or two of {', '.join(OFF_AXIS)}"
        )
    return offset + site.off_m / body.spread.height * way, modes, sd


def _direction(words: str, side: str) -> np.ndarray:
    """(3,) the way that words of `OFF_AXIS` say together; outer is to the right on the right side."""
    turned = np.array([1, -1 if side == "R" else 1, 1])
    ways = [np.array(OFF_AXIS[word]) * (turned if word in ("outer", "inner") else 1) for word in words.split()]
    return np.sum(ways, axis=0)


def _known(marker: str, segment: str, body: MarkerSet, bodies: Sequence[MarkerSet]) -> Place:
    """Where on a segment people have a marker of the built-in sets.

    The body's own where it has it; else that of the first set that does, both sides alike.
    """
    inside, marker = marker.startswith(INSIDE), marker.removeprefix(INSIDE)
    for one in (body, *(other for other in bodies if other is not body)):
        found = _on_segment(one, marker, segment)
        if not found:
            continue
        place = np.mean([one.offsets[index] * [1, mirror, 1] for index, mirror in found], axis=0)
        place = 2 * _nearest(place, _axis(body, segment)) - place if inside else place
        modes = np.zeros((len(body.spread.modes), 3))
        if one is body and not inside:
            index, mirror = found[0]
            modes = body.spread.modes[:, len(body.skeleton) + index] * [1, mirror, 1]
        return place, modes, float(max(one.spread.marker_sd[index] for index, _ in found))
    raise KeyError(marker)


def _on_segment(body: MarkerSet, marker: str, segment: str) -> list[tuple[int, int]]:
    """The index of a marker that a set has on a segment, with 1, and that of its mirror image, with -1."""
    found, segments = [], body.skeleton.segments
    for name, on, mirror in ((marker, segment, 1), (other_side(marker), other_side(segment), -1)):
        index = body.by_name.get(name)
        middle = name == marker and mirror == -1
        if index is not None and segments[body.attachment[index]] == on and not middle:
            found.append((index, mirror))
    return found


def _axis(body: MarkerSet, segment: str) -> np.ndarray:
    """(2, 3) the ends of a segment in its own axes, heights: its joint and the next, or the far end of its capsules."""
    index, skeleton = body.skeleton.segments.index(segment), body.skeleton
    child = np.flatnonzero(skeleton.parents == index)
    if len(child) and segment != "pelvis":
        return np.stack([np.zeros(3), skeleton.offsets[child[0]]])
    if segment == "pelvis":  # its next joints are the hips: it goes up from between them
        return np.array([[0, 0, 0], [0, 0, 0.1]])
    ends = body.capsules.end[body.capsules.segment == index]
    return np.stack([np.zeros(3), ends[np.linalg.norm(ends, axis=1).argmax()]])


def _nearest(place: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """(3,) the point of an axis (2, 3) that is nearest to a place (3,)."""
    along = axis[1] - axis[0]
    return axis[0] + (place - axis[0]) @ along / (along @ along) * along


def _across(way: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """(3,) of length 1, the way (3,) as far as it leads away from an axis (2, 3)."""
    along = axis[1] - axis[0]
    across = way - way @ along / (along @ along) * along
    length = np.linalg.norm(across)
    return across / length if length > 1e-6 else way / max(float(np.linalg.norm(way)), 1e-6)


def _skin(body: MarkerSet, segment: str, middle: np.ndarray, way: np.ndarray) -> float:
    """How far it is from a point inside a segment to its skin, heights."""
    capsules, index = body.capsules, body.skeleton.segments.index(segment)
    reach = np.linspace(0, 0.2, 401)  # heights: no segment is thicker
    inside = np.zeros(len(reach), bool)
    for own in np.flatnonzero(capsules.segment == index):
        away = distance_to_axis(middle + reach[:, None] * way, capsules.start[own], capsules.end[own])
        inside |= away < capsules.radius[own]
    return float(reach[inside].max(initial=0.0))
