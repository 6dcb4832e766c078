# SPDX-License-Identifier: GPL-3.0-or-later
"""A small room with a virtual person in it, and the command line run in this process."""

import csv
import errno
import json
import os
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from addon.capturing import truth_path
from addon.cli import main
from addon.core.data.takes import Points
from addon.core.points.models import Model
from addon.demo.take import MODEL, STAGE_RATE
from addon.io.markersets import open_markerset
from addon.io.models import write_model
from addon.io.points import write_c3d
from scripts.virtual_take import write_virtual_take

FRAMES = (100, 119)


@dataclass(frozen=True)
class Room:
    """Files of a short take: cameras, blobs and their truth, and the take as a labelled C3D."""

    folder: Path
    cameras: Path
    blobs: Path
    truth: Path
    c3d: Path

    @property
    def files(self) -> tuple[Path, ...]:
        return self.c3d, self.blobs, self.cameras


@dataclass(frozen=True)
class Answer:
    """What a command line came to."""

    status: int
    out: str
    err: str

    @property
    def reason(self) -> str:
        """The last line on standard error, which must have the contract's form."""
        assert self.status in (1, 2)
        assert "Traceback" not in self.err
        line = self.err.splitlines()[-1]
        assert line.startswith("mocap-autolabel: ")
        assert "; expected " in line
        return line.removeprefix("mocap-autolabel: ")

    def done(self) -> "Answer":
        """Itself, of one that did its job."""
        assert self.status == 0, self.err
        return self

    def quiet(self) -> "Answer":
        """The same of one that had no word of trouble."""
        assert (self.status, self.err) == (0, "")
        return self

    @property
    def json(self) -> dict:
        return json.loads(self.out)

    def refusal(self, status: int) -> str:
        """The same of one that ended with a status."""
        assert self.status == status
        return self.reason


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def report_of(path: Path) -> dict:
    """A take's report, by any of its results."""
    return json.loads(path.with_name(path.name.partition(".")[0] + ".report.json").read_text(encoding="utf-8"))


def lengthened(source: Path, target: Path, times: int) -> Path:
    """Writes a take of blobs so many times as long."""
    head, *rows = source.read_text().splitlines()
    parts = [row.partition(",") for row in rows]
    length = int(parts[-1][0]) - int(parts[0][0]) + 1
    each = (f"{int(frame) + number * length},{rest}" for number in range(times) for frame, _, rest in parts)
    target.write_text("\n".join([head, *each, ""]))
    return target


def no_room(number: int = errno.ENOSPC):
    """What a full disk, or memory, says."""
    raise OSError(number, os.strerror(number))


@pytest.fixture(scope="session")
def room(tmp_path_factory) -> Room:
    folder = tmp_path_factory.mktemp("room")
    take = write_virtual_take(folder, FRAMES[1], FRAMES[0], "walk.csv", "room.toml")
    files = Room(folder, folder / "room.toml", folder / "walk.csv", folder / "walk.csv.truth.csv", folder / "take.c3d")
    assert truth_path(files.blobs) == files.truth
    write_c3d(files.c3d, Points(take.names, take.xyz, np.zeros(take.xyz.shape[:2]), STAGE_RATE, take.first_frame))
    return files


@pytest.fixture
def copies(room, tmp_path):
    """Copies the room's blobs, or another file, to a folder `takes` under other names."""

    def copy(*names: str, source: Path = room.blobs) -> list[Path]:
        (tmp_path / "takes").mkdir(exist_ok=True)
        return [Path(shutil.copy(source, tmp_path / "takes" / f"{name}{source.suffix}")) for name in names]

    return copy


@pytest.fixture
def run(capsys):
    def call(*words) -> Answer:
        capsys.readouterr()
        status = main([str(word) for word in words])
        said = capsys.readouterr()
        return Answer(status, said.out, said.err)

    return call


@pytest.fixture
def label(run, room, tmp_path):
    def call(*words, blobs=None, cameras=None) -> Answer:
        inputs = blobs or [room.blobs]
        where = ["--cameras", cameras or room.cameras, "--out", tmp_path / "out"]
        return run("label", *inputs, "--model", MODEL, *where, *words)

    return call


@pytest.fixture
def figures(run):
    def call(labels, truth, *words) -> dict:
        return run("evaluate", labels, truth, "--json", *words).done().json

    return call


@pytest.fixture(scope="session")
def trained(room, tmp_path_factory) -> Path:
    model = tmp_path_factory.mktemp("trained") / "me.markerset.json"
    assert main(["train", str(room.c3d), "--out", str(model), "--search", "none"]) == 0
    return model


@pytest.fixture(scope="session")
def bare(tmp_path_factory) -> Path:
    """gait15 as a file that has learned nothing of points."""
    path = tmp_path_factory.mktemp("bare") / "bare.markerset.json"
    write_model(path, Model(replace(open_markerset("gait15"), name="bare")))
    return path
