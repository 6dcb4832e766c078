# SPDX-License-Identifier: GPL-3.0-or-later
"""Real blobs of real cameras: a person stands and moves the arms, and eleven cameras see it for ten seconds.

A model is learned from the first half of the recorded markers, and the second half's blobs are named with it, all by
the command line. The truth is the recorder's own labelling, projected: a blob within 8 px of it has a name, so that
some blobs of the body have none.
"""

from pathlib import Path

from addon.core.data.takes import Points
from addon.io.cameras import read_cameras, write_cameras
from addon.io.points import read_points, write_c3d

from .commands import Files, command
from .people import DATA

TAKE = DATA / "blobs" / "qualisys_run"
LEARNED, TESTED = (1, 500), (501, 1000)  # frames
MOVED = ("15343", "15344")


def available() -> bool:
    """Whether the recording is on this machine."""
    return TAKE.is_dir()


def learn(folder: Path) -> Path:
    """The model that `train` makes of the first half, without partial solvers."""
    take = read_points(TAKE / "run.c3d")
    part = slice(LEARNED[0] - take.first_frame, LEARNED[1] - take.first_frame + 1)
    half, model = folder / "half.c3d", folder / "run.markerset.json"
    write_c3d(half, Points(take.names, take.xyz[part], take.residual[part], take.rate, LEARNED[0]))
    command("train", half, "--out", model, "--search", "none")
    return model


def recorded(folder: Path, model: Path, without: tuple[str, ...] = ()) -> Files:
    """The recording's blobs, truth and calibration, less some cameras."""
    rate = read_points(TAKE / "run.c3d").rate
    files = Files(TAKE / "run.csv", TAKE / "run.truth.csv", TAKE / "room.toml", model, rate)
    if not without:
        return files
    cameras = read_cameras(files.cameras)
    folder.mkdir(exist_ok=True)
    fewer = Files(folder / "fewer.csv", folder / "fewer.truth.csv", folder / "fewer.toml", model, rate)
    write_cameras(fewer.cameras, cameras.select([i for i, name in enumerate(cameras.names) if name not in without]))
    for whole, part in ((files.blobs, fewer.blobs), (files.truth, fewer.truth)):
        lines = whole.read_text(encoding="utf-8").splitlines(keepends=True)
        part.write_text("".join(line for line in lines if line.split(",")[1] not in without), encoding="utf-8")
    return fewer
