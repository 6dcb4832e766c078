# SPDX-License-Identifier: GPL-3.0-or-later
"""A long take that plays from a file beside the Blender file, by Blender's own means: nothing in it grows with frames.

A hidden mesh has a vertex for every marker, which a Mesh Cache modifier moves, and the markers' empties hang on the
vertices. Further vertices carry the numbers that bones would be keyed with, three each, in their x, y and z; empties
on these drive the bones. The mesh itself never moves: the armature hangs on the take's root, and the markers' empties
follow that by a constraint. All of this runs in any Blender, with or without us.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet, Worn
from ..core.data.takes import Suspect
from ..core.filling.ground import settled
from ..io.poses import PART_BYTES, cache_mark, check_cache, write_cache
from ..io.text import written
from . import armature as armatures
from . import naming
from .body import add_body
from .clock import TakeClock, fps_of
from .markers import add_marker
from .performers import body_material, home_of, performers_of
from .roots import ensure_root
from .take import SOURCE, SUSPECTS
from .timing import CARRIER, give_time, keep_clock, kept_clock, plays_from_file, time_cache

if TYPE_CHECKING:
    from ..io.poses import PoseFile

PLAYED = "mocap_played"  # on the collection: the name of the take
MOTION_MARK = "mocap_motion_mark"  # what the file is known again by
FOR_A_PART = "mocap_for_a_part"  # what labels a part of the take as all of it was labelled, and the take's frames
BONE_NUMBERS = 7  # a bone: location x y z, rotation w x y z
OPENED_AROUND = 5.0  # s before and after what is to be looked at: a shorter part tells little of its subject
SETTLED_FRAMES = 16_384  # that are put on the ground at once; memory
SEEN_AROUND = 5.0  # s before and after them that are looked at for that; a plant is seldom longer
MOST_SUSPECTS = 1000  # that the Blender file keeps, the longest; the report has all


@dataclass(frozen=True, eq=False)
class Playing:
    """A long take as it comes from the labelling."""

    name: str  # what to call it
    rate: float  # frames a second
    worn: Worn  # whose markers were named
    # gives the places (n, M, 3) m of a slice of frames, NaN where there are none
    markers: Callable[[slice], np.ndarray]
    poses: "PoseFile"  # the poses of all frames, as `io.poses.PoseFile` has them
    suspects: Sequence[Suspect]  # ranges of frames to look at
    source: str  # the file of the take, empty if there is none
    for_a_part: dict  # what labels a part of it as all of it was labelled, as a job says it


class _Bones:
    """The numbers of one performer's bones, part by part, each rotation on the side of the one before."""

    def __init__(self, performer, armature: bpy.types.Object, markerset: MarkerSet, build: armatures.Build):
        self.rows, self.armature = performer.joint_rows, armature
        self.ends = armatures.bone_tails(markerset, build) - build.joints
        self.parents, self.rest = markerset.skeleton.parents, armatures.rest_matrices(armature, markerset)
        self.segments = markerset.skeleton.segments
        self.last = np.full((len(self.segments), 4), np.nan)

    def settled(self, joints: np.ndarray, rotations: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
        """The own ones of the joints (n, all, 3) and rotations (n, all, 3, 3) of everybody, with planted feet."""
        return settled(joints[:, self.rows], rotations[:, self.rows], self.segments, self.parents, self.ends, rate)

    def numbers(self, joints: np.ndarray, rotations: np.ndarray) -> np.ndarray:
        """(n, 7 J) of the own joints (n, J, 3) and rotations (n, J, 3, 3)."""
        columns = []
        for index, (location, turn) in enumerate(armatures.bone_channels(self.parents, self.rest, rotations, joints)):
            known = np.flatnonzero(np.isfinite(turn).all(axis=1))
            if len(known):
                turn = -turn if turn[known[0]] @ self.last[index] < 0 else turn
                self.last[index] = turn[known[-1]]
            columns += [location, turn]
        return np.concatenate(columns, axis=1)


def show_playing(context: bpy.types.Context, take: Playing, cache: Path) -> bpy.types.Collection:
    """Writes the motion of a take to `cache`, and builds what plays it in the context's scene.

    Needs object mode. The modifier looks for the file beside the Blender file, which must be saved there.
    """
    scene, poses = context.scene, take.poses
    ends = np.array([poses.first_frame, poses.first_frame + poses.frames - 1])
    clock = give_time(scene, take.rate, ends, TakeClock.of(ends))
    clock = clock if plays_from_file(clock) else replace(clock, start=1)
    collection = _child(scene.collection, naming.title(take.name))
    bones, sample, empties, root = [], poses.sampled(), {}, ensure_root(scene, collection, take.name)
    # The hidden mesh whose vertices the file moves.
    carrier = bpy.data.objects.new(f"{collection.name} motion", bpy.data.meshes.new(f"{collection.name} motion"))
    carrier.hide_viewport = carrier.hide_render = carrier.hide_select = True
    collection.objects.link(carrier)
    for performer, (_, markerset) in zip(performers_of(take.worn), take.worn.worn, strict=True):
        home = home_of(collection, performer, {})
        build = armatures.build_of(markerset, performer.motion_of(sample))
        armature = armatures.add_armature(context, home, f"{performer.name or take.name} armature", markerset, build)
        armature.parent = root
        bones.append(_Bones(performer, armature, markerset, build))
        add_body(_child(home, f"{home.name} body"), armature, markerset, build.scale, body_material(home))
        place = _child(home, f"{home.name} markers")
        for index in range(*performer.marker_rows.indices(len(take.worn.markers))):
            empties[index] = add_marker(place, take.worn.markers[index])
            empties[index].show_name = True
            _hang(empties[index], carrier, index)
            empties[index].constraints.new("CHILD_OF").target = root
    numbers = BONE_NUMBERS * sum(len(one.segments) for one in bones)
    vertices = len(take.worn.markers) + -(-numbers // 3)
    carrier.data.vertices.add(vertices)
    seen = np.zeros(len(take.worn.markers), bool)
    write_cache(cache, _frames(take, bones, vertices, seen), _absent(take, bones, vertices))
    for index, empty in empties.items():
        # Standing still in the moving body it would look like a wrong name.
        empty.hide_viewport = empty.hide_render = not seen[index]
    _drive(collection, carrier, bones, len(take.worn.markers))
    modifier = carrier.modifiers.new("Motion", "MESH_CACHE")
    modifier.cache_format = "PC2"
    time_cache(modifier, clock)
    modifier.filepath = "//" + written(cache.name)
    _keep(collection, carrier, take, cache, clock)
    return collection


def _frames(take: Playing, bones: list[_Bones], vertices: int, seen: np.ndarray) -> Iterator[np.ndarray]:
    """The vertices (n, V, 3) of all frames, part by part; notes who is `seen` (M,)."""
    count = len(seen)
    size = max(PART_BYTES // (200 * vertices), 1)
    around = round(SEEN_AROUND * take.rate)
    for part, inner, joints, rotations in take.poses.parts(size * max(SETTLED_FRAMES // size, 1), around):
        pose = [one.settled(joints, rotations, take.rate) for one in bones]
        for start in range(0, part.stop - part.start, size):
            own = slice(inner.start + start, min(inner.start + start + size, inner.stop))
            frames = slice(part.start + start, part.start + start + own.stop - own.start)
            found = np.zeros((own.stop - own.start, vertices, 3))
            found[:, :count] = take.markers(frames)
            seen |= np.isfinite(found[:, :count]).all(axis=2).any(axis=0)
            numbers = [one.numbers(*(table[own] for table in both)) for one, both in zip(bones, pose, strict=True)]
            flat = np.concatenate(numbers, axis=1)
            found[:, count:].reshape(len(found), -1)[:, : flat.shape[1]] = flat
            yield found


def _absent(take: Playing, bones: list[_Bones], vertices: int) -> np.ndarray:
    """(V, 3) what to show of what is never known: markers where the body has them, bones at rest."""
    count, bone = len(take.poses.expected), [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    rest = bone * sum(len(one.segments) for one in bones)
    absent = np.zeros((vertices, 3))
    absent[:count] = np.nan_to_num(take.poses.expected)
    absent[count:].reshape(-1)[: len(rest)] = rest
    return absent


def _hang(empty: bpy.types.Object, carrier: bpy.types.Object, vertex: int):
    """Hangs an empty on a vertex."""
    empty.parent, empty.parent_type, empty.parent_vertices = carrier, "VERTEX", (vertex, 0, 0)


def _drive(collection: bpy.types.Collection, carrier: bpy.types.Object, bones: list[_Bones], first: int):
    """Makes every bone follow its numbers, which are in the vertices from `first` on."""
    place = _child(collection, f"{collection.name} numbers")
    place.hide_viewport = place.hide_render = True
    channels = [("location", axis) for axis in range(3)] + [("rotation_quaternion", axis) for axis in range(4)]
    driven = [
        (one.armature.pose.bones[name], *channel) for one in bones for name in one.segments for channel in channels
    ]
    for number, (bone, path, axis) in enumerate(driven):
        if number % 3 == 0:
            vertex = first + number // 3
            empty = bpy.data.objects.new(f"{collection.name} {vertex}", None)
            _hang(empty, carrier, vertex)
            place.objects.link(empty)
        _follow(bone.driver_add(path, axis), empty, "XYZ"[number % 3])


def _follow(curve: bpy.types.FCurve, empty: bpy.types.Object, axis: str):
    """The value is the place of an empty along an axis."""
    for modifier in list(curve.modifiers):
        curve.modifiers.remove(modifier)
    curve.keyframe_points.clear()  # at 0 and 1, to which Blender pulls whatever is within 1e-4
    driver = curve.driver
    driver.type = "SUM"
    variable = driver.variables.new()
    variable.type = "TRANSFORMS"
    target = variable.targets[0]
    target.id, target.transform_type, target.transform_space = empty, f"LOC_{axis}", "WORLD_SPACE"


def _keep(collection: bpy.types.Collection, carrier: bpy.types.Object, take: Playing, cache: Path, clock: TakeClock):
    longest = sorted(take.suspects, key=lambda one: -one.frames)[:MOST_SUSPECTS]
    rows = sorted([int(one.first), int(one.last), one.reason] for one in longest)
    collection[PLAYED], collection[SOURCE], collection[naming.MARKERSET] = take.name, take.source, take.worn.name
    collection[MOTION_MARK], collection[CARRIER] = cache_mark(cache), carrier
    collection[SUSPECTS] = json.dumps(rows)
    ends = np.array([take.poses.first_frame, take.poses.first_frame + take.poses.frames - 1])
    keep_clock(collection, clock, take.rate, ends)
    collection[FOR_A_PART] = json.dumps({**take.for_a_part, "ends": [int(end) for end in ends]})


def _child(parent: bpy.types.Collection, name: str) -> bpy.types.Collection:
    child = bpy.data.collections.new(name)
    parent.children.link(child)
    return child


def played_takes(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """The takes of a scene that play from files."""
    return [collection for collection in scene.collection.children_recursive if PLAYED in collection]


def modifier_of(collection: bpy.types.Collection) -> bpy.types.Modifier:
    """What plays a take; InputError where a user took it away."""
    carrier = collection.get(CARRIER)
    for modifier in carrier.modifiers if carrier is not None else ():
        if modifier.type == "MESH_CACHE":
            return modifier
    raise InputError("the object that plays the take was taken away; expected it: open the saved file again")


def motion_path(collection: bpy.types.Collection) -> Path:
    """Where the motion of a take is looked for."""
    return Path(bpy.path.abspath(modifier_of(collection).filepath, library=collection.library))


_known: dict[tuple, str] = {}


def what_is_wrong(collection: bpy.types.Collection) -> str:
    """One sentence where the motion of a take is not there as it was saved; empty where all is well.

    Files are looked into only when they changed.
    """
    try:
        path, mark = motion_path(collection), str(collection[MOTION_MARK])
        try:
            status = path.stat()
            state = str(path), mark, status.st_size, status.st_mtime_ns
        except OSError:
            state = None
        if state is None or state not in _known:
            check_cache(path, mark)
            _known.clear()
            _known[state] = ""
    except InputError as error:
        return str(error)
    return ""


def find_motion(collection: bpy.types.Collection, path: Path):
    """Lets a take play from the file at `path`; InputError where it is not that take's."""
    check_cache(path, str(collection[MOTION_MARK]))
    modifier_of(collection).filepath = bpy.path.relpath(str(path)) if bpy.data.filepath else str(path)


def for_a_part(collection: bpy.types.Collection) -> dict:
    """What labels a part of a take, with its first and last frame, `ends`."""
    return json.loads(collection[FOR_A_PART])


def clock_of(collection: bpy.types.Collection) -> TakeClock:
    """When a take plays that plays from a file."""
    return kept_clock(collection, for_a_part(collection)["ends"][0])


def part_here(collection: bpy.types.Collection, scene: bpy.types.Scene) -> tuple[int, int]:
    """First and last frame, as Blender counts, of the part of a take that somebody looks at.

    That is the preview range where there is one, `OPENED_AROUND` seconds to both sides of its middle at least, else
    what is to be looked at in the current frame and as much before and after it.
    """
    now, around = scene.frame_current, round(OPENED_AROUND * fps_of(scene))
    if scene.use_preview_range:
        first, last = scene.frame_preview_start, scene.frame_preview_end
        middle = (first + last) // 2
        return min(first, middle - around), max(last, middle + around)
    here = [(first, last) for first, last, _ in suspects_of(collection) if first <= now <= last]
    first, last = min((one for one, _ in here), default=now), max((one for _, one in here), default=now)
    return first - around, last + around


def suspects_of(collection: bpy.types.Collection) -> list[tuple[int, int, str]]:
    """First and last frame, as Blender counts, and reason of what to look at in a take."""
    clock = clock_of(collection)
    rows = json.loads(collection[SUSPECTS])
    return [(clock.whole(first), clock.whole(last), reason) for first, last, reason in rows]
