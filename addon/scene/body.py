# SPDX-License-Identifier: GPL-3.0-or-later
"""The body as meshes: every capsule of the marker set on its bone, each turning about its own middle."""

from dataclasses import dataclass

import bpy
import numpy as np

from ..core.data.markersets import MarkerSet
from . import armature as armatures
from . import naming
from .armature import SIDE_COLOURS, segment_sides
from .ownership import changed_by_us

AROUND, RINGS = 24, 6
COLOUR = (0.55, 0.65, 0.8, 0.35)
TINT = 0.55  # of the colour of a side in that of the body
START, END, RADIUS = "mocap_start", "mocap_end", "mocap_radius"


@dataclass(frozen=True, eq=False)
class Capsule:
    """One capsule in metres."""

    place: np.ndarray  # (4, 4) where its own axes sit in its segment, from the joint: its middle, z along it
    half: float  # half the length between its ends
    radius: float  # around the line between them

    @classmethod
    def of(cls, markerset: MarkerSet, index: int, scale: np.ndarray) -> "Capsule":
        """Capsule `index` of a set for a subject of `scale` (3,): ends stretch with it, the radius with its mean."""
        capsules = markerset.capsules
        start, end = capsules.start[index] * scale, capsules.end[index] * scale
        length = np.linalg.norm(end - start)
        z = (end - start) / length if length > 0 else np.array([0.0, 0.0, 1.0])
        x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
        x /= np.linalg.norm(x)
        place = np.eye(4)
        place[:3] = np.column_stack([x, np.cross(z, x), z, (start + end) / 2])
        return cls(place, float(length / 2), float(capsules.radius[index] * scale.mean()))

    def hang(self, item: bpy.types.Object, armature: bpy.types.Object, segment: str):
        """Hangs a mesh of this capsule on the bone of a segment."""
        item[START], item[END], item[RADIUS] = [0.0, 0.0, -self.half], [0.0, 0.0, self.half], self.radius
        armatures.attach(item, armature, segment, self.place)


def add_body(
    collection: bpy.types.Collection,
    armature: bpy.types.Object,
    markerset: MarkerSet,
    scale: np.ndarray,
    material: bpy.types.Material | None = None,
) -> list[bpy.types.Object]:
    """Adds a mesh for each of the K capsules, hung on its bone; `scale` (3,) is m for one unit of the marker set.

    They have the `material`, or where there is none the colours of the body's sides.
    """
    meshes = []
    sides = segment_sides(markerset)
    for index, segment in enumerate(markerset.capsules.segment):
        name, capsule = markerset.skeleton.segments[segment], Capsule.of(markerset, index, scale)
        vertices, faces = capsule_shape(capsule.half, capsule.radius)
        mesh = bpy.data.meshes.new("Capsule")
        mesh.from_pydata(vertices.tolist(), [], faces)
        mesh.shade_smooth()
        item = bpy.data.objects.new(f"{name} capsule", mesh)
        item[naming.CAPSULE], item.hide_render = name, True
        collection.objects.link(item)
        capsule.hang(item, armature, name)
        item[naming.MATERIAL] = material or _material(sides[name])
        item.data.materials.append(item[naming.MATERIAL])
        meshes.append(item)
    return meshes


def fit_body(home: bpy.types.Collection, armature: bpy.types.Object, markerset: MarkerSet, scale: np.ndarray):
    """Gives the capsules of a body, which hang on an armature, the place and size that they have by another scale.

    What a person made of them, or took away, stays so.
    """
    hung = [item for item in home.all_objects if naming.CAPSULE in item and item.parent == armature]
    for number, name in enumerate(markerset.skeleton.segments):
        own = np.flatnonzero(markerset.capsules.segment == number).tolist()
        items = [item for item in hung if item[naming.CAPSULE] == name]
        for index, item in zip(own, items, strict=False) if len(own) == len(items) else ():
            capsule = Capsule.of(markerset, index, scale)
            vertices, _ = capsule_shape(capsule.half, capsule.radius)
            with changed_by_us(item):
                if len(item.data.vertices) == len(vertices):
                    item.data.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
                    item.data.update()
                capsule.hang(item, armature, name)


def capsule_shape(half: float, radius: float) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """Corners (V, 3) m and faces of a closed mesh of the points within `radius` of the z axis from -half to half m.

    The corners lie on the capsule, so the mesh is inside it by at most `radius` times 1 - cos(π / 24), under 1 %.
    """
    lift = np.linspace(0, np.pi / 2, RINGS + 1)
    bottom = np.column_stack([np.sin(lift), -np.cos(lift)])[1:]
    profile = np.concatenate([bottom * radius - [0, half], bottom[::-1] * [radius, -radius] + [0, half]])
    turn = np.arange(AROUND) * 2 * np.pi / AROUND
    rings = np.stack(
        [
            np.outer(profile[:, 0], np.cos(turn)),
            np.outer(profile[:, 0], np.sin(turn)),
            np.repeat(profile[:, 1:], AROUND, axis=1),
        ],
        axis=-1,
    ).reshape(-1, 3)
    return np.concatenate([rings, [[0, 0, -half - radius], [0, 0, half + radius]]]), _faces(len(profile))


def _faces(rings: int) -> list[tuple[int, ...]]:
    """Quads between neighbouring rings and a fan at each pole, all facing outwards."""
    faces, low, high = [], rings * AROUND, rings * AROUND + 1
    for step in range(AROUND):
        one, other = np.arange(rings) * AROUND + step, np.arange(rings) * AROUND + (step + 1) % AROUND
        quads = np.column_stack([one[:-1], other[:-1], other[1:], one[1:]])
        faces += [(low, int(other[0]), step), *map(tuple, quads.tolist()), (high, int(one[-1]), int(other[-1]))]
    return faces


def _material(side: str) -> bpy.types.Material:
    """The see-through material of a side of the body, made once a file."""
    name = naming.title({"L": "body left", "R": "body right"}.get(side, "body"))
    material = bpy.data.materials.get(name)
    if material is None:
        material = bpy.data.materials.new(name)
        tinted = zip(COLOUR[:3], SIDE_COLOURS[side], strict=True)
        material.diffuse_color = (*((1 - TINT) * own + TINT * tint for own, tint in tinted), COLOUR[3])
    return material
