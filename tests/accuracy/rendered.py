# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs from rendered pictures: Blender shows the demo's markers through the demo's cameras, `blobs` finds them,
`label` names them, and both are held against the truth.

python -m tests.accuracy.rendered --folder DIR [--first 200 --count 24] [--wall 0.05]

The markers are balls that shine, the body is black and in their way. The cameras have no lens, as Blender's have none.
Pictures that are there already are not rendered again. It needs the `bpy` package and some minutes; no GPU.
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from scipy.optimize import linear_sum_assignment

from addon import capturing
from addon.blendfile import silenced
from addon.core.data.progress import finished
from addon.core.data.takes import Blobs
from addon.core.evaluation.figures import Figures
from addon.core.geometry.cameras import Cameras
from addon.core.papers.virtual_occlusions.occlusion import segment_distance2
from addon.demo.take import MODEL, STAGE, make_performance
from addon.io.blobs import read_blobs
from addon.io.cameras import write_cameras
from addon.io.labels import TruthWriter
from addon.io.markersets import open_markerset
from addon.jobs import LabelJob, label_file
from addon.jobs.pictures import CORNER, PicturesJob, blobs_of_pictures
from addon.scene.body import capsule_in_metres, capsule_mesh, capsule_place
from addon.scene.cameras import add_cameras, look_through
from addon.scoring import compare
from scripts import movies

RADIUS = 0.007  # m, of a marker's ball
SAMPLES = 16  # of each pixel
MARGIN = 12.0  # px around the markers that are rendered; the rest of a picture is black anyway
DISC_POINTS = 61  # of a ball's disc that are looked at, whether the body hides them
FOUND_PX = 2.0  # a spot that is farther from where a marker is, is not that marker's
TOUCHING_PX = 1.0  # images whose rims are nearer than this are reported apart: one pixel between them is half dark


def performance():
    """The demo's room, take and body, its cameras without a lens."""
    made = make_performance(open_markerset(MODEL))
    return replace(made, cameras=replace(made.cameras, distortion=np.zeros((len(made.cameras), 5))))


def build(made, scene: bpy.types.Scene):
    """Balls, capsules and cameras; gives the balls and (segment, place in it, object) of the capsules."""
    markerset = open_markerset(MODEL)
    white, black = _shining("white", 1.0), _shining("black", 0.0)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=32, ring_count=16, radius=RADIUS)
    ball = bpy.context.object
    ball.data.materials.append(white)
    balls = [ball]
    for _ in made.take.names[1:]:
        balls.append(ball.copy())
        scene.collection.objects.link(balls[-1])
    capsules = []
    for index, segment in enumerate(markerset.capsules.segment):
        capsule = capsule_in_metres(markerset, index, made.body.scale[0])
        place, half = capsule_place(capsule)
        mesh = capsule_mesh(half, capsule.radius)
        mesh.materials.append(black)
        item = bpy.data.objects.new("capsule", mesh)
        scene.collection.objects.link(item)
        capsules.append((int(segment), place, item))
    return balls, capsules, add_cameras(scene, made.cameras)


def _lit_walls(strength: float) -> bpy.types.World | None:
    """What is behind the body where pictures are rendered, as bright as this, linear; nothing for 0."""
    if not strength:
        return None
    world = bpy.data.worlds.new("walls")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (strength, strength, strength, 1.0)
    return world


def _shining(name: str, strength: float) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    light, out = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    light.inputs["Strength"].default_value = strength
    material.node_tree.links.new(light.outputs[0], out.inputs[0])
    return material


def render(made, folder: Path, frames: range, wall: float):
    """A folder of pictures for each camera, numbered by frame."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    balls, capsules, cameras = build(made, scene)
    scene.world = _lit_walls(wall)
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = SAMPLES, False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.max_bounces = 0
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 1.0
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "BW"
    scene.render.use_persistent_data = True
    for frame in frames:
        at = frame - made.take.first_frame
        for ball, place in zip(balls, made.take.xyz[at], strict=True):
            ball.location = place
        for segment, place, item in capsules:
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = made.body.rotations[at, segment], made.body.joints[at, segment]
            item.matrix_world = Matrix((pose @ place).tolist())
        for name, camera in zip(made.cameras.names, cameras.objects, strict=True):
            path = folder / name / f"{frame:04}.png"
            if path.exists():
                continue
            look_through(scene, camera)
            _frame_markers(scene.render, made, at, list(made.cameras.names).index(name))
            scene.render.filepath = str(path)
            with silenced():
                bpy.ops.render.render(write_still=True)


def _frame_markers(render: bpy.types.RenderSettings, made, at: int, camera: int):
    """Renders where the markers are, and leaves the rest black."""
    xy, (width, height) = made.cameras.project(made.take.xyz[at])[camera], made.cameras.size[camera]
    low, high = np.nanmin(xy, axis=0) - MARGIN, np.nanmax(xy, axis=0) + MARGIN
    render.use_border, render.use_crop_to_border = True, False
    render.border_min_x, render.border_max_x = low[0] / width, high[0] / width
    render.border_min_y, render.border_max_y = 1 - high[1] / height, 1 - low[1] / height


def encode(made, folder: Path, frames: range) -> dict[str, Path]:
    """The same pictures as H.264, as cameras and phones compress."""
    found = {}
    for name, size in zip(made.cameras.names, made.cameras.size, strict=True):
        found[name] = folder / f"{name}.mp4"
        if found[name].exists():
            continue
        with silenced():
            movies.encode(
                folder / name, frames, found[name], tuple(map(round, size)), round(STAGE.rate), keyed_every=25
            )
    return found


def truth_of(made, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (C, M, 2) px, radii (C, M) px, and the share of each ball's disc that its camera sees (C, M)."""
    at = slice(frame - made.take.first_frame, frame - made.take.first_frame + 1)
    markers, cameras = made.take.xyz[at][0], made.cameras
    xy = cameras.project(markers)
    away = np.linalg.norm(markers - cameras.centres[:, None], axis=2)
    radius = cameras.focal[:, None] * RADIUS / away
    inside = (xy > radius[..., None]).all(axis=2) & (xy < cameras.size[:, None] - radius[..., None]).all(axis=2)
    start, axis, thick = made.papers.virtual_occlusions.occlusion._posed(
        made.body.rotations[at], made.body.joints[at], np.asarray(made.body.scale[at])
    )
    length2 = np.einsum("bkx,bkx->bk", axis, axis)
    share = np.empty(xy.shape[:2])
    for camera, eye in enumerate(cameras.centres):
        points = _facing(markers, eye).reshape(1, -1, 1, 3) - start[0, 0]
        eyes = (eye - start[0, 0])[None, None]
        near = segment_distance2(start - start[:, :1], axis, length2, np.repeat(points, len(thick[0]), axis=2), eyes)
        free = (near[0, 0] >= thick[0] ** 2).all(axis=1)
        share[camera] = free.reshape(len(markers), -1).mean(axis=1)
    return xy, radius, np.where(inside, share, 0.0)


def _facing(markers: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """(M, P, 3) places evenly over what an eye (3,) sees of balls at (M, 3)."""
    count = np.arange(DISC_POINTS) + 0.5
    far, turn = np.sqrt(count / DISC_POINTS), np.pi * (1 + 5**0.5) * count
    towards = eye - markers
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    side = np.cross(towards, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1)[:, None]
    up = np.cross(side, towards)
    parts = (far * np.cos(turn), far * np.sin(turn), np.sqrt(1 - far**2))
    steps = sum(part[:, None] * along[:, None] for part, along in zip(parts, (side, up, towards), strict=True))
    return markers[:, None] + RADIUS * steps


def hold_against(made, blobs: Blobs) -> tuple[dict, list[str]]:
    """What was found of the markers in view, by kind: whole and alone, whole and touching another's image, and those
    that the body hides a part of, half or more of them seen; and the true names of all blobs."""
    kinds = ("whole", "touching", "partly hidden")
    errors, counts = {kind: [] for kind in kinds}, dict.fromkeys(kinds, 0)
    names, others = np.full(len(blobs), "", object), 0
    for index, frame in enumerate(blobs.frames):
        xy, radius, share = truth_of(made, int(frame))
        for camera in range(len(made.cameras)):
            rows = np.flatnonzero((blobs.frame == index) & (blobs.camera == camera))
            shown = np.flatnonzero(share[camera] > 0)
            place, size, seen = xy[camera, shown], radius[camera, shown], share[camera, shown]
            gap = np.linalg.norm(place[:, None] - place, axis=2) - size[:, None] - size
            np.fill_diagonal(gap, np.inf)
            touching = gap.min(axis=1, initial=np.inf) < TOUCHING_PX
            distance = np.linalg.norm(place[:, None] - blobs.xy[rows], axis=2)
            marker, spot = linear_sum_assignment(np.minimum(distance, FOUND_PX))
            near = distance[marker, spot] < FOUND_PX
            marker, spot = marker[near], spot[near]
            parts = ((seen == 1) & ~touching, (seen == 1) & touching, (seen >= 0.5) & (seen < 1))
            for kind, own in zip(kinds, parts, strict=True):
                counts[kind] += int(own.sum())
                errors[kind] += distance[marker, spot][own[marker]].tolist()
            # A spot is of every marker whose image is within its reach: merged ones have either's name.
            reach = np.maximum(FOUND_PX, radius[camera, shown])[:, None]
            for column, row in enumerate(rows):
                names[row] = "|".join(
                    made.take.names[shown[i]] for i in np.flatnonzero(distance[:, column] < reach[:, 0])
                )
                others += not names[row]
    told = {
        kind: {
            "markers": counts[kind],
            "found": round(len(errors[kind]) / max(counts[kind], 1), 5),
            "median_px": round(float(np.median(errors[kind])), 4) if errors[kind] else None,
            "p95_px": round(float(np.percentile(errors[kind], 95)), 4) if errors[kind] else None,
        }
        for kind in kinds
    }
    return {**told, "spots": len(blobs), "of_no_marker": others}, names.tolist()


def measure(made, pictures: dict[str, Path], cameras: Cameras, folder: Path, name: str, shift: int) -> dict:
    """Finds, holds against the truth, labels and scores; `shift` is the frame of a movie's first picture, less one."""
    blob_file = folder / f"{name}.csv"
    job = PicturesJob(pictures, cameras, blob_file, first_pixel=CORNER, overwrite=True)
    said = finished(blobs_of_pictures(job))
    blobs, keys = [], []
    for rows in read_blobs(blob_file, cameras):
        blobs.append(rows.blobs)
        keys += rows.keys
    joined = Blobs.join(blobs)
    told, names = hold_against(made, replace(joined, frames=joined.frames + shift))
    with TruthWriter(capturing.truth_path(blob_file)) as truth:
        truth.write(keys, names)
    room = folder / "room.toml"
    write_cameras(room, cameras)
    job = LabelJob(blob_file, room, MODEL, folder / "out", rate=STAGE.rate, overwrite=True)
    finished(label_file(job))
    markerset = open_markerset(MODEL)
    figures = Figures(markerset.markers, markerset.aliases)
    compare(job.path(".labels.csv"), capturing.truth_path(blob_file), figures)
    scores = {key: figures.as_dict()[key] for key in ("precision", "recall", "f1")}
    return {**told, **scores, "seconds_blobs": said["seconds"], "frames": said["frames"]}


def main() -> int:
    """Renders what is not there yet, measures and prints."""
    parser = argparse.ArgumentParser(prog="python -m tests.accuracy.rendered", description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True, help="where the pictures go")
    parser.add_argument("--first", type=int, default=200)
    parser.add_argument("--count", type=int, default=24)
    parser.add_argument("--wall", type=float, default=0.0, help="how bright it is behind the body, linear, 0 to 1")
    parser.add_argument("--render-only", action="store_true")
    given = parser.parse_args()
    folder, made = given.folder.resolve(), performance()
    frames = range(given.first, given.first + given.count)
    render(made, folder, frames, given.wall)
    if given.render_only:
        return 0
    cameras = made.cameras
    folders = {name: folder / name for name in cameras.names}
    print(json.dumps({"pictures": measure(made, folders, cameras, folder, "pictures", 0)}, indent=1), flush=True)
    filmed = encode(made, folder, frames)
    print(json.dumps({"H.264": measure(made, filmed, cameras, folder, "movies", frames[0] - 1)}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
