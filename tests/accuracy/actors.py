# SPDX-License-Identifier: GPL-3.0-or-later
"""Several people in one take, brought together from single takes, as points and as cameras see them.

Walkers of McGill pass each other, people of cmu41 act beside each other and into each other, and two tennis players
share a court. Their trajectories are cut to pieces as in whole_takes.py, with ghosts. Nobody who is labelled is in the
training of the model, but for those who are asked for by name.

What cameras see is of walkers in the recorded room vicon12, seen by eight of its twelve cameras; `behind` is side by
side in eight made-up cameras on one side, from which one walks behind the other. All real bodies, which the model knows
nothing of, are in the way of all markers.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from addon.core.data.progress import finished
from addon.core.geometry.rotations import turn_of
from addon.core.pipelines.several_through_points import SeveralBlobs, label_several_blobs
from addon.core.points.several.wearers import SeveralOptions
from addon.core.points.whole_take.pipeline import PointOptions
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import BodiesTogether
from addon.io.models import open_model
from addon.io.points import read_points
from tests.core.scenes import cut, parts_of

from .captures import RATE, at_rate, best_way, captured, vicon12
from .flesh import Move, flesh
from .people import BODY26, PEOPLE, WALKERS, Take, Trial, files_of, read
from .whole_takes import Case, actors, case_few

GHOSTS = 60
HIDDEN_EACH = 5  # markers hidden at a time, for each person
PASSING_M = 0.5  # between two walkers as they pass
ACTING_M = 1.2  # between the middles of two actors' takes
TOUCHING_M = 0.5  # the same where they are in each other's reach all the time
ENTERING = 0.35  # part of a take in which somebody is not there yet
RACKET_MARKERS = ("GRIP", "NECK", "LEFT", "TOP", "RIGHT")
RACKET = np.array([[0.15, 0, 0], [0.35, 0, 0.02], [0.6, 0.11, 0], [0.68, 0, 0.01], [0.55, -0.13, 0.03]])  # m
THROUGH_M = 0.15  # between two walkers who meet in one lane: their bodies overlap as they pass
HOLDING_M = 0.25  # between two actors who overlap all the time
NOISE_M = 0.0003
STANDING, STOOD_S = 200, 60.0  # frames that were recorded of standing still, how long it goes on
LYING_M, UPON_M, LIFTED_M = 0.15, 0.4, 1.4  # how high somebody lies, one who lies upon them, and one who is carried
PLATES = PEOPLE / "clouthier"
PLATE = ("LBUL", "LBLL", "LBUR", "LBLR")  # of four markers on the back
PLAYERS = PEOPLE / "tennis" / "kinematics_tennis_serve_2players.c3d"


@dataclass(frozen=True, eq=False)
class Meeting:
    """People in one take, and the model that knows none of them.

    people   a take each, in one room, of as many frames
    training what the model is learned from; its takes of tests are not looked at
    own      what each of them is learned from who is asked for by name, the first ones of `people`; none for numbers
    """

    name: str
    people: tuple[Take, ...]
    training: Case
    own: tuple[Case, ...] = ()

    def together(self) -> Take:
        """All of them as one labelled take, markers called 1:LASI, 2:LASI …"""
        names = tuple(f"{number}:{name}" for number, one in enumerate(self.people, 1) for name in one.markers)
        xyz = np.concatenate([one.xyz for one in self.people], axis=1)
        return Take(self.name, self.name, names, xyz, self.people[0].rate)


def middle_of(xyz: np.ndarray) -> np.ndarray:
    """(T, 2) m, where a person (T, M, 3) m stands."""
    middle = np.nanmedian(xyz[..., :2], axis=1)
    seen = np.isfinite(middle).all(axis=1)
    frames = np.arange(len(middle))
    return np.stack([np.interp(frames, frames[seen], middle[seen, axis]) for axis in range(2)], axis=1)


def moved(take: Take, turn: float, pivot: np.ndarray, place: np.ndarray) -> Take:
    """The take turned about the vertical through `pivot` (2,) m, which goes to `place` (2,) m."""
    return replace(take, xyz=Move(turn, np.append(pivot, 0.0), np.append(place, 0.0))(take.xyz))


def passing(takes: Sequence[Take], apart: float = PASSING_M, one_way: bool = False) -> tuple[Take, ...]:
    """Walkers along x in lanes so far apart, m, every other the other way: all at x = 0 in the middle of the take."""
    frames = min(len(one.xyz) for one in takes)
    found = []
    for index, take in enumerate(takes):
        spare = len(take.xyz) - frames
        one = replace(take, xyz=take.xyz[spare // 2 : spare // 2 + frames])
        path = middle_of(one.xyz)
        along = path[-1] - path[0]
        turn = -np.arctan2(along[1], along[0]) + (0.0 if one_way or index % 2 == 0 else np.pi)
        found.append(moved(one, turn, path[frames // 2], np.array([0.0, apart * index])))
    return tuple(found)


def names_of(people: Iterable[Take]) -> str:
    """Who is in a take, as it is called."""
    return " ".join(one.subject for one in people)


def walkers(count: int) -> Iterator[Meeting]:
    """So many strangers of McGill passing each other, in the set body26 that was learned from five others."""
    for case in case_few("body26", BODY26, False):
        groups = list(combinations(range(len(case.tested)), count))
        for group in groups[:: max(len(groups) // 5, 1)]:
            some = [case.tested[index] for index in group]
            yield Meeting(names_of(some), passing(some), case)


def through() -> Iterator[Meeting]:
    """Walkers who meet in one lane, and pass through each other as far as their middles are apart."""
    for case in case_few("body26", BODY26, False):
        for pair in list(combinations(case.tested, 2))[::2]:
            yield Meeting(names_of(pair), passing(pair, THROUGH_M), case)


def acting(apart: float) -> Iterator[Meeting]:
    """Pairs of cmu41, learned from the other two: takes' middles are so far apart, m, and they move into each other."""
    found = actors("cmu41")
    for pair in combinations(("bd", "s135", "s02", "ball"), 2):
        rest = tuple(take for other, take in found.items() if other not in pair)
        frames = min(1200, *(len(found[name].xyz) for name in pair))
        people = []
        for index, name in enumerate(pair):
            own = found[name].part(0, frames)
            people.append(moved(own, 0.0, np.median(middle_of(own.xyz), axis=0), np.array([apart * index, 0.0])))
        case = Case(f"pair {' '.join(pair)}", rest, (), people[0].markers)
        yield Meeting(" ".join(pair), tuple(people), case)


def entering() -> Iterator[Meeting]:
    """Two walkers, the second of whom comes in when the first is on the way, and leaves last."""
    for meeting in walkers(2):
        first, second = meeting.people
        there = np.arange(len(first.xyz)) / len(first.xyz)
        gone = np.where((there < 1 - ENTERING)[:, None, None], first.xyz, np.nan)
        late = np.where((there > ENTERING)[:, None, None], second.xyz, np.nan)
        yield replace(meeting, people=(replace(first, xyz=gone), replace(second, xyz=late)))


def gone_between(take: Take, elsewhere: np.ndarray, turn: float) -> Take:
    """The take without its middle third; in its last third all is moved by `elsewhere` (2,) m, and turned."""
    there = np.arange(len(take.xyz)) / len(take.xyz)
    middle = np.median(middle_of(take.xyz), axis=0)
    again = moved(take, turn, middle, middle + elsewhere).xyz
    late = np.where((there >= 2 / 3)[:, None, None], again, np.nan)
    return replace(take, xyz=np.where((there < 1 / 3)[:, None, None], take.xyz, late))


def returning(meetings: Iterator[Meeting]) -> Iterator[Meeting]:
    """Two of whom the second leaves for the middle third of the take, and comes back at the other side of the first."""
    for meeting in meetings:
        first, second = meeting.people
        aside = np.median(middle_of(first.xyz), axis=0) - np.median(middle_of(second.xyz), axis=0)
        yield replace(meeting, people=(first, gone_between(second, 2 * aside, np.pi / 2)))


def exchanged_places(meetings: Iterator[Meeting]) -> Iterator[Meeting]:
    """Two who both leave for the middle third, and come back each where the other was."""
    for meeting in meetings:
        first, second = meeting.people
        aside = np.median(middle_of(second.xyz), axis=0) - np.median(middle_of(first.xyz), axis=0)
        yield replace(meeting, people=(gone_between(first, aside, 0.0), gone_between(second, -aside, 0.0)))


def laid(take: Take, part: np.ndarray, place: np.ndarray) -> Take:
    """The take turned about y from upright to flat as far as `part` (T,) says, its middle drawn to `place` (3,) m."""
    middle = np.nanmean(take.xyz, axis=1, keepdims=True)
    turn = turn_of(np.outer(part * np.pi / 2, [0.0, 1.0, 0.0]))
    flat = np.einsum("tij,tmj->tmi", turn, take.xyz - middle)
    return replace(take, xyz=flat + middle + part[:, None, None] * (place - middle))


def lain(meetings: Iterator[Meeting], first_m: float | None, second_m: float) -> Iterator[Meeting]:
    """Two of whom the second lies above the middle of the first for two fifths of the take, so high, m.

    Getting there and away takes a fifth each. The first lies, too, at a height of their own, or stays as they are.
    """
    for meeting in meetings:
        first, second = meeting.people
        at = np.linspace(-1, 1, len(first.xyz))
        part = (1 - np.cos(np.pi * np.clip((0.8 - np.abs(at)) / 0.4, 0, 1))) / 2
        middle = np.nanmedian(first.xyz, axis=(0, 1))
        if first_m is not None:
            first = laid(first, part, np.array([*middle[:2], first_m]))
        yield replace(meeting, people=(first, laid(second, part, np.array([*middle[:2], second_m]))))


def standing(apart_m: float) -> Iterator[Meeting]:
    """Strangers who stand still, so far from each other: what was recorded of it goes back and forth for a minute.

    The set is learned from how the five others stand, too: whose walks alone are known may have their arms otherwise.
    """
    stood = {one: read(files_of(one)[0], one) for one in WALKERS}
    whole = {name: one.of(BODY26) for name, one in stood.items() if set(BODY26) <= set(one.markers)}
    for case in case_few("body26", BODY26, False):
        others = sorted({one.subject for one in case.training} & whole.keys())
        known = *case.training, *(whole[name] for name in others)
        training = replace(case, name=f"standing {case.name[-1]}", training=known)
        takes = [whole[one.subject] for one in case.tested if one.subject in whole]
        for pair in combinations([one for one in takes if len(one.xyz) >= STANDING], 2):
            people = []
            for index, one in enumerate(pair):
                both = np.concatenate([one.xyz, one.xyz[::-1]])
                long = np.concatenate([both] * (int(STOOD_S * one.rate) // len(both)))
                middle = np.median(middle_of(long), axis=0)
                people.append(moved(replace(one, xyz=long), 0.0, middle, np.array([apart_m * index, 0.0])))
            yield Meeting(names_of(pair), tuple(people), training)


def players() -> Iterator[Meeting]:
    """Two tennis players in the built-in body39."""
    whole = read(PLAYERS, "players")
    markerset = open_model("body39").markerset.markers
    size = len(whole.markers) // 2
    people = []
    for first in (0, size):
        own = replace(whole, markers=whole.markers[first : first + size], xyz=whole.xyz[:, first : first + size])
        people.append(own.of(markerset))
    yield Meeting("tennis players", tuple(people), Case("players", (), (), markerset, built_in="body39"))


def own_turn(person: str) -> Case | None:
    """One person's turn, learned alone; None where it lacks a marker."""
    turn = read(files_of(person)[2], person)
    return Case(f"turn {person}", (turn.of(BODY26),), (), BODY26) if set(BODY26) <= set(turn.markers) else None


def in_hand(turn: np.ndarray, grip: np.ndarray, rate: float) -> Take:
    """A racket by its axes (T, 3, 3) and where it is held (T, 3) m, measured with the usual noise."""
    xyz = grip[:, None] + np.einsum("tij,mj->tmi", turn, RACKET)
    return Take("racket", "racket", RACKET_MARKERS, xyz + np.random.default_rng(0).normal(0, NOISE_M, xyz.shape), rate)


def swung() -> Case:
    """A virtual racket that is turned about in a capture of its own, which its model is learned from."""
    steps = np.random.default_rng(1).normal(0, 1, (600, 6)) * [0.05, 0.05, 0.05, 0.01, 0.01, 0.01]
    path = np.cumsum(steps, axis=0)
    return Case("racket", (in_hand(turn_of(path[:, :3]), path[:, 3:] + [0, 0, 1.2], 100.0),), (), RACKET_MARKERS)


def racket() -> Iterator[Meeting]:
    """Walkers with a virtual racket in the right hand, where it turns; the two are asked for by name."""
    for case in case_few("body26", BODY26, False):
        for one in case.tested:
            elbow, thumb, little = (one.xyz[:, one.markers.index(name)] for name in ("RELB", "RWRA", "RWRB"))
            ahead = (thumb + little) / 2 - elbow
            ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
            across = thumb - little - ((thumb - little) * ahead).sum(axis=1, keepdims=True) * ahead
            across /= np.linalg.norm(across, axis=1, keepdims=True)
            turned = np.linspace(0, 1.5, len(ahead))[:, None]
            across = np.cos(turned) * across + np.sin(turned) * np.cross(ahead, across)
            axes = np.stack([ahead, across, np.cross(ahead, across)], axis=2)
            held = in_hand(axes, (thumb + little) / 2, one.rate)
            yield Meeting(f"{one.subject} and a racket", (one, held), case, (case, swung()))


def plate_of(take: str, rate: float) -> Take:
    """The plate that a recorded person wears on the back, as a prop, at a rate."""
    points = read_points(PLATES / take, everything=True, up="z")
    whole = at_rate(Take("plate", "plate", points.names, points.xyz, points.rate).of(PLATE), rate)
    return replace(whole, xyz=whole.xyz[:-1])


def plate() -> Iterator[Meeting]:
    """Walkers with a recorded plate in the right hand, turning as it did; it is learned from another take of it."""
    learned = Case("plate", (plate_of("KneeltoProne01.c3d", 100.0),), (), PLATE)
    for case in case_few("body26", BODY26, False):
        for one in case.tested:
            worn = plate_of("PronetoRun01.c3d", one.rate).xyz
            spare = len(worn) - len(one.xyz)
            worn = worn[spare // 2 : spare // 2 + len(one.xyz)]
            hand = one.xyz[:, [one.markers.index(name) for name in ("RWRA", "RWRB")]].mean(axis=1, keepdims=True)
            carried = Take("plate", "plate", PLATE, worn - worn.mean(axis=1, keepdims=True) + hand, one.rate)
            yield Meeting(f"{one.subject} and a plate", (one, carried), case, (case, learned))


def known(asked: int, there: int = 2) -> Iterator[Meeting]:
    """Walkers passing, so many of whom are asked for by name: each learned from a turn of their own."""
    for case in case_few("body26", BODY26, False):
        for some in list(combinations(case.tested, there))[::2]:
            own = tuple(own_turn(one.subject) for one in some[:asked])
            if None not in own:
                yield Meeting(names_of(some), passing(some), case, own)


MEETINGS: dict[str, Callable[[], Iterator[Meeting]]] = {
    "walkers-2": lambda: walkers(2),
    "walkers-3": lambda: walkers(3),
    "walkers-4": lambda: walkers(4),
    "entering": entering,
    "acting": lambda: acting(ACTING_M),
    "touching": lambda: acting(TOUCHING_M),
    "returning": lambda: returning(walkers(2)),
    "returning-acting": lambda: returning(acting(ACTING_M)),
    "exchanged": lambda: exchanged_places(acting(ACTING_M)),
    "through": through,
    "holding": lambda: acting(HOLDING_M),
    "lying": lambda: lain(acting(ACTING_M), LYING_M, UPON_M),
    "lifted": lambda: lain(acting(ACTING_M), None, LIFTED_M),
    "standing": lambda: standing(1.0),
    "standing-near": lambda: standing(0.8),
    "standing-hands": lambda: standing(0.6),  # in which hands are in each other
    "players": players,
    "racket": racket,
    "plate": plate,
    "known": lambda: known(2),
    "one-of-two": lambda: known(1),
    "stray": lambda: known(2, 3),
    "known-returning": lambda: returning(known(2)),
}


CAMERAS = 8
RING = 24  # of which eight that are next to each other are on one side, a third of the way round
ONE_SIDE = ring_rig(RING, (1280, 1024), 4.5, 1.2, 1.8)
CHUNK = 256


def meetings(kind: str) -> Iterator[Meeting]:
    """Strangers of McGill: `passing`, `beside` or `behind`, `three` who pass each other, or one `returning`."""
    if kind == "returning":
        yield from returning(meetings("beside"))
        return
    for case in case_few("body26", BODY26, False):
        count = 3 if kind == "three" else 2
        for first in range(len(case.tested) - count + 1):
            some = [at_rate(one, RATE) for one in case.tested[first : first + count]]
            yield Meeting(names_of(some), passing(some, one_way=kind not in ("passing", "three")), case)


def seen(meeting: Meeting, seed: int, one_side: bool = False) -> Trial:
    """The meeting in the room, or in front of eight cameras on `one_side`; true names are 1:LASI, 2:LASI …"""
    generator = np.random.default_rng([17, seed])
    centre = np.append(np.mean([middle_of(one.xyz)[len(one.xyz) // 2] for one in meeting.people], axis=0), 0.0)
    if one_side:
        cameras = ONE_SIDE.select(np.sort(np.argsort(ONE_SIDE.centres[:, 1])[:CAMERAS]))
        placed = [one.xyz - centre for one in meeting.people]
    else:
        move, share = best_way(meeting.together().xyz, centre, CAMERAS, generator)
        cameras = vicon12().select(np.sort(np.argsort(-share)[:CAMERAS]))
        placed = [move(one.xyz) for one in meeting.people]
    bodies = tuple(flesh(one.markers, xyz) for one, xyz in zip(meeting.people, placed, strict=True))
    together = BodiesTogether(bodies, tuple(xyz.shape[1] for xyz in placed))
    xyz, markers = np.concatenate(placed, axis=1), meeting.together().markers
    return captured(meeting.name, xyz, markers, cameras, together, RATE, generator)


def named(shot: Trial, asked: SeveralOptions) -> np.ndarray:
    """(N,) the names that the product gives to the blobs, "" for none."""
    take = SeveralBlobs(lambda: parts_of(shot.blobs, CHUNK), shot.cameras, asked, PointOptions("likelihood"), shot.rate)
    made = finished(label_several_blobs(take))
    marker = np.concatenate([chunk.labels.marker for chunk in made.chunks(cut(shot.blobs, CHUNK))])
    return np.array([*made.worn.markers, ""], object)[marker]
