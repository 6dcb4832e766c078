# SPDX-License-Identifier: GPL-3.0-or-later
"""Real blobs of real cameras: a person stands and moves the arms, and eleven cameras see it for ten seconds.

A model is learned from the first half of the recorded markers, and the second half's blobs are named with it, all by
the command line. The truth is the recorder's own labelling, projected: a blob within 8 px of it has a name, so that
some blobs of the body have none.
"""

from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from time import process_time

from addon.cli import main
from addon.core.data.takes import Points
from addon.io.cameras import read_cameras, write_cameras
from addon.io.points import read_points, write_c3d

from .people import DATA

TAKE = DATA / "blobs" / "qualisys_run"
LEARNED, TESTED = (1, 500), (501, 1000)  # frames
MOVED = ("15343", "15344")


@dataclass(frozen=True)
class Files:
    """A take of blobs as files, the model that names it, and its rate in frames a second."""

    blobs: Path
    truth: Path
    cameras: Path
    model: Path | str
    rate: float


def available() -> bool:
    """Whether the recording is on this machine."""
    return TAKE.is_dir()


def command(*words):
    """Runs a command line; RuntimeError where it fails."""
    with redirect_stdout(StringIO()) as said:
        status = main([str(word) for word in words])
    if status:
        raise RuntimeError(f"{words} ended with status {status}: {said.getvalue()}")


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


def labelled(take: Files, out: Path) -> tuple[Path, float]:
    """The labels file that `label` writes of the second half without hints, and its seconds of one core.

    They hold reading and writing too, and depend little on what else the machine does.
    """
    where = ("--cameras", take.cameras, "--model", take.model, "--rate", take.rate, "--out", out, "--overwrite")
    begin = process_time()
    command("label", take.blobs, *where, "--frames", "{}:{}".format(*TESTED), "--occlusion", "capsules")
    return out / f"{take.blobs.stem}.labels.csv", process_time() - begin
