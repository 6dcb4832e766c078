# SPDX-License-Identifier: GPL-3.0-or-later
"""The room of the picture as Blender objects: floor, cameras as pyramids, the body of one frame, its markers."""

from dataclasses import dataclass

import numpy as np

from ..core.geometry.cameras import Cameras
from .sheet import flat_material, linear, new_nodes


@dataclass(frozen=True)
class RoomLook:
    """Colours as on screen, and sizes: larger than they are, so that they are seen in a small picture."""

    floor: tuple = (0.085, 0.1, 0.13)
    grid: tuple = (0.2, 0.23, 0.29)
    camera: tuple = (0.72, 0.78, 0.88)
    stand: tuple = (0.27, 0.31, 0.38)
    skin: tuple = (0.72, 0.8, 0.93)
    marker_radius_m: float = 0.019
    pyramid_m: float = 0.28


ROOM_LOOK = RoomLook()


@dataclass(frozen=True, eq=False)
class Body:
    """The capsules of one frame in the world: start, end (K, 3) m and radius (K,) m."""

    start: np.ndarray
    end: np.ndarray
    radius: np.ndarray


def empty_scene(width: int, height: int):
    """A new scene with a render camera, a lamp and Cycles set for drawing with few samples; returns it."""
    import bpy

    scene = bpy.data.scenes.new("Picture")
    scene.camera = bpy.data.objects.new("View", bpy.data.cameras.new("View"))
    scene.camera.data.clip_start = 0.01
    sun = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN"))
    sun.data.energy, sun.data.angle = 2.6, 0.35
    sun.rotation_euler = (0.5, 0.25, 0.3)
    for thing in (scene.camera, sun):
        scene.collection.objects.link(thing)
    scene.world = bpy.data.worlds.new("Night")
    new_background(scene.world)
    render = scene.render
    render.engine, render.resolution_x, render.resolution_y, render.resolution_percentage = "CYCLES", width, height, 100
    render.image_settings.file_format = "PNG"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_denoising = "CPU", 16, False
    cycles.use_adaptive_sampling = True
    cycles.adaptive_threshold = 0.02
    cycles.max_bounces, cycles.transparent_max_bounces = 1, 24
    scene.view_settings.view_transform = "Standard"
    return scene


def new_background(world):
    """Makes the world a dim, even light and a dark backdrop."""
    if not world.node_tree:
        world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    background = nodes.new("ShaderNodeBackground")
    background.inputs["Color"].default_value = (*linear((0.075, 0.088, 0.115)), 1)
    links.new(background.outputs[0], nodes.new("ShaderNodeOutputWorld").inputs["Surface"])


def add_floor(scene, centre: np.ndarray, half: float):
    """A floor with a grid of 1 m around `centre` (2,) m, reaching `half` m to every side."""
    import bpy

    x, y = np.round(centre)
    corners = [
        (x - half, y - half, -0.002),
        (x + half, y - half, -0.002),
        (x + half, y + half, -0.002),
        (x - half, y + half, -0.002),
    ]
    _mesh(scene, "Floor", corners, [(0, 1, 2, 3)], _matt(bpy, ROOM_LOOK.floor))
    points, faces = [], []
    steps = np.arange(-np.floor(half), np.floor(half) + 1)
    for step in steps:
        for across in (False, True):
            thin = 0.006
            strip = [(step - thin, -half), (step + thin, -half), (step + thin, half), (step - thin, half)]
            faces.append(tuple(range(len(points), len(points) + 4)))
            points += [(x + b, y + a, 0) if across else (x + a, y + b, 0) for a, b in strip]
    _mesh(scene, "Grid", points, faces, flat_material(bpy, ROOM_LOOK.grid))


def add_cameras(scene, cameras: Cameras):
    """Each camera as a pyramid of thin rods that opens the way it looks, on a stand from the floor."""
    import bpy

    rods, stands, panes = (
        flat_material(bpy, ROOM_LOOK.camera),
        flat_material(bpy, ROOM_LOOK.stand),
        flat_material(bpy, (*ROOM_LOOK.camera, 0.1)),
    )
    for index, name in enumerate(cameras.names):
        corners = pyramid(cameras, index, ROOM_LOOK.pyramid_m)
        ends = [(0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1)]
        _rods(scene, name, corners, ends, 0.009, rods)
        foot = corners[0] * [1, 1, 0]
        _rods(scene, f"{name} stand", np.stack([corners[0], foot]), [(0, 1)], 0.005, stands)
        faces = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1), (1, 2, 3, 4)]
        _mesh(scene, f"{name} view", corners.tolist(), faces, panes)


def pyramid(cameras: Cameras, index: int, depth: float) -> np.ndarray:
    """(5, 3) m: the centre of a camera and the corners of its image held `depth` m in front of it."""
    width, height = cameras.size[index]
    pixels = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]], dtype=float)
    local = pixels @ np.linalg.inv(cameras.matrix[index]).T * depth
    return np.vstack([cameras.centres[index], (local - cameras.translation[index]) @ cameras.rotation[index]])


def add_body(scene, body: Body):
    """The capsules melted into one translucent skin."""
    import bpy

    points, faces = [], []
    for start, end, radius in zip(body.start, body.end, body.radius, strict=True):
        rings, quads = capsule_mesh(start, end, radius)
        faces += [[corner + len(points) for corner in quad] for quad in quads]
        points += rings.tolist()
    thing = _mesh(scene, "Body", points, faces, _skin(bpy))
    melt = thing.modifiers.new("Melt", "REMESH")
    melt.mode, melt.voxel_size, melt.use_smooth_shade = "VOXEL", 0.014, True
    smooth = thing.modifiers.new("Smooth", "SMOOTH")
    smooth.factor, smooth.iterations = 0.5, 8


def capsule_mesh(start: np.ndarray, end: np.ndarray, radius: float, around: int = 16, rows: int = 5):
    """Points (N, 3) and quads of a closed capsule from `start` to `end`."""
    axis = end - start
    length = np.linalg.norm(axis)
    up = axis / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    side = np.cross(up, [1.0, 0, 0] if abs(up[0]) < 0.9 else [0.0, 1, 0])
    side /= np.linalg.norm(side)
    front = np.cross(up, side)
    tilt = np.linspace(-np.pi / 2, np.pi / 2, 2 * rows)
    along = radius * np.sin(tilt) + np.where(tilt > 0, length, 0.0)
    turn = np.linspace(0, 2 * np.pi, around, endpoint=False)
    rim = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * front
    points = start + along[:, None, None] * up + (radius * np.cos(tilt))[:, None, None] * rim
    quads = [
        (
            row * around + i,
            row * around + (i + 1) % around,
            (row + 1) * around + (i + 1) % around,
            (row + 1) * around + i,
        )
        for row in range(2 * rows - 1)
        for i in range(around)
    ]
    return points.reshape(-1, 3), quads


def add_markers(scene, points: np.ndarray, colours: list):
    """A bright ball at each of `points` (M, 3) m in its colour; NaN points are left out."""
    import bpy

    balls: dict[tuple, list] = {}
    for point, colour in zip(points, colours, strict=True):
        if np.isfinite(point).all():
            balls.setdefault(tuple(colour), []).append(point)
    for colour, centres in balls.items():
        corners, faces = [], []
        for centre in centres:
            ball, quads = capsule_mesh(centre, centre, ROOM_LOOK.marker_radius_m, rows=6)
            faces += [[corner + len(corners) for corner in quad] for quad in quads]
            corners += ball.tolist()
        _mesh(scene, "Markers", corners, faces, _shiny(bpy, colour), smooth=True)


def look_at(scene, eye: np.ndarray, target: np.ndarray, lens: float, shift: tuple[float, float]):
    """Puts the render camera at `eye` (3,) m, looking at `target`; lens in mm on a 36 mm sensor, shift in widths."""
    from mathutils import Vector

    view = scene.camera
    view.location = eye
    view.rotation_euler = Vector((target - eye).tolist()).to_track_quat("-Z", "Y").to_euler()
    view.data.lens, view.data.sensor_width = lens, 36.0
    view.data.shift_x, view.data.shift_y = shift


def _rods(scene, name: str, corners: np.ndarray, ends, radius: float, material):
    points, faces = [], []
    for first, second in ends:
        rod, quads = capsule_mesh(corners[first], corners[second], radius, around=8, rows=2)
        faces += [[corner + len(points) for corner in quad] for quad in quads]
        points += rod.tolist()
    _mesh(scene, name, points, faces, material)


def _mesh(scene, name: str, points, faces, material, smooth: bool = False):
    import bpy

    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    mesh.materials.append(material)
    if smooth:
        mesh.shade_smooth()
    thing = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(thing)
    return thing


def _matt(bpy, colour):
    material = bpy.data.materials.new("matt")
    nodes, links = new_nodes(material)
    matt = nodes.new("ShaderNodeBsdfDiffuse")
    matt.inputs["Color"].default_value = (*linear(colour), 1)
    links.new(matt.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def _skin(bpy):
    """Glass-like: clear where it faces the view, bright at the edge, its far side not drawn."""
    material = bpy.data.materials.new("skin")
    nodes, links = new_nodes(material)
    edge = nodes.new("ShaderNodeLayerWeight")
    edge.inputs["Blend"].default_value = 0.45
    amount = nodes.new("ShaderNodeMapRange")
    amount.inputs["To Min"].default_value, amount.inputs["To Max"].default_value = 0.3, 0.95
    front = nodes.new("ShaderNodeNewGeometry")
    keep = nodes.new("ShaderNodeMath")
    keep.operation = "SUBTRACT"
    keep.use_clamp = True
    light, glow, sum_ = (
        nodes.new("ShaderNodeBsdfDiffuse"),
        nodes.new("ShaderNodeEmission"),
        nodes.new("ShaderNodeAddShader"),
    )
    light.inputs["Color"].default_value = (*linear(ROOM_LOOK.skin), 1)
    glow.inputs["Color"].default_value = (*linear(ROOM_LOOK.skin), 1)
    glow.inputs["Strength"].default_value = 0.22
    mix = nodes.new("ShaderNodeMixShader")
    links.new(edge.outputs["Facing"], amount.inputs["Value"])
    links.new(amount.outputs["Result"], keep.inputs[0])
    links.new(front.outputs["Backfacing"], keep.inputs[1])
    links.new(light.outputs[0], sum_.inputs[0])
    links.new(glow.outputs[0], sum_.inputs[1])
    links.new(keep.outputs[0], mix.inputs[0])
    links.new(nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
    links.new(sum_.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def _shiny(bpy, colour):
    """Bright in its own colour, a little darker at the rim so that it reads as a ball."""
    material = bpy.data.materials.new("marker")
    nodes, links = new_nodes(material)
    edge = nodes.new("ShaderNodeLayerWeight")
    edge.inputs["Blend"].default_value = 0.3
    amount = nodes.new("ShaderNodeMapRange")
    amount.inputs["To Min"].default_value, amount.inputs["To Max"].default_value = 1.15, 0.4
    glow = nodes.new("ShaderNodeEmission")
    glow.inputs["Color"].default_value = (*linear(colour), 1)
    links.new(edge.outputs["Facing"], amount.inputs["Value"])
    links.new(amount.outputs["Result"], glow.inputs["Strength"])
    links.new(glow.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material
