# SPDX-License-Identifier: GPL-3.0-or-later
"""Virtual occlusion by the real meshes of a scene: the body's own capsules or whatever mesh a user gave it.

Every mesh is taken into the space of the segment that carries it once, so nothing is rebuilt when the body moves: the
rays come to the mesh. A mesh that is skinned to the armature is cut into one piece a bone. Such a piece is open: on
which side of it a marker beyond its rim sits is asked of the whole skin at rest.
"""

from dataclasses import dataclass
from functools import cached_property

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from ..core.papers.virtual_occlusions.occlusion import OCCLUDING, segment_distance2
from .armature import SCALE
from .body import Capsule, capsule_shape

# How thick a mesh of flat faces is; assumed.
BALL_STEPS = 8  # that a ball inside is made smaller by, until it touches two faces
FACETS = 0.97  # a ball in flat faces touches them this much nearer than in the round body that they stand for
SQUARELY = 0.9999  # of a distance, along a face's normal: with less the nearest place is an edge or a corner
INSET_M = 1e-5  # from the wall, where the ray to the far one starts
MIN_DIVISOR_M = 1e-9  # what is divided by is never less


@dataclass(frozen=True, eq=False)
class Mesh:
    """Corners (V, 3) m and faces, (T, 3) where all are triangles, and a tree of them once it is asked for."""

    corners: np.ndarray
    faces: np.ndarray | list

    @cached_property
    def tree(self) -> BVHTree:
        """What rays are cast at."""
        faces = self.faces.tolist() if isinstance(self.faces, np.ndarray) else self.faces
        return BVHTree.FromPolygons(self.corners.tolist(), faces)


@dataclass(frozen=True, eq=False)
class Volume:
    """A mesh fixed to segment `segment`, in its axes from its joint, m, and a capsule around it for quick answers."""

    segment: int
    mesh: Mesh
    # (3,) m, the line in the middle of that capsule; radius m
    start: np.ndarray
    axis: np.ndarray
    radius: float
    skin: "Skin | None" = None  # of a piece of a mesh, the mesh that it was cut from


@dataclass(frozen=True, eq=False)
class Skin:
    """A whole mesh at rest, around a piece of it."""

    mesh: Mesh
    joint: np.ndarray  # (3,) m where the piece's own axes start in those of the mesh
    rim: np.ndarray  # (T,) True for the piece's triangles that touch a cut


@dataclass(eq=False)
class MeshOcclusion:
    """Meshes on a skeleton as the volume in the way: an `addon.core.papers.virtual_occlusions.occlusion.Occlusion`."""

    volumes: list[Volume]  # the meshes, each in its segment's own axes: rays are brought there
    # (3,) m for one unit of the marker set, of the body that the meshes were made for; other bodies stretch them
    scale: np.ndarray

    def __post_init__(self):
        volumes = self.volumes
        self._segment = np.array([volume.segment for volume in volumes])
        self._start = np.array([volume.start for volume in volumes])
        self._axis = np.array([volume.axis for volume in volumes])
        self._radius = np.array([volume.radius for volume in volumes])

    def hidden(
        self, rotations: np.ndarray, joints: np.ndarray, scale: np.ndarray, markers: np.ndarray, centres: np.ndarray
    ) -> np.ndarray:
        """See `addon.core.papers.virtual_occlusions.occlusion.Occlusion.hidden`: (B, C, M)."""
        found = np.zeros((len(markers), len(centres), markers.shape[1]), dtype=bool)
        for body in range(len(markers)):
            if np.isfinite(joints[body]).all():
                stretch = scale[body] / self.scale
                self._hide(found[body], rotations[body], joints[body], stretch, markers[body], centres)
        return found

    def _hide(self, found: np.ndarray, rotations, joints, stretch: np.ndarray, markers, centres: np.ndarray):
        """Marks in `found` (C, M) what one body hides."""
        standoff = OCCLUDING.standoff * float(self.scale.mean())
        turn, joint = rotations[self._segment], joints[self._segment]
        seen = np.flatnonzero(np.isfinite(markers).all(axis=1))
        points = (markers[seen] - joint[:, None]) @ turn / stretch
        eyes = (centres - joint[:, None]) @ turn / stretch
        near = self._near(points, eyes, standoff)
        for index, point in np.argwhere(near.any(axis=1)).tolist():
            cameras = np.flatnonzero(near[index, :, point] & ~found[:, seen[point]])
            if len(cameras):
                hides = _hides(self.volumes[index], points[index, point], eyes[index, cameras], standoff)
                found[cameras, seen[point]] = hides

    def _near(self, points: np.ndarray, eyes: np.ndarray, standoff: float) -> np.ndarray:
        """(K, C, N) True where the line from a point (K, N, 3) to an eye (K, C, 3) comes near enough to a volume."""
        length2 = np.maximum(np.einsum("kx,kx->k", self._axis, self._axis), MIN_DIVISOR_M)
        # Every volume has axes of its own here, so each is a body of one capsule.
        gap2 = segment_distance2(self._start[:, None], self._axis[:, None], length2[:, None], points[:, :, None], eyes)
        return gap2[..., 0] <= ((self._radius + standoff) ** 2)[:, None, None]


def occlusion_of(
    context: bpy.types.Context, armature: bpy.types.Object, items: list[bpy.types.Object], markerset: MarkerSet
) -> MeshOcclusion:
    """The occlusion test of mesh objects on an armature made for `markerset`; modifiers count, the pose does not.

    The meshes are made thinner, as capsules are: a body that fits badly hides less.

    Raises InputError when there is no mesh, the armature lacks a bone of the marker set, or a mesh hangs on no bone,
    neither by parenting nor by vertex groups.
    """
    missing = [segment for segment in markerset.skeleton.segments if segment not in armature.data.bones]
    if missing:
        raise InputError(
            f"{armature.name} has no bone {missing[0]}; expected a skeleton of marker set {markerset.name}"
        )
    if "lumbar" in armature.data.bones and "lumbar" not in markerset.skeleton.segments:
        raise InputError(
            f"{armature.name} has the finer bones of a take of points; expected the skeleton of a take of blobs, or of "
            f"marker set {markerset.name}, with Show and Edit"
        )
    if not items:
        raise InputError(f"{armature.name} carries no mesh; expected one on a bone or skinned to it")
    before = armature.data.pose_position
    armature.data.pose_position = "REST"
    context.view_layer.update()
    try:
        depsgraph = context.evaluated_depsgraph_get()
        volumes = [one for item in items for one in _volumes(item, armature, markerset, depsgraph)]
    finally:
        armature.data.pose_position = before
        context.view_layer.update()
    return MeshOcclusion(volumes, np.array(armature[SCALE], dtype=float))


def capsule_meshes(markerset: MarkerSet) -> MeshOcclusion:
    """The occlusion test of the meshes that `body.add_body` makes of a marker set's capsules, without the objects."""
    scale, volumes = np.full(3, markerset.spread.height), []
    for index, segment in enumerate(markerset.capsules.segment):
        capsule = Capsule.of(markerset, index, scale)
        radius, place = capsule.radius * OCCLUDING.fitted_shrink, capsule.place
        along = capsule.half * place[:3, 2]
        corners, faces = capsule_shape(capsule.half, radius)
        mesh = Mesh(corners @ place[:3, :3].T + place[:3, 3], faces)
        volumes.append(Volume(int(segment), mesh, place[:3, 3] - along, 2 * along, radius))
    return MeshOcclusion(volumes, scale)


def meshes_on(armature: bpy.types.Object, scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The mesh objects of a scene that hang on an armature, by parenting or by a modifier."""
    return [
        item for item in scene.objects if item.type == "MESH" and (item.parent == armature or _skinned(item, armature))
    ]


def _skinned(item: bpy.types.Object, armature: bpy.types.Object) -> bool:
    return any(modifier.type == "ARMATURE" and modifier.object == armature for modifier in item.modifiers)


def _hides(volume: Volume, point: np.ndarray, eyes: np.ndarray, standoff: float) -> list[bool] | bool:
    """Whether a mesh stands between a point (3,) and each of the eyes (C, 3), all in the axes of the mesh."""
    start = _outside(volume, point, standoff)
    if start is None:
        return False
    ahead = eyes - start
    reach = np.linalg.norm(ahead, axis=1)
    rows = zip((ahead / reach[:, None]).tolist(), reach.tolist(), strict=True)
    return [volume.mesh.tree.ray_cast(start, way, far)[0] is not None for way, far in rows]


def _outside(volume: Volume, point: np.ndarray, standoff: float) -> np.ndarray | None:
    """The point itself, or moved to `standoff` m before the surface if it is nearer or inside.

    None where it is so deep inside that nobody can tell on which side of the body it sits.
    """
    surface, normal, face, distance = volume.mesh.tree.find_nearest(point.tolist())
    along = abs((point - np.array(surface)) @ np.array(normal))
    if volume.skin is None or not volume.skin.rim[face] or along > SQUARELY * distance:
        return _moved_out(volume.mesh.tree, point, standoff)
    moved = _moved_out(volume.skin.mesh.tree, point + volume.skin.joint, standoff)
    return None if moved is None else moved - volume.skin.joint


def _moved_out(tree: BVHTree, point: np.ndarray, standoff: float) -> np.ndarray | None:
    """See `_outside`; of a closed mesh."""
    surface, normal, _, distance = tree.find_nearest(point.tolist())
    surface, normal = np.array(surface), np.array(normal)
    away = point - surface
    inside = away @ normal < 0
    if not inside and distance >= standoff:
        return point
    outward = normal if distance < MIN_DIVISOR_M else away * ((-1 if inside else 1) / distance)
    if inside and distance > (1 - OCCLUDING.min_side_share) * _ball_radius(tree, surface, outward):
        return None
    return surface + outward * standoff


def _ball_radius(tree: BVHTree, surface: np.ndarray, outward: np.ndarray) -> float:
    """The largest ball inside the mesh that touches it at `surface`: how thick the body is there.

    A ball as wide as the way to the far wall shrinks onto whatever reaches into it (Ma, Bae and Choi's shrinking ball).
    """
    far = tree.ray_cast((surface - outward * INSET_M).tolist(), (-outward).tolist())[3]
    if far is None:
        return np.inf
    radius = far / 2
    for _ in range(BALL_STEPS):
        centre = surface - outward * radius
        touch, _, _, distance = tree.find_nearest(centre.tolist())
        chord = surface - np.array(touch)
        if distance >= radius * FACETS or chord @ outward < MIN_DIVISOR_M:
            break
        radius = float(chord @ chord / (2 * chord @ outward))
    return radius


def _volumes(item: bpy.types.Object, armature: bpy.types.Object, markerset: MarkerSet, depsgraph) -> list[Volume]:
    """The volumes of one mesh object, one for each segment that carries some of it."""
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
    joints = [np.array(armature.data.bones[name].head_local, dtype=float) for name in markerset.skeleton.segments]
    placed = _shrunk(placed, triangles, owner)
    whole = Mesh(placed, triangles)
    return [
        _piece(int(segment), placed, triangles, owner == segment, whole, joints[segment])
        for segment in np.unique(owner)
    ]


def _piece(
    segment: int, points: np.ndarray, triangles: np.ndarray, part: np.ndarray, whole: Mesh, joint: np.ndarray
) -> Volume:
    """The triangles `part` (T,) of a mesh as a volume of the segment whose joint (3,) is there."""
    used, rows = np.unique(triangles[part], return_inverse=True)
    own = points[used] - joint
    shared = np.zeros(len(points), dtype=bool)
    shared[triangles[~part]] = True
    rim = shared[triangles[part]].any(axis=1)
    skin = Skin(whole, joint, rim) if rim.any() else None
    return Volume(segment, Mesh(own, rows.reshape(-1, 3)), *_around(own), skin)


def _shrunk(points: np.ndarray, triangles: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Every corner (V, 3) of a mesh moved inwards by a part of how thick its piece is there, as a capsule is.

    owner (T,) says which piece a triangle belongs to. Where a piece is open the whole mesh says how thick it is.
    """
    corners = points[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(points)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], faces)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), MIN_DIVISOR_M)
    thick = np.full(len(points), np.inf)
    for part in (*(owner == segment for segment in np.unique(owner)), np.ones(len(owner), dtype=bool)):
        tree = Mesh(points, triangles[part]).tree
        for corner in np.unique(triangles[part]):
            if np.isinf(thick[corner]):
                thick[corner] = _ball_radius(tree, points[corner], normals[corner])
    # Where the whole mesh is open there is no far wall, and nothing to shrink towards.
    return points - normals * np.where(np.isfinite(thick), (1 - OCCLUDING.fitted_shrink) * thick, 0)[:, None]


def _around(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """A capsule around points (V, 3), along the way in which they reach farthest: start, axis (3,) and radius."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    _, vectors = np.linalg.eigh(np.cov((points - middle).T))
    along = (points - middle) @ vectors[:, 2]
    radius = float(np.linalg.norm(points - middle - np.outer(along, vectors[:, 2]), axis=1).max())
    # The ends are round: a corner near one is within the radius of a shorter axis already.
    low, high = min(along.min() + radius, 0.0), max(along.max() - radius, 0.0)
    axis = vectors[:, 2] * (high - low)
    start = middle + vectors[:, 2] * low
    place = np.clip((points - start) @ axis / max(axis @ axis, MIN_DIVISOR_M), 0, 1)
    return start, axis, float(np.linalg.norm(points - start - np.outer(place, axis), axis=1).max())


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
