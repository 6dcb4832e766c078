# SPDX-License-Identifier: GPL-3.0-or-later
"""A labelled take as a whole: gathered from the labelling, shown in a scene, kept in the file and read back."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, field, fields, replace
from secrets import token_hex
from typing import Any, Self

import bpy
import numpy as np

from ..core.data.errors import JobError
from ..core.data.markersets import Worn
from ..core.data.merging import LabelledRange, joined
from ..core.data.takes import STEPS, Blobs, LabelledChunk, Labels, Motion, PointRows, Suspect
from ..core.edits.kinds import Edits
from ..core.filling.kept import KeptFill, filled_samples, put_fills
from ..core.filling.smoothing import smoothed
from ..core.geometry import rotations
from ..core.geometry.cameras import NO_CAMERAS, Cameras
from ..core.geometry.force_plates import NO_LAB, LabRecords
from ..core.geometry.measuring import measured_again
from . import armature as armatures
from . import cameras as scene_cameras
from . import markers as scene_markers
from . import naming, ownership, storage
from .animation import TakeActions
from .body import add_body
from .clock import TakeClock, refresh_frame
from .corrections import keep_edits, kept_text
from .fills import FILL_PATHS, keep_cutoff, keep_fills
from .lab import forget_events, show_lab
from .performers import Colour, Performer, body_material, home_of, homes, performers_in_row, performers_of, rows_of
from .roots import ensure_root, parent_of, remove_root
from .storage import FRAME, add_cloud, cloud_table
from .stored import Stored, changed_between, digest_of, digests_of
from .timing import FRAME_TABLE, RATE, give_time, keep_clock, kept_clock

ROWS, MOTION, POSE = "mocap_blobs", "mocap_motion", "mocap_pose"
EXPECTED = "mocap_expected"
KEPT_BODY = "mocap_body"  # on the table of poses: which body it has, another one after each change
POSED_ON = "posed_on"  # of a frame: the digest of the labels that the body was posed on
SHOWN_BODY = "mocap_shown_body"  # on an action: the digest of the body that it shows
SUSPECTS, SOURCE = "mocap_suspects", "mocap_source"
MARKER_NAMES, MARKER_WORDS, STEP_NAMES = "mocap_names", "mocap_marker_words", "mocap_steps"
PARENTS, SEGMENTS, PERFORMERS = "mocap_parents", "mocap_segments", "mocap_performers"
TRAJECTORY, POINT, RESIDUAL = "trajectory", "point", "point_residual"


@dataclass(frozen=True, eq=False)
class Take:
    """Everything about one labelled take of F frames and N blobs, or N points without cameras."""

    name: str  # what to call it
    rate: float  # frames a second
    cameras: Cameras  # that saw it; none where the take came as points
    markerset: Worn  # whose markers were named: one set, or those that several subjects wear
    rows: Blobs | PointRows  # all N blobs or points of the take, in the order of their file
    labels: Labels  # row for row with `rows`
    motion: Motion  # frame for frame with `rows.frames`
    suspects: tuple[Suspect, ...] = ()  # ranges of frames to look at
    source: str = ""  # the file of the take, empty if there is none
    doubts: tuple[str, ...] | None = None  # what is odd about its cameras, a sentence each; None where nobody looked
    # what a person said of the rows, which the labels follow; None where nobody said anything
    edits: Edits | None = None
    unedited: Labels | None = None  # the program's own labels, of which the edits give these; None where they are these
    fills: tuple[KeptFill, ...] = ()  # gaps that were filled, which `motion` has not
    # Hz, by which the markers are shown smoothed, which `motion` is not; None for as they are
    cutoff: float | None = None
    # of performers by their names; a usual one for who has none
    colours: Mapping[str, Colour] = field(default_factory=dict)
    # frames, by the source's numbers, whose body was posed on other labels
    old_body: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    lab: LabRecords = NO_LAB  # events and force plates of its file
    # from which of Blender's frames on it plays; None for its own where Blender can count so
    clock: TakeClock | None = None

    @classmethod
    def of(
        cls,
        name: str,
        rate: float,
        cameras: Cameras,
        worn: Worn,
        chunks: Sequence[tuple[Blobs | PointRows, LabelledChunk]],
        source: str,
        **more: Any,
    ) -> Self:
        """The take of consecutive rows and what was made of them; `more` are further fields. JobError without any."""
        if not chunks:
            raise JobError("the take holds no frames; expected at least one frame with blobs")
        parts = [LabelledRange(rows, one.labels, one.motion, one.suspects, one.unedited) for rows, one in chunks]
        take = cls(name, rate, cameras, worn, source=source, **vars(joined(parts)), **more)
        return take if take.edits else replace(take, unedited=None)

    @property
    def posed_on(self) -> np.ndarray:
        """(F,) the digests of the labels that the body was posed on."""
        now = digests_of(self.rows, self.labels, self.motion)
        return np.where(np.isin(self.motion.frames, self.old_body), now ^ 1, now)


def show_take(
    context: bpy.types.Context, take: Take, collection: bpy.types.Collection | None = None
) -> bpy.types.Collection:
    """Builds a take in the context's scene: cameras, armature, body and keyed markers in a collection `Mocap: NAME`.

    Or in the collection of a take that was cleared by `clear_take`, with whatever of a person's is in there. All hangs
    on one root. Performers with names have a collection each in it. The points that have no name are one object.
    Returns that collection, which also keeps the take itself (`stored_take`). The scene's frames and rate become the
    take's, or, where what a person made goes by them, it is mapped to them. Needs object mode; adds no undo step.
    """
    scene = context.scene
    clock = TakeClock.of(take.motion.frames) if take.clock is None else take.clock
    clock = give_time(scene, take.rate, take.motion.frames, clock)
    frames = clock.shown(take.motion.frames)
    camera_collection = scene_cameras.find_or_add_cameras(scene, take.cameras) if len(take.cameras) else None
    if collection is None:
        collection = bpy.data.collections.new(naming.title(take.name))
        scene.collection.children.link(collection)
        ownership.sign(collection, collection.name)
    actions, root = TakeActions(collection.name), ensure_root(scene, collection, take.name)
    names = take.markerset.markers
    motion, unfit = put_fills(take.motion, names, take.fills)
    if take.cutoff is not None:
        motion = replace(motion, markers=smoothed(motion.markers, take.rate, take.cutoff))
    fitting = [fill for fill, reason in zip(take.fills, unfit, strict=True) if not reason]
    filled = filled_samples(take.motion.frames, names, fitting)
    for performer, (_, markerset) in zip(performers_of(take.markerset), take.markerset.worn, strict=True):
        home, own = home_of(collection, performer, take.colours), performer.motion_of(motion)
        build = armatures.build_of(markerset, own)
        armature = armatures.add_armature(context, home, f"{performer.name or take.name} armature", markerset, build)
        armature.parent = root
        shown = armatures.on_ground(own, markerset, build, take.rate, take.cutoff)
        armatures.pose_armature(armature, actions, markerset, shown, frames)
        ownership.sign(armature, f"{performer.name} armature", collection)
        armature.animation_data.action[SHOWN_BODY] = digest_of(take.posed_on, take.cutoff)
        place = ownership.made_collection(collection, home, f"{home.name} body", f"{performer.name} body")
        body = add_body(place, armature, markerset, build.scale, body_material(home))
        for number, item in enumerate(body):
            ownership.sign(item, f"{performer.name} capsule {number}", collection)
        mine = performer.marker_rows
        place = ownership.made_collection(collection, home, f"{home.name} markers", f"{performer.name} markers")
        for index, name in enumerate(names[mine]):
            item = scene_markers.add_marker(place, name)
            item.parent = root
            action = actions.for_keys(int(np.isfinite(own.markers[:, index]).sum()))
            scene_markers.show_marker(item, action, own, index, frames, filled[:, mine.start + index])
            ownership.sign(item, f"marker {name}", collection)
    if isinstance(take.rows, PointRows):
        show_unnamed(collection, f"{take.name} unnamed", take.rows, take.labels, clock)
    show_lab(scene, collection, take.name, take.lab, take.motion.frames, clock, actions)
    _store(collection, take, camera_collection, clock)
    refresh_frame(scene)
    return collection


def show_unnamed(collection: bpy.types.Collection, name: str, rows: PointRows, labels: Labels, clock: TakeClock):
    """Makes the object of the points without a name show these; without one, adds it where there are some."""
    left = ~labels.named
    clouds = [one for one in collection.all_objects if one.type == "MESH" and FRAME in one.data.attributes]
    item = next((one for one in clouds if ownership.is_made_for(one, collection)), None)
    if item is None and not left.any():
        return
    table = cloud_table(name, rows.frames[rows.frame[left]] + clock.shift, rows.xyz[left])
    if item is None:
        item = add_cloud(collection, table, clock)
        item.parent = parent_of(collection)
        ownership.sign(item, ownership.WITHOUT_NAMES, collection)
        return
    with ownership.changed_by_us(item):
        before, item.data = item.data, table
    ownership.remove_unused([before])


def show_edits(collection: bpy.types.Collection, before: Stored, after: Stored):
    """Makes the empties of a take, and its points without a name, follow its edits.

    The collection shows the take as it was `before`, and then as it is `after`. Adds no undo step of its own.
    """
    frames = after.clock.shown(after.motion.frames)
    items = scene_markers.marker_empties(collection)
    action = next((item.animation_data.action for item in items.values() if item.animation_data), None)
    filled, was_filled = after.filled_markers, before.filled_markers
    for index in _changed(before, after):
        item = items.get(after.names[index])
        if item is not None:
            shown = before.motion.markers[:, index], was_filled.get(index)
            with ownership.changed_by_us(item):
                scene_markers.show_marker(item, action, after.motion, index, frames, filled.get(index), shown)
    points = isinstance(after.rows, PointRows)
    if points and not np.array_equal(before.labels.named, after.labels.named):
        show_unnamed(collection, f"{after.name} unnamed", after.rows, after.labels, after.clock)


def _changed(before: Stored, after: Stored) -> list[int]:
    """The markers that are elsewhere after other edits, fills or smoothing, or whose filled samples are others."""
    moved = changed_between(before, after, by_hand=False)
    if moved is not None:
        return sorted(moved)
    filled, was_filled, nowhere = after.filled_markers, before.filled_markers, np.zeros(len(after.motion.frames), bool)
    either = filled.keys() | was_filled.keys()
    flags = {index: [one.get(index, nowhere) for one in (filled, was_filled)] for index in either}
    refilled = {index for index, both in flags.items() if not np.array_equal(*both)}
    one, other = before.motion.markers, after.motion.markers
    elsewhere = {index for index in range(len(after.names)) if not _alike(one[:, index], other[:, index])}
    return sorted(refilled | elsewhere)


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether places (F, 3) are the same to the bit, NaN too: quicker by whole numbers, and mostly known early."""
    one, other = one.view(np.int64), other.view(np.int64)
    return np.array_equal(one[:, 0], other[:, 0]) and np.array_equal(one, other)


def takes_of(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """The collections of a scene that hold a take."""
    return [collection for collection in scene.collection.children_recursive if is_take(collection)]


def adopt_copies():
    """Makes what takes show the add-on's own in scenes that were copied in full, too."""
    for scene in bpy.data.scenes:
        here = takes_of(scene)
        for take in here:
            made = take.get(ownership.MADE)
            if any(
                one.get(ownership.MADE) == made and is_take(one) and one not in here for one in bpy.data.collections
            ):
                ownership.adopt_copy(scene, take)


def is_take(collection: bpy.types.Collection | None) -> bool:
    """True for a collection made by `show_take`."""
    return collection is not None and naming.TAKE in collection


def is_linked(collection: bpy.types.Collection) -> bool:
    """True for one of another file, with or without overrides: what is kept with it here is gone with this session."""
    return collection.library is not None or collection.override_library is not None


def remove_take(collection: bpy.types.Collection, scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """Removes a take of a scene with everything that was made for it and nobody changed; its cameras stay.

    What is a person's stays in the collection, which is returned, holds no take any more and is called so; None where
    nothing is left. One that is linked from another file is left out of this scene, and nothing of it is deleted.
    """
    if is_linked(collection):
        leave_out(collection, scene)
        return None
    name = f"Kept from {collection[naming.TAKE]}"
    materials = [body_material(home) for home in homes(collection).values()]
    places = ownership.made_places(collection)
    linked = [item for item in collection.all_objects if not set(item.users_collection) <= set(places)]
    ownership.let_go(clear_take(collection, linked))
    remove_root(collection)
    left = ownership.remove_collections(collection, name)
    for material in materials:
        ownership.remove_or_keep(material)
    return left


def leave_out(collection: bpy.types.Collection, scene: bpy.types.Scene):
    """Takes a linked take out of a scene, where other things may hang on it: out of the scene's own collection.

    One that is overridden, which may be a person's work, or lies elsewhere stays, excluded from the view layers.
    """
    if collection.override_library is None and collection in scene.collection.children.values():
        scene.collection.children.unlink(collection)
    for view_layer in scene.view_layers:
        for layer in _layers_of(collection, view_layer):
            layer.exclude = True


def is_hidden(collection: bpy.types.Collection, view_layer: bpy.types.ViewLayer) -> bool:
    """Whether a person hid a take that is in a view layer, as by its eye or its tick in the Outliner."""
    seen = [layer.visible_get() for layer in _layers_of(collection, view_layer)]
    return bool(seen) and not any(seen)


def _layers_of(
    collection: bpy.types.Collection, view_layer: bpy.types.ViewLayer
) -> Iterator[bpy.types.LayerCollection]:
    layers = [view_layer.layer_collection]
    for layer in layers:
        if layer.collection == collection:
            yield layer
        layers += layer.children


def clear_take(collection: bpy.types.Collection, but: Sequence[bpy.types.Object] = ()) -> ownership.Former:
    """Takes a take out of its collection: what is kept of it, and what was made for it and nobody changed.

    What was made is returned, to be let go; `but` these, which become a person's.
    """
    forget_events(collection)
    former = ownership.set_aside(collection, but)
    tables = [collection.get(key) for key in (ROWS, MOTION, EXPECTED, POSE, FRAME_TABLE, FILL_PATHS)]
    made = collection.get(ownership.MADE)
    ownership.release(collection)
    if made is not None:
        collection[ownership.MADE] = made
    ownership.remove_unused([table for table in tables if table is not None])
    return former


def holds_points(collection: bpy.types.Collection | None) -> bool:
    """True for a take of 3D points."""
    return is_take(collection) and POINT in collection[ROWS].attributes


def unedited_take(collection: bpy.types.Collection, scene: bpy.types.Scene) -> Stored:
    """A take as the program labelled it."""
    table, frames = storage.read_table(collection[ROWS]), storage.read_table(collection[FRAME_TABLE])
    names = tuple(json.loads(collection[MARKER_NAMES]))
    performers = performers_in_row(json.loads(collection[PERFORMERS]))
    if POINT in table:
        known = (table[name] for name in ("frame", TRAJECTORY, POINT))
        rows: Blobs | PointRows = PointRows(frames["number"], *known, table.get(RESIDUAL))
    else:
        rows = Blobs(frames["number"], *(table[field.name] for field in fields(Blobs)[1:]))
    kept, shape = storage.read_table(collection[MOTION]), (len(frames["number"]), len(names))
    motion = Motion(
        frames=frames["number"],
        markers=_by_marker(kept["markers"].reshape(*shape, 3)),
        residual=_by_marker(kept["residual"].reshape(shape)),
        residual_px=_by_marker(kept["residual_px"].reshape(shape)),
        conflicts=kept["conflicts"].reshape(shape),
        **_read_body(collection, frames, len(names), len(performers)),
    )
    # How the labels came about, as an index into STEPS.
    step = np.array([STEPS.index(step) for step in json.loads(collection[STEP_NAMES])])[table["step"]]
    labels = Labels(table["marker"], step, table["confidence"])
    if isinstance(rows, PointRows) and kept_text(collection) is not None:
        # What the file keeps of the motion may have been made with the edits.
        motion.markers[:], motion.residual[:] = np.nan, np.nan
        at = rows.frame[labels.named], labels.marker[labels.named]
        motion.markers[at] = rows.xyz[labels.named]
        if rows.residual is not None:
            motion.residual[at] = rows.residual[labels.named]
    cameras = collection.get(naming.CAMERAS)
    return Stored(
        str(collection[naming.TAKE]),
        float(collection[RATE]),
        scene_cameras.cameras_of(cameras, scene) if cameras else NO_CAMERAS,
        names,
        rows,
        labels,
        motion,
        tuple(Suspect(*row[:4], tuple(row[4]), *row[5:]) for row in json.loads(collection[SUSPECTS])),
        str(collection[SOURCE]),
        kept_clock(collection, int(frames["number"][0]) if len(frames["number"]) else 0),
        json.loads(collection[MARKER_WORDS]),
        model=str(collection[naming.MARKERSET]),
        performers=performers,
        parents=tuple(json.loads(collection[PARENTS])),
        segments=tuple(json.loads(collection[SEGMENTS])),
        posed_on=frames[POSED_ON],
    )


def _store(collection: bpy.types.Collection, take: Take, cameras: bpy.types.Collection | None, clock: TakeClock):
    title, motion = collection.name, take.motion
    labels = take.labels if take.unedited is None else take.unedited
    if take.unedited is not None and isinstance(take.rows, Blobs):
        # What a person placed has the residual 0, as nothing that was measured has.
        motion = measured_again(motion, take.rows, take.labels, labels, take.cameras, also=motion.residual == 0)
    rows = take.rows
    if isinstance(rows, Blobs):
        columns = {field.name: getattr(rows, field.name) for field in fields(Blobs)[1:]}
    else:
        columns = {"frame": rows.frame, TRAJECTORY: rows.trajectory, POINT: rows.xyz}
        columns |= {} if rows.residual is None else {RESIDUAL: rows.residual}
    columns |= {"marker": labels.marker, "step": labels.step, "confidence": labels.confidence}
    collection[ROWS] = storage.store_table(f"{title} rows", columns)
    collection[STEP_NAMES] = json.dumps(STEPS)
    flat = {
        "markers": motion.markers.reshape(-1, 3),
        "residual": motion.residual.ravel(),
        "residual_px": motion.residual_px.ravel(),
        "conflicts": motion.conflicts.ravel().astype(int),
    }
    collection[MOTION] = storage.store_table(f"{title} motion", flat)
    performers = performers_of(take.markerset)
    keep_body(collection, motion, performers, take.posed_on)
    collection[naming.TAKE] = take.name
    collection[naming.MARKERSET] = take.markerset.name
    if cameras is not None:
        collection[naming.CAMERAS] = cameras
    collection[MARKER_NAMES] = json.dumps(take.markerset.markers)
    collection[SOURCE] = take.source
    keep_clock(collection, clock, take.rate, motion.frames)
    suspects = [astuple(one)[: 5 if one.doubtful is None else 6] for one in take.suspects]
    collection[SUSPECTS] = json.dumps(suspects, default=int)  # whole numbers of NumPy as well
    collection[MARKER_WORDS] = json.dumps(take.markerset.by_name)
    collection[PERFORMERS] = json.dumps(rows_of(performers))
    skeletons = [one.skeleton for _, one in take.markerset.worn]
    above = [
        np.where(one.parents < 0, -1, one.parents + who.joints[0])
        for who, one in zip(performers, skeletons, strict=True)
    ]
    collection[PARENTS] = json.dumps(np.concatenate(above).tolist())
    collection[SEGMENTS] = json.dumps([name for one in skeletons for name in one.segments])
    if take.edits is not None:
        keep_edits(collection, take.edits)
    if take.doubts is not None:
        collection[scene_cameras.HEALTH] = json.dumps(take.doubts)
    keep_fills(collection, take.fills)
    keep_cutoff(collection, take.cutoff)


def keep_body(collection: bpy.types.Collection, motion: Motion, performers: Sequence[Performer], posed_on: np.ndarray):
    """Keeps the body of a motion with a take, in the place of the one that it has, and what labels it was posed on."""
    title = collection.name
    turns = rotations.rotation_vector(motion.rotations.reshape(-1, 3, 3))
    sizes = {_size_of(one.number): one.motion_of(motion).scale for one in performers}
    tables = {
        EXPECTED: (f"{title} expected", {"expected": motion.expected.reshape(-1, 3)}),
        POSE: (f"{title} pose", {"joints": motion.joints.reshape(-1, 3), "turns": turns}),
        FRAME_TABLE: (
            f"{title} frames",
            {"number": motion.frames, **sizes, "confidence": motion.confidence, POSED_ON: posed_on},
        ),
    }
    # In the tables that there are, because this is done between two steps of undo as well: undo keeps a collection that
    # neither step changed, and if it pointed at tables that are in none of them, that would end Blender (5.2).
    for key, (name, columns) in tables.items():
        before = collection.get(key)
        collection[key] = storage.store_table(name, columns, before)
        if before is not None and not before.users:
            bpy.data.meshes.remove(before)
    collection[POSE][KEPT_BODY] = token_hex()


def _size_of(number: int) -> str:
    """The column of the sizes of a performer by how many are before."""
    return f"scale{number}" if number else "scale"


def _read_body(
    collection: bpy.types.Collection, frames: dict[str, np.ndarray], markers: int, performers: int
) -> dict[str, np.ndarray]:
    """The body of a take, as the fields of a motion; `frames` is the table of its frames."""
    pose, count = storage.read_table(collection[POSE]), len(frames["number"])
    expected = storage.read_table(collection[EXPECTED])["expected"]
    return {
        "expected": _by_marker(expected.reshape(count, markers, 3)),
        "joints": pose["joints"].reshape(count, -1, 3),
        "rotations": rotations.turn_of(pose["turns"]).reshape(count, -1, 3, 3),
        "scale": np.concatenate([frames[_size_of(number)] for number in range(performers)], axis=1),
        "confidence": frames["confidence"],
    }


def with_kept_body(collection: bpy.types.Collection, stored: Stored) -> Stored:
    """A take as the program labelled it, with the body that the file has of it by now."""
    frames = storage.read_table(collection[FRAME_TABLE])
    own = _read_body(collection, frames, len(stored.names), len(stored.performers))
    return replace(stored, motion=replace(stored.motion, **own), posed_on=frames[POSED_ON])


def _by_marker(values: np.ndarray) -> np.ndarray:
    """The same (F, M, …) with what is one marker's side by side in memory: so curves, tables and edits want it."""
    return np.ascontiguousarray(values.swapaxes(0, 1)).swapaxes(0, 1)
