# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays kept in the file: a mesh that is never shown, one vertex a row, one attribute a column.

Blender saves, links, copies and undoes meshes as fast as arrays go; single precision keeps a pixel to 1/2000 and a
metre to 0.1 µm. A row number is a vertex number.
"""

import bpy
import numpy as np

# Attribute type and the name of its values, by what a row of the array looks like.
_FLOATS = {
    (): ("FLOAT", "value"),
    (2,): ("FLOAT2", "vector"),
    (3,): ("FLOAT_VECTOR", "vector"),
    (4,): ("QUATERNION", "value"),
}
FROM = "mocap_from_"  # and a column's name: what its whole numbers count from, where they need more than 32 bits
_WIDTH = {"INT": (), "FLOAT": (), "FLOAT2": (2,), "FLOAT_VECTOR": (3,), "QUATERNION": (4,)}


def store_table(name: str, columns: dict[str, np.ndarray]) -> bpy.types.Mesh:
    """Keeps `columns`, arrays of N rows (whole numbers (N,), or floats (N,) or (N, 2 to 4)), in a new mesh."""
    mesh = bpy.data.meshes.new(name)
    rows = {len(column) for column in columns.values()}
    if len(rows) != 1:
        raise ValueError(f"columns of different lengths {sorted(rows)}; expected one length")
    mesh.vertices.add(rows.pop())
    for key, column in columns.items():
        if np.issubdtype(column.dtype, np.integer) or column.dtype == bool:
            kind, values, dtype = "INT", "value", np.int32
            if len(column) and np.abs(column).max() > np.iinfo(dtype).max:
                mesh[FROM + key] = float(column.min())
                column = column - column.min()
        else:
            (kind, values), dtype = _FLOATS[column.shape[1:]], np.float32
        attribute = mesh.attributes.new(key, kind, "POINT")
        attribute.data.foreach_set(values, np.ascontiguousarray(column, dtype=dtype).ravel())
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
        values = "vector" if attribute.data_type in ("FLOAT2", "FLOAT_VECTOR") else "value"
        attribute.data.foreach_get(values, flat)
        column = flat.reshape(-1, *shape).astype(np.int64 if whole else float)
        columns[attribute.name] = column + int(mesh[FROM + attribute.name]) if FROM + attribute.name in mesh else column
    return columns
