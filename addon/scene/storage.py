# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays kept in the file: a mesh that is never shown, one vertex a row, one attribute a column.

Blender saves, links, copies and undoes meshes as fast as arrays go; single precision keeps a pixel to 1/2000 and a
metre to 0.1 µm. A row number is a vertex number. A table of points can be shown as one object, which of all frames'
points shows those of the current frame: geometry nodes do the choosing, so the file plays anywhere.
"""

import bpy
import numpy as np

from . import naming
from .clock import TIES_UP, TakeClock

# Attribute types of numbers by what a row of the array looks like, and what Blender calls the values of each.
_FLOATS = {(): "FLOAT", (2,): "FLOAT2", (3,): "FLOAT_VECTOR", (4,): "QUATERNION"}
_WIDTH = {"INT": ()} | {kind: width for width, kind in _FLOATS.items()}
_VALUES = {"INT": "value", "FLOAT": "value", "FLOAT2": "vector", "FLOAT_VECTOR": "vector", "QUATERNION": "value"}
FROM = "mocap_from_"  # and a column's name: what its whole numbers count from, where they need more than 32 bits


def store_table(name: str, columns: dict[str, np.ndarray], before: bpy.types.Mesh | None = None) -> bpy.types.Mesh:
    """Keeps `columns`, arrays of N rows (whole numbers (N,), or floats (N,) or (N, 2 to 4)), in a mesh.

    It is `before`, where that has as many rows and nothing else uses it, as a copy of a take does; else a new one.
    """
    rows = len(next(iter(columns.values())))
    if before is not None and before.users == 1 and len(before.vertices) == rows:
        mesh = before
    else:
        mesh = bpy.data.meshes.new(name)
        mesh.vertices.add(rows)
    for key, column in columns.items():
        mesh.pop(FROM + key, None)
        if np.issubdtype(column.dtype, np.integer) or column.dtype == bool:
            kind, dtype = "INT", np.int32
            if len(column) and np.abs(column).max() > np.iinfo(dtype).max:
                mesh[FROM + key] = float(column.min())
                column = column - column.min()
        else:
            kind, dtype = _FLOATS[column.shape[1:]], np.float32
        attribute = mesh.attributes.get(key) or mesh.attributes.new(key, kind, "POINT")
        attribute.data.foreach_set(_VALUES[kind], np.ascontiguousarray(column, dtype=dtype).ravel())
    return mesh


def read_table(mesh: bpy.types.Mesh) -> dict[str, np.ndarray]:
    """The columns of a mesh written by `store_table`: whole numbers as int64, the rest as float64."""
    columns = {}
    for attribute in mesh.attributes:
        if attribute.domain != "POINT" or attribute.name.startswith(".") or attribute.name == "position":
            continue
        shape = _WIDTH[attribute.data_type]
        whole = attribute.data_type == "INT"
        flat = np.empty(len(mesh.vertices) * int(np.prod(shape, dtype=int)), dtype=np.int32 if whole else np.float32)
        attribute.data.foreach_get(_VALUES[attribute.data_type], flat)
        column = flat.reshape(-1, *shape).astype(np.int64 if whole else float)
        columns[attribute.name] = column + int(mesh[FROM + attribute.name]) if FROM + attribute.name in mesh else column
    return columns


POINT_RADIUS = 0.008  # m
FRAME = "frame"
NODES = naming.title("points of the frame")


def add_cloud(collection: bpy.types.Collection, mesh: bpy.types.Mesh, clock: TakeClock) -> bpy.types.Object:
    """Adds the object that shows `mesh`, a table made by `cloud_table`, by a clock."""
    item = bpy.data.objects.new(mesh.name, mesh)
    item.hide_render = True
    collection.objects.link(item)
    item.modifiers.new("Points of the frame", "NODES").node_group = _nodes(clock)
    return item


def is_cloud(item: bpy.types.Object) -> bool:
    """Whether an object shows a table made by `cloud_table`, by the modifier that it was given."""
    return item.type == "MESH" and FRAME in item.data.attributes and any(map(_chooses, item.modifiers))


def show_moments(item: bpy.types.Object, clock: TakeClock):
    """Lets an object made by `add_cloud` show its points by another clock."""
    for modifier in filter(_chooses, item.modifiers):
        before, modifier.node_group = modifier.node_group, _nodes(clock)
        if not before.users:
            bpy.data.node_groups.remove(before)


def _chooses(modifier: bpy.types.Modifier) -> bool:
    """Whether a modifier keeps the points of the current frame."""
    group = modifier.node_group if modifier.type == "NODES" else None
    return group is not None and group.name.startswith(NODES)


def cloud_table(name: str, frames: np.ndarray, points: np.ndarray, **columns: np.ndarray) -> bpy.types.Mesh:
    """A mesh of N points (N, 3) m, with further columns for `read_table`.

    Their `frames` (N,) are counted from the one on in which Blender shows the first.
    """
    mesh = store_table(name, {FRAME: frames, **columns})
    mesh.vertices.foreach_set("co", np.ascontiguousarray(points, dtype=np.float32).ravel())
    return mesh


def _nodes(clock: TakeClock) -> bpy.types.NodeTree:
    """The nodes that keep the points of the current frame, made once a file for each clock.

    Numbers that another modifier would be given by each Blender otherwise are in the nodes.
    """
    # Groups of earlier versions have names without "rounded", and count otherwise.
    name = f"{NODES}, rounded" + ("" if clock.step == 1 else f", {clock.step:.6g} apart from {clock.start}")
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
        (_counted(tree, now.outputs["Frame"], clock), other),
        (same.outputs["Result"], points.inputs["Selection"]),
        (points.outputs[0], leave.inputs[0]),
    ):
        tree.links.new(start, end)
    for column, node in enumerate(tree.nodes):
        node.location = (200 * column, 0)
    return tree


def _counted(tree: bpy.types.NodeTree, now: bpy.types.NodeSocket, clock: TakeClock) -> bpy.types.NodeSocket:
    """What counts the frame of a take that is nearest to a moment, as `cloud_table` has it."""
    steps = [("ADD", TIES_UP), ("FLOOR", 0.0)]
    if clock.step != 1:
        steps = [("SUBTRACT", clock.start), ("DIVIDE", clock.step), *steps, ("ADD", clock.start)]
    for operation, number in steps:
        node = tree.nodes.new("ShaderNodeMath")
        node.operation, node.inputs[1].default_value = operation, number
        tree.links.new(now, node.inputs[0])
        now = node.outputs[0]
    return now
