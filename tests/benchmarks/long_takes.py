# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory of a long take, stage by stage: python -m tests.benchmarks.long_takes blobs|points [--frames N] [--blend].

The demo's virtual person goes back the way it came, and so on, until the take is as long as asked: an hour at 120 Hz
unless said. It is labelled from file to files. With --blend a Blender file is saved as well, and opened, played and
saved again by another process. Linux only.
"""

import argparse
import subprocess
import sys
import tempfile
from itertools import groupby
from pathlib import Path
from time import process_time

from addon.demo.take import MODEL
from addon.jobs import LabelJob, label_file
from scripts.results import markdown
from scripts.virtual_take import write_virtual_points, write_virtual_take

RATE, ONCE = 120.0, 300  # frames a second, and frames of blobs that are captured and gone through again and again
PLAYED = 300  # frames


def megabytes(key: str) -> float:
    """What the system says of this process under a key: VmRSS now, VmHWM at its peak since `forget_peak`."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(key))


def forget_peak():
    """Lets the peak be that of what follows."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def write_blobs(folder: Path, frames: int) -> Path:
    """Writes cameras.toml and a long take.csv."""
    write_virtual_take(folder, ONCE)
    path = folder / "take.csv"
    head, *lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    rows = [
        [line.partition(",")[2] for line in some] for _, some in groupby(lines, lambda line: line.partition(",")[0])
    ]
    there_and_back = [*rows, *rows[-2:0:-1]]
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(head)
        for frame in range(frames):
            file.writelines(f"{frame + 1},{row}" for row in there_and_back[frame % len(there_and_back)])
    return path


def measure(job: LabelJob):
    """Labels the take and prints a row for every stage."""
    before, stage, begin, rows = megabytes("VmRSS"), "read", process_time(), []
    forget_peak()

    def ended():
        rows.append([stage, f"{megabytes('VmHWM') - before:.0f}", f"{process_time() - begin:.0f}"])

    for step in label_file(job):
        note = "name" if step.note.startswith("frame ") else step.note
        if note != stage:
            ended()
            stage, begin = note, process_time()
            forget_peak()
    ended()
    print(f"{before:.0f} MB before the take\n\n{markdown(['stage', 'peak beyond, MB', 'seconds'], rows)}", flush=True)


def open_saved(path: Path):
    """Opens a Blender file, plays a part of it and saves it again."""
    import bpy

    before, begin = megabytes("VmRSS"), process_time()
    rows = []

    def done(what: str):
        nonlocal begin
        rows.append([what, f"{megabytes('VmHWM') - before:.0f}", f"{process_time() - begin:.2f}"])
        begin = process_time()

    bpy.ops.wm.open_mainfile(filepath=str(path))
    done("open")
    scene = bpy.context.scene
    middle = (scene.frame_start + scene.frame_end) // 2
    for frame in range(middle, middle + PLAYED):
        scene.frame_set(frame)
    done(f"play {PLAYED} frames")
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    done("save again")
    print(markdown(["Blender file", "peak beyond, MB", "seconds"], rows), flush=True)


def main():
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=("blobs", "points"))
    parser.add_argument("--frames", type=int, default=432_000)
    parser.add_argument("--blend", action="store_true", help="save a Blender file as well, and open it")
    parser.add_argument("--open", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.open:
        open_saved(given.open)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if given.kind == "blobs":
            path, cameras = write_blobs(folder, given.frames), folder / "cameras.toml"
        else:
            write_virtual_points(folder, given.frames)
            path, cameras = folder / "walk.c3d", None
        print(f"{given.frames:,} frames, {path.stat().st_size / 1e6:,.0f} MB")
        measure(LabelJob(path, cameras, MODEL, out=folder / "out", rate=RATE, blend=given.blend))
        if given.blend:
            again = "tests.benchmarks.long_takes", given.kind, "--open", str(folder / "out" / f"{path.stem}.blend")
            subprocess.run([sys.executable, "-m", *again], check=True)


if __name__ == "__main__":
    main()
