# SPDX-License-Identifier: GPL-3.0-or-later
"""Calibrated cameras as Blender cameras that look through the real lens, and back.

Pose, focal length and principal point live in Blender's own settings, so moving a camera moves the calibration. What
Blender cannot express (image size and pixel aspect per camera, skew, distortion) is kept in custom properties.
Pixel (0, 0) is the upper left corner of Blender's picture.
"""

import json
from collections.abc import Iterable
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from ..core.data.errors import InputError, of_file
from ..core.geometry.cameras import Cameras
from . import naming
from .units import METRE, metre_in, metre_of

SENSOR_WIDTH = 36.0  # mm; only its ratio to the focal length matters
IMAGE_SIZE, ASPECT, SKEW, DISTORTION = "mocap_size", "mocap_aspect", "mocap_skew", "mocap_distortion"
INVERSE_LENS = "mocap_inverse"
ADOPTED = "mocap_adopted"  # on a collection of cameras that were the scene's own
CAMERA_DISPLAY_SIZE = 0.25
HEALTH, REFINED = "mocap_health", "mocap_refined"  # on a take, on a collection of cameras
SAME_CAMERA = 1e-4  # relative: what single precision does to a calibration and back

# A camera of computer vision looks along +z with y down, Blender's along -z with y up.
FLIP = np.diag([1.0, -1.0, -1.0])


def add_cameras(scene: bpy.types.Scene, cameras: Cameras) -> bpy.types.Collection:
    """Adds `cameras` to `scene` in a collection of their own and makes the first the scene's camera if it had none."""
    collection = bpy.data.collections.new(naming.title("cameras"))
    collection[naming.CAMERAS] = len(cameras)
    scene.collection.children.link(collection)
    metre = metre_in(scene)
    for index, name in enumerate(cameras.names):
        data = bpy.data.cameras.new(name)
        camera = bpy.data.objects.new(name, data)
        camera[naming.CAMERA], camera[METRE] = name, metre
        (width, height), matrix = cameras.size[index], cameras.matrix[index]
        data.sensor_fit, data.sensor_width = "HORIZONTAL", SENSOR_WIDTH
        data.lens = matrix[0, 0] * SENSOR_WIDTH / width
        data.shift_x = (width / 2 - matrix[0, 2]) / width
        data.shift_y = (matrix[1, 2] - height / 2) * matrix[0, 0] / matrix[1, 1] / width
        data.display_size, data.clip_start = CAMERA_DISPLAY_SIZE * metre, 0.01 * metre
        data.clip_end *= metre
        _keep_beyond_blender(data, cameras.size[index], matrix, cameras.distortion[index], cameras.inverse[index])
        pose = np.eye(4)
        pose[:3, :3] = cameras.rotation[index].T @ FLIP
        pose[:3, 3] = cameras.centres[index] * metre
        camera.matrix_world = Matrix(pose.tolist())
        collection.objects.link(camera)
    if len(cameras) and not is_mocap_camera(scene.camera):
        look_through(scene, collection.objects[0])
    return collection


def find_or_add_cameras(scene: bpy.types.Scene, cameras: Cameras) -> bpy.types.Collection:
    """The collection of `scene` that holds exactly these cameras already, or a new one."""
    for collection in scene.collection.children_recursive:
        if naming.CAMERAS in collection and _same(cameras_of(collection, scene), cameras):
            return collection
    return add_cameras(scene, cameras)


def adopt_cameras(scene: bpy.types.Scene) -> bpy.types.Collection:
    """Makes calibrated cameras of all cameras of a scene, as they are, and gathers them in one collection.

    Those that it took before, and no calibration brought, get the size that the scene's pictures have now, and their
    name; they go before those of the same name that one did. Raises InputError when there is none, or one is not a
    perspective camera.
    """
    items = [item for item in scene.objects if item.type == "CAMERA"]
    if not items:
        raise InputError(f"scene {scene.name} has no cameras; expected at least two")
    kept = [one for one in scene.collection.children_recursive if naming.CAMERAS in one]
    brought = {item for one in kept if not is_adopted(one) for item in originals(one.objects)}
    own = {item for one in kept for item in one.objects} - brought
    names = {item: item.name if item in own else camera_name(item) for item in items}
    chosen = set({names[item]: item for item in sorted(items, key=lambda item: item not in brought)}.values())
    items = [item for item in items if item in chosen]
    lenses = [_read_lens(item, scene, anew=item in own) for item in items]
    collection = next(filter(is_adopted, kept), None)
    if collection is None:
        collection = bpy.data.collections.new(naming.title("cameras"))
        scene.collection.children.link(collection)
    collection[naming.CAMERAS], collection[ADOPTED], collection.hide_viewport = len(items), True, False
    for item, lens in zip(items, lenses, strict=True):
        item[naming.CAMERA], item[METRE] = names[item], metre_in(scene)
        _keep_beyond_blender(item.data, *lens)
        if item.name not in collection.objects:
            collection.objects.link(item)
    return collection


def is_adopted(collection: bpy.types.Collection) -> bool:
    """Whether these cameras were the scene's own, and no calibration's."""
    return ADOPTED in collection


def cameras_of(collection: bpy.types.Collection, scene: bpy.types.Scene) -> Cameras:
    """The calibrations of a collection's cameras as they stand now."""
    return calibrations(originals(collection.all_objects), scene)


def originals(items: Iterable[bpy.types.Object]) -> list[bpy.types.Object]:
    """The cameras among some objects: the first of each name, as the others are copies that somebody made of it."""
    found: dict[str, bpy.types.Object] = {}
    for item in (one for one in items if one.type == "CAMERA"):
        found.setdefault(camera_name(item), item)
    return list(found.values())


def cameras_of_scene(scene: bpy.types.Scene) -> Cameras:
    """Calibrations of a scene's cameras: those with a calibration if there are any, else all of them.

    Raises InputError when there is none, or one is not a perspective camera.
    """
    found = [item for item in scene.objects if item.type == "CAMERA"]
    calibrated = originals(filter(is_mocap_camera, found))
    if not found:
        raise InputError(f"scene {scene.name} has no cameras; expected at least two")
    return calibrations(calibrated or found, scene)


def cameras_of_blend(path: Path | str) -> Cameras:
    """Calibrations of the cameras of a `.blend` file's first scene; nothing of the file stays behind.

    Raises InputError when the file is not a `.blend` or has no usable cameras.
    """
    if not Path(path).is_file():
        raise InputError("there is no such file; expected a .blend with cameras", path)
    before = set(bpy.data.libraries)
    try:
        with bpy.data.libraries.load(str(path), link=True) as (there, wanted):
            wanted.scenes = there.scenes[:1]
    except OSError as error:
        raise InputError("is not a Blender file that can be read; expected a .blend with cameras", path) from error
    try:
        if not wanted.scenes or wanted.scenes[0] is None:
            raise InputError("holds no scene; expected a .blend with cameras", path)
        scene = wanted.scenes[0]
        scene.view_layers[0].update()
        with of_file(path):
            return cameras_of_scene(scene)
    finally:
        for library in set(bpy.data.libraries) - before:
            bpy.data.libraries.remove(library)


def is_mocap_camera(item: bpy.types.Object | None) -> bool:
    """True for a camera that carries a calibration."""
    return item is not None and item.type == "CAMERA" and naming.CAMERA in item


def camera_name(camera: bpy.types.Object) -> str:
    """The camera's name in the calibration, whatever Blender made of it."""
    return str(camera.get(naming.CAMERA, camera.name))


def camera_through(space: bpy.types.Space, scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The calibrated camera that a 3D view looks through; None where it looks through none."""
    if space.region_3d.view_perspective != "CAMERA":
        return None
    camera = space.camera if space.use_local_camera else scene.camera
    return camera if is_mocap_camera(camera) else None


def room_pose(camera: bpy.types.Object) -> np.ndarray:
    """(4, 4) of a calibrated camera as a view has it, in metres."""
    pose = np.array(camera.matrix_world.normalized(), dtype=float)
    pose[:3, 3] /= metre_of(camera)
    return pose


def look_through(scene: bpy.types.Scene, camera: bpy.types.Object):
    """Makes `camera` the scene's camera, with its picture's size and pixel aspect, which Blender keeps per scene."""
    scene.camera = camera
    if IMAGE_SIZE not in camera.data:
        return
    render, aspect = scene.render, float(camera.data[ASPECT])
    render.resolution_x, render.resolution_y = (round(side) for side in camera.data[IMAGE_SIZE])
    render.resolution_percentage = 100
    render.pixel_aspect_x, render.pixel_aspect_y = max(1.0, aspect), max(1.0, 1 / aspect)


def _keep_beyond_blender(
    data: bpy.types.Camera, size: np.ndarray, matrix: np.ndarray, distortion: np.ndarray, inverse: np.ndarray
):
    """Keeps what Blender's own settings of a camera cannot say."""
    data[ASPECT], data[SKEW] = float(matrix[1, 1] / matrix[0, 0]), float(matrix[0, 1])
    for key, values in ((IMAGE_SIZE, size), (DISTORTION, distortion), (INVERSE_LENS, inverse)):
        data[key] = [float(value) for value in values]


def calibrations(items: list[bpy.types.Object], scene: bpy.types.Scene) -> Cameras:
    """Those of a scene's cameras as they stand now; InputError where one is not a perspective camera."""
    lenses = list(zip(*(_read_lens(item, scene) for item in items), strict=True)) or [()] * 4
    shapes = (-1, 2), (-1, 3, 3), (-1, 5), (-1, 3)
    size, matrix, distortion, inverse = (np.array(one).reshape(to) for one, to in zip(lenses, shapes, strict=True))
    poses = np.array([pose_of(item).normalized() for item in items]).reshape(-1, 4, 4)
    metres = [metre_of(item) if is_mocap_camera(item) else metre_in(scene) for item in items]
    poses[:, :3, 3] /= np.reshape(metres, (-1, 1))
    left, _, right = np.linalg.svd(FLIP @ poses[:, :3, :3].transpose(0, 2, 1))
    rotation = left @ right  # the nearest to matrices in single precision
    translation = -np.einsum("cij,cj->ci", rotation, poses[:, :3, 3])
    names = tuple(camera_name(item) for item in items)
    return Cameras(names, size, matrix, distortion, rotation, translation, inverse)


def pose_of(item: bpy.types.Object) -> Matrix:
    """Where an object is in the world.

    Blender works `matrix_world` out later than it opens a file, and not at all where a collection is switched off.
    """
    if item.constraints or (item.parent is not None and item.parent_type != "OBJECT"):
        return item.matrix_world
    own = item.matrix_basis
    return own if item.parent is None else pose_of(item.parent) @ item.matrix_parent_inverse @ own


def _read_lens(item: bpy.types.Object, scene: bpy.types.Scene, anew: bool = False) -> tuple[np.ndarray, ...]:
    """Image size (2,) px, intrinsic matrix (3, 3) px, distortion (5,) and inverse lens (3,) of one Blender camera.

    `anew` takes the size that the scene's pictures have for the one that is kept with it.
    """
    data, render = item.data, scene.render
    if data.type != "PERSP":
        raise InputError(f"camera {camera_name(item)} is not a perspective camera; expected one with a focal length")
    if IMAGE_SIZE in data and not anew:
        size, aspect = np.array(data[IMAGE_SIZE], dtype=float), float(data[ASPECT])
    else:
        percent = render.resolution_percentage / 100
        size = np.array([render.resolution_x, render.resolution_y], dtype=float) * percent
        aspect = render.pixel_aspect_x / render.pixel_aspect_y
    width, height = size
    wide = data.sensor_fit == "HORIZONTAL" or (data.sensor_fit == "AUTO" and width * aspect >= height)
    across = width if wide else height / aspect
    sensor = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
    focal = data.lens * across / sensor
    matrix = np.eye(3)
    matrix[0] = focal, float(data.get(SKEW, 0.0)), width / 2 - data.shift_x * across
    matrix[1] = 0.0, focal * aspect, height / 2 + data.shift_y * across * aspect
    lenses = (
        np.array(data.get(key, [0.0] * count), dtype=float) for key, count in ((DISTORTION, 5), (INVERSE_LENS, 3))
    )
    return size, matrix, *lenses


def _same(one: Cameras, other: Cameras) -> bool:
    fields = ("size", "matrix", "distortion", "rotation", "translation", "inverse")
    pairs = ((getattr(one, field), getattr(other, field)) for field in fields)
    return one.names == other.names and all(np.allclose(*pair, rtol=SAME_CAMERA, atol=SAME_CAMERA) for pair in pairs)


def kept_health(take: bpy.types.Collection | None) -> list[str] | None:
    """What is odd about a take's cameras, a sentence each; None where nobody looked."""
    return json.loads(take[HEALTH]) if take is not None and HEALTH in take else None


def kept_refinement(cameras: bpy.types.Collection | None) -> dict | None:
    """The report of the refining that made these cameras; None where none did."""
    return json.loads(cameras[REFINED]) if cameras is not None and REFINED in cameras else None


def show_refined(
    scene: bpy.types.Scene, before: bpy.types.Collection, cameras: Cameras, report: dict
) -> bpy.types.Collection:
    """Adds refined cameras in the place of those before, which are hidden; gives their collection.

    The scene's camera becomes the refined one of the same name.
    """
    through = scene.camera
    collection = find_or_add_cameras(scene, cameras)
    collection[REFINED] = json.dumps(report)
    if through is not None and through.name in before.all_objects:
        by_name = {camera_name(item): item for item in originals(collection.objects)}
        look_through(scene, by_name[camera_name(through)])
    before.hide_viewport = True
    return collection
