# SPDX-License-Identifier: GPL-3.0-or-later
"""What is timed, and what the issue and the paper say of it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from addon.core.blobs.pipeline import label_take
from addon.core.blobs.search import Hints, find_subject, first_starts
from addon.core.blobs.subject import Setup
from addon.core.blobs.subject import name as name_blobs
from addon.core.body.bodies import Bodies, BodyModel
from addon.core.calibration.adjusting import adjusted
from addon.core.calibration.refining import parts_of, refine_cameras
from addon.core.calibration.sightings import Sightings
from addon.core.data.progress import finished
from addon.core.data.takes import NO_MARKER, Labels
from addon.core.geometry import rotations
from addon.core.geometry.views import View
from addon.core.papers.virtual_occlusions.cloud import build_cloud
from addon.core.papers.virtual_occlusions.occlusion import CapsuleOcclusion
from addon.core.pipelines.blobs import BlobOptions
from addon.core.simulation.rigs import paper_rig, ring_rig
from addon.core.simulation.simulate import CaptureOptions
from addon.core.simulation.virtual import Act
from addon.io.models import open_model
from tests.core.papers.virtual_occlusions.stages import fit_nine, stages
from tests.core.scenes import act, built_in, stand

Job = Callable[[], object]
ROOM = CaptureOptions(noise=0.3, reflections=1, flicker=0.1)
RATE = 60.0
WALK = (Act(0.3), Act(1.4, stride=0.9), Act(1.2, stride=0.5, turn=np.pi), Act(1.1, stride=0.9))


@dataclass(frozen=True)
class Row:
    """One row of the table: `per` units of work in one run of `job`; floor, aim and the paper's figure as text."""

    title: str
    job: Job
    promises: tuple[str, str, str]
    repeats: int
    per: float = 1.0
    show: Callable[[float], str] = "{:.2e} s".format


def milliseconds(seconds: float) -> str:
    """Seconds as ms."""
    return f"{1000 * seconds:.2f} ms"


def a_second(seconds: float) -> str:
    """Seconds for one as how many a second."""
    return f"{1 / seconds:.0f} a second"


def start_of(bodies: Bodies, model: BodyModel) -> Bodies:
    """A rest body off by 15°, 0.15 m of height and 0.12 m from the person."""
    ahead = model.pose(bodies).rotations[0, 0, :, 0]
    start = model.rest(1, float(bodies.scale.mean()) - 0.15)
    facing = rotations.about_z([np.arctan2(ahead[1], ahead[0]) + np.radians(15)])
    return replace(start, quaternion=facing, translation=bodies.translation * [1, 1, 0] + [0.1, -0.06, 0.02])


def standing(name: str) -> tuple[Setup, View, Bodies]:
    """Setup, view and bodies of a standing person in the paper's rig."""
    scene = stand(built_in(name), paper_rig(), seed=3, facing=0.7, options=ROOM)
    return Setup.of(scene.cameras, scene.markerset), scene.views()[0], scene.bodies


def table_1(repeats: int) -> Iterator[Row]:
    """The paper's three steps one by one: a first guess, the fit from a given start, algorithm 1."""
    figures = {
        "gait15": (("", "", "0.8 s"), ("3 ms", "1 ms", "1.3 s"), "0.08 s"),
        "body26": (("", "", "1.89 s"), ("5 ms", "2 ms", "3.6 s"), "0.15 s"),
    }
    for name, (five, ten, labelling) in figures.items():
        setup, view, bodies = standing(name)
        title = f"step I, initialisation: cloud of crossing rays, centre, height, eight facings, `{name}`"
        yield Row(title, partial(initialise, view, setup), ("", "", "0.013 s"), repeats, show=milliseconds)
        start = start_of(bodies, setup.model)
        for iterations, promises in ((5, five), (10, ten)):
            job = partial(fit_nine, view, start, setup, stages(iterations))
            title = f"{iterations} iterations of the nine-parameter fit, `{name}`, 4 cameras"
            yield Row(title, job, promises, 5 * repeats, show=milliseconds)
        found = find_subject(view, setup, Hints())
        job = partial(name_blobs, view, found.expected, found.subject, setup)
        title = f"step III, labelling: algorithm 1, `{name}`, 4 cameras"
        yield Row(title, job, ("", "", labelling), 5 * repeats, show=milliseconds)


def initialise(view: View, setup: Setup) -> Bodies:
    """From blobs to the starts of the fit: the paper's step I without the height and facing that it is given."""
    return first_starts(view, build_cloud(view, setup.sight), setup, Hints())


def standing_frame(repeats: int) -> Iterator[Row]:
    """Placement, fit and labelling of one frame with no hints."""
    for name, promises in (("gait15", ("60 ms", "16 ms", "1.4 s")), ("body26", ("120 ms", "16 ms", "3.76 s"))):
        setup, view, _ = standing(name)
        job = partial(find_subject, view, setup, Hints())
        title = f"whole labelling of one standing frame, no hints, `{name}`, 4 cameras"
        yield Row(title, job, promises, repeats, show=milliseconds)


def following(repeats: int) -> Iterator[Row]:
    """A walk of four seconds, finding the person included."""
    rows = (
        ("body26", 8, ("120 a second", "500 a second", "real time hoped for")),
        ("body26", 4, ("60 a second", "", "")),
        ("gait15", 8, ("", "", "")),
    )
    for name, cameras, promises in rows:
        rig = ring_rig(cameras, radius=4.5, volume_radius=1.3)
        scene = act(built_in(name), rig, WALK, seed=3, options=ROOM)
        job = partial(drain, scene.blobs, rig, scene.markerset)
        title = f"following a walk, `{name}`, {cameras} cameras at 60 Hz, search included"
        yield Row(title, job, promises, max(repeats // 10, 2), len(scene.blobs.frames), a_second)


def drain(blobs, rig, markerset) -> int:
    """Labels a take that is one chunk."""
    return sum(len(chunk.labels.marker) for chunk in label_take([blobs], rig, markerset, RATE))


def occlusion(repeats: int) -> Iterator[Row]:
    """Virtual occlusion in closed form: one body, and as many as the search tries."""
    for name, bodies in (("gait15", 1), ("body26", 1), ("body26", 8)):
        markerset, rig = built_in(name), paper_rig()
        model, body = BodyModel(markerset), CapsuleOcclusion(markerset)
        posed = model.pose(model.rest(bodies, 1.7))
        scale = np.full((bodies, 3), 1.7)
        job = partial(body.hidden, posed.rotations, posed.joints, scale, posed.markers, rig.centres)
        rays = bodies * len(rig) * len(markerset)
        title = f"occlusion, `{name}`, {rays} rays × {len(markerset.capsules)} capsules"
        yield Row(title, job, ("", "", ""), 20 * repeats, show=milliseconds)


def refining(repeats: int) -> Iterator[Row]:
    """A calibration refined by a take of eight seconds: the bundle adjustment, and all of it."""
    true = ring_rig(8, generator=np.random.default_rng(5))
    scene = act(built_in("body26"), true, WALK + WALK, seed=3, options=ROOM)
    rotation = true.rotation.copy()
    rotation[3] = rotations.exponential(np.radians([0.3, 0.2, 0.1]))[0] @ rotation[3]
    moved = replace(true, rotation=rotation, translation=-np.einsum("cij,cj->ci", rotation, true.centres))
    index = {name: number for number, name in enumerate(scene.markerset.markers)}
    marker = np.array([index.get(name.partition("|")[0], NO_MARKER) for name in scene.truth])
    named = Sightings.of([(scene.blobs, Labels(marker, 0 * marker, 0.0 * marker))], moved).spread(moved)
    title = f"bundle adjustment of 8 cameras and {named.count} points seen {len(named.camera)} times"
    everyone = np.ones(len(moved), bool)
    yield Row(title, partial(adjusted, moved, named, everyone), ("", "", ""), repeats, show="{:.2f} s".format)
    parts = [scene.blobs.between(first, last) for first, last in parts_of(*scene.blobs.frames[[0, -1]].tolist())]
    frames = sum(len(part.frames) for part in parts)
    job = partial(refine_all, parts, moved)
    title = (
        f"refining a calibration, `body26`, 8 cameras, {len(parts)} parts of the take, {frames} frames in each round"
    )
    yield Row(title, job, ("", "", ""), max(repeats // 10, 1), show="{:.1f} s".format)


def refine_all(parts, cameras):
    """Labels, adjusts, labels again."""
    return finished(refine_cameras(parts, cameras, open_model("body26"), BlobOptions(rate=RATE)))
