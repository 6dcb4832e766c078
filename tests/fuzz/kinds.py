# SPDX-License-Identifier: GPL-3.0-or-later
"""The kinds of files that are broken: a sound one, its reader, and what is done with what was read."""

import json
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np

from addon.core.data.errors import InputError
from addon.core.edits.kinds import Edits, Place, Swap
from addon.core.points.models import Model
from addon.io.batch import FAILING, LABELLED, TakeRow, read_table, write_table
from addon.io.blobs import read_blobs
from addon.io.cameras import read_cameras, write_cameras
from addon.io.edits import read_edits, write_edits
from addon.io.labels import LabelFile
from addon.io.markersets import read_markerset
from addon.io.models import read_model, write_model
from addon.io.points import read_points, write_c3d, write_trc
from addon.io.provenance import differences, earlier_run, open_provenance, sealed
from addon.io.source import digest
from addon.jobs.training_takes import read_takes
from tests.core.toybody import toy_markerset
from tests.io.samples import HISTORY_OF_TWO, ring, toy_model, walk, write_all

from . import streams

# What the sound report says that it was made of.
MADE = {
    "version": "1", "options": {"method": "auto"}, "input": [{"file": "../nowhere.csv", "sha256": "ab"}], "cameras": [],
    "model": [{"file": "gait15", "sha256": "ab"}], "edits": [],
}  # fmt: skip
POINTS = ("c3d", "dec", "mips", "trc", "motive", "tsv")
CALIBRATIONS = ("toml", "xcp", "qca", "mcal", "yml", "pmat", "rad", "res")


def _blobs(path: Path):
    return sum(len(rows.blobs) for rows in read_blobs(path, ring()))


def _labels(path: Path, what: str = "labels"):
    with LabelFile(path, what) as file:
        return sum(1 for _ in file.rows())


def _capture(path: Path):
    """The points, after the cameras and the blobs."""
    cameras = read_cameras(path)
    sum(len(rows.blobs) for rows in read_blobs(path, cameras))
    return read_points(path)


def _take(path: Path):
    read_points(path, everything=True)
    return read_points(path)


def _report(path: Path):
    """A take that was labelled here: by its report the job is passed over, and what is worth learning is known."""
    with suppress(InputError):
        differences(path, open_provenance(path), "1", path)
    earlier_run(path, MADE)
    return read_takes([path.with_name("taught.c3d")], [])


READERS: dict[str, Callable[[Path], object]] = {
    **dict.fromkeys(CALIBRATIONS, read_cameras), "res": lambda path: read_cameras(path.parent), "blobs": _blobs,
    "labels": _labels, "truth": partial(_labels, what="truth"), **dict.fromkeys(POINTS, _take), "qtm": _capture,
    "markerset": read_markerset, "model": read_model, "edits": read_edits, "history": read_model,
    "summary": read_table, "report": _report,
    **{kind: partial(streams.read_stream, kind) for kind in streams.KINDS},
}  # fmt: skip


def samples(folder: Path) -> dict[str, Path]:
    """A sound file of every kind."""
    files = write_all(folder)
    files["truth"] = folder / "take.csv.truth.csv"
    files["truth"].write_text('frame,point,marker\n1,0,LASI\n1,3,"LASI|RASI"\n2,0,\n')
    files["markerset"], files["model"] = folder / "toy.markerset.json", folder / "model.markerset.json"
    write_model(files["markerset"], Model(toy_markerset()))
    write_model(files["model"], toy_model())
    files["history"] = folder / "history.markerset.json"
    write_model(files["history"], Model(toy_markerset(), history=HISTORY_OF_TWO))
    files["summary"] = folder / "summary.csv"
    rows = [TakeRow("b", "b.csv", FAILING, reason="b.csv: is empty"), TakeRow("a", "a, 1.csv", LABELLED, 2, 31.5, 0.98)]
    write_table(files["summary"], rows)
    files["edits"] = folder / "take.edits.json"
    write_edits(files["edits"], Edits((Swap(("LKNE", "RKNE"), frames=(1, 9)), Place("C7", 3, (0.1, 0.2, 1.4)))))
    files["report"] = _taught(folder / "taught.c3d")
    for kind in streams.KINDS:
        files[kind] = folder / f"{kind}.stream"
        files[kind].write_bytes(streams.sound_stream(kind))
    return files


def _taught(take: Path) -> Path:
    """A take of seven markers that was labelled here, and the report beside it, which is the file of this kind."""
    write_c3d(take, walk(points=8))
    report = take.with_name(take.stem + ".report.json")
    made = MADE | {"results": {".c3d": digest(take)}}
    filled = [{"marker": "M2", "first": 34, "last": 35, "method": "spline"}]
    doubtful = {"M1": [[33, 34]], "M3": [[36, 36]]}
    rows = {"doubtful": doubtful, "filled": filled}
    report.write_text(json.dumps(sealed({"take": take.stem, "provenance": made} | rows)))
    return report


def _cameras_again(cameras, folder: Path):
    write_cameras(folder / "again.toml", cameras)
    again = read_cameras(folder / "again.toml")
    if again.names != cameras.names or not np.array_equal(again.matrix, cameras.matrix):
        raise AssertionError("the cameras are others once they were written")
    cameras.undistort(np.tile([[3.0, 4.0]], (len(cameras), 1)), np.arange(len(cameras)))
    cameras.project(np.array([[0.0, 0.0, 1.0]]))


def _points_again(points, folder: Path):
    if not 1e-6 < np.nanmax(np.abs(points.xyz), initial=0) < 1e5:
        # A text has noughts for a micrometre, which stand for no point; and of what is farther than any room, a C3D
        # file leaves out what is too large in its own unit, and a text in mm.
        return
    for write, name in ((write_c3d, "again.c3d"), (write_trc, "again.trc")):
        try:
            write(folder / name, points)
        except InputError as error:  # a format may have no room for a take
            if "; expected" not in error.message:
                raise
            continue
        again = read_points(folder / name, everything=True, up="z")
        if len(again.xyz) != len(points.xyz):
            raise AssertionError(f"{name} has {len(again.xyz)} frames, and {len(points.xyz)} were written")


def _written_again(write: Callable, read: Callable, name: str) -> Callable[[object, Path], None]:
    def again(value: object, folder: Path):
        (folder / name).unlink(missing_ok=True)
        write(folder / name, value)
        read(folder / name)

    return again


_MODEL_AGAIN = _written_again(write_model, read_model, "again.markerset.json")
# What was read is written and read again: what a writer refuses, the reader should have.
USES: dict[str, Callable[[object, Path], None]] = {
    **dict.fromkeys(CALIBRATIONS, _cameras_again),
    **dict.fromkeys((*POINTS, "qtm"), _points_again),
    "markerset": _written_again(
        lambda path, bare: write_model(path, Model(bare)), read_markerset, "again.markerset.json"
    ),
    "model": _MODEL_AGAIN,
    "history": _MODEL_AGAIN,
    "edits": _written_again(write_edits, read_edits, "again.edits.json"),
    "summary": _written_again(write_table, read_table, "summary.csv"),
    **dict.fromkeys(streams.KINDS, streams.named),
}


def verb_of(kind: str, path: Path, sound: dict[str, Path], out: Path) -> list[str]:
    """One command for the broken file at `path`, as a user would type it next; none for a kind without a verb.

    The sound files of the other kinds stand in `sound`.
    """
    made, to = ["--out", out / "made.c3d", "--overwrite"], ["--out", out, "--overwrite"]
    cameras = path.parent if kind in ("pmat", "rad", "res") else path
    words = {
        **{one: ["reconstruct", sound["blobs"], "--cameras", cameras, *made] for one in CALIBRATIONS},
        **{one: ["label", path, "--model", sound["model"], *to] for one in POINTS},
        **{one: ["label", sound["mips"], "--model", path, *to] for one in ("markerset", "model")},
        "blobs": ["label", path, "--cameras", sound["toml"], "--model", sound["markerset"], *to],
        "qtm": ["reconstruct", path, *made],
        "history": ["models", path],
        "edits": ["label", sound["mips"], "--model", sound["model"], "--edits", path, *to],
        **{labels: ["evaluate", path, sound[labels]] for labels in ("labels", "truth")},
    }
    return [str(word) for word in words.get(kind, ())]
