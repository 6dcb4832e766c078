# SPDX-License-Identifier: GPL-3.0-or-later
"""Virtual occlusion by the real meshes of a scene: the body's own capsules or whatever mesh a user gave it.

Every mesh is taken into the space of the segment that carries it once, so nothing is rebuilt when the body moves: the
rays come to the mesh. A mesh that is skinned to the armature is cut into one piece a bone.
"""

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

from ..core.body.occlusion import SIDE_UNKNOWN, STANDOFF
from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from .armature import SCALE

BALL_STEPS = 8
FACETS = 0.97  # a ball in a mesh of flat faces touches them this much nearer than in the round body they stand for
TINY = 1e-9


@dataclass(frozen=True, eq=False)
class Volume:
    """A mesh fixed to segment `segment`, in its axes from its joint, m; a ball around it for quick answers."""

    segment: int
    tree: BVHTree
    centre: np.ndarray
    radius: float


class MeshOcclusion:
    """Meshes on a skeleton as the volume in the way: an `addon.core.body.occlusion.Occlusion`.

    volumes  the meshes
    scale    (3,) m for one unit of the marker set, of the body that the meshes were made for; other bodies stretch them
    """

    def __init__(self, volumes: list[Volume], scale: np.ndarray):
        self.volumes = volumes
        self.scale = np.asarray(scale, dtype=float)

    def hidden(
        self, rotations: np.ndarray, joints: np.ndarray, scale: np.ndarray, markers: np.ndarray, centres: np.ndarray
    ) -> np.ndarray:
        """See `addon.core.body.occlusion.Occlusion.hidden`: (B, C, M)."""
        found = np.zeros((len(markers), len(centres), markers.shape[1]), dtype=bool)
        standoff = STANDOFF * float(self.scale.mean())
        for body in range(len(markers)):
            if not np.isfinite(joints[body]).all():
                continue
            seen = np.flatnonzero(np.isfinite(markers[body]).all(axis=1))
            stretch = scale[body] / self.scale
            for volume in self.volumes:
                turn, joint = rotations[body, volume.segment], joints[body, volume.segment]
                points = (markers[body, seen] - joint) @ turn / stretch
                eyes = (centres - joint) @ turn / stretch
                found[body][:, seen] |= _volume_hides(volume, points, eyes, standoff)
        return found


def occlusion_of(
    context: bpy.types.Context, armature: bpy.types.Object, items: list[bpy.types.Object], markerset: MarkerSet
) -> MeshOcclusion:
    """The occlusion test of mesh objects on an armature made for `markerset`; modifiers count, the pose does not.

    Raises InputError when there is no mesh, the armature lacks a bone of the marker set, or a mesh hangs on no bone,
    neither by parenting nor by vertex groups.
    """
    missing = [segment for segment in markerset.skeleton.segments if segment not in armature.data.bones]
    if missing:
        raise InputError(
            f"{armature.name} has no bone {missing[0]}; expected a skeleton of marker set {markerset.name}"
        )
    if not items:
        raise InputError(f"{armature.name} carries no mesh; expected one on a bone or skinned to it")
    before = armature.data.pose_position
    armature.data.pose_position = "REST"
    context.view_layer.update()
    try:
        depsgraph = context.evaluated_depsgraph_get()
        volumes = [piece for item in items for piece in _volumes(item, armature, markerset, depsgraph)]
    finally:
        armature.data.pose_position = before
        context.view_layer.update()
    return MeshOcclusion(volumes, np.array(armature[SCALE], dtype=float))


def meshes_on(armature: bpy.types.Object, scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The mesh objects of a scene that hang on an armature, by parenting or by a modifier."""
    return [
        item for item in scene.objects if item.type == "MESH" and (item.parent == armature or _skinned(item, armature))
    ]


def _skinned(item: bpy.types.Object, armature: bpy.types.Object) -> bool:
    return any(modifier.type == "ARMATURE" and modifier.object == armature for modifier in item.modifiers)


def _volume_hides(volume: Volume, points: np.ndarray, eyes: np.ndarray, standoff: float) -> np.ndarray:
    """(C, N) True where the volume stands between points (N, 3) and eyes (C, 3), both in its segment's axes."""
    hides = np.zeros((len(eyes), len(points)), dtype=bool)
    near = _crosses_ball(volume, points, eyes, standoff)
    for index in np.flatnonzero(near.any(axis=0)):
        start = _outside(volume.tree, points[index], standoff)
        if start is None:
            continue
        ahead = eyes[near[:, index]] - start
        reach = np.linalg.norm(ahead, axis=1)
        rows = zip((ahead / reach[:, None]).tolist(), reach.tolist(), strict=True)
        hides[near[:, index], index] = [volume.tree.ray_cast(start, way, far)[0] is not None for way, far in rows]
    return hides


def _crosses_ball(volume: Volume, points: np.ndarray, eyes: np.ndarray, standoff: float) -> np.ndarray:
    """(C, N) True where the line from a point to an eye comes so near that the volume could be in the way."""
    ray = eyes[:, None] - points[None]
    to_ball = volume.centre - points
    along = np.einsum("cnx,nx->cn", ray, to_ball) / np.maximum(np.einsum("cnx,cnx->cn", ray, ray), TINY)
    miss = to_ball[None] - np.clip(along, 0, 1)[..., None] * ray
    return np.einsum("cnx,cnx->cn", miss, miss) <= (volume.radius + standoff) ** 2


def _outside(tree: BVHTree, point: np.ndarray, standoff: float) -> list[float] | None:
    """The point itself, or moved to `standoff` m before the surface if it is nearer or inside.

    None where it is so deep inside that nobody can tell on which side of the body it sits.
    """
    surface, normal, _, distance = tree.find_nearest(point.tolist())
    surface, normal = np.array(surface), np.array(normal)
    away = point - surface
    inside = away @ normal < 0
    if not inside and distance >= standoff:
        return point.tolist()
    outward = normal if distance < TINY else away * ((-1 if inside else 1) / distance)
    if inside and distance > (1 - SIDE_UNKNOWN) * _ball_radius(tree, surface, outward):
        return None
    return (surface + outward * standoff).tolist()


def _ball_radius(tree: BVHTree, surface: np.ndarray, outward: np.ndarray) -> float:
    """The largest ball inside the mesh that touches it at `surface`: how thick the body is there.

    A ball as wide as the way to the far wall shrinks onto whatever reaches into it (Ma, Bae and Choi's shrinking ball).
    """
    far = tree.ray_cast((surface - outward * 1e-5).tolist(), (-outward).tolist())[3]
    if far is None:
        return np.inf
    radius = far / 2
    for _ in range(BALL_STEPS):
        centre = surface - outward * radius
        touch, _, _, distance = tree.find_nearest(centre.tolist())
        chord = surface - np.array(touch)
        if distance >= radius * FACETS or chord @ outward < TINY:
            break
        radius = float(chord @ chord / (2 * chord @ outward))
    return radius


def _volumes(item: bpy.types.Object, armature: bpy.types.Object, markerset: MarkerSet, depsgraph) -> list[Volume]:
    """The pieces of one mesh object, one for each segment that carries some of it."""
    evaluated = item.evaluated_get(depsgraph)
    mesh = evaluated.to_mesh()
    try:
        points = np.empty(len(mesh.vertices) * 3, dtype=np.float32)
        mesh.vertices.foreach_get("co", points)
        triangles = np.empty(len(mesh.loop_triangles) * 3, dtype=np.int32)
        mesh.loop_triangles.foreach_get("vertices", triangles)
        triangles = triangles.reshape(-1, 3)
        owner = _owners(item, armature, mesh, triangles, markerset)
    finally:
        evaluated.to_mesh_clear()
    to_armature = np.array(armature.matrix_world.inverted() @ evaluated.matrix_world, dtype=float)
    placed = points.reshape(-1, 3).astype(float) @ to_armature[:3, :3].T + to_armature[:3, 3]
    if np.linalg.det(to_armature[:3, :3]) < 0:
        triangles = triangles[:, ::-1]
    pieces = []
    for segment in np.unique(owner):
        joint = np.array(armature.data.bones[markerset.skeleton.segments[segment]].head_local, dtype=float)
        pieces.append(_volume(int(segment), placed - joint, triangles[owner == segment]))
    return pieces


def _volume(segment: int, points: np.ndarray, triangles: np.ndarray) -> Volume:
    used, rows = np.unique(triangles, return_inverse=True)
    points = points[used]
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = float(np.linalg.norm(points - centre, axis=1).max())
    tree = BVHTree.FromPolygons(points.tolist(), rows.reshape(-1, 3).tolist(), all_triangles=True)
    return Volume(segment, tree, centre, radius)


def _owners(item, armature, mesh, triangles: np.ndarray, markerset: MarkerSet) -> np.ndarray:
    """(T,) index of the segment that carries each triangle of a mesh."""
    segments = markerset.skeleton.segments
    if item.parent == armature and item.parent_type == "BONE" and item.parent_bone in segments:
        return np.full(len(triangles), segments.index(item.parent_bone))
    groups = {group.index: segments.index(group.name) for group in item.vertex_groups if group.name in segments}
    if not groups or not (_skinned(item, armature) or item.parent == armature):
        raise InputError(
            f"mesh {item.name} hangs on no bone; expected it parented to a bone of {armature.name} or skinned to it"
        )
    weights = np.zeros((len(mesh.vertices), len(segments)))
    for index, vertex in enumerate(mesh.vertices):
        for element in vertex.groups:
            if element.group in groups:
                weights[index, groups[element.group]] += element.weight
    return np.argmax(weights[triangles].sum(axis=1), axis=1)
