# SPDX-License-Identifier: GPL-3.0-or-later
"""Points without names as one object: of all frames' points in its mesh it shows those of the current frame.

Geometry nodes do the choosing, so the file plays anywhere, with the extension or without.
"""

import bpy
import numpy as np

from . import naming, storage

POINT_RADIUS = 0.008  # m
FRAME = "frame"


def add_cloud(collection: bpy.types.Collection, mesh: bpy.types.Mesh) -> bpy.types.Object:
    """Adds the object that shows `mesh`, a table made by `cloud_table`."""
    item = bpy.data.objects.new(mesh.name, mesh)
    collection.objects.link(item)
    item.modifiers.new("Points of the frame", "NODES").node_group = _nodes()
    return item


def cloud_table(name: str, frames: np.ndarray, points: np.ndarray, **columns: np.ndarray) -> bpy.types.Mesh:
    """A mesh of N points (N, 3) m at Blender's `frames` (N,), with further columns for `storage.read_table`."""
    mesh = storage.store_table(name, {FRAME: frames, **columns})
    mesh.vertices.foreach_set("co", np.ascontiguousarray(points, dtype=np.float32).ravel())
    return mesh


def cloud_points(mesh: bpy.types.Mesh) -> np.ndarray:
    """(N, 3) m where the points of a table are."""
    flat = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", flat)
    return flat.reshape(-1, 3).astype(float)


def _nodes() -> bpy.types.NodeTree:
    """The nodes that keep the points of the current frame, made once a file."""
    name = naming.title("points of the frame")
    tree = bpy.data.node_groups.get(name)
    if tree is not None:
        return tree
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    entry, leave = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    frame, now = tree.nodes.new("GeometryNodeInputNamedAttribute"), tree.nodes.new("GeometryNodeInputSceneTime")
    frame.data_type = "INT"
    frame.inputs["Name"].default_value = FRAME
    same = tree.nodes.new("FunctionNodeCompare")
    same.data_type, same.operation = "INT", "EQUAL"
    one, other = (socket for socket in same.inputs if socket.type == "INT")
    points = tree.nodes.new("GeometryNodeMeshToPoints")
    points.inputs["Radius"].default_value = POINT_RADIUS
    attribute = next(socket for socket in frame.outputs if socket.enabled and socket.name == "Attribute")
    for start, end in (
        (entry.outputs[0], points.inputs["Mesh"]),
        (attribute, one),
        (now.outputs["Frame"], other),
        (same.outputs["Result"], points.inputs["Selection"]),
        (points.outputs[0], leave.inputs[0]),
    ):
        tree.links.new(start, end)
    for column, node in enumerate((entry, frame, now, same, points, leave)):
        node.location = (200 * column, 0)
    return tree
