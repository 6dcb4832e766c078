# SPDX-License-Identifier: GPL-3.0-or-later
"""How the body stands on the floor, and moves rigs of people's own: python -m tests.accuracy.bodies.

Recorded takes under their own names. When a foot is planted is told by the markers on it. Prints the tables of
results/bodies.json; needs `bpy` with its Rigify.
"""

from collections.abc import Callable, Iterator

import bpy
import numpy as np

from addon.core.body.bodies import BodyModel
from addon.core.data.markersets import Capsules, MarkerSet, Skeleton, Spread
from addon.core.data.takes import BY_FIT, NO_MARKER, Labels, Motion, PointRows, Points
from addon.core.geometry.cameras import NO_CAMERAS
from addon.core.geometry.rigid import best_turns, in_axes, laid_on
from addon.core.geometry.rotations import carried, rotation_vector
from addon.core.points.motion import motion_of
from addon.core.posing.character import Character
from addon.core.posing.ends import with_ends
from addon.core.posing.finer import finer
from addon.core.posing.posing import fit_points
from addon.core.retarget.matching import match_bones
from addon.core.review.suspects import runs
from addon.io.models import open_model
from addon.io.points import read_points
from addon.scene.armature import bone_tails, build_of, on_ground
from addon.scene.character import moving_in
from addon.scene.opened import Opened
from addon.scene.retargeting import rest_bones, retarget_take
from addon.scene.take import Take, show_take
from scripts.results import markdown
from tests.inputs.rigs import drawn, generated, hanging, metarig, mixamo, nameless, unreal

from . import people

SLOW_M_S, SPAN_S, PLANT_S, LOW_M, STILL_M = 0.1, 0.05, 0.15, 0.05, 0.01  # of markers on a planted foot
LIMBS = {"upper_arm": "forearm", "forearm": "hand", "thigh": "shank", "shank": "foot"}
HAND = people.DATA.parent / "strangers" / "animal_hand" / "hand.tsv"
HAND_STRIDE, PERSON_M, WRIST_M = 10, 1.75, 0.06  # frames; whose hand it is; the wrist, behind the plate on the back
NEAR_S = 0.2  # before and after plants, in which toes are compared
ON_RIGS = ("karate", "basketball", "walk 1")


def cases() -> Iterator[tuple[str, str, people.Take]]:
    """What each take is called, and its marker set."""
    takes = {"karate": ("actor41", "s135"), "break dance": ("actor41", "bd"), "basketball": ("actor41", "ball")}
    for title, (model, name) in (takes | {"tennis serve": ("body39", "serve")}).items():
        yield title, model, people.read(people.DATA / people.OTHERS[name], name)
    for number, walk in enumerate(people.takes(people.WALKERS[:3], "walk"), 1):
        yield f"walk {number}", "body26", walk


def posed(take: people.Take, markerset: MarkerSet) -> Motion:
    """The body as it is fitted to a take whose markers have their names."""
    xyz = take.pick(markerset.markers)
    there = np.isfinite(xyz[..., 0])
    labels = Labels(np.where(there, np.arange(len(markerset)), NO_MARKER), there * BY_FIT, there * 1.0)
    return motion_of(xyz, np.where(there, 1e-4, np.nan), labels, markerset, np.arange(len(xyz)))


def plants(take: people.Take, side: str) -> list[tuple[int, int]]:
    """First frames and ends of when the ball of a foot is planted."""
    toe = take.pick([next(side + one for one in ("TOE", "MT1") if side + one in take.markers)])[:, 0]
    span = max(round(SPAN_S * take.rate), 1)
    slow = np.zeros(len(toe), bool)
    slow[span:-span] = np.linalg.norm(toe[2 * span :] - toe[: -2 * span], axis=1) < SLOW_M_S * 2 * span / take.rate
    if slow.any():
        slow &= toe[:, 2] < np.nanquantile(toe[slow, 2], 0.1) + LOW_M
    long = [(first, end) for first, end in runs(slow, 1) if end - first >= PLANT_S * take.rate]
    return [part for part in long if slide(toe[slice(*part)]) <= STILL_M]


def slide(path: np.ndarray) -> float:
    """M, how far a path (F, 3) spreads over the floor."""
    return float(np.linalg.norm(np.ptp(path[:, :2], axis=0)))


def largest_turn(rotated: np.ndarray) -> float:
    """Degrees, of rotations (F, J, 3, 3) from one frame to the next, both of them known."""
    cosine = (np.einsum("fjik,fjik->fj", rotated[1:], rotated[:-1]) - 1) / 2
    return float(np.degrees(np.arccos(np.clip(np.nanmin(cosine), -1, 1))))


def on_floor(take: people.Take, markerset: MarkerSet, fitted: Motion, shown: Motion, tips: np.ndarray) -> list[str]:
    """A row of the first table of a motion as it is shown; `tips` (J, 3) m is where bones end, in their axes."""
    segments, at = markerset.skeleton.segments, markerset.attachment
    heights, slides = [], []
    for side in "LR":
        ankle, ball = (shown.joints[:, segments.index(f"{part}.{side}")] for part in ("foot", "toes"))
        toes = segments.index(f"toes.{side}")
        tip = ball + carried(shown.rotations[:, toes], tips[toes])
        heights.append(np.min([ankle[:, 2], ball[:, 2], tip[:, 2]], axis=0))
        slides += [slide(ball[first:end]) for first, end in plants(take, side)]
    heights = np.concatenate(heights)
    heights = heights[np.isfinite(heights)]
    # Where markers are on the fitted body, on the one that is shown.
    own = np.einsum("fmji,fmj->fmi", fitted.rotations[:, at], fitted.expected - fitted.joints[:, at])
    off = shown.joints[:, at] + np.einsum("fmij,fmj->fmi", shown.rotations[:, at], own) - take.pick(markerset.markers)
    return [
        *(f"{100 * (heights < -deep).mean():.1f}" for deep in (0.005, 0.02)),
        f"{len(slides)}",
        *quantiles(1000 * np.array(slides)),
        f"{largest_turn(shown.rotations):.0f}",
        *quantiles(1000 * np.linalg.norm(off, axis=2)),
    ]


def quantiles(values: np.ndarray) -> list[str]:
    """The median and what 99 % are below, as cells."""
    return [f"{value:.1f}" for value in np.nanquantile(values, (0.5, 0.99))] if values.size else ["", ""]


RIGS: dict[str, Callable[[], bpy.types.Object]] = {
    "Rigify's metarig": metarig,
    "Rigify, generated": generated,
    "Rigify, generated, by IK": generated,
    "Mixamo's names, as FBX": mixamo,
    "Unreal's names, A-pose": unreal,
    "VRM's names, hanging arms": hanging,
    "no names": nameless,
    "a drawn figure": drawn,
}
# What Rigify's controls move.
MOVED = {"torso": "ORG-spine", "neck": "ORG-spine.004", "head": "ORG-spine.006"}


def on_rigs(take: people.Take, markerset: MarkerSet, motion: Motion) -> Iterator[list[str]]:
    """The rows of the second table."""
    bpy.ops.wm.read_homefile(use_empty=True)
    context, scene = bpy.context, bpy.context.scene
    marker = np.where(np.isfinite(motion.residual), np.arange(len(markerset)), NO_MARKER)
    rows = PointRows.of(Points(markerset.markers, motion.markers, motion.residual, take.rate, 0))
    labels = Labels(*(table[marker >= 0] for table in (marker, np.full(marker.shape, BY_FIT), np.ones(marker.shape))))
    collection = show_take(context, Take(take.name, take.rate, NO_CAMERAS, markerset, rows, labels, motion))
    stored = Opened().take(collection, scene)
    character = moving_in(collection, stored).character
    shown = on_ground(motion, markerset, build_of(markerset, motion), take.rate)
    body = character.posed(shown.joints, shown.rotations)
    found = np.flatnonzero(np.isfinite(body[0]).all(axis=(1, 2)))
    context.view_layer.layer_collection.children[collection.name].exclude = True  # only rigs have to move
    for title, make in RIGS.items():
        rig = make()
        context.view_layer.update()
        matched = match_bones(rest_bones(rig))
        bones = matched
        if "torso" in matched.values():
            bones = {part: MOVED.get(bone, "ORG-" + bone.replace("_fk", "")) for part, bone in matched.items()}
        retarget_take(context, rig, collection, stored, matched, False, False)
        free = hips_of(rig, bones, found)
        retarget_take(context, rig, collection, stored, matched, True, False)
        away = np.linalg.norm(hips_of(rig, bones, found) - free, axis=1)
        if title.endswith("by IK"):
            switch_to_ik(rig)
        yield [title, *followed(take, character, body, rig, bones, away)]
        bpy.data.objects.remove(rig)


def switch_to_ik(rig: bpy.types.Object):
    """Switches the limbs of Rigify's human to IK, as a person does after `Retarget`."""
    curves = rig.animation_data.action.layers[0].strips[0].channelbags[0].fcurves
    for curve in [curve for curve in curves if curve.data_path.endswith('["IK_FK"]')]:
        curves.remove(curve)
    for bone in (bone for bone in rig.pose.bones if "IK_FK" in bone):
        bone["IK_FK"] = 0.0
    rig.update_tag()


def hips_of(rig: bpy.types.Object, bones: dict[str, str], frames: np.ndarray) -> np.ndarray:
    """(K, 3) m the middle between where the thighs of a rig begin, in so many frames."""
    places, thighs = np.empty((len(frames), 3)), [rig.pose.bones[bones[f"thigh.{side}"]] for side in "LR"]
    for row, frame in enumerate(frames):
        bpy.context.scene.frame_set(int(frame))
        places[row] = rig.matrix_world @ ((thighs[0].head + thighs[1].head) / 2)
    return places


def followed(
    take: people.Take,
    character: Character,
    posed_body: tuple[np.ndarray, np.ndarray],
    rig: bpy.types.Object,
    bones: dict[str, str],
    away: np.ndarray,
) -> list[str]:
    """How a rig follows where a body's bones begin (F, B, 3) and are turned (F, B, 3, 3): limbs, feet, hips, toes.

    `away` (K,) m is how far its hips are from where they are without Keep Feet.
    """
    body, turned = posed_body
    parts, found = [part for part in bones if part in character.names], np.isfinite(body).all(axis=(1, 2))
    posed, tips = np.full((len(body), len(parts), 4, 4), np.nan), np.full((len(body), 2), np.nan)
    toes, world = [bones[f"toes.{side}"] for side in "LR"], rig.matrix_world
    for frame in np.flatnonzero(found):
        bpy.context.scene.frame_set(int(frame))
        posed[frame] = [world @ rig.pose.bones[bones[part]].matrix for part in parts]
        tips[frame] = [min(_higher(rig, world, toe, end) for end in ("head", "tail")) for toe in toes]
    theirs = {part: posed[:, at, :3, 3] for at, part in enumerate(parts)}
    ours = {part: body[:, character.names.index(part)] for part in parts}
    angles: dict[str, list[np.ndarray]] = {"arm": [], "leg": []}
    for begin, end in LIMBS.items():
        for side in "LR":
            ways = [places[f"{end}.{side}"] - places[f"{begin}.{side}"] for places in (theirs, ours)]
            ways = [way / np.linalg.norm(way, axis=1, keepdims=True) for way in ways]
            off = np.degrees(np.arccos(np.clip((ways[0] * ways[1]).sum(axis=1), -1, 1)))
            angles["arm" if "arm" in begin else "leg"].append(off[found])
    planted = [theirs[f"toes.{side}"][first:end] for side in "LR" for first, end in plants(take, side)]
    slips = np.concatenate([np.linalg.norm((path - np.nanmedian(path, axis=0))[:, :2], axis=1) for path in planted])
    axes = posed[..., :3, :3] / np.linalg.norm(posed[..., :3, :3], axis=-2, keepdims=True)
    turns = []
    for side in "LR":
        rows = found.copy()
        for first, end in plants(take, side):
            rows[first:end] = False
        own = turned[rows, character.names.index(f"foot.{side}")]
        turns.append(off_their_mean(own.swapaxes(1, 2) @ axes[rows, parts.index(f"foot.{side}")]))
    return [
        *quantiles(np.concatenate(angles["arm"])),
        *quantiles(np.concatenate(angles["leg"])),
        *quantiles(1000 * slips),
        *quantiles(np.concatenate(turns)),
        *quantiles(1000 * away * leg(ours, found) / leg(theirs, found)),
        f"{100 * (tips[found] < -0.01).mean():.1f}",
        f"{largest_turn(axes):.0f}",
    ]


def leg(places: dict[str, np.ndarray], found: np.ndarray) -> float:
    """M, how long a leg is from hip to ankle."""
    ways = [np.subtract(places[f"{end}.L"], places[f"{begin}.L"]) for begin, end in list(LIMBS.items())[2:]]
    return float(np.median(np.linalg.norm(ways, axis=2).sum(axis=0)[found]))


def off_their_mean(turns: np.ndarray) -> np.ndarray:
    """Degrees (K,) by which rotations (K, 3, 3) are off what they are in the mean."""
    (mean,), _ = best_turns(turns.mean(axis=0, keepdims=True))
    return np.degrees(np.linalg.norm(rotation_vector(mean.T @ turns), axis=1))


def _higher(rig: bpy.types.Object, world, bone: str, end: str) -> float:
    """M, how much higher an end of a bone is than at rest."""
    return (world @ getattr(rig.pose.bones[bone], end)).z - (world @ getattr(rig.data.bones[bone], f"{end}_local")).z


def toes_off() -> Iterator[list[str]]:
    """The rows of the third table: how far a marker on the big toe is from where foot or toes would carry it.

    It is carried from where it is in the first third of each plant, when the foot is flat. And how fast it turns about
    the ball, and they do.
    """
    markerset = finer(open_model("body26").markerset)
    segments = markerset.skeleton.segments
    off: dict[str, list[np.ndarray]] = {"foot": [], "toes": [], "marker": []}
    pitched: dict[str, list[float]] = {part: [] for part in off}
    for person in people.WALKERS:
        walk = people.read(people.files_of(person)[people.KINDS.index("walk")], person)
        fitted = posed(walk, markerset)
        shown = on_ground(fitted, markerset, build_of(markerset, fitted), walk.rate)
        for side in (side for side in "LR" if plants(walk, side)):
            way = walk.pick([f"{side}HLX"])[:, 0] - shown.joints[:, segments.index(f"toes.{side}")]
            span, near, flat = round(NEAR_S * walk.rate), np.zeros(len(way), bool), np.zeros(len(way), bool)
            turns = {part: shown.rotations[:, segments.index(f"{part}.{side}")] for part in ("foot", "toes")}
            for first, end in plants(walk, side):
                near[max(first - span, 0) : end + span] = flat[first : first + (end - first) // 3] = True
                ahead = turns["foot"][(first + end) // 2, :2, 0]
                for part, ways in ({part: turn[..., 0] for part, turn in turns.items()} | {"marker": way}).items():
                    pitched[part].append(largest_pitch(ways[end : end + span], ahead))
            for part, turn in turns.items():
                place = np.nanmedian(carried(turn.swapaxes(1, 2), way)[flat], axis=0)
                off[part].append(1000 * (carried(turn, place) - way)[near])
            off["marker"].append(np.zeros((1, 3)))
    for title, part in (("as the foot", "foot"), ("shown", "toes"), ("the marker", "marker")):
        gone = np.concatenate(off[part])
        values = np.nanquantile([np.abs(gone[:, 2]), np.linalg.norm(gone, axis=1)], (0.5, 0.9, 0.99), axis=1)
        yield [title, *(f"{value:.1f}" for value in values.T.ravel()), f"{np.nanmedian(pitched[part]):.1f}"]


def largest_pitch(ways: np.ndarray, ahead: np.ndarray) -> float:
    """Degrees, of directions (F, 3) from one frame to the next, seen from the side of who looks `ahead` (2,)."""
    pitch = np.unwrap(np.arctan2(ways[:, 2], ways[:, :2] @ ahead / np.linalg.norm(ahead)))
    return float(np.degrees(np.nanmax(np.abs(np.diff(pitch)), initial=0.0)))


def fingers_off() -> Iterator[list[str]]:
    """The rows of the fourth table: how far a fitted hand is from the markers on fingers, which move, and on its back.

    The set is the hand alone: markers sit where they are in the mean in the axes of the plate on its back.
    """
    take = read_points(HAND)
    names, xyz = take.names, take.xyz[::HAND_STRIDE]
    plate = [names.index(f"hand_{at}") for at in ("top", "left", "right")]
    for title, ends in (("tips", ("_tip",)), ("middles", ("_middle",)), ("tips and middles", ("_tip", "_middle"))):
        on = [names.index(name) for name in names if name.endswith(ends)]
        points = xyz[:, [*plate, *on]]
        first = points[0, :3] - points[0, :3].mean(axis=0)
        places = np.nanmean(in_axes(*laid_on(first, points[:, :3]), points), axis=0)
        ahead = places[3:].mean(axis=0) / np.linalg.norm(places[3:].mean(axis=0))
        markerset = _hand(tuple(names[at] for at in (*plate, *on)), (places + WRIST_M * ahead) / PERSON_M)
        for how, one in (("as the hand", markerset), ("of their own", with_ends(markerset))):
            model = BodyModel(one)
            off = 1000 * np.linalg.norm(model.pose(fit_points(model, points)).markers - points, axis=2)
            fingers = (f"{value:.1f}" for value in np.nanquantile(off[:, 3:], (0.5, 0.9, 0.99)))
            yield [title, how, *fingers, f"{np.nanmedian(off[:, :3]):.1f}"]


def _hand(names: tuple[str, ...], places: np.ndarray) -> MarkerSet:
    """A right hand alone, with markers at places (M, 3) from its wrist, heights."""
    none, count = np.zeros((0, 3)), len(names)
    spread = Spread(
        PERSON_M, 0.05, np.zeros((0, 1 + count, 3)), np.full(count, 0.004), np.zeros((1, 3)), np.zeros((3, 3))
    )
    capsules = Capsules(np.zeros(0, int), none, none, np.zeros(0))
    skeleton = Skeleton(("hand.R",), np.array([-1]), np.zeros((1, 3)))
    return MarkerSet("hand", "", names, {}, skeleton, np.zeros(count, int), places, capsules, spread, {})


def main():
    """Prints the tables."""
    import addon_utils

    people.need_people()
    addon_utils.enable("rigify", default_set=True)
    floor, rigs = [], []
    for title, model, take in cases():
        markerset = finer(open_model(model).markerset)
        fitted = posed(take, markerset)
        build = build_of(markerset, fitted)
        tips = bone_tails(markerset, build) - build.joints
        for how, shown in (("fitted", fitted), ("shown", on_ground(fitted, markerset, build, take.rate))):
            floor.append([title, how, *on_floor(take, markerset, fitted, shown, tips)])
        if title in ON_RIGS:
            rigs += [[title, *row] for row in on_rigs(take, markerset, fitted)]
    head = ["take", "body", "feet 5 mm in the floor, %", "20 mm, %", "plants", "slide, mm", "slide at 99 %, mm"]
    head += ["largest turn, °", "from its markers, mm", "from them at 99 %, mm"]
    print(markdown(head, floor), flush=True)
    head = ["take", "rig", "arms off, °", "arms at 99 %, °", "legs off, °", "legs at 99 %, °"]
    head += ["planted feet off, mm", "feet at 99 %, mm"]
    head += ["feet in the air off, °", "those at 99 %, °", "hips off, mm", "hips at 99 %, mm"]
    head += ["feet 10 mm in the floor, %", "largest turn, °"]
    print(markdown(head, rigs))
    head = ["toes", "height off, mm", "height at 90 %, mm", "height at 99 %, mm"]
    head += ["off, mm", "off at 90 %, mm", "off at 99 %, mm", "largest turn, °"]
    print(markdown(head, list(toes_off())))
    head = ["markers on", "fingers", "off them, mm", "at 90 %, mm", "at 99 %, mm", "off those on the hand's back, mm"]
    print(markdown(head, list(fingers_off())))


if __name__ == "__main__":
    main()
