# SPDX-License-Identifier: GPL-3.0-or-later
"""A body's motion as turns of the bones of a rig of other size, other proportions and another rest pose.

All is told in the axes of a character at rest: x to its left, looking along -y, z up. Limbs point as the body's do,
whatever they do at rest; hands, feet, hips and head turn by as much as the body's. The hips' way is as much longer as
the legs are; where planted feet are kept, hips go part of the way that those lack, and turn less where they are wider.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..body.sides import BODY_SIDES
from ..filling.ground import LEG, ON_GROUND, eased, toes_bent
from ..geometry.rotations import NO_TURN, least_turn, rotation_vector, turn_of
from ..posing.character import FACING, Character
from ..review.suspects import runs
from .matching import FINGER_WORDS

SPINE = ("spine", "between", "chest")
UNTURNED = np.eye(3)
LEFTWARDS, SKYWARDS = np.array([1.0, 0, 0]), np.array([0.0, 0, 1])
NEXT = {"upper_arm": "forearm", "forearm": "hand", "thigh": "shank", "shank": "foot"}
STRAIGHT = np.radians(30)  # physical: a hand bent more than this at rest has a bone that says not where it points
MOST_STRETCHED = 1 - 1e-6  # format: of a limb's length; where it is straight, no angle says how far it reaches
OTHER_SIZE = 2.0  # physical: so many times as long, or as short, are no two people's feet, drawn ones neither
FLOOR_NEAR = 0.1  # physical: of both legs' length, that a rig's lowest bone may be below the floor, at its origin
ANKLE_HIGH = 0.25  # physical: of both legs' length, that it may be over that: no ankle is higher than a shank is long
Posed = tuple[np.ndarray, np.ndarray]  # how bones turn (F, C, 3, 3) from their rest, and where the hips begin (F, 3) m
Plants = Mapping[str, tuple[np.ndarray, np.ndarray]]  # of each side, as `Footing` has them
Pits = Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Footing:
    """What planted feet of a rig go by."""

    scale: float  # how much larger the rig's legs are than the body's
    floor: float  # m, how high the rig's floor is at rest
    fade: int  # in how many frames a change that they need comes and goes
    # in which frames (K,) the body's foot of each side is planted, and how high (K,) m the lower one of its heel and
    # ball is over the floor that it stands on
    plants: Plants
    pits: Pits  # how deep (F,) m the ball of that foot is where no floor is


@dataclass(frozen=True, eq=False)
class Rig:
    """The C bones of a rig that are to be moved, at rest; a bone comes after what it follows."""

    # of the body that they stand for; "between" for those of the spine between `spine` and `chest`
    parts: tuple[str, ...]
    follows: np.ndarray  # (C,) index of the bone that carries each, -1 for none of them
    heads: np.ndarray  # (C, 3) m where they begin, and
    tails: np.ndarray  # (C, 3) m where they end, in the axes of a character, from the origin of the rig

    @property
    def at(self) -> Mapping[str, int]:
        """The index of each part; of the bones between any."""
        return {part: index for index, part in enumerate(self.parts)}

    @property
    def legs(self) -> list[str]:
        """The sides on which there is a leg down to the foot."""
        return [side for side in BODY_SIDES if {f"{part}.{side}" for part in LEG} <= set(self.parts)]


def axes_at_rest(places: Mapping[str, np.ndarray]) -> np.ndarray:
    """(3, 3) columns: the left, the back and the up of a rig in its own axes, by where parts begin (3,) at rest."""
    hips = (places["thigh.L"] + places["thigh.R"]) / 2
    way = hips - (places["shank.L"] + places["shank.R"]) / 2
    up = np.eye(3)[int(np.argmax(np.abs(way)))]
    up = up * np.sign(way @ up)
    pairs = [[places.get(f"{part}.{side}") for side in BODY_SIDES] for part in ("thigh", "foot", "upper_arm")]
    lines = [one - other for one, other in pairs if one is not None and other is not None]
    leans = np.array([line @ up / max(float(np.linalg.norm(line)), NO_TURN) for line in lines])
    if len(lines) > 1 and (leans * leans[0] > 0).all():  # where all lean to one side, the rig does
        level = lines[int(np.argmin(np.abs(leans)))]
        up = up - level * (level @ up) / (level @ level)
        up /= np.linalg.norm(up)
    left = lines[0] - up * (lines[0] @ up)
    left /= np.linalg.norm(left)
    return np.column_stack([left, np.cross(up, left), up])


def stands(places: Mapping[str, np.ndarray]) -> bool:
    """Whether a rig stands at rest, by where parts begin (3,) in the axes of a character; some files' have no pose.

    Or have bones of another size: legs so far apart, for what they are long, that feet could not meet.
    """
    over = [("hips", part) for part in ("chest", "neck", "head") if part in places]
    over += [(f"shank.{side}", f"thigh.{side}") for side in BODY_SIDES]
    ways = np.array([places[high] - places[low] for low, high in over])
    lengths = np.linalg.norm(ways, axis=1)
    together = np.linalg.norm(places["thigh.L"] - places["thigh.R"]) < 2 * lengths[-2:].sum()
    return bool(together and (2 * ways[:, 2] > lengths).all())


def retarget(
    character: Character, motion: tuple[np.ndarray, np.ndarray], rate: float, rig: Rig, feet: bool, hands: bool
) -> Posed:
    """How the bones of a rig turn, and where its hips begin, world.

    From the joints (F, J, 3) m of a body and the rotations (F, J, 3, 3) of its segments, so many a second. `feet` stay
    where they are planted; `hands` are where the body's are in a room that is as much larger as the rig's legs are.
    Legs and arms bend for that; hips go part of what planted feet lack, and turn less where they are wider. Where the
    body is NaN it goes straight from where it was to where it is again.
    """
    body = BodyInMotion(character, *_bridged(*motion))
    rig = _with_feet(rig, body)
    at, aligned = rig.at, _alignments(rig, body)
    turns = np.empty((len(rig.parts), len(body.found), 3, 3)).swapaxes(0, 1)  # in memory bone by bone, as it is used
    for index, part in enumerate(rig.parts):
        if part in SPINE:
            turns[:, index] = _of_spine(rig, body, index, aligned)
        elif part.startswith("shoulder") and "chest" in body.at:  # as it is carried, and as it moves in the chest
            chest = turns[:, at["chest"]] if "chest" in at else body.turned("chest")
            turns[:, index] = body.turned(part) @ (body.turned("chest").swapaxes(1, 2) @ chest)
        elif part.partition(".")[0] in (*NEXT, "hand", *FINGER_WORDS):
            turns[:, index] = body.aimed(part, aligned[index])
        else:
            turns[:, index] = body.turned(part, aligned[index])
    scale, floor, lift = _fitted(rig, body)
    ground, plants, pits = _plants(body, rig.legs, rate) if feet else (0.0, {}, {})
    lift -= scale * ground
    footing = Footing(scale, floor, max(round(ON_GROUND.span_s * rate), 1), plants, pits)
    begin = scale * (body.begin("thigh.L") + body.begin("thigh.R")) / 2 + lift * SKYWARDS
    middle = (rig.heads[at["thigh.L"]] + rig.heads[at["thigh.R"]]) / 2 - rig.heads[at["hips"]]
    hips = begin - turns[:, at["hips"]] @ middle
    if feet:
        turn, way = _with_legs(rig, body, (turns, hips), footing)
        turns[:, at["hips"]] = turn @ turns[:, at["hips"]]
        hips = begin + way - turns[:, at["hips"]] @ middle
    for side, hinge in zip(BODY_SIDES, (-SKYWARDS, SKYWARDS), strict=True):
        if feet and side in rig.legs:
            _plant(rig, body, side, (turns, hips), footing, aligned)
            _keep_foot_out(rig, turns, hips, side, footing)
            if f"toes.{side}" in at:
                _keep_toes_out(rig, turns, hips, side, floor)
        arm = [f"{part}.{side}" for part in ("upper_arm", "forearm", "hand")]
        if hands and set(arm) <= at.keys():
            upper, lower, _ = limb = [at[part] for part in arm]
            way = scale * body.begin(arm[2]) + lift * SKYWARDS - place_of(rig, turns, hips, upper)
            both = turns[:, upper], turns[:, lower]
            turns[:, upper], turns[:, lower] = _reaching(rig, limb, *both, way, aligned[upper].T @ hinge)
    return turns, hips


@dataclass(frozen=True, eq=False)
class BodyInMotion:
    """A character with the joints (F, J, 3) m of its body, and the rotations (F, J, 3, 3) of that one's segments.

    In which frames (F,) it was `found`.
    """

    character: Character
    joints: np.ndarray
    rotated: np.ndarray
    found: np.ndarray

    @property
    def at(self) -> Mapping[str, int]:
        """The index of each part."""
        return {name: index for index, name in enumerate(self.character.names)}

    def begin(self, part: str) -> np.ndarray:
        """(F, 3) m where a bone begins."""
        bone = self.at[part]
        segment = self.character.segment[bone]
        return self.joints[:, segment] + self.rotated[:, segment] @ self.character.starts[bone]

    def rest(self, part: str) -> np.ndarray:
        """(3,) m where a bone begins in the T-pose."""
        return self.character.heads[self.at[part]]

    def turned(self, part: str, rest: np.ndarray = UNTURNED) -> np.ndarray:
        """(F, 3, 3) how axes turn with a bone that are `rest` (3, 3) where the body stands, not in the T-pose."""
        return self.rotated[:, self.character.segment[self.at[part]]] @ (FACING.T @ rest)

    def aimed(self, part: str, rest: np.ndarray) -> np.ndarray:
        """(F, 3, 3) how axes turn with a bone that are `rest` (3, 3) in the T-pose."""
        bone = self.at[part]
        return self.rotated[:, self.character.segment[bone]] @ (self.character.turns[bone].T @ rest)


def _bridged(joints: np.ndarray, rotated: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joints (F, J, 3) m and rotations (F, J, 3, 3), those of NaN frames between those around; where (F,) none were."""
    found = np.isfinite(joints).all(axis=(1, 2))
    if found.all():
        return joints, rotated, found
    gone, rows, joints, rotated = np.flatnonzero(~found), np.flatnonzero(found), joints.copy("K"), rotated.copy("K")
    way = np.interp(gone, rows, np.arange(len(rows)))
    one, two, share = rows[way.astype(int)], rows[np.ceil(way).astype(int)], (way % 1)[:, None, None]
    joints[gone] = joints[one] + share * (joints[two] - joints[one])
    rotated[gone] = _part_way(rotated[one], rotated[two], share)
    return joints, rotated, found


def _alignments(rig: Rig, body: BodyInMotion) -> np.ndarray:
    """(C, 3, 3) the turn of each bone from its rest to the T-pose that the body's turns count from."""
    aligned, at = np.tile(np.eye(3), (len(rig.parts), 1, 1)), rig.at
    for part, index in at.items():
        name, _, side = part.partition(".")
        before = rig.follows[index]
        carried = (
            aligned[before] if before >= 0 and rig.parts[before].partition(".")[0] in (*NEXT, "hand") else np.eye(3)
        )
        after = at.get(f"{NEXT.get(name)}.{side}")
        way = (rig.tails[index] if after is None else rig.heads[after]) - rig.heads[index]
        if name in ("thigh", "shank"):
            aligned[index] = least_turn(carried @ way, -SKYWARDS) @ carried
        elif name in ("upper_arm", "forearm", "hand"):
            out = np.array([1.0 if side == BODY_SIDES[0] else -1.0, 0, 0])
            bent = (carried @ way) @ out < np.cos(STRAIGHT) * np.linalg.norm(way)
            aligned[index] = carried if name == "hand" and bent else least_turn(carried @ way, out) @ carried
        elif name == "foot":  # it stands on its sole, whichever way it points in there
            ball = _ball(rig, side) - rig.heads[index]
            own = body.rest(f"toes.{side}") - body.rest(f"foot.{side}")
            aligned[index] = least_turn(ball * (1, 1, 0), own * (1, 1, 0))
            if f"toes.{side}" in at:
                aligned[at[f"toes.{side}"]] = aligned[index]
        elif name in FINGER_WORDS:
            at_rest = body.character.tails[body.at[part]] - body.rest(part)
            aligned[index] = least_turn(carried @ way, at_rest) @ carried
    trunk = [index for index, part in enumerate(rig.parts) if part in SPINE]
    if trunk:
        aligned[trunk] = least_turn(_top(rig) - rig.heads[trunk[0]], SKYWARDS)
    return aligned


def _with_feet(rig: Rig, body: BodyInMotion) -> Rig:
    """The same with feet whose last bones end as the body's do where theirs end nowhere ahead, or in the distance.

    Importers give a foot without toes any length; then one of another size than the body's has the body's.
    """
    tails, scale = rig.tails.copy(), _fitted(rig, body)[0]
    for side in rig.legs:
        last = next(part for part in (f"toes.{side}", f"foot.{side}") if part in rig.at)
        own = scale * (body.character.tails[body.at[last]] - body.rest(last))
        way = tails[rig.at[last]] - rig.heads[rig.at[last]]
        far, size = np.linalg.norm(way), np.linalg.norm(own)
        least, most = size / OTHER_SIZE, size * OTHER_SIZE
        if last.startswith("toes"):
            least, most = 0.0, OTHER_SIZE * np.linalg.norm(_ball(rig, side) - rig.heads[rig.at[f"foot.{side}"]])
        if not (far / 2 < -way[1] and least < far < most):
            tails[rig.at[last]] = rig.heads[rig.at[last]] + own
    return replace(rig, tails=tails)


def _ball(rig: Rig, side: str) -> np.ndarray:
    """(3,) m the ball of a foot at rest: where the toes begin, else where the foot ends."""
    toes = rig.at.get(f"toes.{side}")
    return rig.tails[rig.at[f"foot.{side}"]] if toes is None else rig.heads[toes]


def _top(rig: Rig) -> np.ndarray:
    """(3,) m where the trunk ends at rest: where neck or head begin, else where the chest ends."""
    for part in ("neck", "head"):
        if part in rig.parts:
            return rig.heads[rig.at[part]]
    return rig.tails[max(index for index, part in enumerate(rig.parts) if part in SPINE)]


def _of_spine(rig: Rig, body: BodyInMotion, index: int, aligned: np.ndarray) -> np.ndarray:
    """(F, 3, 3) how a bone of the spine turns: the chest as the body's, those below share what is between.

    The body bends at two joints of the spine; a rig's bones bend so around the same height of the trunk.
    """
    chest = body.aimed("chest", aligned[index])
    if index + 1 == len(rig.parts) or rig.parts[index + 1] not in SPINE:
        return chest
    low, top = (rig.heads[rig.at["thigh.L"]] + rig.heads[rig.at["thigh.R"]])[2] / 2, _top(rig)[2]
    height = ((rig.heads[index] + rig.heads[index + 1])[2] / 2 - low) / (top - low)
    own = (body.rest("thigh.L") + body.rest("thigh.R"))[2] / 2
    joints = [(body.rest(part)[2] - own) / (body.rest("neck")[2] - own) for part in ("spine", "chest")]
    hips, spine = body.turned("hips"), body.aimed("spine", aligned[index])
    lower = _part_way(hips, spine, _share(height, joints[0]))
    return lower @ (spine.swapaxes(1, 2) @ _part_way(spine, chest, _share(height, joints[1])))


def _share(height: float, joint: float) -> float:
    """How much of a joint's bend a bone has at a height of the trunk, both from 0 at the hips to 1 at the neck."""
    half = min(joint, 1 - joint)
    return float(np.clip((height - joint + half) / (2 * half), 0, 1))


def _part_way(start: np.ndarray, end: np.ndarray, share: float | np.ndarray) -> np.ndarray:
    """Rotations (F, …, 3, 3) so far of the short way from some to others."""
    return start @ turn_of(share * rotation_vector(start.swapaxes(-2, -1) @ end))


def _fitted(rig: Rig, body: BodyInMotion) -> tuple[float, float, float]:
    """How much longer a rig's legs are; m how high its ground is at rest, and how much higher its ankles over that."""
    lengths = np.zeros(2)
    for side in BODY_SIDES:
        chain = [part for part in (f"{one}.{side}" for one in LEG) if part in rig.at]
        for number, places in enumerate(([rig.heads[rig.at[part]] for part in chain], list(map(body.rest, chain)))):
            lengths[number] += np.linalg.norm(np.diff(np.array(places), axis=0), axis=1).sum()
    scale, low = float(lengths[0] / lengths[1]), float(rig.heads[:, 2].min())
    # Rigs stand on their origin; one whose origin is elsewhere stands as far below its lowest joint as the body.
    under = low - scale * min(body.rest(part)[2] for part in rig.parts if part in body.at)
    floor = 0.0 if -FLOOR_NEAR < under / lengths[0] < ANKLE_HIGH else under
    lifts = [
        rig.heads[rig.at[part], 2] - floor - scale * body.rest(part)[2] for part in map("foot.{}".format, rig.legs)
    ]
    return scale, floor, float(np.mean(lifts or [0.0]))


def _plants(body: BodyInMotion, legs: list[str], rate: float) -> tuple[float, Plants, Pits]:
    """M, how much higher than at rest a body stands on the floor: people's feet, and shoes, are as high as they are.

    And the plants and pits of each side, as `Footing` has them.
    """
    planted, balls, stands = {}, {}, [0.0]
    for side in legs:
        ankle, ball = body.rest(f"foot.{side}"), body.rest(f"toes.{side}")
        begin, turned = body.begin(f"foot.{side}"), body.turned(f"foot.{side}")
        heights = [(begin + turned @ below)[:, 2] for below in (ball * (1, 1, 0) - ankle, ankle * (0, 0, -1))]
        lowest = np.minimum(*heights)
        rows = np.flatnonzero(_planted(body.begin(f"toes.{side}"), lowest, rate, body.found))  # which holds still
        stands += lowest[rows][np.abs(np.subtract(*heights))[rows] < ON_GROUND.low_m].tolist()
        planted[side], balls[side] = (rows, lowest[rows]), heights[0]
    ground = float(np.median(stands))
    ground = ground if abs(ground) < ON_GROUND.low_m else 0.0
    plants = {side: (rows, _over_floor(lowest - ground)) for side, (rows, lowest) in planted.items()}
    return ground, plants, {side: -np.minimum(_over_floor(height - ground), 0) for side, height in balls.items()}


def _over_floor(height: np.ndarray) -> np.ndarray:
    """(F,) m how high over the floor a foot is, at such a height m: a little below it is on it, far below is none."""
    return np.minimum(np.maximum(height, 0), np.maximum(height, 2 * height + ON_GROUND.low_m))


def _with_legs(rig: Rig, body: BodyInMotion, posed: Posed, footing: Footing) -> tuple[np.ndarray, np.ndarray]:
    """How the hips turn with both legs (F, 3, 3), by as much as they are wider than the body's, and go (F, 3) m.

    Turned as the body's, joints that are farther apart would go more ways than legs as long as the rig's. And the hips
    go half of the way that each planted foot lacks, smoothly, because all else goes along.
    """
    thighs = [rig.at[f"thigh.{side}"] for side in BODY_SIDES]
    own = footing.scale * np.linalg.norm(body.rest("thigh.L") - body.rest("thigh.R"))
    wider = max(1 - own / max(np.linalg.norm(np.subtract(*rig.heads[thighs])), NO_TURN), 0.0)
    line = np.subtract(*(place_of(rig, *posed, thigh) for thigh in thighs))
    missed = np.zeros((len(line), len(BODY_SIDES), 3))
    for side in rig.legs:
        rows, ankle = _standing(rig, body, side, posed, footing)
        off = ankle - place_of(rig, *posed, rig.at[f"foot.{side}"])[rows]
        missed[:, BODY_SIDES.index(side)] = _fading(rows, off, len(line), 2 * footing.fade)
    missed = eased(missed, footing.fade // 2)
    return least_turn(line, line + wider * (missed[:, 0] - missed[:, 1])), missed.sum(axis=1) / 2


def _plant(rig: Rig, body: BodyInMotion, side: str, posed: Posed, footing: Footing, aligned: np.ndarray):
    """Changes the turns of a leg so that its planted foot does not slide; before and after that fades."""
    turns, leg = posed[0], [rig.at[f"{part}.{side}"] for part in LEG]
    thigh, shank, foot = leg
    rows, ankle = _standing(rig, body, side, posed, footing)
    hip, begin = (place_of(rig, *posed, at)[rows] for at in (thigh, foot))
    far, ball = np.linalg.norm(begin - hip, axis=1), _ball(rig, side) - rig.heads[foot]
    way, sole = _rolled(turns[rows, foot], ball, ankle - hip, far, footing.scale * ON_GROUND.reach_m)
    both = turns[rows, thigh], turns[rows, shank]
    bent = *_reaching(rig, leg, *both, way, aligned[thigh].T @ LEFTWARDS), sole
    for bone, turn in zip(leg, bent, strict=True):
        change = rotation_vector(turn @ turns[rows, bone].swapaxes(1, 2))
        turns[:, bone] = turn_of(_fading(rows, change, len(turns), footing.fade)) @ turns[:, bone]


def _fading(rows: np.ndarray, values: np.ndarray, count: int, fade: int) -> np.ndarray:
    """(F, 3) values of so many frames, by those (K, 3) of some, which go on as they went and fade in so many frames.

    By cubic Hermite curves, with the slope of half as many frames; where the next ones are nearer they become those.
    """
    found = np.zeros((count, 3))
    found[rows] = values
    for step in (1, -1):
        at, known, begin = rows[::step], values[::step], 0
        gaps = np.abs(np.diff(at, append=[*at[-1:] + 2 * step * fade]))
        for last in np.flatnonzero(gaps > 1).tolist():
            back, begin = min(fade // 2, last - begin), last + 1
            gone = (known[last] - known[last - back]) / max(back, 1)
            ahead = np.arange(1, min(gaps[last], fade))[:, None]
            part, there = ahead / min(gaps[last], fade), at[last] + step * ahead[:, 0]
            inside = (there >= 0) & (there < count)
            found[there[inside]] += (((1 + 2 * part) * known[last] + ahead * gone) * (1 - part) ** 2)[inside]
    return found


def _standing(rig: Rig, body: BodyInMotion, side: str, posed: Posed, footing: Footing) -> tuple[np.ndarray, np.ndarray]:
    """In which frames (K,) a foot is planted, and where it is to begin (K, 3) m in them.

    Its ball goes along the floor as the body's does, from where the leg has it in the mean of a plant. The lower one of
    heel and ball is as high as the body's: a foot of another length stands on the floor, not in it.
    """
    (turns, hips), (scale, floor), foot = posed, (footing.scale, footing.floor), rig.at[f"foot.{side}"]
    rows, heights = footing.plants[side]
    turn, ankle, ball = turns[rows, foot], rig.heads[foot], _ball(rig, side)
    begin = place_of(rig, turns, hips, foot)[rows]
    low = [(turn @ (place * (1, 1, 0) + floor * SKYWARDS - ankle))[:, 2] for place in (ball, ankle)]
    goal = scale * body.begin(f"toes.{side}")[rows] - turn @ (ball - ankle)
    goal[:, 2] = scale * heights - np.minimum(*low)
    for run in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) > 1) + 1) if len(rows) else ():
        goal[run, :2] += (begin - goal)[run, :2].mean(axis=0)
    return rows, goal


def _rolled(
    turn: np.ndarray, way: np.ndarray, ankle: np.ndarray, far: np.ndarray, short: float
) -> tuple[np.ndarray, np.ndarray]:
    """The places (K, 3) m of an ankle from the hip, and turns (K, 3, 3) of its foot, that leave the knee as it is.

    For that the foot rolls on its ball, `way` (3,) m from the ankle, towards where this is as `far` (K,) m as the leg
    has it: by damped least squares, so less where the leg is over the ball, or a foot is as `short` m.
    """
    ball, axis = ankle + turn @ way, turn @ LEFTWARDS
    for _ in range(2):  # steps; with four of them knees are nearer the body's at 99 %, and feet turn more
        across = np.cross(turn @ way, axis)
        wanted = ankle * (far / np.linalg.norm(ankle, axis=1) - 1)[:, None]
        angle = (wanted * across).sum(axis=1) / ((across**2).sum(axis=1) + short**2)
        turn = turn_of(axis * angle[:, None]) @ turn
        ankle = ball - turn @ way
    return ankle, turn


def _keep_foot_out(rig: Rig, turns: np.ndarray, hips: np.ndarray, side: str, footing: Footing):
    """Changes the turns of a foot, which may be longer than the body's, so that its ball is not in the floor.

    It turns up about the ankle, as toes do about the ball, and smoothly. Limbs and planted feet stay as they are.
    """
    foot = rig.at[f"foot.{side}"]
    sole = _ball(rig, side) * (1, 1, 0) + footing.floor * SKYWARDS - rig.heads[foot]
    if not sole[:2].any():  # the ball is right under the ankle
        return
    level = sole * (1, 1, 0) * np.linalg.norm(sole) / np.linalg.norm(sole[:2])
    height = (place_of(rig, turns, hips, foot)[:, 2] + footing.scale * footing.pits[side])[:, None]
    carrying = turns[:, [foot]] @ least_turn(level, sole)
    up = rotation_vector(toes_bent(carrying, np.eye(3)[None, None], level[None], 0.0, height))
    up = eased(up, max(footing.fade // 4, 1))
    up[footing.plants[side][0]] = 0.0
    turns[:, [foot]] @= turn_of(up)


def _keep_toes_out(rig: Rig, turns: np.ndarray, hips: np.ndarray, side: str, floor: float):
    """Changes the turns of toes, which may be longer than the body's, so that they are not in the floor, so high m."""
    foot, toes = (rig.at[f"{part}.{side}"] for part in ("foot", "toes"))
    carrying, ahead = turns[:, [foot]], (rig.heads[toes] - rig.heads[foot]) * (1, 1, 0)
    if not ahead.any():  # begins at, or right under, the ankle
        return
    way = ahead * np.linalg.norm(rig.tails[toes] - rig.heads[toes]) / np.linalg.norm(ahead)
    height = place_of(rig, turns, hips, toes)[:, 2:] - rig.heads[toes, 2] + floor
    turns[:, [toes]] = carrying @ toes_bent(
        carrying, carrying.swapaxes(2, 3) @ turns[:, [toes]], way[None], 0.0, height
    )


def _planted(ball: np.ndarray, lowest: np.ndarray, rate: float, found: np.ndarray) -> np.ndarray:
    """(F,) whether a foot stands, by the path of its ball (F, 3) m and its lowest point's height (F,) m.

    Not in gaps, where it was not `found` (F,); short ones are none.
    """
    lag = max(int(rate * ON_GROUND.span_s / 2), 1)
    wide = 2 * lag
    low, planted = lowest < np.percentile(lowest[found], 5) + ON_GROUND.low_m, np.zeros(len(found), bool)
    for start, stop in runs(found, wide + 1):
        frames = np.arange(start, stop)
        ahead, behind = (ball[np.clip(frames + step, start, stop - 1)] for step in (lag, -lag))
        slow = np.linalg.norm(ahead - behind, axis=1) < ON_GROUND.slow_m_s * wide / rate
        still = np.pad(slow & low[start:stop], lag, "edge")  # as it is at its ends, so it is before and after
        for begin, end in runs(still, wide + 1):
            still[begin:end] = end - begin > wide
        planted[start:stop] = still[lag:-lag]
    return planted


def place_of(rig: Rig, turns: np.ndarray, hips: np.ndarray, index: int) -> np.ndarray:
    """(F, 3) m where a bone begins, by the hips (F, 3) m and the turns (F, C, 3, 3) of what carries it."""
    above = rig.follows[index]
    if rig.parts[index] == "hips":
        return hips
    if above < 0:
        return np.broadcast_to(rig.heads[index], hips.shape)
    return place_of(rig, turns, hips, above) + turns[:, above] @ (rig.heads[index] - rig.heads[above])


def _reaching(
    rig: Rig, limb: list[int], upper: np.ndarray, lower: np.ndarray, goal: np.ndarray, hinge: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The turns (F, 3, 3) of a limb's two upper bones by which its third begins at goals (F, 3) m, or near them.

    Goals are from where the limb begins; near them is where these are too far. `hinge` (3,) is the axis of the upper
    bone at rest that the lower one bends about. It bends more or less about that, which leaves what it bends sideways,
    and both swing together the least.
    """
    first, second = np.diff(rig.heads[limb], axis=0)
    one, two = float(np.linalg.norm(first)), float(np.linalg.norm(second))
    way, ahead = upper @ first / one, lower @ second / two
    cross = np.cross(way, ahead)
    sine = np.linalg.norm(cross, axis=1)[:, None]
    bent = cross * np.arctan2(sine, (way * ahead).sum(axis=1)[:, None]) / np.maximum(sine, NO_TURN)
    axis = upper @ hinge
    axis -= way * (axis * way).sum(axis=1)[:, None]
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    far = np.clip(np.linalg.norm(goal, axis=1), abs(one - two), (one + two) * MOST_STRETCHED)[:, None]
    angle = np.arccos(np.clip((far**2 - one**2 - two**2) / (2 * one * two), -1, 1))
    aside = bent - axis * (bent * axis).sum(axis=1)[:, None]
    much = np.linalg.norm(aside, axis=1)[:, None]
    again = aside * np.minimum(1, angle / np.maximum(much, NO_TURN)) + axis * np.sqrt(np.maximum(angle**2 - much**2, 0))
    anew = turn_of(again)
    swing = least_turn(one * way + two * (anew @ way[..., None])[..., 0], goal)
    return swing @ upper, swing @ anew @ turn_of(-bent) @ lower
