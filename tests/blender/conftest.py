# SPDX-License-Identifier: GPL-3.0-or-later
"""The toy person, four cameras around her, and a take that is known to the last digit, inside a fresh Blender."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy module")

from addon.core.body.bodies import BodyModel  # noqa: E402
from addon.core.data import takes  # noqa: E402
from addon.core.data.markersets import MarkerSet  # noqa: E402
from addon.core.data.progress import finished  # noqa: E402
from addon.core.geometry import rotations  # noqa: E402
from addon.core.geometry.cameras import NO_CAMERAS, Cameras  # noqa: E402
from addon.core.papers.virtual_occlusions.occlusion import CapsuleOcclusion  # noqa: E402
from addon.core.points.models import Model  # noqa: E402
from addon.core.points.several.wearers import SetsWorn, Wearer  # noqa: E402
from addon.core.simulation.rigs import ring_rig  # noqa: E402
from addon.io.blobs import write_blobs  # noqa: E402
from addon.io.cameras import write_cameras  # noqa: E402
from addon.io.markersets import open_markerset  # noqa: E402
from addon.io.models import write_model  # noqa: E402
from addon.io.points import write_c3d  # noqa: E402
from addon.scene.take import Take, show_take  # noqa: E402
from tests.core.toybody import toy_markerset  # noqa: E402

from .hands import FRAMES, GHOST, MODULE, ours, press  # noqa: E402

REPOSITORY = Path(__file__).resolve().parents[2]


def make_cameras(lens: float = 0.0) -> Cameras:
    """Four cameras in a ring, with unequal sides of their pixels and the principal point off the middle."""
    rig = ring_rig(4, (656, 491), 4.0, 1.8, 1.0)
    matrix = np.array([[[620.0 + i, 0, 330 + i], [0, 640.0 - 9 * i, 240 + 2 * i], [0, 0, 1]] for i in range(4)])
    names = tuple(f"cam {index}" for index in range(4))
    return replace(rig, names=names, matrix=matrix, distortion=np.tile([lens, 0, 0, 0, 0], (4, 1)))


def make_motion(markerset: MarkerSet, count: int, first: int = 101) -> takes.Motion:
    """A person who wanders, turns and bends for `count` frames, with a gap of one marker and two frames lost."""
    model, time = BodyModel(markerset), np.linspace(0, 1, count)
    bends = 0.5 * np.sin(time[:, None, None] * 6 + np.arange(len(markerset.skeleton))[None, :, None] + np.arange(3))
    bends[:, 0] = 0
    bodies = replace(model.rest(count, 1.6), quaternion=rotations.about_z(5 * time), bends=bends)
    bodies.translation[:] = np.column_stack([time - 0.5, 0.3 * time, np.zeros(count)])
    posed, size = model.pose(bodies), (count, len(markerset))
    markers = posed.markers.copy()
    markers[count // 3 : count // 2, 2] = np.nan
    parts = {"joints": posed.joints.copy(), "rotations": posed.rotations.copy(), "expected": posed.markers.copy()}
    confidence = np.ones(count)
    if count > 6:
        for part in (markers, *parts.values()):
            part[3:5] = np.nan
        confidence[3:5] = 0
    residual = np.where(np.isfinite(markers).all(axis=2), 0.001, np.nan)
    parts |= {"residual": residual, "residual_px": residual * 300, "scale": bodies.scale, "confidence": confidence}
    return takes.Motion(np.arange(first, first + count), markers, conflicts=np.zeros(size, dtype=int), **parts)


def make_blobs(markerset: MarkerSet, cameras: Cameras, motion: takes.Motion) -> tuple[takes.Blobs, takes.Labels]:
    """What the cameras see of a motion with the body in the way, one ghost a frame, and the true labels."""
    hidden = CapsuleOcclusion(markerset).hidden(
        np.nan_to_num(motion.rotations), np.nan_to_num(motion.joints), motion.scale, motion.expected, cameras.centres
    )
    xy = cameras.project(motion.expected).transpose(1, 0, 2, 3)
    seen = ~hidden & (xy > 0).all(axis=3) & (xy < cameras.size[:, None]).all(axis=3)
    ghost = np.broadcast_to(np.arange(len(cameras))[:, None] == 0, (*seen.shape[:2], 1))
    seen = np.concatenate([seen, ghost], axis=2)
    xy = np.concatenate([xy, np.broadcast_to([30.0, 40.0], (*ghost.shape, 2))], axis=2)
    frame, camera, marker = np.nonzero(seen)
    named = marker < len(markerset)
    marker = np.where(named, marker, takes.NO_MARKER)
    step = np.where(named, np.array([takes.EXCLUSIVE, takes.CONFLICT, takes.REMAINING])[marker % 3], 0)
    blobs = takes.Blobs(motion.frames, frame, camera, xy[seen], np.full(len(frame), np.nan))
    return blobs, takes.Labels(marker, step, np.where(named, 0.9, 0.0))


def make_take(frames: int = 20, lens: float = 0.0, name: str = "walk", markerset: MarkerSet | None = None) -> Take:
    """A labelled take of the toy person, or of one who wears another marker set."""
    markerset, cameras = markerset or toy_markerset(), make_cameras(lens)
    motion = make_motion(markerset, frames)
    blobs, labels = make_blobs(markerset, cameras, motion)
    suspects = (takes.Suspect(104, 105, "nobody found"), takes.Suspect(110, 112, "left and right may be exchanged"))
    return Take(name, 59.94, cameras, markerset, blobs, labels, motion, suspects)


def make_pair(frames: int = 20, name: str = "duet", markerset: MarkerSet | None = None) -> Take:
    """A labelled take of points of two people, ann and bob, 1.5 m apart, who are away for two frames.

    They are toy ones unless a marker set is given. Trajectories are the markers in their order, behind them one
    without a name.
    """
    markerset = markerset or toy_markerset()
    alone = make_motion(markerset, frames)
    beside = {part: getattr(alone, part) + np.array([0, 1.5, 0]) for part in ("markers", "joints", "expected")}
    other = replace(alone, **beside, scale=alone.scale * 1.1)
    joined = ("markers", "residual", "residual_px", "conflicts", "expected", "joints", "rotations", "scale")
    both = {part: np.concatenate([getattr(one, part) for one in (alone, other)], axis=1) for part in joined}
    motion = replace(alone, **both)
    worn = SetsWorn((Wearer("ann", Model(markerset)), Wearer("bob", Model(markerset))))
    xyz = np.concatenate([motion.markers, np.tile([2.0, 2.0, 0.3], (frames, 1, 1))], axis=1)
    residual = np.where(np.isfinite(xyz[..., 0]), 0.0002, np.nan)
    rows = takes.PointRows.of(takes.Points(("",) * xyz.shape[1], xyz, residual, 59.94, 101))
    marker = np.where(rows.trajectory < len(worn), rows.trajectory, takes.NO_MARKER)
    named = marker != takes.NO_MARKER
    labels = takes.Labels(marker, np.where(named, takes.BY_FIT, takes.NO_STEP), named * 0.99)
    suspects = (takes.Suspect(110, 112, "bob: left and right may be exchanged", None, ("bob:LASI", "bob:RASI")),)
    return Take(name, 59.94, NO_CAMERAS, worn, rows, labels, motion, suspects, f"{name}.c3d")


@pytest.fixture(scope="session")
def made() -> SimpleNamespace:
    makers = {"markerset": toy_markerset, "cameras": make_cameras, "motion": make_motion, "blobs": make_blobs}
    return SimpleNamespace(**makers, take=make_take, pair=make_pair)


@pytest.fixture
def empty():
    bpy.ops.wm.read_homefile(use_empty=True)
    yield bpy.context
    bpy.ops.wm.read_homefile(use_empty=True)


@pytest.fixture(scope="session")
def extension(tmp_path_factory):
    """The name of the real extension, enabled from a symlinked repository of its own.

    What its operators ask of another process, and what comes of that, goes through files as between two.
    """
    import addon_utils

    folder = tmp_path_factory.mktemp("repository")
    (folder / "mocap_autolabel").symlink_to(REPOSITORY, target_is_directory=True)
    repos = bpy.context.preferences.extensions.repos
    repository = repos.new(name="Mocap tests", module="mocap_tests", custom_directory=str(folder), source="USER")
    assert addon_utils.enable(MODULE, default_set=True) is not None
    parcels, parcel = ours("cli.parcels"), folder / "parcel"

    def work(self, context):
        parcels.write_parcel(parcel, self.asked(context))
        try:
            found = finished(parcels.read_parcel(parcel)())
        except ours("core.data.errors").UserError as error:
            raise self._said(context, error) from error
        parcels.write_parcel(parcel, found)
        return self._show(context, parcels.read_parcel(parcel))

    ours("ops.long_work").LongWork.work = work
    yield MODULE
    addon_utils.disable(MODULE, default_set=True)
    repos.remove(repository)


@pytest.fixture
def settings(extension, empty):
    return empty.scene.mocap_autolabel


@pytest.fixture
def shown(empty, made, extension) -> Take:
    """A take of a whole body, in the scene, that bends every joint while it walks and turns, two frames of it lost."""
    take = replace(made.take(24, markerset=open_markerset("body26")), rate=60.0)
    empty.scene.mocap_autolabel.take = show_take(empty, take)
    return take


@pytest.fixture
def name_as(extension, monkeypatch) -> Callable[[np.ndarray], None]:
    """Lets the extension name the trajectories of points by a naming that knows: the marker of each, or NO_MARKER."""
    pipeline = ours("core.points.whole_take.pipeline")
    jobs = ours("jobs.points")
    takes = ours("core.data.takes")

    def know(truth: np.ndarray):
        def name(points, rate):
            marker = np.where(np.isfinite(points).all(axis=2), truth, takes.NO_MARKER)
            named = marker != takes.NO_MARKER
            yield takes.Labels(marker, np.where(named, takes.BY_FIT, takes.NO_STEP), named * 1.0, named * 1.0)

        monkeypatch.setattr(pipeline, "namer_of", lambda *_: SimpleNamespace(step=takes.BY_FIT, name=name))
        monkeypatch.setattr(pipeline, "refuse_others", lambda *_: None)
        monkeypatch.setattr(jobs, "chosen_method", lambda *_: "ensemble")  # the set has learned nothing

    return know


def write_walk(folder: Path, xyz: np.ndarray, markerset: MarkerSet, rate: float = 60.0) -> SimpleNamespace:
    """Writes a take of points without names, walk.c3d, and the marker set that is worn in it."""
    residual = np.where(np.isfinite(xyz[..., 0]), 0.0002, np.nan)
    take, worn = folder / "walk.c3d", folder / "toy.markerset.json"
    write_c3d(take, takes.Points(("",) * xyz.shape[1], xyz, residual, rate, 101))
    write_model(worn, Model(markerset))
    own = {"edits": folder / "walk.edits.json", "markerset": str(worn)}
    return SimpleNamespace(folder=folder, take=take, xyz=xyz, names=markerset.markers, **own)


def write_walk_and_ghost(folder: Path, frames=FRAMES, ghost=(1.5, 1.5, 0.2), rate=60.0) -> SimpleNamespace:
    """Writes a take of the toy person, a trajectory a marker, and a ghost's behind them."""
    markerset = toy_markerset()
    xyz = np.concatenate([make_motion(markerset, frames).markers, np.tile(ghost, (frames, 1, 1))], axis=1)
    return write_walk(folder, xyz, markerset, rate)


def write_room(folder: Path, frames: int, lens: float = 0.0) -> SimpleNamespace:
    """Writes room.toml, toy.markerset.json and walk.csv: what four cameras see of a person whom nobody loses."""
    markerset, cameras = toy_markerset(), make_cameras(lens)
    motion = make_motion(markerset, frames)
    for part in (motion.markers, motion.expected, motion.joints, motion.rotations):
        part[3:5] = part[2]
    seen, truth = make_blobs(markerset, cameras, motion)
    write_cameras(folder / "room.toml", cameras)
    write_blobs(folder / "walk.csv", seen, cameras)
    write_model(folder / "toy.markerset.json", Model(markerset))
    paths = {"cameras": "room.toml", "blobs": "walk.csv", "markerset": "toy.markerset.json"}
    known = {"room": cameras, "seen": seen, "truth": truth, "motion": motion, "names": markerset.markers}
    return SimpleNamespace(folder=folder, **{name: str(folder / path) for name, path in paths.items()}, **known)


def open_room(files: SimpleNamespace):
    """Imports what `write_room` wrote by the extension's buttons."""
    press("import_cameras", filepath=files.cameras)
    press("import_blobs", filepath=files.blobs)
    press("open_markerset", filepath=files.markerset)
    bpy.context.scene.mocap_autolabel.source.rate = 60.0


def labelled_by_job(files, out: Path, **more) -> Path:
    """The folder in which the job of the command line has labelled the take of points."""
    jobs = ours("jobs")
    finished(jobs.label_file(jobs.LabelJob(files.take, None, str(files.folder / "toy.markerset.json"), out, **more)))
    return out


def label_walk(folder: Path):
    """Labels the take that `write_walk` wrote by the extension's buttons."""
    press("import_points", filepath=folder / "walk.c3d")
    press("open_markerset", filepath=folder / "toy.markerset.json")
    press("label")


def rows_of_export(path) -> list[list[str]]:
    press("export_labels", filepath=path)
    return [line.split(",") for line in path.read_text().splitlines()[1:]]


@pytest.fixture
def files(tmp_path):
    """A take of points of a person, a trajectory a marker and a ghost behind them."""
    return write_walk_and_ghost(tmp_path)


@pytest.fixture
def labelled(extension, empty, files, name_as):
    """The take in a scene, named as it is, by a naming that knows."""
    name_as(np.where(np.arange(GHOST + 1) == GHOST, takes.NO_MARKER, np.arange(GHOST + 1)))
    label_walk(files.folder)
    empty.scene.frame_set(120)
    return empty
