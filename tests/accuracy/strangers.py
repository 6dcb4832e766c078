# SPDX-License-Identifier: GPL-3.0-or-later
"""Single frames of strangers in the paper's rig, in the markers of `body26`.

People of other labs than the one that the set was learned from, who stand in poses that nobody had there. The last ones
are what it is judged by; by the others the search's numbers were chosen.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from addon.core.geometry.rotations import turn_of

from . import people
from .captures import captured_frame
from .flesh import Flesh, flesh
from .people import Trial

_ACTOR = {"LASI": "LFWT", "RASI": "RFWT", "SACR": "LBWT RBWT"}
_SERVE = {"SACR": "LPSI RPSI"}
_HAND = {"SHO": "FSH BSH", "WRA": "IWR", "WRB": "OWR", "FIN": "IHAND OHAND", "HEE": "HEL"}
_BLADE = _ACTOR | {side + one: " ".join(side + t for t in _HAND[one].split()) for side in "LR" for one in _HAND}


@dataclass(frozen=True)
class Stranger:
    """Where somebody's markers are: which of the take's, in the middle of which each of `body26` is taken to be.

    number     of the draws, which is theirs for ever
    whole      whether frames of the whole take are drawn, and not of its first second
    left_out   who must not have been learned from
    """

    take: str
    names: dict[str, str]
    number: int
    whole: bool = False
    left_out: tuple[str, ...] = ()


JUDGED = {
    "`ball`": Stranger("ball", _ACTOR, 0),
    "`bd`, T-pose": Stranger("bd", _ACTOR, 1),
    "`s135`": Stranger("s135", _ACTOR, 3),
    "tennis": Stranger("serve", _SERVE, 4, left_out=("Derrick",)),
}
CHOSEN_ON = {
    "`s02`, fists raised": Stranger("s02", _ACTOR, 2),
    "`s02`, whole take": Stranger("s02", _ACTOR, 5, whole=True),
    "`p1`, whole take": Stranger("p1", _BLADE, 6, whole=True),
    "`p2`, whole take": Stranger("p2", _BLADE, 7, whole=True),
}


def in_body26() -> Iterator[people.Take]:
    """Their takes, each of which is there once however many of its frames are drawn."""
    for name, names in {one.take: one.names for one in (*JUDGED.values(), *CHOSEN_ON.values())}.items():
        yield people.worn_as(people.OTHERS[name], people.BODY26, names)


UPRIGHT = 0.6  # m, how far apart the feet of somebody who stands are at most
LOWEST_HEAD = 0.85  # of its greatest height, of somebody who stands

# How the arms of the lab's own people are set, and their markers placed elsewhere, to be strangers:
ARMS = (0.0, 1.7), (-0.3, 1.6), (0.0, 2.2)  # rad, the least and most of upper arm to the side, ahead, and of the elbow
EVERYWHERE_M = 0.006  # standard deviation along each axis of every marker's place
MOVED, MOVED_M = 2, 0.09  # so many markers are worn up to so far off


def frames_of(take: people.Take, whole: bool) -> np.ndarray:
    """The frames of a take, or of its first second, in which somebody stands and every marker is there."""
    at = {name: take.xyz[:, index] for index, name in enumerate(take.markers)}
    stands = np.isfinite(take.xyz).all(axis=(1, 2))
    stands &= np.linalg.norm((at["LANK"] - at["RANK"])[:, :2], axis=1) < UPRIGHT
    if whole:
        return np.flatnonzero(stands & (at["LFHD"][:, 2] > LOWEST_HEAD * np.nanmax(at["LFHD"][:, 2])))
    return np.flatnonzero(stands[: int(take.rate)])


def standing_strangers(stranger: Stranger, count: int) -> Iterator[Trial]:
    """`count` captures of one frame each: place, facing, rig, ghosts and frame are drawn."""
    take = people.worn_as(people.OTHERS[stranger.take], people.BODY26, stranger.names)
    frames = frames_of(take, stranger.whole)
    body = flesh(take.markers, take.xyz)
    for number in range(count):
        generator = np.random.default_rng([7, number, stranger.number])
        yield _captured(take, body, int(generator.choice(frames)), generator, number)


def posed_people(persons, count: int) -> Iterator[Trial]:
    """`count` captures of people of the lab itself, standing, with other arms and their markers placed elsewhere."""
    recordings = people.takes(persons, "standing")
    for number in range(count):
        generator = np.random.default_rng([11, number])
        take = recordings[number % len(recordings)]
        whole = np.flatnonzero(np.isfinite(take.pick(people.BODY26)).all(axis=(1, 2)))
        frame = int(generator.choice(whole))
        xyz = take.pick(people.BODY26)[frame : frame + 1]
        xyz = _placed_elsewhere(_arms_set(xyz, generator), generator)
        own = replace(take, markers=people.BODY26, xyz=xyz)
        yield _captured(own, flesh(own.markers, own.xyz), 0, generator, number)


def _captured(take: people.Take, body: Flesh, frame: int, generator: np.random.Generator, number: int) -> Trial:
    xyz = take.xyz[frame]
    middle = np.append(np.nanmean(xyz[:, :2], axis=0), np.nanmin(xyz[:, 2]) - 0.03)
    return captured_frame(f"{take.subject} frame {frame} trial {number}", take, body, frame, middle, generator)


def _arms_set(xyz: np.ndarray, generator) -> np.ndarray:
    """(1, M, 3) m with both arms turned at shoulders and elbows: alike in half of the draws."""
    index = people.BODY26.index
    xyz = xyz.copy()
    left = xyz[0, index("LASI")] - xyz[0, index("RASI")]
    left = left * [1, 1, 0] / np.linalg.norm(left[:2])
    ahead = np.cross(left, [0, 0, 1.0])
    alike, angles = generator.uniform() < 0.5, []
    for side, sign in (("L", 1), ("R", -1)):
        if not (alike and angles):
            angles = [generator.uniform(*both) for both in ARMS]
        abducted, flexed, bent = angles
        arm = [index(side + name) for name in ("ELB", "WRA", "WRB", "FIN")]
        shoulder = xyz[0, index(side + "SHO")] - [0, 0, 0.05]
        turn = _turn(left, -flexed) @ _turn(ahead, sign * abducted)
        xyz[0, arm] = (xyz[0, arm] - shoulder) @ turn.T + shoulder
        elbow = xyz[0, arm[0]].copy()
        xyz[0, arm[1:]] = (xyz[0, arm[1:]] - elbow) @ _turn(turn @ left, -bent).T + elbow
    return xyz


def _turn(axis: np.ndarray, angle: float) -> np.ndarray:
    return turn_of(axis / np.linalg.norm(axis) * angle)


def _placed_elsewhere(xyz: np.ndarray, generator) -> np.ndarray:
    xyz = xyz + generator.normal(0, EVERYWHERE_M, xyz.shape)
    for marker in generator.choice(xyz.shape[1], MOVED, replace=False):
        way = generator.normal(size=3)
        xyz[0, marker] += way / np.linalg.norm(way) * generator.uniform(0, MOVED_M)
    return xyz


def cases(chosen_on: bool, count: int) -> Iterator[tuple[str, tuple[str, ...], Iterator[Trial]]]:
    """Title, who is left out of training, and captures of all that is judged by, or that numbers were chosen on."""
    for title, stranger in (CHOSEN_ON if chosen_on else JUDGED).items():
        yield title, stranger.left_out, standing_strangers(stranger, count)
    for fold in people.folds() if chosen_on else ():
        yield f"{' '.join(fold)}, arms set, placed elsewhere", fold, posed_people(fold, count)
