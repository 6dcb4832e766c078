# SPDX-License-Identifier: GPL-3.0-or-later
"""A small valid file of every format that is read, made up here: what the readers' tests start from."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from addon.core.data.takes import Blobs, Points
from addon.core.geometry.cameras import Cameras
from addon.core.papers.partial_solvers.model import Classifiers, PartialSolvers, Record, Solver, Strong
from addon.core.points.models import CheckedTake, Model, ModelHistory, ModelVersion, TaughtTake, TrainingTake
from addon.core.simulation.rigs import ring_rig
from addon.io.cameras import write_cameras
from addon.io.points import write_c3d, write_trc
from addon.io.world import Z_UP_FROM_Y_UP
from tests.core.toybody import toy_markerset
from tests.io.c3d_layouts import DEC, MIPS, Layout
from tests.io.qtm_file import FILLED, MEASURED, Recording, Trajectory, write_qtm

TURN = np.diag([1.0, -1.0, -1.0])
BLOBS = "frame,camera,x,y,area\n" + "".join(
    f"{frame},cam_{1 + row % 3},{100.25 + 7 * row},{-3.5 + row},{'' if row % 4 == 0 else 12.5}\n"
    for frame in (7, 8, 8, 10, 11)
    for row in range(4)
)


def ring(count: int = 4, distortion=(-0.1, 0.05, 0.001, -0.002, 0.01), names=None) -> Cameras:
    """Cameras in a circle around the room, each with a lens and a place of its own, looking at a person."""
    rig = ring_rig(count, (656, 491), 3.0, 1.5, 1.0, np.random.default_rng(3))
    matrix = np.array([[[f, 0, 320.25], [0, f + 1.5, 243.75], [0, 0, 1]] for f in 600 + 10.5 * np.arange(count)])
    names = tuple(names or (f"cam_{index + 1}" for index in range(count)))
    return replace(rig, names=names, matrix=matrix, distortion=np.tile(distortion, (count, 1)))


def row(values) -> str:
    return " ".join(f"{value:.15g}" for value in np.ravel(values))


def xcp(cameras: Cameras, radial=(3e-8, -1e-14)) -> str:
    """A Vicon calibration with two key frames a camera, of which the last counts; square pixels."""
    parts = []
    for index, name in enumerate(cameras.names):
        focal, centre = cameras.matrix[index, 0, 0], cameras.matrix[index, :2, 2]
        good = (
            f'FOCAL_LENGTH="{focal:.15g}" ORIENTATION="{row(Rotation.from_matrix(cameras.rotation[index]).as_quat())}" '
            f'POSITION="{row(cameras.centres[index] * 1000)}" PRINCIPAL_POINT="{row(centre)}" '
            f'VICON_RADIAL="{row(radial)}"'
        )
        stale = good.replace(f'FOCAL_LENGTH="{focal:.15g}"', 'FOCAL_LENGTH="5"')
        parts.append(
            f'<Camera DEVICEID="{2100 + index}" NAME="{name}" PIXEL_ASPECT_RATIO="1" '
            f'SENSOR_SIZE="{row(cameras.size[index])}" USERID="{index}"><KeyFrames><KeyFrame FRAME="0" {stale}/>'
            f'<KeyFrame FRAME="9" {good}/></KeyFrames></Camera>'
        )
    body = "\n".join(parts)
    return f'<?xml version="1.0" encoding="UTF-8" standalone="no" ?>\n<Cameras VERSION="1.0">\n{body}\n</Cameras>\n'


def qca(cameras: Cameras) -> str:
    parts = []
    for index, name in enumerate(cameras.names):
        rotation, centre = TURN @ cameras.rotation[index], cameras.centres[index] * 1000
        entries = " ".join(f'r{1 + i}{1 + j}="{rotation[i, j]:.15g}"' for i in range(3) for j in range(3))
        matrix, lens = cameras.matrix[index] * 64, cameras.distortion[index]
        size = cameras.size[index] * 64 - 1
        parts.append(
            f'<camera active="1" serial="{name}"><transform x="{centre[0]:.15g}" y="{centre[1]:.15g}" '
            f'z="{centre[2]:.15g}" {entries}/><intrinsic focalLengthU="{matrix[0, 0]:.15g}" '
            f'focalLengthV="{matrix[1, 1]:.15g}" centerPointU="{matrix[0, 2]:.15g}" centerPointV="{matrix[1, 2]:.15g}" '
            f'skew="0" sensorMinU="0" sensorMaxU="{size[0]}" sensorMinV="0" sensorMaxV="{size[1]}" '
            f'radialDistortion1="{lens[0]}" radialDistortion2="{lens[1]}" radialDistortion3="{lens[4]}" '
            f'tangentalDistortion1="{lens[2]}" tangentalDistortion2="{lens[3]}"/></camera>'
        )
    return f'<?xml version="1.0"?>\n<calibration><cameras>\n{chr(10).join(parts)}\n</cameras></calibration>\n'


def mcal(cameras: Cameras) -> bytes:
    parts = []
    for index, name in enumerate(cameras.names):
        to_world = Z_UP_FROM_Y_UP.T @ cameras.rotation[index].T @ TURN
        position = Z_UP_FROM_Y_UP.T @ cameras.centres[index]
        entries = " ".join(f'OrientMatrix{i}="{value:.15g}"' for i, value in enumerate(to_world.ravel()))
        matrix, lens = cameras.matrix[index], cameras.distortion[index]
        parts.append(
            f'<Camera Serial="{name}"><Properties CameraID="{index}"/><Attributes '
            f'ImagerPixelWidth="{cameras.size[index, 0]:g}" ImagerPixelHeight="{cameras.size[index, 1]:g}"/>'
            f'<Intrinsic LensCenterX="1" LensCenterY="1" HorizontalFocalLength="1" VerticalFocalLength="1" k1="0.5"/>'
            f'<IntrinsicStandardCameraModel LensCenterX="{matrix[0, 2]}" LensCenterY="{matrix[1, 2]}" '
            f'HorizontalFocalLength="{matrix[0, 0]}" VerticalFocalLength="{matrix[1, 1]}" k1="{lens[0]}" '
            f'k2="{lens[1]}" k3="{lens[4]}" TangentialX="{lens[2]}" TangentialY="{lens[3]}"/>'
            f'<Extrinsic X="{position[0]:.15g}" Y="{position[1]:.15g}" Z="{position[2]:.15g}" {entries}/></Camera>'
        )
    text = (
        '<?xml version="1.0" encoding="UTF-16LE"?>\n<calibrationProfile version="1"><Calibration>'
        f'<Cameras Count="{len(cameras)}">\n{chr(10).join(parts)}\n</Cameras></Calibration></calibrationProfile>\n'
    )
    return text.encode("utf-16")


def opencv_matrix(name: str, values: np.ndarray) -> str:
    values = np.atleast_2d(values)
    flat = [f"{value:.16e}" for value in values.ravel()]
    lines = ",\n       ".join(", ".join(flat[start : start + 3]) for start in range(0, len(flat), 3))
    return (
        f"{name}: !!opencv-matrix\n   rows: {values.shape[0]}\n   cols: {values.shape[1]}\n   dt: d\n"
        f"   data: [ {lines} ]\n"
    )


def yml(cameras: Cameras, intrinsics: bool = True, extrinsics: bool = True) -> str:
    """One file, or either of the pair, in the way that EasyMocap names its parts."""
    text = "%YAML:1.0\n---\nnames:\n" + "".join(f'   - "{name}"\n' for name in cameras.names)
    for index, name in enumerate(cameras.names):
        if intrinsics:
            text += opencv_matrix(f"K_{name}", cameras.matrix[index])
            text += opencv_matrix(f"dist_{name}", cameras.distortion[index])
            text += f"W_{name}: {cameras.size[index, 0]:.0f}\nH_{name}: {cameras.size[index, 1]:.0f}\n"
        if extrinsics:
            text += opencv_matrix(f"Rot_{name}", cameras.rotation[index])
            text += opencv_matrix(f"T_{name}", cameras.translation[index][:, None])
    return text


def write_selfcal(folder: Path, cameras: Cameras):
    """A folder of self-calibration; a projection matrix is good up to its scale and sign."""
    folder.mkdir(exist_ok=True)
    np.savetxt(folder / "Res.dat", cameras.size, fmt="%d")
    (folder / "camera_order.txt").write_text("\n".join(cameras.names) + "\n")
    for index in range(len(cameras)):
        matrix, lens = cameras.matrix[index], cameras.distortion[index]
        projection = -2.5 * matrix @ cameras.extrinsics[index]
        head = "# Created by Octave\n# name: Pmat\n# type: matrix\n# rows: 3\n# columns: 4\n"
        body = "\n".join(" " + row(values) for values in projection)
        (folder / f"camera{index + 1}.Pmat.cal").write_text(head + body + "\n")
        rad = "".join(f"K{i + 1}{j + 1} = {matrix[i, j]:.15g}\n" for i in range(3) for j in range(3))
        rad += "".join(f"kc{i + 1} = {lens[i]:.15g}\n" for i in range(4))
        (folder / f"basename{index + 1}.rad").write_text(rad)


def walk(frames: int = 6, points: int = 4, rate: float = 120.0, first: int = 33) -> Points:
    """A take of a few markers on an upright body, with two gaps; the first trajectory has no name."""
    time = np.arange(frames)[:, None]
    height = np.linspace(0.05, 1.7, points)
    shape = (frames, points)
    xyz = np.stack([np.broadcast_to(0.01 * time, shape), np.broadcast_to(0.1 * np.sin(height), shape)], axis=2)
    xyz = np.concatenate([xyz, np.broadcast_to(height[:, None], (frames, points, 1))], axis=2)
    xyz[1, 1:3] = np.nan
    names = ("", *(f"M{index}" for index in range(1, points)))
    return Points(names, xyz, np.where(np.isnan(xyz[..., 0]), np.nan, 0.0005), rate, first)


def vicon(frames: int = 5) -> str:
    """A Vicon export, z up, mm: a force plate's section, then a marker, one without a name and a marker's speed."""
    plate = "Devices\n1000\n,,Plate,,\nFrame,Sub Frame,Fx,Fy,Fz\n,,N,N,N\n10,0,0,0,-700\n10,1,0,0,-701\n\n"
    head = "Trajectories\n100\n,,Ann:LASI,,,*7,,,Ann:LASI,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z,X',Y',Z'\n"
    head += ",,mm,mm,mm,mm,mm,mm,mm/s,mm/s,mm/s\n"
    rows = ""
    for frame in range(10, 10 + frames):
        gap = ",,," if frame == 12 else f",{100 + frame},{200 + frame},{990 + frame}.5"
        rows += f"{frame},0{gap},11,22,33,1,2,3\n"
    return f"{plate}{head}{rows}\nModel Outputs\n100\n,,Ann:LHipAngles,,\n"


def motive() -> str:
    """A Motive export, y up, mm: one labelled, one unlabelled marker and a rigid body that is no marker."""
    head = (
        "Format Version,1.23,Take Name,test,Capture Frame Rate,240.000000,Export Frame Rate,120.000000,"
        "Length Units,Millimeters,Coordinate Space,Global\n\n"
        ",Type" + ",Rigid Body" * 7 + ",Marker" * 6 + "\n"
        ",Name" + ",Wand" * 7 + ",Ann:LASI" * 3 + ",Unlabeled 1036" * 3 + "\n"
        ",ID" + ",1" * 7 + ",2" * 3 + ",3" * 3 + "\n"
        ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position" + ",Position" * 6 + "\n"
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,X,Y,Z,X,Y,Z\n"
    )
    rows = ""
    for frame in range(5):
        gap = ",,," if frame == 2 else f",{100 + frame},{1000 + frame},{-200 - frame}"
        rows += f"{frame},{frame / 120:.6f},0,0,0,1,5,6,7{gap},11,22,33\n"
    return head + rows


def tsv(frames: int = 5, numbered: bool = True, titled: bool = True) -> str:
    """A Qualisys export, mm: a labelled marker with a gap, one that was not identified, and one never seen."""
    titles = [f"{name} {axis}" for name in ("LASI", "", "RASI") for axis in "XYZ"]
    lines = [
        *(f"NO_OF_FRAMES\t{frames}", "NO_OF_CAMERAS\t8", "NO_OF_MARKERS\t3", "FREQUENCY\t120", "NO_OF_ANALOG\t0"),
        *("DESCRIPTION\t--", "TIME_STAMP\t2026-01-19, 10:19:43.755\t20.5", "DATA_INCLUDED\t3D"),
        *("EVENT\tstep\t9\t0.066667", "MARKER_NAMES\tLASI\t\tRASI", "TRAJECTORY_TYPES\tMeasured\tMeasured\tMixed"),
        *(["\t".join([*(["Frame", "Time"] if numbered else []), *titles, ""])] if titled else []),
    ]
    for frame in range(frames):
        seen = ["", "", ""] if frame == 2 else [100 + frame, 200 + frame, 1000 + frame]
        ahead = [7 + frame, f"{frame / 120:.5f}"] if numbered else []
        lines.append("\t".join(map(str, [*ahead, *seen, 11, 22, 33, "0.000", "0.000", "0.000"])))
    return "\r\n".join(lines) + "\r\n"


WALK = TaughtTake("walk ü.c3d", "Ann", 900, "ab" * 32, "../takes/walk ü.c3d", "-y", 120.0)
SHOWN = TaughtTake("from the scene", "Bob", 3)
HISTORY_OF_TWO = ModelHistory(
    (
        ModelVersion(1, "2026-11-22", "Ann", "0.1.0", "", (WALK, SHOWN)),
        ModelVersion(
            2, program="0.1.0", origin="cd" * 32, checked=(CheckedTake("k", (1.0, 0.5), (0.0, 0.25)),), told=True
        ),
    ),
    (replace(WALK, path="kept.c3d"),),
)


def toy_model() -> Model:
    """A model with one partial solver and a training take."""
    markerset = toy_markerset()
    count = len(markerset)
    classifiers = Classifiers(np.array([1, 3]), np.array([[0, 1, -1, -1], [1, 2, -1, -1]]), np.zeros(2), np.ones(2) / 3)
    record = Record(np.array([3.0, 2]), np.array([0.0, 1]), np.array([3.0, 3]), 4)
    solver = Solver(np.array([0, 1]), Strong(np.array([0]), np.array([0.5])), record, np.array([True, False]))
    solvers = PartialSolvers(markerset.markers, classifiers, (solver,), np.full(count, 0.9999), "top-down", 3, 17)
    points = np.random.default_rng(0).normal(size=(4, count, 3)).astype(np.float32)
    points[1, 0] = np.nan
    takes = (TrainingTake("Ann", ("walk ü", "run"), 900, points),)
    return Model(markerset, partial_solvers=solvers, training_takes=takes)


def capture() -> Recording:
    """Blobs of four cameras and a labelled trajectory."""
    chance = np.random.default_rng(3)
    frame = np.repeat(np.arange(6), 8)
    seen = np.tile(np.arange(4), 12), chance.uniform(10, 400, (48, 2)), np.full(48, 12.5)
    walk = [(10.0 * at, 20.0, 900.0, 0.5, FILLED if at == 3 else MEASURED) for at in range(6)]
    cameras = ring(4, (-0.1, 0.05, 0.001, -0.002, 0.0), ("101", "102", "103", "104"))
    return Recording(cameras, Blobs(7 + np.arange(6), frame, *seen), [Trajectory("LASI", [(7, 12)], walk)])


def write_all(folder: Path) -> dict[str, Path]:
    """One file of every format; the name says which reader it is for."""
    cameras, take = ring(), walk()
    names = {
        "toml": "cameras.toml", "xcp": "cameras.xcp", "qca": "cameras.qca.txt", "mcal": "cameras.mcal",
        "yml": "cameras.yml", "pmat": "selfcal/camera1.Pmat.cal", "rad": "selfcal/basename2.rad",
        "res": "selfcal/Res.dat", "blobs": "blobs.csv", "qtm": "capture.qtm", "labels": "take.labels.csv",
        "c3d": "take.c3d", "dec": "dec.c3d", "mips": "mips.c3d", "trc": "take.trc", "motive": "motive.csv",
        "tsv": "take.tsv",
    }  # fmt: skip
    files = {kind: folder / name for kind, name in names.items()}
    texts = {
        "xcp": xcp(cameras), "qca": qca(cameras), "mcal": mcal(cameras), "yml": yml(cameras), "blobs": BLOBS,
        "labels": "frame,camera,x,y,marker,step,confidence\n1,a,2,3,LASI|RASI,exclusive,0.5\n1,a,2,4,,,0\n",
        "dec": Layout(processor=DEC).content(), "mips": Layout(processor=MIPS).content(),
        "motive": motive(), "tsv": tsv(),
    }  # fmt: skip
    for kind, text in texts.items():
        files[kind].write_bytes(text if isinstance(text, bytes) else text.encode())
    write_cameras(files["toml"], cameras)
    write_selfcal(folder / "selfcal", cameras)
    write_c3d(files["c3d"], take)
    write_trc(files["trc"], take)
    write_qtm(files["qtm"], capture())
    return files
